"""comparison.json: the Report's numbers, null where one does not apply."""

import os

from raytwin import files
from raytwin.compare import Report


def write_comparison(report: Report, path: str | os.PathLike[str]) -> None:
    """Every number of the report under its field's name; NaN and infinity, which JSON lacks, become null."""
    files.write_json(path, report.numbers())
