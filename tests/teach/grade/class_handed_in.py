"""What a class hands in: correct tracers, wrong and hostile ones, and what is no submission."""

import json

import submitted_tracers as tracers

RUBRIC = """
title = "Six < seven"
seed = 5
follow_through = 1.0
hints = 0
[[exercises]]
stage = "intersect_sphere"
points = 10
[[exercises]]
stage = "shade"
points = 10
visibility = "hidden"
[[exercises]]
name = "image"
stage = "render"
scenes = ["single"]
drawn = 1
points = 20
credit = [[1e-1, 0.5], [10.0, 0.25]]
[speed]
of = "image"
bonus = 2
fast = 100.0
slow = 1000.0
[limits]
folder_mb = 3
seconds = 3600
seconds_a_call = 3600
"""
HASTY = RUBRIC.replace("seconds = 3600\nseconds_a_call = 3600", "seconds = 60\nseconds_a_call = 1")
"""For the one who hangs: on a busy machine the others may take long."""
NOTHING = "\n".join(
    f"def {f}:\n    return 0 * {of}\n"
    for f, of in (
        ("back_project(K, dist, width, height)", "__import__('numpy').ones((height, width, 3))"),
        ("intersect_sphere(origins, directions, center, radius)", "origins[:, 0]"),
        ("shade(points, normals, albedo, to_light, irradiance, sky)", "points"),
    )
)


def notebook(*cells: str) -> str:
    return json.dumps({"cells": [{"cell_type": "code", "source": text} for text in cells], "nbformat": 4})


PI = tracers.tracer("pi")
HANDED_IN = {
    **{f"{name or 'right'}.py": tracers.tracer(name) for name in tracers.WRONG if name != "hangs"},
    "right.py": tracers.RIGHT,
    "<script>/tracer.py": "import helper\nrender = helper.render\n",
    "<script>/helper.py": tracers.tracer("gamma"),
    "helped/tracer.py": "from helper import *\nimport helper\ndef render(scene): return helper.render(scene)\n",
    "helped/helper.py": PI,
    "parts.py": PI.replace("def render", "def own"),
    "beside.py": PI.replace("return out.reshape", "return out[:, ::-1].reshape"),
    "nothing.py": NOTHING,
    "empty.py": "",
    "syntax.py": "def render(:",
    "nested.ipynb": "[" * 200_000,
    "cells.ipynb": '{"cells": 5}',
    "large.py": "#" * 3_100_000,
    "surrogate.ipynb": notebook('"\ud800"\ndef shade(): pass'),
    "book.ipynb": notebook(tracers.RIGHT + "#" + "x" * 1_100_000, "1 / 0", "%matplotlib inline", *["x = 1"] * 100),
}
"""File -> text: what its student handed in."""
STRANGE = b"caf\xe9\x1b[31m.py"
"""A name that no str has, and that turns a terminal red."""
STRANGE_NAME = "caf\\udce9\\x1b[31m"
