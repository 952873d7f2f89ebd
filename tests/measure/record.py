"""Print a measurement's tables and, with `--record` on the command line, store them for the pages of docs/measured.

A table lies in docs/measured/data/PAGE.json under its name, with the command that measures it, the date, raytwin's
version, and how busy the machine was. `python docs/tables.py` then copies tables into docs/measured.md.
"""

import json
import os
import sys
from collections.abc import Iterable, Sequence
from datetime import date
from pathlib import Path

import raytwin

DOCS = Path(__file__).resolve().parents[2] / "docs"
DATA = DOCS / "measured" / "data"
sys.path.insert(0, str(DOCS))
from tables import markdown  # noqa: E402 - docs/ is no package

RECORD = "--record"
Cell = str | int | float


def arguments() -> list[str]:
    """Return the words of the command line without `--record`."""
    return [word for word in sys.argv[1:] if word != RECORD]


def table(page: str, name: str, columns: Sequence[str], rows: Iterable[Sequence[Cell]], command: str) -> None:
    """Print a table; with `--record` replace the one of this name in `docs/measured/data/{page}.json`."""
    found = {
        "command": command,
        "date": date.today().isoformat(),
        "version": raytwin.__version__,
        "machine": f"{os.cpu_count()} cores at a load of {os.getloadavg()[2]:.0f}",
        "columns": list(columns),
        "rows": [[str(cell) for cell in row] for row in rows],
    }
    print(markdown(found), flush=True)
    if RECORD in sys.argv:
        path = DATA / f"{page}.json"
        stored = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        stored[name] = found
        unfinished = path.with_suffix(".unfinished")
        unfinished.write_text(json.dumps(stored, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        unfinished.replace(path)
