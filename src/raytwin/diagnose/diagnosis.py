"""Which mistake explains these pictures? Each fault's prediction beside what was handed in, over all scenes together.

A fault is believed for what it predicts: its picture of every scene is compared with the one that was submitted, the
scenes that are right included. Where no single one suffices, faults are added one by one; where none does, it is said
where the picture is wrong. The cost of errors e is Σ log(1 + (e/τ)²), minus the log likelihood of values that are
either hit closely or missed by any amount, so that a few odd pixels decide nothing.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from raytwin.diagnose.antialiasing import between
from raytwin.diagnose.budget import SECONDS, Budget
from raytwin.diagnose.catalogue import ACNE, CHANCES, FACTS, FAULTS, SHADOW_TESTS, cached, equivalent_forms
from raytwin.diagnose.certainty import (
    WHOLE,
    are_alike,
    explained_share,
    hit_shares,
    is_exact,
    is_firm,
    is_good,
    is_likelier,
    is_settled,
    left_over,
    shows,
)
from raytwin.diagnose.changes import LIGHT, NORMALS, OUTPUT, SAMPLING, SHADOW, STAGES, Fault
from raytwin.diagnose.conditional_faults import clued
from raytwin.diagnose.distances import depth_cause
from raytwin.diagnose.explanation import Cause, Diagnosis, Sureness
from raytwin.diagnose.light_decomposition import split
from raytwin.diagnose.localize import whereabouts
from raytwin.diagnose.noisy_values import noisy_cause
from raytwin.diagnose.parametric_faults import FAMILIES, ParametricFault, fit, of_objects, promising, total
from raytwin.diagnose.pixel_sample import MET, PixelSample, Sampled, SubmittedImage, many
from raytwin.diagnose.predict import RIGHT, UP_TO_RAYS, Array, Pipeline
from raytwin.diagnose.prediction_cache import costs
from raytwin.diagnose.slip_search import likely_slips
from raytwin.diagnose.tolerance_mask import SHADOW_STEPS
from raytwin.files import Rounding
from raytwin.image import Image
from raytwin.rungs import RUNGS
from raytwin.scene import Scene

EXPLAINED = 0.9
"""Share of the squared error below which no cause is named."""
MATCHED = 0.5
"""Share of the wrong pixels below which no cause is named: its values have to be hit, not only come near."""
FEW = 6
"""Wrong pixels below which nothing is named: rounding on outlines."""
ALTERNATIVES = 3
"""Causes that explain it as well, at most so many of which are told."""
RARE = 3e-3
"""Share of a picture's pixels: up to here, only single faults without fitted numbers are tried."""
SCREEN = 4
"""Every fault is tried on one in so many of the pixels first."""
FINALISTS = 24
"""Guesses that are compared on all pixels, those of least cost: more cost time."""
CLEAR = 0.1
"""Share of the cost: fit no numbers once less than this is left."""
CLOSE = 4
"""Multiple of the best cost on few pixels above which a fault is not tried on all."""
TEMPTING = 16
"""Faults that are tried with every habit."""
EVEN = 5e-4
"""Share of the cost without any cause: causes that differ by less are equally good."""
NEAR = 0.5
"""Share of the cost: a fault that leaves more is dropped once another leaves hardly any."""
TIED = 0.01
"""Costs of one view that tell nothing apart."""
SOME = 3
"""Views, the most wrong ones, on which it is seen which numbers are worth fitting."""
SPECKLED = 0.2
"""Share of right neighbours from which on wrong pixels are speckles."""
MOST = 25_000
"""Pixels of a picture that are looked at in the end."""
HOPELESS = 0.97
"""Share of the cost: a fault that leaves more is not tried together with a second one."""
FITS = 5
"""Families whose numbers are fitted to the end, of those whose first step explains most."""
OF_VALUES = (NORMALS, LIGHT, SHADOW, SAMPLING, OUTPUT)
"""Stages that leave alone what rays meet: quickly tried, and tried first."""
NOTHING = 1e-4
"""Share of the cost: where a mistake of these stages leaves less, other stages are not tried."""
BEAM = 3
"""Single faults that a second one is added to."""
REACHED = 0.5
"""Share of the pixels that one fault leaves wrong: a second one that changes fewer of them is not tried with it."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """What is tried: causes that are made one after the other, the steps that come of them, and their cost.

    `typical`: each cause in the first of its ways. `way`: the change that was made last, as it stands in the catalogue.
    """

    causes: tuple[Cause, ...]
    steps: Pipeline
    cost: float = np.inf
    refit: Callable[[Sequence[PixelSample]], Pipeline] | None = None
    typical: bool = True
    way: Pipeline | None = None


PLAIN = tuple(
    fault for fault in FAULTS
    if fault.name == "swapped-axes" or (
        fault.stage == OUTPUT and all(name in ("output", "pixel") for name, _ in fault.ways[0]))
)  # fmt: skip
"""What may be wrong with a picture of nobody knows what: its values and its order."""
PLAIN_FAMILIES = tuple(family for family in FAMILIES if family.name in ("image-scaled", "offset", "power"))


def diagnose(
    views: Sequence[SubmittedImage],
    seed: int = 0,
    faults: Sequence[Fault] = FAULTS,
    families: Sequence[ParametricFault] = FAMILIES,
    most: int = 2,
    seconds: float = SECONDS,
) -> Diagnosis:
    """The cause of all that is wrong in the views of one submission; `most`: faults together; `seconds` to search.

    Give the views that are right too: a fault that would have spoiled them is none.
    """
    if (value := _one_value(views)) is not None:
        text = f"every pixel has the same value, {value:.4g}: nothing of the scene is in the picture"
        return Diagnosis(False, (Cause("one-value", OUTPUT, text),), ((),), 1.0, None, "sure")
    budget = Budget(seconds)
    sights = many(views, seed)
    errors = [s.off(s.predict(RIGHT)) for s in sights]
    count = sum(int(s.wrong.sum()) for s in sights)
    where = whereabouts(sights, errors)
    if count == 0:
        return Diagnosis(right=True, explained=1.0, where="right everywhere")
    if count < FEW:
        return Diagnosis(right=False, where=where)
    sights = [s for s in sights if s.weight.size]
    return replace(_search(sights, where, faults, families, most, budget), untried=budget.words)


def _search(
    sights: list[PixelSample],
    where: str,
    faults: Sequence[Fault],
    families: Sequence[ParametricFault],
    most: int,
    budget: Budget,
) -> Diagnosis:
    """The causes that cost least, one or `most` of them together."""
    every = faults is FAULTS
    if every:
        cameras = [(s.view.scene.camera, bool(s.wrong.any())) for s in sights if s.view.scene]
        faults = (*FAULTS, *cached([c for c, wrong in cameras if not wrong], [c for c, _ in cameras]))
    if families is FAMILIES and sights[0].view.scene and len({s.view.scene for s in sights}) == 1:
        families = (*FAMILIES, *of_objects(sights[0].view.scene))
    small = [s.only(slice(None, None, SCREEN)) for s in sights]
    thorough = max(float((s.weight * s.wrong).sum()) for s in sights) > RARE
    base = Hypothesis((), RIGHT, total(sights, RIGHT))
    found = _round(base, sights, small, faults, families if thorough else (), budget)
    if thorough and every and not (found and is_good(sights, found[0].steps)) and (clues := clued(sights, budget)):
        found = sorted([*_round(base, sights, small, clues, (), budget), *found], key=lambda g: g.cost)
    if thorough and every and not (found and is_good(sights, found[0].steps)):
        found = sorted([*_slips(base, sights, small, budget), *found], key=lambda g: g.cost)
    if not (found and is_good(sights, found[0].steps)):
        hit = hit_shares(sights, found[0].steps)[0] if found else 0.0
        if is_firm(sights) and (chance := _by_chance(sights, where, hit, budget)) is not None:
            return chance
    for _ in range(most - 1):
        if not thorough or not found or is_settled(sights, found[0].steps) or budget.over:
            break
        for k, one in enumerate([g for g in found[:BEAM] if g.cost < HOPELESS * base.cost]):
            found += _round(one, sights, small, faults, () if k else families, budget)
        found.sort(key=lambda g: g.cost + len(g.causes) * _price(base))
        more = min(found, key=lambda g: g.cost)
        if len(more.causes) > len(found[0].causes) and not left_over(sights, more.steps)[0]:
            found = [more, *(g for g in found if g is not more)]
    made = _described(found, sights, base, where, budget)
    if not made.causes and thorough and is_firm(sights) and (beside := between(sights, budget)) is not None:
        fault, share = beside
        return Diagnosis(False, (Cause(fault.name, fault.stage, fault.sentence),), ((),), share, None, "likely", where)
    return made


def _one_value(views: Sequence[SubmittedImage]) -> float | None:
    """The value of every channel of every pixel, where there is only one, and it is neither 0 nor the sky's."""
    values = {float(x) for view in views for x in (np.min(view.shown), np.max(view.shown))}
    value = values.pop()
    skies = [x for view in views if view.scene for x in view.scene.sky.radiance]
    if values or not np.isfinite(value) or value == 0 or any(abs(value - x) <= 1e-6 * abs(value) for x in skies):
        return None
    return None if any(view.right is not None and np.ptp(view.right) <= 1e-6 * value for view in views) else value


def explain(
    test: Image,
    reference: Image,
    scene: Scene | None = None,
    rung: str = "shadow",
    rounding: Rounding = Rounding(),  # noqa: B008 (frozen)
    most: int = 2,
    sampled: Sampled | None = None,
    seconds: float = SECONDS,
) -> tuple[str, ...]:
    """In words, why an image is not its reference: of a known scene any fault, else what a writer does wrong.

    Of an unknown scene only a cause that explains it is told. `rounding`: of the test's format. `sampled`: the parts of
    light that chance finds, for the factors of light that are told where no cause explains it.
    """
    shown, right = test.mean, reference.mean
    if shown.shape != right.shape or shown.ndim != 3 or shown.dtype.kind != "f":
        return ()
    if not (np.isfinite(shown).all() and np.isfinite(right).all()):
        return ()
    if scene and (words := depth_cause(test.surface, reference.surface, scene)):
        return (f"cause (sure): {words}",)
    variances = [image.variance for image in (test, reference) if image.variance is not None]
    if variances:
        zero = np.zeros(shown.shape)
        both = (zero if image.variance is None else image.variance for image in (test, reference))
        if words := noisy_cause(shown, right, *both):
            return (f"cause (likely): {words}",)
    view = view_of(test, reference, scene, rung, rounding, sampled)
    if view.scene is not None:
        return diagnose([view], most=most, seconds=seconds).words
    made = diagnose([view], faults=PLAIN, families=PLAIN_FAMILIES, most=1, seconds=seconds)
    return made.words if made.causes else ()


def view_of(
    test: Image,
    reference: Image,
    scene: Scene | None,
    rung: str,
    rounding: Rounding = Rounding(),  # noqa: B008 (frozen)
    sampled: Sampled | None = None,
) -> SubmittedImage:
    """Return what `diagnose` looks at: noise is slack, and a scene that no fault can be predicted in is unknown."""
    shown = test.mean
    slack = np.zeros(shown.shape) if rounding.half is None else rounding.half.astype(float)
    variances = [image.variance for image in (test, reference) if image.variance is not None]
    if variances:
        slack = slack + 3 * np.sqrt(np.maximum(np.sum(variances, axis=0, dtype=float), 0))
    # Faults are predicted under a constant sky, without highlights.
    known = scene and RUNGS[rung].lit and scene.objects and not (scene.glossy or scene.environment)
    return SubmittedImage(
        scene if known else None, shown, reference.mean, rung, half=slack, clipped=rounding.clipped, sampled=sampled
    )


def _price(base: Hypothesis) -> float:
    """What another cause has to bring: a twentieth of the cost."""
    return 0.03 * base.cost


def _round(
    before: Hypothesis,
    sights: list[PixelSample],
    small: list[PixelSample],
    faults: Sequence[Fault],
    families: Sequence[ParametricFault],
    budget: Budget,
) -> list[Hypothesis]:
    """All that may be added to a guess, the best first."""
    named = {cause.name for cause in before.causes}
    families = [f for f in families if f.name not in named]
    ways = [
        Hypothesis((*before.causes, Cause(f.name, f.stage, f.sentence)), (*before.steps, *way),
              typical=before.typical and not k, way=way)
        for f in faults if f.name not in named for k, way in enumerate(f.ways)
        if not before.causes or _reaches(way, before.steps, small)
    ]  # fmt: skip
    order = _order(small, before.steps)
    if before.causes or faults[: len(FAULTS)] != FAULTS:
        tried = _screened(ways, order, before, budget)
    elif len(few := _by_common(ways, sights, before)) < len(ways):
        tried = _screened(few, order, before, budget)
    else:
        values = [w for w in ways if w.causes[-1].stage in OF_VALUES]
        tried = _screened(values, order, before, budget)
        if not tried or min(w.cost for w in tried) > NOTHING * before.cost:
            tried += _screened([w for w in ways if w.causes[-1].stage not in OF_VALUES], order, before, budget)
    exact = _with_habits(tried, before, sights, order, budget)
    exact = _ranked(exact, faults, EVEN * before.cost)
    if not families or (exact and exact[0].cost < CLEAR * before.cost and is_good(sights, exact[0].steps)):
        return exact
    fitted = []
    begun = _begun(families, order[:SOME], before, budget)
    for k, family in enumerate(begun):
        if budget.over:
            budget.cut([f.name for f in begun], k)
            break
        p, cost = fit(family, small, before.steps, lambda: budget.over)
        if cost > 0.9 * before.cost:
            continue
        p, cost = fit(_from(family, p), sights, before.steps, lambda: budget.over)
        if not family.possible(p) or not shows(sights, before.steps, (*before.steps, *family.make(p))):
            continue
        scenes = [s.view.scene for s in sights if s.view.scene]
        cause = Cause(family.name, family.stage, family.sentence(p, scenes), len(p))
        refit = lambda some, family=family, p=p: _refit(family, p, some, before.steps)  # noqa: E731
        extra = 0.01 * before.cost * len(p)
        fitted.append(Hypothesis((*before.causes, cause), (*before.steps, *family.make(p)), cost + extra, refit))
    return sorted((*exact, *fitted), key=lambda g: g.cost)


def _reaches(way: Pipeline, steps: Pipeline, small: Sequence[PixelSample]) -> bool:
    """Whether a way alone changes most of the pixels that these steps leave wrong; where that was seen, else True."""
    for s in small:
        if (alone := s.thin.changed.get(way)) is not None:
            s = s.thin
            left = s.errors(steps) > s.tau
            return not left.any() or bool((s.weight * (alone & left)).sum() > REACHED * (s.weight * left).sum())
    return True


def _with_habits(
    tried: list[Hypothesis], before: Hypothesis, sights: list[PixelSample], order: Sequence[PixelSample], budget: Budget
) -> list[Hypothesis]:
    """The best of the guesses, each also with what right tracers do in one way or another; their cost on all pixels."""
    best = {guess.causes[-1].name: guess for guess in reversed(tried)}
    some = sorted(best.values(), key=lambda g: g.cost)[:TEMPTING]
    if some and some[0].cost < CLEAR / 2 * before.cost:
        some = [g for g in some if EVEN * before.cost < g.cost < NEAR * before.cost]
    # A second fault is added to what the first one's way has shown; another camera meets surfaces rightly.
    some = [g for g in some if not before.causes and _beyond_the_camera(g.way)]
    forms = [replace(g, steps=form, cost=np.inf) for g in some for form in equivalent_forms(g.steps)]
    tried += _screened(forms, order, before, budget)
    some = [g for g in sorted(tried, key=lambda g: g.cost)[:TEMPTING] if _shadow_test(g.steps) in ((), *SHADOW_TESTS)]
    some = [g for g in some if g.cost > EVEN * before.cost and _beyond_the_camera(g.way)]
    tested = [
        replace(g, steps=(*(step for step in g.steps if step[0] not in SHADOW_STEPS), *test))
        for g in some
        for test in SHADOW_TESTS
    ]
    tried += _screened(tested, order, before, budget, TEMPTING)
    tried = sorted(tried, key=lambda g: g.cost)[:FINALISTS]
    near = [g for g in tried if g.cost < CLOSE * tried[0].cost + 1e-2 * before.cost]
    return [_weighed(g, sights) for k, g in enumerate(near) if not (k and budget.over)]


def _shadow_test(steps: Pipeline) -> Pipeline:
    return tuple(step for step in steps if step[0] in SHADOW_STEPS)


def _beyond_the_camera(way: Pipeline | None) -> bool:
    """Whether more is changed than the rays of the eye."""
    return way is None or any(name not in UP_TO_RAYS for name, _ in way)


def _slips(before: Hypothesis, sights: list[PixelSample], small: list[PixelSample], budget: Budget) -> list[Hypothesis]:
    """Generated slips that explain all that is wrong, the least far-fetched first of those that do it alike."""
    order = _order(small, before.steps)
    guesses = []
    for slip, steps in likely_slips(order, before.steps, budget):
        cause = Cause(slip.name, slip.stage, slip.sentence)
        guesses.append(Hypothesis((*before.causes, cause), steps))
    if not guesses:
        return []
    place = {g.causes[-1].name: k for k, g in enumerate(guesses)}
    tried = _screened(guesses, order, before, budget)
    found = [g for g in (_weighed(g, sights) for g in tried[:FINALISTS]) if is_good(sights, g.steps)]
    if not found:
        found = [g for g in _with_habits(tried, before, sights, order, budget) if is_good(sights, g.steps)]
    budget.slips_left = 0 if found else budget.slips_left
    return sorted(found, key=lambda g: (round(g.cost / (EVEN * before.cost)), place[g.causes[-1].name]))[:1]


def _begun(
    families: Sequence[ParametricFault], some: Sequence[PixelSample], before: Hypothesis, budget: Budget
) -> list[ParametricFault]:
    """The families worth fitting, of those that there is time to begin with."""
    tried, names = promising(families, some, before.steps, FITS, lambda: budget.over)
    budget.cut([f.name for f in families], len(families) if not budget.over else names)
    return tried


def _ranked(guesses: Sequence[Hypothesis], faults: Sequence[Fault], even: float) -> list[Hypothesis]:
    """The best way of each fault, by cost alone; then the other ways. Of faults that cost the same (but for `even`) the
    one that is seen in its typical form comes first, then the one that stands first in the catalogue.
    """
    rank = {f.name: k for k, f in enumerate(faults)}
    best: dict[str, Hypothesis] = {}
    others = []
    usual = set()
    for guess in sorted(guesses, key=lambda g: g.cost):
        name = guess.causes[-1].name
        if best.setdefault(name, guess) is not guess:
            others.append(guess)
        if guess.typical and guess.cost <= best[name].cost + even:
            usual.add(name)
    place = {name: (round(g.cost / max(even, 1e-12)), name not in usual, rank[name]) for name, g in best.items()}
    return [*(best[name] for name in sorted(place, key=lambda n: place[n])), *others]


def _by_common(ways: list[Hypothesis], sights: Sequence[PixelSample], before: Hypothesis) -> list[Hypothesis]:
    """Those that cost least in the scenes that everyone is asked for."""
    common = [s for s in sights if s.view.common and not (s.more or s.deep)]
    if not common:
        return ways
    changes = tuple(way for fault in FAULTS for way in fault.ways)
    sums = np.sum([costs(s, changes) for s in common], axis=0)
    limit = _limit(sums, total(common, before.steps) * len(common), FINALISTS)
    return [w for k, w in enumerate(ways) if k >= len(sums) or sums[k] <= limit]


def _screened(
    guesses: list[Hypothesis], order: Sequence[PixelSample], before: Hypothesis, budget: Budget, least: int = FINALISTS
) -> list[Hypothesis]:
    """Those that cost least, by one view after the other; a quarter is left each time, and what costs hardly more."""
    sums, wrong, views = np.zeros(len(guesses)), 0.0, 0
    first = [order[0].thin] if len(guesses) > 2 * least else []
    for sight in (*first, *order):
        unchanged = sight.errors(RIGHT)
        costs: list[float] = []
        for guess in guesses:
            if budget.over:
                break
            errors = sight.errors(guess.steps)
            costs.append(sight.cost(errors))
            if guess.way is not None and len(guess.causes) == 1 and sight in first:
                sight.changed[guess.way] = np.abs(errors - unchanged) > 0.1 * sight.tau
        budget.cut([guess.causes[-1].name for guess in guesses], len(costs))
        if len(costs) < len(guesses) and views:
            break  # what is left was tried on some views
        guesses, sums, views = guesses[: len(costs)], sums[: len(costs)] + costs, views + 1
        wrong += total([sight], before.steps)
        limit = _limit(sums, wrong, least)
        kept = [int(k) for k in np.argsort(sums, kind="stable") if sums[k] <= limit]
        guesses, sums = [guesses[k] for k in kept], sums[kept]
    return [replace(guess, cost=cost / max(views, 1)) for guess, cost in zip(guesses, sums.tolist(), strict=True)]


def _limit(sums: Array, wrong: float, least: int) -> float:
    """The cost up to which a guess is kept, of `wrong` without any: where one explains all, the others have to, too."""
    few = max(least, sums.size // 4)
    limit = float(np.sort(sums)[few - 1]) + TIED if few < sums.size else np.inf
    return min(limit, NEAR * wrong) if sums.size and sums.min() < CLEAR / 2 * wrong else limit


def _order(small: Sequence[PixelSample], before: Pipeline) -> list[PixelSample]:
    """The one that is most wrong, then the one of another rung that is, then the others."""
    worst = sorted(small, key=lambda s: -total([s], before))
    second = next((s for s in worst if s.view.rung != worst[0].view.rung), worst[0])
    return [worst[0], *([second] if second is not worst[0] else []), *(s for s in worst[1:] if s is not second)]


def _from(family: ParametricFault, p: tuple[float, ...]) -> ParametricFault:
    """The family, to be fitted from there on."""
    return replace(family, start=p, tries=())


def _refit(family: ParametricFault, p: tuple[float, ...], sights: Sequence[PixelSample], base: Pipeline) -> Pipeline:
    return (*base, *family.make(fit(_from(family, p), sights, base)[0]))


def _weighed(guess: Hypothesis, sights: Sequence[PixelSample]) -> Hypothesis:
    return replace(guess, cost=total(sights, guess.steps))


def _described(
    found: list[Hypothesis], sights: list[PixelSample], base: Hypothesis, where: str, budget: Budget
) -> Diagnosis:
    if not found:
        return Diagnosis(right=False, where=where)
    best = _rather_than_a_fact(found, sights)
    share, each = explained_share(sights, best.steps)
    hit, kept = hit_shares(sights, best.steps)
    loose = hit < MATCHED and not any(s.deep for s in sights)
    if (share < EXPLAINED or best.cost > 0.6 * base.cost or loose) and not (hit > EXPLAINED and kept > 0.99):
        single = min((g for g in found if len(g.causes) == 1), key=lambda g: g.cost)
        share = explained_share(sights, single.steps)[0]
        lit = [(s, s.view.scene) for s in sights if s.view.scene and s.view.scene.objects and not s.view.points]
        parts_of_light = [
            f"{scene.name}: {words}" for s, scene in lit if not budget.spent and (words := split(s).words)
        ]
        return Diagnosis(
            right=False,
            explained=max(share, 0.0),
            where=where,
            nearest=single.causes[0],
            light="; ".join(parts_of_light),
        )
    if not is_likelier(sights, best.steps):
        return Diagnosis(right=False, where=where)
    worst = _held_out(best, sights, each)
    others = _as_good(best, found, sights, budget)
    alone = len(best.causes) == 1 and not others[0]
    shown = share > WHOLE or (share > EXPLAINED and sum(bool(s.wrong.any()) for s in sights) > 1)
    agreed = worst is None or worst > EXPLAINED
    unchecked = budget.spent
    count, left = (0, "") if unchecked else left_over([s.everywhere(_most(s)) for s in sights], best.steps)
    whole = count < FEW and not unchecked and is_good(sights, best.steps)
    whole = whole and (best.refit is None or is_exact(sights, best.steps))
    written = not any(cause.name.startswith("slip-in-") for cause in best.causes)
    sureness: Sureness = "sure" if alone and shown and agreed and whole and written else "likely"
    order = sorted(range(len(best.causes)), key=lambda k: STAGES.index(best.causes[k].stage))
    return Diagnosis(
        right=False,
        causes=tuple(best.causes[k] for k in order),
        alternatives=tuple(others[k] for k in order),
        explained=share,
        held_out=worst,
        sureness=sureness,
        where=f"{where}; something else is wrong, too: {left}".rstrip(": ") if count >= FEW else where,
    )


def _rather_than_a_fact(found: list[Hypothesis], sights: list[PixelSample]) -> Hypothesis:
    """The best guess; not one that says only what is seen where another one leaves nothing, and that does."""
    best = found[0]
    if FACTS & {cause.name for cause in best.causes} and not is_exact(sights, best.steps):
        return next((g for g in found[1:] if is_exact(sights, g.steps)), best)
    return best


def _most(sight: PixelSample) -> int:
    """Pixels that are looked at in the end: fewer where a scene has many objects."""
    objects = len(sight.view.scene.objects) if sight.view.scene else 0
    return min(MOST, max(MET // max(objects, 1), 1))


def _by_chance(sights: Sequence[PixelSample], where: str, least: float, budget: Budget) -> Diagnosis | None:
    """A cause that leaves it to chance which of its ways is seen at a pixel: acne, and what is like it.

    `least`: the share of the wrong pixels that it has to hit, beside EXPLAINED.
    """
    spoilt = [s for s in sights if s.wrong.any()]
    mixed = np.average([s.mixed for s in spoilt], weights=[s.wrong.sum() for s in spoilt])
    for chance in budget.within("what goes by chance", CHANCES):
        if chance is ACNE and mixed < SPECKLED:
            continue
        made = [[s.predict(way) for way in chance.ways] for s in sights]
        off = [np.stack([s.off(one) for one in all_]) for s, all_ in zip(sights, made, strict=True)]
        hit = np.concatenate([
            (e.min(axis=0) <= np.minimum(4 * s.tau, s.errors(RIGHT) / 2))[s.wrong]
            for e, s in zip(off, sights, strict=True)
        ])  # fmt: skip
        kept = np.concatenate([e.min(axis=0)[~s.wrong] <= 4 * s.tau for e, s in zip(off, sights, strict=True)])
        if hit.mean() < max(EXPLAINED, least) or (kept.size and kept.mean() < 0.99):
            continue
        before = sum(s.squared(s.predict(RIGHT)) for s in sights)
        after = sum(s.squared(np.take_along_axis(np.stack(all_), e.argmin(axis=0)[None, :, None], 0)[0])
                    for s, e, all_ in zip(sights, off, made, strict=True))  # fmt: skip
        cause = Cause(chance.name, chance.stage, chance.sentence)
        return Diagnosis(False, (cause,), ((),), 1 - float(after / max(before, 1e-300)), None, "likely", where)
    return None


def _held_out(best: Hypothesis, sights: list[PixelSample], each: Array) -> float | None:
    """The share explained of the scene that is explained least, what was fitted being fitted on the others."""
    if len(sights) < 2:
        return None
    if best.refit is not None:
        each = np.array([
            explained_share([s], best.refit([x for x in sights if x is not s]))[0] if np.isfinite(each[k]) else np.nan
            for k, s in enumerate(sights)
        ])  # fmt: skip
    finite = each[np.isfinite(each)]
    return float(max(finite.min(), 0.0)) if finite.size else None


def _as_good(
    best: Hypothesis, found: Iterable[Hypothesis], sights: list[PixelSample], budget: Budget
) -> list[tuple[Cause, ...]]:
    """For each cause of the best guess those that explain the pictures as well in its place."""
    own = [s.predict(best.steps) for s in sights]
    names = [cause.name for cause in best.causes]
    others: list[dict[str, Cause]] = [{} for _ in names]
    if FACTS & set(names):
        return [() for _ in names]
    for guess in found:
        if budget.spent:
            break
        if len(guess.causes) != len(names):
            continue
        new = [cause for cause in guess.causes if cause.name not in names]
        gone = [k for k, name in enumerate(names) if name not in {cause.name for cause in guess.causes}]
        if len(new) != 1 or len(gone) != 1 or new[0].numbers != best.causes[gone[0]].numbers:
            continue
        if guess.cost < 1.25 * best.cost or all(
            are_alike(s, a, s.predict(guess.steps)) for s, a in zip(sights, own, strict=True)
        ):
            others[gone[0]].setdefault(new[0].name, new[0])
    return [tuple(list(found.values())[:ALTERNATIVES]) for found in others]
