"""What the page may ask for: all of it checked, none of it a path."""

import base64
import binascii
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec.structs import replace

from raytwin.errors import InputError, check_one_of
from raytwin.fast import ENGINES
from raytwin.rungs import RUNGS
from raytwin.scene import NOWHERE, Rectangle, Scene, Sky, Sphere, Sun
from raytwin.scene.record_base import Matrix, NonNegative, Positive, Radiance, Record, Vector
from raytwin.scene.scene import NO_SUN
from raytwin.scene.scene_files import scene_text
from raytwin.tracer import SOLVERS

MOST_OBJECTS, MOST_SAMPLES = 1000, 4096


class Look(Record, frozen=True):
    """How the page shows radiance, for the pictures that it gets while something moves.

    `low` to `high`: the errors that its difference shows, in equal ratios where `log`, else from 0 in equal steps.
    """

    exposure: Annotated[float, msgspec.Meta(ge=-20, le=20)] = 0.0
    low: NonNegative = 0.0
    high: Positive = 1.0
    log: bool = False


class WantedCamera(Record, frozen=True):
    """Where the camera was turned to; `zoom`: times the focal length."""

    R_cam_board: Matrix
    t_cam_board: Vector
    zoom: Annotated[float, msgspec.Meta(ge=0.05, le=50)] = 1.0


class WantedSky(Record, frozen=True):
    """The `radiance` of an even sky. A map stays, and the page does not name it."""

    radiance: Radiance = (0.0, 0.0, 0.0)


class ViewRequest(Record, frozen=True):
    """A scene's shapes and lights as its file has them, and how both sides render it.

    `rung` is the tracer's and `twin_rung` the twin's; light that is followed meets `depth` - 1 surfaces at most, and
    `samples` rays a pixel are the last pass. `camera`: the scene's own where None. `moving`: the next wish is on its
    way.
    """

    spheres: Annotated[tuple[Sphere, ...], msgspec.Meta(max_length=MOST_OBJECTS)] = ()
    planes: Annotated[tuple[Rectangle, ...], msgspec.Meta(max_length=MOST_OBJECTS)] = ()
    sun: Sun = NO_SUN
    sky: WantedSky = WantedSky()
    camera: WantedCamera | None = None
    rung: str = "shadow"
    twin_rung: str = "path"
    depth: Annotated[int, msgspec.Meta(ge=2, le=64)] = 8
    samples: Annotated[int, msgspec.Meta(ge=1, le=MOST_SAMPLES)] = 64
    engine: str = "numpy32"
    solver: str = "robust"
    look: Look = Look()
    moving: bool = False

    def check(self) -> "ViewRequest":
        """Return itself. Raises InputError for an unknown name, and for contents that no scene.toml may have."""
        for what, name, rows in (
            ("rung", self.rung, RUNGS),
            ("twin_rung", self.twin_rung, RUNGS),
            ("engine", self.engine, ENGINES),
            ("solver", self.solver, SOLVERS),
        ):
            check_one_of(what, name, rows)
        self.scene(Scene("", NOWHERE))  # whose records raise
        return self

    def scene(self, base: Scene) -> Scene:
        """The scene that this asks for."""
        sky = Sky(self.sky.radiance) if base.sky.map is msgspec.UNSET else base.sky
        placed = replace(base, spheres=self.spheres, planes=self.planes, sun=self.sun, sky=sky)
        if self.camera is None:
            return placed
        (fx, s, cx), (z, fy, cy), last = base.camera.K
        K = ((fx * self.camera.zoom, s, cx), (z, fy * self.camera.zoom, cy), last)
        turned = {name: getattr(self.camera, name) for name in ("R_cam_board", "t_cam_board")}
        return placed.with_camera(replace(base.camera, K=K, **turned))


def wanted_of(base: Scene, engine: str) -> ViewRequest:
    """What is shown first."""
    return ViewRequest(base.spheres, base.planes, base.sun, WantedSky(base.sky.radiance), engine=engine)


def from_json(text: str | bytes, where: str = "what the page asks for") -> ViewRequest:
    """What the page asks for. Raises InputError."""
    try:
        return msgspec.json.decode(text, type=ViewRequest).check()
    except msgspec.DecodeError as error:
        raise InputError(where, "a scene and how to render it", error) from None


def from_link(text: str) -> ViewRequest:
    """What a link of the page's says, or what follows its `#view=`. Raises InputError."""
    packed = text.rpartition("#view=")[2]
    try:
        plain = base64.urlsafe_b64decode(packed + "=" * (-len(packed) % 4))
    except (binascii.Error, ValueError):
        raise InputError("--view", "a link copied from the page", text[:60]) from None
    return from_json(plain, "--view")


def scene_toml(base: Scene, wanted: ViewRequest, folder: Path) -> str:
    """Return the scene.toml of what is shown; `folder` has the file of its map. It needs no photo any more."""
    shown = wanted.scene(base)
    if shown.sky.map is not msgspec.UNSET:
        path = str((folder / shown.sky.map).resolve())  # it may be saved anywhere
        shown = replace(shown, sky=replace(shown.sky, map=path))
    return scene_text(shown, f"{base.name}, as it was left while exploring it.")
