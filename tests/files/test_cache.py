"""A stored file that is damaged, in whatever way, is no cache: nothing of it is used, and nobody sees a traceback."""

import io
import os
import zipfile

import numpy as np
import pytest

from raytwin.files import load_arrays


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


def test_arrays_that_were_stored_are_loaded(tmp_path):
    (tmp_path / "a.npz").write_bytes(npz())
    np.testing.assert_array_equal(load_arrays(tmp_path / "a.npz")["a"], np.arange(100.0))


@pytest.mark.parametrize(
    "data",
    [
        encrypted(),
        *(of_compression(n) for n in (1, 12, 14, 97, 99)),
        member("a.txt", b"no array"),
        member("a.npy", b"no array"),
        member("a.npy", b"\x93NUMPY\x01\x00\x10\x00" + b"(" * 15 + b"\n"),
        member("a.npy", b"\x93NUMPY\x01\x00\xff\xff" + b"[" * 65535),
        npz()[:-30],
        b"",
        b"PK\x03\x04",
    ],
)
def test_what_cannot_be_read_as_arrays_is_none(tmp_path, data):
    (tmp_path / "a.npz").write_bytes(data)
    assert load_arrays(tmp_path / "a.npz") is None


@pytest.mark.skipif(os.name != "posix", reason="there are no named pipes")
def test_a_folder_or_a_pipe_is_none(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    assert load_arrays(tmp_path) is None
    assert load_arrays(tmp_path / "pipe") is None
    assert load_arrays(tmp_path / "missing") is None
