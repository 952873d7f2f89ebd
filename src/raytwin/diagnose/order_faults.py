"""Mistakes in which of several objects is seen."""

from collections.abc import Iterator
from itertools import product

from raytwin.diagnose.changes import (
    ALONG_Z,
    ORDER,
    POINT,
    Thing,
    before_shading,
    by_key,
    chain,
    gone,
    is_ball,
    offset_by,
    others_hide,
    row,
    shading_normals,
    unit,
)
from raytwin.diagnose.predict import Pipeline, SceneDict, replaced, slip

AWAY = 'np.linalg.norm([x["center"] - eye for x in things], axis=-1)[:, None]'
RADII = 'np.array([[x.get("radius", 0.0)] for x in things])'
HEIGHTS = 'np.array([[x["center"][2]] for x in things])'
FIRST, LAST = "one = met.argmax(axis=0)", "one = len(met) - 1 - met[::-1].argmax(axis=0)"


def _one_of_kind(kind: str, which: str) -> Pipeline:
    """See the last or the first hit of one kind, or something of the other kind before it."""
    first = f"met = np.isfinite(every_t) & {kind}\n    {which}"
    return by_key(f"np.where({kind} & (number != one), np.inf, every_t)", first=first)[0]


def _all_written(kind: str, albedo: bool, normal: bool, there: bool = True) -> Pipeline:
    """Write the albedo or normal of the last object of this kind that the eye's ray meets.

    `there`: the normal where it is met itself, not at the point that is seen.
    """
    lines = [
        f"d = {unit('points - eye')}",
        "every_t = intersect_all(np.tile(eye, (len(points), 1)), d, things)",
        "ball = np.array([['radius' in x] for x in things])",
        f"there = np.isfinite(every_t) & ({kind})",
        "last = np.where(there.any(axis=0), len(there) - 1 - there[::-1].argmax(axis=0), which)",
    ]
    where = "eye + every_t[last, np.arange(len(last))][:, None] * d" if there else "points"
    paint = ["albedo = np.array([x['albedo'] for x in things])[last]"] if albedo else []
    if not normal:
        return before_shading(*lines, *paint)
    return shading_normals(f"normals_at({where}, last, eye, things)", *lines, *paint)


def less(kinds: tuple[bool, ...], lost: slice) -> tuple[Pipeline, Pipeline]:
    """Lose some spheres (True), planes (False) or both: out of reach, so that ids stay; or for the eye alone."""

    def which(things: list[Thing]) -> list[int]:
        return [k for k, x in enumerate(things) if is_ball(x) in kinds][lost]

    def all_but(scene: SceneDict) -> SceneDict:
        out = which(scene["things"])
        return scene | {"things": [gone(x) if k in out else x for k, x in enumerate(scene["things"])]}

    unseen = by_key("np.where(np.isin(number, lost(things)), np.inf, every_t)")[0]
    return (("things", all_but),), chain(unseen, replaced(lost=lambda _: which))


def all_at_last(*kinds: bool) -> Pipeline:
    """Put the last sphere, or plane, in the place of all; the first one's colour is seen on it."""

    def merged(scene: SceneDict) -> SceneDict:
        things = made = list(scene["things"])
        for kind in kinds:
            alike = [k for k, x in enumerate(things) if is_ball(x) == kind]
            made = [gone(x) if k in alike[1:] else x for k, x in enumerate(made)]
            for k in alike[:1]:
                made[k] = things[alike[-1]] | {"albedo": things[k]["albedo"]}
        return scene | {"things": made}

    return (("things", merged),)


def _rounded(to: str, of_unit: bool, t: str) -> str:
    """A rounded t, of rays that are `unit` or have z = 1."""
    return to.format(t if of_unit else f"{t} * {ALONG_Z}")


def _at_rounded(to: str, of_unit: bool) -> Pipeline:
    at = _rounded(to, of_unit, "t") + ("" if of_unit else f" / {ALONG_Z}")
    return slip("met", (POINT, POINT.replace("t[", f"np.maximum({at}, 1e-6)[")))  # off the eye: on some side


TRUE_POINTS = slip("normals_at", ("    normals = np.zeros", f"""    d = {unit("points - eye")}
    t = intersect_all(np.tile(eye, (len(points), 1)), d, things)[which, np.arange(len(which))]
    points = eye + np.where(np.isfinite(t), t, 0)[:, None] * d
    normals = np.zeros"""))  # fmt: skip
"""Normals that are taken where the ray meets the object, whatever point is kept."""


def rounded_t(to: str) -> Iterator[Pipeline]:
    """t is kept as to(t): to be compared alone, for where shadow rays start, too, or even for normals."""
    for of_unit in (True, False):
        order = by_key(_rounded(to, of_unit, "every_t"))[0]
        yield order
        for test in (offset_by(1e-6), others_hide):
            point = chain(order, _at_rounded(to, of_unit), test)
            yield from (chain(point, TRUE_POINTS), point)


ORDERS = (
    row("last-wins", ORDER,
        "no depth test: of all objects on a ray, the last one tested is shown; keep the one of the smallest t",
        *by_key("-number + 0 * every_t", "ball * 1e6 * -1 - number + 0 * every_t")),
    row("first-wins", ORDER,
        "no depth test: of all objects on a ray, the first one tested is shown; keep the one of the smallest t",
        *by_key("number + 0 * every_t", "ball * 1e6 + number + 0 * every_t"),
        *(_one_of_kind(kind, FIRST) for kind in ("ball", "~ball"))),
    row("painter", ORDER,
        "objects are drawn by the distance of their centres (painter's order): compare t on each ray",
        *by_key(f"{AWAY} + 0 * every_t", f"np.where(ball, {AWAY}, 1e6 + every_t)", f"{AWAY} - {RADII} + 0 * every_t",
                f"np.where(ball, -{HEIGHTS}, 1e6 + every_t)")),
    row("spheres-on-top", ORDER,
        "spheres always hide planes: compare the t of all objects, planes and spheres alike",
        *by_key("every_t + 1e6 * ~ball", "np.where(ball, -1e6 - number, every_t)")),
    row("planes-on-top", ORDER,
        "planes always hide spheres: compare the t of all objects, planes and spheres alike",
        *by_key("every_t + 1e6 * ball", "np.where(~ball, -1e6 - number, every_t)")),
    *(row(f"last-{name}-wins", ORDER,
          f"among {name}s the last one hit is shown, not the nearest: compare t between them too",
          _one_of_kind(kind, LAST))
      for name, kind in (("sphere", "ball"), ("plane", "~ball"))),
    row("farthest-wins", ORDER, "the farthest object on a ray is shown: keep the one of the smallest t",
        *by_key("-every_t")),
    row("t-of-other-rays", ORDER,
        "t of spheres and of planes is compared across rays of different length: t is a distance only along unit rays",
        *by_key(f"every_t * np.where(ball, 1, {ALONG_Z})", f"every_t * np.where(ball, {ALONG_Z}, 1)")),
    row("depth-from-elsewhere", ORDER,
        "depth is measured from the board's origin, not from the eye: keep the smallest t on each ray",
        *by_key("np.linalg.norm(origins + np.nan_to_num(every_t, posinf=0)[..., None] * directions, axis=-1)")),
    row("hidden-one-written", ORDER,
        "albedo or normals are written for every object that a ray meets, not only for the nearest: use the mask of "
        "the closer t for them, too",
        *(_all_written(kind, albedo, normal) for albedo, normal in ((True, False), (False, True), (True, True))
          for kind in ("True", "~ball", "ball")),
        *(chain(*test, _all_written("True", True, True, there=False)) for test in ((), (others_hide,)))),
    row("t-rounded", ORDER,
        "t is kept in whole numbers or few digits (np.full(n, 10000) makes an array of integers): objects are compared "
        "by it, or points are made of it; keep it in float64, np.full(n, np.inf)",
        *rounded_t("np.floor({})"), *by_key(*(_rounded(to, of_unit, "every_t")
                                for to in ("np.rint({})", "np.round({}, 1)") for of_unit in (True, False))),
        *(chain(_at_rounded(f"np.round({{}}, {k})", True), others_hide) for k in (0, 1, 2))),
    row("one-sphere", ORDER,
        "only one of the spheres is there, in its own colour or in another's: test every ray against each of them "
        "(functions that are made in a loop see its variable as it is in the end: the last sphere)",
        *less((True,), slice(1, None)), *less((True,), slice(None, -1)),
        all_at_last(True), all_at_last(True, False)),
    row("object-missing", ORDER, "one object is missing: the loop ends too early or begins too late, test them all",
        *(way for kind, one in product(((True,), (False,), (True, False)), (slice(1), slice(-1, None)))
          for way in less(kind, one))),
    row("one-plane", ORDER,
        "only one of the planes is there, in its own colour or in another's: test every ray against each of them "
        "(functions that are made in a loop see its variable as it is in the end: the last plane)",
        *less((False,), slice(1, None)), *less((False,), slice(None, -1)), all_at_last(False)),
)  # fmt: skip
