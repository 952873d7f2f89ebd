"""Mistakes in the values that are handed in."""

from functools import partial

import numpy as np

from raytwin.diagnose.changes import SUM, Ways, behind, pixels, shade, shown
from raytwin.diagnose.predict import Array, Pipeline, replaced, slip
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


OUTPUTS: Ways = {
    "gamma-once": (shown(srgb_encode), shown(partial(_power, k=1 / 2.2)), shown(partial(_power, k=1 / 2)),
        shown(lambda x: srgb_encode(np.clip(x, 0, 1))), shown(lambda x: _power(np.clip(x, 0, 1), 1 / 2.2)),
        *shade(f"{SUM} => ({SUM}) ** (1 / 2.2)")),
    "gamma-twice": (shown(lambda x: srgb_encode(srgb_encode(x))), shown(partial(_power, k=1 / 2.2**2))),
    "gamma-missing": (
        shown(lambda x: srgb_decode(np.maximum(x, 0))), shown(partial(_power, k=2.2)), shown(partial(_power, k=2))),
    "bgr": (shown(lambda x: x[..., ::-1]), *shade(f"{SUM} => ({SUM})[:, ::-1]")),
    "channels-turned": (
        shown(lambda x: x[..., [1, 2, 0]]), shown(lambda x: x[..., [2, 0, 1]]), shown(lambda x: x[..., [1, 0, 2]]),
        shown(lambda x: x[..., [0, 2, 1]])),
    "grey": (shown(lambda x: np.broadcast_to(x.mean(axis=-1, keepdims=True), x.shape)),
        shown(lambda x: np.broadcast_to(x @ np.array([0.2126, 0.7152, 0.0722])[:, None], x.shape)),
        shown(lambda x: np.broadcast_to(x @ np.array([0.299, 0.587, 0.114])[:, None], x.shape)),
        *(shown(partial(_channel, k=k)) for k in range(3))),
    "clamped": (shown(lambda x: np.minimum(x, 1)),
        *shade(f"{SUM} => np.clip({SUM}, 0, 1)")),
    "overflow": (shown(_overflow), shown(lambda x: np.rint(np.maximum(x, 0) * 255) % 256 / 255),
        shown(partial(_overflow, by=256)), shown(lambda x: srgb_decode(_overflow(srgb_encode(x)))),
        shown(lambda x: _overflow(srgb_encode(x))), shown(lambda x: _overflow(_power(x, 1 / 2.2)))),
    "eight-bits": (
        shown(lambda x: np.floor(np.clip(x, 0, 1) * 255) / 255), shown(lambda x: np.rint(np.clip(x, 0, 1) * 255) / 255),
        shown(lambda x: srgb_decode(np.floor(srgb_encode(np.clip(x, 0, 1)) * 255) / 255)),
        shown(lambda x: srgb_decode(np.rint(srgb_encode(np.clip(x, 0, 1)) * 255) / 255))),
    "rounded": (shown(np.floor), shown(np.rint), *(shown(partial(_rounded, digits=k)) for k in (1, 2, 3))),
    "times-255": (shown(lambda x: 255 * x), shown(lambda x: np.floor(np.clip(x, 0, 1) * 255)),
        shown(lambda x: np.rint(np.clip(x, 0, 1) * 255))),
    "by-255": (shown(lambda x: x / 255),),
    "half-float": (shown(lambda x: np.clip(x, -65504, 65504).astype(np.float16).astype(float)),),
    "upside-down": pixels("u, height - 1 - v"),
    "mirrored": pixels("width - 1 - u, v"),
    "half-turn": pixels("width - 1 - u, height - 1 - v"),
    "normalised": (replaced(output=lambda right: lambda x, brightest: right(x, brightest) / brightest),),
    "tone-mapped": (shown(lambda x: x / (1 + np.maximum(x, 0))), shown(lambda x: 1 - np.exp(-np.maximum(x, 0)))),
    "negative": (shown(lambda x: 1 - x),),
    "background-black": behind("0"),
    "background-white": behind("1"),
    "background-gradient": tuple(_gradient(height, sky) for sky in ("sky", "np.array([0.5, 0.7, 1.0])")
        for height in ("d[:, 1]", "d[:, 2]", '-(d @ scene["R_cam_board"][1])')),
    "background-sun": behind('sun["irradiance"]', 'sky + sun["irradiance"]', 'sun["irradiance"] / np.pi'),
    "empty": (shown(lambda x: 0 * x),),
}  # fmt: skip
