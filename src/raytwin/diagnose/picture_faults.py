"""Mistakes in the values that are handed in, and in how samples are averaged."""

from collections.abc import Callable
from functools import partial
from math import pi
from typing import Any

import numpy as np

from raytwin.diagnose.changes import OUTPUT, SAMPLING, SUM, behind, pixels, row, shade, shown
from raytwin.diagnose.predict import Array, Pipeline, replaced, slip
from raytwin.diagnose.walks import Walks, gathered
from raytwin.files import srgb_decode, srgb_encode


def _overflow(x: Array, by: int = 255) -> Array:
    return np.floor(np.maximum(x, 0) * by + 1e-9) % 256 / by


def _gradient(height: str, sky: str) -> Pipeline:
    """From white to the sky's radiance, or to a blue, by the unit direction's height: (1 - a) white + a sky."""
    far = slip("met", ("origins + t[:, None]", "origins + np.where(which < 0, 1e9, t)[:, None]"))
    lines = f"d = (points - eye) / 1e9\n    a = ({height} + 1) / 2\n    "
    tiled = ("picture = np.tile(sky, (len(points), 1))", f"{lines}picture = (1 - a)[:, None] + a[:, None] * {sky}")
    return far + slip("radiance", tiled)


def _rounded(x: Array, digits: int) -> Array:
    return np.round(x, digits)


def _channel(x: Array, k: int) -> Array:
    return np.broadcast_to(x[..., k : k + 1], x.shape)


def _power(x: Array, k: float) -> Array:
    return np.maximum(x, 0) ** k


OUTPUTS = (
    row("gamma-once", OUTPUT,
        "the values are encoded for display (gamma): hand in linear radiance, without a power of 1/2.2",
        shown(srgb_encode), shown(partial(_power, k=1 / 2.2)), shown(partial(_power, k=1 / 2)),
        shown(lambda x: srgb_encode(np.clip(x, 0, 1))), shown(lambda x: _power(np.clip(x, 0, 1), 1 / 2.2)),
        *shade(f"{SUM} => ({SUM}) ** (1 / 2.2)")),
    row("gamma-twice", OUTPUT, "the values are encoded for display twice",
        shown(lambda x: srgb_encode(srgb_encode(x))), shown(partial(_power, k=1 / 2.2**2))),
    row("gamma-missing", OUTPUT,
        "the values are decoded once too often: linear numbers were written where a display's (sRGB) were expected",
        shown(lambda x: srgb_decode(np.maximum(x, 0))), shown(partial(_power, k=2.2)), shown(partial(_power, k=2))),
    row("bgr", OUTPUT, "red and blue are swapped: OpenCV writes BGR, the order here is RGB",
        shown(lambda x: x[..., ::-1]), *shade(f"{SUM} => ({SUM})[:, ::-1]")),
    row("channels-turned", OUTPUT, "the channels are in the wrong order: red, green, blue",
        shown(lambda x: x[..., [1, 2, 0]]), shown(lambda x: x[..., [2, 0, 1]]), shown(lambda x: x[..., [1, 0, 2]]),
        shown(lambda x: x[..., [0, 2, 1]])),
    row("grey", OUTPUT, "the image has no colours: all channels are equal",
        shown(lambda x: np.broadcast_to(x.mean(axis=-1, keepdims=True), x.shape)),
        shown(lambda x: np.broadcast_to(x @ np.array([0.2126, 0.7152, 0.0722])[:, None], x.shape)),
        shown(lambda x: np.broadcast_to(x @ np.array([0.299, 0.587, 0.114])[:, None], x.shape)),
        *(shown(partial(_channel, k=k)) for k in range(3))),
    row("clamped", OUTPUT, "values are cut off at 1: radiance may be larger, leave it as it is",
        shown(lambda x: np.minimum(x, 1)),
        *shade(f"{SUM} => np.clip({SUM}, 0, 1)")),
    row("overflow", OUTPUT, "8-bit values overflow: what is brighter than white wraps round to black; clip first",
        shown(_overflow), shown(lambda x: np.rint(np.maximum(x, 0) * 255) % 256 / 255),
        shown(partial(_overflow, by=256)), shown(lambda x: srgb_decode(_overflow(srgb_encode(x)))),
        shown(lambda x: _overflow(srgb_encode(x))), shown(lambda x: _overflow(_power(x, 1 / 2.2)))),
    row("eight-bits", OUTPUT, "the values are rounded to 8 bits: hand in floats",
        shown(lambda x: np.floor(np.clip(x, 0, 1) * 255) / 255), shown(lambda x: np.rint(np.clip(x, 0, 1) * 255) / 255),
        shown(lambda x: srgb_decode(np.floor(srgb_encode(np.clip(x, 0, 1)) * 255) / 255)),
        shown(lambda x: srgb_decode(np.rint(srgb_encode(np.clip(x, 0, 1)) * 255) / 255))),
    row("rounded", OUTPUT, "the values are rounded, to whole numbers or a few digits: hand in floats as they are",
        shown(np.floor), shown(np.rint), *(shown(partial(_rounded, digits=k)) for k in (1, 2, 3))),
    row("times-255", OUTPUT, "the values are 255 times too large: radiance is not a byte",
        shown(lambda x: 255 * x), shown(lambda x: np.floor(np.clip(x, 0, 1) * 255)),
        shown(lambda x: np.rint(np.clip(x, 0, 1) * 255))),
    row("by-255", OUTPUT, "the values are divided by 255, though they are no bytes", shown(lambda x: x / 255)),
    row("half-float", OUTPUT, "the values are rounded to half floats (float16): use float32",
        shown(lambda x: np.clip(x, -65504, 65504).astype(np.float16).astype(float))),
    row("upside-down", OUTPUT, "the image is upside down: row 0 is the top one",
        *pixels("u, height - 1 - v")),
    row("mirrored", OUTPUT, "the image is mirrored left to right",
        *pixels("width - 1 - u, v")),
    row("half-turn", OUTPUT, "the image is turned by half a turn",
        *pixels("width - 1 - u, height - 1 - v")),
    row("normalised", OUTPUT, "the image is divided by its brightest value: radiance has a scale of its own",
        replaced(output=lambda right: lambda x, brightest: right(x, brightest) / brightest)),
    row("tone-mapped", OUTPUT, "the values are tone-mapped, x / (1 + x): hand in linear radiance",
        shown(lambda x: x / (1 + np.maximum(x, 0))), shown(lambda x: 1 - np.exp(-np.maximum(x, 0)))),
    row("negative", OUTPUT, "the image is a negative: 1 - value", shown(lambda x: 1 - x)),
    row("background-black", OUTPUT,
        "the background is black: a ray that meets nothing shows the sky's radiance",
        *behind("0")),
    row("background-white", OUTPUT, "the background is white: a ray that meets nothing shows the sky's radiance",
        *behind("1")),
    row("background-gradient", OUTPUT,
        "the background is a gradient by the rays' directions: a ray that meets nothing shows the sky's radiance, the "
        "same everywhere",
        *(_gradient(height, sky) for sky in ("sky", "np.array([0.5, 0.7, 1.0])")
          for height in ("d[:, 1]", "d[:, 2]", '-(d @ scene["R_cam_board"][1])'))),
    row("background-scaled", OUTPUT,
        "the background is not the sky's radiance as it is: a factor of π or 2 has slipped in",
        *behind("np.pi * sky", "sky / np.pi", "2 * sky", "0.5 * sky")),
    row("background-sun", OUTPUT, "the background shows the sun's colour: it shows the sky's radiance",
        *behind('sun["irradiance"]', 'sky + sun["irradiance"]', 'sun["irradiance"] / np.pi')),
    row("premultiplied", OUTPUT, "colours are multiplied by their own coverage or value once more (premultiplied)",
        shown(lambda x: x * x)),
    row("half-bright", OUTPUT, "the whole image, background too, is half as bright", shown(lambda x: x / 2)),
    row("twice-bright", OUTPUT, "the whole image, background too, is twice as bright", shown(lambda x: 2 * x)),
    row("image-by-pi", OUTPUT, "the whole image, background too, is divided by π", shown(lambda x: x / pi),
        *shade(f"{SUM} => ({SUM}) / np.pi")),
    row("image-times-pi", OUTPUT, "the whole image, background too, is multiplied by π", shown(lambda x: x * pi)),
    row("empty", OUTPUT, "the image is black everywhere", shown(lambda x: 0 * x)),
)  # fmt: skip


def walked(f: Callable[[Walks], Array]) -> Pipeline:
    """Another sum over random walks; shows only where light is followed."""
    return replaced(gather=lambda right: f)


def per_bounce(g: Callable[[Array], Any]) -> Pipeline:
    """Each change of direction weighs g(cos) too much, g = 1 where directions have density cos/π and weigh albedo."""

    def f(walks: Walks) -> Array:
        gain = np.broadcast_to(np.asarray(g(walks.cos), float), walks.cos.shape)
        along = np.concatenate([np.ones_like(gain[:1]), np.cumprod(gain, axis=0)[:-1]])[:, None]
        light = walks.weight * (along * walks.sun + along * gain[:, None] * walks.sky)
        return np.asarray(light.sum(axis=0).mean(axis=-1).T)

    return walked(f)


def without(kept: Callable[[int], float]) -> Pipeline:
    """The sun at the k-th surface, and the sky seen from it, count kept(k) times."""

    def f(walks: Walks) -> Array:
        share = np.array([kept(k) for k in range(len(walks.cos))])[:, None, None, None]
        return gathered(walks._replace(sun=share * walks.sun, sky=share * walks.sky))

    return walked(f)


def _each_sample(f: Callable[[Array], Array], back: Callable[[Array], Array] = lambda x: x) -> Pipeline:
    """The mean of a function of every walk's light."""

    def gather(walks: Walks) -> Array:
        light = (walks.weight * (walks.sun + walks.sky)).sum(axis=0)
        return np.asarray(back(f(light).mean(axis=-1).T))

    return walked(gather)


def _sky_and_ambient(walks: Walks) -> Array:
    """The open sky is added to what the walks find of it."""
    sky = walks.sky.max(axis=(0, 2, 3))[:, None, None]
    return gathered(walks) + np.asarray((walks.weight[0] * sky).mean(axis=-1).T)


SAMPLINGS = (
    row("no-interreflection", SAMPLING, "light that comes by way of another surface is missing: follow the walk on",
        without(lambda k: float(k < 1))),
    row("bounce-missing", SAMPLING,
        "one bounce is missing: every surface on the way adds its own sunlight, the second one too",
        without(lambda k: float(k != 1)), without(lambda k: float(k != 2))),
    row("depth-off-by-one", SAMPLING,
        "walks end too early: depth counts surfaces, light to surface to eye is 2; compare your loop's limit",
        without(lambda k: float(k < 2)), without(lambda k: float(k < 3)), without(lambda k: float(k < 4))),
    row("pdf-too-large", SAMPLING,
        "each bounce is half as bright: directions that are uniform over the hemisphere have density 1/(2π), not 1/π",
        per_bounce(lambda cos: 0.5)),
    row("pdf-too-small", SAMPLING, "each bounce is twice as bright: a density is half of what it should be",
        per_bounce(lambda cos: 2.0)),
    row("bounce-by-pi", SAMPLING, "each bounce is divided by π: albedo/π times cosine, by cosine/π, is albedo",
        per_bounce(lambda cos: 1 / pi)),
    row("bounce-times-pi", SAMPLING, "each bounce is multiplied by π: albedo/π times cosine, by cosine/π, is albedo",
        per_bounce(lambda cos: pi)),
    row("cosine-twice", SAMPLING,
        "the cosine counts twice: directions of density cosine/π hold it already, so a bounce weighs the albedo alone",
        per_bounce(lambda cos: cos), per_bounce(lambda cos: 2 * cos), per_bounce(lambda cos: pi * cos)),
    row("cosine-missing", SAMPLING,
        "the cosine is missing at bounces: uniform directions weigh 2 albedo cosine",
        per_bounce(lambda cos: 1 / np.maximum(cos, 0.02)), per_bounce(lambda cos: 0.5 / np.maximum(cos, 0.02))),
    row("light-twice", SAMPLING, "the sun is counted twice where light is followed: once by its own ray is enough",
        walked(lambda w: gathered(w._replace(sun=2 * w.sun))), without(lambda k: 2.0 if k else 1.0)),
    row("sky-and-ambient", SAMPLING, "the sky is counted twice: walks that leave the scene find it, so add no ambient",
        walked(_sky_and_ambient)),
    row("sky-not-found", SAMPLING, "walks that leave the scene bring no light: there they meet the sky's radiance",
        walked(lambda w: gathered(w._replace(sky=0 * w.sky)))),
    row("gamma-in-mean", SAMPLING,
        "the samples are encoded for display before their mean is taken: average radiance, encode last if at all",
        _each_sample(lambda x: x ** (1 / 2.2)), _each_sample(lambda x: x ** (1 / 2.2), lambda x: x**2.2)),
    row("clamp-in-mean", SAMPLING, "each sample is cut off at 1 before the mean is taken: radiance may be larger",
        _each_sample(lambda x: np.minimum(x, 1))),
)  # fmt: skip
