"""The figures 10 to 12 of the paper that this tool grew from, made again, each with the error that it leaves out.

measure.py runs them -> record.py (paper.json) -> tables.py (what is held against what) -> page.py (paper.html)
"""

from raytwin.paper.paper_page import paper_summary, write_paper_all
from raytwin.paper.paper_record import Paper
from raytwin.paper.paper_runs import paper

__all__ = ["Paper", "paper", "paper_summary", "write_paper_all"]
