"""Files in and out, and all validation of them. The only place where sRGB exists.

Reading: TOML into records, photos, EXR, any image (`read_image`). Writing: always under a temporary name first, then
renamed, so that an interrupted run leaves either the old file or the new one.
"""

import contextlib
import io
import math
import os
import re
import secrets
import tomllib
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
import tomli_w

from raytwin.errors import InputError
from raytwin.formats import EXR_MAGIC, check_size, pfm_bytes, read_exr_header, read_hdr, read_pfm
from raytwin.image import Image, Surface
from raytwin.scene import Camera, PhotoCamera, Plane, Pyramid, Scene, Sky, Sphere, Sun, Tolerance

T = TypeVar("T")

MAX_PIXELS = 400_000_000
"""A header that claims more than this is damaged or hostile: no camera makes it."""


# ---------------------------------------------------------------------------------------------- writing safely


@contextlib.contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """A temporary path beside `path`, renamed to it when the block ends well and removed when it does not.

    Links are followed. A device or a pipe (/dev/stdout) is handed out as it is: a rename would replace it.
    """
    real = Path(os.path.realpath(path))
    if real.is_dir():
        raise InputError(path, "a file to write", "a folder")
    temporary = real.parent / f".{real.stem}-{secrets.token_hex(4)}{real.suffix}"
    try:
        if real.exists() and not real.is_file():
            yield real
            return
        real.parent.mkdir(parents=True, exist_ok=True)
        temporary.touch(exist_ok=False)
        yield temporary
        temporary.replace(real)
    except OSError as error:
        raise InputError(path, "a place that can be written", error.strerror or error) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_text(path: str | os.PathLike, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: str | os.PathLike, value: Any) -> None:
    """`value` (plain data, records, arrays as lists) as indented JSON; NaN and infinity become null."""
    write_text(path, msgspec.json.format(msgspec.json.encode(plain(value)), indent=2).decode() + "\n")


def write_toml(path: str | os.PathLike, value: Mapping[str, Any], comment: str = "") -> None:
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    write_text(path, head + tomli_w.dumps(plain(value)))


def plain(value: Any) -> Any:
    """Records, dataclasses and arrays as dicts, lists and numbers."""
    if isinstance(value, msgspec.Struct):
        value = msgspec.structs.asdict(value)
    elif is_dataclass(value) and not isinstance(value, type):
        value = {f.name: getattr(value, f.name) for f in fields(value)}
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value


# ---------------------------------------------------------------------------------------------- TOML into records


def read_toml(path: str | os.PathLike) -> dict[str, Any]:
    path = Path(path)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(path, "a TOML file", "no such file") from None
    except OSError as error:
        raise InputError(path, "a TOML file", error.strerror) from None
    except UnicodeDecodeError as error:
        raise InputError(path, "UTF-8 text", f"byte {error.object[error.start]:#04x} at {error.start}") from None
    except (ValueError, RecursionError) as error:  # beside TOMLDecodeError: numbers too long, lists too deep
        raise InputError(path, "TOML", error) from None


def to_record(path: str | os.PathLike, data: Any, kind: type[T], prefix: str = "") -> T:
    """`data` (parsed TOML or JSON) as the record `kind`, or an InputError that names file, field and what was found."""
    try:
        record = msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        raise _readable(path, data, str(error), prefix) from None
    if bad := next(_not_finite(data, ""), None):
        raise InputError(f"{path}: {_join(prefix, bad[0])}", "a finite number", bad[1])
    return record


def _readable(path: str | os.PathLike, data: Any, message: str, prefix: str) -> InputError:
    """msgspec's `Expected ... - at `$.spheres[1].radius`` in this project's words, with the value that was found."""
    what, _, where = message.partition(" - at `$")
    field = where.rstrip("`").lstrip(".")
    found: Any = data
    for key in re.findall(r"[^.\[\]]+", field):
        try:
            found = found[int(key)] if isinstance(found, list) else found[key]
        except (KeyError, IndexError, TypeError, ValueError):
            break
    if match := re.match(r"Object contains unknown field `(.*)`", what):
        name = match[1]
        known = "only known keys"
        return InputError(f"{path}: {_join(prefix, _join(field, name))}", known, f"the unknown key {name!r}")
    if match := re.match(r"Object missing required field `(.*)`", what):
        return InputError(f"{path}: {_join(prefix, _join(field, match[1]))}", "a value", "nothing")
    what = re.sub(r"^Expected ", "", what)
    what = re.sub(r", got (`.*`|\d+)$", "", what)
    what = what.replace("`float`", "a number").replace("`int`", "a whole number").replace("`str`", "text")
    what = what.replace("`array`", "a list").replace("`object`", "a table").replace("`bool`", "true or false")
    what = re.sub(r"(\d)\.0\b", r"\1", what).replace("Number out of range", "a number that 64 bits hold")
    if field.endswith("radius"):  # the only bounded length
        what = what.replace("a number", "metres")
    shown = repr(found)
    return InputError(f"{path}: {_join(prefix, field)}", what, shown if len(shown) <= 60 else shown[:57] + "...")


def _join(prefix: str, field: str) -> str:
    return f"{prefix}.{field}" if prefix and field and not field.startswith("[") else f"{prefix}{field}"


def _not_finite(data: Any, where: str) -> Iterator[tuple[str, float]]:
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _not_finite(value, _join(where, key))
    elif isinstance(data, list):
        for i, value in enumerate(data):
            yield from _not_finite(value, f"{where}[{i}]")
    elif isinstance(data, float) and not math.isfinite(data):
        yield where, data


# ---------------------------------------------------------------------------------------------- scenes and cameras


class _SceneFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    camera: dict[str, Any]
    spheres: tuple[Sphere, ...] = ()
    planes: tuple[Plane, ...] = ()
    pyramids: tuple[Pyramid, ...] = ()
    sun: Sun = Sun(to_light=(0.0, 0.0, 1.0), irradiance=(0.0, 0.0, 0.0))
    sky: Sky = Sky()
    tolerance: Tolerance = Tolerance()


def read_scene(path: str | os.PathLike) -> Scene:
    """A scene's folder, or its scene.toml, as a Scene; the camera stays a PhotoCamera where it is to be calibrated."""
    path = Path(path)
    file = path / "scene.toml" if path.is_dir() else path
    if not file.exists() and path.suffix != ".toml":
        raise InputError(
            path, "a scene's folder, holding scene.toml", "no such folder" if not path.exists() else "none"
        )
    data = read_toml(file)
    parts = to_record(file, data, _SceneFile)
    kind = PhotoCamera if "photos" in parts.camera else Camera
    camera = to_record(file, parts.camera, kind, "camera")
    if isinstance(camera, Camera):
        check_camera(camera, f"{file}: camera.")
    if not math.hypot(*parts.sun.to_light) > 0:
        raise InputError(f"{file}: sun.to_light", "a direction", "the zero vector")
    for i, plane in enumerate(parts.planes):
        u, v = np.asarray(plane.half_u), np.asarray(plane.half_v)
        lengths = np.linalg.norm(u) * np.linalg.norm(v)
        if not lengths > 0:
            raise InputError(
                f"{file}: planes[{i}]", "half_u and half_v longer than 0 m", f"{plane.half_u}, {plane.half_v}"
            )
        if abs(u @ v) > 1e-6 * lengths:
            degrees = math.degrees(math.acos(np.clip(u @ v / lengths, -1, 1)))
            raise InputError(
                f"{file}: planes[{i}].half_v", "a vector perpendicular to half_u", f"{degrees:.4g} degrees"
            )
    name = file.resolve().parent.name + ("" if file.name == "scene.toml" else f"-{file.stem}")
    lights = parts.sun, parts.sky
    return Scene(name, camera, parts.spheres, parts.planes, *lights, parts.tolerance, str(file.parent), parts.pyramids)


def upright(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """The pixels turned as the EXIF orientation (1 to 8) asks a viewer to turn them."""
    if orientation in (2, 4, 5, 7):
        pixels = pixels[:, ::-1]
    quarter_turns = {3: 2, 4: 2, 5: 1, 6: 3, 7: 3, 8: 1}.get(orientation, 0)
    return np.rot90(pixels, quarter_turns)


def check_camera(camera: Camera, where: str) -> None:
    """Raise InputError unless K is [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with positive foci and R is a rotation.

    `where` is put before the field's name: `scenes/desk/scene.toml: camera.`.
    """
    if camera.width * camera.height > MAX_PIXELS:
        raise InputError(
            f"{where}image_size", f"at most {MAX_PIXELS / 1e6:.0f} megapixels", f"{camera.width} x {camera.height}"
        )
    if not (camera.fx > 0 and camera.fy > 0):
        raise InputError(f"{where}K", "focal lengths > 0 px", f"{camera.fx}, {camera.fy}")
    if camera.K[0][1] != 0 or camera.K[1][0] != 0 or tuple(camera.K[2]) != (0, 0, 1):
        raise InputError(f"{where}K", "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]", camera.K)
    R = np.asarray(camera.R_cam_board)
    off = float(np.abs(R @ R.T - np.eye(3)).max())
    if off > 1e-6 or np.linalg.det(R) < 0:
        found = "a mirroring" if off <= 1e-6 else f"R R^T off the identity by {off:.2g}"
        raise InputError(f"{where}R_cam_board", "a rotation matrix", found)


def read_camera(path: str | os.PathLike) -> Camera:
    """A camera.toml, as `raytwin calibrate -o` writes it."""
    camera = to_record(path, read_toml(path), Camera)
    check_camera(camera, f"{path}: ")
    return camera


def write_camera(path: str | os.PathLike, camera: Camera, comment: str = "") -> None:
    write_toml(path, plain(camera), comment)


# ---------------------------------------------------------------------------------------------- sRGB, photos, PNG


def srgb_encode(linear: np.ndarray) -> np.ndarray:
    """Linear [0, 1] to sRGB's [0, 1], clipped; IEC 61966-2-1."""
    x = np.clip(np.nan_to_num(linear, nan=0.0, posinf=1.0, neginf=0.0), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.power(np.maximum(x, 1e-9), 1 / 2.4) - 0.055)


def srgb_decode(encoded: np.ndarray) -> np.ndarray:
    """sRGB's [0, 1] to linear [0, 1]; IEC 61966-2-1."""
    x = np.asarray(encoded)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def to_bytes(linear: np.ndarray) -> np.ndarray:
    """Linear radiance (H, W, 3), 1 is white, as sRGB uint8."""
    return np.round(srgb_encode(linear) * 255).astype(np.uint8)


_DECODE = srgb_decode(np.arange(256) / 255).astype(np.float32)


def from_bytes(pixels: np.ndarray) -> np.ndarray:
    """sRGB uint8 as linear float32 in [0, 1]."""
    return _DECODE[pixels]


def photo_size(path: str | os.PathLike) -> tuple[int, int]:
    """(width, height) of a photo from its header alone."""
    with _opened(path) as photo:
        return photo.size


def read_photo(path: str | os.PathLike) -> np.ndarray:
    """A PNG or JPEG as sRGB uint8 (H, W, 3), in the sensor's own pixel grid.

    An EXIF orientation is not applied: it turns the picture for the eye, but the lens and its K stay with the sensor.
    """
    with _opened(path) as photo:
        return np.asarray(photo.convert("RGB"))


def read_grey(path: str | os.PathLike) -> np.ndarray:
    """A PNG or JPEG as grey uint8 (H, W), Rec. 601 luma of sRGB, in the sensor's own pixel grid.

    A JPEG stores luma apart from colour: reading it alone takes a third of `read_photo`'s time.
    """
    with _opened(path) as photo:
        photo.draft("L", photo.size)
        return np.asarray(photo.convert("L"))


def photo_orientation(path: str | os.PathLike) -> int:
    """The EXIF orientation, 1 (upright) to 8; 1 where the file says nothing."""
    with _opened(path) as photo:
        return int(photo.getexif().get(0x0112, 1) or 1)


@contextlib.contextmanager
def _opened(path: str | os.PathLike) -> Iterator[Any]:
    from PIL import Image as Pillow  # 40 ms: not at import

    if Path(path).is_dir():
        raise InputError(path, "a photo (JPEG or PNG)", "a folder")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Pillow.DecompressionBombWarning)
            # From memory: of a file on disk, Pillow asks for as many bytes at once as a damaged chunk claims to have.
            with Pillow.open(io.BytesIO(Path(path).read_bytes()), formats=("JPEG", "PNG")) as photo:
                check_size(path, *photo.size, 12, MAX_PIXELS)
                yield photo
    except (FileNotFoundError, PermissionError) as error:
        raise InputError(path, "a photo (JPEG or PNG)", error.strerror.lower()) from None
    except Pillow.UnidentifiedImageError:
        raise InputError(path, "a photo (JPEG or PNG)", "a file of another kind, or a damaged header") from None
    except Pillow.DecompressionBombError as error:
        raise InputError(path, "a photo of a size that a camera makes", error) from None
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError(path, "a whole photo (JPEG or PNG)", f"a damaged one ({error})") from None


def write_picture(path: str | os.PathLike, pixels: np.ndarray, quality: int = 92) -> None:
    """sRGB uint8 (H, W) or (H, W, 3) as PNG or, by the name's ending, JPEG."""
    from PIL import Image as Pillow

    suffix = Path(path).suffix.lower()
    if suffix not in (".png", ".jpg", ".jpeg"):
        raise InputError(path, "a name that ends in .png, .jpg or .jpeg", suffix or "no ending")
    options = {"compress_level": 6} if suffix == ".png" else {"quality": quality, "subsampling": 0}
    with replacing(path) as temporary:
        Pillow.fromarray(np.ascontiguousarray(pixels)).save(temporary, **options)


# ---------------------------------------------------------------------------------------------- EXR


def write_exr(path: str | os.PathLike, image: Image, header: Mapping[str, str] | None = None) -> None:
    """An Image as a multi-part EXR: `mean`, and `variance`, `depth`, `normal`, `id` where it has them.

    `header` adds text attributes (provenance) to the first part.
    """
    import OpenEXR

    parts = [("mean", _rgb(image.mean))]
    if image.variance is not None:
        parts.append(("variance", _rgb(image.variance)))
    if image.surface is not None:
        s = image.surface
        parts.append(("depth", {"Z": np.ascontiguousarray(s.depth, np.float32)}))
        normal = np.asarray(s.normal, np.float32)
        parts.append(("normal", {c: np.ascontiguousarray(normal[..., i]) for i, c in enumerate("XYZ")}))
        # EXR's integers are unsigned: the background's -1 is stored as 0, every object as its index + 1.
        parts.append(("id", {"id": np.ascontiguousarray(s.ids + 1, np.uint32)}))
    built = []
    for name, channels in parts:
        attributes: dict[str, Any] = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        if name == "mean":
            # The image's own numbers last: a header taken from another file must not overrule them.
            attributes |= {f"raytwin/{k}": str(v) for k, v in (header or {}).items() if k != "batches"}
            attributes |= {"raytwin/samples": str(image.samples), "raytwin/parts": " ".join(n for n, _ in parts)}
            if image.batches is not None:
                attributes |= {"raytwin/batches": str(image.batches)}
        built.append(OpenEXR.Part(attributes, channels, name))
    with replacing(path) as temporary, OpenEXR.File(built) as file:
        file.write(str(temporary))


def _rgb(pixels: np.ndarray) -> dict[str, np.ndarray]:
    return {"RGB": np.ascontiguousarray(pixels, np.float32)}


def read_exr(path: str | os.PathLike) -> tuple[Image, dict[str, str]]:
    """An EXR as an Image and the text attributes under `raytwin/`.

    Reads what `write_exr` writes, and any other EXR with RGB (or one grey) channels in its first part.
    """
    with _exr(path) as parts:
        first = next(iter(parts.values()))
        texts = {k: v for k, v in first.header.items() if isinstance(v, str)}
        header = {k.removeprefix("raytwin/"): v for k, v in texts.items() if k.startswith("raytwin/")}
        # OpenEXR leaves out a part that it cannot read, and only prints a warning.
        if lost := set(header.pop("parts", "").split()) - parts.keys():
            raise InputError(path, "an EXR file", f"a damaged one (without its part {', '.join(sorted(lost))})")
        mean = _colours(path, parts)
        variance = _colours(path, {"variance": parts["variance"]}) if "variance" in parts else None
        surface = None
        if {"depth", "normal", "id"} <= parts.keys():
            normal, depth, ids = (parts[name].channels for name in ("normal", "depth", "id"))
            surface = Surface(
                ids["id"].pixels.astype(np.int32) - 1, depth["Z"].pixels, _stack(normal[c].pixels for c in "XYZ")
            )
        batches = int(header["batches"]) if "batches" in header else None
        samples = int(header.get("samples", 1))
        layers = [variance, *(() if surface is None else (surface.ids, surface.depth, surface.normal))]
        sizes = [layer.shape[1::-1] for layer in (mean, *layers) if layer is not None]
        if len(set(sizes)) > 1:
            raise InputError(path, "parts of one size", ", ".join(f"{w} x {h}" for w, h in sizes))
    return Image(mean, variance, samples, surface, batches), header


@contextlib.contextmanager
def _exr(path: str | os.PathLike) -> Iterator[dict[str, Any]]:
    """The parts by name, decoded; whatever goes wrong inside is an InputError."""
    import OpenEXR

    if not Path(path).is_file():
        raise InputError(path, "an EXR file", "a folder" if Path(path).is_dir() else "no such file")
    claimed = read_exr_header(path, MAX_PIXELS)
    if bad := [channel for part in claimed for channel in part.subsampled]:
        raise InputError(path, "channels with a value for every pixel", f"{', '.join(bad)} with fewer")
    try:
        # OpenEXR leaves out a part that it cannot read, and only prints a warning.
        with contextlib.redirect_stdout(io.StringIO()):
            opened = OpenEXR.File(str(path), separate_channels=True)
        with opened as file:
            if len(file.parts) < len(claimed):
                lost = ", ".join(p.name for p in claimed if p.name not in {q.name() for q in file.parts})
                raise InputError(path, "an EXR file", f"a damaged one (without its part {lost})")
            for part, claim in zip(file.parts, claimed, strict=True):
                if any(c.pixels is None or c.pixels.shape[::-1] != claim.size for c in part.channels.values()):
                    raise InputError(path, "an EXR file", f"a damaged one (part {claim.name} has another size)")
            yield {p.name() or str(i): p for i, p in enumerate(file.parts)}
    except InputError:
        raise
    except Exception as error:  # OpenEXR raises whatever its C++ did
        raise InputError(path, "an EXR file", f"a damaged one ({' '.join(str(error).split())[:120]})") from None


def _colours(
    path: str | os.PathLike, parts: Mapping[str, Any], part: str | None = None, layer: str | None = None
) -> np.ndarray:
    """(H, W, 3) float32 of the first part with colours; of a named part and layer where asked for."""
    if part is not None:
        chosen = parts.get(part) or dict(zip(map(str, range(len(parts))), parts.values(), strict=True)).get(part)
        if chosen is None:
            raise InputError(f"{path}: part", f"one of {', '.join(parts)}", part)
        parts = {part: chosen}
    for channels in (p.channels for p in parts.values()):
        if layer is not None:
            named = {k.removeprefix(f"{layer}."): c for k, c in channels.items() if k.startswith(f"{layer}.")}
            found = _triple(named, ("RGB", "XYZ", "Y")) or ([channels[layer]] if layer in channels else None)
        else:
            found = _triple(channels, ("RGB", "Y") if part is None else ("RGB", "XYZ", "Y"))
        if found:
            return _stack((found * 3)[:3][i].pixels for i in range(3))
    layers = _layers(parts)
    if layer is not None:
        raise InputError(f"{path}: layer", f"one of {', '.join(layers) or 'none'}", layer)
    if len(layers) == 1:
        return _colours(path, parts, None, layers[0])
    if part is not None and len(channels) == 1:
        return _colours(path, parts, None, next(iter(channels)))
    names = [c for p in parts.values() for c in p.channels]
    choose = f"; choose one of the layers {', '.join(layers)}" if layers else ""
    raise InputError(path, "channels R, G, B (or Y)", (", ".join(names) or "none") + choose)


def _triple(channels: Mapping[str, Any], kinds: tuple[str, ...]) -> list[Any] | None:
    return next(([channels[c] for c in kind] for kind in kinds if all(c in channels for c in kind)), None)


def _layers(parts: Mapping[str, Any]) -> list[str]:
    """Names before `.R`, `.G`, `.B`, as in `diffuse.R`."""
    names = {c for p in parts.values() for c in p.channels}
    return sorted(n[:-2] for n in names if n.endswith(".R") and {n[:-1] + "G", n[:-1] + "B"} <= names)


def _stack(planes: Iterable[np.ndarray]) -> np.ndarray:
    """Three planes (H, W) as float32 (H, W, 3)."""
    planes = list(planes)
    out = np.empty((*planes[0].shape, 3), np.float32)
    for i, plane in enumerate(planes):
        out[..., i] = plane
    return out


# ---------------------------------------------------------------------------------------------- any image


def read_image(path: str | os.PathLike, part: str | None = None, layer: str | None = None) -> Image:
    """EXR, PFM, Radiance HDR, PNG (8 and 16 bit) or JPEG as an Image: told apart by their first bytes.

    `part` (name or number) and `layer` (`diffuse` for `diffuse.R`..., or a single channel) choose within an EXR; where
    nothing is chosen, the first part with colours counts, with the variance and the surface that `write_exr` wrote.
    Grey becomes three equal channels; alpha is left out; PNG and JPEG are taken for sRGB. An EXR's pixels are those of
    its data window.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "an image file", "a folder" if path.is_dir() else "no such file")
    try:
        with path.open("rb") as file:
            start = file.read(8)
        kind = next((kind for magic, kind in MAGIC.items() if start.startswith(magic)), None)
        if kind is None:
            raise InputError(path, "an image: EXR, PFM, HDR, PNG or JPEG", "a file of another kind")
        if kind != "EXR" and (part is not None or layer is not None):
            raise InputError(path, "an EXR, which has parts and layers", kind)
        if kind == "EXR":
            if part is None and layer is None:
                return read_exr(path)[0]
            with _exr(path) as parts:
                return Image(_colours(path, parts, part, layer))
        if kind in ("PFM", "HDR"):
            pixels = (read_pfm if kind == "PFM" else read_hdr)(path, MAX_PIXELS)
        else:
            pixels = _read_deep_png(path) if kind == "PNG" else None
            pixels = from_bytes(read_photo(path)) if pixels is None else pixels
    except OSError as error:
        raise InputError(path, "an image file", error.strerror or error) from None
    return Image(pixels if pixels.ndim == 3 else _stack([pixels] * 3))


def read_origin(path: str | os.PathLike, part: str | None = None) -> tuple[int, int]:
    """Where on the display an EXR's first (or named) part begins, (x, y) in pixels; (0, 0) for any other image."""
    path = Path(path)
    with path.open("rb") as file:
        if file.read(4) != EXR_MAGIC:
            return 0, 0
    parts = read_exr_header(path, MAX_PIXELS)
    chosen = next((p for i, p in enumerate(parts) if part in (p.name, str(i))), parts[0])
    return chosen.data.x0 - chosen.display.x0, chosen.data.y0 - chosen.display.y0


MAGIC = {
    EXR_MAGIC: "EXR", b"PF": "PFM", b"Pf": "PFM", b"#?": "HDR", b"\x89PNG": "PNG", b"\xff\xd8": "JPEG",
}  # fmt: skip


def _read_deep_png(path: Path) -> np.ndarray | None:
    """A PNG of 16 bits as linear float32, (H, W) or (H, W, 3); None where it has fewer."""
    with _opened(path) as photo:
        raw = photo.tile[0].args if photo.tile else None
        raw = raw if isinstance(raw, str) else raw[0] if raw else ""
        if not raw.endswith(";16B"):
            return None
        if photo.mode == "I;16":
            return srgb_decode(np.asarray(photo, np.float32) / np.float32(65535)).astype(np.float32)
        # Pillow keeps the first byte of each pair; told that the pairs are swapped, it keeps the second.
        high = np.asarray(photo)[..., :3]
    if raw not in ("RGB;16B", "RGBA;16B"):
        return from_bytes(high)
    with _opened(path) as photo:
        photo.tile = [tile._replace(args=raw.replace("16B", "16L")) for tile in photo.tile]
        low = np.asarray(photo)[..., :3]
    return _decode_pairs(high, low)


def _decode_pairs(high: np.ndarray, low: np.ndarray) -> np.ndarray:
    codes = np.arange(1 << 16, dtype=np.float32) / np.float32(65535)
    table = srgb_decode(codes).astype(np.float32)
    return table[high.astype(np.uint16) << 8 | low]


def write_image(path: str | os.PathLike, image: Image) -> None:
    """By the name's ending: EXR with all that the image has; PFM its mean; PNG or JPEG its mean as 8-bit sRGB."""
    suffix = Path(path).suffix.lower()
    if suffix == ".exr":
        write_exr(path, image)
    elif suffix == ".pfm":
        with replacing(path) as temporary:
            temporary.write_bytes(pfm_bytes(image.mean))
    else:
        write_picture(path, to_bytes(image.mean))
