"""What a hostile process writes is read as numbers, or refused; nothing in it runs."""

import io
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from raytwin.teach.sandbox import wire


def written(value) -> bytes:
    stream = io.BytesIO()
    wire.write(stream, value)
    return stream.getvalue()


def read(data: bytes, most: int = 1 << 20):
    return wire.read(wire.exactly(io.BytesIO(data)), most)


def forged(arrays, head_value=None, data: bytes = b"") -> bytes:
    head = json.dumps({"value": head_value or {"array": 0}, "arrays": arrays}).encode()
    return (8 + len(head) + len(data)).to_bytes(8, "little") + len(head).to_bytes(8, "little") + head + data


def test_what_is_written_is_read_back():
    a = np.array([[1.5, np.nan], [np.inf, -0.0]])
    value = {"scene": {"K": a, "name": "é", "array": [{"radius": 0.1}]}, "many": [a.T, np.arange(3, dtype=np.int8)]}
    back = read(written(value))
    np.testing.assert_array_equal(back["scene"]["K"], a)
    np.testing.assert_array_equal(back["many"][0], a.T)
    assert back["many"][1].dtype == np.int8
    assert (back["scene"]["name"], back["scene"]["array"]) == ("é", [{"radius": 0.1}])


NO_MESSAGES = (
        (1 << 40).to_bytes(8, "little"),
        forged([["O", 3]], data=bytes(24)),
        forged([["<f8,<f8", 1]], data=bytes(16)),
        forged([["V8", 1]], data=bytes(8)),
        forged([["<f8", -1, -3]], data=bytes(24)),
        forged([["<f8", 4]], data=bytes(24)),
        forged([["<f8", 3]], {"array": 5}, bytes(24)),
        forged([["<f8", 1]] * 1025, data=bytes(8 * 1025)),
        forged([["<f8", 1 << 62, 1 << 62]]),
        forged([["<f8", True]], data=bytes(8)),
        forged([["<f8", 1.0]], data=bytes(8)),
        forged([["<f8", float("inf")]], data=bytes(8)),
        forged([["<f8", float("nan")]]),
        forged([["<f8", "1"]], data=bytes(8)),
        forged(5),
        forged([], {"table": 5}),
        forged([], {"other": 5}),
        forged([], [{}]),
        forged([], {"array": "x"}),
        b"\x10" + bytes(7) + b"\xff" * 16,
        (8 + 200_000).to_bytes(8, "little") + (200_000).to_bytes(8, "little") + b"[" * 200_000,
)  # fmt: skip


def test_what_is_no_message_is_refused():
    for data in NO_MESSAGES:
        with pytest.raises((ValueError, EOFError)):
            read(data)


def test_the_grader_may_send_a_large_head_and_many_arrays_and_a_submission_may_not():
    for value in ("x" * (1 << 20), [np.zeros(1)] * 1025):
        data = written(value)
        assert len(wire.read(wire.exactly(io.BytesIO(data)), 1 << 22, trusted=True)) == len(value)
        with pytest.raises(wire.WireError):
            read(data, 1 << 22)
    with pytest.raises(wire.WireError):
        wire.read(wire.exactly(io.BytesIO(data)), len(data) - 9, trusted=True)


def test_a_message_is_as_long_as_it_says_and_a_reader_sets_the_most():
    data = written([1, 2])
    assert int.from_bytes(data[:8], "little") == len(data) - 8
    assert read(data, len(data) - 8) == [1, 2]
    with pytest.raises(wire.WireError):
        read(data, len(data) - 9)


@given(st.binary(max_size=200))
def test_no_bytes_do_more_than_be_refused(data):
    with pytest.raises((ValueError, EOFError)):
        read(len(data).to_bytes(8, "little") + data)
