"""Views of a comparison: a page, a folder, a few lines of text. They compute nothing that the comparison lacks."""

from importlib import import_module
from typing import Any

_HOME = {
    "Against": "against",
    "Case": "junit",
    "PairView": "view",
    "atlas_summary": "atlas",
    "augment_summary": "text",
    "bench_summary": "bench_page",
    "calibration_summary": "text",
    "diff_summary": "text",
    "ladder_summary": "ladder",
    "summary": "text",
    "write_all": "folder",
    "write_atlas": "atlas",
    "write_bench_all": "bench_page",
    "write_bends": "uncertainty",
    "write_comparison": "json",
    "write_diff": "folder",
    "write_junit": "junit",
    "write_ladder": "ladder",
    "write_report": "html",
    "write_uncertainty": "uncertainty",
}
__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    # On demand: charts take half a second to import, and most commands write none.
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
