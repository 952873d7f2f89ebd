"""comparison.json: the Comparison's own keys, null where one does not apply."""

import os

from raytwin import files
from raytwin.compare import Comparison


def write_comparison(comparison: Comparison, path: str | os.PathLike) -> None:
    """Every number of the comparison under its field's name; NaN and infinity, which JSON lacks, become null."""
    files.write_json(path, comparison)
