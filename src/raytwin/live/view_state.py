"""What the page may ask for: all of it checked, none of it a path."""

import base64
import binascii
from pathlib import Path
from typing import Annotated

import msgspec
import tomli_w

from raytwin import files
from raytwin.errors import InputError, check_one_of
from raytwin.rungs import RUNGS
from raytwin.scene import Camera, Scene, SceneFile, WrittenPlane, WrittenSky, WrittenSphere, WrittenSun
from raytwin.scene.record_base import Radiance, Record
from raytwin.speed import ENGINES
from raytwin.tracer import SOLVERS

MOST_OBJECTS, MOST_SAMPLES = 1000, 4096


class Look(Record, frozen=True):
    """How the page shows radiance, for the pictures that it gets while something moves."""

    exposure: Annotated[float, msgspec.Meta(ge=-20, le=20)] = 0.0
    gamma: Annotated[float, msgspec.Meta(ge=0.2, le=5)] = 1.0
    tone: str = "sRGB"


class WantedSky(Record, frozen=True):
    """The `radiance` of an even sky; or of a map, which the page does not name, scale and turn in degrees."""

    radiance: Radiance = (0.0, 0.0, 0.0)
    scale: Annotated[float, msgspec.Meta(ge=0, le=1e6)] = 1.0
    rotation: Annotated[float, msgspec.Meta(ge=-360, le=360)] = 0.0


class Wanted(Record, frozen=True):
    """A scene's shapes and lights as its file has them, and how both sides render it.

    `rung` is the tracer's and `twin_rung` the twin's; light that is followed meets `depth` - 1 surfaces at most, and
    `samples` rays a pixel are the last pass. `moving`: the next wish is on its way.
    """

    spheres: Annotated[tuple[WrittenSphere, ...], msgspec.Meta(max_length=MOST_OBJECTS)] = ()
    planes: Annotated[tuple[WrittenPlane, ...], msgspec.Meta(max_length=MOST_OBJECTS)] = ()
    sun: WrittenSun = WrittenSun((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    sky: WantedSky = WantedSky()
    rung: str = "shadow"
    twin_rung: str = "path"
    depth: Annotated[int, msgspec.Meta(ge=2, le=64)] = 8
    samples: Annotated[int, msgspec.Meta(ge=1, le=MOST_SAMPLES)] = 64
    engine: str = "numpy32"
    solver: str = "robust"
    look: Look = Look()
    moving: bool = False

    def check(self) -> "Wanted":
        """Return itself. Raises InputError for an unknown name, and for contents that no scene.toml may have."""
        for what, name, rows in (
            ("rung", self.rung, RUNGS),
            ("twin_rung", self.twin_rung, RUNGS),
            ("engine", self.engine, ENGINES),
            ("solver", self.solver, SOLVERS),
        ):
            check_one_of(what, name, rows)
        files.check_contents(self, "")
        return self

    def written(self, base: SceneFile) -> SceneFile:
        """The scene's file as it would stand for this."""
        if base.sky.map is msgspec.UNSET:
            sky = WrittenSky(self.sky.radiance)
        else:
            sky = msgspec.structs.replace(base.sky, scale=self.sky.scale, rotation=self.sky.rotation)
        return msgspec.structs.replace(base, spheres=self.spheres, planes=self.planes, sun=self.sun, sky=sky)

    def scene(self, base: SceneFile) -> Scene:
        return self.written(base).scene


def wanted_of(base: SceneFile, engine: str) -> Wanted:
    """What is shown first."""
    sky = base.sky
    scale, turn = (default if x is msgspec.UNSET else x for x, default in ((sky.scale, 1.0), (sky.rotation, 0.0)))
    return Wanted(base.spheres, base.planes, base.sun, WantedSky(sky.radiance, scale, turn), engine=engine)


def from_json(text: str | bytes, where: str = "what the page asks for") -> Wanted:
    """What the page asks for. Raises InputError."""
    try:
        return msgspec.json.decode(text, type=Wanted).check()
    except msgspec.DecodeError as error:
        raise InputError(where, "a scene and how to render it", error) from None


def from_link(text: str) -> Wanted:
    """What a link of the page's says, or what follows its `#view=`. Raises InputError."""
    packed = text.rpartition("#view=")[2]
    try:
        plain = base64.urlsafe_b64decode(packed + "=" * (-len(packed) % 4))
    except (binascii.Error, ValueError):
        raise InputError("--view", "a link copied from the page", text[:60]) from None
    return from_json(plain, "--view")


def scene_toml(base: SceneFile, wanted: Wanted, camera: Camera) -> str:
    """A scene.toml of its own: what was calibrated is written out, so that it needs no photo."""
    written = files.plain(wanted.written(msgspec.structs.replace(base, camera=camera, photos=None)))
    tables = {k: v for k, v in written.items() if k not in ("name", "folder", "photos") and v not in ((), [], None)}
    if "map" in tables["sky"]:
        tables["sky"] = {k: v for k, v in tables["sky"].items() if k in ("map", "scale", "rotation")}
        tables["sky"]["map"] = str((Path(base.folder) / tables["sky"]["map"]).resolve())  # it may be saved anywhere
    order = ("camera", "sun", "sky", "tolerance")
    first = {key: tables.pop(key) for key in order if key in tables}
    head = f"# {base.name}, as it was left while exploring it.\n\n"
    return head + tomli_w.dumps({**first, **tables})
