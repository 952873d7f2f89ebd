"""Which mistake explains these pictures? Each fault's prediction beside what was handed in, over all scenes together.

A fault is believed for what it predicts: its picture of every scene is compared with the one that was submitted, the
scenes that are right included. Where one explains only a part, it is said that something else is wrong, too. Where none
does, it is said where the picture is wrong. `hypothesis_search` tries them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from raytwin.compare.finding import Finding
from raytwin.diagnose.averaged_pixels import averaging_faults
from raytwin.diagnose.budget import SECONDS, Budget
from raytwin.diagnose.catalogue import ACNE, FACTS, FAULTS
from raytwin.diagnose.certainty import (
    SURE,
    are_alike,
    explained_share,
    hit_shares,
    is_exact,
    is_firm,
    is_good,
    is_likelier,
    left_over,
)
from raytwin.diagnose.changes import ORDER, OUTPUT, Fault
from raytwin.diagnose.curve import curve_cause
from raytwin.diagnose.distances import depth_cause
from raytwin.diagnose.explanation import Cause, Diagnosis, Sureness
from raytwin.diagnose.hypothesis_search import Hypothesis, Search
from raytwin.diagnose.light_decomposition import split
from raytwin.diagnose.localize import points_of_misses, whereabouts
from raytwin.diagnose.noisy_values import noisy_cause
from raytwin.diagnose.parametric_faults import FAMILIES, ParametricFault, radii_of
from raytwin.diagnose.pixel_sample import MET, PixelSample, Sampled, SubmittedImage, look
from raytwin.diagnose.predict import RIGHT
from raytwin.diagnose.premultiplied import alpha_cause
from raytwin.files import Rounding
from raytwin.image import Image
from raytwin.rungs import RUNGS
from raytwin.scene import Scene

EXPLAINED = 0.9
"""Share of the squared error below which no cause is named, unless it explains a part."""
EXACT = 0.9999
"""Share of the squared error that a cause explains exactly: below it, a curve through all values is told instead."""
MATCHED = 0.5
"""Share of the wrong pixels that it has to hit: its values must not only come near."""
PART, SPARED = 0.4, 0.99
"""Shares of the wrong pixels that a cause has to hit, and of the right ones that it has to spare, to explain a part."""
FEW = 6
"""Wrong pixels below which nothing is named: rounding on outlines."""
ALTERNATIVES = 3
"""Causes that explain it as well, at most so many of which are told."""
RARE = 3e-3
"""Share of a picture's pixels: up to here, only single faults without fitted numbers are tried."""
SPECKLED = 0.1
"""`PixelSample.mixed` from which on chance is asked: acne of seven tracers in five scenes has .11 to .26, and 981
of 1006 pictures with faults of shapes and light have less."""
MOST = 25_000
"""Pixels of a picture that are looked at in the end."""
BRIGHT = 1e6
"""What is stored as white may be anything up to this."""


PLAIN = tuple(
    fault for fault in FAULTS
    if fault.name == "swapped-axes" or (
        fault.stage == OUTPUT and all(name in ("hand_in", "pixel") for name, _ in fault.ways[0]))
)  # fmt: skip
"""Faults that are predicted without a scene: of a picture's values and of their order."""
PLAIN_FAMILIES = tuple(family for family in FAMILIES if family.name in ("image-scaled", "offset", "power"))


def diagnose(
    views: Sequence[SubmittedImage],
    seed: int = 0,
    faults: Sequence[Fault] = FAULTS,
    families: Sequence[ParametricFault] = FAMILIES,
    seconds: float = SECONDS,
) -> Diagnosis:
    """The cause of what is wrong in the views of one submission; `seconds` to search.

    Give the views that are right too: a fault that would have spoiled them is none.
    """
    budget = Budget(seconds)
    samples = [look(view, seed) for view in views]
    errors = [s.off(s.predict(RIGHT)) for s in samples]
    count = sum(int(s.wrong.sum()) for s in samples)
    where = whereabouts(samples, errors)
    if count == 0:
        return Diagnosis(right=True, explained=1.0, where="right everywhere")
    if cause := _one_value(views):
        return Diagnosis(False, cause, (), 1.0, None, "proved")
    if count < FEW:
        return Diagnosis(right=False, where=where)
    if words := points_of_misses(samples):
        text = f"rays that meet nothing have points, too ({words}): NaN is wanted there"
        cause = Cause("points-of-misses", ORDER, text)
        return Diagnosis(False, cause, (), 1.0, None, "proved", where)
    samples = [s for s in samples if s.weight.size]
    return _search(samples, where, faults, families, budget)


def _search(
    samples: list[PixelSample],
    where: str,
    faults: Sequence[Fault],
    families: Sequence[ParametricFault],
    budget: Budget,
) -> Diagnosis:
    """The cause that costs least."""
    every = faults is FAULTS
    if families is FAMILIES and samples[0].view.scene and len({s.view.scene for s in samples}) == 1:
        families = (*FAMILIES, *radii_of(samples[0].view.scene))
    thorough = max(float((s.weight * s.wrong).sum()) for s in samples) > RARE
    search = Search(samples, budget)
    found = search.causes(faults, families if thorough else ())
    if thorough and every and not (budget.over or search.explained_by(found)) and (means := averaging_faults(samples)):
        found = sorted([*search.causes(means), *found], key=lambda g: g.cost)
    if not (search.explained_by(found) and is_exact(samples, found[0].steps)):
        hit = hit_shares(samples, found[0].steps)[0] if found else 0.0
        if is_firm(samples) and (chance := _by_chance(samples, where, hit, budget)) is not None:
            return chance
    untried = budget.words
    return replace(_described(found, search, where), untried=untried)


def _one_value(views: Sequence[SubmittedImage]) -> Cause | None:
    """What is told where every channel of every pixel has one value: 0, or one that is not the sky's."""
    values = {float(x) for view in views for x in (np.min(view.shown), np.max(view.shown))}
    value = values.pop()
    if value == 0 and not values and not any(view.points for view in views):
        return Cause("empty", OUTPUT, "the image is black everywhere")
    skies = [x for view in views if view.scene for x in view.scene.sky_radiance]
    if values or not np.isfinite(value) or value == 0 or any(abs(value - x) <= 1e-6 * abs(value) for x in skies):
        return None
    if any(view.right is not None and np.ptp(view.right) <= 1e-6 * value for view in views):
        return None
    text = f"every pixel has the same value, {value:.4g}: nothing of the scene is in the picture"
    return Cause("one-value", OUTPUT, text)


def explain(
    test: Image,
    reference: Image,
    scene: Scene | None = None,
    rung: str = "shadow",
    rounding: Rounding = Rounding(),  # noqa: B008 (frozen)
    sampled: Sampled | None = None,
    seconds: float = SECONDS,
    of_reference: Rounding = Rounding(),  # noqa: B008 (frozen)
) -> tuple[Finding, ...]:
    """Why an image is not its reference: of a known scene any fault, else what a writer does wrong.

    Of an unknown scene only a cause that explains it is told. `rounding`, `of_reference`: what the formats of test and
    reference round off. `sampled`: the parts of light that chance finds, for the factors of light that are told where
    no cause explains it.
    """
    shown, right = test.mean, reference.mean
    if shown.shape != right.shape or shown.ndim != 3 or shown.dtype.kind != "f":
        return ()
    if not (np.isfinite(shown).all() and np.isfinite(right).all()):
        return ()
    if scene and (words := depth_cause(test.surface, reference.surface, scene)):
        return (Finding("likely", words),)
    variances = [image.variance for image in (test, reference) if image.variance is not None]
    if variances:
        zero = np.zeros(shown.shape)
        both = (zero if image.variance is None else image.variance for image in (test, reference))
        if words := noisy_cause(shown, np.clip(right, 0, 1) if rounding.clipped else right, *both):
            return (Finding("likely", words),)
    elif words := alpha_cause(test, reference, rounding, of_reference):
        return (Finding("likely", words),)
    view = view_of(test, reference, scene, rung, rounding, sampled, of_reference)
    if view.scene is not None:
        made = diagnose([view], seconds=seconds)
    else:
        made = diagnose([view], faults=PLAIN, families=PLAIN_FAMILIES, seconds=seconds)
    if not variances and not (made.right or (made.cause and made.explained > EXACT)) and (words := curve_cause(view)):
        return (Finding("likely", words),)
    return made.findings if made.cause or view.scene is not None else ()


def view_of(
    test: Image,
    reference: Image,
    scene: Scene | None,
    rung: str,
    rounding: Rounding = Rounding(),  # noqa: B008 (frozen)
    sampled: Sampled | None = None,
    of_reference: Rounding = Rounding(),  # noqa: B008 (frozen)
) -> SubmittedImage:
    """Return what `diagnose` looks at: noise is slack, and a scene that no fault can be predicted in is unknown."""
    shown = test.mean
    slack = np.zeros(shown.shape) if rounding.half is None else rounding.half.astype(float)
    variances = [image.variance for image in (test, reference) if image.variance is not None]
    if variances:
        slack = slack + 3 * np.sqrt(np.maximum(np.sum(variances, axis=0, dtype=float), 0))
    # Faults are predicted under a constant sky, without highlights.
    known = scene and RUNGS[rung].lit and scene.objects and not (scene.glossy or scene.environment)
    right: np.ndarray = reference.mean
    bounds: tuple[np.ndarray, ...] = ()
    if of_reference.half is not None:
        above = np.where(of_reference.clipped & (right >= 1), BRIGHT, right + of_reference.half)
        bounds = right - of_reference.half, above
    clipped = rounding.clipped or of_reference.clipped
    return SubmittedImage(
        scene if known else None, shown, right, rung, half=slack, clipped=clipped, sampled=sampled, bounds=bounds
    )


def _described(found: list[Hypothesis], search: Search, where: str) -> Diagnosis:
    if not found:
        return Diagnosis(right=False, where=where)
    samples, budget = search.samples, search.budget
    best = _rather_than_a_fact(found, samples)
    share, each = explained_share(samples, best.steps)
    hit, kept = hit_shares(samples, best.steps)
    near = share >= EXPLAINED and best.cost <= 0.6 * search.unexplained
    if not ((near and hit >= MATCHED) or (hit >= PART and kept > SPARED)):
        nearest = min(found, key=lambda g: g.cost)
        share = explained_share(samples, nearest.steps)[0]
        lit = [(s, s.view.scene) for s in samples if s.view.scene and s.view.scene.objects and not s.view.points]
        parts_of_light = [
            f"{scene.name}: {words}" for s, scene in lit if not budget.spent and (words := split(s).words)
        ]
        return Diagnosis(
            right=False,
            explained=max(share, 0.0),
            where=where,
            nearest=nearest.cause,
            light="; ".join(parts_of_light),
        )
    if not is_likelier(samples, best.steps):
        return Diagnosis(right=False, where=where)
    finite = each[np.isfinite(each)]
    worst = float(max(finite.min(), 0.0)) if len(samples) > 1 and finite.size else None
    others = _as_good(best, found, samples, budget)
    # Each scene confirms what the others select: one alone proves nothing.
    confirmed = worst is not None and worst > SURE and sum(bool(s.wrong.any()) for s in samples) > 1
    unchecked = budget.spent
    count, left = (0, "") if unchecked else left_over([s.everywhere(_most(s)) for s in samples], best.steps)
    whole = count < FEW and not unchecked and is_good(samples, best.steps)
    whole = whole and (not best.cause.numbers or is_exact(samples, best.steps))
    sureness: Sureness = "proved" if not others and confirmed and whole else "likely"
    if count >= FEW or hit < EXPLAINED:
        where = "; ".join(filter(None, (where, f"something else is wrong, too: {left}".rstrip(": "))))
    return Diagnosis(
        right=False,
        cause=best.cause,
        alternatives=others,
        explained=share,
        held_out=worst,
        sureness=sureness,
        where=where,
    )


def _rather_than_a_fact(found: list[Hypothesis], samples: list[PixelSample]) -> Hypothesis:
    """The best guess; not one that says only what is seen where another one leaves nothing, and that does."""
    best = found[0]
    if best.cause.name in FACTS and not is_exact(samples, best.steps):
        return next((g for g in found[1:] if is_exact(samples, g.steps)), best)
    return best


def _most(sight: PixelSample) -> int:
    """Pixels that are looked at in the end: fewer where a scene has many objects."""
    objects = len(sight.view.scene.objects) if sight.view.scene else 0
    return min(MOST, max(MET // max(objects, 1), 1))


def _by_chance(samples: Sequence[PixelSample], where: str, least: float, budget: Budget) -> Diagnosis | None:
    """Acne, which leaves it to chance whether a pixel is lit or dark.

    `least`: the share of the wrong pixels that it has to hit, beside EXPLAINED.
    """
    spoilt = [s for s in samples if s.wrong.any()]
    mixed = np.average([s.mixed for s in spoilt], weights=[s.wrong.sum() for s in spoilt])
    if budget.over or mixed < SPECKLED:
        return None
    made = [[s.predict(way) for way in ACNE.ways] for s in samples]
    off = [np.stack([s.off(one) for one in all_]) for s, all_ in zip(samples, made, strict=True)]
    hit = np.concatenate([
        (e.min(axis=0) <= np.minimum(4 * s.tau, s.errors(RIGHT) / 2))[s.wrong]
        for e, s in zip(off, samples, strict=True)
    ])  # fmt: skip
    kept = np.concatenate([e.min(axis=0)[~s.wrong] <= 4 * s.tau for e, s in zip(off, samples, strict=True)])
    if hit.mean() < max(EXPLAINED, least) or (kept.size and kept.mean() < 0.99):
        return None
    before = sum(s.squared(s.predict(RIGHT)) for s in samples)
    after = sum(s.squared(np.take_along_axis(np.stack(all_), e.argmin(axis=0)[None, :, None], 0)[0])
                for s, e, all_ in zip(samples, off, made, strict=True))  # fmt: skip
    cause = Cause(ACNE.name, ACNE.stage, ACNE.sentence)
    return Diagnosis(False, cause, (), 1 - float(after / max(before, 1e-300)), None, "likely", where)


def _as_good(
    best: Hypothesis, found: Iterable[Hypothesis], samples: list[PixelSample], budget: Budget
) -> tuple[Cause, ...]:
    """Return the causes that explain the pictures as well as the best guess."""
    if best.cause.name in FACTS:
        return ()
    own = [s.predict(best.steps) for s in samples]
    others: dict[str, Cause] = {}
    for guess in found:
        if budget.spent:
            break
        if guess.cause.name == best.cause.name or guess.cause.numbers != best.cause.numbers:
            continue
        if guess.cost < 1.25 * best.cost or all(
            are_alike(s, a, s.predict(guess.steps)) for s, a in zip(samples, own, strict=True)
        ):
            others.setdefault(guess.cause.name, guess.cause)
    return tuple(others.values())[:ALTERNATIVES]
