"""Charts as SVG, for pages, files and notebooks.

svg.py the shapes of any drawing, and its axes; chart.py error against seconds; rows_chart.py the chart of any rows
"""
