"""Mistakes in shadows."""

from raytwin.diagnose.changes import (
    ASKED,
    BALLS,
    NU,
    NV,
    SHADOW,
    chain,
    in_shadow_test,
    inside,
    mixed,
    offset_by,
    others_hide,
    reaching,
    row,
    shadow,
    towards,
    where_cast,
    within,
)
from raytwin.diagnose.predict import Pipeline, slip


def _counted(share: str) -> Pipeline:
    """The share of the light that n objects on the way let through."""
    return mixed(
        't = intersect_all(points, np.tile(sun["to_light"], (len(points), 1)), things)',
        "n = (np.isfinite(t) & (which != np.arange(len(t))[:, None])).sum(axis=0)[:, None]",
        f'share, visible = ({share}) if scene["rung"] == "shadow" else 1.0, visible | True',
        "lit = dark + (lit - dark) * share",
    )


BLOCKS, TO_SUN = (
    "visible = visible & (own | ~np.isfinite(t[k]))",
    ("t = intersect_all(points, np.tile(to_light, (len(points), 1)), things)"),
)
ON_BALL = 'np.array(["radius" in x for x in things])[which]'
NUMBERS = '[["radius" in y for y in things[:i]].count("radius" in x) for i, x in enumerate(things)]'
"""The number that each thing has among those of its kind."""


def _free(*tests: str) -> tuple[Pipeline, ...]:
    """What lets the light through: functions of k, thing, which and things."""
    return shadow(*(f"(own | => (own | ({test}) |" for test in tests))


def _aside(direction: str) -> Pipeline:
    """Another direction to the light, for shadows alone."""
    return chain(others_hide, slip("radiance", (ASKED, ASKED.replace('sun["to_light"]', direction))))


SHADOWS = (
    row("no-shadow", SHADOW, "there are no cast shadows: send a ray from each point to the sun",
        *shadow("return visible => return visible | True")),
    row("shadows-always", SHADOW,
        "shadows are cast with the rung \"lambert\", too: there nothing casts any, only with \"shadow\"",
        slip("radiance", ('scene["rung"] == "shadow"', "True"))),
    row("all-in-shadow", SHADOW,
        "every surface is in its own shadow: the shadow ray goes away from the sun (it goes along to_light, not "
        "-to_light), or starts inside the object (move it a little along +n), or t <= 0 counts as a hit",
        *shadow(*(f"return visible => return visible & {on}" for on in ("False", f"~{ON_BALL}", ON_BALL)))),
    row("shadow-offset", SHADOW,
        "the shadow ray starts too far from the surface: shadows near what casts them are lost; 1e-4 of the scene is "
        "enough",
        *(offset_by(eps, way) for way in (False, True) for eps in (3e-3, 1e-2, 2e-2, 5e-2))),
    row("shadow-both-ways", SHADOW,
        "what lies on the far side of the surface, away from the sun, casts shadows too: keep t > 0 alone",
        *shadow(*(f"{TO_SUN} => {TO_SUN}\n    back = {TO_SUN[4:].replace('to_light', '-to_light')}\n"
                  f"    t = np.minimum(t, np.where({kind}, back, np.inf)){own}" for kind, own in (
                      ("True", ""), (BALLS, ""), (f"~{BALLS}", ""),
                      (BALLS, ' ;; (own | => ((own & ("radius" not in thing)) |'))))),
    row("shadow-reversed", SHADOW, "shadow rays go away from the sun: they go along to_light",
        *shadow("np.tile(to_light => np.tile(-to_light")),
    row("shadow-light-turned", SHADOW,
        "shadows fall by another direction than the light: the shadow ray goes along the same to_light, in the same "
        "frame",
        *(_aside(f'scene["R_cam_board"]{t} @ sun["to_light"]') for t in ("", ".T")),
        *shadow(*(f"np.tile(to_light => np.tile(to_light * {signs}" for signs in ([1, 1, -1], [-1, -1, 1])))),
    row("shadow-to-eye", SHADOW,
        "shadow rays go to the eye, away from it, or along the normal: they go to the sun, along to_light",
        *map(towards, ("eye - points", "points - eye", "normals"))),
    row("shadow-to-place", SHADOW,
        "shadow rays go to to_light as if it were a point: it is a direction, the same for every surface",
        *map(towards, ("to_light - points", "to_light + eye - points"))),
    row("shadow-bounded", SHADOW,
        "only near objects cast shadows: nothing bounds the way to the sun",
        *(within(limit) for limit in (0.2, 0.1, 0.25, 0.3, 0.5, 1.0))),
    row("spheres-receive-none", SHADOW, "no shadow falls on spheres: test every surface, whatever its kind",
        *_free(ON_BALL)),
    row("planes-receive-none", SHADOW, "no shadow falls on planes: test every surface, whatever its kind",
        *_free(f"~{ON_BALL}")),
    row("shadow-own-kind", SHADOW,
        "a surface's own kind is left out of its shadow test: only its own object may be (spheres shadow spheres, "
        "planes planes)",
        *_free(f'("radius" in thing) & {ON_BALL}', f'("radius" not in thing) & ~{ON_BALL}',
               f'("radius" in thing) == {ON_BALL}')),
    row("own-number", SHADOW,
        "sphere i casts no shadow on plane i, nor plane i on sphere i: leave out the surface's own object, not all "
        "that have its number in their list",
        *shadow(f"own = which == k => own = np.array({NUMBERS})[which] == {NUMBERS}[k]")),
    row("other-size-in-shadow", SHADOW,
        "rectangles have another size in the shadow test than the eye sees: half_u and half_v are changed in place "
        "(u /= |u|) or used otherwise there; write u = half_u / |half_u|",
        *map(in_shadow_test, inside("np.isfinite(t)", reaching(NU, NV), *(
            reaching(f"{k} * (half_u @ half_u)", f"{k} * (half_v @ half_v)") for k in (0.5, 2.0))))),
    row("planes-cast-none", SHADOW, "planes cast no shadows: test shadow rays against planes too",
        *_free('"radius" not in thing')),
    row("spheres-cast-none", SHADOW, "spheres cast no shadows: test shadow rays against spheres too",
        *_free('"radius" in thing')),
    row("one-casts", SHADOW,
        "only one object casts shadows: the answer of each test overwrites the one before; any hit hides the sun",
        *_free("k != 0", f"k != {BALLS}.sum() - 1", "k != len(things) - 1", *(
            f'("radius" in thing) == {ball} and {NUMBERS}[k] != {end}' for ball, ends in (
                (True, ("0", f"{BALLS}.sum() - 1")), (False, ("0", f"(~{BALLS}).sum() - 1"))) for end in ends)),
        *shadow(*(f"{BLOCKS} => visible = np.where(own, visible, ~np.isfinite(t[k])){more}" for more in (
            "", " ;; enumerate(things) => reversed([*enumerate(things)])")))),
    row("half-of-pairs", SHADOW,
        "objects are tested for shadows only against those that come later in the list, or earlier: test against all "
        "but the point's own",
        *_free("k < which", "k > which")),
    row("whole-object-in-shadow", SHADOW,
        "one point in shadow darkens its whole object: np.any over all points instead of over the objects (axis=0), "
        "each point has a shadow ray of its own",
        *shadow("return visible => return np.array([visible[which == w].all() for w in which])")),
    row("one-casts-not", SHADOW, "one of the spheres casts no shadow: test shadow rays against all of them",
        *_free("k == 0", f"k == {BALLS}.sum() - 1")),
    row("shadow-from-elsewhere", SHADOW,
        "shadow rays start in the wrong place: they start at the point that the eye's ray met",
        *shadow('intersect_all(points => intersect_all(np.array([x["center"] for x in things])[which]'),
        *shadow(*(f"intersect_all(points => intersect_all({start}{own}" for own in ("", " ;; (own |  => (")
                  for start in ("0 * points", "eye + 0 * points", "points - eye")))),
    row("shadow-counts", SHADOW,
        "what several objects hide is darker than what one hides: each hit takes light away once more, one is enough",
        *(_counted(share) for share in ("1.0 - n", "0.5**n"))),
    row("shadow-inverted", SHADOW, "light and shadow are swapped: V is 1 where the way to the sun is free",
        *shadow("return visible => return ~visible")),
    row("shadow-colour", SHADOW,
        "shadowed points have a colour of their own: there as elsewhere the sky gives albedo Lₛ, the sun alone is gone",
        *(way(mixed(f"dark = {dark}")) for way in (chain, where_cast) for dark in (
            "dark / np.maximum(albedo, 1e-9)", "dark / np.maximum(sky, 1e-9)",
            *(f"{k} + 0 * dark" for k in (0.05, 0.1, 0.2))))),
    row("shadow-by-pi", SHADOW,
        "the sky's part is divided by π in shadow: there as elsewhere it is albedo Lₛ; albedo /= π inside shade "
        "changes the array that it was given, so that the next call divides once more",
        *(way(mixed("dark = dark / np.pi")) for way in (chain, where_cast))),
    row("shadow-on-sky", SHADOW,
        "shadows take away the sky's light and leave the sun's: it is the other way round",
        *(way(mixed("dark = lit - dark")) for way in (chain, where_cast))),
    row("shadow-dims-all", SHADOW, "shadows scale the whole light: they take away the sun's part alone",
        *(way(mixed(f"dark = {k} * lit")) for way in (chain, where_cast) for k in (0.5, 0.3, 0.2))),
)  # fmt: skip
