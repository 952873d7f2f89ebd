"""A photo's light as a page: a ball drawn in under it, what it was found by, where the sun is, and the map.

Of a photo that was refused it shows why, the ball as it was given, and the board's axes, by which to give another.
"""

import os
from typing import TYPE_CHECKING

import numpy as np

from raytwin.images.image import Image
from raytwin.show import viewer
from raytwin.show.data_urls import small_jpeg, stops
from raytwin.show.page import write_page

if TYPE_CHECKING:
    from raytwin.photos.lighting.estimate_light import LightEstimate

REPEATED = 8
"""How often each texel of the map is repeated, across and down."""

TICK = 0.05
"""Metres between two ticks of an axis."""

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
    """The models tried, what showed the sun, the light with its standard deviations, and warnings."""
    lines = ["model                     off the map, on a matt sphere"]
    for i, t in enumerate(found.trials):
        lines.append(f"  {t.name:<22} {100 * t.on_sphere:10.2f} %{'  <- taken' if i == found.taken else ''}")
    lines += [f"{name}: {value}" for name, value in light_facts(found)]
    lines.append(f"({SCALE})")
    return "\n".join([*lines, *(f"warning: {text}" for text in found.warnings)])


def light_facts(found: "LightEstimate") -> list[tuple[str, str]]:
    """What was found, each with its standard deviation: (name, value)."""
    light, mirror, facts = found.light, found.evidence.mirror, []
    if light is None:
        return []
    if mirror:
        ball = mirror.ball
        x, y, z = (f"{1000 * v:.1f}" for v in ball.center)
        where = f"({x}, {y}, {z}) ± {1000 * ball.sigma[:3].max():.1f} mm"
        radius = f"radius {1000 * ball.radius:.1f} ± {1000 * ball.sigma[3]:.1f} mm"
        facts.append(("mirror ball", f"center {where}, {radius}, reflectance {mirror.reflectance.mean():.2f}"))
    facts += [(f"sun by the {n}", f"{_angles(d)} ± {np.degrees(sd):.2f} degrees") for n, d, sd in found.evidence.suns]
    if light.to_light is not None:
        facts.append(("sun", f"{_angles(light.to_light)} ± {np.degrees(light.sigma):.2f} degrees, by all of these"))
        facts.append(("sun's irradiance", _triple(light.E, light.E_sd)))
    name = "constant sky that lights level paper as the map does" if light.around is not None else "sky's radiance"
    return [*facts, (name, _triple(light.Ls, light.Ls_sd))]


def _angles(d: np.ndarray) -> str:
    turn = np.degrees(np.arctan2(d[1], d[0])) % 360
    return f"{np.degrees(np.arcsin(d[2])):.2f} degrees high, {turn:.2f} from the board's x towards y"


def _triple(values: np.ndarray, sds: np.ndarray) -> str:
    return ", ".join(f"{v:.3f} ± {s:.3f}" for v, s in zip(values, sds, strict=True))


def write_light_page(found: "LightEstimate", path: str | os.PathLike[str]) -> None:
    """light.html, which holds everything that it shows."""
    data = None
    if found.light and found.light.around is not None:
        image = Image(found.light.around.repeat(REPEATED, axis=0).repeat(REPEATED, axis=1))
        pane = {
            "key": "reference", "kind": "radiance", "title": "Map", "tab": "Map", "alt": "the light from all around",
        }  # fmt: skip
        data = viewer.pack(image, image, budget=1 << 40, most_pixels=1 << 40).for_page() | {
            "names": {"test": "map", "reference": "map"}, "panes": [pane], "noisy": False,
            "bound": {"share": 0.1, "scale": 1.0, "held": False}, "exposure": stops(image),
        }  # fmt: skip
    axes, labels = _axes(found)
    lines = [(line, colour) for line, colour in axes + _evidence(found) if np.isfinite(line).all()]
    paths = [(" ".join(f"{u:.1f},{v:.1f}" for u, v in line), colour) for line, colour in lines]
    write_page(
        path, "light.html.j2", (viewer.style(), STYLE), (viewer.script(),) if data else (),
        data=data, found=found, facts=light_facts(found), scale=SCALE, tick=round(1000 * TICK),
        size=found.photo.camera.image_size, paths=paths, labels=labels, before=_jpeg(found.photo.pixels),
        after=_jpeg(found.drawn) if found.drawn is not None else None,
    )  # fmt: skip


def _axes(found: "LightEstimate") -> tuple[list[Line], list[tuple[float, float, str]]]:
    """The board's axes from its origin, a tick every TICK metres, and labels: each second one's millimetres. A label
    that the frame would cut, or that would cover another one, is left out."""
    far = np.max(list(found.board.centers().values()), axis=0)
    lines, labels = [], []
    for k, (name, colour) in enumerate((("x", "#f55"), ("y", "#3d3"), ("z", "#5af"))):
        axis, across = np.eye(3)[k], TICK * np.eye(3)[1 if k == 0 else 0]
        count = max(2, int(np.ceil(far[k] / TICK))) if k < 2 else 2
        end = found.photo.project(np.array([0 * axis, count * TICK * axis, (count + 0.3) * TICK * axis]))
        lines.append((end[:2], colour))
        labels.append((end[2], name))
        for i in range(1, count + 1):
            tick = found.photo.project(i * TICK * axis + np.array([[-0.1], [0.1], [-0.4]]) * across)
            lines.append((tick[:2], colour))
            if i % 2 == 0:
                labels.append((tick[2], str(round(1000 * i * TICK))))
    size, border = np.array(found.photo.camera.image_size), found.photo.camera.width / 40
    shown: list[tuple[float, float, str]] = []
    for at, text in sorted(labels, key=lambda label: label[1].isdigit()):  # the axes' names first
        inside = (at > border).all() and (at < size - border).all()
        if inside and all((np.abs(at - other[:2]) > (2.5 * border, 1.2 * border)).any() for other in shown):
            shown.append((*at.round(1).tolist(), text))
    return lines, shown


def _evidence(found: "LightEstimate") -> list[Line]:
    """The outline of the ball, an upright with its shadow, and an arrow towards the sun from the top of it."""
    from raytwin.photos.lighting.estimate_light import middle_of
    from raytwin.photos.lighting.mirror_ball import Ball, outline

    photo, mirror, lines = found.photo, found.evidence.mirror, []
    if mirror:
        lines.append((outline(photo, mirror.ball), "#fd0"))
        if mirror.spot:
            cross = photo.camera.width / 100 * np.array([(-1, 0), (1, 0), (0, 0), (0, -1), (0, 1)])
            lines.append((mirror.spot.middle + cross, "#fd0"))
    elif found.ball:
        lines.append((outline(photo, Ball(np.array(found.ball[:3]), found.ball[3], np.zeros(4))), "#f22"))
    sun = found.light.to_light if found.light else None
    x, y, height = found.stand or (*middle_of(found.board), found.board.tag_edge)
    foot, top = np.array([x, y, 0.0]), np.array([x, y, height])
    if found.stand or sun is not None:
        lines.append((photo.project(np.array([top, foot])), "#c6f"))
    if sun is not None:
        lines.append((photo.project(np.array([foot, top - sun * height / sun[2]])), "#28f"))
        tip = photo.project(np.array([top, top + 2 * height * sun]))
        along = tip[1] - tip[0]
        aside = np.array([-along[1], along[0]])
        lines.append(
            (
                np.array(
                    [tip[0], tip[1], tip[1] - 0.2 * along + 0.1 * aside, tip[1], tip[1] - 0.2 * along - 0.1 * aside]
                ),
                "#fd0",
            )
        )
    return lines


def _jpeg(pixels: np.ndarray) -> str:
    h, w = pixels.shape[:2]
    return small_jpeg(pixels, (2 * h, 2 * w))[0]
