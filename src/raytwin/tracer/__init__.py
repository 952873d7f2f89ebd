"""The subject: a minimal ray tracer that reads like its equations, on NumPy and on Dr.Jit from one source.

    pixel -> back_project -> ray -> nearest (intersect_sphere, intersect_plane) -> hit -> RUNGS -> radiance

`trace` runs it over an image; each stage is public, so that it can be stepped through and checked on its own.
"""

from raytwin.tracer.camera import back_project, distort, undistort
from raytwin.tracer.engine import ENGINES
from raytwin.tracer.hit import Hit, nearest
from raytwin.tracer.light import RUNGS, lambert, sun_visible
from raytwin.tracer.objects import everything
from raytwin.tracer.plane import intersect_plane
from raytwin.tracer.sphere import SOLVERS, intersect_sphere
from raytwin.tracer.trace import trace
from raytwin.tracer.trim import TRIMS, corner_box, trim_box

__all__ = [
    "ENGINES",
    "RUNGS",
    "SOLVERS",
    "TRIMS",
    "Hit",
    "back_project",
    "corner_box",
    "distort",
    "everything",
    "intersect_plane",
    "intersect_sphere",
    "lambert",
    "nearest",
    "sun_visible",
    "trace",
    "trim_box",
    "undistort",
]
