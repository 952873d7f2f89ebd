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
import warnings
from typing import Any

import numpy as np

from raytwin.calib.boards.board import FAMILIES, Board, BoardTag, check_board, family_size
from raytwin.errors import InputError
from raytwin.files import check_file

LARGEST = 1 << 20
"""Bytes of a file; a board of a thousand tags takes a tenth."""

MOST_BYTES = 128
"""Bytes of an array; a center has two or three numbers."""

MOST_TAGS = max(map(family_size, FAMILIES))

PLAIN = "plain data and NumPy's numbers"


class _Refused(Exception):
    """expected, got"""


class _Array(list[int | float]):
    """An ndarray as its numbers in memory order: two or three, all that a center has, are always a vector."""

    def fill(self, state: Any) -> None:
        _, dtype, _, data = state[-4:]  # (version,) shape, dtype, whether in Fortran's order, data
        self[:] = dtype.numbers(data)


class _DType:
    def __init__(self, code: Any) -> None:
        if code not in ("f2", "f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8"):
            raise _Refused("arrays of numbers", f"an array of {'objects' if code == 'O8' else 'something else'}")
        self.code, self.order = code, "<"

    def fill(self, state: Any) -> None:
        self.order = state[1]

    def numbers(self, data: Any) -> list[int | float]:
        """The numbers in a buffer: bytes, or text of the characters 0 to 255 as Python 2 wrote them."""
        if self.order not in ("<", ">", "|"):
            raise _Refused("a dtype of plain numbers", "another")
        return np.frombuffer(_bytes(data), self.order + self.code).tolist()


class _Names(dict[str, Any]):
    def __setitem__(self, key: Any, value: Any) -> None:
        if type(key) is not str:
            raise _Refused("dictionaries with names as keys", "other keys")
        super().__setitem__(key, value)


def _bytes(data: Any, _encoding: Any = None) -> bytes:
    if not isinstance(data, str | bytes | bytearray) or len(data) > MOST_BYTES:
        raise _Refused(f"at most {MOST_BYTES} bytes of an array", "something else, or more")
    return data.encode("latin-1") if isinstance(data, str) else bytes(data)


def _scalar(dtype: Any, data: Any) -> int | float:
    (number,) = dtype.numbers(data)
    return number


KNOWN = {
    "_codecs.encode": _bytes,
    "numpy.dtype": lambda code, *_: _DType(code),
    "numpy.ndarray": None,
    "numpy.core.multiarray._reconstruct": lambda *_: _Array(),
    "numpy.core.multiarray.scalar": _scalar,
    "numpy.core.numeric._frombuffer": lambda data, dtype, *_: _Array(dtype.numbers(data)),
}
"""Names in a pickled NumPy array or number, and the function called in place of each."""

PLAIN_STEPS = """PROTO FRAME STOP MARK POP POP_MARK DUP PUT BINPUT LONG_BINPUT MEMOIZE GET BINGET LONG_BINGET
NONE NEWTRUE NEWFALSE INT BININT BININT1 BININT2 LONG LONG1 LONG4 FLOAT BINFLOAT STRING BINSTRING SHORT_BINSTRING
UNICODE BINUNICODE SHORT_BINUNICODE BINUNICODE8 BINBYTES SHORT_BINBYTES BINBYTES8 BYTEARRAY8 EMPTY_LIST EMPTY_TUPLE
EMPTY_DICT TUPLE TUPLE1 TUPLE2 TUPLE3 LIST APPEND APPENDS DICT SETITEM SETITEMS GLOBAL STACK_GLOBAL REDUCE BUILD"""
"""The instructions that are carried out: all that plain data and arrays need."""


class _Reader(pickle._Unpickler):
    """Python's own reader, in Python: the one in C sets aside as much memory as a file says that it needs."""

    def find_class(self, module: str, name: str) -> Any:
        moved = f"{module}.{name}".replace("numpy._core.", "numpy.core.", 1)  # NumPy 2 moved it
        if moved not in KNOWN:
            raise _Refused(PLAIN, f"a use of {module[:60]}.{name[:60]}")
        return KNOWN[moved]

    def load_build(self: Any) -> None:
        state, target = self.stack.pop(), self.stack[-1]
        if not isinstance(target, _Array | _DType):
            raise _Refused(PLAIN, "an object with a state of its own")
        target.fill(state)

    def load_empty_dictionary(self: Any) -> None:
        self.append(_Names())

    def load_dict(self: Any) -> None:
        items, names = self.pop_mark(), _Names()
        for key, value in zip(items[::2], items[1::2], strict=True):
            names[key] = value
        self.append(names)

    def load_put(self: Any) -> None:
        at = int(self.readline()[:-1])
        if not 0 <= at <= LARGEST:  # larger numbers can be chosen to collide
            raise _Refused("a pickle", "a damaged one (a memo beyond its size)")
        self.memo[at] = self.stack[-1]

    def load_bytearray8(self: Any) -> None:
        self.append(self.read(int.from_bytes(self.read(8), "little")))

    dispatch = {
        ord(op.code): pickle._Unpickler.dispatch[ord(op.code)]
        for op in pickletools.opcodes
        if op.name in PLAIN_STEPS.split()
    } | {
        pickle.EMPTY_DICT[0]: load_empty_dictionary,
        pickle.DICT[0]: load_dict,
        pickle.PUT[0]: load_put,
        pickle.BYTEARRAY8[0]: load_bytearray8,
        pickle.BUILD[0]: load_build,
    }


def read_pickle(path: str | os.PathLike) -> Any:
    """The plain data in a pickle of any protocol, arrays as lists; InputError for all else. Runs nothing."""
    path = check_file(path, "a pickle of boards")
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST + 1)
    except OSError as error:
        raise InputError(path, "a pickle of boards", (error.strerror or str(error)).lower()) from None
    if len(data) > LARGEST:
        raise InputError(path, "a pickle of boards, at most 1 MiB", "a larger file")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about an unknown escape in text
            return _Reader(io.BytesIO(data), encoding="latin-1").load()
    except _Refused as refusal:
        raise InputError(path, *refusal.args) from None
    except Exception as error:  # what the reader trips over in a damaged file can be anything
        text = " ".join(str(error).split())[:80] or type(error).__name__
        raise InputError(path, "a pickle", f"a damaged file, or one of another kind ({text})") from None


def read_pickled(
    path: str | os.PathLike, name: str | None, tag_edge: float, unit: float, y_down: bool = False
) -> Board:
    """The board `name` of a pickle `{name: [{tag_family, tag_id, center}]}`, as a Board in metres.

    `center`: x, y and mostly z, as list, tuple or array, in units of `unit` metres; `tag_edge` in metres, which the
    file does not contain. `y_down`: the file counts Y downwards, so turn its sign: else the board would be a mirror
    image.
    """
    boards = read_pickle(path)
    if not isinstance(boards, dict) or not boards:
        raise InputError(path, "boards by their names", _kind(boards))
    names = ", ".join(key[:24] for key in list(boards)[:12]) + (", ..." if len(boards) > 12 else "")
    if name is None or name not in boards:
        raise InputError("--name", f"one of {names}", "none" if name is None else name[:40])
    where = f"{path}: {name[:40]}"
    tags = boards[name]
    if not isinstance(tags, list | tuple) or not 0 < len(tags) <= MOST_TAGS:
        got = f"{len(tags)}" if isinstance(tags, list | tuple) else _kind(tags)
        raise InputError(where, f"a list of 1 to {MOST_TAGS} tags", got)
    found, families, heights = [], set(), []
    for i, tag in enumerate(tags):
        family, tag_id, (x, y, z) = _tag(f"{where}[{i}]", tag)
        families.add(family)
        heights.append(z)
        found.append(BoardTag(tag_id, (x * unit, (-y if y_down else y) * unit)))
    if len(families) > 1:
        raise InputError(f"{where}: tag_family", "one family for all tags", ", ".join(sorted(families)))
    if max(heights) - min(heights) > 1e-6 * tag_edge / unit:
        raise InputError(f"{where}: center", "all in one plane, z the same", f"z {min(heights):g} to {max(heights):g}")
    board = Board(families.pop(), tag_edge, tags=tuple(found))
    check_board(board, where)
    return board


def _tag(where: str, tag: Any) -> tuple[str, int, tuple[float, float, float]]:
    """(family, id, centre as in the file) of one entry; z is 0 where it has none."""
    if not isinstance(tag, dict):
        raise InputError(where, "tag_family, tag_id and center", _kind(tag))
    if lacking := [key for key in ("tag_family", "tag_id", "center") if key not in tag]:
        raise InputError(f"{where}.{lacking[0]}", "a value", "nothing")
    family, tag_id, center = tag["tag_family"], tag["tag_id"], tag["center"]
    if isinstance(family, bytes):
        family = family[:40].decode("latin-1")  # as the detector's own results hold it
    if not isinstance(family, str) or family not in FAMILIES:
        raise InputError(f"{where}.tag_family", f"one of {', '.join(FAMILIES)}", _kind(family))
    if type(tag_id) is not int or not 0 <= tag_id < family_size(family):
        raise InputError(f"{where}.tag_id", f"a whole number from 0 to {family_size(family) - 1}", _kind(tag_id))
    if not isinstance(center, list | tuple) or len(center) not in (2, 3):
        raise InputError(f"{where}.center", "two or three numbers", _kind(center))
    for value in center:
        # Also against infinity, NaN, and whole numbers that no float holds.
        if type(value) not in (int, float) or not -1e6 < value < 1e6:
            raise InputError(f"{where}.center", "finite numbers, at most a million", _kind(value))
    x, y, z = (float(v) for v in (*center, 0)[:3])
    return family, tag_id, (x, y, z)


def _kind(value: Any) -> str:
    """What was found, never more than a line of it: a few nested lists can stand for gigabytes of text."""
    if isinstance(value, str):
        return repr(value[:40])
    if value is None or isinstance(value, float | bool):
        return repr(value)
    if isinstance(value, int):
        return str(value) if abs(value) < 10**12 else "a huge number"
    if isinstance(value, list | tuple):
        return f"{len(value)} values"
    if isinstance(value, dict):
        return "a dictionary"
    return "bytes" if isinstance(value, bytes) else "something else"
