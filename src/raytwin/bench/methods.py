"""Every way to an image that the bench knows: METHODS says what varies, PREPARE how a row becomes a call.

To add a method, add a row; for a new kind of renderer, a function `(method, scene) -> call(seed)` and a row in PREPARE.
What a call does is timed, from the scene's record to a float32 image (H, W, 3); what `prepare` does is not, and that is
said where it matters: Mitsuba's plain scenes are loaded in it, which flatters Mitsuba.
"""

from collections.abc import Callable
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from raytwin import twin
from raytwin.bench.loop import loop
from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.scene import Camera, Scene
from raytwin.speed import background, draw, speculate

Call = Callable[[int], np.ndarray]
"""seed -> radiance (H, W, 3) float32."""


@dataclass(frozen=True)
class Method:
    """One row: `kind` is a row of PREPARE, `family` what the chart joins by a line, `label` the point's place in it.

    `engine`: python, numpy, drjit (LLVM), cuda, or Mitsuba's variant; `precision`: bits of a float; `trim`: a row of
    TRIMS, None where nothing is trimmed by boxes; `speculation`: every how many-th pixel is traced, 1: all;
    `keep`: of fills and the tracer, every frame goes into one array, as a film's do: a fresh one costs more than
    filling it, since the system hands it out page by page.
    """

    name: str
    family: str
    label: str
    kind: str
    engine: str
    precision: int
    rung: str
    trim: str | None = None
    speculation: int = 1
    samples: int = 1
    way: str | None = None
    keep: bool = False

    @property
    def truth(self) -> str:
        """Which truth its own errors are against: one ray through the pixel's centre, or the mean over the pixel."""
        return f"{self.rung}-{'center' if self.exact else 'area'}"

    @property
    def exact(self) -> bool:
        """Every ray goes through a pixel's centre, and no number is random."""
        return self.samples == 1 and self.kind not in ("plain", "denoised") and self.rung in ("lambert", "shadow")

    @property
    def noisy(self) -> bool:
        """Another seed gives another image."""
        return self.kind in ("plain", "denoised") or self.rung in ("sky", "path")


COUNTS = (1, 4, 16, 64, 256, 1024)
FEW = (1, 4, 16)


def _tracer(engine: str, bits: int, rung: str, trim: str) -> Method:
    family = f"{engine}{bits} {rung}"
    return Method(f"{engine}{bits}-{rung}-{trim}", family, trim, "tracer", engine, bits, rung, trim)


def _samples(engine: str, n: int) -> Method:
    name = f"{engine}32-shadow-{n}spp"
    return Method(name, f"{engine}32 supersampled", str(n), "samples", engine, 32, "shadow", "conic", samples=n)


def _speculation(way: str, n: int) -> Method:
    name, family = f"numpy32-shadow-{way}{n}", f"speculation, {way}"
    return Method(name, family, f"n={n}", "speculation", "numpy", 32, "shadow", "conic", n, way=way)


def _twin(variant: str, rung: str, n: int, kind: str = "twin") -> Method:
    short = variant.split("_")[0]
    integrator = {"sky": "direct", "path": "path"}[rung]
    what = {"twin": "twin", "plain": "Mitsuba", "denoised": "non-local means"}[kind]
    name = {"twin": f"twin-{short}", "plain": f"mitsuba-{short}", "denoised": f"denoised-{short}"}[kind]
    return Method(
        f"{name}-{integrator}-{n}", f"{what} {short} {integrator}", str(n), kind, variant, 32, rung, samples=n
    )


LLVM, SCALAR, CUDA = "llvm_ad_rgb", "scalar_rgb", "cuda_ad_rgb"

METHODS: tuple[Method, ...] = (
    # The least that any method can do: fill the frame with the sky.
    Method("fill", "fill", "fill", "fill", "numpy", 32, "shadow"),
    # The paper's way.
    Method("loop-lambert-none", "Python loop lambert", "none", "loop", "python", 64, "lambert", "none"),
    Method("loop-lambert-corners", "Python loop lambert", "corners", "loop", "python", 64, "lambert", "corners"),
    Method("loop-lambert-conic", "Python loop lambert", "conic", "loop", "python", 64, "lambert", "conic"),
    Method("loop-shadow-none", "Python loop shadow", "none", "loop", "python", 64, "shadow", "none"),
    Method("loop-shadow-conic", "Python loop shadow", "conic", "loop", "python", 64, "shadow", "conic"),
    # The tracer: engine, precision, rung, trim.
    *(_tracer(engine, bits, rung, trim)
      for engine in ("numpy", "drjit", "cuda") for bits in (32, 64)
      for rung, trims in (("lambert", ("none", "conic")), ("shadow", ("none", "corners", "conic"))) for trim in trims),
    # Into a frame that is filled already: what drawing into a photo costs.
    Method("drjit32-shadow-inplace", "drjit32 shadow", "in place", "inplace", "drjit", 32, "shadow", "conic"),
    Method("numpy32-shadow-inplace", "numpy32 shadow", "in place", "inplace", "numpy", 32, "shadow", "conic"),
    # Samples a pixel, on a regular grid within it.
    *(_samples(engine, n) for engine in ("numpy", "drjit", "cuda") for n in (4, 16, 64)),
    # Speculation: the paper's, and ours.
    *(_speculation(way, n) for way in ("paper", "careful") for n in (1, 2, 4, 8, 16)),
    # The twin, as `raytwin compare` renders it.
    *(Method(f"twin-{v.split('_')[0]}-shadow", f"twin {v.split('_')[0]} shadow", "1", "twin", v, 32, "shadow")
      for v in (LLVM, SCALAR, CUDA)),
    *(_twin(LLVM, rung, n) for rung in ("sky", "path") for n in COUNTS),
    *(_twin(SCALAR, rung, n) for rung in ("sky", "path") for n in FEW),
    *(_twin(CUDA, rung, n) for rung in ("sky", "path") for n in COUNTS),
    # Mitsuba left to itself.
    *(_twin(LLVM, rung, n, "plain") for rung in ("sky", "path") for n in COUNTS),
    *(_twin(SCALAR, rung, n, "plain") for rung in ("sky", "path") for n in FEW),
    *(_twin(CUDA, rung, n, "plain") for rung in ("sky", "path") for n in COUNTS),
    # Few samples, then OpenCV's non-local means.
    *(_twin(LLVM, "path", n, "denoised") for n in (1, 4, 16, 64)),
)  # fmt: skip


def choose(globs: tuple[str, ...] = ("*",)) -> tuple[Method, ...]:
    """The methods whose name matches one of the patterns, in the table's order. InputError where a pattern has none."""
    for glob in globs:
        if not any(fnmatchcase(m.name, glob) for m in METHODS):
            raise InputError("--methods", "patterns of names as drjit32-* (`raytwin bench list`)", glob)
    return tuple(m for m in METHODS if any(fnmatchcase(m.name, glob) for glob in globs))


# ------------------------------------------------------------------------------------------ from a row to a call


def prepare(method: Method, scene: Scene) -> Call:
    """The call that is timed. Raises InputError or MachineError where this scene or machine cannot have it."""
    if method.engine in twin.VARIANTS:
        twin.activate(method.engine)
    elif method.engine == "drjit":
        twin.activate()  # tells Dr.Jit which libLLVM to load
    return PREPARE[method.kind](method, scene)


def _fill(method: Method, scene: Scene) -> Call:
    kept = background(scene) if method.keep else None
    return lambda seed: background(scene, out=kept)


def _loop(method: Method, scene: Scene) -> Call:
    return lambda seed: loop(scene, method.rung, method.trim)


def _trace(method: Method, scene: Scene) -> Call:
    engine = f"{method.engine}{method.precision}"
    kept = background(scene, method.rung) if method.keep else None

    def call(seed: int) -> np.ndarray:
        out = background(scene, method.rung, kept)
        draw(scene, out, method.rung, engine, trim=method.trim)
        return out

    return call


def _inplace(method: Method, scene: Scene) -> Call:
    engine, out = f"{method.engine}{method.precision}", background(scene, method.rung)

    def call(seed: int) -> np.ndarray:
        draw(scene, out, method.rung, engine, trim=method.trim)
        return out

    return call


def _supersample(method: Method, scene: Scene) -> Call:
    engine, side = f"{method.engine}{method.precision}", round(method.samples**0.5)
    steps = (np.arange(side) + 0.5) / side - 0.5
    return lambda seed: mean_of_shifts(scene, method.rung, engine, [(x, y) for y in steps for x in steps])


def mean_of_shifts(scene: Scene, rung: str, engine: str, shifts) -> np.ndarray:
    """The mean image (H, W, 3) over rays through pixel centres moved by each (x, y) of `shifts`, in pixels."""
    total = None
    for x, y in shifts:
        out = background(scene, rung)
        draw(shifted(scene, float(x), float(y)), out, rung, engine)
        total = out if total is None else np.add(total, out, out=total)
    return total / np.float32(len(shifts))


def shifted(scene: Scene, x: float, y: float) -> Scene:
    """The scene whose pixel (u, v) sees what (u + x, v + y) did."""
    (a, s, cx), (z, b, cy), last = scene.camera.K
    K = ((a, s, cx - x), (z, b, cy - y), last)
    camera = scene.camera
    return scene.with_camera(Camera(camera.image_size, K, camera.R_cam_board, camera.t_cam_board, camera.dist))


def _speculate(method: Method, scene: Scene) -> Call:
    engine = f"{method.engine}{method.precision}"
    return lambda seed: speculate(scene, method.speculation, method.rung, engine, method.way)[0]


def _render(method: Method, scene: Scene) -> Call:
    sampling = "center" if method.exact else "area"

    def call(seed: int) -> np.ndarray:
        return render_twin(method, scene, sampling, seed).mean

    return call


def render_twin(method: Method, scene: Scene, sampling: str, seed: int) -> Image:
    return twin.render(
        scene, method.rung, sampling=sampling, samples=method.samples, seed=seed, cache=False, variant=method.engine
    )


def _plain(method: Method, scene: Scene) -> Call:
    integrator = {"sky": "direct", "path": "path"}[method.rung]
    loaded = twin.load_plain(scene, integrator, method.engine)

    def call(seed: int) -> np.ndarray:
        twin.activate(method.engine)
        return twin.render_plain(loaded, method.samples, seed)

    return call


def _denoise(method: Method, scene: Scene) -> Call:
    from raytwin.denoise import denoise

    return lambda seed: denoise(render_twin(method, scene, "area", seed))


PREPARE: dict[str, Callable[[Method, Scene], Call]] = {
    "fill": _fill,
    "loop": _loop,
    "tracer": _trace,
    "inplace": _inplace,
    "samples": _supersample,
    "speculation": _speculate,
    "twin": _render,
    "plain": _plain,
    "denoised": _denoise,
}
