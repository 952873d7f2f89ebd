"""Boards saved as a Python pickle, `{name: [{tag_family, tag_id, center}]}`, read without running it.

A pickle is a program for a stack machine. Python's own reader carries it out, with two limits: only the instructions of
PLAIN_STEPS exist, and every name becomes a function of this file that copies a few numbers. Nothing is imported.

A small file cannot ask for much either: each instruction makes at most one small object, and only text may be a key
(numbers can be chosen to collide, and nested tuples take forever to hash).
"""

import io
import os
import pickle
import pickletools
from typing import Annotated, Any

import msgspec
import numpy as np

from raytwin.calib.boards.board import Board, BoardTag, TagId, check_board
from raytwin.errors import InputError
from raytwin.files import check_file, to_record

LARGEST = 1 << 20
"""Bytes of a file; a board of a thousand tags takes a tenth."""

MOST_BYTES = 128
"""Bytes of an array; a center has two or three numbers."""


class _Array(list[int | float]):
    """An ndarray as its numbers in memory order: two or three, all that a center has, are always a vector."""

    def fill(self, state: Any) -> None:
        _, dtype, _, data = state[-4:]  # (version,) shape, dtype, whether in Fortran's order, data
        self[:] = dtype.numbers(data)


class _DType:
    def __init__(self, code: Any, *_: Any) -> None:
        if code not in ("f2", "f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8"):
            raise ValueError("an array of something else than numbers")
        self.code, self.order = code, "<"

    def fill(self, state: Any) -> None:
        self.order = state[1]

    def numbers(self, data: Any) -> list[int | float]:
        """The numbers in a buffer, which `_Reader` gives as text."""
        if self.order not in ("<", ">", "|") or len(data) > MOST_BYTES:
            raise ValueError(f"an array of more than {MOST_BYTES} bytes, or of a dtype of its own")
        return np.frombuffer(data.encode("latin-1"), self.order + self.code).tolist()


class _Names(dict[str, Any]):
    def __setitem__(self, key: Any, value: Any) -> None:
        if type(key) is not str:
            raise ValueError("a dictionary whose keys are no names")
        super().__setitem__(key, value)


KNOWN = {
    "_codecs.encode": lambda text, *_: text,
    "numpy.dtype": lambda *code: _DType(*code),
    "numpy.ndarray": None,
    "numpy.core.multiarray._reconstruct": lambda *_: _Array(),
    "numpy.core.multiarray.scalar": lambda dtype, data: dtype.numbers(data)[0],
    "numpy.core.numeric._frombuffer": lambda data, dtype, *_: _Array(dtype.numbers(data)),
}
"""Names in a pickled NumPy array or number, and the function called in place of each."""

PLAIN_STEPS = """PROTO FRAME STOP MARK BINPUT LONG_BINPUT MEMOIZE BINGET LONG_BINGET NONE NEWTRUE NEWFALSE
BININT BININT1 BININT2 LONG1 BINFLOAT BINUNICODE SHORT_BINUNICODE EMPTY_LIST EMPTY_TUPLE TUPLE TUPLE1 TUPLE2 TUPLE3
APPEND APPENDS SETITEM SETITEMS GLOBAL STACK_GLOBAL REDUCE"""
"""The instructions that are carried out as they are, beside those below: all that plain data and arrays need from
protocol 2 on."""


class _Reader(pickle._Unpickler):
    """Python's own reader, in Python: the one in C sets aside as much memory as a file says that it needs.

    Bytes are read as text of the characters 0 to 255.
    """

    def find_class(self, module: str, name: str) -> Any:
        moved = f"{module}.{name}".replace("numpy._core.", "numpy.core.", 1)  # NumPy 2 moved it
        if moved not in KNOWN:
            raise ValueError(f"a use of {module[:30]}.{name[:30]}")
        return KNOWN[moved]

    def load_build(self: Any) -> None:
        state, target = self.stack.pop(), self.stack[-1]
        if not isinstance(target, _Array | _DType):
            raise ValueError("an object with a state of its own")
        target.fill(state)

    def load_empty_dictionary(self: Any) -> None:
        self.append(_Names())

    def load_bytearray8(self: Any) -> None:
        self.append(self.read(int.from_bytes(self.read(8), "little")).decode("latin-1"))

    dispatch = {
        ord(op.code): pickle._Unpickler.dispatch[ord(op.code)]
        for op in pickletools.opcodes
        if op.name in PLAIN_STEPS.split()
    } | {
        pickle.SHORT_BINBYTES[0]: pickle._Unpickler.dispatch[pickle.SHORT_BINSTRING[0]],
        pickle.BINBYTES[0]: pickle._Unpickler.dispatch[pickle.BINSTRING[0]],
        pickle.BYTEARRAY8[0]: load_bytearray8,
        pickle.EMPTY_DICT[0]: load_empty_dictionary,
        pickle.BUILD[0]: load_build,
    }


class PickledTag(msgspec.Struct):
    """An entry of a board: `center` is x, y and mostly z."""

    tag_family: str
    tag_id: TagId
    center: Annotated[list[Annotated[float, msgspec.Meta(gt=-1e6, lt=1e6)]], msgspec.Meta(min_length=2, max_length=3)]


def read_pickle(path: str | os.PathLike) -> dict[str, Any]:
    """The boards in a pickle by their names, as plain data, arrays as lists; InputError for all else. Runs nothing."""
    path = check_file(path, "a pickle of boards")
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST + 1)
        if len(data) > LARGEST:
            raise ValueError("more than 1 MiB")
        boards = _Reader(io.BytesIO(data), encoding="latin-1").load()
    except Exception as error:  # what the reader trips over in a damaged file can be anything
        text = " ".join(str(error).split())[:80] or type(error).__name__
        raise InputError(path, "a pickle (protocol 2 or later) of plain data and NumPy's numbers", text) from None
    if not isinstance(boards, dict) or not boards:
        raise InputError(path, "a pickle with boards by their names", "one without")
    return boards


def read_pickled(
    path: str | os.PathLike, name: str | None, tag_edge: float, unit: float, y_down: bool = False
) -> Board:
    """The board `name` of a pickle `{name: [{tag_family, tag_id, center}]}`, as a Board in metres.

    `center`: x, y and mostly z, as list, tuple or array, in units of `unit` metres; `tag_edge` in metres, which the
    file does not contain. `y_down`: the file counts Y downwards, so turn its sign: else the board would be a mirror
    image.
    """
    boards = read_pickle(path)
    names = ", ".join(key[:24] for key in list(boards)[:12]) + (", ..." if len(boards) > 12 else "")
    if name is None or name not in boards:
        raise InputError("--name", f"one of {names}", "none" if name is None else name[:40])
    where, entries = name[:40], boards[name]
    if isinstance(entries, list | tuple):  # keys beside those that a board needs are passed over, whatever they hold
        known = PickledTag.__struct_fields__
        entries = [{k: e[k] for k in known if k in e} if isinstance(e, dict) else e for e in entries]
    tags = to_record(path, entries, list[PickledTag], where)
    families, heights = {tag.tag_family[:40] for tag in tags}, [(*tag.center, 0.0)[2] for tag in tags]
    if len(families) != 1:
        raise InputError(f"{path}: {where}: tag_family", "one family for all tags", ", ".join(sorted(families)[:4]))
    if max(heights) - min(heights) > 1e-6 * tag_edge / unit:
        got = f"z {min(heights):g} to {max(heights):g}"
        raise InputError(f"{path}: {where}: center", "all in one plane, z the same", got)
    up = -unit if y_down else unit
    centers = tuple(BoardTag(tag.tag_id, (tag.center[0] * unit, tag.center[1] * up)) for tag in tags)
    board = Board(families.pop(), tag_edge, tags=centers)
    check_board(board, f"{path}: {where}")
    return board
