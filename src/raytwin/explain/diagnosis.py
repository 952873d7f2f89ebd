"""Find the mistake that explains these pictures: cheap tests first, then each fault's prediction beside the pictures.

Each fault predicts the picture of every scene, and is judged by all of them, the correct ones included. A fault that
explains only a part is named, and something else is reported wrong, too. If no fault explains the pictures, the report
says where they are wrong. `search` tries the faults.
"""

from collections.abc import Sequence

import numpy as np

from raytwin.compare.finding import Finding
from raytwin.explain.catalogue import ACNE, FACTS, FAULTS
from raytwin.explain.changes import ORDER, OUTPUT, Fault
from raytwin.explain.evidence import NOTHING_LEFT, are_alike, fit_of, is_firm, is_likelier
from raytwin.explain.explanation import Cause, Certainty, Explanation
from raytwin.explain.formula_causes import alpha_cause, curve_cause, depth_cause
from raytwin.explain.localize import border_alone, points_of_misses, whereabouts
from raytwin.explain.noisy_values import noisy_cause
from raytwin.explain.parametric_faults import FAMILIES, ParametricFault
from raytwin.explain.pixel_sample import (
    PIXELS_BY_OBJECTS,
    PixelSample,
    SubmittedImage,
    mixed,
    sample_pixels,
)
from raytwin.explain.predict import NO_MISTAKE, Pipeline
from raytwin.explain.search import Hypothesis, Search
from raytwin.explain.tolerance_mask import doubtful
from raytwin.images.image import Image
from raytwin.images.stored_precision import Rounding
from raytwin.rungs import RUNGS
from raytwin.scene import Scene

NAMED_FROM_SHARE = 0.9
"""Share of the squared error below which no cause is named, unless it explains a part."""
EXACT_FROM_SHARE = 0.9999
"""Share of the squared error that a cause must explain to count as exact: below it, a curve through all values is
reported instead."""
ENOUGH_HITS = 0.5
"""Share of the wrong pixels that a named cause must predict exactly: coming near is not enough."""
PART_FROM_HITS, SPARED_FROM_SHARE = 0.4, 0.99
"""Shares of the wrong pixels that a cause has to hit, and of the correct ones it has to spare, to explain a part."""
FEWEST_WRONG_PIXELS = 6
"""With fewer wrong pixels no cause is named: rounding on outlines makes as many."""
MAX_ALTERNATIVES = 3
"""Most alternative causes that are reported."""
RARE_SHARE = 3e-3
"""Share of a picture's pixels: up to here, only single faults without fitted numbers are tried."""
SPECKLED_FROM = 0.1
"""Least `mixed` value at which acne is tested: acne of seven tracers in five scenes has .11 to .26, and 981
of 1006 pictures with faults of shapes and light have less."""
MAX_PIXELS = 25_000
"""Pixels of a picture that are checked for leftover errors."""
MAX_SHARE_DOUBTED = 0.1
"""Share of the pixels: if more stay wrong, differences between correct tracers do not explain it."""
BRIGHTEST_WHITE = 1e6
"""Upper bound assumed for a reference value that was clipped to white."""

PLAIN = tuple(
    fault for fault in FAULTS
    if fault.name == "swapped-axes" or (
        fault.stage == OUTPUT and all(name in ("hand_in", "pixel") for name, _ in fault.ways[0]))
)  # fmt: skip
"""Faults that are predicted without a scene: of a picture's values and of their order."""
PLAIN_FAMILIES = tuple(family for family in FAMILIES if family.name in ("image-scaled", "offset", "power"))


def explain(
    test: Image,
    reference: Image,
    scene: Scene | None = None,
    rung: str = "shadow",
    rounding: Rounding = Rounding(),  # noqa: B008 (frozen)
    of_reference: Rounding = Rounding(),  # noqa: B008 (frozen)
) -> tuple[Finding, ...]:
    """Why an image is not its reference: with a scene, any fault; without, only errors in writing the image.

    Of an unknown scene only a cause that explains it is told. `rounding`, `of_reference`: what the formats of test and
    reference round off.
    """
    shown, correct = test.mean, reference.mean
    if shown.shape != correct.shape or shown.ndim != 3 or shown.dtype.kind != "f":
        return ()
    if not (np.isfinite(shown).all() and np.isfinite(correct).all()):
        return ()
    words = depth_cause(test.surface, reference.surface, scene) if scene else ""
    noisy = test.variance is not None or reference.variance is not None
    if noisy and not words:
        both = (np.zeros(shown.shape) if x.variance is None else x.variance for x in (test, reference))
        words = noisy_cause(shown, np.clip(correct, 0, 1) if rounding.clipped else correct, *both)
    elif not words:
        words = alpha_cause(test, reference, rounding, of_reference)
    if words:
        return (Finding("likely", words),)
    view = _view(test, reference, scene, rung, rounding, of_reference)
    made = diagnose([view]) if view.scene else diagnose([view], faults=PLAIN, families=PLAIN_FAMILIES)
    exact = made.certainty == "correct" or (made.cause is not None and made.explained > EXACT_FROM_SHARE)
    if not noisy and not exact and (words := curve_cause(view)):
        return (Finding("likely", words),)
    return made.findings if made.cause or view.scene else ()


def _view(
    test: Image, reference: Image, scene: Scene | None, rung: str, rounding: Rounding, of_reference: Rounding
) -> SubmittedImage:  # fmt: skip
    """Make the view for `diagnose`. Noise becomes slack. The scene is left out if no fault can be predicted in it."""
    shown, correct = test.mean, reference.mean
    slack = np.zeros(shown.shape) if rounding.half is None else rounding.half.astype(float)
    variances = [image.variance for image in (test, reference) if image.variance is not None]
    if variances:
        slack = slack + 3 * np.sqrt(np.maximum(np.sum(variances, axis=0, dtype=float), 0))
    bounds: tuple[np.ndarray, ...] = ()
    if of_reference.half is not None:
        above = np.where(of_reference.clipped & (correct >= 1), BRIGHTEST_WHITE, correct + of_reference.half)
        bounds = correct - of_reference.half, above
    clipped = rounding.clipped or of_reference.clipped
    fits = scene and shown.shape == (scene.camera.height, scene.camera.width, 3)
    # Faults are predicted under a constant sky, without highlights.
    known = scene and fits and RUNGS[rung].lit and scene.objects and not (scene.glossy or scene.environment)
    return SubmittedImage(scene if known else None, shown, correct, rung, half=slack, clipped=clipped, bounds=bounds)


def diagnose(
    views: Sequence[SubmittedImage],
    seed: int = 0,
    faults: Sequence[Fault] = FAULTS,
    families: Sequence[ParametricFault] = FAMILIES,
) -> Explanation:
    """The cause of what is wrong in the views of one submission.

    Give the correct views too: a fault that would change one of them is ruled out.
    """
    samples = [sample_pixels(view, seed) for view in views]
    where = whereabouts(samples, [s.errors(NO_MISTAKE) for s in samples])
    count = sum(int(s.wrong.sum()) for s in samples)
    if count == 0:
        return Explanation("correct", where=where, explained=1.0)
    if cause := _one_value(views):
        return Explanation("proved", (cause,), (cause.sentence,), explained=1.0)
    if count < FEWEST_WRONG_PIXELS:
        return Explanation("unknown", where=where)
    if words := points_of_misses(samples):
        text = f"rays that miss everything have hit points ({words}): return NaN for them"
        return Explanation("proved", (Cause("points-of-misses", ORDER, text),), (text,), where, 1.0)
    if words := border_alone(samples):
        text = f"only {words} of the image are wrong: render every row and column"
        return Explanation("likely", (Cause("border-alone", OUTPUT, text),), (text,), explained=1.0)
    samples = [s for s in samples if s.weight.size]
    if (share := _acne(samples)) > 0:
        cause = Cause(ACNE.name, ACNE.stage, ACNE.sentence)
        return Explanation("likely", (cause,), (cause.sentence,), where, share)
    thorough = max(float((s.weight * s.wrong).sum()) for s in samples) > RARE_SHARE
    search = Search(samples)
    return _explanation(search.causes(faults, families if thorough else ()), search, where)


def _one_value(views: Sequence[SubmittedImage]) -> Cause | None:
    """The cause if every channel of every pixel has the same value: 0, or one that is not the sky's."""
    values = {float(x) for view in views for x in (np.min(view.shown), np.max(view.shown))}
    value = values.pop()
    if value == 0 and not values and not any(view.points for view in views):
        return Cause("empty", OUTPUT, "the image is black everywhere")
    skies = [x for view in views if view.scene for x in view.scene.sky_radiance]
    if values or not np.isfinite(value) or value == 0 or any(abs(value - x) <= 1e-6 * abs(value) for x in skies):
        return None
    if any(view.correct is not None and np.ptp(view.correct) <= 1e-6 * value for view in views):
        return None
    text = f"every pixel has the same value, {value:.4g}: nothing of the scene is in the picture"
    return Cause("one-value", OUTPUT, text)


def _acne(samples: Sequence[PixelSample]) -> float:
    """The share of the squared error that shadow acne (a random part of the pixels is unlit) explains, or 0."""
    spoilt = [s for s in samples if s.wrong.any()]
    speckled = np.average([mixed(s.frame.wrong) for s in spoilt], weights=[s.wrong.sum() for s in spoilt])
    if speckled < SPECKLED_FROM or not is_firm(samples):
        return 0.0
    hit, kept, before, after = [], [], 0.0, 0.0
    for s in samples:
        made = np.stack([s.predict(way) for way in ACNE.ways])
        off = np.stack([s.off(one) for one in made])
        nearest = off.min(axis=0)
        hit.append((nearest <= np.minimum(4 * s.tau, s.errors(NO_MISTAKE) / 2))[s.wrong])
        kept.append((nearest <= 4 * s.tau)[~s.wrong])
        before += s.squared(s.predict(NO_MISTAKE))
        after += s.squared(np.take_along_axis(made, off.argmin(axis=0)[None, :, None], 0)[0])
    spared = np.concatenate(kept)
    if np.concatenate(hit).mean() < NAMED_FROM_SHARE or (spared.size and spared.mean() < SPARED_FROM_SHARE):
        return 0.0
    return 1 - float(after / max(before, 1e-300))


def _explanation(found: list[Hypothesis], search: Search, where: str) -> Explanation:
    """Report the best hypothesis if it explains enough; else where the pictures are wrong, and the nearest one."""
    samples = search.samples
    if not found:
        return Explanation("unknown", where=where)
    best = _rather_than_a_fact(found, samples)
    fit = fit_of(samples, best.steps)
    near = fit.explained >= NAMED_FROM_SHARE and best.cost <= 0.6 * search.unexplained and fit.hit >= ENOUGH_HITS
    if not (near or (fit.hit >= PART_FROM_HITS and fit.kept > SPARED_FROM_SHARE)):
        return _unknown(found, samples, where)
    if not is_likelier(samples, best.steps):
        return Explanation("unknown", where=where)
    others = () if best.cause.name in FACTS else _as_good(best, found, samples)
    count, left = left_over([s.everywhere(_most(s)) for s in samples], best.steps)
    # Each scene confirms what the others select: one alone proves nothing.
    confirmed = fit.least > NOTHING_LEFT and sum(bool(s.wrong.any()) for s in samples) > 1
    whole = count < FEWEST_WRONG_PIXELS and fit.is_good and (fit.exact or not best.cause.numbers)
    certainty: Certainty = "proved" if confirmed and whole and not others else "likely"
    sentences = [best.cause.sentence, *(f"or, with the same effect here: {other.sentence}" for other in others)]
    if count >= FEWEST_WRONG_PIXELS or fit.hit < NAMED_FROM_SHARE:
        sentences.append(f"something else is wrong, too: {left}".rstrip(": "))
    return Explanation(certainty, (best.cause, *others), tuple(sentences), where, fit.explained)


def _unknown(found: list[Hypothesis], samples: list[PixelSample], where: str) -> Explanation:
    """Where the pictures are wrong, and what comes nearest."""
    nearest = min(found, key=lambda g: g.cost)
    share = max(fit_of(samples, nearest.steps).explained, 0.0)
    closest = f"closest known fault, which explains only part of the error: {nearest.cause.sentence}"
    return Explanation("unknown", sentences=(closest,) if share >= ENOUGH_HITS else (), where=where, explained=share)


def _rather_than_a_fact(found: list[Hypothesis], samples: list[PixelSample]) -> Hypothesis:
    """Return the best hypothesis. A symptom (FACTS) that is not exact gives way to a cause that is."""
    best = found[0]
    if best.cause.name in FACTS and not fit_of(samples, best.steps).exact:
        return next((g for g in found[1:] if fit_of(samples, g.steps).exact), best)
    return best


def _as_good(best: Hypothesis, found: Sequence[Hypothesis], samples: list[PixelSample]) -> tuple[Cause, ...]:
    """The causes that explain the pictures as well as the best one."""
    own = [s.predict(best.steps) for s in samples]
    others: dict[str, Cause] = {}
    for guess in found:
        if guess.cause.name == best.cause.name or guess.cause.numbers != best.cause.numbers:
            continue
        if guess.cost < 1.25 * best.cost or all(
            are_alike(s, a, s.predict(guess.steps)) for s, a in zip(samples, own, strict=True)
        ):
            others.setdefault(guess.cause.name, guess.cause)
    return tuple(others.values())[:MAX_ALTERNATIVES]


def left_over(samples: Sequence[PixelSample], steps: Pipeline) -> tuple[int, str]:
    """Count the pixels that these steps do not explain, up to differences of correct tracers. Say where."""
    errors, count = [], 0
    for s in samples:
        e = s.errors(steps)
        off = e > 4 * s.tau
        if off.any() and off.sum() <= MAX_SHARE_DOUBTED * off.size:
            off[off] = ~doubtful(s.only(off).predict, s.scale, steps)
        errors.append(np.where(off, e, 0.0))
        count += int(off.sum())
    return count, whereabouts(samples, errors).split("; ")[0] if count else ""


def _most(sample: PixelSample) -> int:
    """Pixels that are checked for leftover errors: fewer where a scene has many objects."""
    objects = len(sample.view.scene.objects) if sample.view.scene else 0
    return min(MAX_PIXELS, max(PIXELS_BY_OBJECTS // max(objects, 1), 1))
