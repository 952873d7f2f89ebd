"""Path tracing over the whole frame: mean, variance, and the parts that the light is made of."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from raytwin.array_types import Int
from raytwin.fast.boxes import trim_boxes
from raytwin.fast.engine import ENGINES, Canvas, constant
from raytwin.fast.fast_world import MAX_OBJECTS_WITHOUT_TREE, FastWorld
from raytwin.fast.frame import EyeScene, background, draw, pieces
from raytwin.fast.sampling import BATCHES, sobol_pair
from raytwin.images.image import Image, Surface
from raytwin.rungs import RUNGS
from raytwin.scene import Scene
from raytwin.scene.lens import without_ray
from raytwin.tracer.arrays import Vec, plus, repeat, select
from raytwin.tracer.hit import Hit, Stages, World
from raytwin.tracer.lights import ConstantSky, Lighting, sky_visibility
from raytwin.tracer.lights.lookup import floor
from raytwin.tracer.path import Draw, radiance_along_path, sum_along_path
from raytwin.tracer.render_image import EYE, STAGES
from raytwin.tracer.shading import lambert_radiance, shadow_radiance
from raytwin.tracer.world import first_hit


def part_names(bounces: int = 3) -> tuple[str, ...]:
    """The parts that sum to global illumination: unhidden sun and sky; what hides the sun, what hides the sky; bounces.

    The last of the `bounces` includes all that follow.
    """
    return ("open", "shadow", "occlusion", *(f"bounce {k}" for k in range(1, bounces)), f"bounce {bounces}+")


PARTS = part_names()
NOTHING = (0.0, 0.0, 0.0)

Integrand = Callable[[World, Hit], Callable[[Draw], Sequence[Vec]]]
"""(world, hit) -> random numbers -> the colours of one sample there."""


def walk(
    scene: Scene,
    rung: str = "path",
    engine: str = "numpy64",
    *,
    sampling: str = "area",
    samples: int = 16,
    seed: int = 0,
    depth: int | None = None,
    surface: bool = True,
    stages: Stages = STAGES,
) -> Image:
    """Return the radiance of a path-traced rung: mean and variance over the pixels' `area`, or at the `center`.

    `depth` counts surfaces as Mitsuba does and is the rung's own where not given. `surface`: also what the rays through
    the pixels' centres meet first.
    """
    deep, side = depth or RUNGS[rung].depth or 2, 1.0 if sampling == "area" else 0.0
    view = EyeScene(scene, ENGINES[engine], stages)
    surfaces = constant(view.engine, deep)
    closed = deep == 2 and not side and not scene.environment and not scene.glossy
    closed = closed and len(scene.objects) <= MAX_OBJECTS_WITHOUT_TREE  # it tests all pairs at every pixel

    def whole(world: World, hit: Hit) -> Callable[[Draw], Sequence[Vec]]:
        known, light = _closed_form_sky(view, hit) if closed else (NOTHING, view.light)

        def sample(numbers: Draw) -> Sequence[Vec]:
            L = radiance_along_path(hit, light, world, numbers, surfaces)
            return [_or_sky(hit, plus(known, L), view.light)]

        return sample

    (image,) = _sampled(view, scene, whole, [background(scene, rung)], side, samples, seed)
    if surface:
        image = replace(image, surface=Surface.empty(*scene.camera.image_size))
        draw(scene, background(scene), "surface", engine, surface=image.surface, stages=stages)
    return image.blacken(without_ray(scene.camera))


def light_parts(
    scene: Scene,
    engine: str = "numpy64",
    *,
    samples: int = 64,
    seed: int = 0,
    depth: int = 8,
    side: float = 1.0,
    bounces: int = 3,
) -> dict[str, Image]:
    """Return global illumination over the pixels' area as its parts, `part_names(bounces)`, from the same samples.

    `side` of the area, in pixels, about their centres.
    """
    view, names = EyeScene(scene, ENGINES[engine]), part_names(bounces)
    surfaces = constant(view.engine, depth)

    def parts(world: World, hit: Hit) -> Callable[[Draw], Sequence[Vec]]:
        open_, lit = (f(hit, view.light, world, view.camera) for f in (lambert_radiance, shadow_radiance))

        def sample(numbers: Draw) -> Sequence[Vec]:
            direct, *later = radiance_by_surfaces(hit, view, world, numbers, surfaces, bounces + 1)
            hidden = (tuple(x - y for x, y in zip(a, b, strict=True)) for a, b in ((lit, open_), (direct, lit)))
            shadow, occlusion = (select(hit.ids >= 0, L, NOTHING) for L in hidden)
            return [_or_sky(hit, open_, view.light), shadow, occlusion, *later]

        return sample

    start = [background(scene), *(np.zeros((*scene.camera.image_size[::-1], 3), np.float32) for _ in names[1:])]
    found = _sampled(view, scene, parts, start, side, samples, seed)
    return {name: image.blacken(without_ray(scene.camera)) for name, image in zip(names, found, strict=True)}


def radiance_by_surfaces(hit: Hit, view: EyeScene, world: World, draw: Draw, depth: Any, parts: int) -> list[Vec]:
    """`radiance_along_path` by the number of surfaces that the light met: [1, 2, ...], the last of `parts` and more."""

    def add(k: Any, totals: Any, direct: Vec) -> Any:
        now = [*(k == part for part in range(parts - 1)), k >= parts - 1]
        return tuple(plus(total, select(this, direct, NOTHING)) for this, total in zip(now, totals, strict=True))

    nothing = ((0 * hit.point[0],) * 3,) * parts
    return [*sum_along_path(hit, view.light, world, draw, depth, nothing, add)]


def _closed_form_sky(view: EyeScene, hit: Hit) -> tuple[Vec, Lighting]:
    """The sky's light at the first surface where `sky_visibility` knows it, and light whose sky is dark there."""
    left, known = sky_visibility(hit, view.objects.objects)
    sky, albedo = view.light.sky.radiance(hit.d), select(hit.ids >= 0, hit.albedo, NOTHING)
    r, g, b = (select(known, rho * left * L, 0.0) for rho, L in zip(albedo, sky, strict=True))
    return (r, g, b), view.light._replace(sky=ConstantSky(select(known, NOTHING, sky)))


def _or_sky(hit: Hit, colour: Vec, light: Lighting) -> Vec:
    r, g, b = select(hit.ids >= 0, colour, light.sky.radiance(hit.d))
    return r, g, b


def _sampled(
    view: EyeScene, scene: Scene, integrand: Integrand, start: list[np.ndarray], side: float, samples: int, seed: int
) -> list[Image]:
    """The mean of each of the integrand's colours, and that mean's variance; `start` is where no object is seen."""
    batches = min(BATCHES, samples)
    number, size, more, key = (
        constant(view.engine, n) for n in (batches, samples // batches, samples % batches, seed & 0xFFFFFFFF)
    )
    boxes = area_boxes(scene)
    if side and scene.environment:  # which differs within a pixel: all of them are sampled
        boxes[:] = (0, 0, *scene.camera.image_size)
    variances = [np.zeros_like(mean) for mean in start]
    canvas = Canvas(view.engine, [*start, *variances])

    def moments(u: Any, v: Any, world: FastWorld) -> tuple[Any, ...]:
        """For each number of the colours the mean, and the batches' sum of squares about it, by their samples."""
        pixel = floor(v) * scene.camera.width + floor(u)

        def place_at(u: Any, v: Any) -> Callable[[Draw], Sequence[Vec]]:
            return integrand(world, first_hit(world, EYE, view.ray(u, v)))

        centre = None if side else place_at(u, v)  # what all samples share is found once

        def sample(batch: Any, place: Any, *sums: Any) -> tuple[Any, ...]:
            numbers = partial(sobol_pair, u, pixel, batch, place, key)
            if (here := centre) is None:
                a, b = numbers(0)
                here = place_at(u + side * (a - 0.5), v + side * (b - 0.5))
            return plus(sums, sum(here(numbers), ()))

        def with_batch(batch: Any, count: Any, mean: Any, scatter: Any) -> tuple[Any, ...]:
            # Chan, Golub and LeVeque's update: no difference of large numbers.
            added = size + select(batch < more, 1, 0)
            after = count + added
            steps = [x / added - m for x, m in zip(repeat(added, partial(sample, batch), zero), mean, strict=True)]
            mean = plus(mean, tuple(s * (added / after) for s in steps))
            return after, mean, plus(scatter, tuple(s * s * (added * count / after) for s in steps))

        zero = (0 * u,) * (3 * len(start))
        return repeat(number, with_batch, (0 * u, zero, zero))[1:]

    with np.errstate(all="ignore"):
        for u, v, place, world in pieces(view, boxes):
            u, v = (u + 0 * v, v + 0 * u)
            mean, scatter = moments(u, v, world)
            scale = 1 / (samples * max(batches - 1, 1))
            numbers = *mean, *(x * scale for x in scatter)
            canvas.store(place, [numbers[i : i + 3] for i in range(0, len(numbers), 3)], u == u)
    canvas.flush()
    found = zip(start, variances, strict=True)
    return [Image(mean, variance if batches > 1 else None, samples, batches=batches) for mean, variance in found]


def area_boxes(scene: Scene) -> Int[np.ndarray, "n 4"]:
    """Which pixels can see each object in any part of their area: the boxes of `trim_boxes`, grown by a pixel."""
    camera = scene.camera
    w, h = camera.image_size
    boxes = trim_boxes(scene.objects, camera.grid(-1, -1, size=(w + 2, h + 2)))
    empty = np.asarray((boxes[:, 2:] <= boxes[:, :2]).any(axis=1))
    low, high = np.maximum(boxes[:, :2] - 2, 0), np.minimum(boxes[:, 2:], (w, h))
    return np.where(empty[:, None], 0, np.concatenate([low, high], axis=1))
