"""A stored file that is damaged, in whatever way, is no cache: nothing of it is used, and nobody sees a traceback."""

import io
import os
import zipfile

import numpy as np
import pytest

from raytwin.images.image import Image, Surface
from raytwin.twin import render_cache
from raytwin.twin.render_cache import load, path_of, store


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache in a folder of its own, which exists."""
    monkeypatch.setenv("RAYTWIN_CACHE", str(tmp_path))
    (tmp_path / "renders").mkdir()


IMAGE = Image(np.full((1, 2, 3), 0.5, np.float32), samples=3, surface=Surface.empty(2, 1), batches=2)


def npz() -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, a=np.arange(100.0))
    return stream.getvalue()


def encrypted() -> bytes:
    """Bit 0 of the general purpose flags, of the local header and of the central directory: PKWARE's APPNOTE 4.4.4."""
    data = bytearray(npz())
    for start, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(start) + offset] |= 1
    return bytes(data)


def of_compression(number: int) -> bytes:
    data = bytearray(npz())
    for start, offset in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):
        data[data.index(start) + offset] = number
    return bytes(data)


def member(name: str, content: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(name, content)
    return stream.getvalue()


@pytest.mark.parametrize(
    "change",
    [
        {"mean": IMAGE.mean * 2}, {"mean": IMAGE.mean.astype(float)}, {"mean": IMAGE.mean[0]}, {"more": np.zeros(1)},
        {"seal": np.zeros(32, np.uint8)}, {"seal": np.array("none")},
    ],
)  # fmt: skip
def test_a_stored_render_is_loaded_under_its_own_key_and_only_as_it_was_stored(change):
    store("a", IMAGE)
    again = load("a")
    np.testing.assert_array_equal(again.mean, IMAGE.mean)
    assert (again.samples, again.batches, again.variance) == (3, 2, None)
    path_of("b").write_bytes(path_of("a").read_bytes())
    assert load("b") is None
    np.savez(path_of("a"), **(dict(np.load(path_of("a"))) | change))
    assert load("a") is None
    np.savez(path_of("a"), mean=IMAGE.mean)
    assert load("a") is None


@pytest.mark.parametrize(
    "data",
    [
        encrypted(),
        *(of_compression(n) for n in (1, 12, 99)),
        member("a.txt", b"no array"),
        member("a.npy", b"no array"),
        member("a.npy", b"\x93NUMPY\x01\x00\xff\xff" + b"[" * 65535),
        npz()[:-30],
        b"",
    ],
)
def test_what_cannot_be_read_as_arrays_is_none(data):
    path_of("a").write_bytes(data)
    assert load("a") is None


@pytest.mark.skipif(os.name != "posix", reason="there are no named pipes")
def test_a_folder_or_a_pipe_is_none_and_is_not_replaced():
    os.mkfifo(path_of("pipe"))
    path_of("folder").mkdir()
    for key in ("pipe", "folder", "missing"):
        assert load(key) is None
    for key in ("pipe", "folder"):
        store(key, IMAGE)
        assert not path_of(key).is_file()


def test_what_was_used_longest_ago_is_dropped_and_use_makes_a_file_young(monkeypatch):
    store("a", IMAGE)
    monkeypatch.setattr(render_cache, "LIMIT", 3 * path_of("a").stat().st_size)
    for age, key in enumerate("abcd"):
        store(key, IMAGE)
        os.utime(path_of(key), (1e9 + age, 1e9 + age))
    assert [key for key in "abcd" if path_of(key).exists()] == ["b", "c", "d"]
    assert load("b") is not None
    store("e", IMAGE)
    assert [key for key in "abcde" if path_of(key).exists()] == ["b", "d", "e"]


def test_a_file_that_is_refused_stays_old():
    path_of("a").write_bytes(npz())
    os.utime(path_of("a"), (1e9, 1e9))
    assert load("a") is None
    assert path_of("a").stat().st_mtime == 1e9
