"""Where the twin's float32 departs from the tracer in float64, and what `compare` says of it.

`python -m measure.twin_agreement shipped|random|far [SEEDS]`, in tests/ (3): pixels that see another object, pixels at
`shadow` off by more than 1e-4 of white, and the verdicts of `compare` at every light level, none of which may fail.
`sides` replaces the sizes of the shipped scenes (`sides=160x120,320x240`). `files [SEEDS]` compares renders of Mitsuba
files with one of another seed: alarms by noise alone.
"""

import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np
from measure import record
from measure.random_scenes import KINDS, random_scene
from scene_of import scene_of

from raytwin import fast, twin
from raytwin.compare import Comparison, compare
from raytwin.rungs import RUNGS
from raytwin.scene import Camera, Rectangle, Scene, Sky, Sphere, Sun
from raytwin.scene.mitsuba_file import read_mitsuba
from raytwin.scene.scene_files import read_scene
from raytwin.study.compare_scene import compare_with_twin
from raytwin.tracer import trace

SHIPPED = "ball", "distorted", "eclipse", "gloss", "grazing", "overlap", "single", "studio", "wedge", "weekend"
SIZES = (160, 120), (320, 240), (640, 480)
SAMPLES = 16
RADII = 300, 10_000
COLUMNS = "pixels", "another object", "shadow off", "compared", "fail", "undecided", "single precision said"


def shipped(seeds: int) -> Iterator[tuple[str, Scene, int]]:
    given = [word.partition("=")[2] for word in sys.argv if word.startswith("sides=")]
    sizes = [tuple(map(int, size.split("x"))) for size in given[0].split(",")] if given else SIZES
    for name, size in product(SHIPPED, sizes):
        scene = read_scene(record.DOCS.parent / "scenes" / name)
        yield name, scene.with_camera(scene.camera.resized(*size)), seeds


def drawn(seeds: int) -> Iterator[tuple[str, Scene, int]]:
    for kind, seed in product(KINDS, range(seeds)):
        yield kind, random_scene(kind, seed), 1


def far(seeds: int) -> Iterator[tuple[str, Scene, int]]:
    """Balls on a floor, as large in the picture at any distance; the last also beside a near ball, in one scene."""
    for radii, seed, near in product(RADII, range(seeds), (False, True)):
        rng, r, eye = np.random.default_rng(seed), 0.05, np.array((0.3, -0.8, 0.5)) * radii * 0.05
        z = -eye / np.linalg.norm(eye)
        x = np.cross(z, (0, 0, 1)) / np.linalg.norm(np.cross(z, (0, 0, 1)))
        R = np.stack([x, np.cross(z, x), z])
        f = 60 / (4 * r / np.linalg.norm(eye))
        K = ((f, 0.0, 79.5), (0.0, f, 59.5), (0.0, 0.0, 1.0))
        camera = Camera((160, 120), K, tuple(map(tuple, R.tolist())), tuple((-R @ eye).tolist()), ())
        balls = [Sphere((*rng.uniform(-0.125, 0.125, 2).tolist(), s), s, tuple(rng.uniform(0.2, 0.9, 3)))
                 for s in r * rng.uniform(0.9, 1, 3)]  # fmt: skip
        floor = Rectangle((0, 0, 0), (0.25, 0, 0), (0, 0.25, 0))
        beside = eye + 4 * r * z + 1.5 * r * x * 60 / f
        close = [Sphere(tuple(beside.tolist()), 1.5 * r * 60 / f, (0.5, 0.5, 0.5))] if near else []
        lights = Sun((*rng.normal(0, 0.4, 2).tolist(), 0.8)), Sky((0.5, 0.7, 1.0))
        yield f"{radii} radii{', another near' * near}", scene_of("far", camera, (*balls, floor, *close), lights), 1


BEDS = {"shipped": shipped, "random": drawn, "far": far}


def verdicts(scene: Scene, seeds: int) -> Iterator[tuple[str, Comparison]]:
    """The comparison with the tracer at each level."""
    for rung, seed in product(RUNGS, range(seeds)):
        if RUNGS[rung].noisy:
            mine = fast.walk(scene, rung, "drjit64", samples=SAMPLES, seed=seed, sampling="center")
        elif seed == 0:
            mine = trace(scene, rung)
        else:
            continue
        other = twin.render(scene, rung, samples=SAMPLES, seed=seed + 1000, cache=False)
        yield rung, compare_with_twin(mine, other, scene)


def alarms(seeds: int) -> Iterator[tuple[str, int, int]]:
    """A file's name, its comparisons of correct renders, and how many of these are no pass."""
    import mitsuba as mi

    folder = Path(tempfile.mkdtemp())
    glass = read_mitsuba(record.DOCS.parent / "scenes" / "glass")
    box = mi.parser.parse_dict(mi.parser.ParserConfig(mi.variant()), mi.cornell_box())
    (folder / "box.xml").write_text(mi.parser.write_string(box))
    for scene in (glass, read_mitsuba(folder / "box.xml")):
        right = twin.render_mitsuba(scene, 1024, 1_000_000, cache=False)
        tested = [twin.render_mitsuba(scene, 64, seed, cache=False) for seed in range(seeds)]
        yield scene.name, seeds, sum(compare(image, right).verdict == "fail" for image in tested)


def main() -> None:
    words = [word for word in record.arguments() if not word.startswith("sides=")]
    name, seeds = words[0], int(words[1]) if len(words) > 1 else 3
    twin.activate()
    command = f"python -m measure.twin_agreement {' '.join(record.arguments())}"
    if name == "files":
        return record.table("twin", name, ["file", "compared", "fail"], alarms(seeds), command)
    rows: dict[str, Counter[str]] = {}
    for label, scene, own in BEDS[name](seeds):
        exact, image = fast.trace(scene, "shadow", "numpy64"), twin.render(scene, "shadow", cache=False)
        row, lit = rows.setdefault(label, Counter()), exact.mean[exact.mean > 0]
        off = abs(exact.mean - image.mean) > 1e-4 * (float(np.quantile(lit, 0.99)) if lit.size else 1.0)
        row["pixels"] += exact.surface.ids.size
        row["another object"] += int(np.count_nonzero(exact.surface.ids != image.surface.ids))
        row["shadow off"] += int(np.count_nonzero(off.any(axis=-1)))
        for rung, found in verdicts(scene, own):
            row["compared"] += 1
            row[found.verdict] += 1
            row["single precision said"] += "single precision" in " ".join(found.reasons)
            if found.verdict == "fail":
                print(label, scene.camera.image_size, rung, found.reasons[0], file=sys.stderr, flush=True)
    table = [[label, *(row[column] for column in COLUMNS)] for label, row in rows.items()]
    return record.table("twin", name, ["scene", *COLUMNS], table, command)


if __name__ == "__main__":
    main()
