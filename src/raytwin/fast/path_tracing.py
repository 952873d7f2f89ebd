"""Path tracing over the whole frame: mean, variance, and the parts that the light is made of."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from raytwin.array_types import Int
from raytwin.fast.boxes import trim_boxes
from raytwin.fast.engine import ENGINES, canvas, constant, flush, pixel_numbers, store
from raytwin.fast.frame import EyeScene, background, draw, pieces
from raytwin.fast.sampling import BATCHES, sobol_pair
from raytwin.images.image import Image, Surface
from raytwin.rungs import RUNGS
from raytwin.scene import Scene
from raytwin.scene.lens import without_ray
from raytwin.tracer.arrays import Vec, plus, repeat, select
from raytwin.tracer.hit import Hit, Stages, World
from raytwin.tracer.lights import ConstantSky, Lighting, sky_visibility
from raytwin.tracer.path import Draw, bounce, packed, radiance_along_path, unpacked
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

MAX_OBJECTS_IN_CLOSED_FORM = 16
"""Objects up to which the sky's visibility is computed in closed form: it tests all pairs at every pixel."""


def walk(
    scene: Scene,
    rung: str = "path",
    engine: str = "numpy64",
    *,
    sampling: str = "area",
    samples: int = 16,
    seed: int = 0,
    depth: int | None = None,
    side: float = 1.0,
    surface: bool = True,
    stages: Stages = STAGES,
) -> Image:
    """Return the radiance of a path-traced rung: mean and variance over the pixels' `area`, or at the `center`.

    `depth` counts surfaces as Mitsuba does and is the rung's own where not given. `side` of the area, in pixels, about
    their centres. `surface`: also what the rays through the pixels' centres meet first.
    """
    deep, side = depth or RUNGS[rung].depth or 2, side if sampling == "area" else 0.0
    view = EyeScene(scene, ENGINES[engine], stages)
    surfaces = constant(view.engine, deep)
    closed = (
        deep == 2
        and not side
        and len(scene.objects) <= MAX_OBJECTS_IN_CLOSED_FORM
        and not scene.environment
        and not scene.glossy
    )

    def whole(world: World, hit: Hit) -> Callable[[Draw], Sequence[Vec]]:
        known, light = _closed_form_sky(view, hit) if closed else (None, view.light)

        def sample(numbers: Draw) -> Sequence[Vec]:
            L = radiance_along_path(hit, light, view.everywhere, numbers, surfaces)
            return [_or_sky(hit, plus(known, L) if known else L, view.light)]

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
    stages: Stages = STAGES,
) -> dict[str, Image]:
    """Return global illumination over the pixels' area as its parts, `part_names(bounces)`, from the same samples.

    `side` of the area, in pixels, about their centres.
    """
    view, names = EyeScene(scene, ENGINES[engine], stages), part_names(bounces)
    surfaces = constant(view.engine, depth)

    def parts(world: World, hit: Hit) -> Callable[[Draw], Sequence[Vec]]:
        open_, lit = (f(hit, view.light, world, view.camera) for f in (lambert_radiance, shadow_radiance))

        def sample(numbers: Draw) -> Sequence[Vec]:
            direct, *later = radiance_by_surfaces(hit, view, numbers, surfaces, bounces + 1)
            hidden = (tuple(x - y for x, y in zip(a, b, strict=True)) for a, b in ((lit, open_), (direct, lit)))
            shadow, occlusion = (select(hit.ids >= 0, L, NOTHING) for L in hidden)
            return [_or_sky(hit, open_, view.light), shadow, occlusion, *later]

        return sample

    start = [background(scene), *(np.zeros((*scene.camera.image_size[::-1], 3), np.float32) for _ in names[1:])]
    found = _sampled(view, scene, parts, start, side, samples, seed)
    return {name: image.blacken(without_ray(scene.camera)) for name, image in zip(names, found, strict=True)}


def radiance_by_surfaces(hit: Hit, view: EyeScene, draw: Draw, depth: Any, parts: int) -> tuple[Vec, ...]:
    """`radiance_along_path` by the number of surfaces that the light met: [1, 2, ...], the last of `parts` and more."""

    def step(k: Any, *state: Any) -> tuple[Any, ...]:
        direct, there, onto = bounce(k, unpacked(state[:-1]), view.light, view.everywhere, draw)
        now = [*(k == part for part in range(parts - 1)), k >= parts - 1]
        found = zip(now, state[-1], strict=True)
        return *packed(there, onto), tuple(plus(total, select(this, direct, NOTHING)) for this, total in found)

    start = *packed(hit, (1.0, 1.0, 1.0)), ((0 * hit.point[0],) * 3,) * parts
    found: tuple[Vec, ...] = repeat(depth - 1, step, start, lambda *state: state[6] >= 0)[-1]
    return found


def _closed_form_sky(view: EyeScene, hit: Hit) -> tuple[Vec, Lighting]:
    """The sky's light at the first surface where `sky_visibility` knows it, and light whose sky is dark there."""

    def fold(state: Any, body: Callable[..., Any]) -> Any:
        return view.one_by_one.fold(None, state, lambda state, _, index, thing: body(state, index, thing))

    left, known = sky_visibility(hit, fold)
    sky, albedo = view.light.sky.radiance(hit.d), select(hit.ids >= 0, hit.albedo, NOTHING)
    r, g, b = (select(known, rho * left * L, 0.0) for rho, L in zip(albedo, sky, strict=True))
    return (r, g, b), view.light._replace(sky=ConstantSky(select(known, NOTHING, sky)))


def _or_sky(hit: Hit, colour: Vec, light: Lighting) -> Vec:
    r, g, b = select(hit.ids >= 0, colour, light.sky.radiance(hit.d))
    return r, g, b


class Moments(NamedTuple):
    """Of some batches' means: the `count` of samples, and for each number of the colours its mean and sum of squares
    about it, weighed by the batches' samples."""

    count: Any
    mean: tuple[Any, ...]
    scatter: tuple[Any, ...]

    def with_batch(self, means: Sequence[Any], count: Any) -> "Moments":
        """Chan, Golub and LeVeque's update: no difference of large numbers."""
        after = self.count + count
        steps = [m - x for m, x in zip(means, self.mean, strict=True)]
        mean = (x + s * (count / after) for x, s in zip(self.mean, steps, strict=True))
        scatter = (x + s * s * (count * self.count / after) for x, s in zip(self.scatter, steps, strict=True))
        return Moments(after, tuple(mean), tuple(scatter))


def _sampled(
    view: EyeScene, scene: Scene, integrand: Integrand, start: list[np.ndarray], side: float, samples: int, seed: int
) -> list[Image]:
    """The mean of each of the integrand's colours, and that mean's variance; `start` is where no object is seen."""
    how, batches = view.engine, min(BATCHES, samples)
    number, size, more, key = (
        constant(how, n) for n in (batches, samples // batches, samples % batches, seed & 0xFFFFFFFF)
    )
    variances = [np.zeros_like(mean) for mean in start]
    boxes = area_boxes(scene)
    if side and scene.environment:  # which differs within a pixel: all of them are sampled
        boxes[:] = (0, 0, *scene.camera.image_size)
    queued = [(out, canvas(how, out)) for out in (*start, *variances)]

    def moments(u: Any, v: Any, pixel: Any, world: World) -> Moments:
        def place_at(u: Any, v: Any) -> Callable[[Draw], Sequence[Vec]]:
            return integrand(world, first_hit(world, EYE, view.ray(u, v)))

        centre = None if side else place_at(u, v)  # what all samples share is found once

        def sample(batch: Any, place: Any, *sums: Any) -> tuple[Any, ...]:
            numbers = partial(sobol_pair, u, pixel, batch, place, key)
            if (here := centre) is None:
                a, b = numbers(0)
                here = place_at(u + side * (a - 0.5), v + side * (b - 0.5))
            return plus(sums, sum(here(numbers), ()))

        def with_batch(batch: Any, *state: Any) -> Moments:
            count = size + select(batch < more, 1, 0)
            totals = repeat(count, partial(sample, batch), zero)
            return Moments(*state).with_batch([total / count for total in totals], count)

        zero = (0 * u,) * (3 * len(start))
        return Moments(*repeat(number, with_batch, (0 * u, zero, zero)))

    with np.errstate(all="ignore"):
        for u, v, place, world in pieces(view, boxes):
            u, v = (u + 0 * v, v + 0 * u)
            _, mean, scatter = moments(u, v, pixel_numbers(how, place, scene.camera.width), world)
            scale = 1 / (samples * max(batches - 1, 1))
            colours = (*mean, *(x * scale for x in scatter))
            for i, (_, targets) in enumerate(queued):
                store(how, targets, place, colours[3 * i : 3 * i + 3], u == u)
    flush(how, queued)
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
