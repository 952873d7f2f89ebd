"""Measure the paper's figures 10 to 12 again, each time with the error that the paper leaves out.

    python -m measure.paper [--record] [PHOTOS [WIDTH [REPEATS]]]

calibration    seconds of a whole calibration over image scale, and the error in photos that the fit did not use
intersection   a frame of two spheres by a plain loop, NumPy and Dr.Jit, trimmed and not, and its error
speculation    every n-th pixel traced, the rest interpolated, and its error

The paper: "An Image Augmentation Pipeline With Customized Data For AR Education". It ran a Python loop over pixels on
Google Colab: its seconds are another machine's, so only ratios compare. Photos and frames have 4032 x 3024 pixels by
default, and the loop's frames a quarter of the side. Errors of frames are those of radiance, against the untrimmed
tracer in float64.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from measure import record
from measure.calibration_cost import OURS, QUARTER, WHOLE, costs, medians, photographed
from scene_of import scene_of

from raytwin import twin
from raytwin.compare import METRICS
from raytwin.errors import InputError
from raytwin.fast import TRIMS, background, trace
from raytwin.images.image import BACKGROUND, Image
from raytwin.renderers.renderer import Call, Renderer
from raytwin.renderers.renderer_table import renderers_of
from raytwin.renderers.subject_renderers import Speculated
from raytwin.scene import Camera, Scene, Sky, Sphere, Sun, to_camera_frame
from raytwin.show.numbers import shown
from raytwin.tracer import STAGES, PlainWorld
from raytwin.tracer.lights import lighting
from raytwin.tracer.shading import RADIANCE
from raytwin.tracer.world import first_hit

COLUMNS = "figure", "what", "the paper", "its times faster", "times faster", "error"
Row = tuple[str, ...]

STATED = {WHOLE: ("34.8 s", "1.00"), QUARTER: ("2.5 s", "13.9")}
"""What the paper states for photos of 12 megapixels."""
STATED_FRAMES = {"none": ("17.7 and 19.6 s", ""), "corners": ("1.3 and 8 s", "13.6 and 2.45")}
"""What the paper states for a loop over 756 x 1008 pixels, two spheres."""
NO_TIME = "", ""

RUNG = "lambert"
"""Diffuse light without shadows, as in the paper."""
BOXES = {"none": "untrimmed", "corners": "eight-corner box", "conic": "conic box"}
SMALL = "numpy32-lambert-*", "drjit32-lambert-*"
LARGE = (
    "numpy32-lambert-*",
    "drjit32-lambert-*",
    *(f"numpy32-shadow-{w}{n}" for w in ("paper", "careful") for n in (4, 8)),
)
"""Patterns of RENDERERS; shadow's are measured at RUNG."""

DOWN = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
"""R_cam_board of a camera above the board that looks straight down."""


@dataclass(frozen=True)
class Loop(Renderer):
    """The paper's way: one ray after another by the tracer's own functions, in the objects' boxes of a `trim`."""

    trim: str = "none"

    @property
    def name(self) -> str:
        return f"loop-{self.rung}-{self.trim}"

    def prepare(self, scene: Scene) -> Call:
        local, camera = to_camera_frame(scene), scene.camera
        light, world, eye = lighting(local), PlainWorld(local.objects, STAGES), (0.0, 0.0, 0.0)
        inside = np.zeros((camera.height, camera.width), bool)
        for x0, y0, x1, y1 in TRIMS[self.trim](scene.objects, camera).tolist():
            inside[y0:y1, x0:x1] = True

        def call(seed: int) -> Image:
            out = background(scene, self.rung)
            for v, u in np.argwhere(inside).tolist():
                hit = first_hit(world, eye, STAGES.back_project(float(u), float(v), camera, STAGES.undistort))
                if hit.ids > BACKGROUND:
                    out[v, u] = RADIANCE[self.rung](hit, light, world, camera)
            return Image(out)

        return call


def two_spheres(width: int, height: int) -> Scene:
    """Return two spheres that cover about 5 % of a frame of a phone's lens, 0.5 m away."""
    f = 0.7234 * width
    K = ((f, 0.0, 0.5 * width), (0.0, 0.9965 * f, 0.496 * height), (0.0, 0.0, 1.0))
    camera = Camera((width, height), K, DOWN, (0.0, 0.0, 0.5), (0.1, -0.2, 0.001, -0.0005, 0.05))
    red, blue = (0.8, 0.3, 0.2), (0.2, 0.3, 0.8)
    spheres = Sphere((-0.05, 0.02, 0.05), 0.0455, red), Sphere((0.06, -0.03, 0.06), 0.047, blue)
    return scene_of("two spheres", camera, spheres, (Sun((0.3, 0.4, 1.0)), Sky((0.1, 0.1, 0.1))))


def seen(image: Image) -> np.ndarray:
    """Return where an object is seen."""
    assert image.surface is not None
    return image.surface.mask


def cut(scene: Scene, trim: str) -> int:
    """Return how many pixels see an object outside its box."""
    lost = 0
    for thing, (x0, y0, x1, y1) in zip(scene.objects, TRIMS[trim](scene.objects, scene.camera).tolist(), strict=True):
        mask = seen(trace(scene_of(scene.name, scene.camera, (thing,)), "surface", trim="none")).copy()
        mask[y0:y1, x0:x1] = False
        lost += int(mask.sum())
    return lost


def calibrations(folder: Path, count: int, size: tuple[int, int], repeats: int) -> Iterator[Row]:
    found = costs(folder, repeats, (WHOLE, OURS, QUARTER))
    for name, cost in found.items():
        faster = shown(found[WHOLE].seconds / cost.seconds) if WHOLE in found else "–"
        figure = f"calibration: synthetic, {count} of {size[0]} x {size[1]}"
        yield figure, name, *STATED.get(name, NO_TIME), faster, f"{shown(cost.heldout)} px held out"


def frames(scene: Scene, named: list[Renderer], repeats: int) -> Iterator[Row]:
    """Yield a row per method that works on this machine: how much faster than the untrimmed one, and its error."""
    truth, calls, errors = trace(scene, RUNG, "numpy64", trim="none").mean, {}, {}
    methods = [replace(method, rung=RUNG) for method in named]
    for method in methods:
        try:
            call = method.prepare(scene)
            image = call(0).mean
        except InputError as error:
            print(f"{method.name}: {error}")
            continue
        calls[method.name] = lambda call=call: call(0)
        errors[method.name] = {name: shown(METRICS[name].function(image, truth)) for name in ("rmse", "max_abs")}
    seconds = medians(calls, repeats)
    width, height = scene.camera.image_size
    for method in (one for one in methods if one.name in seconds):
        faster, error = shown(seconds[untrimmed(method)] / seconds[method.name]), errors[method.name]
        if isinstance(method, Speculated):
            worst = f"RMSE {error['rmse']}, worst {error['max_abs']}"
            yield f"speculation: {width} x {height}", f"{method.way}, n = {method.step}", *NO_TIME, faster, worst
        else:
            stated = STATED_FRAMES.get(method.trim, NO_TIME) if isinstance(method, Loop) else NO_TIME
            lost = f"RMSE {error['rmse']}, {cut(scene, method.trim)} px cut"
            yield (
                f"intersection: {method.name.rpartition('-')[0]}, {width} x {height}",
                BOXES[method.trim],
                *stated,
                faster,
                lost,
            )


def untrimmed(method: Renderer) -> str:
    """Return the name of what a method's seconds are compared with: every pixel, on the same engine."""
    return f"{method.name.partition('-')[0]}-{RUNG}-none"


def main(count: str = "15", width: str = "4032", repeats: str = "3") -> None:
    size, times = (int(width), int(width) * 3 // 4), int(repeats)
    with photographed(int(count), size) as folder:
        rows = [*calibrations(folder, int(count), size, times)]
    twin.activate()
    loops = [Loop(RUNG, trim) for trim in BOXES]
    rows += frames(two_spheres(size[0] // 4, size[1] // 4), [*loops, *renderers_of(SMALL)], times)
    rows += frames(two_spheres(*size), renderers_of(LARGE), times)
    record.table("paper", "figures", COLUMNS, rows, " ".join(["python -m measure.paper", *record.arguments()]))


if __name__ == "__main__":
    main(*record.arguments())
