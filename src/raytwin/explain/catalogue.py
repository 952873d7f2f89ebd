"""The catalogue of mistakes, `faults.tsv`: a line per fault, and below it a line for each way in which it is made.

A fault's line is its stage, its name, and the sentence that helps. A way's line begins with a tab, and is a change of
the textbook: function, what stands there, what the mistake makes of it; several changes follow one another. A way that
begins with `alone` shows only where the function is tested alone. To add a fault, add its lines. Factors that are not
known beforehand are rows of `parametric_faults`.
"""

from itertools import groupby, product
from pathlib import Path
from typing import Any

import numpy as np

from raytwin.explain.changes import SAMPLING, SHADOW, Fault, chain, in_shadow_test, offset_by, others_hide, row
from raytwin.explain.predict import SPREAD, Array, Pipeline, replaced, slip, touches

ACNE = row("acne", SHADOW,
    "shadow rays hit the surface they start from (acne): rounding puts their start now above it, now below; "
    "start them a little off the surface, or leave its own object out",
    (), slip("sun_visible", ("return visible", "return visible & False")))  # fmt: skip
"""Acne darkens points at random: it is recognised by fully lit and fully dark pixels, in a mixture."""

FACTS = frozenset({"nothing-met", "empty", "no-spheres", "no-planes", "border-alone"})
"""Faults that say what a picture lacks, and not why: most mistakes of a part look like that. What would cause the same
is not reported beside them, and a line of the text is looked for even where one of them is proved."""

ALONE = "alone"


def read_faults() -> tuple[Fault, ...]:
    """All of the file's faults."""
    lines = Path(__file__).with_name("faults.tsv").read_text(encoding="utf-8").splitlines()
    starts = [k for k, line in enumerate(lines) if not line.startswith("\t")]
    made = []
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        rows = [line[1:].replace("\\n", "\n").split("\t") for line in lines[start + 1 : end]]
        ways, alone = (tuple(map(_way, (r for r in rows if (r[0] == ALONE) == of))) for of in (False, True))
        made.append(Fault(*_named(lines[start]), ways, alone))
    return tuple(made)


def _named(line: str) -> tuple[str, str, str]:
    stage, name, sentence = line.split("\t")
    return name, stage, sentence


def _way(fields: list[str]) -> Pipeline:
    """A change of each function, of one or several replacements; of none where nothing is replaced."""
    if fields[0] == ALONE:
        fields = fields[1:]
    changes = list(zip(fields[::3], fields[1::3], fields[2::3], strict=True))
    return chain(*(
        slip(function, *((old, new) for _, old, new in some if old))
        for function, some in groupby(changes, key=lambda change: change[0])
    ))  # fmt: skip


def _mean_of(n: int, low: float, high: float) -> Pipeline:
    """The mean of n x n rays from `low` to `high` in both directions, pixels from the centre."""
    places = tuple(product(np.linspace(low, high, n).tolist(), repeat=2))
    return ((SPREAD, places),)


BLENDS = "each pixel is the mean of several rays (anti-aliasing), which blends outlines and the edges of shadows"
ONE_RAY = "here a pixel shows what the one ray through its centre, (u, v), meets"
AVERAGED = (
    row("averaged-over-pixel", SAMPLING, f"{BLENDS}: {ONE_RAY}",
        *(_mean_of(n, 0.5 / n - 0.5, 0.5 - 0.5 / n) for n in (2, 3, 4)), *(_mean_of(n, -0.5, 0.5) for n in (2, 3))),
    row("averaged-from-corner", SAMPLING,
        f"{BLENDS}, and the rays are spread to one side of (u, v) as if that were the pixel's corner: {ONE_RAY}",
        *(_mean_of(n, 0.5 / n, 1 - 0.5 / n) for n in (2, 3, 4)), *(_mean_of(n, 0.0, 1 - 1 / n) for n in (2, 3, 4)),
        _mean_of(2, 0.0, 1.0)),
)  # fmt: skip
FAULTS = (*read_faults(), *AVERAGED)
"""Every mistake there is, by stage."""


def _faced(normals: Array, points: Array, which: Array, eye: Array, things: Any) -> Array:
    return np.where(np.sum(normals * (points - eye), axis=-1, keepdims=True) > 0, -normals, normals)


def _made_unit(normals: Array, *_: Any) -> Array:
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    return normals / np.where(length > 0, length, 1)


def _normals(f: Any) -> Pipeline:
    return replaced(normals_at=lambda right: lambda *args: f(right(*args), *args))


FACED, MADE_UNIT = _normals(_faced), _normals(_made_unit)
"""Normals of spheres, too, are turned to the eye; normals are made unit."""
SHADOW_TESTS = (others_hide, offset_by(1e-4), offset_by(1e-4, True))
"""Ways to test for shadows that are all right: the own object left out, or a start a little off the surface."""
MEETING = ("intersect_sphere", "intersect_plane")


def equivalent_forms(pipeline: Pipeline) -> tuple[Pipeline, ...]:
    """The same tracer with what may be done in either way without harm, but shows where something else is wrong.

    Normals turned to the eye, or made unit; how shadows are tested; functions of their own for shadow rays.
    """
    tests = ((), *SHADOW_TESTS) if not touches(pipeline, "sun_visible") else ((),)
    normals = ((), FACED, MADE_UNIT, chain(MADE_UNIT, FACED))
    made = [chain(pipeline, normal, test) for test in tests for normal in normals if normal or test]
    if meeting := tuple(step for step in pipeline if step[0] in MEETING):
        rest = tuple(step for step in pipeline if step[0] not in MEETING)
        made += [chain(pipeline, in_shadow_test(())), chain(rest, in_shadow_test(meeting))]
    return tuple(made)
