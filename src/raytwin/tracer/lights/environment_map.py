"""A sky that differs by direction: its radiance, samples by its luminance, and its diffuse irradiance by harmonics.

The map is what `scene.Environment` says: bilinear between the centres of its texels, which are equal steps of u (round)
and v (down). A row of texels fills the solid angle between two heights z.
"""

from math import pi
from typing import Any, NamedTuple

from raytwin.scene import Environment
from raytwin.tracer.arrays import Vec, cos, dot, maximum, minimum, select, sin, sqrt
from raytwin.tracer.lights.envmap_tables import tabulate
from raytwin.tracer.lights.lookup import arctan2, as_floats, floor, take


class EnvironmentMap(NamedTuple):
    """The map as rays read it. `texels`: three channels, row by row; `axes`: the map's x, y, z in the rays' frame.

    `rows` (h + 1) and `columns` (h, w + 1): the shares of light above each row's edge, and, within a row, to the left
    of each column's; `heights` (h + 1): z of the rows' edges; `densities` (h, w): of `sample`, per steradian.
    `harmonics`: nine numbers per channel, see `diffuse_irradiance`. All but `size` (w, h) in the engine's floats.
    """

    size: tuple[int, int]
    texels: Vec
    axes: tuple[Vec, Vec, Vec]
    rows: Any
    columns: Any
    heights: Any
    densities: Any
    harmonics: tuple[tuple[Any, ...], ...]

    @property
    def sampled(self) -> bool:
        return True

    def radiance(self, d: Vec) -> Vec:
        """L(d): bilinear between the four nearest centres."""
        w, h = self.size
        x, y = self._columns_rows(d)
        i, j = floor(x - 0.5), floor(y - 0.5)
        a, b = x - 0.5 - as_floats(x, i), y - 0.5 - as_floats(y, j)
        left, right = select(i < 0, w - 1, i), select(i + 1 < w, i + 1, 0)
        top, low = maximum(j, 0) * w, minimum(j + 1, h - 1) * w
        r, g, b_ = (
            (1 - b) * ((1 - a) * take(c, top + left) + a * take(c, top + right))
            + b * ((1 - a) * take(c, low + left) + a * take(c, low + right))
            for c in self.texels
        )
        return r, g, b_

    def density(self, d: Vec) -> Any:
        """The density of `sample` along d, per steradian."""
        w, h = self.size
        x, y = self._columns_rows(d)
        return take(self.densities, minimum(floor(y), h - 1) * w + minimum(floor(x), w - 1))

    def sample(self, a: Any, b: Any) -> tuple[Vec, Any]:
        """A direction with about the density of its luminance, from two numbers in [0, 1); and that density.

        A row by its share of the light, a column by its share of the row's, evenly within the texel.
        """
        w, h = self.size
        j, down = _interval(self.rows, 0 * floor(a), h, a)
        i, right = _interval(self.columns, j * (w + 1), w, b)
        top, low = take(self.heights, j), take(self.heights, j + 1)
        z, turn = top + down * (low - top), ((as_floats(right, i) + right) * (2 / w) - 1) * pi
        level = sqrt(maximum(1 - z * z, 0.0))
        local = level * sin(turn), level * cos(turn), z
        x, y, z = (dot(local, column) for column in zip(*self.axes, strict=True))
        return (x, y, z), take(self.densities, j * w + i)

    def diffuse_irradiance(self, normal: Vec) -> Vec:
        """E(n)/π of the normal n, where nothing hides the map: the constant sky that gives it as much light.

        E(n) = Σ Â_l L_lm Y_lm(n) to l = 2, with Â = π, 2π/3, π/4: what is left out is small, since the cosine hardly
        lets more through (Ramamoorthi and Hanrahan, "An Efficient Representation for Irradiance Environment Maps",
        SIGGRAPH 2001). Never below 0.
        """
        x, y, z = (dot(axis, normal) for axis in self.axes)
        basis = polynomials(x, y, z)
        r, g, b = (maximum(sum(k * p for k, p in zip(c, basis, strict=True)), 0.0) for c in self.harmonics)
        return r, g, b

    def _columns_rows(self, d: Vec) -> tuple[Any, Any]:
        """Columns from the map's left edge and rows from its top."""
        w, h = self.size
        x, y, z = (dot(axis, d) for axis in self.axes)
        return (0.5 + arctan2(x, y) / (2 * pi)) * w, arctan2(sqrt(x * x + y * y), z) / pi * h


def polynomials(x: Any, y: Any, z: Any) -> tuple[Any, ...]:
    """The nine harmonics to l = 2 as polynomials of a unit direction, without their factors."""
    return 0 * x + 1, x, y, z, x * y, y * z, x * z, x * x - y * y, 3 * z * z - 1


def _interval(ends: Any, first: Any, count: int, x: Any) -> tuple[Any, Any]:
    """(k, how far into it): the last k < count with ends[first + k] <= x, by halving; ends[first] is 0."""
    k, step = 0 * first, 1 << (count - 1).bit_length()
    while step := step >> 1:
        further = k + step
        there = take(ends, first + minimum(further, count - 1)) <= x
        k = select((further < count) & there, further, k)
    low, high = take(ends, first + k), take(ends, first + k + 1)
    return k, minimum((x - low) / maximum(high - low, 1e-30), 1 - 2.0**-24)


def environment_map(environment: Environment) -> EnvironmentMap:
    """Its tables, and its axes."""
    x, y, z = environment.R_map_board
    tables = tabulate(environment.size, environment.texels)
    return EnvironmentMap(environment.size, tables.texels, (x, y, z), *tables[1:])
