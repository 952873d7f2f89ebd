"""What a class hands in: correct tracers, wrong and hostile ones, and what is no submission."""

import json

import submitted_tracers as tracers

RUBRIC = """
title = "Six < seven"
seed = 5
follow_through = 1.0
hints = 0
limits = { folder_mb = 3, seconds = 3600, seconds_a_call = 3600 }
exercises = [
  { stage = "intersect_sphere", points = 10 },
  { stage = "shade", points = 10, visibility = "hidden" },
  { name = "image", stage = "render", scenes = ["single"], drawn = 1, points = 20, credit = [[0.1, 0.5], [10, 0.25]] },
]
"""
HASTY = RUBRIC.replace("seconds = 3600, seconds_a_call = 3600", "seconds = 60, seconds_a_call = 1")
"""For the one who hangs: on a busy machine the others may take long."""


def notebook(*cells: str) -> str:
    return json.dumps({"cells": [{"cell_type": "code", "source": text} for text in cells], "nbformat": 4})


PI = tracers.tracer("pi")
HANDED_IN = {
    **{f"{name}.py": tracers.tracer(name) for name in ("no shadows", "pi", "gamma", "nan", "raises", "cached")},
    "right.py": tracers.RIGHT,
    "<script>/tracer.py": "import helper\nrender = helper.render\n",
    "<script>/helper.py": tracers.tracer("gamma"),
    "parts.py": PI.replace("def render", "def own"),
    "beside.py": PI.replace("return out.reshape", "return out[:, ::-1].reshape"),
    "empty.py": "",
    "syntax.py": "def render(:",
    "nested.ipynb": "[" * 200_000,
    "large.py": "#" * 3_100_000,
    "book.ipynb": notebook(tracers.RIGHT + "#" + "x" * 1_100_000, "1 / 0", "%matplotlib inline", *["x = 1"] * 100),
}
"""File -> text: what its student handed in."""
STRANGE = b"caf\xe9\x1b[31m.py"
"""A name that no str has, and that turns a terminal red."""
STRANGE_NAME = "caf\\udce9\\x1b[31m"
