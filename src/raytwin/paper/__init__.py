"""The figures 10 to 12 of the paper that this tool grew from, recomputed, each with the error that it leaves out.

paper_runs measures -> paper_record (paper.json) -> paper_tables (which rows are compared) -> paper_page (paper.html)
"""

from raytwin.paper.paper_page import paper_summary, write_paper_all
from raytwin.paper.paper_record import Paper
from raytwin.paper.paper_runs import paper

__all__ = ["Paper", "paper", "paper_summary", "write_paper_all"]
