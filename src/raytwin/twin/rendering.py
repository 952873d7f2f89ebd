"""Scene -> Image through Mitsuba: rungs of light transport, two samplings, variance by independent batches, a cache."""

import hashlib
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any

import msgspec
import numpy as np

from raytwin import files
from raytwin.errors import InputError
from raytwin.image import Image, Surface
from raytwin.progress import Progress, silent
from raytwin.rungs import MOST_SAMPLES, RUNGS, SAMPLINGS
from raytwin.scene import Scene, to_camera_frame
from raytwin.scene.lens import without_ray
from raytwin.twin import render_cache
from raytwin.twin.backend import activate, made_with
from raytwin.twin.batches import Batches
from raytwin.twin.direct_light import albedos, first_light
from raytwin.twin.outlines import Seen, rays, refine, retrace_edges
from raytwin.twin.rays import lens_of
from raytwin.twin.twin_scene import check_textures

BATCHES = 16
"""Independent renders behind a variance: its relative standard error is √(2/15)."""
TWIN = "5"
"""The twin's own version, part of every cache key: raise it when a change moves a pixel."""


def render(
    scene: Scene,
    rung: str = "shadow",
    *,
    sampling: str = "center",
    samples: int = 16,
    seed: int = 0,
    batches: int | None = None,
    max_depth: int | None = None,
    textures: Mapping[int, np.ndarray] | None = None,
    cache: bool = True,
    variant: str | None = None,
    progress: Progress = silent,
) -> Image:
    """Render `scene` with Mitsuba: an Image of the camera's size, with `surface` filled in.

    Radiance by rung, with albedo ρ, sun irradiance E from direction l, sky radiance Ls, n on the eye's side:

    - `surface`: (n + 1) / 2 as a colour, 0 at the background;
    - `lambert`: ρ/π E max(0, n·l) + ρ Ls; of a map, Ls is E(n)/π by harmonics (`sky.harmonics`); with a highlight
      (`phong`) π f stands for the first ρ, ρ + specular for the second;
    - `shadow`: the first term times the sun's visibility (Mitsuba's shadow test);
    - `sky`: the second term with the sky's occlusion as well (Mitsuba's `path` at depth 2);
    - `path`: interreflection to `max_depth` (default 8), counted as Mitsuba does: 2 is direct light alone.

    Behind all objects the camera sees Ls. In `sky` and `path` a shadow ray adds the sun at the first hit, as in
    `shadow`; Mitsuba's `path` adds the rest from the first bounce on. The expectation equals that of `path` from the
    eye, with less noise and exact shadow edges. There is no Russian roulette.

    `sampling`: `center` sends every ray through the pixel's centre; `area` spreads them evenly over the pixel (a box
    filter). `surface`, `lambert` and `shadow` at `center` have no noise: one ray, `variance` None, `samples` 1. All
    else has noise: `samples` rays per pixel, drawn from `seed`, in independent `batches` (default: 16, or one per
    sample if there are fewer); `variance` is that of the mean, from the batches' spread, and None for `batches=1`.

    `textures`: albedo (h, w) or (h, w, 3), linear, by a plane's object id; row 0 at the +half_v side, column 0 at
    -half_u. `cache` stores slow renders on disk; `progress` counts hundredths. `variant`: see `activate`.

    Raises InputError (camera.dist where the distortion cannot be undone, samples, textures, ...) and MachineError.
    """
    plan = _plan(scene, rung, sampling, samples, seed, batches, max_depth)
    to_camera_frame(scene, "twin")  # for its checks
    textures = check_textures(scene, textures)
    about = _about(scene, plan, textures, activate(variant).variant)

    def make() -> Image:
        renderer = _engine(about["variant"]).Renderer(scene, textures, plan.depth or 0)
        return _rendered(renderer, scene, plan, progress, settled=not textures)

    return render_cache.cached(about, cache, make)


def _rendered(renderer: Any, scene: Scene, plan: "_Plan", progress: Progress, settled: bool) -> Image:
    passes = 1 if plan.exact else 1 + plan.samples

    def say(passes_done: float) -> None:
        progress("twin", round(100 * passes_done / passes), 100)

    seen, mean, albedo = _exact(renderer, scene, plan, say, settled)
    variance: np.ndarray | None = None
    if not plan.exact:
        found, variance = _sampled(renderer, scene, plan, seen, albedo, lambda part: say(1 + part * plan.samples))
        weight = np.ones_like(albedo) if scene.glossy else albedo  # with highlights, a sample has its own
        mean = mean + weight * found if plan.sampling == "center" else found
        if variance is not None and plan.sampling == "center":
            variance = np.square(weight) * variance
    h, w = scene.camera.height, scene.camera.width
    surface = Surface(seen.ids.reshape(h, w), seen.depth.reshape(h, w), seen.normal.reshape(h, w, 3))
    if variance is not None:
        variance = variance.astype(np.float32).reshape(h, w, 3)
    mean = mean.astype(np.float32, copy=False).reshape(h, w, 3)
    image = Image(mean, variance, plan.samples, surface, None if plan.exact else plan.batches)
    return image.blacken(without_ray(scene.camera))


def provenance(
    scene: Scene,
    rung: str = "shadow",
    *,
    textures: Mapping[int, np.ndarray] | None = None,
    variant: str | None = None,
    **options: Any,
) -> dict[str, str]:
    """Everything that decides the pixels of `render` with the same arguments, as text: for an EXR's header."""
    plan = _plan(scene, rung, **options)
    return _about(scene, plan, check_textures(scene, textures), activate(variant).variant)


class _Plan(msgspec.Struct, frozen=True):
    """`render`'s arguments, checked and with their defaults filled in."""

    rung: str
    sampling: str
    samples: int
    seed: int
    batches: int
    depth: int | None

    @property
    def exact(self) -> bool:
        """Nothing is random: one ray a pixel, through its centre."""
        return not RUNGS[self.rung].lit or (self.sampling == "center" and not RUNGS[self.rung].noisy)


def _plan(
    scene: Scene,
    rung: str,
    sampling: str = "center",
    samples: int = 16,
    seed: int = 0,
    batches: int | None = None,
    max_depth: int | None = None,
) -> _Plan:
    for where, name, known in (("rung", rung, tuple(RUNGS)), ("sampling", sampling, SAMPLINGS)):
        if name not in known:
            raise InputError(where, " or ".join(known), name)
    files.check_camera(scene.camera, "camera.")
    lens_of(scene.camera)  # raises where the distortion cannot be undone
    if not 1 <= samples <= MOST_SAMPLES:
        raise InputError("samples", f"a whole number from 1 to {MOST_SAMPLES}", samples)
    if seed < 0:
        raise InputError("seed", "a whole number, at least 0", seed)
    if batches is None:
        batches = min(samples, BATCHES)
    elif not 1 <= batches <= samples:
        raise InputError("batches", f"a whole number from 1 to samples ({samples})", batches)
    if max_depth is not None and max_depth < 2:
        raise InputError("max_depth", "at least 2 (light, surface, eye)", max_depth)
    depth = RUNGS[rung].depth and (max_depth or RUNGS[rung].depth)
    plan = _Plan(rung, sampling, samples, seed, batches, depth)
    return msgspec.structs.replace(plan, samples=1, seed=0, batches=1) if plan.exact else plan


def _about(scene: Scene, plan: _Plan, textures: Mapping[int, np.ndarray], variant: str) -> dict[str, str]:
    seen = (scene.camera, scene.objects, scene.lights)
    content = hashlib.sha256(msgspec.json.encode(seen, enc_hook=files.plain))
    for i, texture in textures.items():
        content.update(f"{i} {texture.shape}".encode() + texture.tobytes())
    about = made_with(TWIN, variant) | {"scene": content.hexdigest()}
    return about | {name: str(value) for name, value in msgspec.structs.asdict(plan).items()}


def _engine(variant: str) -> ModuleType:
    """The engines import Mitsuba, whose classes exist once a variant is set."""
    if variant.startswith("scalar"):
        from raytwin.twin import scalar

        return scalar
    from raytwin.twin import jit

    return jit


def _exact(
    renderer: Any, scene: Scene, plan: _Plan, say: Callable[[float], None], settled: bool
) -> tuple[Seen, np.ndarray, np.ndarray]:
    """Through the pixels' centres, row by row: what is seen, the first light (n, 3), albedo (n, 3), float32.

    `settled`: float64 decides in the pixels in doubt (not where textures are: those are photographs).
    """
    n = scene.camera.width * scene.camera.height
    shadows, sky_at_hit = RUNGS[plan.rung].shadows and plan.sampling == "center", plan.depth is None
    seen = Seen(np.empty(n, np.int32), np.empty(n, np.float32), np.empty((n, 3), np.float32), np.empty(n, np.int32))
    colour, albedo = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32)
    for a in range(0, n, renderer.lanes):
        b = min(n, a + renderer.lanes)
        found = renderer.exact(a, b - a, shadows, sky_at_hit)
        for whole, part in zip((colour, *seen, albedo), found, strict=False):  # albedo where light goes on, else none
            whole[a:b] = part
        say(b / n)
    if settled:
        exact = len(renderer.large) == len(scene.objects)
        again = np.zeros(0, int) if exact else np.union1d(refine(scene, seen), retrace_edges(scene, seen, shadows))
        if scene.environment:  # a map's own detail is finer than float32's directions
            again = np.union1d(again, np.flatnonzero(seen.ids < 0))
        ids, _, normal, blocker = (part[again] for part in seen)
        albedo[again] = albedos(scene)[ids]
        d = rays(scene, again) @ np.asarray(scene.camera.R_cam_board)
        colour[again] = first_light(scene, ids, albedo[again], normal, d, blocker, sky_at_hit)
    if not RUNGS[plan.rung].lit:
        colour = np.where(seen.ids[:, None] < 0, np.float32(0), (seen.normal + 1) / 2)
    return seen, colour, albedo


def _sampled(
    renderer: Any, scene: Scene, plan: _Plan, seen: Seen, albedo: np.ndarray, say: Callable[[float], None]
) -> tuple[np.ndarray, np.ndarray | None]:
    """Mean (n, 3) of all samples and the variance of that mean; of the light that bounces, where the rest is known."""
    n, batches = scene.camera.width * scene.camera.height, Batches(plan.batches, plan.samples)
    mean, spread = np.empty((n, 3)), np.empty((n, 3))
    block = max(1, renderer.lanes // batches.lanes)
    for a in range(0, n, block):
        b = min(n, a + block)
        seed = int(np.random.SeedSequence([plan.seed, a]).generate_state(1)[0])
        if plan.sampling == "area":
            mean[a:b], spread[a:b] = renderer.sampled(a, b - a, batches, seed, RUNGS[plan.rung].shadows)
        else:
            part = Seen(*(column[a:b] for column in seen))
            mean[a:b], spread[a:b] = renderer.bounced(a, b - a, batches, seed, part, albedo[a:b])
        say(b / n)
    return mean, batches.variance(spread)
