"""Time, memory and error of many methods, interleaved: every round runs all in a new order, so that drift hits all."""

import contextlib
import ctypes
import gc
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np

from raytwin.image import Image
from raytwin.renderers.renderer import Call, Renderer

Clock = Callable[[], float]
T = TypeVar("T")
Errors = dict[str, dict[str, float | None]]
"""Truth's name -> ERRORS."""
Look = Callable[[Renderer, Image], Errors]

NOISY_IMAGES = 5
"""Images per method compared with the reference, where they differ from seed to seed."""


@dataclass(eq=False)
class Measured:
    """One method while it is measured. `guess`: the seconds that its next call is expected to take."""

    method: Renderer
    call: Call
    guess: float
    compile_seconds: float = 0.0
    peak_mib: float | None = None
    seconds: list[float] = field(default_factory=list)
    errors: list[Errors] = field(default_factory=list)


def orders(count: int, seed: int = 0) -> Iterator[list[int]]:
    """Endless permutations of range(count): neighbours change, so that no method always runs behind a greedy one."""
    rng = np.random.default_rng(seed)
    while True:
        yield [int(i) for i in rng.permutation(count)]


def warm(measured: Measured, look: Look, clock: Clock = time.perf_counter) -> None:
    """The first call at full size: not timed for the median; its memory and its image's error are taken."""
    start = clock()
    image, measured.peak_mib = with_peak(lambda: measured.call(0))
    measured.guess = clock() - start
    measured.compile_seconds += measured.guess  # less the median, once that is known
    if measured.method.library.startswith("cuda"):
        measured.peak_mib = None  # the GPU's memory is not the process's
    measured.errors.append(look(measured.method, image))


def repeat(
    all_of_them: Sequence[Measured],
    look: Look,
    deadline: float,
    repeats: int,
    clock: Clock = time.perf_counter,
) -> None:
    """Rounds of timed calls, until each has `repeats`, or its share of the time is spent, or the deadline is near.

    Three calls come before any share is asked for; no call begins that is expected to end past the deadline.
    """
    if not all_of_them:
        return
    share = (deadline - clock()) / len(all_of_them)
    for order in orders(len(all_of_them)):
        ran = False
        for m in (all_of_them[i] for i in order):
            done = len(m.seconds)
            if done >= repeats or (done >= 3 and sum(m.seconds) + m.guess > share):
                continue
            if clock() + m.guess > deadline:
                continue
            gc.disable()
            start = clock()
            image = m.call(done + 1)
            taken = clock() - start
            gc.enable()
            m.seconds.append(taken)
            m.guess = float(np.median(m.seconds))
            ran = True
            if m.method.noisy and len(m.errors) < NOISY_IMAGES:
                m.errors.append(look(m.method, image))
        if not ran:
            break
    for m in all_of_them:
        if m.seconds:
            m.compile_seconds = max(0.0, m.compile_seconds - float(np.median(m.seconds)))


def guess(small: tuple[int, float], larger: tuple[int, float], pixels: int) -> float:
    """The seconds of `pixels` pixels on the line through two (pixels, seconds)."""
    slope = max(0.0, (larger[1] - small[1]) / (larger[0] - small[0]))
    return larger[1] + slope * max(0, pixels - larger[0])


# ------------------------------------------------------------------------------------------ memory


def with_peak(call: Callable[[], T]) -> tuple[T, float | None]:
    """The call's result, and the most resident memory of the process during it beyond what it held before, MiB.

    From Linux's high-water mark (VmHWM), which /proc/self/clear_refs resets; None elsewhere. Freed memory that NumPy,
    Dr.Jit or the C library keep for reuse is handed back first, or it would hide the call's own.
    """
    gc.collect()
    if "drjit" in sys.modules:
        with contextlib.suppress(Exception):  # no backend in use yet
            sys.modules["drjit"].flush_malloc_cache()
    with contextlib.suppress(OSError, AttributeError, TypeError):  # Windows has no such library
        ctypes.CDLL(None).malloc_trim(0)
    try:
        Path("/proc/self/clear_refs").write_text("5")
        before = _status("VmRSS")
    except OSError:
        return call(), None
    result = call()
    return result, max(0.0, _status("VmHWM") - before) / 1024


def _status(name: str) -> int:
    """kB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(name + ":"):
            return int(line.split()[1])
    raise OSError(f"/proc/self/status has no {name}")
