"""Copy measured tables of docs/measured/data/*.json into docs/measured.md, between their markers.

python docs/tables.py

The page has `<!-- table: FILE/NAME -->` where a table begins and `<!-- end -->` where it ends. The commands that the
tables name write the JSON under `--record`; nothing between the markers is written by hand.
"""

import json
import re
from pathlib import Path
from typing import Any

PAGE = Path(__file__).resolve().parent / "measured.md"
BLOCK = re.compile(r"(<!-- table: (\S+)/(\S+) -->\n).*?(<!-- end -->)", re.DOTALL)
NUMBER = re.compile(r"[-+]?[\d.]|$")
"""What a cell of a right-aligned column begins with."""


def markdown(table: dict[str, Any]) -> str:
    """Return a table in Markdown: numbers to the right, and when and how it was measured below."""
    if not table["command"]:
        raise ValueError("a measured table lacks the command that makes it again")
    columns, rows = table["columns"], table["rows"]
    right = [column > 0 and all(NUMBER.match(row[column]) for row in rows) for column in range(len(columns))]
    lines = [columns, ["---:" if r else "---" for r in right], *rows]
    shown = (" | ".join(cell.replace("|", "\\|") for cell in cells) for cells in lines)
    text = "\n".join(f"| {line} |" for line in shown)
    where = f" on {table['machine']}" if "machine" in table else ""
    return f"{text}\n\n*Measured on {table['date']} with raytwin {table['version']}{where} by `{table['command']}`.*\n"


def filled(page: Path) -> str:
    """Return a page's text with its tables as they were last measured; the files lie in measured/data/ beside it."""

    def table(found: re.Match[str]) -> str:
        tables = json.loads((page.parent / "measured" / "data" / f"{found[2]}.json").read_text(encoding="utf-8"))
        return f"{found[1]}{markdown(tables[found[3]])}{found[4]}"

    return BLOCK.sub(table, page.read_text(encoding="utf-8"))


def written_by_hand(page: Path) -> list[str]:
    """Return the lines of a page's tables that no measurement wrote: outside the markers, or changed within them."""
    text, measured = page.read_text(encoding="utf-8"), filled(page)
    made = set("".join(found[0] for found in BLOCK.finditer(measured)).splitlines())
    outside = BLOCK.sub("", text).splitlines()
    inside = "".join(found[0] for found in BLOCK.finditer(text)).splitlines()
    return [line for line in outside if line.startswith("|")] + [line for line in inside if line not in made]


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE), encoding="utf-8")
