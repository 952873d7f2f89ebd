"""Damaged and adversarial image files, and a child process of limited memory that reads them.

`python tests/images/hostile.py FOLDER RESULTS` writes what came of reading each file there.
"""

import io
import resource
import signal
import struct
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

GIB = 1 << 30
SECONDS = 20
"""Of the processor's time: a single file that takes longer hangs, however busy the machine is."""


# ------------------------------------------------------------------------------------------ sound files


def sound_files() -> dict[str, bytes]:
    """Small files of every kind that is read, by name."""
    import OpenEXR
    from PIL import Image as Pillow

    from raytwin.images.exr import write_exr
    from raytwin.images.image import Image, Surface
    from raytwin.images.image_formats import write_image

    rng = np.random.default_rng(20)
    a = rng.random((21, 33, 3)).astype(np.float32)
    a[4:9] = 0.25
    made: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        def exr(key: str, parts: list) -> None:
            with OpenEXR.File(parts) as file:
                file.write(str(folder / "x.exr"))
            made[f"{key}.exr"] = (folder / "x.exr").read_bytes()

        for key in ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB"):
            head = {"compression": getattr(OpenEXR, f"{key}_COMPRESSION")}
            half = {c: np.ascontiguousarray(a[..., i], np.float16) for i, c in enumerate("RGB")}
            exr(f"lines_{key}", [OpenEXR.Part(head | {"type": OpenEXR.scanlineimage}, {"RGB": a}, "x")])
            tiles = OpenEXR.TileDescription()
            tiles.xSize, tiles.ySize = 16, 8
            exr(f"tiles_{key}", [OpenEXR.Part(head | {"type": OpenEXR.tiledimage, "tiles": tiles}, half, "x")])
        layers = {"diffuse.R": a[..., 0], "diffuse.G": a[..., 1], "diffuse.B": a[..., 2], "Z": a[..., 0]}
        layers = {k: np.ascontiguousarray(v) for k, v in layers.items()} | {"id": np.ones((21, 33), np.uint32)}
        exr("layers", [OpenEXR.Part({"type": OpenEXR.scanlineimage}, layers, "x")])
        surface = Surface(np.zeros((21, 33), np.int32), a[..., 0], a)
        write_exr(folder / "x.exr", Image(a, a, 4, surface, 4))
        made["parts.exr"] = (folder / "x.exr").read_bytes()
        write_image(folder / "x.pfm", Image(a))
        made["colour.pfm"] = (folder / "x.pfm").read_bytes()
    made["big_endian_grey.pfm"] = b"Pf\n33 21\n1.0\n" + a[::-1, :, 0].astype(">f4").tobytes()
    codes = np.round(a * 255).astype(np.uint8)
    for key, mode in (("rgb", "RGB"), ("grey", "L"), ("palette", "P"), ("rgba", "RGBA"), ("bits", "1")):
        Pillow.fromarray(codes).convert(mode).save(buffer := io.BytesIO(), "PNG")
        made[f"{key}.png"] = buffer.getvalue()
    for key, progressive in (("base", False), ("progressive", True)):
        Pillow.fromarray(codes).save(buffer := io.BytesIO(), "JPEG", progressive=progressive)
        made[f"{key}.jpg"] = buffer.getvalue()
    for key in ("PPM", "TIFF", "BMP", "WEBP"):
        Pillow.fromarray(codes).save(buffer := io.BytesIO(), key)
        made[f"rgb.{key.lower()}"] = buffer.getvalue()
    made["text.ppm"] = b"P3\n33 21\n255\n" + b" ".join(b"%d" % x for x in codes.ravel())
    return made


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width: int, height: int, raw: bytes) -> bytes:
    """A PNG that claims a size; `raw` are its filtered rows, as many as there are."""
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b"")


# ------------------------------------------------------------------------------------------ damage

COUNTS = (
    0, 1, 2, 3, 7, 255, 256, 4096, 32767, 32768, 65535, 65536, 10**6, 2**24, 2**28, 2**30, 2**31 - 1, 2**31, 2**32 - 1,
)  # fmt: skip
"""What breaks code that multiplies sizes."""


def hostile_files(count: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """(name, content): crafted ones first, then `count` in all by seeded damage to sound ones."""
    sound = sound_files()
    names = sorted(sound)
    rng = np.random.default_rng(seed)
    crafted = list(crafted_files(sound))
    for i, (name, data) in enumerate(crafted[:count]):
        yield f"{i:05d}_crafted_{name}", data
    for i in range(min(len(crafted), count), count):
        name = names[i % len(names)]
        data = sound[name]
        for _ in range(int(rng.integers(1, 5))):
            data = damaged(data, rng, sound[names[int(rng.integers(len(names)))]])
        if name.endswith("png") and rng.random() < 0.6:
            data = checksummed(data)
        yield f"{i:05d}_{name}", data


def damaged(data: bytes, rng: np.random.Generator, other: bytes) -> bytes:
    """Cut, spoilt, counted wrongly, with something more or less in the middle, or with another file's end."""
    at, size, value = place(data, rng), int(rng.integers(1, 40)), COUNTS[int(rng.integers(len(COUNTS)))]
    order = "<>"[int(rng.integers(2))]
    kinds = (
        lambda: data[:at],
        lambda: data[:at] + bytes([data[at] ^ 1 << int(rng.integers(8))]) + data[at + 1 :] if data else data,
        lambda: patched(data, at, rng.bytes(4)),
        lambda: patched(data, at, struct.pack(f"{order}I", value)),
        lambda: data.replace((b"33", b"21")[int(rng.integers(2))], str(value).encode(), 1),
        lambda: data[:at] + rng.bytes(size) + data[at:],
        lambda: data[:at] + data[at + size :],
        lambda: data[:at] + data[at : at + 5 * size] + data[at:],
        lambda: data[:at] + other[place(other, rng) :],
    )
    return kinds[int(rng.integers(len(kinds)))]()


def place(data: bytes, rng: np.random.Generator) -> int:
    """Half of the time among the first 400 bytes, where the counts stand."""
    return int(rng.integers(max(1, min(len(data), 400 if rng.random() < 0.5 else len(data)))))


def checksummed(data: bytes) -> bytes:
    """The PNG with right checksums, so that the damage reaches what they protect."""
    out, at = bytearray(data[:8]), 8
    while at + 12 <= len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        if size > len(data) - at - 12:
            break
        out += chunk(data[at + 4 : at + 8], data[at + 8 : at + 8 + size])
        at += 12 + size
    return bytes(out) + data[at:]


FIELDS = {
    "dataWindow": b"box2i", "displayWindow": b"box2i", "chunkCount": b"int", "tiles": b"tiledesc",
    "lineOrder": b"lineOrder", "compression": b"compression",
}  # fmt: skip
SIZES = ((20000, 20000), (60000, 60000), (2**31 - 1, 2**31 - 1), (0, 5), (1, 2**31 - 1), (2**31 - 1, 1))


def patched(data: bytes, at: int, new: bytes) -> bytes:
    return data[:at] + new + data[at + len(new) :]


def crafted_exrs(sound: dict[str, bytes]) -> Iterator[tuple[str, bytes]]:
    """Headers that lie, one field at a time."""
    for key in ("lines_ZIP", "lines_NO", "lines_DWAB", "tiles_ZIP", "parts"):
        data = sound[f"{key}.exr"]
        for field, kind in FIELDS.items():
            mark = field.encode() + b"\0" + kind + b"\0"
            start = data.find(mark) + len(mark) + 4
            if mark not in data:
                continue
            size = int.from_bytes(data[start - 4 : start], "little")
            for k in range(0, size - size % 4 or 1, 4):
                for value in COUNTS[1::2] if size >= 4 else (9, 11, 12, 200):
                    new = value.to_bytes(4, "little")[: min(4, size)]
                    yield f"{field}{k}_{value}_{key}.exr", patched(data, start + k, new)
            yield f"{field}_long_{key}.exr", patched(data, start - 4, b"\xff\xff\xff\x7f")
        at = data.find(b"dataWindow\0box2i\0") + 21
        for name, window in (("huge", (0, 0, 19999, 19999)), ("whole", (-(2**31), -(2**31), 2**31 - 1, 2**31 - 1))):
            yield f"{name}_{key}.exr", patched(data, at, struct.pack("<4i", *window))
        at = data.find(b"channels\0chlist\0")
        for k, value in ((22, 7), (22, 0), (30, 0), (30, 2**31 - 1), (34, 2)):
            yield f"channel{k}_{value}_{key}.exr", patched(data, at + k, struct.pack("<I", value))
        yield f"empty_{key}.exr", data[: data.find(b"\0\0", 300)]


def crafted_files(sound: dict[str, bytes]) -> Iterator[tuple[str, bytes]]:
    """The same of every kind."""
    yield from crafted_exrs(sound)
    for key in ("rgb", "grey", "bits"):
        data = sound[f"{key}.png"]
        at = data.find(b"IDAT") - 4
        for length in (2**28, 2**31 - 1, 2**32 - 1):
            yield f"IDAT_{length}_{key}.png", patched(data, at, length.to_bytes(4, "big"))
    rows = bytes(3 * 20000 + 1)
    for width, height in SIZES:
        yield f"bomb_{width}x{height}.png", png(width, height, rows * 200)
        yield f"few_{width}x{height}.png", png(width, height, b"\0" * 10)
        for mark in (b"\n-1.0\n", b"\n1e400\n", b"\n-0\n", b"\nnan\n"):
            yield f"size_{width}x{height}_{len(mark)}.pfm", f"PF\n{width} {height}".encode() + mark + bytes(1000)
        jpeg = sound["base.jpg"]
        sides = struct.pack(">HH", height & 0xFFFF, width & 0xFFFF)
        yield f"size_{width}x{height}.jpg", patched(jpeg, jpeg.find(b"\xff\xc0") + 5, sides)


# ------------------------------------------------------------------------------------------ reading them


def read_all(folder: Path, results: Path) -> None:
    """Write a line `name outcome` for every file; the process may take 1 GiB more than it has now."""
    import OpenEXR  # noqa: F401 (before the limit)
    from PIL import Image as Pillow

    from raytwin.errors import InputError
    from raytwin.images.image import Image
    from raytwin.images.image_formats import read_image

    Pillow.init()
    read_image(next(p for p in sorted(folder.glob("sound*.exr"))))
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    limit = GIB + 1024 * int(status["VmSize"].split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    with results.open("w", buffering=1, encoding="utf-8") as out:
        for path in sorted(folder.iterdir()):
            out.write(f"{path.name} ")
            signal.setitimer(signal.ITIMER_PROF, SECONDS)
            try:
                image = read_image(path)
            except InputError as error:
                text = str(error)
                # A refusal that came from the allocator came too late.
                late = any(word in text.lower() for word in ("alloc", "out of memory", "memoryerror"))
                outcome = "LATE" if late else "error" if text.isprintable() else "UNPRINTABLE"
                out.write(f"{outcome} {text!a}\n")
            except BaseException as error:
                out.write(f"RAISED {error!a:.300}\n")
            else:
                sane = isinstance(image, Image) and image.mean.dtype == np.float32 and image.mean.shape[2:] == (3,)
                out.write(f"{'image' if sane else 'WRONG'} {image.shape}\n")
            signal.setitimer(signal.ITIMER_PROF, 0)
    # Not ru_maxrss, which begins at what the parent held when it forked.
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    results.with_suffix(".peak").write_text(status["VmHWM"].split()[0])


def judge(folder: Path, results: Path) -> tuple[dict[str, str], int]:
    """(outcome by file name, peak KiB of memory): a child reads them; the file that kills it is a CRASH."""
    files = sorted(p.name for p in folder.iterdir())
    child = subprocess.run(
        [sys.executable, "-X", "faulthandler", __file__, str(folder), str(results)],
        capture_output=True,
        text=True,
        errors="replace",
    )
    lines = results.read_text(encoding="utf-8").splitlines() if results.exists() else []
    found = dict(line.split(" ", 1) for line in lines)
    if child.returncode or child.stdout:  # OpenEXR's C part warns on standard error
        last = next((n for n in files if not found.get(n)), files[-1])
        found[last] = f"CRASH {child.returncode}: {child.stdout[-400:]}{child.stderr[-400:]}"
    peak = results.with_suffix(".peak")
    return found, int(peak.read_text()) if peak.exists() else 0


if __name__ == "__main__":
    read_all(Path(sys.argv[1]), Path(sys.argv[2]))
