"""A Mitsuba file, rendered by its own sensor, film and integrator."""

import re
from dataclasses import replace
from typing import Any

import numpy as np

from raytwin.errors import InputError
from raytwin.images.image import Image, Surface
from raytwin.images.image_pool import ImagePool
from raytwin.progress import Progress, silent
from raytwin.scene import MitsubaScene
from raytwin.twin import render_cache
from raytwin.twin.backend import activate, made_with
from raytwin.twin.rendering import BATCHES

VERSION = "5"
"""Part of every cache key: raise it when a change moves a pixel."""
LANES = 1 << 24
"""Most samples in one batch: Mitsuba keeps the state of each in memory."""


def render_mitsuba(
    scene: MitsubaScene,
    samples: int = 64,
    seed: int = 0,
    batches: int = BATCHES,
    *,
    cache: bool = True,
    variant: str | None = None,
    progress: Progress = silent,
) -> Image:
    """Render the file as Mitsuba would, `samples` per pixel in `batches` or more that share no random number.

    The result has the variance of its mean and, of each pixel's centre, the shape that it sees, its distance from the
    eye in the file's own unit, and its normal in the file's world. Raises InputError where Mitsuba refuses the scene.
    """
    width, height = scene.image_size
    batches = max(1, min(max(batches, -(-samples * width * height // LANES)), samples))
    about = mitsuba_provenance(scene, samples, seed, batches, variant)

    def make() -> Image:
        import mitsuba as mi

        loaded, pool, each = _loaded(scene), ImagePool(), -(-samples // batches)
        # An `aov` integrator's channels come after the film's colours.
        colours = 1 if "pixel_format = y" in str(loaded.sensors()[0].film()) else 3
        for k in range(batches):
            progress("twin", k, batches)
            try:
                number = int(np.random.SeedSequence((seed, k)).generate_state(1)[0])
                made = np.asarray(mi.render(loaded, spp=each, seed=number), float)[..., :colours]
            except Exception as error:
                raise _refused(scene, error) from None
            # As an image without noise: a file without random numbers makes equal batches, which are no repeats.
            pool.add(Image(np.broadcast_to(made, (height, width, 3)), samples=1))
        progress("twin", batches, batches)
        return replace(pool.image, samples=each * batches, surface=_surface(loaded))

    return render_cache.cached(about, cache, make)


def mitsuba_provenance(
    scene: MitsubaScene, samples: int, seed: int = 0, batches: int = BATCHES, variant: str | None = None
) -> dict[str, str]:
    """Everything that decides the pixels of `render_mitsuba`, as text: for an EXR's header."""
    about = made_with(f"file {VERSION}", activate(variant).variant) | {"scene": scene.digest}
    return about | {"samples": str(samples), "seed": str(seed), "batches": str(batches)}


def named_shapes(scene: MitsubaScene) -> tuple[str, ...]:
    """The names of the file's shapes in the order of their ids. Raises InputError where Mitsuba refuses the scene."""
    activate()
    return tuple(shape.id() or f"shape-{i}" for i, shape in enumerate(_loaded(scene).shapes()))


def _loaded(scene: MitsubaScene) -> Any:
    """Mitsuba's scene, without `optimize` (see `load`)."""
    import mitsuba as mi

    try:
        loaded = mi.load_file(scene.file, optimize=False)
    except Exception as error:  # RuntimeError, or whatever a plugin of Python's raises
        raise _refused(scene, error) from None
    film = loaded.sensors()[0].film()
    if "pixel_format = xyz" in str(film):
        raise InputError(scene.file, "a film in RGB or luminance", "XYZ")
    if (size := tuple(film.crop_size())) != scene.image_size:
        raise InputError(scene.file, "a <film> within its <sensor> that says the size", "{} x {}".format(*size))
    return loaded


def _surface(loaded: Any) -> Surface:
    """What the ray through each pixel's centre meets first: shape, distance from the eye, normal towards it."""
    import drjit as dr
    import mitsuba as mi

    from raytwin.twin.twin_light import seen_along, surface_of

    sensor = loaded.sensors()[0]
    width, height = (int(side) for side in sensor.film().crop_size())
    pixel = dr.arange(mi.UInt32, width * height)
    x, y = mi.Float(pixel % width), mi.Float(pixel // width)
    place = mi.Point2f((x + 0.5) / width, (y + 0.5) / height)  # in the crop window
    ray = sensor.sample_ray_differential(sensor.shutter_open(), 0.5, place, mi.Point2f(0.5))[0]
    seen = seen_along(loaded, ray)
    depth = seen.hit.t
    if "Orthographic" not in str(sensor):  # its rays begin at no common point
        depth = depth + dr.norm(ray.o - sensor.world_transform().translation())
    return surface_of(loaded, seen, range(len(loaded.shapes())), depth, (width, height))


def _refused(scene: MitsubaScene, error: Exception) -> InputError:
    """Mitsuba's complaint in one line."""
    before = rf"^\[parser\.cpp:\d+\] |(?:At|While loading|Error while loading) {re.escape(scene.file)} "
    text = re.sub(before, "", str(error).strip())
    return InputError(scene.file, "a scene that Mitsuba renders", " ".join(text.split()) or type(error).__name__)
