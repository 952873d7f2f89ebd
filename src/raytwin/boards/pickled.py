"""Boards that were saved as a Python pickle, `{name: [{tag_family, tag_id, center}]}`, read without running it.

A pickle is a program for a stack machine, and two of its instructions call what they like. Python's own reader with a
list of allowed names would still hand the file's arguments to NumPy's constructors and `__setstate__`, which trust
them. So this reads the instructions with pickletools, which only decodes, and carries out those that build plain data.
A call is looked up in a table of four forms that NumPy's arrays and numbers take, and answered by functions of this
file; no name is ever imported, and no object of the file's choosing ever made.

Nor may a small file ask for much: every instruction makes at most one small object, since arrays and byte strings that
come out of calls are bounded, only text may be a key (numbers can be made to collide), and what one list or text is
referred to from many places is never walked or shown as a whole.
"""

import os
import pickletools
import struct
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from raytwin.boards.board import FAMILIES, Board, BoardTag, check_board, family_size
from raytwin.errors import InputError

LARGEST = 1 << 20
"""Bytes of a file; a board of a thousand tags takes a tenth."""

MOST_VALUES = 16
"""Of an array: a centre has two or three."""

MOST_TAGS = max(map(family_size, FAMILIES))

DTYPES = {
    f"{kind}{size}" for kind, sizes in {"f": (2, 4, 8), "i": (1, 2, 4, 8), "u": (1, 2, 4, 8)}.items() for size in sizes
}


class _Refused(Exception):
    """expected, got"""


class _Name(NamedTuple):
    module: str
    name: str


class _DType:
    """`numpy.dtype('f8', False, True)`; its state tells the byte order."""

    def __init__(self, code: str):
        self.code, self.order = code, None if code[1:] != "1" else "|"

    def set(self, state: Any) -> None:
        order = state[1] if isinstance(state, tuple) and len(state) > 1 else None
        if not isinstance(order, str) or order not in ("<", ">", "|"):
            raise _Refused("a dtype of plain numbers", "another")
        self.order = order

    def values(self, data: Any) -> list:
        """The numbers in a buffer: bytes, or text of the characters 0 to 255 as Python 2 wrote them."""
        data = _latin1(data)
        size = int(self.code[1:])
        if self.order is None or len(data) % size or len(data) > MOST_VALUES * size:
            raise _Refused(f"whole arrays of at most {MOST_VALUES} numbers", f"{len(data)} bytes of {self.code}")
        return np.frombuffer(data, self.order + self.code).tolist()


class _Array:
    """An ndarray that `_reconstruct` begins and its state fills; only its numbers count, in order."""

    def __init__(self):
        self.values: list | None = None

    def set(self, state: Any) -> None:
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
    if not isinstance(data, bytes):
        raise _Refused(f"at most {8 * MOST_VALUES} bytes of an array", "something else, or more")
    return data


def _encode(text: Any, encoding: Any) -> bytes:
    if encoding not in ("latin1", "latin-1") or not isinstance(text, str):
        raise _Refused("text for the bytes it stands for", "another use of _codecs.encode")
    return _latin1(text)


def _dtype(code: Any, *_: Any) -> _DType:
    if isinstance(code, str) and code[:1] == "O":
        raise _Refused("arrays of numbers", "an array of objects")
    if not isinstance(code, str) or code not in DTYPES:
        raise _Refused("arrays of numbers", "an array of something else")
    return _DType(code)


def _scalar(dtype: Any, data: Any) -> int | float:
    values = dtype.values(data) if isinstance(dtype, _DType) else []
    if len(values) != 1:
        raise _Refused("one number", f"{len(values)}")
    return values[0]


def _reconstruct(kind: Any, *_: Any) -> _Array:
    if not isinstance(kind, _Name) or kind.name != "ndarray":
        raise _Refused("an ndarray", "another kind of array")
    return _Array()


def _frombuffer(data: Any, dtype: Any, shape: Any, *_: Any) -> _Array:
    array = _Array()
    array.fill(shape, dtype, data)
    return array


CALLS = {
    _Name("_codecs", "encode"): _encode,
    _Name("numpy", "dtype"): _dtype,
    _Name("numpy.core.multiarray", "_reconstruct"): _reconstruct,
    _Name("numpy.core.multiarray", "scalar"): _scalar,
    _Name("numpy.core.numeric", "_frombuffer"): _frombuffer,
}
"""What a pickled array or number of NumPy calls, and what is done instead."""

KNOWN = {*CALLS, _Name("numpy", "ndarray")}


def _known(module: Any, name: Any) -> _Name:
    if isinstance(module, str) and isinstance(name, str):
        # NumPy 2 moved numpy.core to numpy._core.
        moved = module.replace("numpy._core.", "numpy.core.", 1) if module.startswith("numpy._core.") else module
        if _Name(moved, name) in KNOWN:
            return _Name(moved, name)
        raise _Refused("plain data and NumPy's numbers", f"a use of {module[:60]}.{name[:60]}")
    raise _Refused("plain data and NumPy's numbers", "a name that is no text")


_MARK = object()

VALUES = {
    "INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT",
    "STRING", "BINSTRING", "SHORT_BINSTRING", "UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8",
    "BINBYTES", "SHORT_BINBYTES", "BINBYTES8",
}  # fmt: skip
CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
MADE = {"EMPTY_LIST": list, "EMPTY_TUPLE": tuple, "EMPTY_DICT": dict}
SMALL_TUPLES = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}


class _Machine:
    """The pickle's stack and memo; `run` carries out one instruction."""

    def __init__(self):
        self.stack: list[Any] = []
        self.memo: dict[int, Any] = {}

    def pop(self, count: int = 1) -> list[Any]:
        if len(self.stack) < count or any(item is _MARK for item in self.stack[-count:]):
            raise _Refused("a pickle", "a damaged one (an empty stack)")
        items = self.stack[-count:]
        del self.stack[-count:]
        return items

    def to_mark(self) -> list[Any]:
        items = []
        while self.stack:
            if (item := self.stack.pop()) is _MARK:
                return items[::-1]
            items.append(item)
        raise _Refused("a pickle", "a damaged one (no mark)")

    def top(self, kind: type) -> Any:
        if not self.stack or not isinstance(self.stack[-1], kind):
            raise _Refused("a pickle", f"a damaged one (no {kind.__name__} to fill)")
        return self.stack[-1]

    def remember(self, index: int) -> None:
        (item,) = self.pop()
        self.stack.append(item)
        if not 0 <= index <= LARGEST:
            raise _Refused("a pickle", "a damaged one (a memo beyond its size)")
        self.memo[index] = item

    def set_items(self, items: list[Any]) -> None:
        keys = items[::2]
        if len(items) % 2 or not all(type(key) is str for key in keys):
            raise _Refused("dictionaries with names as keys", "other keys")
        self.top(dict).update(zip(keys, items[1::2], strict=True))

    def run(self, op: str, arg: Any) -> None:
        push = self.stack.append
        if op in VALUES:
            push(arg)
        elif op == "BYTEARRAY8":
            push(bytes(arg))
        elif op in CONSTANTS:
            push(CONSTANTS[op])
        elif op in MADE:
            push(MADE[op]())
        elif op in SMALL_TUPLES:
            push(tuple(self.pop(SMALL_TUPLES[op])))
        elif op == "TUPLE":
            push(tuple(self.to_mark()))
        elif op == "LIST":
            push(self.to_mark())
        elif op == "APPEND":
            items = self.pop()
            self.top(list).extend(items)
        elif op == "APPENDS":
            items = self.to_mark()
            self.top(list).extend(items)
        elif op == "DICT":
            items = self.to_mark()
            push({})
            self.set_items(items)
        elif op == "SETITEM":
            self.set_items(self.pop(2))
        elif op == "SETITEMS":
            self.set_items(self.to_mark())
        elif op == "MARK":
            push(_MARK)
        elif op == "POP":
            if not self.stack:
                raise _Refused("a pickle", "a damaged one (an empty stack)")
            self.stack.pop()
        elif op == "POP_MARK":
            self.to_mark()
        elif op == "DUP":
            (item,) = self.pop()
            self.stack += [item, item]
        elif op in ("PUT", "BINPUT", "LONG_BINPUT"):
            self.remember(arg)
        elif op == "MEMOIZE":
            self.remember(len(self.memo))
        elif op in ("GET", "BINGET", "LONG_BINGET"):
            if arg not in self.memo:
                raise _Refused("a pickle", "a damaged one (nothing remembered)")
            push(self.memo[arg])
        elif op == "GLOBAL":
            push(_known(*arg.split(" ", 1)))
        elif op == "STACK_GLOBAL":
            push(_known(*self.pop(2)))
        elif op == "REDUCE":
            called, given = self.pop(2)
            self.call(called, given)
        elif op == "BUILD":
            thing, state = self.pop(2)
            if not isinstance(thing, _Array | _DType):
                raise _Refused("plain data and NumPy's numbers", "an object with a state of its own")
            thing.set(state)
            push(thing)
        elif op not in ("PROTO", "FRAME", "STOP"):
            raise _Refused("plain data and NumPy's numbers", f"the instruction {op}, which makes other objects")

    def call(self, called: Any, given: Any) -> None:
        if not isinstance(called, _Name) or called not in CALLS or not isinstance(given, tuple):
            raise _Refused("plain data and NumPy's numbers", "a call of something else")
        least, most = (
            (2, 2) if called.name in ("encode", "scalar") else (3, 4) if called.name == "_frombuffer" else (1, 3)
        )
        if not least <= len(given) <= most:
            raise _Refused("a pickle", f"a damaged one ({called.name} of {len(given)} values)")
        self.stack.append(CALLS[called](*given))


def read_pickle(path: str | os.PathLike) -> Any:
    """The plain data in a pickle of any protocol, arrays as `_Array`; InputError for all else. Runs nothing."""
    path, machine = Path(path), _Machine()
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST + 1)
    except OSError as error:
        raise InputError(path, "a pickle of boards", (error.strerror or str(error)).lower()) from None
    if len(data) > LARGEST:
        raise InputError(path, "a pickle of boards, at most 1 MiB", "a larger file")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pickletools, about an unknown escape in text
            for opcode, arg, _ in pickletools.genops(data):
                machine.run(opcode.name, arg)
        (found,) = machine.pop()
    except _Refused as refusal:
        raise InputError(path, *refusal.args) from None
    except (ValueError, OverflowError, IndexError, struct.error) as error:  # pickletools, on what it cannot decode
        raise InputError(path, "a pickle", f"a damaged file, or one of another kind ({str(error)[:80]})") from None
    return found


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
        "an array" if isinstance(value, _Array) else {dict: "a dictionary", bytes: "bytes"}.get(type(value), "another")
    )
