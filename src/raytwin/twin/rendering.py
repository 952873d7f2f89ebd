"""Scene -> Image through Mitsuba: rungs of light transport, two samplings, variance by independent batches, a cache."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from raytwin.errors import InputError
from raytwin.images.image import Image, Surface
from raytwin.progress import Progress, silent
from raytwin.rungs import MOST_SAMPLES, RUNGS, SAMPLINGS, Rung
from raytwin.scene import Scene, to_camera_frame
from raytwin.scene.lens import without_ray
from raytwin.scene.scene_files import check_camera
from raytwin.scene.toml_json import plain
from raytwin.twin import render_cache
from raytwin.twin.backend import activate, made_with
from raytwin.twin.rays import lens_of
from raytwin.twin.twin_scene import check_textures

BATCHES = 16
"""Independent renders behind a variance: its relative standard error is √(2/15)."""
TWIN = "6"
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
    - `lambert`: ρ/π E max(0, n·l) + ρ Ls; of a map, Ls is E(n)/π by harmonics (`levels.open_sky`); with a highlight
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

    return render_cache.cached(about, cache, lambda: _rendered(scene, textures, plan, progress))


def _rendered(scene: Scene, textures: Mapping[int, np.ndarray], plan: "_Plan", progress: Progress) -> Image:
    from raytwin.twin.twin_light import TwinLight  # Mitsuba's classes exist once a variant is set

    twin, rung = TwinLight(scene, textures, plan.depth), RUNGS[plan.rung]
    passes = 1 if plan.exact else 1 + plan.samples

    def say(passes_done: float) -> None:
        progress("twin", round(100 * passes_done / passes), 100)

    shape = scene.camera.height, scene.camera.width
    surface, mean = _centers(twin, shape, rung if rung.lit and plan.sampling == "center" else None, say)
    variance = third = None
    if not rung.lit:
        mean = np.where(surface.mask[..., None], (surface.normal + 1) / 2, np.float32(0))
    if not plan.exact:
        found, variance, third = _sampled(twin, shape, rung, plan, lambda part: say(1 + part * plan.samples))
        mean = (mean + found if plan.sampling == "center" else found).astype(np.float32)
    image = Image(mean, variance, plan.samples, surface, None if plan.exact else plan.batches, third=third)
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
    check_camera(scene.camera, "camera.")
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


def _about(scene: Scene, plan: _Plan, textures: Mapping[int, np.ndarray], variant: str | None) -> dict[str, str]:
    seen = (scene.camera, scene.spheres, scene.planes, scene.sun, scene.sky)
    content = hashlib.sha256(msgspec.json.encode(seen, enc_hook=plain))
    for i, texture in textures.items():
        content.update(f"{i} {texture.shape}".encode() + texture.tobytes())
    about = made_with(TWIN, variant) | {"scene": content.hexdigest()}
    return about | {name: str(value) for name, value in msgspec.structs.asdict(plan).items()}


def _centers(
    twin: Any, shape: tuple[int, int], rung: Rung | None, say: Callable[[float], None]
) -> tuple[Surface, np.ndarray]:
    """What the pixels' centres show, and the light without noise there (H, W, 3), 0 without a rung."""
    import drjit as dr
    import mitsuba as mi

    from raytwin.twin.twin_light import LANES

    n = shape[0] * shape[1]
    ids, depth, normal = np.empty(n, np.int32), np.empty(n, np.float32), np.empty((n, 3), np.float32)
    colour = np.zeros((n, 3), np.float32)
    for a in range(0, n, LANES):
        b = min(n, a + LANES)
        seen = twin.hit_of(dr.arange(mi.UInt32, b - a) + dr.opaque(mi.UInt32, a))
        found = *twin.surface(seen), twin.unsampled(rung, seen) if rung else mi.Color3f(0)
        dr.eval(found)
        ids[a:b], depth[a:b] = found[0].numpy(), found[1].numpy()
        normal[a:b], colour[a:b] = found[2].numpy().T, found[3].numpy().T
        say(b / n)
    return Surface(ids.reshape(shape), depth.reshape(shape), normal.reshape(*shape, 3)), colour.reshape(*shape, 3)


def _sampled(
    twin: Any, shape: tuple[int, int], rung: Rung, plan: _Plan, say: Callable[[float], None]
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Mean (H, W, 3) of all samples, that mean's variance and third moment; at `center` of the light that bounces."""
    import drjit as dr
    import mitsuba as mi

    from raytwin.twin.twin_light import LANES

    n, double = shape[0] * shape[1], dr.float64_array_t(mi.Float)
    # Where the batches do not share the samples evenly, the first `more` have one more.
    each, more = divmod(plan.samples, plan.batches)
    kinds = [(size, number) for size, number in ((each + 1, more), (each, plan.batches - more)) if number]
    mean, variance, third = (np.empty((n, 3), np.float32) for _ in range(3))
    block = max(1, LANES // max(size * number for size, number in kinds))
    for a in range(0, n, block):
        b, parts = min(n, a + block), []
        for size, number in kinds:
            lanes, seed = (b - a) * size * number, np.random.SeedSequence([plan.seed, a, size])
            sampler = mi.load_dict({"type": "independent"})
            sampler.seed(dr.opaque(mi.UInt32, int(seed.generate_state(1)[0])), lanes)
            pixel = dr.arange(mi.UInt32, lanes) // dr.opaque(mi.UInt32, size * number) + dr.opaque(mi.UInt32, a)
            if plan.sampling == "area":
                seen = twin.hit_of(pixel, *(sampler.next_2d() - 0.5))
                colour = twin.unsampled(rung, seen) + (twin.bounced(seen, sampler) if plan.depth else 0)
            else:
                colour = twin.bounced(twin.hit_of(pixel), sampler)
            dr.eval(colour)  # all channels in one kernel: block_sum would run it once for each
            parts.append([dr.block_sum(double(c), size) / size for c in colour])
        for channel in range(3):
            found = pooled([part[channel] for part in parts], kinds)
            mean[a:b, channel], variance[a:b, channel], third[a:b, channel] = (x.numpy() for x in found)
        say(b / n)
    made = (x.reshape(*shape, 3) for x in (mean, variance, third))
    return tuple(x if plan.batches > k else None for k, x in enumerate(made))  # type: ignore[return-value]


def pooled(parts: Sequence[Any], kinds: Sequence[tuple[int, int]]) -> tuple[Any, Any, Any]:
    """The mean of all samples, its variance and its third moment, for n pixels; 0 from too few batches.

    `kinds`: how many samples a batch has, and how many such batches. `parts`: of each kind the means of its batches,
    pixel by pixel, a float64 array of Dr.Jit. With sizes k, means m and the mean of all M, Σ k (m - M)² is (number of
    batches - 1) times the variance of one sample, also where sizes differ. See ImagePool for the third moment.
    """
    import drjit as dr

    samples, batches = sum(k * n for k, n in kinds), sum(n for _, n in kinds)
    mean = sum(k * dr.block_sum(part, n) for part, (k, n) in zip(parts, kinds, strict=True)) / samples
    dr.eval(mean)
    spread, cubes = 0.0, 0.0
    for part, (k, n) in zip(parts, kinds, strict=True):
        step = part - dr.repeat(mean, n)
        spread += k * dr.block_sum(dr.square(step), n)
        cubes += k * k * dr.block_sum(dr.square(step) * step, n)
    third = cubes * (batches / (max(1, (batches - 1) * (batches - 2)) * samples**2))
    return mean, spread / (max(1, batches - 1) * samples), third
