"""Path tracing over the whole frame: mean, variance, and the parts that the light is made of."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from raytwin.array_types import Int
from raytwin.arrays import Vec, repeat, select
from raytwin.image import Image, Surface
from raytwin.lights import ConstantSky, Lighting, sky_visibility
from raytwin.rungs import RUNGS
from raytwin.scene import Scene
from raytwin.scene.lens import without_ray
from raytwin.speed.boxes import trim_boxes
from raytwin.speed.engine import ENGINES, canvas, constant, flush, pixel_numbers, store
from raytwin.speed.frame import EyeScene, background, draw, kernel, tiles
from raytwin.speed.sampling import BATCHES, sobol_pair
from raytwin.tracer.hit import Hit, Stages, World
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

Integrand = Callable[[EyeScene, World, Hit], Callable[[Draw], list[Vec]]]
"""(scene, world, hit) -> random numbers -> the colours of one sample there."""

NOTHING = (0.0, 0.0, 0.0)

FEW = 16
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
    surfaces = constant(ENGINES[engine], deep)
    closed = deep == 2 and not side and len(scene.objects) <= FEW and not scene.environment and not scene.glossy

    def whole(view: EyeScene, world: World, hit: Hit) -> Callable[[Draw], list[Vec]]:
        known, light = _closed_form_sky(view, hit) if closed else (NOTHING, view.light)

        def sample(numbers: Draw) -> list[Vec]:
            L = radiance_along_path(hit, light, view.everywhere, numbers, surfaces)
            return [_or_sky(hit, tuple(a + b for a, b in zip(known, L, strict=True)) if closed else L, view.light)]

        return sample

    ((mean, variance),) = _sampled(scene, whole, [background(scene, rung)], engine, side, samples, seed, stages)
    seen = Surface.empty(*scene.camera.image_size) if surface else None
    if seen is not None:
        draw(scene, background(scene), "surface", engine, surface=seen, stages=stages)
    image = Image(mean, variance, samples, seen, min(BATCHES, samples))
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
    surfaces = constant(ENGINES[engine], depth)

    def parts(view: EyeScene, world: World, hit: Hit) -> Callable[[Draw], list[Vec]]:
        open_, lit = (f(hit, view.light, world, view.camera) for f in (lambert_radiance, shadow_radiance))

        def sample(numbers: Draw) -> list[Vec]:
            direct, *later = radiance_by_surfaces(hit, view, numbers, surfaces, bounces + 1)
            seen, changes = hit.ids >= 0, ((lit, open_), (direct, lit))
            shadow, occlusion = (tuple(select(seen, x - y, 0.0) for x, y in zip(a, b, strict=True)) for a, b in changes)
            return [_or_sky(hit, open_, view.light), shadow, occlusion, *later]

        return sample

    names = part_names(bounces)
    start = [background(scene), *(np.zeros((*scene.camera.image_size[::-1], 3), np.float32) for _ in names[1:])]
    found = _sampled(scene, parts, start, engine, side, samples, seed, stages)
    return {
        name: Image(mean, variance, samples, batches=min(BATCHES, samples)).blacken(without_ray(scene.camera))
        for name, (mean, variance) in zip(names, found, strict=True)
    }


def radiance_by_surfaces(hit: Hit, view: EyeScene, draw: Draw, depth: Any, parts: int) -> list[Vec]:
    """`radiance_along_path` by the number of surfaces that the light met: [1, 2, ...], the last of `parts` and more."""
    values = 3 * parts

    def step(k: Any, *state: Any) -> tuple[Any, ...]:
        direct, there, onto = bounce(k, unpacked(state[:-values]), view.light, view.everywhere, draw)
        now = [k == part for part in range(parts - 1)] + [k >= parts - 1]
        found = (total + select(now[i // 3], direct[i % 3], 0.0) for i, total in enumerate(state[-values:]))
        return (*packed(there, onto), *found)

    start = *packed(hit, (1.0, 1.0, 1.0)), *([0 * hit.point[0]] * values)
    end = repeat(depth - 1, step, start, lambda *state: state[6] >= 0)[-values:]
    return [(end[i], end[i + 1], end[i + 2]) for i in range(0, values, 3)]


def _closed_form_sky(view: EyeScene, hit: Hit) -> tuple[Vec, Lighting]:
    """The sky's light at the first surface where `sky_visibility` knows it, and light whose sky is dark there."""

    def fold(state: Any, body: Callable[..., Any]) -> Any:
        return view.one_by_one.fold(None, state, lambda state, _, index, thing: body(state, index, thing))

    left, known = sky_visibility(hit, fold)
    sky = view.light.sky.radiance(hit.d)
    albedo = (select(hit.ids >= 0, rho, 0.0) for rho in hit.albedo)
    r, g, b = (select(known, rho * left * L, 0.0) for rho, L in zip(albedo, sky, strict=True))
    rest = tuple(select(known, 0.0, L) for L in sky)
    return (r, g, b), view.light._replace(sky=ConstantSky((rest[0], rest[1], rest[2])))


def _or_sky(hit: Hit, colour: Vec, light: Lighting) -> Vec:
    r, g, b = (select(hit.ids >= 0, c, sky) for c, sky in zip(colour, light.sky.radiance(hit.d), strict=True))
    return r, g, b


def _sampled(
    scene: Scene,
    integrand: Integrand,
    start: list[np.ndarray],
    engine: str,
    side: float,
    samples: int,
    seed: int,
    stages: Stages,
) -> list[tuple[np.ndarray, np.ndarray | None]]:
    """For each of the integrand's colours its mean, and that mean's variance; `start` is where no object is seen."""
    how, view = ENGINES[engine], EyeScene(scene, ENGINES[engine], stages)
    batches, values = min(BATCHES, samples), 3 * len(start)
    number, size, more, key = (
        constant(how, n) for n in (batches, samples // batches, samples % batches, seed & 0xFFFFFFFF)
    )
    variances = [np.zeros_like(mean) for mean in start]
    boxes = area_boxes(scene)
    if side and scene.environment:  # which differs within a pixel: all of them are sampled
        boxes[:] = (0, 0, *scene.camera.image_size)
    queued = [(out, canvas(how, out)) for out in (*start, *variances)]

    def estimate(u: Any, v: Any, pixel: Any, world: World) -> tuple[Any, ...]:
        def place_at(u: Any, v: Any) -> Callable[[Draw], list[Vec]]:
            return integrand(view, world, first_hit(world, EYE, view.ray(u, v)))

        centre = None if side else place_at(u, v)  # what all samples share is found once

        def batch(index: Any, *state: Any) -> tuple[Any, ...]:
            mean, scatter, before = state[:values], state[values:-1], state[-1]

            def sample(place: Any, *sums: Any) -> tuple[Any, ...]:
                numbers = partial(sobol_pair, u, pixel, index, place, key)
                if centre is None:
                    a, b = numbers(0)
                    brought = place_at(u + side * (a - 0.5), v + side * (b - 0.5))(numbers)
                else:
                    brought = centre(numbers)
                return tuple(x + y for x, y in zip(sums, sum(brought, ()), strict=True))

            count = size + select(index < more, 1, 0)
            means = [total / count for total in repeat(count, sample, (0 * u,) * values)]
            # Chan, Golub and LeVeque's update: no difference of large numbers.
            after = before + count
            steps = [m - x for m, x in zip(means, mean, strict=True)]
            moved = (x + s * (count / after) for x, s in zip(mean, steps, strict=True))
            return (*moved, *(x + s * s * (count * before / after) for x, s in zip(scatter, steps, strict=True)), after)

        return repeat(number, batch, (0 * u,) * (2 * values + 1))[:-1]

    with np.errstate(all="ignore"):
        for u, v, place, world in (tiles if how.is_numpy else kernel)(view, boxes):
            u, v = (u + 0 * v, v + 0 * u)
            found = estimate(u, v, pixel_numbers(how, place, scene.camera.width), world)
            scale = 1 / (samples * max(batches - 1, 1))
            colours = (*found[:values], *(x * scale for x in found[values:]))
            for i, (_, targets) in enumerate(queued):
                store(how, targets, place, colours[3 * i : 3 * i + 3], u == u)
    flush(how, queued)
    return [(mean, variance if batches > 1 else None) for mean, variance in zip(start, variances, strict=True)]


def area_boxes(scene: Scene) -> Int[np.ndarray, "n 4"]:
    """Which pixels can see each object in any part of their area: the boxes of `trim_boxes`, grown by a pixel."""
    camera = scene.camera
    w, h = camera.image_size
    boxes = trim_boxes(scene.objects, camera.grid(-1, -1, size=(w + 2, h + 2)))
    empty = np.asarray((boxes[:, 2:] <= boxes[:, :2]).any(axis=1))
    low, high = np.maximum(boxes[:, :2] - 2, 0), np.minimum(boxes[:, 2:], (w, h))
    return np.where(empty[:, None], 0, np.concatenate([low, high], axis=1))
