"""Whole jobs, of one scene or of many: compare, make references, bench, levels, atlas, shrink.

A job takes a scene or files and returns one record. Pages and the command line show it.
"""
