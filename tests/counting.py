"""Work that is counted, not timed: calls and comparisons are the same on every machine and under every load."""

import sys
from collections import Counter
from collections.abc import Callable
from typing import Any


class Compared(str):
    """A text that counts how often one of its kind is compared with another."""

    __slots__ = ()
    times = 0

    def __eq__(self, other: object) -> bool:
        Compared.times += 1
        return str.__eq__(self, other)

    __hash__ = str.__hash__


def calls(act: Callable[[], Any]) -> int:
    """How many functions, of Python's and C's, `act` calls."""
    counted: Counter[str] = Counter()
    before = sys.getprofile()
    sys.setprofile(lambda _, event, __: counted.update((event,)))
    try:
        act()
    finally:
        sys.setprofile(before)
    return counted["call"] + counted["c_call"]


def lines(act: Callable[[], Any], function: Callable[..., Any]) -> int:
    """How many lines of `function` itself are run while `act` is."""
    counted: Counter[str] = Counter()

    def local(frame: Any, event: str, _: Any) -> Any:
        counted.update((event,))
        return local

    before = sys.gettrace()
    sys.settrace(lambda frame, *_: local if frame.f_code is function.__code__ else None)
    try:
        act()
    finally:
        sys.settrace(before)
    return counted["line"]
