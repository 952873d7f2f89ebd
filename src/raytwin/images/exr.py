"""EXR: an Image with its variance, surface and provenance as parts of one file; and whatever others write."""

import contextlib
import io
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from raytwin.errors import InputError
from raytwin.images.image import Image, Surface
from raytwin.images.limits import check_size
from raytwin.safe_write import check_file, replacing

EXR_MAGIC = b"\x76\x2f\x31\x01"


def write_exr(path: str | os.PathLike, image: Image, header: Mapping[str, str] | None = None) -> None:
    """An Image as a multi-part EXR: `mean`, and `variance`, `depth`, `normal`, `id` where it has them.

    `header` adds text attributes (provenance) to the first part.
    """
    import OpenEXR

    parts = [("mean", _rgb(image.mean))]
    if image.alpha is not None:
        parts[0][1]["A"] = np.ascontiguousarray(image.alpha, np.float32)
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
            attributes["raytwin/samples"] = str(image.samples)
            if image.batches is not None:
                attributes |= {"raytwin/batches": str(image.batches)}
        built.append(OpenEXR.Part(attributes, channels, name))
    with replacing(path) as temporary, OpenEXR.File(built) as file:
        try:
            file.write(str(temporary))
        except RuntimeError as error:  # 'Cannot open image file "x". No such file or directory.'
            raise InputError(path, "a writable path", str(error).rpartition('". ')[2].rstrip(".")) from None


def _rgb(pixels: np.ndarray) -> dict[str, np.ndarray]:
    return {"RGB": np.ascontiguousarray(pixels, np.float32)}


def read_exr(path: str | os.PathLike, layer: str | None = None) -> tuple[Image, dict[str, str]]:
    """Read an EXR as an Image, and the text attributes under `raytwin/`.

    `layer` (`diffuse` for `diffuse.R`..., a single channel, or a part's name) chooses its colours. By default these are
    the first part's that has R, G, B or Y, with the variance and surface that `write_exr` wrote; else those of the only
    layer, or of Blender's Combined.
    """
    with _exr(path) as parts:
        first = next(iter(parts.values()))
        texts = {k: v for k, v in first.header.items() if isinstance(v, str)}
        header = {k.removeprefix("raytwin/"): v for k, v in texts.items() if k.startswith("raytwin/")}
        header.pop("parts", None)  # earlier versions wrote it
        name, channels, alpha = _chosen(path, parts, layer)
        mean = stack(channels)
        origin, display = (parts[name].header[key][0].tolist() for key in ("dataWindow", "displayWindow"))
        begins = origin[0] - display[0], origin[1] - display[1]
        if layer is not None:
            return Image(mean, samples=0, alpha=alpha, begins=begins), header
        variance, surface = _variance(path, parts), None
        if {"depth", "normal", "id"} <= parts.keys():
            normal, depth, ids = (parts[name].channels for name in ("normal", "depth", "id"))
            surface = Surface(
                ids["id"].pixels.astype(np.int32) - 1, depth["Z"].pixels, stack(normal[c].pixels for c in "XYZ")
            )
        batches = int(header["batches"]) if "batches" in header else None
        samples = _samples(first.header)
        layers = [variance, *(() if surface is None else (surface.ids, surface.depth, surface.normal))]
        sizes = [layer.shape[1::-1] for layer in (mean, *layers) if layer is not None]
        if len(set(sizes)) > 1:
            raise InputError(path, "parts of one size", ", ".join(f"{w} x {h}" for w, h in sizes))
    return Image(mean, variance, samples, surface, batches, alpha, begins=begins), header


def _samples(header: Mapping[str, Any]) -> int:
    """Samples per pixel, as raytwin and pbrt write them; 0 where there are none."""
    if "raytwin/samples" in header:
        return int(header["raytwin/samples"])
    with contextlib.suppress(TypeError, ValueError):
        return max(int(header.get("samplesPerPixel", 0)), 0)
    return 0


def _variance(path: str | os.PathLike, parts: Mapping[str, Any]) -> np.ndarray | None:
    """The variance of the mean: a part called `variance`, or the channels `variance.R`, .G and .B of any part."""
    if "variance" in parts:
        return stack(_chosen(path, {"variance": parts["variance"]}, None)[1])
    found = next((planes for one in parts.values() if (planes := _planes(one, "variance.", ("RGB",)))), None)
    return None if found is None else stack(found)


def split_layer(path: str | os.PathLike) -> tuple[Path, str | None]:
    """`render.exr:diffuse` as the path and the layer; None where there is a file of the whole name."""
    base, colon, layer = os.fspath(path).rpartition(":")
    exists = os.path.exists  # unlike Path's, it takes names that are too long for the system
    is_path = colon and not exists(path) and (exists(base) or any(c in base for c in "*?["))
    return (Path(base), layer) if is_path else (Path(path), None)


@contextlib.contextmanager
def _exr(path: str | os.PathLike) -> Iterator[dict[str, Any]]:
    """The parts by name, decoded; whatever goes wrong inside is an InputError."""
    with _opened(path, header_only=True) as parts:
        claimed = {part.name(): _claimed_size(path, part.header) for part in parts}
        # All parts are decoded together, so together they must fit. No channel takes more than 4 bytes.
        total = sum(w * h * 4 * len(p.header["channels"]) for p, (w, h) in zip(parts, claimed.values(), strict=True))
    for width, height in claimed.values():
        check_size(path, width, height, -(-total // max(width * height, 1)))
    with _opened(path) as parts:
        for part in parts:
            size = claimed[part.name()]
            if any(c.pixels is None or c.pixels.shape[::-1] != size for c in part.channels.values()):
                raise InputError(path, "an EXR file", f"a damaged one (part {part.name()} has another size)")
        # OpenEXR leaves out a part that it cannot read, and only prints a warning.
        if lost := claimed.keys() - {part.name() for part in parts}:
            raise InputError(path, "an EXR file", f"a damaged one (without its part {', '.join(sorted(lost))})")
        yield {part.name() or str(i): part for i, part in enumerate(parts)}


def _claimed_size(path: str | os.PathLike, header: Mapping[str, Any]) -> tuple[int, int]:
    """(width, height) that a part's header claims; InputError where not every pixel has one value per channel."""
    if "deep" in str(header["type"]):
        raise InputError(path, "an EXR file", "deep pixels, which have no single value")
    if few := [c.name for c in header["channels"] if (c.xSampling, c.ySampling) != (1, 1)]:
        raise InputError(path, "channels with a value for every pixel", f"{', '.join(few)} with fewer")
    corner, end = header["dataWindow"]
    return int(end[0]) - int(corner[0]) + 1, int(end[1]) - int(corner[1]) + 1


@contextlib.contextmanager
def _opened(path: str | os.PathLike, header_only: bool = False) -> Iterator[list[Any]]:
    """The parts as OpenEXR has them. From 3.5 on it survives all damage of tests/images/hostile.py."""
    import OpenEXR

    check_file(path, "an EXR file")
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # it prints what it cannot read
            opened = OpenEXR.File(str(path), separate_channels=True, header_only=header_only)
        with opened as file:
            yield file.parts
    except InputError:
        raise
    except Exception as error:  # OpenEXR raises whatever its C++ did
        raise InputError(path, "an EXR file", f"a damaged one ({' '.join(str(error).split())[:120]})") from None


def _chosen(
    path: str | os.PathLike, parts: Mapping[str, Any], layer: str | None
) -> tuple[str, list[np.ndarray], np.ndarray | None]:
    """Return the name of the part that has the colours asked for, three planes (H, W), and alpha."""
    layers = _layers(parts)
    is_part = layer in parts and layer not in layers  # some programs write each layer as a part
    if is_part:
        parts, layer = {str(layer): parts[str(layer)]}, None
    prefix = "" if layer is None else f"{layer}."
    for name, one in parts.items():
        channels = one.channels
        is_xyz = {"X", "Y", "Z"} <= channels.keys() and not is_part  # a part that is asked for may be a normal
        if layer is None and "R" not in channels and (is_xyz or {"RY", "BY"} & channels.keys()):
            raise InputError(path, "channels R, G, B", ", ".join(channels))
        found = _planes(one, prefix, ("RGB", "XYZ", "Y"))
        if not found and (layer in channels or (is_part and len(channels) == 1)):
            found = [channels[layer or next(iter(channels))].pixels]
        if found:
            alpha = channels[f"{prefix}A"].pixels.astype(np.float32) if f"{prefix}A" in channels else None
            return name, (found * 3)[:3], alpha
    if layer is not None:
        raise InputError(f"{path}: layer", f"one of {', '.join(layers) or 'none'}", layer)
    combined = [name for name in layers if name.rpartition(".")[2] == "Combined"]  # Blender's whole image
    if len(only := combined or layers) == 1:
        return _chosen(path, parts, only[0])
    names = [channel for one in parts.values() for channel in one.channels]
    choose = f"; choose one of the layers {', '.join(layers)}, as {Path(path).name}:{layers[0]}" if layers else ""
    raise InputError(path, "channels R, G, B (or Y)", (", ".join(names) or "none") + choose)


def _layers(parts: Mapping[str, Any]) -> list[str]:
    """Names before `.R`, `.G`, `.B`, as in `diffuse.R`."""
    names = ((one, name) for one in parts.values() for name in one.channels if name.endswith(".R"))
    return sorted({name[:-2] for one, name in names if _planes(one, name[:-1], ("RGB",))})


def _planes(part: Any, prefix: str, kinds: tuple[str, ...]) -> list[np.ndarray]:
    """Return the planes of the first of the kinds whose channels the part has under this prefix; none of none."""
    for kind in kinds:
        if all(prefix + c in part.channels for c in kind):
            return [part.channels[prefix + c].pixels for c in kind]
    return []


def stack(planes: Iterable[np.ndarray]) -> np.ndarray:
    """Three planes (H, W) as float32 (H, W, 3)."""
    return np.stack(list(planes), axis=-1, dtype=np.float32, casting="unsafe")
