"""The reference that a test compares images with: what the pytest plugin's fixture returns, and its rows in the report.

It stands beside the plugin because every run of pytest loads that, and this only where the fixture is used.
"""

import contextlib
import itertools
import os
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import pytest

from raytwin.compare import Comparison, Report, SequentialComparison, compare, finding
from raytwin.errors import InputError
from raytwin.explain import diagnosis
from raytwin.images import image_input
from raytwin.images.image import Image
from raytwin.images.image_input import LoadedImage
from raytwin.judging import Judging
from raytwin.renderers import references
from raytwin.renderers.references import Reference
from raytwin.renderers.scene_exchange import as_arrays
from raytwin.scene import Camera, Scene, Tolerance
from raytwin.show import check_page
from raytwin.show.terminal_text import because, further

_COUNTER = pytest.StashKey["itertools.count"]()
_FAILED = pytest.StashKey[bool]()
"""Whether a comparison of the test failed: its own row says so."""
_MAKERS = pytest.StashKey[dict[Path, str]]()
"""The references that this run made of images -> the test that made each."""


class ReferenceCheck:
    """A reference that images are compared with. Missing, damaged or stale, it fails the test and says what to do."""

    def __init__(self, request: pytest.FixtureRequest, name: str, rung: str, image: bool = False) -> None:
        __tracebackhide__ = True
        self.name, self.rung, self._of_an_image = name, rung, image
        self._node, self._folders, self._text = request.node, Folders(request.config), ""
        self.reference: Reference | None = self._find()

    def __repr__(self) -> str:
        return f"<raytwin reference {self.name}/{self.rung}>"

    @property
    def image(self) -> Image:
        """What it holds: `mean` (H, W, 3) linear Rec. 709, `variance` where it has noise, `surface` at that rung."""
        return self._known().image

    @property
    def path(self) -> Path:
        return self._known().path

    @property
    def header(self) -> dict[str, str]:
        """Its provenance: `sampling`, `samples`, `seed`, `mitsuba`, ..."""
        return self._known().header

    @property
    def scene(self) -> Scene:
        """The scene to render, its camera found and of the reference's size."""
        __tracebackhide__ = True
        known = self._known()
        made_from = "a Mitsuba file: read it" if known.of_file else "an image: it has no scene"
        return known.scene if known.scene is not None else pytest.fail(f"{self.path} was made from {made_from}")

    @property
    def scene_dict(self) -> dict[str, Any]:
        """The same scene as the dict of arrays that `--subject FILE.py:FUNCTION` passes."""
        return as_arrays(self.scene, self.rung)

    @property
    def camera(self) -> Camera:
        """The camera to render with."""
        return self.scene.camera

    def check(self, image: Any, **options: Any) -> Comparison:
        """Fail the test unless `image` shows what the reference shows; options as in `compare`."""
        __tracebackhide__ = True
        made = self.compare(image, **options)
        if not made.passed:
            pytest.fail(self._text)
        return made

    def compare(
        self,
        image: Any,
        *,
        variance: Any = None,
        renders: int = 64,
        tolerance: float | Tolerance | None = None,
        **judging: Any,
    ) -> Comparison:
        """The verdict on `image`, without failing.

        `image`: an array (H, W, 3) of linear radiance, row 0 on top, with the `variance` of its mean where it has
        noise; independent renders as a list or an array (k, H, W, 3), k >= 4; a path to an EXR, PFM or 8-bit picture;
        a function of a seed that returns any of these, called until the verdict is certain, `renders` times at most; a
        raytwin Image. `tolerance`: a number (noise-free values may err by it, relative to the reference's scale, 99.9 %
        of them) or a Tolerance; the scene's by default. `judging`: other fields of Judging, as `false_alarm_rate`,
        `noise` and `detectable_bias`.
        """
        __tracebackhide__ = True
        taken, made = None, None
        allowed = self.reference.tolerance if self.reference is not None else Tolerance()
        try:
            how = Judging(allowed if tolerance is None else tolerance, **judging)
            if callable(image) and not isinstance(image, Image) and variance is None and self.reference is not None:
                taken, made = self._in_rounds(image, renders, how)
            else:
                taken = image_input.as_image(image, variance, min(renders, image_input.RENDERS))
        except InputError as error:
            wrong = str(error)
        if taken is None:  # not above: pytest would show the InputError's traceback too
            self._fail(f"{self.name}/{self.rung}: {wrong}")
        notes = list(taken.notes)
        if self._golden() and (maker := self._keep(taken.image)):
            notes.append(f"this run made the reference from the image of {maker}: two images need two names")
        known = self._known()
        shown = taken.fitted(known.image)
        if made is None:
            how = replace(how, noise="both") if taken.measured else how
            made = compare(taken.image, shown, how, half_steps=(taken.rounding.half, None))
        if made.verdict == "fail":
            made = made.because(*diagnosis.explain(taken.image, known.image, known.scene, self.rung, taken.rounding))
        if not made.passed and shown.variance is not None and taken.image.variance is None:
            notes.append(
                "the reference has noise and the image tells none: where it has, give its variance=, "
                "several renders, or a function of a seed"
            )
        if not made.passed and known.golden and (folder := report_folder(self._node.config)):
            new = self._as_reference(taken.image, folder / "new")
            references.save(new)
            command = f"raytwin reference accept {shlex.quote(self._from_here(new.path))} --because 'why'"
            notes.append(f"to take it for the reference: {command}{self._folder_option()}")
        text = f"{self.name}/{self.rung}{because(made) or f': {made.verdict}'}\n"
        text += "".join(f"  {reason}\n" for reason in further(made)) + "".join(f"  note: {n}\n" for n in notes)
        if page := self._report(made, tuple(notes), taken.image, shown, how.bounds):
            text += f"  page: {page}\n"
        self._text = text + f"  reference: {known.path}"
        return made

    # ---------------------------------------------------------------------------------- within

    def _in_rounds(self, render: Callable[[int], Any], renders: int, how: Judging) -> tuple[LoadedImage, Comparison]:
        """Renders of the seeds 0, 1, ... until the verdict is certain: what they make together, and the verdict."""
        if renders < image_input.FEWEST_RENDERS:
            raise InputError("renders", f"at least {image_input.FEWEST_RENDERS}", renders)
        check = SequentialComparison(self._known().image, judging=replace(how, noise="both"))
        for seed in range(renders):
            if check.add(render(seed)):
                break
        return image_input.as_image(check.image("test"))._replace(measured=True), check.conclude()

    def _known(self) -> Reference:
        __tracebackhide__ = True
        if self.reference is None:
            pytest.fail(f"{self._folders.own / self.name / self.rung}.exr is not there yet: check an image first")
        return self.reference

    def _find(self) -> Reference | None:
        """The reference, whole and of its scene as it is; None where --raytwin-update may make it from an image."""
        __tracebackhide__ = True
        folders, scene = self._folders, self._folders.scene(self.name)
        paths, path, found, why = [], None, None, None
        try:
            # A scene of the user's own is not the shipped one of the same name.
            paths = [references.path_of(f, self.name, self.rung) for f in (folders.all[:1] if scene else folders.all)]
            path = next((p for p in paths if p.exists()), None)
            if path is not None:
                found = references.load(path)
        except InputError as error:
            why = str(error)
        if not paths:  # no such rung, or no name at all
            self._fail(why or self.name)
        own = path in (None, paths[0])
        if path is None:
            why = f"{self.name}/{self.rung}: no such reference in {' or '.join(map(str, paths))}"
        elif found is not None and scene and (reason := references.stale(found, scene)):
            why = f"{path}: stale: {reason}"
        if why is None:
            return found
        if folders.update and own and scene:
            from raytwin.study import make_reference

            made = make_reference.make(scene, self.rung, folders.own)
            print("\n".join(made.lines()))
            self._write(made.new)
            return made.new
        if folders.update and own and (self._of_an_image or (found is not None and found.golden)):
            return None
        self._fail(f"{why}\n  {self._remedy(scene)}")

    def _remedy(self, scene: Path | None) -> str:
        where = self._from_here(scene or self._folders.scenes / self.name)
        command = f"raytwin reference make {shlex.quote(where)} --rung {self.rung}{self._folder_option()}"
        if scene is not None:
            return f"To make it: {command}"
        there = ", ".join(dict.fromkeys(name for folder in self._folders.all for name, _ in references.listed(folder)))
        return (
            f"There: {there or 'none'}. To make it, write {where}/scene.toml, then: {command}\n"
            f"  Where it is to be an image of no scene: raytwin_reference({self.name!r}, {self.rung!r}, image=True), "
            "and pytest --raytwin-update"
        )

    def _golden(self) -> bool:
        """Whether the image is to become the reference: asked for, and of no scene."""
        own = self.reference is None or self.reference.path.is_relative_to(self._folders.own)
        return self._folders.update and own and (self.reference is None or self.reference.golden)

    def _keep(self, image: Image) -> str | None:
        """Make `image` the reference, once per run: later images are compared with it. Return which test made it."""
        __tracebackhide__ = True
        made = self._as_reference(image, self._folders.own)
        makers = self._node.config.stash.setdefault(_MAKERS, {})
        if made.path in makers:
            self.reference = references.load(made.path)
            return makers[made.path]
        wrong = compare(image, image)  # NaN, black, of another shape: nothing to compare others with
        if not wrong.passed:
            self._fail(f"{self.name}/{self.rung}: no reference can be made of this image: {'; '.join(wrong.reasons)}")
        makers[made.path] = made.header["renderer"]
        old, self.reference = self.reference, made
        # What has not changed keeps its file, and the reason in it.
        if old is None or references.checksum(old.image, {}) != references.checksum(made.image, {}):
            self._write(made)
        return None

    def _write(self, made: Reference) -> None:
        """Write the reference, and tell it at the end of the run."""
        did = "replaced" if made.path.exists() else "made"
        references.save(made)
        self._node.user_properties.append(("raytwin", f"{did} {self._from_here(made.path)}"))

    def _folder_option(self) -> str:
        folder = self._from_here(self._folders.own)
        return "" if folder == "reference" else f" --folder {shlex.quote(folder)}"

    def _from_here(self, path: Path) -> str:
        return os.path.relpath(path, self._node.config.invocation_params.dir)

    def _as_reference(self, image: Image, folder: Path) -> Reference:
        header = {"scene": self.name, "rung": self.rung, "renderer": f"the test {self._node.nodeid}"}
        return references.sealed(references.path_of(folder, self.name, self.rung), image, header, None)

    def _fail(self, text: str) -> NoReturn:
        __tracebackhide__ = True
        self._report(Comparison("fail", finding.notes(text.splitlines())))
        pytest.fail(text)

    def _report(self, made: Comparison, notes: tuple[str, ...] = (), *images: Any) -> Path | None:
        folder = report_folder(self._node.config)
        if folder is None:
            return None

        report = Report(self.name, self.rung, made)
        try:
            return check_page.write_check(folder, *numbered(self._node, made.verdict), report, notes, *images)
        except InputError as error:
            wrong = f"{self.name}/{self.rung}: {made.verdict}, but its page cannot be written: {error}"
        pytest.fail("\n  ".join((wrong, *made.reasons)))


class Folders:
    """Where references and scenes lie: the user's own first, then the references that raytwin ships."""

    def __init__(self, config: pytest.Config) -> None:
        self.own = config.rootpath / (config.getini("raytwin_references") or "reference")
        self.scenes = config.rootpath / (config.getini("raytwin_scenes") or "scenes")
        self.update = config.getoption("--raytwin-update")

    @property
    def all(self) -> list[Path]:
        return [self.own, references.SHIPPED]

    def scene(self, name: str) -> Path | None:
        """The folder of the scene, where there is one."""
        folder = self.scenes / name
        return folder if any((folder / kind).is_file() for kind in ("scene.toml", "scene.xml")) else None


def numbered(node: pytest.Item, verdict: str) -> tuple[str, int]:
    """The test's name and the number of its next row, whose verdict is kept."""
    node.stash[_FAILED] = node.stash.get(_FAILED, False) or verdict not in ("pass", "differs")
    counter = node.stash.setdefault(_COUNTER, itertools.count())
    return node.nodeid, next(counter)


def report_folder(config: pytest.Config) -> Path | None:
    """The folder of --raytwin-report; None where it is not given."""
    asked = config.getoption("--raytwin-report")
    return config.invocation_params.dir / asked if asked else None


def list_crash(item: pytest.Item, call: pytest.CallInfo[None]) -> None:
    """Write the row of a test that ended by an error of its own: it compared nothing, and the index would lack it."""
    folder = report_folder(item.config)
    if folder is None or call.excinfo is None or item.stash.get(_FAILED, False):
        return
    text = call.excinfo.exconly(tryshort=True).removeprefix("Failed: ").splitlines()
    case = getattr(item, "callspec", None)
    reason = f"{'' if call.when == 'call' else f'in {call.when}: '}{text[0] if text else 'an error'}"
    with contextlib.suppress(InputError):  # the end of the run says that there is no report
        check_page.write_crash(folder, *numbered(item, "error"), case.id if case else "", reason)
