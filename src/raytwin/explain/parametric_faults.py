"""Mistakes with parameters: a factor, a shift, an angle. They are fitted to all views together.

Each family is a change of the tracer with parameters. They are found by least squares on the logarithmic cost of
`PixelSample`, whose tolerance begins at the size of the errors and shrinks to what is close.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np

from raytwin.explain.changes import (
    CAMERA,
    LIGHT,
    NEAR,
    OUTPUT,
    SHADOW,
    SOLVER,
    chain,
    handed_in,
    in_shadow,
    off_surface,
    read,
    resized,
    with_number,
)
from raytwin.explain.pixel_sample import PixelSample
from raytwin.explain.predict import Array, Pipeline, slip
from raytwin.scene import Scene

NAMED = (
    (pi, "π"), (1 / pi, "1/π"), (2.0, "2"), (0.5, "1/2"), (2 * pi, "2π"), (1 / (2 * pi), "1/(2π)"), (4.0, "4"),
    (0.25, "1/4"), (pi**2, "π²"), (1 / pi**2, "1/π²"), (255.0, "255"), (1 / 255, "1/255"),
)  # fmt: skip
WRITTEN = tuple(
    (ratio, name)
    for name, value in (("3.14", 3.14), ("3.1415", 3.1415), ("22/7", 22 / 7))
    for ratio in (pi / value, value / pi)
)
"""Factors of light that a rounded π leaves, as divisor or factor."""
MAX_STEPS_AT_FIRST = 100
"""Largest first step of a fit, in units of `step`."""
SAME = 1e-5
"""Factors that differ from 1 by less are ignored: single precision cannot show them."""


@dataclass(frozen=True, eq=False)
class ParametricFault:
    """`slips`: of the textbook, in whose text `p` is the parameters; `start`: those that change nothing; `step`: small.

    `sentence(p, scenes)`: what a user reads of parameters that were fitted to these scenes; `tries`: other places to
    begin at. `possible(p)`: whether the parameters mean anything; a fit that leaves them is dropped. `number(p)`: what
    the text takes for `p`.
    """

    name: str
    stage: str
    start: tuple[float, ...]
    step: float
    slips: Pipeline
    sentence: Callable[[Any, Sequence[Scene]], str]
    tries: tuple[tuple[float, ...], ...] = ()
    possible: Callable[[Any], bool] = lambda p: True
    number: Callable[[Any], Any] = np.array

    def make(self, p: Sequence[float]) -> Pipeline:
        """The change with these parameters."""
        return with_number("p", self.number(p), self.slips)


def factor(k: float) -> str:
    """3.142 = π."""
    named = next((f" = {name}" for value, name in NAMED if abs(k / value - 1) < 2e-3), "")
    return f"{k:.4g}{named if 'π' in named or '/' in named else ''}"


def bright(k: float) -> str:
    """Say in words how light that is k times the correct light differs from it."""
    if abs(k - 1) < 2e-3:
        written = next((f" (π written as {name})" for value, name in WRITTEN if abs(k - value) < 2e-5), "")
        return f"{100 * abs(k - 1):.2g} % too {'bright' if k > 1 else 'dark'}{written}"
    if abs(k) < 1e-3 or k < 0:
        return "gone" if abs(k) < 1e-3 else f"negative: multiplied by {k:.4g}"
    return f"{factor(k)} times too bright" if k > 1 else f"too dark by a factor of {factor(1 / k)}"


def _turned(p: Sequence[float]) -> Array:
    """The matrix of the rotation vector p, radians."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(p).as_matrix())


def _degrees(p: Sequence[float]) -> float:
    return float(np.degrees(np.linalg.norm(p)))


def _sun_moved(p: Sequence[float], scenes: Sequence[Scene]) -> str:
    """State the angle between the correct and the fitted direction. A turn about that direction has no effect."""
    turn, suns = _turned(p), [np.array(scene.sun.to_light) for scene in scenes]
    angle = max(float(np.arctan2(np.linalg.norm(np.cross(to, turn @ to)), to @ turn @ to)) for to in suns)
    most = "up to " if len({scene.sun.to_light for scene in scenes}) > 1 else ""
    return f"the sun's direction is off by {most}{np.degrees(angle):.3g} degrees"


def _sun_and_sky(p: Sequence[float], scenes: Sequence[Scene]) -> str:
    parts = [
        f"the {name}'s part is {bright(k)}" for name, k in zip(("sun", "sky"), p, strict=True) if abs(k - 1) > SAME
    ]
    return ", and ".join(parts)


SUN, SKY = slip("shade", ("* irradiance", "* (p[0] * irradiance)")), slip("shade", ("* sky", "* (p[-1] * sky)"))
FAMILIES = (
    ParametricFault("shifted", CAMERA, (0.0, 0.0), 0.1, slip("pixel", ("return u, v", "return u + p[0], v + p[1]")),
        lambda p, _: f"the image is shifted by ({-p[0]:.3g}, {-p[1]:.3g}) pixels (right, down): (0, 0) is the "
                     "centre of the top-left pixel"),
    ParametricFault("focal-lengths", CAMERA, (1.0, 1.0), 0.003,
        read('"K": scene["K"] * [[p[0], p[0], 1], [1, p[1], 1], [1, 1, 1]]'),
        lambda p, _: f"the focal lengths are off: fx by a factor of {p[0]:.4g}, fy by {p[1]:.4g}"),
    ParametricFault("camera-turned", CAMERA, (0.0, 0.0, 0.0), 0.001,
        read('"R_cam_board": p.T @ scene["R_cam_board"], "t_cam_board": p.T @ scene["t_cam_board"]'),
        lambda p, _: f"the camera is turned by {_degrees(p):.3g} degrees: check R", number=_turned),
    ParametricFault("camera-moved", CAMERA, (0.0, 0.0, 0.0), 0.001,
        read('"t_cam_board": scene["t_cam_board"] - scene["R_cam_board"] @ p'),
        lambda p, _: "the eye stands off by ({:.3g}, {:.3g}, {:.3g}) m in the board's frame: it is "
                     "-Rᵀ t".format(*p)),
    ParametricFault("distortion-scaled", CAMERA, (1.0,), 0.02, read('"dist": p * scene["dist"]'),
        lambda p, _: f"the distortion is {p[0]:.3g} times as strong as it should be"),
    ParametricFault("radius-scaled", SOLVER, (1.0,), 0.005, resized('abs(p[0]) * x["radius"] + 1e-12'),
        lambda p, _: f"the spheres are {p[0]:.4g} times as large as they should be", ((0.9,), (1.1,))),
    ParametricFault("light-turned", LIGHT, (0.0, 0.0, 0.0), 0.01,
        read('"sun": scene["sun"] | {"to_light": p @ scene["sun"]["to_light"]}'),
        _sun_moved, ((0.6, 0.0, 0.0), (0.0, 0.6, 0.0), (-0.6, 0.0, 0.0), (0.0, -0.6, 0.0)), number=_turned),
    ParametricFault("sun-scaled", LIGHT, (1.0,), 0.1, SUN, lambda p, _: f"the sun's part is {bright(p[0])}"),
    ParametricFault("sky-scaled", LIGHT, (1.0,), 0.1, SKY, lambda p, _: f"the sky's part is {bright(p[0])}"),
    ParametricFault("surfaces-scaled", LIGHT, (1.0,), 0.1, chain(SUN, SKY),
        lambda p, _: f"all that is lit is {bright(p[0])}, the background is correct"),
    ParametricFault("sun-and-sky-scaled", LIGHT, (1.0, 1.0), 0.1, chain(SUN, SKY), _sun_and_sky),
    ParametricFault("sun-colour", LIGHT, (1.0, 1.0, 1.0), 0.1, slip("shade", ("* irradiance", "* (p * irradiance)")),
        lambda p, _: "the sun's part is off by the factors {:.4g}, {:.4g}, {:.4g} (red, green, blue)".format(*p)),
    ParametricFault("shadow-strength", SHADOW, (0.0,), 0.1, in_shadow("dark + p * (lit - dark)"),
        lambda p, _: f"shadows let {100 * p[0]:.3g} % of the sun through: there is none where it is hidden"),
    ParametricFault("shadow-dims", SHADOW, (1.0,), 0.1, in_shadow("p * lit"),
        lambda p, _: f"shadows scale the whole light by {p[0]:.3g}: they take away the sun's part alone"),
    ParametricFault("image-scaled", OUTPUT, (1.0,), 0.1, handed_in("p * picture"),
        lambda p, _: f"the whole image, background too, is {bright(p[0])}"),
    ParametricFault("offset", OUTPUT, (0.0,), 0.01, handed_in("p + picture"),
        lambda p, _: f"{p[0]:.4g} is added to every value"),
    ParametricFault("power", OUTPUT, (1.0,), 0.05, handed_in("np.maximum(picture, 0) ** p"),
        lambda p, _: f"the values are raised to the power {p[0]:.3g}: gamma, where linear radiance is wanted",
        ((0.5,), (2.0,)), possible=lambda p: 0.2 < p[0] < 5),
    ParametricFault("background-scaled", OUTPUT, (1.0,), 0.1, slip("radiance", ("np.tile(sky,", "np.tile(p * sky,")),
        lambda p, _: f"the background is {bright(p[0])}: a ray that meets nothing shows the sky's radiance"),
    ParametricFault("background-constant", OUTPUT, (0.0, 0.0, 0.0), 0.05,
        slip("radiance", ("np.tile(sky,", "np.tile(p,")),
        lambda p, _: "the background is ({:.3g}, {:.3g}, {:.3g}): a ray that meets nothing shows the sky's "
                     "radiance".format(*p)),
    ParametricFault("shadow-start", SHADOW, (-6.0,), 0.2, off_surface("10**p[0]"),
        lambda p, _: f"the shadow ray starts too far from the surface ({10 ** p[0]:.2g} m): shadows near what "
                     "casts them are lost", ((-3.0,), (-2.3,), (-1.7,), (-1.0,), (-0.3,))),
    ParametricFault("shadow-reach", SHADOW, (3.0,), 0.1, chain(off_surface("1e-7"), NEAR),
        lambda p, _: f"only what is nearer than {10 ** p[0]:.2g} m casts a shadow: nothing bounds the way to the "
                     "sun", ((-0.7,), (-1.2,), (0.0,))),
)  # fmt: skip
"""Of two rows that fit equally well, the one with fewer parameters is preferred."""


def nearer(
    family: ParametricFault, samples: Sequence[PixelSample], start: tuple[float, ...], rounds: int = 9
) -> tuple[tuple[float, ...], float]:
    """Parameters that explain more, and their cost: least squares whose tolerance shrinks from round to round.

    It counts in units of MAX_STEPS_AT_FIRST small steps, so that one of them is a difference of its inverse.
    """
    from scipy.optimize import least_squares

    weights = np.concatenate([np.repeat(s.weight / len(samples), 3) for s in samples])

    def at(q: Array) -> tuple[float, ...]:
        return tuple((start + MAX_STEPS_AT_FIRST * family.step * (q - 1)).tolist())

    def off(q: Array) -> Array:
        steps = family.make(at(q))
        errors = [np.clip((s.shown - s.predict(steps)) / s.tau, -1e8, 1e8).ravel() for s in samples]
        return np.nan_to_num(np.concatenate(errors))

    def loss(z: Array) -> Array:
        return weights * np.stack([np.log1p(z), 1 / (1 + z), -1 / (1 + z) ** 2])

    q, cost = np.ones(len(start)), np.inf
    large = np.abs(off(q))
    width = 2 * float(np.quantile(large[large > 1], 0.9)) if (large > 1).any() else 1.0
    for k in range(rounds):
        step = (1 if width > 1 else 0.1) / MAX_STEPS_AT_FIRST
        found = least_squares(off, q, loss=loss, f_scale=width, diff_step=step, max_nfev=3 if rounds == 1 else 4)
        q, cost = found.x, 2 * found.cost / width**2
        if width == 1 and k > 0:
            break
        width = max(width / 4, 1.0)
    return at(q), cost
