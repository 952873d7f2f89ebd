"""Views of a comparison: a page, a folder, a few lines of text. They compute nothing that the comparison lacks."""

from importlib import import_module
from typing import Any

_HOME = {
    "Against": "regression_page",
    "Case": "junit",
    "PairView": "view",
    "atlas_summary": "atlas_page",
    "augment_summary": "terminal_text",
    "bench_summary": "bench_page",
    "calibration_summary": "terminal_text",
    "difference_summary": "terminal_text",
    "diff_summary": "terminal_text",
    "ladder_summary": "ladder_page",
    "light_summary": "light_page",
    "needs_summary": "recommend_page",
    "summary": "terminal_text",
    "write_all": "report_folder",
    "write_atlas": "atlas_page",
    "write_bench_all": "bench_page",
    "write_calibration": "calibration_page",
    "write_bends": "uncertainty_pictures",
    "write_diff": "report_folder",
    "write_junit": "junit",
    "write_ladder": "ladder_page",
    "write_light_page": "light_page",
    "write_needs": "recommend_page",
    "write_report": "compare_page",
    "write_difference": "uncertainty_pictures",
    "write_uncertainty": "uncertainty_pictures",
}
__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    # On demand: charts take half a second to import, and most commands write none.
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
