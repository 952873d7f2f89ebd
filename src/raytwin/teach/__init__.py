"""Submissions -> results: what a student's functions are held to, and who runs and marks them.

contract/   each function of the starter file: its cases, its sentence, its repair
sandbox/    a child process that a submission cannot leave
grade/      a class: rubric, points, pages to hand out
walk/       the tutorial that builds a tracer function by function
"""
