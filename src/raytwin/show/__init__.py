"""Pages, pictures and lines of text. They only show numbers that were computed elsewhere.

page.py the shell of every page; compare_page.py the page of two images; NAME_page.py those of other results; charts/
"""
