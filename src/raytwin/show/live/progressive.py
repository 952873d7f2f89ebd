"""What the page wants to see, rendered: a quick picture while something moves, one pass after the other when it rests.

Each pass is a whole run of a method, so that its seconds and its error are those of that method: a point of the chart.
Errors are against all light over the pixel's area, from two independent halves of random walks: the mean of
(x - half) (x - other half) has no noise of the halves in it.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from raytwin import twin
from raytwin.explain.ledger import make_ledger
from raytwin.fast import ENGINES
from raytwin.images.image import Image
from raytwin.images.packing import binned
from raytwin.images.photo_files import encoded, to_bytes
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.subject_renderers import PathTraced, Traced, fast_engine
from raytwin.rungs import RUNGS
from raytwin.scene import Scene
from raytwin.scene.toml_json import plain
from raytwin.show import viewer
from raytwin.show.live.view_state import Look, ViewRequest
from raytwin.study.compare_scene import compare_with_twin

QUALITY = 85
"""JPEG quality of the pictures sent while the view moves."""
WHOLE_SAMPLES = 8
"""Samples per pixel in each half of the global-illumination reference."""
SEEDS = 0xE47, 0x10E
"""Seeds of the two halves; no rendering pass uses them."""
BLOCK = 2
"""Side in pixels of the blocks that a noisy difference is averaged over while something moves."""
TWIN_EVERY = 3
"""Pause of the twin while something moves, in units of its last render, so that the tracer gets most of the time."""

Event = tuple[dict[str, Any], tuple[bytes, ...]]
"""What is sent to the page, and bytes that belong to it."""


@dataclass(frozen=True)
class Session:
    """A scene and what can render it here. `subject`: in the tracer's place, where given; `folder`: the scene's own."""

    base: Scene
    subject: Renderer | None = None
    folder: Path = Path()

    @property
    def engines(self) -> tuple[str, ...]:
        """Rows of ENGINES that work here, the fastest first."""
        fast = fast_engine(twin.activate().variant)
        double = next(name for name, row in ENGINES.items() if row == ENGINES[fast]._replace(precision="float64"))
        return tuple(dict.fromkeys((fast, double, "numpy32", "numpy64")))

    def tracer(self, wanted: ViewRequest, samples: int) -> Renderer:
        if self.subject is not None:
            return replace(self.subject, rung=wanted.rung)
        if RUNGS[wanted.rung].noisy:
            depth = None if RUNGS[wanted.rung].depth == 2 else wanted.depth
            return PathTraced(wanted.rung, wanted.engine, samples, surface=not wanted.moving, depth=depth)
        return Traced(wanted.rung, wanted.engine, solver=wanted.solver, surface=not wanted.moving)

    def twin(self, wanted: ViewRequest, scene: Scene, samples: int, seed: int) -> Image:
        row = RUNGS[wanted.twin_rung]
        depth = None if row.depth in (None, 2) else wanted.depth
        return twin.render(
            scene, wanted.twin_rung, sampling="area" if row.noisy else "center", samples=samples, seed=seed,
            max_depth=depth, cache=False,
        )  # fmt: skip

    def fails(self, wanted: ViewRequest, scene: Scene, test: Image, reference: Image) -> bool:
        """Return whether the tracer's image fails against the twin at the tracer's rung; `reference`: at the twin's."""
        if wanted.rung != wanted.twin_rung:
            level = msgspec.structs.replace(wanted, twin_rung=wanted.rung)
            reference = self.twin(level, scene, 1, 0)
        return compare_with_twin(test, reference, scene, self.base.tolerance).verdict == "fail"

    def passes(self, wanted: ViewRequest) -> Iterator[Event]:
        """Yield what is sent to the page, one event at a time. Between two of them it may be stopped."""
        scene, fast = wanted.scene(self.base), self.engines[0]
        method = self.tracer(wanted, 1)
        test, seconds = _timed(method, scene, 0)
        yield picture("test", test, wanted.look, seconds, test.samples)
        reference, seconds_twin = _timed(self.twin, wanted, scene, 1, 0)
        shown, (jpeg,) = picture("reference", reference, wanted.look, seconds_twin, reference.samples)
        noisy = method.noisy or RUNGS[wanted.twin_rung].noisy
        yield shown, (jpeg, difference(test, reference, wanted.look, BLOCK if noisy else 1))
        if wanted.moving:
            return
        yield pair(test, reference, scene.names, noisy)
        halves = [PathTraced("path", fast, WHOLE_SAMPLES)(scene, seed) for seed in SEEDS]
        yield point("tracer", method, test, seconds, halves)
        yield point("twin", None, reference, seconds_twin, halves)
        if RUNGS[wanted.rung].lit:
            faulty = self.fails(wanted, scene, test, reference)
            ledger = make_ledger(scene, test, wanted.rung, fast, wanted.depth, faulty=faulty)
            noise = {part.part: part.noise or 0.0 for part in ledger.parts}
            maps = viewer.raw_parts(ledger.pictures, ledger.step, noise)
            words = tuple(blob for _, blobs in maps for blob in blobs)
            yield {"kind": "ledger", "parts": plain(ledger.parts), "maps": [about for about, _ in maps]}, words
        samples = 2
        while samples <= wanted.samples and noisy:
            if method.noisy:
                method = self.tracer(wanted, samples)
                test, seconds = _timed(method, scene, samples)
                yield point("tracer", method, test, seconds, halves)
            if RUNGS[wanted.twin_rung].noisy:
                reference, seconds = _timed(self.twin, wanted, scene, samples, samples)
                yield point("twin", None, reference, seconds, halves)
            yield pair(test, reference, scene.names, noisy)
            samples *= 2
        yield {"kind": "rest"}, ()


def _timed(make: Callable[..., Image], *arguments: Any) -> tuple[Image, float]:
    start = time.perf_counter()
    return make(*arguments), time.perf_counter() - start


def point(side: str, method: Renderer | None, image: Image, seconds: float, halves: list[Image]) -> Event:
    """Where a pass stands on the chart: seconds beside the RMSE against the whole light; null where
    it lies below the `floor` that the halves' noise leaves."""
    one, other = (image.mean - half.mean for half in halves)
    squared = float((one * other).mean(dtype=float))
    noise = float(np.mean([np.mean(half.variance, dtype=float) for half in halves if half.variance is not None]))
    floor = float(np.sqrt(noise / np.sqrt(one.size)))
    error = float(np.sqrt(squared)) if squared > floor**2 else None
    about = {"side": side, "name": method.name if method else "twin", "samples": image.samples}
    return {"kind": "point", **about, "seconds": seconds, "error": error, "floor": floor}, ()


def picture(pane: str, image: Image, look: Look, seconds: float, samples: int) -> Event:
    """A JPEG of it, as the page would show it."""
    jpeg = encoded(to_screen(image.mean, look.exposure), "jpeg", quality=QUALITY)
    return {"kind": "picture", "pane": pane, "seconds": seconds, "samples": samples}, (jpeg,)


def difference(test: Image, reference: Image, look: Look, side: int = 1) -> bytes:
    """Return a grey PNG of the error of the channel that errs most: 127 for none, 0 and 254 for `look.high`.

    Means of blocks of `side` x `side` pixels, in which noise averages out; 255 where there is no number.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        error = binned(Image(test.mean - reference.mean), side).mean
    worst = np.take_along_axis(error, np.abs(error).argmax(axis=-1)[..., None], axis=-1)[..., 0]
    size = np.abs(worst)
    if look.log and look.low > 0:
        share = np.log(np.maximum(size, look.low) / look.low) / math.log(look.high / look.low)
    else:
        share = size / look.high
    signed = np.rint(127 * np.copysign(np.minimum(share, 1), worst) + 127)
    grey = np.where(np.isnan(worst), 255, np.nan_to_num(signed)).astype(np.uint8)
    return encoded(grey, "png", compress_level=1)


def pair(test: Image, reference: Image, names: tuple[str, ...], noisy: bool) -> Event:
    """Both images' values, and what their objects are called."""
    planes, words = zip(*viewer.raw(test, reference), strict=True)
    return {
        "kind": "pair",
        "planes": planes,
        "names": names,
        "noisy": noisy,
        "samples": [test.samples, reference.samples],
    }, words


def to_screen(mean: np.ndarray, exposure: float) -> np.ndarray:
    """(H, W, 3) uint8 by the viewer's exposure in stops."""
    with np.errstate(over="ignore"):
        return _bytes_of(exposure)[mean.astype(np.float16).view(np.uint16)]


@lru_cache(4)
def _bytes_of(exposure: float) -> np.ndarray:
    """(65536,) uint8: what is shown for every half float. Many pictures in a row have one exposure."""
    halves = np.arange(1 << 16, dtype=np.uint16).view(np.float16).astype(np.float32)
    with np.errstate(all="ignore"):
        return to_bytes(halves * np.float32(2.0**exposure))


def as_message(event: Mapping[str, Any], blobs: tuple[bytes, ...]) -> bytes:
    """One message: the length of the JSON (4 bytes, little end first), the JSON, and the bytes, each padded to four.

    `sizes` in the JSON has their lengths.
    """
    head = msgspec.json.encode({**event, "sizes": [len(blob) for blob in blobs]})
    head += b" " * (-len(head) % 4)
    return b"".join([len(head).to_bytes(4, "little"), head, *(blob + bytes(-len(blob) % 4) for blob in blobs)])
