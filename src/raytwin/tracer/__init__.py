"""The subject: a minimal ray tracer that reads like its equations, on NumPy and on Dr.Jit from one source.

    pixel -> back_project -> ray -> World.closest_hit (sphere, rectangle) -> hit -> RADIANCE, or a path -> radiance

Read it in this order: render_image, pixel_to_ray, hit (the records), world, sphere, rectangle, shading; then path,
which follows light from one surface to the next. The arithmetic is `arrays`, the light
`lights`. `raytwin.fast` gives the same pixels, fast.
"""

from raytwin.tracer.hit import Hit, Stages, World
from raytwin.tracer.path import radiance_along_path, sample_cosine_hemisphere
from raytwin.tracer.pixel_to_ray import back_project, undistort
from raytwin.tracer.rectangle import intersect_rectangle
from raytwin.tracer.render_image import STAGES, trace, trace_paths
from raytwin.tracer.shading import RADIANCE, lambert, sun_visible
from raytwin.tracer.sphere import SOLVERS, intersect_sphere
from raytwin.tracer.world import PlainWorld, first_hit, next_hit, surface_at

__all__ = [
    "RADIANCE", "SOLVERS", "STAGES", "Hit", "PlainWorld", "Stages", "World", "back_project", "first_hit",
    "intersect_rectangle", "intersect_sphere", "lambert", "next_hit", "radiance_along_path", "sample_cosine_hemisphere",
    "sun_visible", "surface_at", "trace", "trace_paths", "undistort",
]  # fmt: skip
