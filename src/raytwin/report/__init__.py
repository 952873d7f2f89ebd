"""Views of a comparison: a page, a folder, a few lines of text. They compute nothing that the comparison lacks."""

from raytwin.report.bench_files import bench_summary, write_bench_all
from raytwin.report.folder import write_all, write_diff
from raytwin.report.html import write_report
from raytwin.report.json import write_comparison
from raytwin.report.junit import Case, write_junit
from raytwin.report.summary import augment_summary, calibration_summary, diff_summary, summary
from raytwin.report.view import View

__all__ = [
    "Case",
    "View",
    "augment_summary",
    "bench_summary",
    "calibration_summary",
    "diff_summary",
    "summary",
    "write_all",
    "write_bench_all",
    "write_comparison",
    "write_diff",
    "write_junit",
    "write_report",
]
