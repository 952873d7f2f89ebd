"""The engines that this machine has, and the scenes that are tried on each: fixtures of tracer and speed."""

import os
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from raytwin.fast import ENGINES
from raytwin.fast.sampling import BATCHES, sobol_pair
from raytwin.images.image import Image
from raytwin.scene import Scene
from raytwin.scene.scene_files import read_scene
from raytwin.tracer import trace_paths
from raytwin.tracer.arrays import library
from raytwin.tracer.path import Draw

SHIPPED = ("single", "overlap", "distorted", "grazing")

# A wrong LLVM aborts the process, so a child tries each backend first: a kernel is compiled, run and its sum printed.
CHILD = """
import drjit
for package in ("llvm", "cuda"):
    if drjit.has_backend(getattr(drjit.JitBackend, package.upper())):
        if float(drjit.sum(drjit.square(drjit.arange(getattr(drjit, package).Float, 4)))[0]) == 14:
            print(package, flush=True)
"""


@pytest.fixture(scope="session")
def packages() -> set[str]:
    """The packages of ENGINES that work on this machine; Dr.Jit's are loaded with the LLVM that was tried."""
    library = os.environ.get("DRJIT_LIBLLVM_PATH") or str(Path(sys.prefix) / "lib" / "libLLVM.so.23.1")
    found = {"numpy"}
    if Path(library).is_file():
        environment = os.environ | {"DRJIT_LIBLLVM_PATH": library}
        child = subprocess.run([sys.executable, "-c", CHILD], capture_output=True, text=True, env=environment)
        found |= set(child.stdout.split())
    if "llvm" in found:
        # Dr.Jit reads the variable when it is first touched: later tests find the environment as it was.
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("DRJIT_LIBLLVM_PATH", library)
            import drjit

            assert float(drjit.sum(drjit.llvm.Float([1.0, 2.0]))[0]) == 3
    return found


# Without NVIDIA's driver there is nothing to try: its rows would only fill the report with skips.
TRIED = [name for name, row in ENGINES.items() if row.package != "cuda" or shutil.which("nvidia-smi")]


@pytest.fixture(params=TRIED)
def engine(request, packages) -> str:
    """Every row of ENGINES that this machine has."""
    if ENGINES[request.param].package not in packages:
        pytest.skip(f"engine {request.param}: this machine has no working {ENGINES[request.param].package} for Dr.Jit")
    return request.param


@pytest.fixture(scope="session", params=SHIPPED)
def shipped(request, scenes) -> Scene:
    """Each shipped scene whose camera is given, in a picture of several tiles, those at its edges cut."""
    scene = read_scene(scenes / request.param)
    return scene.with_camera(scene.camera.resized(400, 300))


@pytest.fixture(scope="session")
def single(scenes) -> Scene:
    return read_scene(scenes / "single")


@pytest.fixture(scope="session")
def overlap(scenes) -> Scene:
    return read_scene(scenes / "overlap")


def sample_indices(samples: int) -> list[tuple[int, int]]:
    """(batch, index within it) of each of a pixel's samples; the first batches have one more where they differ."""
    number = min(BATCHES, samples)
    return [(b, i) for b in range(number) for i in range(samples // number + (b < samples % number))]


def pixel_draws(image_size: tuple[int, int], samples: int, seed: int = 0) -> list[Draw]:
    """The numbers of all pixels of a frame (width, height), for each of its samples: what `fast.walk` uses."""
    w, h = image_size
    pixel, like = np.arange(w * h).reshape(h, w), np.zeros((h, w))
    return [partial(sobol_pair, like, pixel, batch, i, seed & 0xFFFFFFFF) for batch, i in sample_indices(samples)]


def plain_paths(scene: Scene, depth: int = 8, samples: int = 16, seed: int = 0) -> Image:
    """The plain tracer's paths with the random numbers of `fast.walk`."""
    return trace_paths(scene, pixel_draws(scene.camera.image_size, samples, seed), depth)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20251121)


def to_numpy(values, shape: tuple[int, ...]) -> np.ndarray:
    """The engine's numbers, or one number for all, as a NumPy array of `shape`."""
    return np.broadcast_to(values if library(values) is np else values.numpy(), shape)
