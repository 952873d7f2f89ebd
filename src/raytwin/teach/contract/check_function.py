"""A stage's function held against its cases: called (where the student's code may run), then judged (where it may not).

What is wrong is found by prediction: each variant of the stage, a typical mistake, is called with the same arguments,
and named where it gives the numbers that were found, in all cases.
"""

import dataclasses
import itertools
import pickle
import traceback
import warnings
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np
from msgspec.structs import replace

from raytwin.explain.explanation import Explanation
from raytwin.explain.repair import Repair
from raytwin.teach.contract.composed_tracer import NEEDED
from raytwin.teach.contract.loading import arrays_of
from raytwin.teach.contract.repair_function import (
    REPAIRED_OFF,
    further_probes,
    probes,
    repair_here,
    right_ones,
    words_of,
)
from raytwin.teach.contract.stage import Arrays, Case, Function, Stage, Variant
from raytwin.teach.contract.stage_result import CaseResult, StageResult

Outcome = Arrays | str
"""What a call gave: arrays, or in words why there are none."""


def judge_function(stage: Stage, function: Function, seed: int = 0) -> StageResult:
    """Both at once: the function called and judged in this process."""
    cases = stage.cases(seed)
    found = judge(stage, cases, call_stage(stage, function, cases))
    if not found.passed or not (last := stage.last(seed)):
        return found
    return judge(stage, [*cases, *last], call_stage(stage, function, [*cases, *last]))


def repair_function(stage: Stage, function: Function, seed: int = 0, source: str = "") -> Repair | None:
    """The change of one place of the function's text that makes it correct in all cases; None where none is found."""
    if stage.misfit(function):
        return None

    def is_wrong(case: Case) -> bool:
        return not is_right(stage, case, call_stage(stage, function, [case])[0])

    cases = probes(stage, stage.cases(seed), is_wrong) or probes(stage, stage.last(seed), is_wrong)
    further = partial(further_probes, stage, seed)
    right = right_ones(stage, cases, is_wrong)
    return repair_here(function, cases, partial(is_repaired, stage), source, further, right, words_of(stage.name))


def is_right(stage: Stage, case: Case, got: Outcome) -> bool:
    """Whether these arrays pass the case."""
    return _passes(stage, case, got)


def is_repaired(stage: Stage, case: Case, got: Outcome) -> bool:
    """Whether these arrays pass the case, hardly a value being off: an accident may spoil as few as may be off."""
    return _passes(dataclasses.replace(stage, outliers=min(stage.outliers, REPAIRED_OFF)), case, got)


# ------------------------------------------------------------------------------------------ calling


def call_stage(stage: Stage, function: Function, cases: Iterable[Case]) -> list[Outcome]:
    """The function's answer to each case; it gets copies of the arguments, and whatever it raises is its answer."""
    if other := stage.misfit(function):
        return [f"it is {other}, and is called as {stage.signature}" for _ in cases]
    answers = [_call(function, case) for case in cases]
    return _one_says_so(stage, [answer for answer, _ in answers], [changed for _, changed in answers])


def _one_says_so(stage: Stage, outcomes: list[Outcome], changed: Sequence[Sequence[int]]) -> list[Outcome]:
    """The outcomes, of which the first whose call changed its arguments becomes that in words."""
    for k, arguments in enumerate(changed):
        if (said := stage.changes(arguments)) and not isinstance(outcomes[k], str):
            return [*outcomes[:k], said, *outcomes[k + 1 :]]
    return outcomes


def _call(function: Function, case: Case) -> tuple[Outcome, list[int]]:
    """What it answers, and the numbers of the arguments that it changed."""
    arguments = _copied(case.args)
    before = [pickle.dumps(argument) for argument in arguments]
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            outcome = as_arrays(function(*arguments))
    except Exception as error:  # theirs, whatever it is
        outcome = _error_text(error)
    return outcome, [k for k, one in enumerate(before) if one != pickle.dumps(arguments[k])]


def _copied(args: Any) -> Any:
    if isinstance(args, np.ndarray):
        return args.copy()
    if isinstance(args, dict):
        return {key: _copied(value) for key, value in args.items()}
    return type(args)(map(_copied, args)) if isinstance(args, list | tuple) else args


def as_arrays(made: Any) -> Outcome:
    """What was returned as arrays of floats, or in words what else it was."""
    try:
        return tuple(a.astype(float) for a in arrays_of(made))
    except TypeError as error:
        return str(error)


def _error_text(error: Exception) -> str:
    """`it raised ValueError: ... (line 12: x = a @ b)`, the line being the student's own."""
    if isinstance(error, NotImplementedError):
        return "it is not written yet"
    text = " ".join(str(error).split())[:120]
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if f.filename != __file__ and "site-packages" not in f.filename]
    where = f" (line {own[-1].lineno}{f': {own[-1].line[:60]}' if own[-1].line else ''})" if own else ""
    return f"it raised {type(error).__name__}{': ' + text if text else ''}{where}"


# ------------------------------------------------------------------------------------------ judging


def judge(stage: Stage, cases: Sequence[Case], outcomes: Sequence[Outcome]) -> StageResult:
    """No code of the student's runs here."""
    checked = [_checked(stage, case, outcome) for case, outcome in zip(cases, outcomes, strict=True)]
    results = tuple(_case_result(stage, case, got) for case, got in zip(cases, checked, strict=True))
    worst = max(
        range(len(cases)), key=lambda i: (not results[i].passed, isinstance(checked[i], str), results[i].error or 0)
    )
    errors = [r.error for r in results]
    error = None if None in errors else max(e for e in errors if e is not None)
    wrong = float(np.mean([r.wrong for r in results]))
    base = StageResult(
        stage.name, all(r.passed for r in results), error, stage.tolerance, stage.unit, "", wrong=wrong, cases=results
    )
    broken = next((got for got in checked if isinstance(got, str)), None)
    arrays = [got for got in checked if not isinstance(got, str)]
    numbers = "" if broken is not None else stage.tells(cases, arrays)
    if base.passed:
        said = f"correct in all {len(cases)} cases" + ("" if stage.judged_by else f", to {error:.2g} {stage.unit}")
        return replace(base, sentence="; ".join(filter(None, (said, numbers))))
    if broken is not None:
        where = "" if all(isinstance(got, str) for got in checked) else f" ({cases[worst].shows})"
        return replace(base, sentence=broken + where, inputs=_short_args(stage, cases[worst]))
    causes = explain(stage, cases, arrays)
    inputs, expected, found = _worst_value(stage, cases[worst], arrays[worst])
    unknown = " ".join(filter(None, ("no single common mistake fits.", _where(results), numbers)))
    sentence = _blame(causes) if causes else unknown
    made = ((causes[0].name, causes[0].sentence),) if causes else ()
    base = replace(base, sentence=sentence, faults=made, inputs=inputs, expected=expected, got=found)
    if stage.name in NEEDED and not causes:
        return _diagnosed(base, stage, cases, arrays)
    return replace(base, causes=tuple(dict.fromkeys(v.name for v in causes)))


def _diagnosed(base: StageResult, stage: Stage, cases: Sequence[Case], got: Sequence[Arrays]) -> StageResult:
    """The result with the cause that explains most of what is wrong with pictures, and the sentence."""
    from raytwin.explain.diagnosis import diagnose
    from raytwin.explain.pixel_sample import SubmittedImage
    from raytwin.renderers.scene_exchange import as_scene

    views = []
    for case, (picture,) in zip(cases, got, strict=True):
        scene, points = case.args[0], stage.name == "hit_points"
        made = as_scene(scene | {"name": case.shows})
        views.append(SubmittedImage(made, picture, case.expected[0], scene["rung"], points))
    found = diagnose(views)
    faults = ((found.cause.name, found.cause.sentence),) if found.cause else ()
    said, causes = "; ".join(student_words(found)), tuple(name for name, _ in faults)
    return replace(base, sentence=said, causes=causes, faults=faults, exact=found.certainty == "proved")


def student_words(found: Explanation) -> tuple[str, ...]:
    """The explanation in sentences for a student, without the names of scenes."""
    where = f"your pictures are {found.where.partition(';')[0]}"
    if found.cause is None:
        return (f"no single common mistake fits: {where}", *found.sentences)
    return (*found.sentences, where) if found.where else found.sentences


def _checked(stage: Stage, case: Case, outcome: Outcome) -> Outcome:
    """The arrays in the shapes that are expected, or in words what is wrong with theirs."""
    if isinstance(outcome, str):
        return outcome
    if stage.columns and len(outcome) == len(case.expected):
        outcome = tuple(a.reshape(e.shape) if a.size == e.size and a.ndim == 2 and e.ndim == 1 else a
                        for a, e in zip(outcome, case.expected, strict=True))  # fmt: skip
    if [a.shape for a in outcome] == [a.shape for a in case.expected]:
        return outcome
    names = ", ".join(f"{n} {_shape(a)}" for n, a in zip(stage.returns, case.expected, strict=True))
    found = " and ".join(_shape(a) for a in outcome) or "nothing"
    hint = stage.hint(case.expected, outcome)
    return f"it returned an array {found}, where {names} is wanted{': ' + hint if hint else ''}"


def _shape(a: np.ndarray) -> str:
    return str(a.shape) if a.shape else "of one number"


def _case_result(stage: Stage, case: Case, got: Outcome) -> CaseResult:
    if isinstance(got, str):
        return CaseResult(case.shows, False)
    errors = _errors(stage, case, got)
    error = stage.worst(errors)
    wrong = float((errors > stage.tolerance).mean())
    return CaseResult(case.shows, error <= stage.tolerance, error if np.isfinite(error) else None, wrong)


def _errors(stage: Stage, case: Case, got: Arrays) -> np.ndarray:
    with np.errstate(all="ignore"):
        errors = stage.errors(case, got)
    return np.where(np.isnan(errors), np.inf, errors)


def explain(stage: Stage, cases: Sequence[Case], got: Sequence[Arrays]) -> list[Variant]:
    """The variants that give these numbers in all cases; empty where none does.

    A variant that does not explain the first wrong case is not tried on the others. One whose own numbers pass that
    case is no explanation: it would account for any small error.
    """
    if told := stage.by_values(cases, got):
        return [Variant(*told, lambda: stage.reference)]
    order = sorted(range(len(cases)), key=lambda i: _case_result(stage, cases[i], got[i]).passed)
    first, *rest = [(cases[i], got[i]) for i in order]

    def explains(variant: Variant) -> bool:
        function = variant.make()
        predicted, _ = _call(function, first[0])
        others = (one for one in rest if not (variant.sometimes and _passes(stage, *one)))
        return (
            _agrees(stage, predicted, first[1])
            and all(_agrees(stage, _call(function, case)[0], found) for case, found in others)
            and not _passes(stage, first[0], predicted)
        )

    return list(filter(explains, stage.variants)) or list(itertools.islice(filter(explains, stage.in_other_forms), 1))


def _passes(stage: Stage, case: Case, outcome: Outcome) -> bool:
    checked = _checked(stage, case, outcome)
    return not isinstance(checked, str) and _case_result(stage, case, checked).passed


def _agrees(stage: Stage, predicted: Outcome, found: Arrays) -> bool:
    """Whether the values are those predicted, outliers apart."""
    if isinstance(predicted, str) or [a.shape for a in predicted] != [a.shape for a in found]:
        return False
    off = np.concatenate([_distance(a, b).ravel() for a, b in zip(predicted, found, strict=True)])
    return bool((off > stage.tolerance).mean() <= stage.outliers)


def _distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """|a - b| by the largest finite |a|, 1 at most; NaN and infinities agree with their like alone."""
    finite = np.isfinite(a)
    scale = np.abs(a[finite]).max(initial=1e-300)
    with np.errstate(all="ignore"):
        off = np.where(finite, np.abs(a - b) / scale, np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, 1.0))
    return np.where(off <= 1, off, 1.0)


def _blame(causes: list[Variant]) -> str:
    """The sentence; of several that explain it equally, all."""
    sentences = list(dict.fromkeys(v.sentence for v in causes))
    if len(sentences) == 1:
        return sentences[0]
    return "one of these, which these cases cannot tell apart: " + "; or: ".join(sentences)


def _where(results: Sequence[CaseResult]) -> str:
    """Return in words which cases fail, and which pass."""
    failed = [r for r in results if not r.passed]
    bad = [f"{r.shows}{f' ({100 * r.wrong:.0f} % of the values)' if r.wrong < 0.995 else ''}" for r in failed]
    good = [r.shows for r in results if r.passed]
    return f"Fails: {'; '.join(bad)}." + (f" Passes: {'; '.join(good)}." if good else "")


# ------------------------------------------------------------------------------------------ the worst value


def _worst_value(stage: Stage, case: Case, got: Arrays) -> tuple[str, str, str]:
    """Inputs, what was expected and what was found, of the value that is off by most; or of what the stage tells."""
    if told := stage.tells([case], [got]):
        return case.shows, stage.tells([case], [case.expected]), told
    errors = _errors(stage, case, got)
    at = np.unravel_index(int(errors.argmax()), errors.shape)
    if len(case.expected) > 1:
        return _short_args(stage, case), _short(case.expected), _short(got)
    return _short_args(stage, case, at), _short((case.expected[0][at],)), _short((got[0][at],))


def _short_args(stage: Stage, case: Case, at: tuple[Any, ...] = ()) -> str:
    """`directions[3] = [0.1, 0.2, 0.9], radius = 0.2`: rows of the value at `at`, and what is short as a whole."""
    named = []
    for name, arg in zip(stage.parameters, case.args, strict=True):
        if isinstance(arg, dict):
            continue
        if isinstance(arg, np.ndarray) and arg.ndim == 2 and len(at) and len(arg) == len(case.expected[0]):
            named.append(f"{name}[{at[0]}] = {_number(arg[at[0]])}")
        elif not isinstance(arg, np.ndarray) or arg.size <= 9:
            named.append(f"{name} = {_number(arg)}")
    if len(case.expected) == 1 and len(at) >= 2 and case.expected[0].ndim == 3:
        named.insert(0, f"pixel u = {at[1]}, v = {at[0]}")
    return f"{case.shows}: {', '.join(named)}" if named else case.shows


def _short(arrays: Arrays) -> str:
    return ", ".join(_number(a) for a in arrays)


def _number(value: Any) -> str:
    if np.ndim(value):
        return f"[{', '.join(map(_number, value))}]"
    return f"{float(value):.5g}"
