"""A photo's light as a page: a ball drawn in under it, what it was found by, where the sun is, and the map.

Of a photo that was refused it shows why, the ball as it was given, and the board's axes, by which to give another.
"""

import os
from typing import TYPE_CHECKING

import numpy as np

from raytwin.images.packing import MOST_PIXELS
from raytwin.images.photo_files import to_bytes
from raytwin.show.data_urls import small_jpeg
from raytwin.show.page import write_page

if TYPE_CHECKING:
    from raytwin.photos.lighting.estimate_light import LightEstimate

MAP_PIXELS_PER_TEXEL = 24
"""How often each texel of the map is repeated, across and down."""

MAP_WHITE = 2.0
"""Radiance that is white in the picture of the map, over its mean."""

TICK_METRES = 0.05
"""Distance between two ticks of an axis."""

SCALE = "scale: white paper in full light has luminance 1; its albedo is assumed to be 0.85"

STYLE = """
.lit { position: relative; margin: 0 0 1rem; max-width: 60rem; }
.lit img, .lit svg { display: block; width: 100%; height: auto; }
.lit svg { position: absolute; inset: 0; height: 100%; }
.lit text { paint-order: stroke; stroke: #000; fill: #fff; font-weight: 600; }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(18rem, 100%), 1fr)); gap: 1rem; }
"""

Line = tuple[np.ndarray, str]
"""Points (n, 2) of a line, pixels, and its colour."""


def light_summary(found: "LightEstimate") -> str:
    """Return what showed the light, the light with its standard deviations, and warnings."""
    lines = [f"{name}: {value}" for name, value in light_facts(found)]
    return "\n".join([*lines, f"({SCALE})", *(f"warning: {text}" for text in found.warnings)])


def light_facts(found: "LightEstimate") -> list[tuple[str, str]]:
    """Return what was found, each with its standard deviation: (name, value)."""
    light, mirror = found.light, found.mirror
    if light is None:
        return []
    facts = [("light", light.name)]
    if mirror:
        ball = mirror.ball
        x, y, z = (f"{1000 * v:.1f}" for v in ball.center)
        where = f"({x}, {y}, {z}) ± {1000 * ball.sigma[:3].max():.1f} mm"
        radius = f"radius {1000 * ball.radius:.1f} ± {1000 * ball.sigma[3]:.1f} mm"
        facts.append(("a constant sky", f"off by {100 * found.off_by_constant:.2f} % on a matt sphere"))
        facts.append(("mirror ball", f"center {where}, {radius}, reflectance {mirror.reflectance.mean():.2f}"))
    if light.to_light is not None:
        x, y, z = light.to_light
        direction = f"{np.degrees(np.arcsin(z)):.2f} degrees high, {np.degrees(np.arctan2(y, x)) % 360:.2f} from the"
        facts.append(("sun", f"{direction} board's x towards y, ± {np.degrees(light.sigma):.2f} degrees"))
        facts.append(("sun's irradiance", _triple(light.E, light.E_sd)))
    name = "constant sky that lights level paper as the map does" if light.around is not None else "sky's radiance"
    return [*facts, (name, _triple(light.Ls, light.Ls_sd))]


def _triple(values: np.ndarray, sds: np.ndarray) -> str:
    return ", ".join(f"{v:.3f} ± {s:.3f}" for v, s in zip(values, sds, strict=True))


def write_light_page(found: "LightEstimate", path: str | os.PathLike[str]) -> None:
    """Write light.html, which holds everything that it shows."""
    around = None
    if found.light and found.light.around is not None:
        texels = found.light.around / (MAP_WHITE * found.light.around.mean())
        around = _jpeg(to_bytes(texels).repeat(MAP_PIXELS_PER_TEXEL, axis=0).repeat(MAP_PIXELS_PER_TEXEL, axis=1))
    axes, labels = _axes(found)
    lines = [(line, colour) for line, colour in axes + _evidence(found) if np.isfinite(line).all()]
    write_page(
        path, "light.html.j2", (STYLE,), found=found, facts=light_facts(found), scale=SCALE,
        tick=round(1000 * TICK_METRES), size=found.photo.camera.image_size, labels=labels, map=around,
        paths=[(" ".join(f"{u:.1f},{v:.1f}" for u, v in line), colour) for line, colour in lines],
        before=_jpeg(found.photo.pixels), after=_jpeg(found.drawn) if found.drawn is not None else None,
    )  # fmt: skip


def _axes(found: "LightEstimate") -> tuple[list[Line], list[tuple[float, float, str]]]:
    """Return the board's axes from its origin with a tick every TICK_METRES, and their labels: the axis with the last
    tick's millimetres."""
    far = np.max(list(found.board.centers().values()), axis=0)
    lines, labels = [], []
    for k, (name, colour) in enumerate((("x", "#f55"), ("y", "#3d3"), ("z", "#5af"))):
        axis, across = TICK_METRES * np.eye(3)[k], TICK_METRES * np.eye(3)[1 if k == 0 else 0]
        count = max(2, int(np.ceil(far[k] / TICK_METRES))) if k < 2 else 2
        origin, end, beyond = found.photo.project(np.outer([0, count, count + 0.3], axis))
        lines.append((np.array([origin, end]), colour))
        labels.append((*beyond.round(1).tolist(), f"{name} {round(1000 * count * TICK_METRES)}"))
        ticks = (i * axis + np.outer([-0.1, 0.1], across) for i in range(1, count + 1))
        lines += [(found.photo.project(tick), colour) for tick in ticks]
    return lines, labels


def _evidence(found: "LightEstimate") -> list[Line]:
    """Return the ball's outline with a cross at the sun's spot, and an upright with its shadow."""
    from raytwin.photos.lighting.mirror_ball import Ball, outline

    photo, mirror, lines = found.photo, found.mirror, []
    if mirror:
        lines.append((outline(photo, mirror.ball), "#fd0"))
        if mirror.spot:
            cross = photo.camera.width / 100 * np.array([(-1, 0), (1, 0), (0, 0), (0, -1), (0, 1)])
            lines.append((mirror.spot.middle + cross, "#fd0"))
    elif found.ball:
        lines.append((outline(photo, Ball(np.array(found.ball[:3]), found.ball[3], np.zeros(4))), "#f22"))
    if found.stand:
        x, y, height = found.stand
        foot, top = np.array([x, y, 0.0]), np.array([x, y, height])
        lines.append((photo.project(np.array([top, foot])), "#c6f"))
        if found.light and (sun := found.light.to_light) is not None:
            lines.append((photo.project(np.array([foot, top - sun * height / sun[2]])), "#28f"))
    return lines


def _jpeg(pixels: np.ndarray) -> str:
    return small_jpeg(pixels, MOST_PIXELS // 4)[0]
