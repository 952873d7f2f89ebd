"""Light as rays meet it, in their frame and in the engine's floats.

A scene has one sun and one sky. The sun is one direction: its record in `Lighting` is all of it. A sky is a
`SkyLight`: `radiance` (along a direction), `diffuse_irradiance` (E/π where nothing hides it), and `sample` with
`density` (a direction, and its density per steradian) if it is worth sampling: constant_sky, environment_map. To add a
kind of sky, write its record in `scene.lights`, a file like these two, its row in SKIES (scene_lighting),
and as an emitter in `twin.twin_scene.translate`.

Read it in this order: scene_lighting, constant_sky, environment_map, sky_occlusion; lookup and envmap_tables are their
tools.
"""

from raytwin.tracer.lights.constant_sky import ConstantSky
from raytwin.tracer.lights.environment_map import EnvironmentMap
from raytwin.tracer.lights.scene_lighting import SKIES, Lighting, SkyLight, lighting
from raytwin.tracer.lights.sky_occlusion import sky_visibility, sphere_share
