"""A reference: an EXR that renders are compared with, `<folder>/<scene>/<rung>.exr`.

Each stands alone: beside the pixels, its header has what made them, the scene with its camera found, a hash of the
scene as it is written, and a checksum of everything, since EXR itself does not notice a flipped byte. Reading one needs
neither Mitsuba nor OpenCV; `study.make_reference` makes them.
"""

import hashlib
import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from raytwin.errors import InputError, check_one_of
from raytwin.images.exr import read_exr, write_exr
from raytwin.images.image import Image, Surface
from raytwin.images.photo_files import list_photos
from raytwin.rungs import RUNGS
from raytwin.scene import Camera, Scene, Tolerance
from raytwin.scene.mitsuba_file import is_mitsuba, read_mitsuba
from raytwin.scene.scene_files import scene_and_photos
from raytwin.scene.toml_json import read_toml, to_record
from raytwin.scene_folders import REFERENCES, find_scene

SHIPPED = REFERENCES
"""The references that come with raytwin; in a checkout, its own reference/."""
FORMAT = "1"
VARIANCE_BITS = 4
"""Significant bits kept of a variance: it is known to 18 % from 64 batches, and stored to 6 %."""
NOISE_STEPS = 2
"""A noisy mean is stored in steps of half its standard deviation or less, which adds at most 2.1 % to its variance: a
z-score is at most 1 % too large, and a false-alarm rate of 1e-3 at most 1.13e-3. Further digits are noise, which does
not compress."""
MEAN_BITS = 22
"""Significant bits kept of a mean without noise: it is off by at most 2.4e-7 of itself, a fortieth of the default
tolerance."""
SURFACE_BITS = 16
"""Significant bits kept of depths and normals: 8e-6 of the depth and 5e-4 degrees, where 1e-4 and 0.1 are allowed."""


FILES = "files"
"""The header's key for the files that a Mitsuba file pulls in, each with its SHA-256."""

SET_UP = ("name", "camera", "spheres", "planes", "sun", "sky", "tolerance")
"""What a header holds of a Scene."""


@dataclass(frozen=True, eq=False)
class Reference:
    """The image, and its header: what made it, as text. `scene` is None for one that was made from an image."""

    path: Path
    image: Image
    header: dict[str, str] = field(default_factory=dict)
    scene: Scene | None = None

    @property
    def camera(self) -> Camera | None:
        return self.scene.camera if self.scene else None

    def __repr__(self) -> str:
        return f"<raytwin.reference {self.path.parent.name}/{self.path.stem}: {self.image!r}>"

    def origin(self) -> Scene:
        """The scene that it was made from. Raises InputError for one that was made from an image."""
        if self.scene is None:
            raise InputError(self.path, "a reference made from a scene", "one made from an image")
        return self.scene

    @property
    def tolerance(self) -> Tolerance:
        return self.scene.tolerance if self.scene else Tolerance()

    @property
    def of_file(self) -> bool:
        """Whether it was made from a Mitsuba file."""
        return FILES in self.header

    @property
    def golden(self) -> bool:
        """Whether it was made from an image, and of no scene."""
        return self.scene is None and not self.of_file


# ------------------------------------------------------------------------------------------ files


def path_of(folder: str | Path, name: str, rung: str) -> Path:
    """`<folder>/<scene>/<rung>.exr`; InputError for a rung or a name that cannot be one."""
    check_one_of("rung", rung, RUNGS)
    if not re.fullmatch(r"\w[\w .+-]*", name):
        raise InputError("scene", "the name of a scene's folder", repr(name))
    return Path(folder) / name / f"{rung}.exr"


def reference(name: str, rung: str = "shadow", folder: str | Path | None = None) -> Reference:
    """Return the reference image of scene `name` at light level `rung`: `image`, and `scene` and `camera` to render it
    with.

    It is looked for in `folder`, by default in `reference/`, then among those that raytwin ships. Raises InputError if
    there is none, or if the file is damaged.

    >>> reference("single", "lambert").image
    <raytwin.Image 336 x 252, 1 sample, mean 0.1496>
    """
    folders = [Path(folder)] if folder is not None else [Path("reference"), SHIPPED]
    paths = [path_of(one, name, rung) for one in folders]
    found = next((path for path in paths if path.is_file()), None)
    if found is None:
        known = dict.fromkeys(scene for one in folders for scene, _ in listed(one))
        check_one_of("reference", name, known)
        raise InputError(
            paths[0], "a reference", f"none; there are {', '.join(r for s, r in listed(folders[-1]) if s == name)}"
        )
    return load(found)


def load(path: str | Path) -> Reference:
    """The reference, once its checksum holds and it lies under its own name. Raises InputError, also for no file."""
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "a reference", "no such file")
    image, header = read_exr(path)
    if "checksum" not in header:
        raise InputError(path, "a reference, with a checksum in its header", "an EXR without")
    if header["checksum"] != checksum(image, header):
        raise InputError(path, "a reference", "a damaged one (it does not have the checksum written into it)")
    if header.get("format") != FORMAT:
        raise InputError(path, f"a reference of format {FORMAT}", header.get("format"))
    named = header.get("scene"), header.get("rung")
    if named != (path.parent.name, path.stem):
        raise InputError(path, "the reference of its scene and light level", f"that of {named[0]}, {named[1]}")
    scene = None
    if "set_up" in header:
        scene = to_record(f"{path}: set_up", msgspec.json.decode(header["set_up"]), Scene)
    return Reference(path, image, header, scene)


def save(reference: Reference) -> None:
    """Write it, checksum included, to its path: under another name first, so that nothing half-written is left."""
    write_exr(reference.path, reference.image, reference.header)


def checksum(image: Image, header: dict[str, str]) -> str:
    """SHA-256 of all pixels and of the header without the checksum itself, 32 hexadecimal digits."""
    own = {k: v for k, v in header.items() if k not in ("checksum", "samples", "batches")}
    own |= {"samples": str(image.samples), "batches": str(image.batches)}
    total = hashlib.sha256(msgspec.json.encode(own, order="sorted"))
    parts = {"mean": image.mean, "variance": image.variance, "alpha": image.alpha}
    if image.surface is not None:
        parts |= {name: getattr(image.surface, name) for name in ("ids", "depth", "normal")}
    for name, pixels in parts.items():
        if pixels is not None:
            whole = name == "ids"
            total.update(f"{name} {pixels.shape}".encode())
            total.update(np.ascontiguousarray(pixels, "<i4" if whole else "<f4").tobytes())
    return total.hexdigest()[:32]


def sealed(path: Path, image: Image, header: dict[str, str], scene: Scene | None) -> Reference:
    """The reference as it will be read back: rounded as far as noise lets, scene and checksum in the header."""
    mean, variance, surface = np.asarray(image.mean, np.float32), image.variance, image.surface
    if variance is None:
        mean = rounded(mean, MEAN_BITS)
    else:
        variance = rounded(np.asarray(variance, np.float32), VARIANCE_BITS)
        mean = stepped(mean, variance)
    if surface is not None:
        surface = Surface(surface.ids, rounded(surface.depth, SURFACE_BITS), rounded(surface.normal, SURFACE_BITS))
    image = replace(image, mean=mean, variance=variance, surface=surface)
    header = {k: v for k, v in header.items() if k not in ("checksum", "batches")} | {"format": FORMAT}
    if scene is not None:
        header["set_up"] = msgspec.json.encode({name: getattr(scene, name) for name in SET_UP}).decode()
    header |= {"samples": str(image.samples)} | ({"batches": str(image.batches)} if image.batches else {})
    return Reference(path, image, header | {"checksum": checksum(image, header)}, scene)


def rounded(x: ArrayLike, bits: int) -> np.ndarray:
    """float32 to `bits` significant bits, to nearest: the rest is zeros, which compress."""
    drop = 24 - bits
    u = np.asarray(x, np.float32).view(np.uint32)
    whole = u + np.uint32((1 << (drop - 1)) - 1) + (u >> np.uint32(drop) & np.uint32(1))
    return np.where(np.isfinite(x), (whole & np.uint32(0xFFFFFFFF << drop & 0xFFFFFFFF)).view(np.float32), x)


def stepped(mean: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """The mean to the nearest multiple of a power of two: the largest up to sd / NOISE_STEPS; as it is where sd = 0."""
    with np.errstate(divide="ignore"):
        step = np.exp2(np.floor(np.log2(np.sqrt(variance.astype(np.float64)) / NOISE_STEPS)))
    safe = np.where(step > 0, step, 1.0)
    return np.where(step > 0, np.round(mean / safe) * safe, mean).astype(np.float32)


# ------------------------------------------------------------------------------------------ scenes


def scene_hash(path: str | Path) -> str:
    """SHA-256 of the scene as its file says it, 32 hexadecimal digits: camera, objects, lights; no names, no tolerance.

    Where the camera is to be calibrated, of its photos' bytes and of its board, not of what the calibration finds:
    another version of OpenCV changes that in its last digits.
    """
    file, (scene, asked) = find_scene(path), scene_and_photos(path)
    sun = msgspec.to_builtins(scene.sun)
    if "to_light" in (written := read_toml(file).get("sun", {})):
        sun["to_light"] = [float(x) for x in written["to_light"]]  # of any length
    seen: dict[str, Any] = {"sun": sun, "sky": scene.sky, "camera": asked or scene.camera}
    for kind in ("spheres", "planes"):  # what an object is called changes no pixel
        seen[kind] = [msgspec.structs.replace(thing, name=msgspec.UNSET) for thing in getattr(scene, kind)]
    total = hashlib.sha256(msgspec.json.encode(seen, order="sorted"))
    if asked:
        total.update(msgspec.json.encode(read_toml(file.parent / asked.board), order="sorted"))
        for photo in list_photos(file.parent / asked.photos):
            total.update(photo.name.encode() + hashlib.sha256(photo.read_bytes()).digest())
    return total.hexdigest()[:32]


def stale(old: Reference, path: str | Path) -> str | None:
    """Why the reference no longer fits the scene as it is written; None where it does."""
    if is_mitsuba(path):
        return _stale_file(old, path)
    scene, photos = scene_and_photos(path)
    if old.scene is None:
        return f"it was made from an image, but now there is a scene: {path}"
    # The reference's camera has its own size; one that was found in photos is none of the file's.
    before = old.scene.camera
    if old.header["scene_hash"] != scene_hash(path):
        now = scene.with_camera(before if photos else scene.camera.resized(*before.image_size))
        return f"the scene has changed since: {', '.join(now.differences(old.scene))}".rstrip(": ")
    if old.tolerance != scene.tolerance:
        return "the scene's tolerance has changed since"
    return None


def _stale_file(old: Reference, scene: str | Path) -> str | None:
    if not old.of_file:
        return f"it was made from something else, but now there is a Mitsuba file: {scene}"
    written = read_mitsuba(scene)
    if old.header["scene_hash"] == written.digest:
        return None
    before = msgspec.json.decode(old.header[FILES], type=dict[str, str])
    changed = [name for name in before | written.files if before.get(name) != written.files.get(name)]
    return f"{', '.join(changed) or 'the file itself'} changed since"


# ------------------------------------------------------------------------------------------ show


def listed(folder: str | Path) -> list[tuple[str, str]]:
    """(scene, rung) of every reference in the folder, by scene, then in the rungs' order."""
    found = ((f.parent.name, f.stem) for f in Path(folder).glob("*/*.exr") if f.stem in RUNGS)
    return sorted(found, key=lambda case: (case[0], list(RUNGS).index(case[1])))


OUTLINE = f"{'reference':<20} what it holds"
"""What stands above `outline`."""


def outline(reference: Reference) -> str:
    """What it is, in one line: size, samples per pixel, mean and noise, and Mitsuba's version."""
    header = reference.header
    name = f"{header['scene']}/{header['rung']}"
    return f"{name:<20} {reference.image!r}, Mitsuba {header.get('mitsuba', '–')}"


def show(reference: Reference) -> list[str]:
    """The same, and the header, one line each."""
    hidden = ("set_up", "scene", "rung", FILES)
    header = [f"  {k:<12} {v}" for k, v in reference.header.items() if k not in hidden and v != "None"]
    return [outline(reference), f"  {'path':<12} {reference.path}", *header]
