"""Mistakes with a number in them: a factor, a shift, an angle, fitted to all views together.

Each family is a change of the tracer with parameters. They are found by Gauss and Newton's method on the logarithmic
cost of `Sight`, whose tolerance begins at the size of the errors and shrinks to what is close.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import pi
from typing import Any

import msgspec
import numpy as np

from raytwin.diagnose.changes import (
    CAMERA,
    LIGHT,
    OUTPUT,
    SHADOW,
    SOLVER,
    at,
    behind,
    dimmed,
    lens,
    lit,
    offset_by,
    posed,
    resized,
    shaded,
    shadows,
    shown,
    sky_times,
    sun,
    sun_times,
    within,
)
from raytwin.diagnose.pixel_sample import Sight
from raytwin.diagnose.predict import RIGHT, Array, Change, Steps, Terms
from raytwin.scene import Camera, Scene, Shape, Sphere

__all__ = ["FAMILIES", "Family", "fit"]

NAMED = (
    (pi, "π"), (1 / pi, "1/π"), (2.0, "2"), (0.5, "1/2"), (2 * pi, "2π"), (1 / (2 * pi), "1/(2π)"), (4.0, "4"),
    (0.25, "1/4"), (pi**2, "π²"), (1 / pi**2, "1/π²"), (255.0, "255"), (1 / 255, "1/255"),
)  # fmt: skip
WRITTEN = (
    (pi / 3.14, "3.14"),
    (pi / 3.1415, "3.1415"),
    (7 * pi / 22, "22/7"),
    (3.14 / pi, "3.14"),
    (22 / 7 / pi, "22/7"),
)
"""Factors of light that a rounded π leaves, as divisor or factor."""
SAME = 1e-5
"""A factor this close to 1 changes nothing that single precision shows."""


@dataclass(frozen=True, eq=False)
class Family:
    """`make(p)` is the change with the parameters p; `start`: those that change nothing; `step`: small ones.

    `tries`: other places to begin at. `say(p)`: the sentence; `say_in(p, scenes)`: the same where it depends on the
    scenes. `possible(p)`: whether the parameters mean anything; a fit that leaves them is dropped.
    """

    name: str
    stage: str
    start: tuple[float, ...]
    step: float
    make: Callable[[Any], Change]
    say: Callable[[Any], str]
    tries: tuple[tuple[float, ...], ...] = ()
    say_in: Callable[[Any, Sequence[Scene]], str] | None = None
    possible: Callable[[Any], bool] = lambda p: True

    def sentence(self, p: Sequence[float], scenes: Sequence[Scene]) -> str:
        """What a user reads of these parameters, fitted to these scenes."""
        return self.say_in(p, scenes) if self.say_in and scenes else self.say(p)


def factor(k: float) -> str:
    """3.142 = π."""
    named = next((f" = {name}" for value, name in NAMED if abs(k / value - 1) < 2e-3), "")
    return f"{k:.4g}{named if 'π' in named or '/' in named else ''}"


def bright(k: float) -> str:
    """How a part with the factor k differs from the right one."""
    if abs(k - 1) < 2e-3:
        written = next((f" (π written as {name})" for value, name in WRITTEN if abs(k - value) < 2e-5), "")
        return f"{100 * abs(k - 1):.2g} % too {'bright' if k > 1 else 'dark'}{written}"
    if abs(k) < 1e-3 or k < 0:
        return "gone" if abs(k) < 1e-3 else f"negative: multiplied by {k:.4g}"
    return f"{factor(k)} times too bright" if k > 1 else f"too dark by a factor of {factor(1 / k)}"


def _turned(p: Sequence[float]) -> Array:
    """exp of the rotation vector p, radians (Rodrigues)."""
    x, y, z = (float(a) for a in p)
    angle = (x * x + y * y + z * z) ** 0.5
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    if angle < 1e-12:
        return np.eye(3) + K
    return np.eye(3) + np.sin(angle) / angle * K + (1 - np.cos(angle)) / angle**2 * (K @ K)


def _light_turned(p: Sequence[float]) -> Change:
    turn = _turned((*p, 0.0)[:3])
    return lit(lambda to, scene, hits: turn @ to)


def _camera_turned(p: Sequence[float]) -> Change:
    turn = _turned(p)
    return posed(lambda R, t: (-R.T @ t, R.T @ turn))


def _camera_moved(p: Sequence[float]) -> Change:
    return posed(lambda R, t: (-R.T @ t + np.array(p), R.T))


def _focal(p: Sequence[float]) -> Change:
    return lens(fx=lambda c: c.fx * p[0], fy=lambda c: c.fy * p[-1])


def _distortion(p: Sequence[float]) -> Change:
    return lambda s: s._replace(lens=lambda camera: msgspec.structs.replace(
        s.lens(camera), dist=tuple(p[0] * k for k in camera.coefficients)))  # fmt: skip


def _strength(p: Sequence[float]) -> Change:
    """Shadows let through a share of the sun."""
    return shaded(lambda x: sun(x._replace(visible=x.visible + p[0] * (1 - x.visible))) + x.albedo * x.sky)


def _power(p: Sequence[float]) -> Change:
    return shown(lambda x: np.maximum(x, 0) ** p[0])


def _added(x: Terms, p: Sequence[float]) -> Array:
    return x.albedo * (x.sky + np.array(p)[:, None]) + sun(x)


def _degrees(p: Sequence[float]) -> float:
    return float(np.degrees(np.linalg.norm(p)))


def _sun_moved(p: Sequence[float], scenes: Sequence[Scene]) -> str:
    """By the angle between the right and the fitted direction: what turns about the sun itself moves nothing."""
    turn, suns = _turned(p), [np.array(scene.sun.to_light) for scene in scenes]
    angle = max(float(np.arctan2(np.linalg.norm(np.cross(to, turn @ to)), to @ turn @ to)) for to in suns)
    most = "up to " if len({scene.sun.to_light for scene in scenes}) > 1 else ""
    return f"the sun's direction is off by {most}{np.degrees(angle):.3g} degrees"


def _sun_and_sky(p: Sequence[float]) -> str:
    parts = [
        f"the {name}'s part is {bright(k)}" for name, k in zip(("sun", "sky"), p, strict=True) if abs(k - 1) > SAME
    ]
    return ", and ".join(parts)


FAMILIES = (
    Family("shifted", CAMERA, (0.0, 0.0), 0.1, lambda p: at(lambda u, v, c: (u + p[0], v + p[1])),
           lambda p: f"the image is shifted by ({-p[0]:.3g}, {-p[1]:.3g}) pixels (right, down): (0, 0) is the centre "
                     "of the top-left pixel"),
    Family("focal-length", CAMERA, (1.0,), 0.003, _focal,
           lambda p: f"the focal length is off by a factor of {p[0]:.4g}"),
    Family("focal-lengths", CAMERA, (1.0, 1.0), 0.003, _focal,
           lambda p: f"the focal lengths are off: fx by a factor of {p[0]:.4g}, fy by {p[1]:.4g}"),
    Family("camera-turned", CAMERA, (0.0, 0.0, 0.0), 0.001, _camera_turned,
           lambda p: f"the camera is turned by {_degrees(p):.3g} degrees: check R"),
    Family("camera-moved", CAMERA, (0.0, 0.0, 0.0), 0.001, _camera_moved,
           lambda p: "the eye stands off by ({:.3g}, {:.3g}, {:.3g}) m in the board's frame: it is -Rᵀ t".format(*p)),
    Family("distortion-scaled", CAMERA, (1.0,), 0.02, _distortion,
           lambda p: f"the distortion is {p[0]:.3g} times as strong as it should be"),
    Family("radius-scaled", SOLVER, (1.0,), 0.005, lambda p: resized(abs(p[0]) + 1e-9),
           lambda p: f"the spheres are {p[0]:.4g} times as large as they should be"),
    Family("light-turned", LIGHT, (0.0, 0.0, 0.0), 0.01, _light_turned,
           lambda p: f"the sun's direction is off by up to {_degrees(p):.3g} degrees",
           ((0.6, 0.0, 0.0), (0.0, 0.6, 0.0), (-0.6, 0.0, 0.0), (0.0, -0.6, 0.0)), _sun_moved),
    Family("sun-scaled", LIGHT, (1.0,), 0.1, lambda p: sun_times(p[0]), lambda p: f"the sun's part is {bright(p[0])}"),
    Family("sky-scaled", LIGHT, (1.0,), 0.1, lambda p: sky_times(p[0]), lambda p: f"the sky's part is {bright(p[0])}"),
    Family("surfaces-scaled", LIGHT, (1.0,), 0.1, lambda p: lambda s: sky_times(p[0])(sun_times(p[0])(s)),
           lambda p: f"all that is lit is {bright(p[0])}, the background is right"),
    Family("sun-and-sky-scaled", LIGHT, (1.0, 1.0), 0.1, lambda p: lambda s: sky_times(p[1])(sun_times(p[0])(s)),
           _sun_and_sky),
    Family("sun-colour", LIGHT, (1.0, 1.0, 1.0), 0.1, lambda p: sun_times(np.array(p)[:, None]),
           lambda p: "the sun's part is off by the factors {:.4g}, {:.4g}, {:.4g} (red, green, blue)".format(*p)),
    Family("sky-colour", LIGHT, (0.0, 0.0, 0.0), 0.02, lambda p: shaded(lambda x: _added(x, p)),
           lambda p: "the sky that lights surfaces has ({:+.3g}, {:+.3g}, {:+.3g}) too much radiance".format(*p)),
    Family("shadow-strength", SHADOW, (0.0,), 0.1, _strength,
           lambda p: f"shadows let {100 * p[0]:.3g} % of the sun through: there is none where it is hidden"),
    Family("shadow-dims", SHADOW, (1.0,), 0.1, lambda p: shaded(partial(dimmed, by=p[0])),
           lambda p: f"shadows scale the whole light by {p[0]:.3g}: they take away the sun's part alone"),
    Family("image-scaled", OUTPUT, (1.0,), 0.1, lambda p: shown(lambda x: p[0] * x),
           lambda p: f"the whole image, background too, is {bright(p[0])}"),
    Family("offset", OUTPUT, (0.0,), 0.01, lambda p: shown(lambda x: p[0] + x),
           lambda p: f"{p[0]:.4g} is added to every value"),
    Family("power", OUTPUT, (1.0,), 0.05, _power,
           lambda p: f"the values are raised to the power {p[0]:.3g}: gamma, where linear radiance is wanted",
           ((0.5,), (2.0,)), possible=lambda p: 0.2 < p[0] < 5),
    Family("background", OUTPUT, (0.0, 0.0, 0.0), 0.05,
           lambda p: behind(lambda scene: np.array(scene.sky.radiance) + np.array(p)),
           lambda p: "the background is off by ({:+.3g}, {:+.3g}, {:+.3g}): a ray that meets nothing shows the sky's "
                     "radiance".format(*p)),
    Family("background-constant", OUTPUT, (0.0, 0.0, 0.0), 0.05, lambda p: behind(lambda scene: p),
           lambda p: "the background is ({:.3g}, {:.3g}, {:.3g}): a ray that meets nothing shows the sky's "
                     "radiance".format(*p)),
    Family("shadow-start", SHADOW, (-6.0,), 0.2, lambda p: shadows(offset_by(10 ** p[0])),
           lambda p: f"the shadow ray starts too far from the surface ({10 ** p[0]:.2g} m): shadows near what "
                     "casts them are lost", ((-3.0,), (-2.3,), (-1.7,), (-1.0,), (-0.3,))),
    Family("shadow-reach", SHADOW, (3.0,), 0.1, lambda p: shadows(within(10 ** p[0])),
           lambda p: f"only what is nearer than {10 ** p[0]:.2g} m casts a shadow: nothing bounds the way to the sun",
           ((-0.7,), (-1.2,), (0.0,))),
)  # fmt: skip
"""A number more is a worse explanation: of two that fit alike, the row with fewer parameters stands."""


MANY = 8
"""Objects, beyond which no single one is fitted."""


def of_objects(scene: Scene) -> tuple[Family, ...]:
    """Families of one object each: a sphere's radius, where there are other spheres, and where an object stands."""
    if len(scene.objects) > MANY:
        return ()
    made = []
    for k, (name, number, thing) in enumerate(zip(scene.names, scene.numbers, scene.objects, strict=True)):
        if isinstance(thing, Sphere) and len(scene.spheres) > 1:
            r = thing.radius
            made.append(Family(f"radius-of-{number}", SOLVER, (0.0,), 0.001 * r, partial(_grown, k),
                               partial(_said_of_radius, name), ((0.03 * r,), (-0.03 * r,))))  # fmt: skip
        size = thing.radius if isinstance(thing, Sphere) else float(np.linalg.norm(thing.half_u))
        made.append(
            Family(f"place-of-{number}", SOLVER, (0.0, 0.0, 0.0), 0.005 * size, partial(_moved, k),
                   partial(_said_of_place, name))
        )  # fmt: skip
    return tuple(made)


def _with_object(k: int, change: Callable[[Any], Shape]) -> Change:
    """The k-th object changed, all others as they are."""

    def objects(things: tuple[Shape, ...], camera: Camera, before: Any) -> tuple[Shape, ...]:
        all_ = before(things, camera)
        return (*all_[:k], change(all_[k]), *all_[k + 1 :]) if k < len(all_) else all_

    return lambda s: s._replace(objects=partial(objects, before=s.objects))


def _grown(k: int, p: Sequence[float]) -> Change:
    return _with_object(k, lambda x: msgspec.structs.replace(x, radius=abs(x.radius + float(p[0])) + 1e-12))


def _moved(k: int, p: Sequence[float]) -> Change:
    return _with_object(k, lambda x: msgspec.structs.replace(
        x, center=tuple(float(a + b) for a, b in zip(x.center, p, strict=True))))  # fmt: skip


def _said_of_radius(name: str, p: Sequence[float]) -> str:
    return f"the radius of {name} is {1000 * abs(p[0]):.3g} mm too {'large' if p[0] > 0 else 'small'}"


def _said_of_place(name: str, p: Sequence[float]) -> str:
    return f"{name} stands off by ({', '.join(f'{1000 * x:+.3g}' for x in p)}) mm in the board's frame"


def fit(
    family: Family, sights: Sequence[Sight], base: Steps = RIGHT, over: Callable[[], bool] = lambda: False
) -> tuple[tuple[float, ...], float]:
    """The parameters that explain most, and their cost, the mean over sights; as far as it comes until `over`."""
    found = [Descent(family, sights, base, np.array(p, float)).run(over) for p in (family.start, *family.tries)]
    p, cost = min(found, key=lambda x: x[1])
    return tuple(float(x) for x in p), cost


def promising(
    families: Sequence[Family],
    sights: Sequence[Sight],
    base: Steps,
    most: int,
    over: Callable[[], bool] = lambda: False,
) -> tuple[list[Family], int]:
    """Those whose first step explains most, each begun at its best place; and how many were tried until `over`."""
    tried: list[tuple[float, int, Family, Array]] = []
    count = 0
    for family in families:
        if over():
            break
        count += 1
        for start in (family.start, *family.tries):
            descent = Descent(family, sights, base, np.array(start, float))
            gain = descent.advance()
            tried.append(
                (descent.cost(descent.before, descent.first) if gain else np.inf, len(tried), family, descent.p)
            )
    found: dict[str, Family] = {}
    for _, _, family, p in sorted(tried, key=lambda x: x[:2]):
        found.setdefault(family.name, replace(family, start=tuple(p), tries=()))
    return list(found.values())[:most], count


def total(sights: Sequence[Sight], steps: Steps, widen: float = 1) -> float:
    """The mean cost; `widen`: with so many times the tolerance."""
    return float(np.mean([s.cost(s.errors(steps), widen * s.tau) for s in sights]))


class Descent:
    """Gauss and Newton's steps, kept where the cost falls; `widen`: times the last tolerance."""

    def __init__(self, family: Family, sights: Sequence[Sight], base: Steps, p: Array) -> None:
        self.family, self.sights, self.base, self.p = family, sights, base, p
        self.roots = np.concatenate([np.repeat(np.sqrt(s.weight / len(sights)), 3) for s in sights])
        self.before = self.residuals(p)
        right = np.abs(self._residuals(base) / self.roots)
        self.first = self.widen = float(np.median(right[right > 1])) if (right > 1).any() else 1.0
        self.step = family.step

    def residuals(self, p: Array) -> Array:
        return self._residuals(self.family.make(tuple(p))(self.base))

    def _residuals(self, steps: Steps) -> Array:
        off = [np.clip((s.shown - s.predict(steps)) / s.tau, -1e8, 1e8).ravel() for s in self.sights]
        return self.roots * np.nan_to_num(np.concatenate(off))

    def cost(self, r: Array, widen: float) -> float:
        return float((self.roots**2 * np.log1p(np.square(r / self.roots / widen))).sum())

    def advance(self) -> float:
        """One step, as long as it helps: its length; 0 where none does."""
        columns = []
        for k in range(self.p.size):
            moved = self.p.copy()
            moved[k] += self.step
            columns.append((self.residuals(moved) - self.before) / self.step)
        J = np.stack(columns, axis=1)
        w = 1 / (1 + np.square(self.before / self.roots / self.widen))
        A, b = (J * w[:, None]).T @ J, (J * w[:, None]).T @ self.before
        try:
            change = -np.linalg.solve(A + 1e-9 * np.diag(np.diag(A) + 1e-12), b)
        except np.linalg.LinAlgError:
            return 0.0
        now = self.cost(self.before, self.widen)
        for shorter in (1.0, 0.4):
            tried = self.residuals(self.p + shorter * change)
            if self.cost(tried, self.widen) < now:
                self.p, self.before = self.p + shorter * change, tried
                return float(np.abs(change).max())
        return 0.0

    def run(self, over: Callable[[], bool] = lambda: False) -> tuple[Array, float]:
        for _ in range(12):
            if over():
                break
            length = self.advance()
            if not length:
                if self.widen <= 1 and self.step <= self.family.step * 0.1:
                    break
                self.step = max(self.step / 4, self.family.step * 1e-2)
            elif self.widen <= 1 and length < 1e-5 * self.family.step:
                break
            self.widen = max(self.widen / 4, 1.0)
        return self.p, total(self.sights, self.family.make(tuple(self.p))(self.base))
