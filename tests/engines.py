"""The engines that this machine has, and the scenes that are tried on each: fixtures of tracer and speed."""

import shutil
from functools import partial

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
from raytwin.twin import backend

SHIPPED = ("single", "overlap", "distorted", "grazing")

NVIDIA = shutil.which("nvidia-smi") is not None
"""Whether CUDA is worth a try: without the driver its rows would only fill the report with skips."""


@pytest.fixture(scope="session")
def packages() -> set[str]:
    """The packages of ENGINES that work on this machine; Dr.Jit's are loaded with the LLVM that the twin has tried."""
    found = {"numpy"}
    if backend.chosen(backend.LLVM).variant:
        found.add("llvm")
    if NVIDIA and backend.find_backend(backend.CUDA).variant:
        found.add("cuda")
    return found


TRIED = [name for name, row in ENGINES.items() if row.package != "cuda" or NVIDIA]


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
