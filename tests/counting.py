"""Work that is counted, not timed: calls are the same on every machine and under every load."""

import sys
from collections import Counter
from collections.abc import Callable
from typing import Any


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
