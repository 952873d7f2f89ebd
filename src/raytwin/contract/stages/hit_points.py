"""Where each pixel's ray first meets a sphere: eye + t d, in the board's frame."""

from typing import Any

import numpy as np

from raytwin.contract.composed_tracer import Renderer, SceneDict, changed
from raytwin.contract.stage import Arrays, Case, Function, Stage, Variant
from raytwin.contract.stages import back_project, intersect_sphere
from raytwin.contract.stages.stage_scenes import AROUND, LENS, draw_scene


def cases(seed: int) -> list[Case]:
    """Pictures of 26 x 18 pixels; planes are given and stand in nobody's way."""
    rng = np.random.default_rng(seed)
    drawn = (
        ("one sphere", draw_scene(rng, ((0.3, 0.2, 0.6, 0.6),), 0, "lambert")),
        ("a sphere that fills the picture", draw_scene(rng, (), 0, "lambert")),
        (
            "three spheres",
            draw_scene(rng, ((0.4, 0.4, 0.7, 0.7), (-0.6, -0.5, 1.3, 0.3), (-0.3, 0.0, 0.9, 0.4)), 1, "lambert"),
        ),
        ("spheres on all sides", draw_scene(rng, AROUND, 0, "lambert")),
        ("spheres on all sides, through a lens", draw_scene(rng, AROUND, 0, "lambert", LENS)),
    )
    return [Case(shows, (scene,), (Renderer().hit_points(scene),)) for shows, scene in drawn]


def errors(expected: Arrays, got: Arrays) -> np.ndarray:
    """The distance of each point from where it should be, metres; infinity where a hit is missed or made up."""
    right, p = expected[0], got[0]
    missed = np.isnan(right).all(axis=-1)
    off = np.where(missed, 0.0, np.linalg.norm(p - right, axis=-1))
    # NaN in one coordinate is as much a miss as in all three.
    return np.where(np.isnan(p).any(axis=-1) != missed, np.inf, off)


def hint(expected: Arrays, got: Arrays) -> str:
    if len(got) != 1:
        return "return the points alone"
    h, w, _ = expected[0].shape
    return {
        (w, h, 3): "rows and columns are swapped: the result is indexed [v, u]",
        (h * w, 3): "reshape to (height, width, 3)",
        (h, w): "distances are returned: points are wanted, eye + t d",
    }.get(got[0].shape, "only some pixels' points are returned: NaN stands for none" if got[0].ndim == 2 else "")


# ------------------------------------------------------------------------------------------ typical mistakes


def _pose(change: Any) -> Any:
    """`view` with R and t changed."""

    def changed_view(f: Function) -> Function:
        def view(scene: SceneDict, rays: Any) -> tuple[Any, Any]:
            R, t = change(scene["R_cam_board"], scene["t_cam_board"])
            return f(scene | {"R_cam_board": R, "t_cam_board": t}, rays)

        return view

    return changed("view", changed_view)


def _view(eye_and_rays: Any) -> Any:
    """`view` as eye_and_rays(R, t, rays)."""
    return changed("view", lambda f: lambda s, rays: eye_and_rays(s["R_cam_board"], s["t_cam_board"], rays))


def _last(ts: Any) -> Any:
    """The last object that is met, in the order of the scene."""
    hit = np.isfinite(ts)
    return np.where(hit.any(axis=0), len(ts) - 1 - hit[::-1].argmax(axis=0), -1)


def _first(ts: Any) -> Any:
    hit = np.isfinite(ts)
    return np.where(hit.any(axis=0), hit.argmax(axis=0), -1)


def _farthest(ts: Any) -> Any:
    hit = np.where(np.isfinite(ts), ts, -np.inf)
    return np.where(np.isfinite(hit.max(axis=0)), hit.argmax(axis=0), -1)


def _t_of_unit_rays(f: Function) -> Function:
    """t solved for unit rays, then applied to (x, y, 1): the paper's own."""
    return lambda o, d, center, radius: f(o, d / np.linalg.norm(d, axis=-1, keepdims=True), center, radius)


PARTS = {"back_project": "rays", "intersect_sphere": "t of spheres", "shade": "shading"}
"""What a stage makes, in a tracer that has no function of that name."""


def lifted(part: str, variants: tuple[Variant, ...], *without: str) -> tuple[Variant, ...]:
    """A stage's own mistakes, as they show in a picture."""
    return tuple(
        Variant(v.name, f"{PARTS[part]}: {v.sentence}", changed(part, v.change))
        for v in variants
        if v.name not in without
    )


def _t_on_long_rays(f: Any) -> Function:
    return changed("intersect_sphere", _t_of_unit_rays)(changed("back_project", _long)(f))


def _long(f: Function) -> Function:
    return lambda *args: (lambda rays: rays / rays[..., 2:])(f(*args))


LONG = "not unit"
"""Of no effect where t counts in the directions' lengths."""

GEOMETRY = (
    Variant("transposed R", "R is transposed: p_cam = R @ p_board + t, so a ray d of the camera is R.T @ d in the "
            "board's "
            "frame", _pose(lambda R, t: (R.T, t))),
    Variant("rays not turned", "the rays are not turned into the board's frame: R.T @ d", _view(lambda R, t,
            d: (-R.T @ t, d))),
    Variant("inverse pose for rays", "the rays are turned by R, which goes from the board to the camera: R.T @ d",
            _view(lambda R, t, d: (-R.T @ t, d @ R.T))),
    Variant("eye at t", "the eye is taken to be t: it is -R.T @ t", _view(lambda R, t, d: (t, d @ R))),
    Variant("eye at -t", "the eye is taken to be -t: it is -R.T @ t", _view(lambda R, t, d: (-t, d @ R))),
    Variant("eye's sign", "the eye has the wrong sign: it is -R.T @ t", _view(lambda R, t, d: (R.T @ t, d @ R))),
    Variant("eye with R", "the eye is taken to be -R @ t: it is -R.T @ t", _view(lambda R, t, d: (-R @ t, d @ R))),
    Variant("eye at the origin", "the rays start at the board's origin: they start at the eye, -R.T @ t",
            _view(lambda R, t, d: (0 * t, d @ R))),
    Variant("inverse pose", "the pose is taken for its inverse: the rays start at t and are turned by R. It is the "
            "other way round: p_cam = R @ p_board + t", _view(lambda R, t, d: (t, d @ R.T))),
    Variant("t of unit rays", "t was solved for unit rays and then applied to (x, y, 1): use the same ray for both",
            _t_on_long_rays),
)  # fmt: skip

ORDER = (
    Variant("no depth test", "the last sphere met wins, whatever its distance: the smallest t is wanted",
            changed("nearest", lambda f: _last)),
    Variant("first in the list", "the first sphere of the list wins, whatever its distance: the smallest t is wanted",
            changed("nearest", lambda f: _first)),
    Variant("farthest", "the farthest sphere wins: the smallest t is wanted", changed("nearest", lambda f: _farthest)),
)  # fmt: skip

VARIANTS = (
    *lifted("back_project", back_project.VARIANTS, LONG),
    *lifted("intersect_sphere", intersect_sphere.VARIANTS),
    *GEOMETRY,
    *ORDER,
    Variant("camera's frame", "the points are in the camera's frame: take them to the board's, R.T @ (p - t)",
            changed("finish", lambda f: lambda s, p: p @ s["R_cam_board"].T + s["t_cam_board"])),
    Variant("distances from the eye", "eye is missing: the points are t d, which is eye + t d",
            changed("finish", lambda f: lambda s, p: p + s["R_cam_board"].T @ s["t_cam_board"])),
    Variant("pixels of 0", "pixels that meet nothing are 0: NaN is wanted",
            changed("finish", lambda f: lambda s, p: np.nan_to_num(p, nan=0.0))),
    Variant("misses are the eye's", "pixels that meet nothing hold the eye: NaN is wanted",
            changed("finish", lambda f: lambda s, p: np.where(np.isnan(p), -s["R_cam_board"].T @ s["t_cam_board"], p))),
    Variant("misses are infinite", "pixels that meet nothing are infinite: NaN is wanted",
            changed("finish", lambda f: lambda s, p: np.nan_to_num(p, nan=np.inf))),
    Variant("points about the sphere", "the points are counted from a sphere's centre: the board's frame is wanted",
            changed("finish", lambda f: lambda s, p: p - s["spheres"][0]["center"])),
)  # fmt: skip

STAGE = Stage(Renderer().hit_points, ("points",), cases, errors, 1e-4, "m", VARIANTS, hint=hint)
