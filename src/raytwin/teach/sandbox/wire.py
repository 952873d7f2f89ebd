"""Messages between the grader and a submission's process: 8 bytes of length, a JSON head, then the arrays' bytes.

Nothing in them is run when they are read, and none is longer than the reader allows: a hostile process may have written
them. Standard library and NumPy alone: a submission's process loads this file, and nothing else of raytwin.
"""

import json
import math
import re
from collections.abc import Callable
from typing import Any, BinaryIO

import numpy as np

MOST_ARRAYS = 1 << 10
"""Arrays per message: more are refused."""
MOST_HEAD = 1 << 20
"""Bytes of a message's head: more are refused."""


class WireError(ValueError):
    """What arrived is no message."""


def write(stream: BinaryIO, value: Any) -> None:
    """`value`: dicts with text keys, lists, text, numbers, None and arrays. NaN and infinity are kept."""
    arrays: list[np.ndarray] = []
    head = json.dumps({"value": _flat(value, arrays), "arrays": [[a.dtype.str, *a.shape] for a in arrays]}).encode()
    size = 8 + len(head) + sum(a.nbytes for a in arrays)
    stream.write(size.to_bytes(8, "little") + len(head).to_bytes(8, "little") + head)
    for array in arrays:
        stream.write(array.tobytes())
    stream.flush()


def read(take: Callable[[int], bytearray], most: int, trusted: bool = False) -> Any:
    """Return the next message; `take(n)` gives exactly n bytes or raises EOFError. WireError for anything else.

    `trusted`: the grader wrote it, with as large a head and as many arrays as the message allows.
    """
    size = int.from_bytes(take(8), "little")
    if not 8 <= size <= most:
        raise WireError(f"a message of {size} bytes, where at most {most} are taken")
    headed = int.from_bytes(take(8), "little")
    if headed > (size - 8 if trusted else min(size - 8, MOST_HEAD)):
        raise WireError("a head longer than its message")
    try:
        head = json.loads(take(headed))
        value, shapes = head["value"], head["arrays"]
        layout = [(_number_type(kind), tuple(map(_length, shape))) for kind, *shape in shapes]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise WireError(f"a head that cannot be read ({type(error).__name__})") from None
    sizes = [math.prod(shape) * kind.itemsize for kind, shape in layout]
    if (len(layout) > MOST_ARRAYS and not trusted) or sum(sizes) + headed + 8 != size:
        raise WireError("arrays that do not fill their message")
    data = [np.frombuffer(take(n), kind).reshape(shape) for (kind, shape), n in zip(layout, sizes, strict=True)]
    try:
        return _whole(value, data)
    except (IndexError, KeyError, TypeError, AttributeError, RecursionError):
        raise WireError("a value that is no table, list or array") from None


def exactly(stream: BinaryIO) -> Callable[[int], bytearray]:
    """`take` of a blocking stream; memory grows with what arrives, not with what was announced."""

    def take(count: int) -> bytearray:
        taken = bytearray()
        while len(taken) < count:
            part = stream.read(min(count - len(taken), 1 << 20))
            if not part:
                raise EOFError
            taken += part
        return taken

    return take


def _number_type(text: Any) -> np.dtype:
    if not re.fullmatch("[<>|=]?[fiub][1248]", str(text)):
        raise ValueError("no numbers")
    return np.dtype(str(text))


def _length(value: Any) -> int:
    if type(value) is not int or value < 0:
        raise ValueError("no length")
    return value


def _flat(value: Any, arrays: list[np.ndarray]) -> Any:
    if isinstance(value, np.ndarray):
        arrays.append(np.ascontiguousarray(value).reshape(value.shape))
        return {"array": len(arrays) - 1}
    if isinstance(value, dict):
        return {"table": {str(k): _flat(v, arrays) for k, v in value.items()}}
    if isinstance(value, list | tuple):
        return [_flat(v, arrays) for v in value]
    return value.item() if isinstance(value, np.generic) else value


def _whole(value: Any, arrays: list[np.ndarray]) -> Any:
    if isinstance(value, list):
        return [_whole(v, arrays) for v in value]
    if isinstance(value, dict):
        if "array" in value:
            return arrays[value["array"]]
        return {k: _whole(v, arrays) for k, v in value["table"].items()}
    return value
