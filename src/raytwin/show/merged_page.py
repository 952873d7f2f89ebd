"""Reports of several machines as one: a row per test, a column per machine, and which machine is the odd one."""

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from raytwin.errors import InputError
from raytwin.safe_write import write_text
from raytwin.show.check_page import GOOD, INDEX, SUMMARY, CheckRow, cell, read_rows
from raytwin.show.page import write_page


@dataclass(frozen=True)
class MergedRow:
    """A comparison on every machine, None where it was not made."""

    name: str
    found: tuple[CheckRow | None, ...]

    @property
    def verdicts(self) -> tuple[str, ...]:
        return tuple(row.verdict if row else "missing" for row in self.found)

    @property
    def good(self) -> bool:
        return set(self.verdicts) <= set(GOOD)

    @property
    def odd(self) -> tuple[int, ...]:
        """Return which machines, by number, differ from most of them: in verdict, or in how a picture fails."""
        fails = (
            f"{row.rmse or 0:.1e} {row.ratio or 0:.3g}" if row and row.verdict not in GOOD else "" for row in self.found
        )
        said = list(zip(self.verdicts, fails, strict=True))
        usual, count = Counter(said).most_common(1)[0]
        return tuple(i for i, one in enumerate(said) if one != usual and 2 * count > len(said))


def merge(folders: Sequence[Path]) -> list[MergedRow]:
    """Return the rows of what `pytest --raytwin-report` wrote on each machine, odd ones first, then what failed.

    Raises InputError for another folder.
    """
    tables = [{(row.test, row.number, row.scene, row.rung): row for row in read_rows(folder)} for folder in folders]
    if not all(tables):
        raise InputError(folders[tables.index({})], "a report as pytest --raytwin-report writes it", "none")
    keys = sorted({key for table in tables for key in table})
    rows = [MergedRow(" ".join((key[0], *key[2:])), tuple(table.get(key) for table in tables)) for key in keys]
    return sorted(rows, key=lambda row: (not row.odd, row.good))


def machines(folders: Sequence[Path]) -> list[str]:
    """Return what each machine is called: its folder's name, or the whole path where two are alike."""
    names = [folder.resolve().name for folder in folders]
    return names if len(set(names)) == len(names) else [str(folder) for folder in folders]


def sentences(rows: Sequence[MergedRow], names: Sequence[str]) -> list[str]:
    """Return how many comparisons pass everywhere, and which machines are odd, the oddest first."""
    odd = Counter(i for row in rows for i in row.odd)
    said = [f"{sum(row.good for row in rows)} of {len(rows)} comparisons pass on all {len(names)} machines."]
    return said + [f"{names[i]} is the odd one in {count} of {len(rows)}." for i, count in odd.most_common()]


def write_merged(rows: Sequence[MergedRow], folders: Sequence[Path], folder: Path) -> None:
    """Write index.html and summary.md; their pictures and pages stay where the reports are."""
    names, places = machines(folders), [quote(os.path.relpath(path, folder)) for path in folders]
    said = sentences(rows, names)
    lines = [
        f"**{' '.join(said)}**",
        "",
        f"| test | {' | '.join(map(cell, names))} |",
        "| --- " * (len(names) + 1) + "|",
    ]
    for row in rows:
        shown = []
        for i, (place, found, verdict) in enumerate(zip(places, row.found, row.verdicts, strict=True)):
            picture = (
                f"<br>![{verdict}]({place}/{found.error})" if found and found.error and verdict not in GOOD else ""
            )
            shown.append((f"**{verdict}**" if i in row.odd else verdict) + picture)
        lines.append(f"| {cell(row.name)} | {' | '.join(shown)} |")
    write_text(folder / SUMMARY, "\n".join(lines) + "\n")
    about = {"rows": rows, "names": names, "places": places, "said": said, "GOOD": GOOD}
    write_page(folder / INDEX, "merged.html.j2", ("checks.css",), **about)
