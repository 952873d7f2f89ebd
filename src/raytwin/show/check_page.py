"""A test run's comparisons: a page for each as it is made, then an index of all, failures first.

Each comparison leaves `check-<test>-<hash>.json` and, where it has pictures, a page and small PNGs of the same name.
The index and summary.md are made from these files, so that tests may run in many processes at once.
"""

import hashlib
import html
import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from raytwin.compare import Report
from raytwin.errors import InputError
from raytwin.images.image import Image
from raytwin.images.photo_files import write_picture
from raytwin.safe_write import write_text
from raytwin.scene import Tolerance
from raytwin.scene.toml_json import write_json
from raytwin.show import data_urls, laws_page, viewer
from raytwin.show.compare_page import write_report
from raytwin.show.page import write_page
from raytwin.show.terminal_text import counted
from raytwin.show.view import Names, PairView, numbered
from raytwin.study.diff_files import Compared

if TYPE_CHECKING:
    from raytwin.study.laws import Laws

THUMB = 150
"""Pixels across a small picture in the index."""
INDEX, SUMMARY = "index.html", "summary.md"
SCRIPT = "check-viewer.js"
"""The viewer, which all pages of a run share."""
GOOD = ("pass", "differs")
NEW = "new"
"""Folder of the images that may become references."""
PICTURES = "picture", "reference", "error"
"""Fields of a row that name a file."""

NAMES = Names("test", "reference", "The test's image", "The reference")


class CheckRow(msgspec.Struct):
    """A line of the index. `page` and the pictures (files) are empty where there was no image to show."""

    test: str
    number: int
    scene: str
    rung: str
    verdict: str
    reasons: tuple[str, ...]
    notes: tuple[str, ...] = ()
    rmse: float | None = None
    worst: float | None = None
    ratio: float | None = None
    page: str = ""
    picture: str = ""
    reference: str = ""
    error: str = ""


def write_check(
    folder: Path,
    test: str,
    number: int,
    report: Report,
    notes: tuple[str, ...] = (),
    image: Image | None = None,
    reference: Image | None = None,
    tolerance: Tolerance | None = None,
) -> Path | None:
    """Write the row and the page of one comparison of the test called `test`; return the page's path."""
    c, r = report.comparison, report.comparison.radiance
    row = CheckRow(
        test, number, report.scene, report.rung or "", c.verdict, c.reasons, notes, r.rmse, r.max_abs, r.mean_ratio
    )
    stem, page = _stem(test, number), None
    if image is not None and reference is not None:
        tolerance = tolerance or Tolerance()
        view = _view(test, notes, Compared(test=image, reference=reference, report=report, tolerance=tolerance))
        row.page, page = f"{stem}.html", folder / f"{stem}.html"
        write_report(view, page, SCRIPT)
        if view.alike:
            pictures = data_urls.small_pictures(view.test, view.reference, view.tolerance.p999_abs, THUMB)
            for name, pixels in zip(PICTURES, pictures, strict=True):
                setattr(row, name, f"{stem}-{name}.png")
                write_picture(folder / f"{stem}-{name}.png", pixels)
    write_json(folder / f"{stem}.json", row)
    return page


def write_laws(folder: Path, test: str, number: int, found: "Laws") -> Path:
    """Write the row and the page of the laws that a test judged its renderer by; return the page's path."""
    stem = _stem(test, number)
    page = f"laws/{stem}/laws.html"
    laws_page.write_laws(found, (folder / page).parent)
    row = CheckRow(test, number, "laws", found.rung, found.verdict, laws_page.answer(found), page=page)
    write_json(folder / f"{stem}.json", row)
    return folder / page


def write_crash(folder: Path, test: str, number: int, case: str, reason: str) -> None:
    """Write the row of a test that ended before it had compared anything, or failed beside its comparisons."""
    write_json(folder / f"{_stem(test, number)}.json", CheckRow(test, number, case, "", "error", (reason,)))


def _stem(test: str, number: int) -> str:
    short = re.sub(r"[^A-Za-z0-9]+", "-", test.rpartition("/")[2]).strip("-")[:80]
    return f"check-{short}-{hashlib.sha256(f'{test} {number}'.encode()).hexdigest()[:8]}"


def prepare(folder: Path) -> None:
    """Make the folder, without what an earlier run wrote. Raises InputError for a folder that cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        written = [old for kind in ("check-*.*", f"{NEW}/*/*.exr", "laws/*/laws.*") for old in folder.glob(kind)]
        for old in [*written, folder / INDEX, folder / SUMMARY, folder / SCRIPT]:
            old.unlink(missing_ok=True)
    except OSError as error:
        found = "a file" if folder.is_file() else error.strerror or error
        raise InputError(folder, "a folder to write", found) from None
    write_text(folder / SCRIPT, viewer.script())


def write_index(folder: Path) -> tuple[int, int]:
    """Write index.html and summary.md over all comparisons; return how many there are, and how many failed."""
    rows = sorted(read_rows(folder), key=lambda row: (row.verdict in GOOD, row.test, row.number))
    failed = sum(row.verdict not in GOOD for row in rows)
    about = {"rows": rows, "failed": failed, "name": folder.absolute().name}
    write_page(folder / INDEX, "checks.html.j2", ("checks.css",), ("table.js",), **about)
    write_text(folder / SUMMARY, summary(rows, failed))
    return len(rows), failed


def read_rows(folder: Path) -> list[CheckRow]:
    """Return the rows of a report's folder. Raises InputError where one is damaged."""
    try:
        return [msgspec.json.decode(file.read_bytes(), type=CheckRow) for file in sorted(folder.glob("check-*.json"))]
    except msgspec.DecodeError as error:
        raise InputError(folder, "a report as pytest --raytwin-report writes it", error) from None


def summary(rows: list[CheckRow], failed: int) -> str:
    """Return a table in Markdown of what failed, with small pictures, which are files beside it."""
    compared = counted(len(rows), "comparison")
    if failed:
        lines = [f"**{failed} of {compared} failed.**", ""]
        lines += ["| verdict | test | cause | expected | got | difference |", "| --- " * 6 + "|"]
    else:
        said = f"All {compared} pass." if len(rows) > 1 else f"{compared} passes."
        lines = [said if rows else "Nothing was compared."]
    for row in rows[:failed]:
        files = {"expected": row.reference, "got": row.picture, "difference": row.error}
        shown = [f"![{name}]({file})" if file else "" for name, file in files.items()]
        name, scene = cell(row.test.rpartition("/")[2]), cell(" ".join(filter(None, (row.scene, row.rung))))
        what = "<br>".join(filter(None, (f"[{name}]({row.page})" if row.page else name, scene)))
        lines.append(f"| {' | '.join((row.verdict, what, cell(*row.reasons[:1], *row.notes), *shown))} |")
    return "\n".join(lines) + "\n"


def cell(*texts: str) -> str:
    """Return texts as the lines of a table's cell in Markdown: nothing in them is markup."""
    lines = (re.sub(r"([\\`*_\[\]|~])", r"\\\1", html.escape(" ".join(text.split()))) for text in texts)
    return "<br>".join(filter(None, lines))


def _view(test: str, notes: tuple[str, ...], pair: Compared) -> PairView:
    settings = {"test": test, "samples of the reference": str(pair.reference.samples)}
    return PairView(
        pair=replace(pair, report=pair.report.saying(*(f"note: {n}" for n in notes)), settings=settings),
        title=", ".join(filter(None, (pair.report.scene, pair.report.rung))),
        about=("test", test.rpartition("/")[2]),
        names=NAMES,
        motto="a renderer compared with its reference",
        objects=numbered(pair.reference),
    )
