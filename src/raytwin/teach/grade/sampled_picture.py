"""A picture at a sampled light level: rendered again and again until the sequential verdict is certain."""

from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256

import numpy as np

from raytwin.compare import Comparison, SequentialComparison
from raytwin.compare.finding import notes
from raytwin.images.image import Image
from raytwin.teach.sandbox.sandbox import Answer

MAX_RENDERS = 64
"""Renders of one picture; what is undecided then is not passed."""
ALARMS_PER_PICTURE = 1e-5
"""Share of the correct pictures that fail by chance."""
SAME_NUMBERS = "each call of `render` drew the same random numbers: use np.random.default_rng() without a seed"


def render_until_certain(call: Callable[[], Answer], reference: Image) -> tuple[Answer, Comparison | None]:
    """The mean of all renders, and the verdict on them; None where a call gave no picture of the reference's shape."""
    check = SequentialComparison(reference, false_alarm_rate=ALARMS_PER_PICTURE)
    total, seconds, renders = np.zeros(reference.shape), 0.0, 0
    different: set[bytes] = set()
    while not check.decided and renders < MAX_RENDERS:
        answer = call()
        seconds += answer.seconds
        if answer.problem or [a.shape for a in answer.arrays[:1]] != [reference.shape]:
            return replace(answer, seconds=seconds), None
        picture = np.asarray(answer.arrays[0], np.float64)
        total, renders = total + picture, renders + 1
        different.add(sha256(picture.tobytes()).digest())
        with np.errstate(over="ignore"):
            check.add(Image(picture.astype(np.float32), samples=0))
    verdict = check.conclude()
    if verdict.verdict == "undecided" and len(different) < renders:
        verdict = verdict.judged("undecided", *notes([f"undecided: {SAME_NUMBERS}"]))
    return replace(answer, arrays=(total / renders,), seconds=seconds), verdict
