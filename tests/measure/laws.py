"""Laws without a reference: which correct renderers break one, and which faults are seen and named by them alone.

`python -m measure.laws correct [FILE ...]`: the shipped renderers without noise, and the given correct tracers.
`python -m measure.laws noisy RUNS`: path tracers with so many seeds each. `python -m measure.laws faults`: every
fault of `planted_renderers`, with the word that its cause must have, and how many mistakes of students are seen.
"""

import sys
import types
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from measure import record
from planted_renderers import FAULTS, Planted
from tracers_by_students import CORRECT, MISTAKES, mistaken, swap

from raytwin.errors import InputError
from raytwin.renderers.renderer import Call, Renderer
from raytwin.scene import Scene
from raytwin.study.laws import Laws, laws
from raytwin.teach.contract.subject import find_subject, method

EXACT = (
    "numpy64-lambert-conic", "numpy64-shadow-conic", "numpy32-shadow-conic", "drjit32-shadow-conic", "twin-llvm-shadow",
)  # fmt: skip
NOISY = "drjit32-sky-16", "drjit32-path-16", "twin-llvm-path-16"
SIZE = 72, 54
"""Pixels of noisy pictures: six tiles, and many runs."""

NAMED = {
    "small spheres": "radius", "large spheres": "radius", "spheres too high": "offset", "planes too low": "offset",
    "planes too wide": "rectangles end elsewhere", "one sphere forgotten": "left out", "no planes": "rectangles",
    "red and blue exchanged": "channel", "albedo squared": "proportional to the albedo", "half a pixel": "half a pixel",
    "no distortion": "lens", "mirrored": "rows or columns", "upside down": "rows or columns", "gamma": "gamma",
    "twice as bright": "factor", "clipped": "clamp", "offset": "offset", "bottom row black": "row",
    "not a number": "NaN", "first over all": "than the nearest", "crash with two spheres": "IndexError",
    "no shadows": "shadow", "sun from below": "direction to the sun", "sun in grey": "channel",
    "no sky": "the sky's light", "sky twice": "the sky's light",
}  # fmt: skip
"""Fault -> words of the cause that name it."""


@dataclass(frozen=True)
class Reseeded(Renderer):
    """A noisy renderer whose seeds begin elsewhere."""

    inner: Renderer | None = None
    offset: int = 0
    noisy = True

    @property
    def name(self) -> str:
        return self.inner.name

    @property
    def sampling(self) -> str:
        return self.inner.sampling

    def with_samples(self, samples: int) -> Renderer:
        return replace(self, inner=self.inner.with_samples(samples))

    def prepare(self, scene: Scene) -> Call:
        call = self.inner.prepare(scene)
        return lambda seed: call(seed + self.offset)


def student(text: str) -> Renderer:
    """Return a student's text as a renderer in this process."""
    module: Any = types.ModuleType("a_student")
    sys.modules["a_student"] = module
    module.SWAP = swap
    exec(compile(text, "student.py", "exec"), module.__dict__)

    def render(scene: dict[str, Any]) -> np.ndarray:
        with np.errstate(all="ignore"):
            return np.asarray(module.render(scene))

    return method(render, rung="shadow")


def exact(files: list[str]) -> Iterator[tuple[str, Callable[[], Laws]]]:
    """(what is tried, how) of every correct renderer without noise."""
    for name in (*EXACT, *files):
        yield name.rpartition("students/")[2], lambda name=name: laws(find_subject(name, "shadow"))
    for number, how in enumerate(CORRECT):
        yield f"student's text {number}", lambda how=how: laws(student(mistaken(*how)))


def reseeded(count: int) -> Iterator[tuple[str, Callable[[], Laws]]]:
    """(what is tried, how) of path tracers with other seeds."""
    for seed in range(count):
        for name in NOISY:
            inner = find_subject(name, "path")
            renderer = Reseeded(inner.rung, inner, seed * 10_000_000)
            yield name, lambda renderer=renderer: laws(renderer, size=SIZE)


def tell(table: str, command: str, runs: Iterator[tuple[str, Callable[[], Laws]]]) -> None:
    found: dict[str, list[Laws]] = {}
    for name, judged in runs:
        found.setdefault(name, []).append(judged())
        print(name, found[name][-1].verdict, [row.law for row in found[name][-1].broken], file=sys.stderr, flush=True)
    rows = []
    for name, all_ in found.items():
        broken = sorted({row.law for one in all_ for row in one.broken})
        undecided = sum(one.verdict == "undecided" for one in all_)
        rows.append((name, len(all_), sum(bool(one.broken) for one in all_), ", ".join(broken), undecided))
    columns = ("renderer", "runs", "with a broken law", "which", "undecided")
    record.table("laws", table, columns, rows, command)


def faults() -> None:
    rows, seen, named = [], 0, 0
    for name in FAULTS:
        try:
            found = laws(Planted("shadow", name))
            broken, cause = ", ".join(row.law for row in found.broken), found.cause
        except InputError as error:
            broken, cause = "no picture of the scene itself", str(error)
        seen, named = seen + bool(broken), named + (bool(broken) and NAMED[name] in cause)
        rows.append((name, broken, cause, "yes" if broken and NAMED[name] in cause else ""))
        print(*rows[-1], sep=" | ", flush=True)
    rows.append((f"all {len(FAULTS)}", f"{seen} seen", "", f"{named} named"))
    record.table("laws", "planted", ("fault", "broken laws", "cause", "named"), rows, "python -m measure.laws faults")
    texts = [(names[0], mistaken(text.replace("EPS = 1e-4", "EPS = 1e-6"), *how)) for names, text, *how in MISTAKES]
    hidden = [name for name, text in texts if laws(student(text)).verdict == "pass"]
    about = len(texts), len(texts) - len(hidden), ", ".join(hidden)
    record.table("laws", "students", ("mistakes", "seen", "not seen"), [about], "python -m measure.laws faults")


if __name__ == "__main__":
    kind, *words = record.arguments()
    if kind == "faults":
        faults()
    elif kind == "correct":
        tell(kind, "python -m measure.laws correct FILE...", exact(words))
    else:
        tell(kind, f"python -m measure.laws noisy {words[0]}", reseeded(int(words[0])))
