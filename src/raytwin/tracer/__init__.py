"""The subject: a minimal ray tracer that reads like its equations, on NumPy and on Dr.Jit from one source.

    pixel -> camera.back_project -> ray -> hit.World.nearest (sphere, rectangle) -> hit -> light.RADIANCE -> radiance

Read it in this order: frame, camera, hit, sphere, rectangle, light; then path and random, which follow light from one
surface to the next; occlusion and environment, of the sky; arrays last. `raytwin.speed` makes it fast.
"""

from raytwin.tracer.hit import Every, Hit, Stages, World
from raytwin.tracer.path import about, follow
from raytwin.tracer.pixel_to_ray import back_project, undistort
from raytwin.tracer.rectangle import intersect_rectangle
from raytwin.tracer.render_image import STAGES, trace, trace_paths
from raytwin.tracer.shading import RADIANCE, Lighting, lambert, lighting, sun_visible
from raytwin.tracer.sphere import SOLVERS, intersect_sphere

__all__ = [
    "RADIANCE", "SOLVERS", "STAGES", "Every", "Hit", "Lighting", "Stages", "World", "about", "back_project",
    "follow", "intersect_rectangle", "intersect_sphere", "lambert", "lighting", "sun_visible", "trace", "trace_paths",
    "undistort",
]  # fmt: skip
