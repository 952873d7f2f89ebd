"""Scene -> Image through Mitsuba: rungs of light transport, two samplings, variance by independent batches, a cache."""

import hashlib
from collections.abc import Mapping

import msgspec
import numpy as np

from raytwin.errors import InputError, check_one_of
from raytwin.images.image import Image
from raytwin.progress import Progress, silent
from raytwin.rungs import MOST_SAMPLES, RUNGS, SAMPLINGS
from raytwin.scene import Scene, to_camera_frame
from raytwin.scene.lens import check_lens, without_ray
from raytwin.scene.toml_json import plain
from raytwin.twin import render_cache
from raytwin.twin.backend import activate, made_with
from raytwin.twin.twin_scene import read_textures

BATCHES = 16
"""Independent renders behind a variance: its relative standard error is √(2/15)."""
TWIN = "8"
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
    - `lambert`: ρ/π E max(0, n·l) + ρ Ls; of a map, Ls is E(n)/π by harmonics (`twin_light.open_sky`); with a highlight
      (`phong`) π f stands for the first ρ, ρ + specular for the second;
    - `shadow`: the first term times the sun's visibility (Mitsuba's shadow test);
    - `sky`: the second term with the sky's occlusion as well (Mitsuba's `path` at depth 2);
    - `path`: interreflection to `max_depth` (default 8), counted as Mitsuba does: 2 is direct light alone.

    Behind all objects the camera sees Ls. In `sky` and `path` a shadow ray adds the sun at the first hit, and Mitsuba's
    `path` the rest from the first bounce on: the same expectation as that of `path` from the eye, with less noise.

    `sampling`: `center` sends every ray through the pixel's centre; `area` spreads them evenly over the pixel (a box
    filter). `surface`, `lambert` and `shadow` at `center` have no noise: one ray, `variance` None, `samples` 1. All
    else has noise: `samples` rays per pixel, drawn from `seed`, in equal independent `batches` (default: at most 16),
    whose spread gives the mean's `variance`, None for one batch. Where `samples` is no multiple of `batches`, there are
    some more, and the image says how many.

    `textures`: albedo (h, w) or (h, w, 3), linear, by a plane's object id; row 0 at the +half_v side, column 0 at
    -half_u. `cache` stores slow renders on disk; `progress` counts hundredths. `variant`: see `activate`.

    Raises InputError (camera.dist where the distortion cannot be undone, samples, ...) and MachineError.
    """
    plan = Plan(rung, sampling, samples, seed, batches, max_depth).settled(scene)
    textures = read_textures(textures)
    about = _about(scene, plan, textures, activate(variant).variant)
    return render_cache.cached(about, cache, lambda: _rendered(scene, textures, plan, progress))


def provenance(scene: Scene, rung: str, sampling: str, samples: int, seed: int) -> dict[str, str]:
    """Everything that decides the pixels of `render` with the same arguments, as text: for an EXR's header."""
    return _about(scene, Plan(rung, sampling, samples, seed).settled(scene), {}, activate().variant)


class Plan(msgspec.Struct, frozen=True):
    """`render`'s arguments of these names."""

    rung: str
    sampling: str
    samples: int
    seed: int
    batches: int | None = None
    depth: int | None = None

    def settled(self, scene: Scene) -> "Plan":
        """Return it checked, and with its defaults filled in."""
        check_one_of("rung", self.rung, RUNGS)
        check_one_of("sampling", self.sampling, SAMPLINGS)
        check_lens(scene.camera)
        to_camera_frame(scene, "twin")  # for its checks
        if not 1 <= self.samples <= MOST_SAMPLES:
            raise InputError("samples", f"a whole number from 1 to {MOST_SAMPLES}", self.samples)
        if self.seed < 0:
            raise InputError("seed", "a whole number, at least 0", self.seed)
        if self.batches is not None and not 1 <= self.batches <= self.samples:
            raise InputError("batches", f"a whole number from 1 to samples ({self.samples})", self.batches)
        if self.depth is not None and self.depth < 2:
            raise InputError("max_depth", "at least 2 (light, surface, eye)", self.depth)
        rung = RUNGS[self.rung]
        if not rung.sampled(self.sampling):
            return Plan(self.rung, self.sampling, samples=1, seed=0, batches=1)
        each = -(-self.samples // (self.batches or min(self.samples, BATCHES)))
        batches = self.batches or -(-self.samples // each)
        depth = rung.depth and (self.depth or rung.depth)
        return Plan(self.rung, self.sampling, each * batches, self.seed, batches, depth)


def _about(scene: Scene, plan: Plan, textures: Mapping[int, np.ndarray], variant: str | None) -> dict[str, str]:
    seen = (scene.camera, scene.spheres, scene.planes, scene.sun, scene.sky)
    content = hashlib.sha256(msgspec.json.encode(seen, enc_hook=plain))
    for i, texture in textures.items():
        content.update(f"{i} {texture.shape}".encode() + texture.tobytes())
    about = made_with(TWIN, variant) | {"scene": content.hexdigest()}
    return about | {name: str(value) for name, value in msgspec.structs.asdict(plan).items()}


def _rendered(scene: Scene, textures: Mapping[int, np.ndarray], plan: Plan, progress: Progress) -> Image:
    from raytwin.twin.twin_light import TwinLight  # Mitsuba's classes exist once a variant is set

    return TwinLight(scene, textures, plan.depth).image(plan, progress).blacken(without_ray(scene.camera))
