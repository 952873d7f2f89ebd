"""Judge a renderer without a reference: by the laws that the pictures of every correct renderer keep.

law       a picture of changed scenes = a picture of the scene itself, or a constant (`scene_laws`)
verdict   of images without noise within the scene's tolerance, of noisy ones by sequential comparison; all laws of
          a run share its false-alarm rate
cause     the first broken law's, or that of laws which break together
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import count
from typing import Any

import numpy as np

from raytwin.compare import Comparison, Judging, SequentialComparison, Verdict, compare
from raytwin.compare.finding import notes
from raytwin.errors import InputError, check_one_of
from raytwin.images.image import Image
from raytwin.progress import Progress, Stages, silent
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.user_renderers import UserRenderer
from raytwin.rungs import RUNGS
from raytwin.scene import Rectangle, Scene
from raytwin.scene.record_base import Row
from raytwin.scene.scene_files import read_scene
from raytwin.study.rounds import Budget, Rounds, calls_per_round, sample_more
from raytwin.study.scene_laws import CAUSES, LAWS, OF_RECTANGLES, Level, View, placed
from raytwin.teach.contract.submission import Shown

FALSE_ALARM_RATE = 1e-3
"""Share of correct noisy renderers of which any law is said to be broken."""
WIDTH = 144
"""Pixels across a law's picture, unless a size is asked for."""
ENLARGED = 50.0
"""The built-in scene is the shipped `overlap` this many times as large: at 1/50, epsilons meet the size they know."""
REFERENCE_SEEDS = 1_000_000
"""Seeds from here on render the scene itself, those from 0 on the changed ones."""
EDGES = 1e-3
"""Share of the pixels that rounding may move across an outline or a shadow's edge."""
PICTURE = "picture"
"""The row of the scene's own picture. Where it cannot be judged, no law is tried."""


class LawRow(Row, frozen=True):
    """A law, whether it holds, and why: `verdict` is "skipped" where it does not apply. `cause`: of its break alone."""

    law: str
    does: str
    verdict: Verdict | str
    reasons: tuple[str, ...] = ()
    cause: str = ""


@dataclass(frozen=True, eq=False)
class Laws:
    """What came of all laws. `pictures`: law -> the changed one, and what it must be."""

    subject: str
    scene: Scene
    rung: str
    rows: tuple[LawRow, ...]
    pictures: dict[str, tuple[Image, Image]]

    @property
    def broken(self) -> tuple[LawRow, ...]:
        return tuple(row for row in self.rows if row.verdict == "fail")

    @property
    def verdict(self) -> Verdict:
        found = [row.verdict for row in self.rows]
        return "fail" if "fail" in found else "undecided" if "undecided" in found or "pass" not in found else "pass"

    @property
    def exit_code(self) -> int:
        return Comparison(self.verdict).exit_code

    @property
    def cause(self) -> str:
        """What a renderer does that breaks just these laws; empty where none is broken."""
        names = {row.law for row in self.broken}
        if "disc" in names and any(row.law == "frame" and row.verdict == "skipped" for row in self.rows):
            names.add("frame")  # both show the sky beside a black body
        together = (cause for laws, cause in CAUSES.items() if names.issuperset(laws))
        return next(together, self.broken[0].cause if self.broken else "")

    def numbers(self) -> dict[str, Any]:
        """Return what JSON holds."""
        about = {"subject": self.subject, "scene": self.scene.name, "rung": self.rung, "verdict": self.verdict}
        return about | {"cause": self.cause or None, "false_alarm_rate": FALSE_ALARM_RATE, "laws": self.rows}


def builtin_scene() -> Scene:
    """Return the scene that laws are tried on by default: spheres that overlap, a floor, a wall, a lens."""
    scene = read_scene("overlap")
    wall = Rectangle((0.0, 0.16, 0.05), (0.14, 0.03, 0.0), (0.0, 0.0, 0.05), (0.7, 0.5, 0.3), name="wall")
    camera = scene.camera.with_(
        dist=(-0.15, 0.04, 0.002, -0.003, 0.01), K=((760, 0, 325.3), (0, 720, 236.8), (0, 0, 1))
    )
    return placed(scene.with_(camera=camera, objects=[*scene.objects, wall]), ENLARGED * np.eye(3))


def laws(
    subject: Renderer, scene: Scene | None = None, *, size: tuple[int, int] | None = None, budget: Budget = Budget(),  # noqa: B008 (immutable)
    without: str = "", progress: Progress = silent,
) -> Laws:  # fmt: skip
    """Return which laws the subject keeps on a scene, by default `builtin_scene`; `size` (width, height) in pixels.

    Laws that do not hold for the scene or the subject's light level are skipped, with the reason. `budget`: samples or
    seconds per law of a renderer with noise. `without="planes"`: for one that has no rectangles. Raises
    InputError for a subject that cannot render the scene itself, or is an image; for a scene with a sky map, highlights
    or no object; and for a light level without light.
    """
    base = scene or builtin_scene()
    if without:
        check_one_of("--without", without, ("planes",))
        base = base.with_(objects=base.spheres)
    trial = _Trial(subject, _checked(subject, base, size), budget)
    own = trial.render(trial.base, 1, REFERENCE_SEEDS)
    found = compare(own, own, noise="none")
    if found.passed and not np.ptp(own.mean, axis=(0, 1)).any():
        found = found.judged("fail" if scene is None else "undecided", *notes(["it has one colour everywhere"]))
    cause = "" if found.passed else found.reasons[0]
    rows = [
        LawRow(PICTURE, "the scene's own picture shows something, in values of 0 or more", found.verdict, cause=cause)
    ]
    pictures = {PICTURE: (own, own)}
    level = Level(RUNGS[subject.rung], subject.sampling, subject.noisy)
    for number, law in enumerate(LAWS.values() if found.passed else ()):
        progress("laws", number, len(LAWS))
        no_rectangles = without and law.name in OF_RECTANGLES
        views = "the renderer has no rectangles" if no_rectangles else law.views(trial.base, level)
        if isinstance(views, str):
            rows.append(LawRow(law.name, law.does, "skipped", (views,)))
            continue
        try:
            test, reference, judged = trial.decide(*views)
            pictures[law.name] = test, reference
        except InputError as error:  # the renderer's own: it could render the scene as it is
            judged = Comparison("fail", notes([str(error)]))
        cause = law.cause if judged.verdict == "fail" else ""
        rows.append(LawRow(law.name, law.does, judged.verdict, judged.reasons, cause))
    progress("laws", len(LAWS), len(LAWS))
    return Laws(subject.name, trial.base, subject.rung, tuple(rows), pictures)


def _checked(subject: Renderer, scene: Scene, size: tuple[int, int] | None) -> Scene:
    """The scene at the size that its pictures have, once the laws can be tried on it."""
    if isinstance(subject, UserRenderer) and isinstance(subject.render, Shown):
        raise InputError("--subject", "a renderer, since an image shows one scene alone", subject.name)
    if not RUNGS[subject.rung].lit:
        raise InputError("--rung", "a light level with light", subject.rung)
    scene.check_lambertian("laws")
    scene.sky_radiance  # noqa: B018 (checked)
    if not scene.objects:
        raise InputError(f"scene {scene.name}", "objects", "none")
    width, height = scene.image_size
    edges = max(EDGES, scene.tolerance.outlier_fraction)
    scene = scene.with_(tolerance=scene.tolerance.with_(outlier_fraction=edges))
    return scene.with_(size=size or (WIDTH, max(3, 3 * round(WIDTH * height / width / 3))))


@dataclass(eq=False)
class _Trial:
    """One subject on one scene, whose own renders are made once."""

    subject: Renderer
    base: Scene
    budget: Budget
    _known: dict[tuple[int, int], Image] = field(default_factory=dict)

    def decide(self, changed: View, expected: View) -> tuple[Image, Image, Comparison]:
        """Return both pictures, and the verdict on them."""
        judging = Judging(tolerance=self.base.tolerance, false_alarm_rate=FALSE_ALARM_RATE / len(LAWS))
        seeds, own_seeds = count(), count(REFERENCE_SEEDS)
        if not self.subject.noisy:
            test, reference = self._image(changed, 1, seeds), self._image(expected, 1, own_seeds)
            return test, reference, compare(test, reference, judging)
        constant = None if expected.scenes else self._image(expected, 1, own_seeds)
        check = SequentialComparison(constant, judging=judging)
        sides = (
            lambda samples, _: self._image(changed, samples, seeds),
            None if constant else lambda samples, _: self._image(expected, samples, own_seeds),
        )
        calls = calls_per_round(self.subject)
        found = Rounds(check, *sides, 0, Stages(), calls, calls).decide(self.budget)
        return check.image("test"), check.image("reference"), found

    def _image(self, view: View, samples: int, seeds: Iterator[int]) -> Image:
        """Return the view's picture from independent renders: what adds pictures adds their variances too."""
        if not view.scenes:
            return Image(np.broadcast_to(np.float32(view.value), (*self.base.image_size[::-1], 3)).copy())
        images = [self.render(scene, samples, next(seeds)) for scene in view.scenes]
        parts: dict[str, Any] = {}
        for power, name in enumerate(("mean", "variance", "third"), start=1):
            arrays = [getattr(image, name) for image in images]
            if all(array is not None for array in arrays):
                parts[name] = np.float32(view.weight**power) * np.asarray(view.join(arrays), np.float32)
        return Image(**parts, samples=images[0].samples, batches=images[0].batches)

    def render(self, scene: Scene, samples: int, seed: int) -> Image:
        key = (samples, seed) if self.subject.noisy else (1, 0)
        known = self._known if scene is self.base else {}
        if key not in known:
            known[key] = sample_more(self.subject, scene)(*key)
        return known[key]
