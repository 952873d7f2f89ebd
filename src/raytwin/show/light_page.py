"""A photo's light as a page: a ball drawn in under it, what it was found by, where the sun is, and the map.

Of photos that were refused it shows why, the balls as they were given, and the board's axes, by which to give others.
"""

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from raytwin.images.image import Image
from raytwin.show import viewer
from raytwin.show.data_urls import small_jpeg, stops
from raytwin.show.page import write_page

if TYPE_CHECKING:
    from raytwin.photos.lighting.estimate_light import LightEstimate
    from raytwin.photos.lighting.linear_photo import LinearPhoto

LEAST_WIDTH = 256
"""Columns of the map as it is shown; its texels are repeated."""

SHOWN = 4
"""Photos at most that the page shows: every further one says the same."""

TICK = 0.05
"""Metres between two ticks of an axis."""

TURNS = ((0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1), (1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1))
"""EXIF's orientations 1 to 8: whether rows become columns, then columns and rows are reversed."""

SCALE = "scale: white paper in full light has luminance 1; its albedo is assumed to be 0.85"


def light_summary(found: "LightEstimate") -> str:
    """The models tried, what showed the sun, the light with its standard deviations, and warnings."""
    lines = ["model                     off the finest, on a matt sphere"]
    for i, t in enumerate(found.trials):
        lines.append(f"  {t.name:<22} {100 * t.on_sphere:10.2f} %{'  <- taken' if i == found.taken else ''}")
    lines += [f"{name}: {value}" for name, value in light_facts(found)]
    lines.append(f"({SCALE})")
    return "\n".join([*lines, *(f"warning: {text}" for text in found.warnings)])


def light_facts(found: "LightEstimate") -> list[tuple[str, str]]:
    """What was found, each with its standard deviation: (name, value)."""
    light, facts = found.light, []
    if light is None:
        return []
    for mirror in found.evidence.mirrors:
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
    if found.light:
        image = Image(found.light.shown_map(LEAST_WIDTH // 2))
        pane = {
            "key": "reference", "kind": "radiance", "title": "Map", "tab": "Map", "alt": "the light from all around",
        }  # fmt: skip
        data = viewer.pack(image, image, budget=1 << 40, most_pixels=1 << 40).for_page() | {
            "names": {"test": "map", "reference": "map"}, "panes": [pane], "noisy": False,
            "bound": {"share": 0.1, "scale": 1.0, "held": False}, "exposure": stops(image),
        }  # fmt: skip
    first = found.photos[0]
    write_page(
        path, "light.html.j2", (viewer.style(), STYLE), (viewer.script(),) if data else (),
        data=data, found=found, facts=light_facts(found), scale=SCALE, tick=round(1000 * TICK),
        photos=[_drawing(found, photo) for photo in found.photos[:SHOWN]],
        before=_jpeg(first.pixels, first.turn),
        after=_jpeg(found.drawn, first.turn) if found.drawn is not None else None,
    )  # fmt: skip


STYLE = """
.lit { position: relative; margin: 0 0 1rem; max-width: 60rem; }
.lit img, .lit svg { display: block; width: 100%; height: auto; }
.lit svg { position: absolute; inset: 0; height: 100%; }
.lit text { paint-order: stroke; stroke: #000; fill: #fff; font-weight: 600; }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(18rem, 100%), 1fr)); gap: 1rem; }
"""


def _drawing(found: "LightEstimate", photo: "LinearPhoto") -> dict[str, Any]:
    """A photo, and what lies over it: (points, colour, closed) of each line, and (u, v, text) of each label."""
    lines, labels = _axes(found, photo)
    lines += _evidence(found, photo)
    height, width = _turned(photo.pixels, photo.turn).shape[:2]

    def upright(uv: np.ndarray) -> np.ndarray:
        transposed, columns, rows = TURNS[photo.turn - 1]
        u, v = (uv[:, ::-1] if transposed else uv).T
        return np.stack([width - 1 - u if columns else u, height - 1 - v if rows else v], axis=1)

    paths = [(" ".join(f"{u:.1f},{v:.1f}" for u, v in upright(line)), *style) for line, *style in lines]
    seen = [(upright(np.array([at]))[0].round(1).tolist(), text) for at, text in labels]
    border = width / 40
    texts: list[
        tuple[float, float, str]
    ] = []  # a label that the frame would cut is left out, or that another one would cover
    for (u, v), text in sorted(seen, key=lambda label: label[1].isdigit()):  # the axes' names first
        inside = border < u < width - border and border < v < height - border
        if inside and all(abs(u - a) > 2.5 * border or abs(v - b) > 1.2 * border for a, b, _ in texts):
            texts.append((u, v, text))
    return {
        "name": photo.name, "url": _jpeg(photo.pixels, photo.turn), "width": width, "height": height,
        "paths": paths, "texts": texts,
    }  # fmt: skip


def _axes(found: "LightEstimate", photo: "LinearPhoto") -> tuple[list[tuple], list[tuple]]:
    """The board's axes from its origin, a tick every TICK metres, each second one labelled in millimetres."""
    far = np.max(list(found.board.centers().values()), axis=0)
    lines, labels = [], []
    for k, (name, colour) in enumerate((("x", "#f55"), ("y", "#3d3"), ("z", "#5af"))):
        axis, across = np.eye(3)[k], np.eye(3)[1 if k == 0 else 0]
        count = max(2, int(np.ceil(far[k] / TICK)) if k < 2 else 2)
        ends = photo.project(np.array([0 * axis, count * TICK * axis, (count + 0.3) * TICK * axis]))
        lines.append((ends[:2], colour, False))
        labels.append((ends[2], name))
        for i in range(1, count + 1):
            at = i * TICK * axis
            tick = photo.project(
                np.array([at - 0.1 * TICK * across, at + 0.1 * TICK * across, at - 0.4 * TICK * across])
            )
            lines.append((tick[:2], colour, False))
            if i % 2 == 0:
                labels.append((tick[2], str(round(1000 * i * TICK))))
    return lines, labels


def _evidence(found: "LightEstimate", photo: "LinearPhoto") -> list[tuple]:
    """Outlines of balls, an upright with its shadow, and an arrow towards the sun from the top of it."""
    from raytwin.photos.lighting.estimate_light import middle_of
    from raytwin.photos.lighting.mirror_ball import outline

    if found.refusal:
        lines: list[tuple] = [(outline(photo, ball), "#f22", True) for ball in found.given]
    else:
        lines = [(outline(photo, mirror.ball), "#fd0", True) for mirror in found.evidence.mirrors]
    cross = photo.camera.width / 100 * np.array([(-1, 0), (1, 0), (0, 0), (0, -1), (0, 1)])
    k = next(i for i, one in enumerate(found.photos) if one is photo)
    lines += [(spot[0] + cross, "#fd0", False) for m in found.evidence.mirrors if (spot := m.spots[k])]
    shadow, sun = found.evidence.shadow, found.light.to_light if found.light else None
    if shadow:
        foot, height = np.array([*shadow.foot, 0]), shadow.height
    elif found.stand:
        foot, height = np.array([*found.stand[:2], 0]), found.stand[2]
    else:
        foot, height = np.array([*middle_of(found.board), 0]), found.board.tag_edge
    top = foot + np.array([0, 0, height])
    if shadow or found.stand or sun is not None:
        lines.append((photo.project(np.array([top, foot])), "#c6f", False))
    if shadow:
        lines.append((photo.project(np.array([foot, [*shadow.tip, 0]])), "#28f", False))
    elif sun is not None:
        lines.append((photo.project(np.array([foot, top - sun * height / sun[2]])), "#28f", False))
    if sun is not None:
        tip = photo.project(np.array([top, top + 2 * height * sun]))
        along = tip[1] - tip[0]
        aside = np.array([-along[1], along[0]])
        head = [tip[1] - 0.2 * along + 0.1 * aside, tip[1], tip[1] - 0.2 * along - 0.1 * aside]
        lines += [(tip, "#fd0", False), (np.array(head), "#fd0", False)]
    return [line for line in lines if np.isfinite(line[0]).all()]


def _turned(pixels: np.ndarray, turn: int) -> np.ndarray:
    transposed, columns, rows = TURNS[turn - 1]
    pixels = pixels.swapaxes(0, 1) if transposed else pixels
    return pixels[:: -1 if rows else 1, :: -1 if columns else 1]


def _jpeg(pixels: np.ndarray, turn: int) -> str:
    h, w = pixels.shape[:2]
    return small_jpeg(np.ascontiguousarray(_turned(pixels, turn)), (2 * h, 2 * w))[0]  # a quarter: a page has up to six
