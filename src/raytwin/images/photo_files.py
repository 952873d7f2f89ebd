"""Photos and pictures: sRGB in, sRGB out. The only place where sRGB exists."""

import base64
import contextlib
import io
import os
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from raytwin.errors import InputError
from raytwin.images.limits import check_size
from raytwin.safe_write import check_file, replacing


def srgb_encode(linear: np.ndarray) -> np.ndarray:
    """Linear [0, 1] to sRGB's [0, 1], clipped; IEC 61966-2-1."""
    x = np.clip(np.nan_to_num(linear, nan=0.0, posinf=1.0, neginf=0.0), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.power(np.maximum(x, 1e-9), 1 / 2.4) - 0.055)


def srgb_decode(encoded: np.ndarray) -> np.ndarray:
    """sRGB's [0, 1] to linear [0, 1]; IEC 61966-2-1."""
    x = np.asarray(encoded)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def to_bytes(linear: np.ndarray) -> np.ndarray:
    """Linear radiance (H, W, 3), 1 is white, as sRGB uint8. NaN is black."""
    return np.rint(255 * srgb_encode(np.asarray(linear, np.result_type(linear, np.float32)))).astype(np.uint8)


_DECODE = srgb_decode(np.arange(256) / 255).astype(np.float32)


def from_bytes(pixels: np.ndarray) -> np.ndarray:
    """sRGB uint8 as linear float32 in [0, 1]."""
    return _DECODE[pixels]


PHOTOS = {
    ".jpg": "JPEG", ".jpeg": "JPEG", ".png": "PNG", ".webp": "WEBP", ".tif": "TIFF", ".tiff": "TIFF", ".bmp": "BMP",
}  # fmt: skip
"""Endings of the photos that are read, and Pillow's name of their format."""

UNREAD = (
    ".heic", ".heif", ".avif", ".jxl", ".jp2", ".gif", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".rw2", ".orf",
)  # fmt: skip
"""Endings of photos that are not read: a folder's are listed, so that whoever opens them says so."""

A_PHOTO = "photo (JPEG, PNG, WebP, TIFF or BMP)"
PICTURES = (*sorted({*PHOTOS.values()}), "PPM")
"""What of 8 bits per channel is taken for an image, as Pillow calls it."""


def list_photos(folder: str | Path) -> list[Path]:
    """The photos of a folder, by name, and those of UNREAD; a photo's file stands for itself.

    Raises InputError where there are none.
    """
    folder = Path(folder)
    if folder.is_file() and folder.suffix.lower() in (*PHOTOS, *UNREAD):
        return [folder]
    if not folder.is_dir():
        raise InputError(folder, "a folder of photos", "no such folder" if not folder.exists() else "a file")
    found = sorted(p for p in folder.iterdir() if p.suffix.lower() in (*PHOTOS, *UNREAD))
    if not found:
        raise InputError(folder, f"photos ({', '.join(PHOTOS)})", "none")
    return found


def readable_photos(photos: Iterable[Path]) -> tuple[list[Path], dict[Path, str]]:
    """Those of the photos whose header can be read, and by each other what is wrong with it.

    Raises InputError about the first where none can be read.
    """
    kept, wrong = list[Path](), dict[Path, InputError]()
    for photo in photos:
        try:
            photo_size(photo)
            kept.append(photo)
        except InputError as error:
            wrong[photo] = error
    if wrong and not kept:
        raise next(iter(wrong.values()))
    return kept, {photo: error.got for photo, error in wrong.items()}


def photo_size(path: str | os.PathLike) -> tuple[int, int]:
    """(width, height) of a photo from its header alone."""
    with _opened(path) as photo:
        return photo.size


def read_photo(path: str | os.PathLike) -> np.ndarray:
    """A photo as sRGB uint8 (H, W, 3), converted from its own colour profile, in the sensor's own pixel grid.

    An EXIF orientation is not applied: it turns the picture for the eye, but the lens and its K stay with the sensor.
    """
    with _opened(path) as photo:
        return np.asarray(_srgb(_converted(path, photo, "RGB"), photo.info.get("icc_profile")))


def _srgb(picture: Any, icc: bytes | None) -> Any:
    """An RGB picture of Pillow's in sRGB: a phone's Display P3, read as sRGB, would be too dull."""
    from PIL import ImageCms

    if icc is None:
        return picture
    try:
        profile = ImageCms.ImageCmsProfile(io.BytesIO(icc))
        if "sRGB" in ImageCms.getProfileDescription(profile):  # rounding would change some codes
            return picture
        return ImageCms.profileToProfile(picture, profile, ImageCms.createProfile("sRGB"))
    except (OSError, ImageCms.PyCMSError):  # damaged, or that of a grey photo or of four inks
        return picture


def read_picture(path: str | os.PathLike) -> tuple[np.ndarray, np.ndarray | None]:
    """A picture of any of PICTURES as sRGB uint8 (H, W, 3), and its alpha (H, W) float32 where it has one.

    Raises InputError for one of more than 8 bits per channel.
    """
    with _opened(path, PICTURES) as picture:
        if _is_deep(picture):
            name = f"a{Path(path).suffix}"
            convert = f"oiiotool {name} --colorconvert sRGB linear -d float -o a.exr"
            raise InputError(path, f"a {picture.format} of 8 bits per channel", f"more (convert it: {convert})")
        if not picture.has_transparency_data:
            return np.asarray(picture.convert("RGB")), None
        pixels = np.asarray(picture.convert("RGBA"))
        return pixels[..., :3], pixels[..., 3] / np.float32(255)


def _is_deep(picture: Any) -> bool:
    """Whether a picture of Pillow's has more than 8 bits per channel: some of them it reads as 8 without a word."""
    stored = picture.tile[0][3] if picture.tile else ""
    if picture.format == "TIFF":
        return max(picture.tag_v2.get(258, (1,))) > 8  # BitsPerSample
    if picture.format == "PPM":
        return picture.mode == "I" or (isinstance(stored, tuple) and stored[1] > 255)
    return picture.format == "PNG" and ";16" in stored


def read_grey(path: str | os.PathLike) -> np.ndarray:
    """A photo as grey uint8 (H, W), Rec. 601 luma of sRGB, in the sensor's own pixel grid.

    A JPEG stores luma apart from colour: reading it alone takes a third of `read_photo`'s time.
    """
    with _opened(path) as photo:
        photo.draft("L", photo.size)
        return np.asarray(_converted(path, photo, "L"))


def _converted(path: str | os.PathLike, photo: Any, mode: str) -> Any:
    """The photo in a mode of Pillow's, "RGB" or "L"."""
    if photo.mode.startswith(("I", "F")):  # Pillow would clip its values to 255
        raise InputError(path, "a photo of 8 bits per channel", "more: save it with 8 bits")
    return photo.convert(mode)


def photo_exif(path: str | os.PathLike) -> bytes:
    """The photo's EXIF, byte for byte; empty where it has none."""
    with _opened(path) as photo:
        return bytes(photo.info.get("exif", b""))


@contextlib.contextmanager
def _opened(path: str | os.PathLike, formats: tuple[str, ...] | None = None) -> Iterator[Any]:
    from PIL import Image as Pillow  # 40 ms: not at import

    kind = f"a {A_PHOTO}" if formats is None else f"a picture ({', '.join(formats)})"
    check_file(path, kind)
    if (suffix := Path(path).suffix.lower()) in UNREAD:
        raise InputError(path, kind, f"{suffix[1:].upper()}: save it as JPEG or PNG")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Pillow.DecompressionBombWarning)
            # From memory: of a file on disk, Pillow asks for as many bytes at once as a damaged chunk claims to have.
            known = formats or sorted({*PHOTOS.values()})
            with Pillow.open(io.BytesIO(Path(path).read_bytes()), formats=known) as photo:
                check_size(path, *photo.size, 12)
                yield photo
    except InputError:
        raise
    except PermissionError as error:
        raise InputError(path, kind, str(error.strerror).lower()) from None
    except Pillow.UnidentifiedImageError:
        raise InputError(path, kind, "a file of another kind, or a damaged header") from None
    except Pillow.DecompressionBombError as error:
        raise InputError(path, "a photo of a size that a camera makes", error) from None
    except Exception as error:  # Pillow raises whatever its parsers meet
        raise InputError(path, kind, f"a damaged one ({error})") from None


def write_picture(path: str | os.PathLike, pixels: np.ndarray, quality: int = 92, exif: bytes = b"") -> None:
    """sRGB uint8 (H, W) or (H, W, 3) as PNG or, by the name's ending, JPEG; with a photo's `photo_exif`."""
    from PIL import Image as Pillow

    suffix = Path(path).suffix.lower()
    if suffix not in (".png", ".jpg", ".jpeg"):
        raise InputError(path, "a name that ends in .png, .jpg or .jpeg", suffix or "no ending")
    options: dict[str, Any] = {"compress_level": 2} if suffix == ".png" else {"quality": quality, "subsampling": 0}
    with replacing(path) as temporary:
        Pillow.fromarray(np.ascontiguousarray(pixels)).save(temporary, exif=exif, **options)


def encoded(picture: Any, kind: str, **options: Any) -> bytes:
    """Return sRGB uint8 (H, W) or (H, W, 3), or a picture of Pillow's, as a PNG or JPEG (`kind`: png, jpeg)."""
    from PIL import Image as Pillow

    made = Pillow.fromarray(np.ascontiguousarray(picture)) if isinstance(picture, np.ndarray) else picture
    made.save(buffer := io.BytesIO(), kind, **options)
    return buffer.getvalue()


def data_url(picture: Any, kind: str, **options: Any) -> str:
    """Return the same as a data URL."""
    return f"data:image/{kind};base64,{base64.b64encode(encoded(picture, kind, **options)).decode('ascii')}"
