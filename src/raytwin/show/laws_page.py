"""What `raytwin laws` found: its page, a row per law with both pictures, and its lines for the terminal."""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from raytwin.scene.toml_json import write_json
from raytwin.show.data_urls import png_url, small_pictures
from raytwin.show.page import write_page

if TYPE_CHECKING:
    from raytwin.study.laws import Laws

SIGN = {"pass": "✓", "fail": "✗", "undecided": "?", "skipped": "–"}


def write_laws(found: "Laws", folder: Path) -> None:
    """Write laws.html and laws.json."""
    allowed = found.scene.tolerance.p999_abs
    pictures = {
        law: [*map(png_url, small_pictures(*pair, allowed, pair[0].shape[1]))] for law, pair in found.pictures.items()
    }
    write_json(folder / "laws.json", found.numbers())
    about = {"found": found, "pictures": pictures, "SIGN": SIGN, "answer": answer(found)}
    write_page(folder / "laws.html", "laws.html.j2", ("checks.css",), **about)


def answer(found: "Laws") -> tuple[str, str, str]:
    """Return the cause, how many laws hold, and what the worst shows: three sentences."""
    count = Counter(row.verdict for row in found.rows)
    cause = found.cause or {"pass": "no law is broken"}.get(found.verdict, "not every law can be decided")
    skipped = f"; not applicable: {count['skipped']}" if count["skipped"] else ""
    held = f"{count['pass']} of {len(found.rows) - count['skipped']} laws hold{skipped}."
    if found.broken:
        held += f" Broken: {', '.join(row.law for row in found.broken)}."
    worst = "No law sees an error that is the same in every picture."
    if decided := [*found.broken, *(row for row in found.rows if row.verdict == "undecided")]:
        worst = f"{decided[0].law}: {(*decided[0].reasons, decided[0].cause)[0]}."
    return f"{cause[:1].upper()}{cause[1:]}.", held, worst


def laws_summary(found: "Laws") -> str:
    """Return the answer in three lines, then a line per law."""
    cause, held, worst = answer(found)
    lines = [f"{found.verdict.upper()}  {found.subject}, {found.rung}: {cause}", f"  {held}", f"  {worst}"]
    for row in found.rows:
        said = f"{row.does}: {row.reasons[0]}" if row.verdict == "skipped" else row.does
        lines.append(f"  {SIGN[row.verdict]} {row.law:<15} {said}")
    return "\n".join(lines)
