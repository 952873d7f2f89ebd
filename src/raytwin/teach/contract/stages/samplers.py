"""Samplers: random numbers become directions about (0, 0, 1), each with its density and its weight.

A sampler is judged by what it draws, not by its formula. Every map of the unit square with the density that is asked
for is correct: for cos θ / π Malley's map, Shirley and Chiu's concentric one, or one that swaps the two numbers.
To add a sampler, write its function, its row of SAMPLERS and of SAMPLER_STAGES, and its mistakes in stage_faults.tsv.
"""

import inspect
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import trapezoid
from scipy.stats import chi2

from raytwin.teach.contract.loading import arrays_of
from raytwin.teach.contract.stage import Arrays, Case, Stage, read_faults

DRAWS = 16384
"""Directions per case."""
ROWS, COLUMNS = 8, 16
"""Cells along cos θ and around the normal, equally probable: 128 draws in each."""
ALARMS_PER_CASE = 1e-6
"""Share of the cases that a correct sampler fails by chance."""
SAMPLER_TOLERANCE = 1e-5
"""Largest error of a direction's length, and of pdf and weight x pdf as shares of their largest values."""
UNRECOGNISED_SHARE = 1e-3
"""Share of the cases in which what a mistake draws is not recognised as its own."""
FEWEST_EXPECTED = 5.0
"""Draws expected in a cell; cells with fewer are counted together, since chi-square does not hold for them."""


class Sampler(NamedTuple):
    """The textbook in expressions: of a mistake one of them is another, or two that belong together.

    `cosine`: cos θ, of a number `a` in [0, 1), from 1 downwards. `turn`: the angle about the normal, of `b`. `pdf` and
    `value`, what is sampled, per steradian, of z = cos θ; c and n are the number that a sampler takes beside u.
    """

    cosine: str
    pdf: str
    value: str
    turn: str = "2 * pi * b"
    weight: str = "value / pdf"

    def at(self, part: str, parameter: Any, **known: Any) -> Any:
        """The value of one part."""
        names = {"pi": np.pi, "sqrt": np.sqrt, "cos": np.cos, "arccos": np.arccos, "c": parameter, "n": parameter}
        with np.errstate(all="ignore"):
            return eval(_compiled(getattr(self, part)), names | known) + 0 * next(iter(known.values()))

    def __call__(self, u: Any, parameter: Any = None) -> Arrays:
        a, b = np.asarray(u, float).T
        z, angle = self.at("cosine", parameter, a=a), self.at("turn", parameter, b=b)
        radius = np.sqrt(np.maximum(1 - z * z, 0))
        pdf, value = self.at("pdf", parameter, z=z), self.at("value", parameter, z=z)
        directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)
        return directions, pdf, self.at("weight", parameter, value=value, pdf=pdf)


@cache
def _compiled(expression: str) -> Any:
    return compile(expression, "sampler", "eval")


SAMPLERS = {
    "sample_cosine": Sampler("sqrt(1 - a)", "z / pi", "z / pi"),
    "sample_hemisphere": Sampler("1 - a", "1 / (2 * pi)", "z / pi"),
    "sample_cone": Sampler("1 - a * (1 - c)", "1 / (2 * pi * (1 - c))", "1"),
    "sample_phong": Sampler("(1 - a) ** (1 / (n + 1))", "(n + 1) / (2 * pi) * z**n", "(n + 2) / (2 * pi) * z**n"),
}
"""Name of a stage -> its textbook."""


# ------------------------------------------------------------------------------------------ what students write


def sample_cosine(u: Any) -> Any:
    return SAMPLERS["sample_cosine"](u)


def sample_hemisphere(u: Any) -> Any:
    return SAMPLERS["sample_hemisphere"](u)


def sample_cone(u: Any, cos_max: float) -> Any:
    return SAMPLERS["sample_cone"](u, cos_max)


def sample_phong(u: Any, exponent: float) -> Any:
    return SAMPLERS["sample_phong"](u, exponent)


SAMPLER_NAMES = tuple(SAMPLERS)
"""The samplers, each of which may be a part of a sampled picture."""


def source_of(names: Sequence[str]) -> str:
    """The text of these samplers, with all that they need."""
    head = "from functools import cache\nfrom typing import Any, NamedTuple\nimport numpy as np\nArrays = Any"
    known = f"SAMPLERS = {SAMPLERS!r}"
    texts = [inspect.getsource(globals()[name]) for name in names]
    return "\n\n".join([head, inspect.getsource(Sampler), inspect.getsource(_compiled), known, *texts])


# ------------------------------------------------------------------------------------------ what is drawn


class Drawn:
    """What a function gave in one case, beside its textbook: unit `directions` (N, 3), `pdf` and `weight` (N,)."""

    def __init__(self, sampler: Sampler, case: Case, got: Arrays) -> None:
        self.sampler, (self.directions, self.pdf, self.weight) = sampler, got
        self.parameter = next((argument for argument in case.args if np.ndim(argument) == 0), None)
        self.z = self.directions[:, 2]
        self.lowest = float(self.at("cosine", a=1.0))
        self.off = np.abs(np.linalg.norm(self.directions, axis=-1) - 1)
        self.unit = bool((self.off <= SAMPLER_TOLERANCE).all())

    def at(self, part: str, **known: Any) -> Any:
        return self.sampler.at(part, self.parameter, **known)

    def p_value(self, of: Sampler) -> float:
        """The probability of drawing worse than this, if `of` drew it: chi-square over cells, rows and columns."""
        edges = [-1.0, *(self.at("cosine", a=np.linspace(1, 0, ROWS + 1)) - SAMPLER_TOLERANCE)]
        edges[-1] = 1.0 + SAMPLER_TOLERANCE
        turn = np.arctan2(self.directions[:, 1], self.directions[:, 0]) / (2 * np.pi) % 1
        counts = np.histogram2d(self.z, turn, (edges, np.linspace(0, 1, COLUMNS + 1)))[0]
        even = (np.arange(DRAWS) + 0.5) / DRAWS
        rows = np.histogram(of.at("cosine", self.parameter, a=even), edges)[0] / DRAWS
        columns = np.histogram(of.at("turn", self.parameter, b=even) / (2 * np.pi) % 1, COLUMNS, (0, 1))[0] / DRAWS
        tests = (counts, np.outer(rows, columns)), (counts.sum(axis=1), rows), (counts.sum(axis=0), columns)
        return min(1.0, len(tests) * min(_chi_square(found, len(self.z) * shares) for found, shares in tests))

    def errors(self) -> np.ndarray:
        """Return each direction's error: its length, domain, pdf and weight x pdf; 1 for all where the test fails."""
        off = np.maximum(self.off, np.maximum(self.lowest - self.z, 0))
        for found, part in ((self.pdf, "pdf"), (self.weight * self.pdf, "value")):
            off = np.maximum(off, np.abs(found - self.at(part, z=self.z)) / self.at(part, z=1.0))
        if not (off <= SAMPLER_TOLERANCE).all() or self.p_value(self.sampler) >= ALARMS_PER_CASE:
            return np.asarray(off)
        return np.ones_like(off)

    def integral(self) -> float:
        """The integral of the claimed pdf over the domain, the pdf being one of cos θ; NaN where none is in it."""
        inside = self.z >= self.lowest
        if not inside.any():
            return np.nan
        z, pdf = self.z[inside], self.pdf[inside]
        order = np.argsort(z)
        z, pdf = np.concatenate([[self.lowest], z[order], [1.0]]), pdf[order[[0, *range(len(z)), -1]]]
        return float(2 * np.pi * trapezoid(pdf, z))

    def variance(self) -> float:
        """The weight's variance by the square of its mean."""
        return float(self.weight.var() / max(self.weight.mean() ** 2, 1e-300))

    def fits(self, wrong: Sampler) -> bool:
        """Whether a mistake predicts what was drawn and claimed; the weight may be of the correct pdf, too."""
        if self.p_value(wrong) < UNRECOGNISED_SHARE:
            return False
        inside = self.z >= self.lowest
        z, pdf, weight = (values[inside] for values in (self.z, self.pdf, self.weight))
        value, right = self.at("value", z=z), self.at("pdf", z=z)
        claimed = wrong.at("pdf", self.parameter, z=z)
        weights = [wrong.at("weight", self.parameter, value=value, pdf=one) for one in (claimed, right)]
        return _close(pdf, claimed) and any(_close(weight, one) for one in weights)


def _chi_square(counts: np.ndarray, expected: np.ndarray) -> float:
    """The probability of counts that are farther from those expected."""
    few = expected < FEWEST_EXPECTED
    counts, expected = np.append(counts[~few], counts[few].sum()), np.append(expected[~few], expected[few].sum())
    if counts[-1] > 0 and expected[-1] == 0:
        return 0.0
    used = expected > 0
    return float(chi2.sf(((counts - expected)[used] ** 2 / expected[used]).sum(), max(used.sum() - 1, 1)))


def _close(found: np.ndarray, expected: np.ndarray) -> bool:
    """Whether 99 % of the values agree: near the horizon some lose their digits."""
    return bool(np.isclose(found, expected, rtol=1e-3).mean() >= 0.99)


# ------------------------------------------------------------------------------------------ what is said


@cache
def faults(stage: str) -> tuple[tuple[str, str, tuple[Sampler, ...]], ...]:
    """The mistakes of a sampler: name, sentence, and for each way, part, expression, ..., what the textbook becomes."""
    return tuple(
        (name, sentence, tuple(SAMPLERS[stage]._replace(**dict(zip(way[::2], way[1::2], strict=True))) for way in ways))
        for name, sentence, ways in read_faults(stage)
    )


def _named(stage: str, cases: Sequence[Case], got: Sequence[Arrays]) -> tuple[str, str] | None:
    """The mistake that predicts what was drawn and claimed in all cases, whatever the formula; None if none does."""
    drawn = [Drawn(SAMPLERS[stage], case, arrays) for case, arrays in zip(cases, got, strict=True)]
    if not all(np.isfinite(one.directions).all() for one in drawn):
        return None
    if not all(one.unit for one in drawn):
        return "not unit", "the directions are not unit: x² + y² + z² = 1"
    for name, sentence, ways in faults(stage):
        if any(all(one.fits(way) for one in drawn) for way in ways):
            return name, sentence
    return None


def _told(stage: str, cases: Sequence[Case], got: Sequence[Arrays]) -> str:
    """The numbers that any density and any weight have, of all cases."""
    drawn = [Drawn(SAMPLERS[stage], case, arrays) for case, arrays in zip(cases, got, strict=True)]
    if not all(one.unit for one in drawn):
        return f"the largest error of a direction's length is {max(one.off.max() for one in drawn):.2g}"
    said = [f"chi-square p {', '.join(f'{one.p_value(one.sampler):.2g}' for one in drawn)}"]
    integrals = dict.fromkeys(f"{one.integral():.4g}" for one in drawn)
    said.append(f"the pdf integrates to {', '.join(integrals)}")
    least = "0 by the density cos θ / π" if stage == "sample_hemisphere" else "best known: 0"
    said.append(f"the weight's relative variance is {round(max(one.variance() for one in drawn), 6):.2g} ({least})")
    return "; ".join(said)


# ------------------------------------------------------------------------------------------ the stages


def _stage(reference: Callable[..., Any], *shown: tuple[str, tuple[float, ...]]) -> Stage:
    """A stage with a case for each row of `shown`: its words, and the numbers that the sampler takes beside u."""
    name = reference.__name__

    def cases(seed: int) -> list[Case]:
        rng = np.random.default_rng(seed)
        asked = [(words, (rng.uniform(size=(DRAWS, 2)), *more)) for words, more in shown]
        return [Case(words, args, arrays_of(reference(*args))) for words, args in asked]

    def errors(case: Case, got: Arrays) -> np.ndarray:
        return Drawn(SAMPLERS[name], case, got).errors()

    return Stage(
        reference, ("directions", "pdf", "weight"), cases, errors, SAMPLER_TOLERANCE, "of 1",
        columns=True, by_values=partial(_named, name), tells=partial(_told, name),
        judged_by="a chi-square test of the directions",
    )  # fmt: skip


TWO_DRAWS = ("numbers at random", ()), ("other numbers at random", ())
SAMPLER_STAGES = (
    _stage(sample_cosine, *TWO_DRAWS),
    _stage(sample_hemisphere, *TWO_DRAWS),
    _stage(sample_cone, ("a wide cone", (0.3,)), ("a narrow cone", (0.98,))),
    _stage(sample_phong, ("a wide lobe", (3.0,)), ("a narrow lobe", (10.0,))),
)
