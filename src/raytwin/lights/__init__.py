"""Light as rays meet it, in their frame and in the engine's floats.

A light is a record, three functions and a row. The sun is one direction: its record in `Lighting` is all of it. What
fills the sky has `radiance` (along a direction), `diffuse_irradiance` (E/π where nothing hides it) and `sample` (a
direction and its density per steradian): constant_sky, environment_map. To add a light, write its record in
`scene.lights`, a file like these two, its row in SKIES, and its row in `twin.sky.SKIES`.

Read it in this order: scene_lighting, constant_sky, environment_map, sky_occlusion; lookup and envmap_tables are their
tools.
"""

from raytwin.lights.constant_sky import ConstantSky
from raytwin.lights.environment_map import EnvironmentMap
from raytwin.lights.scene_lighting import SKIES, Lighting, SkyLight, lighting
from raytwin.lights.sky_occlusion import sky_visibility, sphere_share
