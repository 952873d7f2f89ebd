"""The whole tracer: a ray for every pixel, the nearest object for every ray, its light for every hit."""

from collections.abc import Callable
from typing import Any

import numpy as np

from raytwin.contract.composed_tracer import Met, Renderer, SceneDict, changed
from raytwin.contract.stage import Arrays, Case, Function, Stage, Variant
from raytwin.contract.stages import back_project, intersect_sphere, shade
from raytwin.contract.stages.hit_points import GEOMETRY, LONG, ORDER, lifted
from raytwin.contract.stages.stage_scenes import AROUND, LENS, draw_scene


def cases(seed: int) -> list[Case]:
    """Pictures of 26 x 18 pixels, from one sphere to shadows of all on all."""
    rng = np.random.default_rng(seed)
    front, back, high = (-0.6, -0.5, 1.3, 0.3), (0.4, 0.4, 0.7, 0.7), (0.87, -0.26, 1.6, 0.4)
    drawn = (
        ("a sphere that fills the picture", draw_scene(rng, (), 0, "lambert")),
        ("three spheres on a floor, no shadows", draw_scene(rng, (back, front, high), 1, "lambert")),
        ("three spheres on a floor, with shadows", draw_scene(rng, (front, back, high), 1, "shadow")),
        ("spheres, a floor and a wall, with shadows", draw_scene(rng, (back, high, front), 2, "shadow")),
        ("spheres on all sides, through a lens", draw_scene(rng, AROUND, 2, "lambert", LENS)),
    )
    return [Case(shows, (scene,), (Renderer().render(scene),)) for shows, scene in drawn]


def errors(expected: Arrays, got: Arrays) -> np.ndarray:
    """|L - L₀| of each pixel's worst channel, by the largest L₀; infinity for NaN."""
    off = np.abs(got[0] - expected[0]).max(axis=-1) / expected[0].max()
    return np.where(np.isnan(off), np.inf, off)


def hint(expected: Arrays, got: Arrays) -> str:
    if len(got) != 1:
        return "return the picture alone"
    h, w, _ = expected[0].shape
    return {
        (w, h, 3): "rows and columns are swapped: the picture is indexed [v, u]",
        (3, h, w): "colours belong on the last axis",
        (h * w, 3): "reshape to (height, width, 3)",
        (h, w): "red, green and blue are wanted",
        (h, w, 4): "an alpha channel is one too many",
    }.get(got[0].shape, "")


# ------------------------------------------------------------------------------------------ typical mistakes


def _picture(change: Callable[[SceneDict, Any], Any]) -> Any:
    return changed("finish", lambda f: lambda scene, picture: change(scene, f(scene, picture)))


def _visible(visible: Callable[[SceneDict, Met, Any], Any]) -> Any:
    return changed("sun_visible", lambda f: visible)


def _dark(scene: SceneDict, met: Met, own: bool = False, casters: Any = None, beyond: float = np.inf) -> np.ndarray:
    """As Renderer.dark, with mistakes: the `own` object counts, or only these `casters`, or none `beyond` so far."""
    things = [*scene["spheres"], *scene["planes"]]
    p = np.where((met.which >= 0)[:, None], met.points, 0.0)
    to_light = np.tile(scene["sun"]["to_light"], (len(p), 1))
    ts = Renderer()._distances(p, to_light, scene["spheres"], scene["planes"])
    kind = np.array(["sphere" if "radius" in thing else "plane" for thing in things])[:, None]
    counts = np.isfinite(ts) & (ts < beyond) & (own | (np.arange(len(ts))[:, None] != met.which))
    return np.asarray((counts & (kind == casters if casters else True)).any(axis=0) & (met.which >= 0))


def _received(kind: str) -> Callable[[SceneDict, Met, Any], Any]:
    """Objects of this kind receive no shadow."""

    def visible(scene: SceneDict, met: Met, dark: Any) -> Any:
        is_sphere = (met.which >= 0) & (met.which < len(scene["spheres"]))
        return ~(dark & (~is_sphere if kind == "sphere" else is_sphere))

    return visible


def _turned(scene: SceneDict) -> SceneDict:
    """The light read in the camera's frame."""
    return scene | {"sun": scene["sun"] | {"to_light": scene["R_cam_board"].T @ scene["sun"]["to_light"]}}


def _scene(change: Callable[[SceneDict], SceneDict]) -> Callable[[Any], Function]:
    """The right picture of another scene."""
    return changed("given", lambda f: lambda scene: change(f(scene)))


def _srgb(x: Any) -> Any:
    x = np.clip(x, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def _background(value: float) -> Callable[[SceneDict, Any], Any]:
    """Of pixels that meet nothing."""

    def change(scene: SceneDict, picture: Any) -> Any:
        met = Renderer().meet(scene, scene["spheres"], scene["planes"])
        return np.where((met.which >= 0).reshape(*picture.shape[:2], 1), picture, value)

    return change


def _black_shadows(scene: SceneDict, picture: Any) -> Any:
    ours = Renderer()
    dark = ours.dark(scene, ours.meet(scene, scene["spheres"], scene["planes"])) & (scene["rung"] == "shadow")
    return np.where(dark.reshape(*picture.shape[:2], 1), 0.0, picture)


def _inward(scene: SceneDict, met: Met, normals: Any) -> Any:
    """Spheres' normals the other way; planes look to the eye."""
    sphere = (met.which >= 0) & (met.which < len(scene["spheres"]))
    return np.where(sphere[:, None], -normals, normals)


def _far_root(f: Any) -> Function:
    """With normals that are not turned to the eye: they point away from it there, where the ray leaves the sphere."""
    far = next(v for v in intersect_sphere.VARIANTS if v.name == "far root")
    return changed("normals", lambda g: _inward)(changed("intersect_sphere", far.change)(f))


def _sized(plane: SceneDict, factor: float) -> SceneDict:
    return plane | {"half_u": factor * plane["half_u"], "half_v": factor * plane["half_v"]}


VARIANTS = (
    *lifted("back_project", back_project.VARIANTS, LONG),
    *lifted("intersect_sphere", intersect_sphere.VARIANTS),
    *lifted("shade", shade.VARIANTS, "gamma", "clipped at 1", "BGR"),
    *GEOMETRY,
    *ORDER,
    Variant("no shadows", "there are no shadows: with the rung \"shadow\" the sun does not reach what another object "
            "hides",
            _visible(lambda scene, met, dark: np.ones_like(dark))),
    Variant("shadows where there are none", "shadows are cast with the rung \"lambert\", too: there it has none",
            _scene(lambda scene: scene | {"rung": "shadow"})),
    Variant("shadows black", "shadows are black: the sky still reaches them, albedo * sky",
            _picture(lambda s, L: _black_shadows(s, L))),
    Variant("spheres receive no shadow", "spheres receive no shadows", _visible(_received("sphere"))),
    Variant("planes receive no shadow", "planes receive no shadows", _visible(_received("plane"))),
    Variant("planes cast no shadow", "planes cast no shadows", _visible(lambda s, met, d: ~_dark(s, met,
            casters="sphere"))),
    Variant("spheres cast no shadow", "spheres cast no shadows", _visible(lambda s, met, d: ~_dark(s, met,
            casters="plane"))),
    Variant("shadows from the other side", "shadows fall towards the sun: the shadow ray goes along to_light",
            _visible(lambda s, met, d: ~_dark(s | {"sun": s["sun"] | {"to_light": -s["sun"]["to_light"]}}, met))),
    Variant("normals inward", "the spheres' normals point inwards", changed("normals", lambda f: _inward)),
    Variant("normals not unit", "the spheres' normals are not unit: divide p - center by the radius",
            changed("sphere_normal", lambda f: lambda p, s: p - s["center"])),
    Variant("normals from the origin", "the spheres' normals are those of spheres about the origin: (p - center) / "
            "radius",
            changed("sphere_normal", lambda f: lambda p, s: p / np.linalg.norm(p, axis=-1, keepdims=True))),
    Variant("light in the camera's frame", "the light's direction is taken in the camera's frame: to_light is in the "
            "board's",
            _scene(_turned)),
    Variant("light in the camera's frame", "the light's direction is turned once too often, by R: points, normals and "
            "to_light are all in the board's frame",
            _scene(lambda s: s | {"sun": s["sun"] | {"to_light": s["R_cam_board"] @ s["sun"]["to_light"]}})),
    Variant("far root", "t of spheres: the far root is returned where the near one is wanted: (-b - √disc) comes first",
            _far_root),
    Variant("no planes", "the planes are left out", _scene(lambda scene: scene | {"planes": []})),
    Variant("no spheres", "the spheres are left out", _scene(lambda scene: scene | {"spheres": []})),
    Variant("whole edges", "half_u and half_v are taken for whole edges: a plane is center ± half_u ± half_v",
            _scene(lambda scene: scene | {"planes": [_sized(p, 0.5) for p in scene["planes"]]})),
    Variant("planes without end", "the planes have no edges: they are rectangles, center ± half_u ± half_v",
            _scene(lambda scene: scene | {"planes": [_sized(p, 1e4) for p in scene["planes"]]})),
    Variant("background black", "the background is black: it is the sky's radiance", _picture(_background(0.0))),
    Variant("background white", "the background is white: it is the sky's radiance", _picture(_background(1.0))),
    Variant("background NaN", "the background is NaN: it is the sky's radiance", _picture(_background(np.nan))),
    Variant("sRGB", "the picture is encoded for the screen (sRGB): linear radiance is wanted", _picture(lambda s,
            L: _srgb(L))),
    Variant("gamma", "a gamma of 1/2.2 is applied: linear radiance is wanted", _picture(lambda s,
            L: np.abs(L) ** (1 / 2.2))),
    Variant("clipped at 1", "the picture is cut off at 1: radiance has no upper bound", _picture(lambda s,
            L: np.clip(L, 0, 1))),
    Variant("0 to 255", "the picture is in 0 to 255: linear radiance is wanted", _picture(lambda s, L: 255 * L)),
    Variant("8 bits", "the picture is cut to bytes: linear radiance, in floats, is wanted",
            _picture(lambda s, L: (255 * np.clip(L, 0, 1)).astype(np.uint8).astype(float))),
    Variant("divided by the brightest", "the picture is divided by its brightest value: linear radiance is wanted",
            _picture(lambda s, L: L / L.max())),
    Variant("BGR", "red and blue are swapped, as OpenCV has them", _picture(lambda s, L: L[..., ::-1])),
    Variant("grey", "the colour is lost", _picture(lambda s, L: np.repeat(L.mean(axis=-1, keepdims=True), 3, axis=-1))),
    Variant("mirrored", "left and right are swapped", _picture(lambda s, L: L[:, ::-1])),
)  # fmt: skip

STAGE = Stage(
    Renderer().render, ("picture",), cases, errors, 1e-3, "of the brightest", VARIANTS, outliers=0.01, hint=hint
)
