"""A stored file that is damaged, in whatever way, is no cache: nothing of it is used, and nobody sees a traceback."""

import io
import os
import zipfile

import numpy as np
import pytest

from raytwin.files import Cache


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A cache of 1000 bytes in a folder of its own, which exists."""
    monkeypatch.setenv("RAYTWIN_CACHE", str(tmp_path))
    (tmp_path / "things").mkdir()
    return Cache("things", ".npz", 1000)


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
        {"a": np.array([1.0, 2.5])}, {"a": np.array([1, 2])}, {"a": np.array([[1.0, 2.0]])}, {"b": np.zeros(1)},
        {"seal": np.zeros(32, np.uint8)}, {"seal": np.array("none")},
    ],
)  # fmt: skip
def test_stored_arrays_are_loaded_under_their_own_key_and_only_as_they_were_stored(cache, change):
    cache.store_arrays("a", {"a": np.array([1.0, 2.0])})
    assert cache.load_arrays("a")["a"].tolist() == [1.0, 2.0]
    cache.path("b").write_bytes(cache.path("a").read_bytes())
    assert cache.load_arrays("b") is None
    np.savez(cache.path("a"), **(dict(np.load(cache.path("a"))) | change))
    assert cache.load_arrays("a") is None
    np.savez(cache.path("a"), a=np.array([1.0, 2.0]))
    assert cache.load_arrays("a") is None


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
def test_what_cannot_be_read_as_arrays_is_none(cache, data):
    cache.path("a").write_bytes(data)
    assert cache.load_arrays("a") is None


@pytest.mark.skipif(os.name != "posix", reason="there are no named pipes")
def test_a_folder_or_a_pipe_is_none_and_is_not_replaced(cache):
    os.mkfifo(cache.path("pipe"))
    cache.path("folder").mkdir()
    for key in ("pipe", "folder", "missing"):
        assert cache.load_arrays(key) is None
    for key in ("pipe", "folder"):
        cache.store_arrays(key, {})
        assert not cache.path(key).is_file()


def test_what_was_used_longest_ago_is_dropped_and_use_makes_a_file_young(cache):
    cache = Cache("things", ".npz", 3 * file_size(cache))
    for age, key in enumerate("abcd"):
        cache.store_arrays(key, {})
        os.utime(cache.path(key), (1e9 + age, 1e9 + age))
    assert [key for key in "abcd" if cache.path(key).exists()] == ["b", "c", "d"]
    assert cache.load_arrays("b") == {}
    cache.store_arrays("e", {})
    assert [key for key in "abcde" if cache.path(key).exists()] == ["b", "d", "e"]


def test_a_file_that_is_refused_stays_old(cache):
    cache.path("a").write_bytes(npz())
    os.utime(cache.path("a"), (1e9, 1e9))
    assert cache.load_arrays("a") is None
    assert cache.path("a").stat().st_mtime == 1e9


def file_size(cache: Cache) -> int:
    cache.store_arrays("x", {})
    size = cache.path("x").stat().st_size
    cache.path("x").unlink()
    return size
