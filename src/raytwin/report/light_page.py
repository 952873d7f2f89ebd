"""A photo's light as a page: what it was found by, the map, where the sun is, and a ball drawn in under it."""

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from raytwin import files, viewer
from raytwin.image import Image
from raytwin.report.data_urls import stops
from raytwin.report.page import write_page

if TYPE_CHECKING:
    from raytwin.workflows.estimate_light import LightEstimate

LEAST_WIDTH = 256
"""Columns of the map as it is shown; its texels are repeated."""

SHOWN = 4
"""Photos at most that the page shows: every further one says the same."""


def light_summary(found: "LightEstimate") -> str:
    """The models tried, what showed the sun, the light with its standard deviations, and warnings."""
    lines = ["model                     held-out error   on a matt sphere   seconds"]
    for i, t in enumerate(found.trials):
        taken = "  <- taken" if i == found.taken else ""
        lines.append(f"  {t.name:<22} {100 * t.error:10.2f} % {100 * t.on_sphere:16.2f} % {t.seconds:9.2f}{taken}")
    lines += ["(on a matt sphere: how far its shading is off that under the last model)"]
    lines += [f"{name}: {value}" for name, value in light_facts(found)]
    lines.append(f"({SCALE})")
    return "\n".join([*lines, *(f"warning: {text}" for text in found.warnings)])


SCALE = "scale: white paper in full light has luminance 1; its albedo is assumed to be 0.85"


def light_facts(found: "LightEstimate") -> list[tuple[str, str]]:
    """What was found, each with its standard deviation: (name, value)."""
    light, facts = found.light, []
    for kind, ball in _balls(found):
        x, y, z = (f"{1000 * v:.1f}" for v in ball.center)
        where = f"({x}, {y}, {z}) ± {1000 * ball.sigma[:3].max():.1f} mm"
        facts.append(
            (f"{kind} ball", f"center {where}, radius {1000 * ball.radius:.1f} ± {1000 * ball.sigma[3]:.1f} mm")
        )
    facts += [(f"sun by the {name}", f"{_angles(d)} ± {np.degrees(sd):.2f} degrees") for name, d, sd in found.suns]
    if light.to_light is not None:
        facts.append(("sun", f"{_angles(light.to_light)} ± {np.degrees(light.sigma):.2f} degrees, by all of these"))
        facts.append(("sun's irradiance", _triple(light.E, light.E_sd)))
    name = "constant sky that lights level paper as the map does" if light.around is not None else "sky's radiance"
    return [*facts, (name, _triple(light.Ls, light.Ls_sd))]


def _balls(found: "LightEstimate") -> list[tuple[str, Any]]:
    return [("matt", m.ball) for m in found.evidence.matt] + [("mirror", m.ball) for m in found.evidence.mirrors]


def _angles(d: np.ndarray) -> str:
    turn = np.degrees(np.arctan2(d[1], d[0])) % 360
    return f"{np.degrees(np.arcsin(d[2])):.2f} degrees high, {turn:.2f} from the board's x towards y"


def _triple(values: np.ndarray, sds: np.ndarray) -> str:
    return ", ".join(f"{v:.3f} ± {s:.3f}" for v, s in zip(values, sds, strict=True))


def write_light_page(found: "LightEstimate", path: str | os.PathLike[str]) -> None:
    """light.html, which holds everything that it shows."""
    around = found.light.shown_map(LEAST_WIDTH // 2)
    image = Image(around)
    panes = [{"key": "reference", "kind": "radiance", "title": "Map", "tab": "Map", "alt": "the light from all around"}]
    data = viewer.pack(image, image, budget=1 << 40, most_pixels=1 << 40).for_page() | {
        "names": {"test": "map", "reference": "map"}, "panes": panes, "noisy": False,
        "bound": {"share": 0.1, "scale": 1.0, "held": False}, "exposure": stops(image),
    }  # fmt: skip
    write_page(
        path, "light.html.j2", (viewer.style(), STYLE), (viewer.script(),),
        data=data, found=found, facts=light_facts(found), scale=SCALE,
        photos=[_drawing(found, i) for i in range(min(len(found.photos), SHOWN))],
        before=_jpeg(found.photos[0].pixels), after=_jpeg(found.drawn) if found.drawn is not None else None,
    )  # fmt: skip


STYLE = """
.lit { position: relative; margin: 0 0 1rem; max-width: 60rem; }
.lit img, .lit svg { display: block; width: 100%; height: auto; }
.lit svg { position: absolute; inset: 0; height: 100%; }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(18rem, 1fr)); gap: 1rem; }
"""


def _drawing(found: "LightEstimate", i: int) -> dict[str, Any]:
    """The i-th photo, and what lies over it: outlines, the upright with its shadow, mirrored pixels of the sun."""
    photo = found.photos[i]
    paths = [(" ".join(f"{u:.1f},{v:.1f}" for u, v in line), colour, closed) for line, colour, closed in found.lines(i)]
    return {
        "name": photo.name, "url": _jpeg(photo.pixels), "width": photo.camera.width, "height": photo.camera.height,
        "paths": paths,
    }  # fmt: skip


def _jpeg(pixels: np.ndarray) -> str:
    from PIL import Image as Pillow

    picture = Pillow.fromarray(np.ascontiguousarray(pixels))
    picture.thumbnail((1400, 1400))
    return files.data_url(picture, "jpeg", quality=85)
