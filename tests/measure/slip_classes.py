"""Which slips of the textbook show what: `python -m measure.slip_classes [FORM ...]`, in tests/, writes
`diagnose/slips.tsv`; of forms that are named only the slips in these are looked for, and added.

Every slip of the operators is put into every function of the textbook, in each of its right forms, and rendered on
drawn scenes. Slips with the same picture are one class, of which the least far-fetched member is kept. What changes
nothing, does not run, or is a fault of the catalogue already, is left out.
"""

import ast
import resource
import signal
import sys
import time
import warnings
from collections.abc import Iterator, Sequence

import numpy as np

from raytwin.diagnose.catalogue import FAULTS
from raytwin.diagnose.draw_scene import draw_scene
from raytwin.diagnose.operators import Edit, edits
from raytwin.diagnose.predict import RIGHT, Pipeline, Predictor, predictor
from raytwin.diagnose.slip_table import FILE, PLACES, Slip, forms_of, read, write

MOST = 1.35
"""Weight: what is more far-fetched is left out."""
RARER = {
    "a square root is missing": 0.6, "a square is missing": 0.3, "the absolute value is missing": 0.6,
    "a bound of 0 is missing": 0.6, "it is not made unit": 0.6, "it is not transposed": 0.6, "pi is missing": 0.3,
    "pi is too many": 0.3, "there are too few steps": 9.0,
}  # fmt: skip
"""Operator of repairs -> weight that is added where its reverse is a mistake: few take a root that is not wanted."""
PIXELS = 150
DIGITS = 2e-6
"""Share of the scale: pictures that differ by less are the same."""


def predictors() -> list[Predictor]:
    """Chosen pixels of three drawn scenes, the last without shadows."""
    made = []
    for seed in (11, 12, 13):
        whole = predictor(draw_scene(seed), seed != 13)
        at = np.random.default_rng(seed).choice(whole.u.size, PIXELS, replace=False)
        made.append(whole.at(whole.u[at], whole.v[at]))
    return made


def picture(scene: Predictor, way: Pipeline) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = scene.picture(way)
    if made.shape != (PIXELS, 3):
        raise ValueError(made.shape)
    return made


def alone(scene: Predictor, way: Pipeline, whole: np.ndarray) -> bool:
    """Whether what a pixel shows is the same without the other half of the pixels."""
    made = scene.at(scene.u[::2], scene.v[::2]).picture(way)
    return made.shape == whole[::2].shape and np.allclose(made, whole[::2], rtol=1e-6, atol=1e-9, equal_nan=True)


def signature(pictures: list[np.ndarray]) -> bytes:
    whole = np.nan_to_num(np.concatenate(pictures), nan=-7.0, posinf=7e3, neginf=-7e3)
    return np.rint(np.clip(whole, -1e4, 1e4) / DIGITS / 4 + 0.123).astype(np.int64).tobytes()


def written(only: Sequence[str]) -> Iterator[tuple[float, str, str, Edit]]:
    """(weight, form, function, edit), the least far-fetched first."""
    found = []
    for function in PLACES:
        for k, (form, text) in enumerate(forms_of(function)):
            if only and form not in only:
                continue
            (statement,) = ast.parse(text).body
            for e in edits(statement):
                weight = e.weight + RARER.get(e.operator, 0.0) + 0.01 * k
                if weight <= MOST:
                    found.append((weight, form, function, e))
    yield from sorted(found, key=lambda x: x[0])


def stop(number: int, frame: object) -> None:
    raise TimeoutError


def main(*only: str) -> int:
    resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))  # a slip may ask for arrays without end
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGVTALRM, stop)
    scenes = predictors()
    right = [picture(one, RIGHT) for one in scenes]
    known = {signature(right)}
    count = 0
    for fault in FAULTS:
        for way in fault.ways:
            try:
                known.add(signature([picture(one, way) for one in scenes]))
                count += 1
            except (ValueError, TypeError, IndexError):
                pass
    print(count, "ways of the catalogue,", len(known), "pictures", flush=True)
    rows: list[Slip] = list(read()) if only else []
    for row in rows:
        known.add(signature([picture(one, row.way) for one in scenes]))
    tried = broken = 0
    began = time.process_time()
    for weight, form, function, edit in written(only):
        slip = Slip.of(weight, form, function, edit)
        if slip is None:
            continue
        tried += 1
        try:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0.3)
            pictures = [picture(one, slip.way) for one in scenes]
        except Exception:  # what does not run is no prediction
            broken += 1
            continue
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        key = signature(pictures)
        if key not in known and alone(scenes[0], slip.way, pictures[0]):
            known.add(key)
            rows.append(slip)
        if len(rows) % 100 == 0:
            print(tried, broken, len(rows), round(time.process_time() - began), flush=True)
    write(sorted(rows, key=lambda row: row.weight))
    print(f"{tried} slips, {broken} do not run, {len(rows)} classes in {FILE}")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
