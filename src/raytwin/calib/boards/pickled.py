"""Boards that were saved as a Python pickle, `{name: [{tag_family, tag_id, center}]}`, read without running it.

A pickle is a program for a stack machine, and two of its instructions call what they like. Python's own reader carries
it out, but every name in it becomes a stand-in of this file, which copies a few numbers out of what NumPy's arrays
would have been given; no name is ever imported, and no instruction that makes other objects is known.

Nor may a small file ask for much: every instruction makes at most one small object, since arrays and byte strings that
come out of calls are bounded, only text may be a key (numbers can be made to collide, nested tuples take forever to
hash), and what one list or text is referred to from many places is never walked or shown as a whole.
"""

import io
import os
import pickle
import pickletools
import warnings
from collections.abc import Callable
from typing import Any, NoReturn

import numpy as np

from raytwin.calib.boards.board import FAMILIES, Board, BoardTag, check_board, family_size
from raytwin.errors import InputError
from raytwin.files import check_file

LARGEST = 1 << 20
"""Bytes of a file; a board of a thousand tags takes a tenth."""

MOST_VALUES = 16
"""Of an array: a centre has two or three."""

MOST_TAGS = max(map(family_size, FAMILIES))

DTYPES = {"f2", "f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8"}

PLAIN = "plain data and NumPy's numbers"


class _Refused(Exception):
    """expected, got"""


class _StandIn:
    """What a name in a pickle becomes: it may be called as the real one would be, and that is all."""

    __slots__ = ("make",)

    def __init__(self, make: Callable[..., Any]):
        self.make = make

    def __call__(self, *given: Any) -> Any:
        return self.make(*given)

    def __setstate__(self, state: Any) -> NoReturn:
        raise _Refused(PLAIN, "an object with a state of its own")


class _DType:
    """`numpy.dtype('f8', False, True)`; its state tells the byte order."""

    __slots__ = ("code", "order")

    def __init__(self, code: Any, align: Any = False, copy: Any = False):
        if not isinstance(code, str) or code not in DTYPES:
            of = "objects" if isinstance(code, str) and code[:1] == "O" else "something else"
            raise _Refused("arrays of numbers", f"an array of {of}")
        self.code, self.order = code, None if code[1:] != "1" else "|"

    def __setstate__(self, state: Any) -> None:
        order = state[1] if isinstance(state, tuple) and len(state) > 1 else None
        if not isinstance(order, str) or order not in ("<", ">", "|"):
            raise _Refused("a dtype of plain numbers", "another")
        self.order = order

    def values(self, data: Any) -> list[int | float]:
        """The numbers in a buffer: bytes, or text of the characters 0 to 255 as Python 2 wrote them."""
        data = _latin1(data)
        size = int(self.code[1:])
        if self.order is None or len(data) % size or len(data) > MOST_VALUES * size:
            raise _Refused(f"whole arrays of at most {MOST_VALUES} numbers", f"{len(data)} bytes of {self.code}")
        return np.frombuffer(data, self.order + self.code).tolist()


class _Array:
    """An ndarray that `_reconstruct` begins and its state fills; only its numbers count, in order."""

    __slots__ = ("values",)

    def __init__(self, kind: Any, shape: Any = None, code: Any = None):
        if kind is not NDARRAY:
            raise _Refused("an ndarray", "another kind of array")
        self.values: list[int | float] = []

    def __setstate__(self, state: Any) -> None:
        # (version,) shape, dtype, whether in Fortran's order, data
        if not isinstance(state, tuple) or len(state) not in (4, 5):
            raise _Refused("an array's state", "another")
        shape, dtype, _, data = state[-4:]
        self.fill(shape, dtype, data)

    def fill(self, shape: Any, dtype: Any, data: Any) -> None:
        if not isinstance(dtype, _DType):
            raise _Refused("an array of numbers", "another")
        values = dtype.values(data)
        # Vectors only, (3,) or (1, 3) or (3, 1): then the order in memory is the order.
        plain = isinstance(shape, tuple) and len(shape) <= 2 and all(type(n) is int for n in shape)
        if not plain or [n for n in shape if n != 1] not in ([len(values)], [] if len(values) == 1 else None):
            raise _Refused("a vector", "an array of another shape")
        self.values = values


def _latin1(data: Any) -> bytes:
    if isinstance(data, str) and len(data) <= 8 * MOST_VALUES:
        try:
            return data.encode("latin-1")
        except UnicodeEncodeError:
            raise _Refused("bytes as text", "characters above 255") from None
    if not isinstance(data, bytes | bytearray):
        raise _Refused(f"at most {8 * MOST_VALUES} bytes of an array", "something else, or more")
    return bytes(data)


def _encode(text: Any, encoding: Any) -> bytes:
    if encoding not in ("latin1", "latin-1") or not isinstance(text, str):
        raise _Refused("text for the bytes it stands for", "another use of _codecs.encode")
    return _latin1(text)


def _scalar(dtype: Any, data: Any) -> int | float:
    values = dtype.values(data) if isinstance(dtype, _DType) else []
    if len(values) != 1:
        raise _Refused("one number", f"{len(values)}")
    return values[0]


def _frombuffer(data: Any, dtype: Any, shape: Any, order: Any) -> _Array:
    array = _Array(NDARRAY)
    array.fill(shape, dtype, data)
    return array


def _no_array() -> NoReturn:
    raise _Refused(PLAIN, "a call of numpy.ndarray")


NDARRAY = _StandIn(_no_array)

KNOWN = {
    "_codecs.encode": _StandIn(_encode),
    "numpy.dtype": _StandIn(_DType),
    "numpy.ndarray": NDARRAY,
    "numpy.core.multiarray._reconstruct": _StandIn(_Array),
    "numpy.core.multiarray.scalar": _StandIn(_scalar),
    "numpy.core.numeric._frombuffer": _StandIn(_frombuffer),
}
"""What a pickled array or number of NumPy names, and what stands in for it."""

PLAIN_STEPS = """PROTO FRAME STOP MARK POP POP_MARK DUP PUT BINPUT LONG_BINPUT MEMOIZE GET BINGET LONG_BINGET
NONE NEWTRUE NEWFALSE INT BININT BININT1 BININT2 LONG LONG1 LONG4 FLOAT BINFLOAT STRING BINSTRING SHORT_BINSTRING
UNICODE BINUNICODE SHORT_BINUNICODE BINUNICODE8 BINBYTES SHORT_BINBYTES BINBYTES8 BYTEARRAY8 EMPTY_LIST EMPTY_TUPLE
EMPTY_DICT TUPLE TUPLE1 TUPLE2 TUPLE3 LIST APPEND APPENDS DICT SETITEM SETITEMS GLOBAL STACK_GLOBAL REDUCE BUILD"""
"""The instructions that are carried out: all that plain data and arrays need."""


class _Steps(dict[int, Callable[[Any], None]]):
    def __missing__(self, code: int) -> NoReturn:
        name = next((op.name for op in pickletools.opcodes if ord(op.code) == code), None)
        if name is None:
            raise _Refused("a pickle", "a damaged file, or one of another kind")
        raise _Refused(PLAIN, f"the instruction {name}, which makes other objects")


class _Reader(pickle._Unpickler):
    """Python's own reader, in Python: the one in C sets aside as much memory as a file says that it needs."""

    stack: list[Any]
    memo: dict[int, Any]
    append: Callable[[Any], None]
    pop_mark: Callable[[], list[Any]]
    read: Callable[[int], bytes]
    readline: Callable[[], bytes]

    def find_class(self, module: str, name: str) -> _StandIn:
        # NumPy 2 moved numpy.core to numpy._core.
        moved = f"{module}.{name}".replace("numpy._core.", "numpy.core.", 1)
        if moved not in KNOWN:
            raise _Refused(PLAIN, f"a use of {module[:60]}.{name[:60]}")
        return KNOWN[moved]

    def _set(self, items: list[Any]) -> None:
        if not isinstance(self.stack[-1], dict):
            raise _Refused("a pickle", "a damaged one (no dictionary to fill)")
        if len(items) % 2 or not all(type(key) is str for key in items[::2]):
            raise _Refused("dictionaries with names as keys", "other keys")
        self.stack[-1].update(zip(items[::2], items[1::2], strict=True))

    def load_dict(self) -> None:
        items = self.pop_mark()
        self.append({})
        self._set(items)

    def load_setitem(self) -> None:
        items = [self.stack.pop(), self.stack.pop()][::-1]
        self._set(items)

    def load_setitems(self) -> None:
        self._set(self.pop_mark())

    def load_put(self) -> None:
        at = int(self.readline()[:-1])
        if not 0 <= at <= LARGEST:
            raise _Refused("a pickle", "a damaged one (a memo beyond its size)")
        self.memo[at] = self.stack[-1]

    def load_bytearray8(self) -> None:
        size = int.from_bytes(self.read(8), "little")
        if size > 8 * MOST_VALUES:
            raise _Refused(f"at most {8 * MOST_VALUES} bytes of an array", f"{size}")
        self.append(self.read(size))

    dispatch = _Steps(
        {
            ord(op.code): pickle._Unpickler.dispatch[ord(op.code)]
            for op in pickletools.opcodes
            if op.name in PLAIN_STEPS.split()
        }
        | {
            pickle.DICT[0]: load_dict,
            pickle.SETITEM[0]: load_setitem,
            pickle.SETITEMS[0]: load_setitems,
            pickle.PUT[0]: load_put,
            pickle.BYTEARRAY8[0]: load_bytearray8,
        }
    )


def read_pickle(path: str | os.PathLike) -> Any:
    """The plain data in a pickle of any protocol, arrays as `_Array`; InputError for all else. Runs nothing."""
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
    file does not tell. `y_down`: the file counts Y downwards, so turn its sign: else the board would be a mirror image.
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
    values = center.values if isinstance(center, _Array) else center
    if not isinstance(values, list | tuple) or len(values) not in (2, 3):
        raise InputError(f"{where}.center", "two or three numbers", _kind(center))
    for value in values:
        # Also against infinity, NaN, and whole numbers that no float holds.
        if type(value) not in (int, float) or not -1e6 < value < 1e6:
            raise InputError(f"{where}.center", "finite numbers, at most a million", _kind(value))
    x, y, z = (float(v) for v in (*values, 0)[:3])
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
    return (
        "an array"
        if isinstance(value, _Array)
        else "a dictionary"
        if isinstance(value, dict)
        else "bytes"
        if isinstance(value, bytes)
        else "another"
    )
