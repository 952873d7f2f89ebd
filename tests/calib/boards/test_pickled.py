"""Boards in pickles: what NumPy and Python of any age write is read; whatever else a pickle can do is refused."""

import os
import pickle
import struct
import tracemalloc

import msgspec
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from raytwin.calib.boards.board import read_board, write_board
from raytwin.calib.boards.pickled import LARGEST, read_pickle, read_pickled
from raytwin.errors import InputError

INCH = 0.0254
PROTOCOLS = range(2, pickle.HIGHEST_PROTOCOL + 1)
SQUARE = [(1.0, 1.0, 0.0), (2.0, 1.0, 0.0), (1.0, 2.5, 0.0), (2.0, 2.5, 0.0)]


def tags(center=list, family="tag36h11", tag_id=int, centers=SQUARE) -> list[dict]:
    return [{"tag_family": family, "tag_id": tag_id(i), "center": center(c)} for i, c in enumerate(centers, start=14)]


@pytest.fixture
def save(tmp_path):
    def save(thing, protocol: int = 4):
        path = tmp_path / "boards.pickle"
        path.write_bytes(thing if isinstance(thing, bytes) else pickle.dumps(thing, protocol))
        return path

    return save


def read(path, name="fine", **changes):
    return read_pickled(path, name, 0.8 * INCH, INCH, **changes)


def refused(path, *parts, name="fine"):
    with pytest.raises(InputError) as error:
        read(path, name)
    text = str(error.value)
    assert "\n" not in text
    assert len(text) < 600
    for part in parts:
        assert part in text, text


CENTERS = {
    "list": list,
    "tuple": tuple,
    "array": np.array,
    "float32": lambda c: np.array(c, np.float32),
    "big-endian": lambda c: np.array(c, ">f8"),
    "integers": lambda c: np.array([2 * v for v in c]).astype(np.int16),
    "column": lambda c: np.array(c)[:, None],
    "two values": lambda c: np.array(c[:2]),
    "scalars": lambda c: [np.float64(v) for v in c],
    "Fortran's order": lambda c: np.asfortranarray(c),
}


@pytest.mark.parametrize("kind", CENTERS)
def test_centers_of_any_kind_and_protocol_are_read(save, kind):
    scale = 2 * INCH if kind == "integers" else INCH
    for protocol in PROTOCOLS:
        board = read(save({"fine": tags(CENTERS[kind], tag_id=np.int64)}, protocol))
        assert list(board.centers()) == [14, 15, 16, 17]
        want = np.array(SQUARE)[:, :2] * scale
        np.testing.assert_allclose(list(board.centers().values()), want, rtol=1e-7)


def test_arrays_of_numpy_1_and_of_numpy_2_are_read_alike(save):
    data = pickle.dumps({"fine": tags(np.array, tag_id=np.int64)}, 2)
    assert b"cnumpy._core" in data  # this is NumPy 2
    assert read(save(data.replace(b"cnumpy._core", b"cnumpy.core"))) == read(save(data))


def test_what_is_read_can_be_written_as_toml_and_read_again(save, tmp_path):
    board = read(save({"coarse": [], "fine": tags()}))
    write_board(tmp_path / "board.toml", board)
    assert read_board(tmp_path / "board.toml") == board
    assert read(save({"fine": tags()}), y_down=True).centers() == {i: (x, -y) for i, (x, y) in board.centers().items()}


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_family_in_bytes_is_read_as_the_text_it_stands_for(save, protocol):
    """As the detector's own results hold it, and so the course's files."""
    path = save({"at_coarseboard": tags(np.array), "at_fineboard": tags(np.array, family=b"tag36h11")}, protocol)
    assert read(path, "at_fineboard") == read(path, "at_coarseboard")


@pytest.mark.parametrize(
    ("boards", "parts"),
    [
        ({"fine": tags(family="tag36h10")}, ["fine: family", "tag36h11", "'tag36h10'"]),
        ({"fine": tags() + tags(family="tag25h9")}, ["fine: tag_family", "one family"]),
        ({"fine": tags(tag_id=bool)}, ["fine[0].tag_id", "True"]),
        ({"fine": tags(centers=[*SQUARE[:3], (2.0, 2.5, 0.3)])}, ["fine: center", "plane", "0.3"]),
        ({"fine": tags(centers=[*SQUARE[:3], (2.0, np.nan, 0.0)])}, ["fine[3].center[1]", "a number", "nan"]),
        ({"fine": tags(centers=[*SQUARE[:3], (10**400, 1.0, 0.0)])}, ["fine[3].center[0]", "64 bits", "1000"]),
        ({"fine": tags(lambda c: c[:1])}, ["fine[0].center", "length >= 2"]),
        ({"fine": [{"tag_family": "tag36h11", "tag_id": 1}]}, ["fine[0].center", "nothing"]),
        ({"fine": []}, ["fine: tag_family"]),
        ({}, ["boards by their names"]),
        ({1: []}, ["whose keys are no names"]),
    ],
)  # fmt: skip
def test_a_wrong_board_is_refused_with_what_is_wrong(save, boards, parts):
    refused(save(boards), *parts)


def test_a_missing_name_lists_the_names_there_are(save):
    path = save({"coarse": tags(), "fine": tags()})
    refused(path, "--name", "one of coarse, fine", "none", name=None)
    refused(path, "--name", "one of coarse, fine", "medium", name="medium")
    refused(save({"n" * 9999 + str(i): [] for i in range(50)}), "--name", "...", name=None)


# ---------------------------------------------------------------------------------- hostile


class Call:
    """Pickles as a call of `function`."""

    def __init__(self, function, *arguments):
        self.made = function, arguments

    def __reduce__(self):
        return self.made


@pytest.fixture
def canary(tmp_path):
    """A file that must not come to be, made by any hostile pickle that runs."""
    path = tmp_path / "ran"
    yield path
    assert not path.exists()


def test_no_call_is_run_wherever_it_stands(save, canary):
    for call in (
        Call(os.system, f"touch {canary}"),
        Call(eval, f"open({str(canary)!r}, 'w')"),
        Call(getattr, "x", "upper"),
        Call(np.fromfile, str(canary)),
    ):
        hidden = (
            {"fine": tags(lambda c, call=call: [*c[:2], call])},
            {"fine": tags(lambda c, call=call: Call(np.dtype, call))},
        )
        for thing in (call, *hidden):
            for protocol in PROTOCOLS:
                refused(save(thing, protocol), "plain data and NumPy's numbers", "a use of")


def test_objects_other_than_small_vectors_of_numbers_are_refused(save):
    for thing in (
        np.array([1, None], object), np.array([(1, 2.0)], [("a", "i4"), ("b", "f8")]), np.array([1 + 2j]),
        np.zeros((2, 2)), np.zeros(17), np.ma.array([1.0, 2.0]), 1j, {1, 2}, object(), msgspec.Struct,
    ):  # fmt: skip
        for protocol in (2, 5):
            refused(save({"fine": [thing]}, protocol), "expected")


def nested_pairs(depth: int) -> list:
    """Memory for `depth` lists, text for 2 ** depth."""
    pair: list = []
    for _ in range(depth):
        pair = [pair, pair]
    return pair


def chatty(code: bytes) -> bytes:
    return b"\x80\x04" + code + b"."


CALL = b"c_codecs\nencode\n\x94"
HOSTILE = {
    "a memo bomb": (pickle.dumps({"fine": nested_pairs(60)}), "fine[0]"),
    "a memo bomb in a center": (pickle.dumps({"fine": tags(lambda c: nested_pairs(60))}), "fine[0].center"),
    "deep lists": (b"]" * 60_000 + b"a" * 59_999 + b".", "boards by their names"),
    "an empty file": (b"", "a pickle"),
    "too large a file": (b"N" * (LARGEST + 1), "more than 1 MiB"),
    "a memo far off": (chatty(b"Nr\xff\xff\xff\xff"), "boards by their names"),
    "keys that collide": (
        chatty(b"}(" + b"".join(b"\x8a\x08" + (i * (2**61 - 1)).to_bytes(8, "little") + b"N" for i in range(4)) + b"u"),
        "no names"),
    "nested tuples as a key": (
        chatty(b"N\x940" + b"".join(b"h%ch%c\x86\x940" % (i, i) for i in range(60)) + b"}h" + bytes([60]) + b"Ns"),
        "a pickle"),
    "text of 4 GiB": (chatty(b"\x8d" + struct.pack("<Q", 1 << 32)), "a pickle"),
    "bytes of 2 GiB": (chatty(b"B\xff\xff\xff\x7f"), "a pickle"),
    "a frame of 2**62 bytes": (b"\x80\x04\x95" + struct.pack("<Q", 1 << 62) + b"N.", "boards by their names"),
    "a persistent id": (chatty(b"Pfile\n"), "a pickle"),
    "an old instance": (b"(S'x'\nios\nsystem\n.", "a pickle"),
    "a new object": (chatty(b"cbuiltins\nobject\n)\x81"), "a use of builtins.object"),
    "defaults of a function": (chatty(b"c_codecs\nencode\nN}\x8c\x0c__defaults__)s\x86b"), "a state of its own"),
    "a dotted name": (chatty(b"\x8c\x05numpy\x8c\x0edtype.__init__\x93"), "a use of numpy.dtype.__init__"),
    "a call of ndarray": (chatty(b"cnumpy\nndarray\nM\xff\xff\x85\x85R"), "a pickle"),
    "an array with itself as its state": (chatty(
        b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85C\x01b\x87R\x94(h\x00h\x00h\x00h\x00tb"
    ), "a pickle"),
    "one long text, encoded again and again": (chatty(
        CALL + b"X" + struct.pack("<I", 500_000) + b"x" * 500_000 + b"\x94\x8c\x06latin1\x86\x94R"
        + b"h\x00h\x02R" * 60_000
    ), "boards by their names"),
}  # fmt: skip


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_pickle_is_refused_for_its_own_reason_in_one_line_and_little_memory(save, kind):
    data, reason = HOSTILE[kind]
    path = save(data)
    tracemalloc.start()
    try:
        refused(path, "expected", reason)
        assert tracemalloc.get_traced_memory()[1] < 200 << 20
    finally:
        tracemalloc.stop()


def test_every_truncated_pickle_is_refused(save):
    for protocol in (2, 5):
        data = pickle.dumps({"fine": tags(np.array)[:1]}, protocol)
        for end in range(len(data)):
            refused(save(data[:end]), "expected")


WHOLE = [pickle.dumps({"fine": tags(np.array, tag_id=np.int32)}, p) for p in (2, 4, 5)]
OPS = [bytes([b]) for b in b"(.0]}).N\x85\x86\x87\x88\x89\x93\x94RbaestuK\x01h\x00q\x012o\x81\x90\x91"] + [
    b"cnumpy\ndtype\n", b"cnumpy\nndarray\n", b"cnumpy.core.multiarray\n_reconstruct\n", b"c_codecs\nencode\n",
    b"cnumpy._core.multiarray\nscalar\n", b"cnumpy._core.numeric\n_frombuffer\n", b"cos\nsystem\n", b"\x8c\x02f8",
    b"\x8c\x01<", b"\x8c\x06latin1", b"C\x08abcdefgh", b"K\x01", b"K\x03", b"\x8c\x0btag_family", b"h\x00", b"q\x00",
]  # fmt: skip


@st.composite
def damaged(draw) -> bytes:
    data = bytearray(draw(st.sampled_from(WHOLE)))
    for at, value in draw(st.lists(st.tuples(st.integers(0, 1 << 12), st.integers(0, 255)), min_size=1, max_size=4)):
        data[at % len(data)] = value
    return bytes(data)


ORDERS = st.lists(st.sampled_from(OPS), max_size=40).map(lambda ops: b"".join(ops) + b".")


@settings(max_examples=400)
@given(st.one_of(damaged(), ORDERS, st.binary(max_size=200)))
@example(b"cnumpy\ndtype\n\x8c\x02f8\x85RNb.")
def test_damaged_pickles_instructions_of_any_order_and_any_bytes_are_read_or_refused(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "any.pickle"
    path.write_bytes(data)
    try:
        read_pickle(path)
        read(path)
    except InputError as error:
        text = str(error)
        assert "\n" not in text
        assert len(text) < 600
