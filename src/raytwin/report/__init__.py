"""Views of a comparison: a page, a folder, a few lines of text. They compute nothing that the comparison lacks."""

from raytwin.report.folder import write_all
from raytwin.report.html import write_report
from raytwin.report.json import write_comparison
from raytwin.report.summary import augment_summary, calibration_summary, summary

__all__ = ["augment_summary", "calibration_summary", "summary", "write_all", "write_comparison", "write_report"]
