"""A Mitsuba file -> Image: its own sensor, film and integrator, in independent batches whose spread is the variance."""

import re
from dataclasses import replace
from functools import partial
from typing import Any
from xml.etree.ElementTree import fromstring, tostring

import numpy as np

from raytwin.errors import InputError
from raytwin.images.image import BACKGROUND, Image, Surface
from raytwin.images.image_pool import ImagePool
from raytwin.progress import Progress, silent
from raytwin.scene.mitsuba_file import as_loaded
from raytwin.scene.mitsuba_scene import MitsubaScene
from raytwin.twin import render_cache
from raytwin.twin.backend import activate, made_with
from raytwin.twin.plain import render_plain

BATCHES = 16
"""Independent renders behind a variance."""
VERSION = "3"
"""Part of every cache key: raise it when a change moves a pixel."""


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
    """Render the file as Mitsuba would, `samples` per pixel in `batches` that share no random number.

    The result has the variance of its mean and, of each pixel's centre, the shape that it sees, its distance from the
    eye in the file's own unit, and its normal in the file's world. Raises InputError where Mitsuba refuses the scene.
    """
    batches = max(1, min(batches, samples))
    about = mitsuba_provenance(scene, samples, seed, batches, variant)
    make = partial(_pooled, scene, samples, seed, batches, progress)
    return render_cache.cached(about, cache, make)


def _pooled(scene: MitsubaScene, samples: int, seed: int, batches: int, progress: Progress) -> Image:
    width, height = scene.image_size
    loaded = _loaded(scene)
    each, pool = -(-samples // batches), ImagePool()
    for k in range(batches):
        progress("twin", k, batches)
        # As one sample without noise: a file without random numbers makes equal batches, which are no repeats.
        pool.add(Image(_rendered(scene, loaded, each, (seed, k)).reshape(height, width, 3), samples=1))
    progress("twin", batches, batches)
    return replace(pool.image, samples=each * batches, surface=_surface(scene, loaded))


def mitsuba_provenance(
    scene: MitsubaScene, samples: int, seed: int = 0, batches: int = BATCHES, variant: str | None = None
) -> dict[str, str]:
    """Everything that decides the pixels of `render_mitsuba`, as text: for an EXR's header."""
    about = made_with(f"file {VERSION}", activate(variant).variant) | {"scene": scene.digest}
    return about | {"samples": str(samples), "seed": str(seed), "batches": str(batches)}


def _loaded(scene: MitsubaScene) -> Any:
    """Mitsuba's scene, without `optimize`, which would merge shapes and let light leak (see twin_scene.load)."""
    import mitsuba as mi

    root = as_loaded(scene)
    try:
        return mi.load_string(tostring(root, "unicode"), optimize=False)
    except Exception as error:  # RuntimeError, or whatever a plugin of Python's raises
        raise _refused(scene, error) from None


def _rendered(scene: MitsubaScene, loaded: Any, samples: int, seed: tuple[int, int]) -> np.ndarray:
    """(H, W, 3): the film's colours, or its grey, without what an `aov` integrator adds after them."""
    width, height = scene.image_size
    colours = _colours(scene)
    try:
        made = render_plain(loaded, samples, seed)
    except Exception as error:
        raise _refused(scene, error) from None
    if made.shape[:2] != (height, width) or made.shape[2] < colours:
        raise InputError(scene.file, f"a film of {width} x {height} pixels in grey or RGB", made.shape)
    return np.broadcast_to(made[..., :colours], (height, width, 3))


def _colours(scene: MitsubaScene) -> int:
    """Channels of light that come first in the film: 1 if it is grey, else 3."""
    root = fromstring(scene.text)
    integrator = root.find("integrator")
    while integrator is not None and integrator.get("type") == "aov":
        if integrator.find("ref") is None and integrator.find("integrator") is None:
            raise InputError(f"{scene.file}: <integrator>", "an image's integrator inside aov", "none")
        integrator = integrator.find("integrator")
    pixel_format = root.find("sensor/film/string[@name='pixel_format']")
    grey = pixel_format is not None and pixel_format.get("value", "").lower().startswith("luminance")
    return 1 if grey else 3


def _surface(scene: MitsubaScene, loaded: Any) -> Surface:
    """What the ray through each pixel's centre meets first: shape, distance from the eye, normal towards it."""
    import drjit as dr
    import mitsuba as mi

    from raytwin.twin.twin_light import numbers_of

    width, height = scene.image_size
    y, x = (a.ravel() for a in np.mgrid[0:height, 0:width])
    place = mi.Point2f(mi.Float((x + 0.5) / width), mi.Float((y + 0.5) / height))  # of the crop window
    sensor = loaded.sensors()[0]
    ray = sensor.sample_ray(sensor.shutter_open(), 0.5, place, mi.Point2f(0.5))[0]
    hit = loaded.ray_intersect(ray)
    ids_of = {name: i for i, name in enumerate(scene.names)}
    table = numbers_of(loaded, lambda name: ids_of.get(name, BACKGROUND))
    ids = dr.gather(mi.Int32, table, dr.reinterpret_array(mi.UInt32, hit.shape), hit.is_valid())
    depth = hit.t
    if "Orthographic" not in str(sensor):  # whose rays begin at no common point
        depth = depth + dr.norm(ray.o - sensor.world_transform().translation())
    n = dr.select(dr.dot(hit.n, ray.d) > 0, -hit.n, hit.n)
    found = (dr.select(hit.is_valid(), value, miss) for value, miss in ((ids, BACKGROUND), (depth, 0), (n, 0)))
    ids, depth, n = (value.numpy() for value in found)
    return Surface(ids.reshape(height, width), depth.reshape(height, width), n.T.reshape(height, width, 3).copy())


def _refused(scene: MitsubaScene, error: Exception) -> InputError:
    """Mitsuba's complaint in one line."""
    text = re.sub(r"^\[parser\.cpp:\d+\] |(?:At|While loading|Error while loading) string ", "", str(error).strip())
    return InputError(scene.file, "a scene that Mitsuba renders", " ".join(text.split()) or type(error).__name__)
