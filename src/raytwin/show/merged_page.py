"""Reports of several machines as one: a row per test, a column per machine, and which machine is the odd one."""

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from raytwin.errors import InputError
from raytwin.safe_write import write_text
from raytwin.show.check_page import GOOD, INDEX, SUMMARY, CheckRow, cell, read_rows
from raytwin.show.page import write_page

MISSING = "missing"


@dataclass(frozen=True)
class MergedRow:
    """A comparison on every machine, None where it was not made."""

    name: str
    found: tuple[CheckRow | None, ...]

    @property
    def verdicts(self) -> tuple[str, ...]:
        return tuple(row.verdict if row else MISSING for row in self.found)

    @property
    def odd(self) -> tuple[int, ...]:
        """Return which machines, by number, differ from most of them: in verdict, or in how a picture fails."""
        said = [
            (verdict, "" if row is None or verdict in GOOD else f"{row.rmse or 0:.1e} {row.ratio or 0:.3g}")
            for verdict, row in zip(self.verdicts, self.found, strict=True)
        ]
        usual, count = Counter(said).most_common(1)[0]
        return tuple(i for i, one in enumerate(said) if one != usual and 2 * count > len(said))


@dataclass(frozen=True)
class Merged:
    """`machines`: name -> its report's folder."""

    machines: dict[str, Path]
    rows: tuple[MergedRow, ...]

    @property
    def sentences(self) -> tuple[str, ...]:
        """How many tests pass everywhere, and which machines are odd, the oddest first."""
        good = sum(set(row.verdicts) <= set(GOOD) for row in self.rows)
        said = f"{good} of {len(self.rows)} comparisons pass on all {len(self.machines)} machines."
        odd = Counter(i for row in self.rows for i in row.odd)
        names = [*self.machines]
        which = (f"{names[i]} is the odd one in {count} of {len(self.rows)}." for i, count in odd.most_common())
        return said, *which

    @property
    def exit_code(self) -> int:
        found = {verdict for row in self.rows for verdict in row.verdicts} - set(GOOD)
        return 1 if found & {"fail", "error"} else 2 if found else 0


def merge(folders: Sequence[Path]) -> Merged:
    """Read what `pytest --raytwin-report` wrote on each machine. Raises InputError for another folder."""
    names = [folder.resolve().name for folder in folders]
    names = names if len(set(names)) == len(names) else [str(folder) for folder in folders]
    tables = []
    for folder in folders:
        tables.append({(row.test, row.number, row.scene, row.rung): row for row in read_rows(folder)})
        if not tables[-1]:
            raise InputError(folder, "a report as pytest --raytwin-report writes it", "none")
    keys = sorted({key for table in tables for key in table})
    rows = [MergedRow(" ".join((key[0], *key[2:])), tuple(table.get(key) for table in tables)) for key in keys]
    rows.sort(key=lambda row: (not row.odd, set(row.verdicts) <= set(GOOD)))
    return Merged(dict(zip(names, folders, strict=True)), tuple(rows))


def write_merged(merged: Merged, folder: Path) -> None:
    """Write index.html and summary.md; their pictures and pages stay where the reports are."""
    folder.mkdir(parents=True, exist_ok=True)
    places = [os.path.relpath(path, folder) for path in merged.machines.values()]
    head = f"| test | {' | '.join(cell(name) for name in merged.machines)} |"
    lines = ["**" + " ".join(merged.sentences) + "**", "", head, "| --- " * (len(places) + 1) + "|"]
    for row in merged.rows:
        shown = []
        for place, found, verdict in zip(places, row.found, row.verdicts, strict=True):
            picture = (
                f"<br>![{verdict}]({place}/{found.error})" if found and found.error and verdict not in GOOD else ""
            )
            shown.append(verdict + picture)
        for i in row.odd:
            shown[i] = f"**{shown[i]}**"
        lines.append(f"| {cell(row.name)} | {' | '.join(shown)} |")
    write_text(folder / SUMMARY, "\n".join(lines) + "\n")
    write_page(folder / INDEX, "merged.html.j2", ("checks.css",), merged=merged, places=places, GOOD=GOOD)
