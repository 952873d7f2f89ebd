"""Charts as SVG, for pages and files.

svg.py the shapes of any drawing, and its axes; chart.py error against seconds
"""
