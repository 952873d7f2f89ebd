"""The file that a student starts from: the contract's functions, their docstrings, one worked example, their checks."""

import textwrap
from collections.abc import Sequence

from raytwin.teach.contract.stage import Stage
from raytwin.teach.contract.stage_table import CONTRACT, LESSONS

HEAD = '''"""A ray tracer in stages: functions that take and return NumPy arrays, each graded alone, in any order.

Run this file to check what is written so far: `python {name}`. In a notebook, `raytwin.check("shade", shade)` shows
it as a small page. Keep names and parameters; helpers and classes of your own are welcome. N, the number of rays or
points in a call, may be 1, and the eye may be inside a sphere. Arguments are float arrays of the shapes in parentheses;
do not change them in place. A result passes that is correct to about 1e-4 (rays and radiance 1e-5, a picture 1e-3); the
check says how far it is off. A function that is left as it is counts as not written.
You may import the standard library, numpy and scipy, and the packages that the rubric lists: OpenCV 4.11 or newer
(`import cv2`), unless your instructor changed it.
{scene}"""

import numpy as np


def intersect_plane(origins, directions, center, half_u, half_v):
    """A worked example, not graded: t (N,) > 0 where rays meet the rectangle center ± half_u ± half_v; inf for a miss.

    The plane: (p - center) · n = 0 with n = half_u x half_v. With p = origin + t direction that is one equation for t.
    origins, directions: (N, 3); the others (3,). No loop: every line works on all N rays at once.
    """
    n = np.cross(half_u, half_v)
    with np.errstate(divide="ignore", invalid="ignore"):  # rays along the plane divide by 0, and miss
        t = ((center - origins) @ n) / (directions @ n)  # (N,)
        q = origins + t[:, None] * directions - center  # (N, 3): from the centre to where the ray meets the plane
        inside = (np.abs(q @ half_u) <= half_u @ half_u) & (np.abs(q @ half_v) <= half_v @ half_v)
    return np.where(inside & (t > 0), t, np.inf)
'''

SCENE = """
`scene` is a dict: "name", "width", "height"; the camera "K" (3, 3), "dist" (5,), "R_cam_board" (3, 3), "t_cam_board"
(3,); "spheres", a list of {"center" (3,), "radius", "albedo" (3,)}; "planes", a list of {"center", "half_u",
"half_v", "albedo"}, rectangles whose half_u and half_v are at right angles; both lists may be empty; "sun",
{"to_light" (3,), unit, "irradiance" (3,)}; "sky", {"radiance" (3,)}; "rung", "lambert" or "shadow", or where your
instructor asks for sampled light "sky" or "path". At both, draw new random numbers in each call. At "path", light meets
at most seven surfaces (depth 8). Lengths are in metres; the scene's places and directions are in the board's frame, and
p_cam = R_cam_board @ p_board + t_cam_board takes them to the camera's.

Graded pictures have up to about 340 x 250 pixels.
"""

TAIL = """

if __name__ == "__main__":
    import sys

    import raytwin

    names = ({names})
    results = [raytwin.check(name, globals()[name]) for name in names]
    sys.exit(not all(result.passed for result in results))
"""


def starter(name: str = "tracer.py", stages: Sequence[str] = tuple(CONTRACT)) -> str:
    """The text of that file."""
    chosen = [LESSONS[stage] for stage in stages]
    scene = SCENE if any("scene" in stage.parameters for stage in chosen) else ""
    names = "".join(f'"{stage}", ' for stage in stages).removesuffix(" " if len(stages) == 1 else ", ")
    return HEAD.format(name=name, scene=scene) + "".join(map(_function, chosen)) + TAIL.format(names=names)


def _function(stage: Stage) -> str:
    doc = textwrap.indent(f'"""{stage.doc}\n"""' if "\n" in stage.doc else f'"""{stage.doc}"""', "    ")
    doc = "\n".join(line.rstrip() for line in doc.splitlines())
    return f"\n\ndef {stage.signature}:\n{doc}\n    raise NotImplementedError\n"
