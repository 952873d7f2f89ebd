"""A sheet that is not flat: its heights as a polynomial, and where its points go when paper bends and does not stretch.

z(x, y) = Σ c_ij P_i(x) P_j(y), 2 <= i + j <= degree, Legendre's polynomials of coordinates that run from -1 to 1 along
the longer side of the tags' centres. (Degrees 0 and 1 are a shift and a tilt: they belong to the pose.) Heights alone
would make every line on the sheet longer; so the points also move within the plane, by the displacement d whose strain
compensates the slopes, in least squares where no displacement can:

    d1_x + z_x²/2 = 0,  d2_y + z_y²/2 = 0,  d1_y + d2_x + z_x z_y = 0,

to second order in the slopes: 0.1 mm where a sheet of 250 mm is bent by 3 mm.
"""

import functools
from dataclasses import dataclass
from typing import Annotated

import msgspec
import numpy as np
from numpy.polynomial.legendre import legder, legvander

from raytwin.scene import Record

GRID = 11
"""The strain is compensated at GRID x GRID points."""


LEAST_DETERMINED = 1e-3
"""A term is undetermined if a plane and lower terms explain all but this share of its values at the tags."""

DEGREES = (2, 4, 6)
"""Those that a calibration tries; without 3 no set is predicted worse."""


class Heights(Record, frozen=True):
    """The coefficients c_ij, metres: of degree 2 (c_20, c_11, c_02), then of degree 3, and so on.

    `stretch`: by which share the board's y, about the middle of its centres, is longer than its description says.
    """

    degree: Annotated[int, msgspec.Meta(ge=DEGREES[0], le=DEGREES[-1])]
    coefficients: tuple[float, ...]
    stretch: Annotated[float, msgspec.Meta(gt=-0.5, lt=0.5)] = 0.0


def count(degree: int) -> int:
    """How many coefficients a shape of this degree has."""
    return sum(d + 1 for d in range(2, degree + 1))


@dataclass(frozen=True, eq=False)
class Bending:
    """What the coefficients c (s,) of a shape do to n points, in metres.

    `heights` (n, s): z = heights @ c. `slopes` (2, g, s): z_x and z_y on the grid. `shift` (2, n, 3 g): the
    displacement that compensates three strains on the grid.
    """

    heights: np.ndarray
    slopes: np.ndarray
    shift: np.ndarray

    def move(self, c: np.ndarray) -> np.ndarray:
        """(n, 3): how far the points lie from their places on the flat sheet."""
        zx, zy = self.slopes @ c
        return np.stack(
            [*(self.shift @ np.concatenate([-zx * zx / 2, -zy * zy / 2, -zx * zy])), self.heights @ c], axis=-1
        )

    def moves(self, c: np.ndarray) -> np.ndarray:
        """(n, s, 3): d move / d c."""
        sx, sy = self.slopes
        zx, zy = (s @ c for s in self.slopes)
        strain = np.concatenate([-zx[:, None] * sx, -zy[:, None] * sy, -zx[:, None] * sy - zy[:, None] * sx])
        return np.stack([*(self.shift @ strain), self.heights], axis=-1)


def heights_at(at: np.ndarray, xy: tuple[tuple[float, float], ...], degree: int, straight: bool = True) -> np.ndarray:
    """(..., s): what each coefficient of the shape of a board with centres at `xy` adds to the height at `at` (...,
    2).

    Beyond the outermost centres the sheet goes on `straight`: no tag shows its height there, a free edge has no
    curvature, and a polynomial of a board of four rows is wild. Not `straight`: as the polynomial goes on.
    """
    middle, half = _frame(xy)
    u = ((at - middle) / half).reshape(-1, 2)
    reach = np.ptp(np.array(xy), axis=0) / (2 * half)
    inner = np.clip(u, -reach, reach) if straight else u
    x, y = inner.T
    beyond, terms = u - inner, _terms(degree)
    found = _table(x, y, terms) + sum(beyond[:, [i]] * _table(x, y, terms, (1 - i, i)) for i in (0, 1))
    return found.reshape(*at.shape[:-1], -1)


@functools.lru_cache(maxsize=32)
def bending(xy: tuple[tuple[float, float], ...], degree: int) -> Bending:
    """The bending of a board with tags' centres at `xy`, metres."""
    middle, half = _frame(xy)
    u = (np.array(xy) - middle) / half
    reach = np.ptp(u, axis=0) / 2
    line = np.linspace(-1, 1, GRID)
    gx, gy = (g.ravel() for g in np.meshgrid(line * reach[0], line * reach[1]))
    terms = _terms(degree)
    slopes = np.stack([_table(gx, gy, terms, (1, 0)), _table(gx, gy, terms, (0, 1))]) / half
    known = _determined(x := u[:, 0], y := u[:, 1], terms)
    slopes *= known
    # The displacement: polynomials of the degree that the product of two slopes, integrated, has.
    free = [(i, d - i) for d in range(2 * degree) for i in range(d, -1, -1)]
    dx, dy = _table(gx, gy, free, (1, 0)), _table(gx, gy, free, (0, 1))
    none = np.zeros_like(dx)
    strain = np.block([[dx, none], [none, dy], [dy, dx]])
    # Least squares; the whole sheet's shift and turn strain nothing, and the small ridge leaves them at 0.
    normal = strain.T @ strain
    inverse = half * np.linalg.solve(normal + 1e-9 * normal.max() * np.eye(len(normal)), strain.T)
    values = _table(x, y, free)
    shift = np.stack([values @ inverse[: len(free)], values @ inverse[len(free) :]])
    return Bending(_table(x, y, terms) * known, slopes, shift)


def _frame(xy: tuple[tuple[float, float], ...]) -> tuple[np.ndarray, float]:
    """The middle of the centres, and half of their longer side, metres."""
    at = np.array(xy)
    low, high = at.min(axis=0), at.max(axis=0)
    return (low + high) / 2, float((high - low).max() / 2)


def _determined(x: np.ndarray, y: np.ndarray, terms: list[tuple[int, int]]) -> np.ndarray:
    """(s,) bool: which terms are not, at these n points, a sum of a plane and of those before them.

    Four rows do not determine a fourth degree: between them it could be anything.
    """
    values = _table(x, y, [(0, 0), (1, 0), (0, 1), *terms])
    values /= np.maximum(np.linalg.norm(values, axis=0), 1e-300)
    known: list[bool] = []
    basis = np.zeros((len(x), 0))
    for column in values.T:
        rest = column - basis @ (basis.T @ column)
        rest -= basis @ (basis.T @ rest)
        left = float(np.linalg.norm(rest))
        known.append(left > LEAST_DETERMINED)
        if known[-1]:
            basis = np.c_[basis, rest / left]
    return np.array(known[3:])


def _terms(degree: int) -> list[tuple[int, int]]:
    return [(i, d - i) for d in range(2, degree + 1) for i in range(d, -1, -1)]


def _table(x: np.ndarray, y: np.ndarray, terms: list[tuple[int, int]], derive: tuple[int, int] = (0, 0)) -> np.ndarray:
    """(n, terms): P_i(x) P_j(y), or its derivative, `derive` times in x and y."""
    tables = []
    for at, times, index in ((x, derive[0], 0), (y, derive[1], 1)):
        most = max(term[index] for term in terms)
        turned = legder(np.eye(most + 1), times) if times else np.eye(most + 1)
        tables.append((legvander(at, len(turned) - 1) @ turned)[:, [term[index] for term in terms]])
    return tables[0] * tables[1]
