"""What a change of a scene does to its picture, known exactly: a law per change, with the cause where it breaks.

Frame, disc, ball and curtain put one simple body before the scene's camera. The other laws change the scene itself.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from raytwin.rungs import Rung
from raytwin.scene import Rectangle, Scene, Shape, Sky, Sphere

SHIFT, SHRINK = (873.1, -1746.3, 433.74), 1 / 50
"""By how much the scene is moved, 2000 units and nothing that floats hold exactly, and scaled."""
TURN = np.array([[2, -1, 2], [2, 2, -1], [-1, 2, 2]]) / 3
"""A rotation about none of the frame's axes."""
BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
SKYLIGHT, SUNLIGHT = (0.6, 0.7, 0.8), (2.0, 2.5, 3.0)

Join = Callable[[Sequence[np.ndarray]], np.ndarray]


class View(NamedTuple):
    """`weight` join(pictures of the `scenes`), with a `join` that adds or moves values; of no scene, the `value`."""

    scenes: tuple[Scene, ...] = ()
    join: Join = lambda pictures: pictures[0]
    weight: float = 1.0
    value: Any = BLACK


class Level(NamedTuple):
    """What a renderer computes, and where its rays go; `noisy`: by random samples."""

    rung: Rung
    sampling: str
    noisy: bool


Pair = tuple[View, View]
"""The changed scene's picture, and what it must be."""


class Law(NamedTuple):
    """`does`: the change, in words; `cause`: what a renderer that breaks this law alone does wrong.

    `views(scene, level)`: both pictures; or, in words, why the law does not hold for this scene or level.
    """

    name: str
    does: str
    cause: str
    views: Callable[[Scene, Level], Pair | str]


# ------------------------------------------------------------------------------------------ changes of a scene


def placed(scene: Scene, A: np.ndarray, d: Sequence[float] = BLACK, flips: Sequence[int] = (1, 1)) -> Scene:
    """Return the scene at p' = A p + d with its camera, whose picture has its axes x, y times `flips`.

    A (3, 3) is a scale s > 0 times an orthogonal Q. With the camera's axes D = diag(flips, 1): R' = D R Qᵀ and
    t' = s D t - R' d, where det Q det D = 1. A flipped axis mirrors the principal point, and turns the sign of the lens
    coefficient that is odd in it: p2 of x, p1 of y.
    """
    camera, D = scene.camera, np.diag([*flips, 1])
    s = abs(np.linalg.det(A)) ** (1 / 3)
    Q = A / s
    R = D @ camera.R_cam_board @ Q.T
    sides = zip((camera.cx, camera.cy), flips, camera.image_size, strict=True)
    cx, cy = (c if flip > 0 else side - 1 - c for c, flip, side in sides)
    k1, k2, p1, p2, k3 = camera.coefficients
    there = camera.with_(
        K=((camera.fx, 0, cx), (0, camera.fy, cy), (0, 0, 1)), dist=(k1, k2, flips[1] * p1, flips[0] * p2, k3),
        R_cam_board=R, t_cam_board=s * D @ camera.t_cam_board - R @ d,
    )  # fmt: skip

    def moved(thing: Shape) -> Shape:
        center = A @ thing.center + d
        if isinstance(thing, Sphere):
            return thing.with_(center=center, radius=s * thing.radius)
        return thing.with_(center=center, half_u=A @ thing.half_u, half_v=A @ thing.half_v)

    sun = scene.sun.with_(to_light=Q @ scene.sun.to_light)
    return scene.with_(camera=there, objects=[moved(thing) for thing in scene.objects], sun=sun)


def painted(scene: Scene, albedo: Callable[[np.ndarray], Any]) -> Scene:
    """Return the scene with another albedo of each object, made of its own (3,)."""
    return scene.with_(objects=[thing.with_(albedo=albedo(np.array(thing.albedo))) for thing in scene.objects])


def lit(scene: Scene, sun: float = 1.0, sky: float = 1.0) -> Scene:
    """Return the scene with its lights times these factors."""
    irradiance, radiance = sun * np.array(scene.sun.irradiance), sky * np.array(scene.sky_radiance)
    return scene.with_(sun=scene.sun.with_(irradiance=irradiance), sky=Sky().with_(radiance=radiance))


def screen(scene: Scene, box: Sequence[float], distance: float) -> Rectangle:
    """Return a black rectangle that faces the camera and fills the pixels from `box`'s x, y to its x, y.

    It fills just these without a lens; with one, a box far beyond the picture's edge still fills the picture.
    """
    camera, R = scene.camera, np.array(scene.camera.R_cam_board)
    ends = (np.array(box).reshape(2, 2) - 0.5 - (camera.cx, camera.cy)) / (camera.fx, camera.fy) * distance
    (x, y), (half_x, half_y) = ends.mean(axis=0), np.ptp(ends, axis=0) / 2
    screen = Rectangle(BLACK, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), BLACK)
    center = camera.eye + (x, y, distance) @ R
    return screen.with_(center=center, half_u=half_x * R[0], half_v=half_y * R[1])


def _alone(scene: Scene) -> Scene:
    """The first object only: a convex body, whose light reaches no other surface."""
    return scene.with_(objects=scene.objects[:1])


def _reached(scene: Scene) -> np.ndarray:
    """(n, 3): corners of boxes round all objects."""
    return np.concatenate([thing.center + thing.corners() for thing in scene.objects])


# ------------------------------------------------------------------------------------------ laws


def _changed(change: Callable[[Scene], Scene], join: Join = lambda pictures: pictures[0]) -> Any:
    """The views of a law by which the picture of the changed scene, its pixels put back by `join`, stays the same."""
    return lambda scene, level: (View((change(scene),), join), View((scene,)))


def _framed(scene: Scene, level: Level) -> Pair:
    plain = scene.with_camera(scene.camera.with_(dist=()))
    (width, height), expected = scene.image_size, np.full((*scene.image_size[::-1], 3), SKYLIGHT)
    x0, y0, x1, y1 = box = width // 6, height // 5, width // 2, height // 3
    expected[y0:y1, x0:x1] = 0
    return View((plain.with_(objects=[screen(plain, box, 1.0)], sky=Sky(SKYLIGHT)),)), View(value=expected)


def _disc(scene: Scene, level: Level) -> Pair | str:
    if level.sampling != "center":
        return "pixels of the outline hold a part of each"
    camera = scene.camera.with_(dist=())
    distance, radius = 10, 2
    ball = Sphere(BLACK, radius, BLACK).with_(center=camera.eye + distance * np.array(camera.R_cam_board[2]))
    v, u = np.indices(scene.image_size[::-1])
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    inside = x * x + y * y < radius**2 / (distance**2 - radius**2)
    expected = np.where(inside[..., None], 0, SKYLIGHT)
    return View((scene.with_(camera=camera, objects=[ball], sky=Sky(SKYLIGHT)),)), View(value=expected)


def _ball(scene: Scene, level: Level) -> Pair:
    """E n·l / π on a ball of radius r whose centre is c = (0, 0, f): t d with |t d - c| = r, in the camera's frame."""
    camera = scene.camera.with_(dist=())
    R, r, f, to_light = np.array(camera.R_cam_board), 10, 11, (0, -np.sqrt(0.75), -0.5)
    v, u = np.indices(scene.image_size[::-1])
    d = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1)
    squared = (d * d).sum(axis=-1)
    root = f * f - squared * (f * f - r * r)
    t = (f - np.sqrt(np.maximum(root, 0))) / squared
    cosine = np.where(root > 0, (t[..., None] * d - (0, 0, f)) @ to_light / r, 0)
    ball = Sphere(BLACK, r, WHITE).with_(center=camera.eye + f * R[2])
    sun = scene.sun.with_(to_light=to_light @ R, irradiance=SUNLIGHT)
    lit_ball = scene.with_(camera=camera, objects=[ball], sun=sun, sky=None)
    return View((lit_ball,)), View(value=np.maximum(cosine, 0)[..., None] * SUNLIGHT / np.pi)


def curtained(scene: Scene) -> Scene:
    """Return the scene behind a black rectangle that fills the picture."""
    width, height = scene.image_size
    near = np.linalg.norm(_reached(scene) - scene.camera.eye, axis=1).min()
    curtain = screen(scene, (-width, -height, 2 * width, 2 * height), near / 100)
    return scene.with_(objects=[*scene.objects, curtain])


def _sun_behind(scene: Scene, level: Level) -> Pair:
    one = lit(_alone(scene), sky=0)
    away = np.subtract(one.objects[0].center, scene.camera.eye)
    return View((one.with_(sun=one.sun.with_(to_light=away)),)), View()


def _covered(scene: Scene, level: Level) -> Pair | str:
    if not level.rung.shadows:
        return "this light level has no shadows"
    points, to_light = np.concatenate([_reached(scene), [scene.camera.eye]]), np.array(scene.sun.to_light)
    center = points.mean(axis=0)
    reach = np.linalg.norm(points - center, axis=1).max()
    lid = Sphere(BLACK, 2 * reach, BLACK).with_(center=center + 4 * reach * to_light)
    return View((lit(scene, sky=0).with_(objects=[*scene.objects, lid]),)), View()


def _half_albedo(scene: Scene, level: Level) -> Pair | str:
    if (level.rung.depth or 2) > 2:
        return "bounced light is not proportional to the albedo"
    sunlit = lit(scene, sky=0)
    return View((painted(sunlit, lambda albedo: albedo / 2),), weight=2.0), View((sunlit,))


def _furnace(scene: Scene, level: Level) -> Pair:
    several = scene if level.rung.sky == "open" else _alone(scene)
    return View((painted(several, lambda albedo: WHITE).with_(sun=None, sky=Sky(SKYLIGHT)),)), View(value=SKYLIGHT)


def _recoloured(scene: Scene) -> Scene:
    sun = scene.sun.with_(irradiance=np.roll(scene.sun.irradiance, 1))
    sky = Sky().with_(radiance=np.roll(scene.sky_radiance, 1))
    return painted(scene, lambda albedo: np.roll(albedo, 1)).with_(sun=sun, sky=sky)


def _behind_the_eye(scene: Scene, level: Level) -> Pair | str:
    if level.rung.sky != "open":
        return "what stands behind the camera hides sky there"
    skylit, eye = lit(scene, sun=0), np.array(scene.camera.eye)
    there = [
        thing.with_(center=1.5 * eye - np.array(thing.center) / 2, name=f"behind {i}")
        for i, thing in enumerate(scene.objects)
    ]
    return View((skylit.with_(objects=[*scene.objects, *there]),)), View((skylit,))


def _reordered(scene: Scene, level: Level) -> Pair | str:
    if max(len(scene.spheres), len(scene.planes)) < 2:
        return "it needs two objects of a kind"
    return View((scene.with_(objects=scene.objects[::-1]),)), View((scene,))


def _halved(scene: Scene, level: Level) -> Pair:
    (width, height), left = scene.image_size, scene.image_size[0] // 2
    halves = (scene.camera.grid(x, size=(w, height)) for x, w in ((0, left), (left, width - left)))
    whole = View(tuple(map(scene.with_camera, halves)), lambda pictures: np.concatenate(pictures, axis=1))
    return whole, View((scene,))


def _coarser(scene: Scene, level: Level) -> Pair | str:
    width, height = scene.image_size
    if width % 3 or height % 3:
        return f"{width} x {height} pixels cannot be divided by 3"
    coarse = View((scene.with_camera(scene.camera.resized(width // 3, height // 3)),))
    if level.sampling == "center":  # every third pixel has its centre where a coarse one has
        return coarse, View((scene,), lambda pictures: pictures[0][1::3, 1::3])
    if not level.noisy:
        return "rays on a grid over the pixel's area depend on its size"
    blocks = height // 3, 3, width // 3, 3, 3
    return coarse, View((scene,), lambda pictures: np.asarray(pictures[0].reshape(blocks).sum(axis=(1, 3))), 1 / 9)


LAWS: dict[str, Law] = {
    law.name: law
    for law in (
        Law("frame", "a black rectangle fills just the pixels that it is placed to fill",
            "pixels see other places than K, R and t say, or rectangles end elsewhere", _framed),
        Law("disc", "a black ball on the camera's axis is the disc that its radius and distance give",
            "a sphere's outline is wrong: its radius, or the quadratic", _disc),
        Law("curtain", "a black screen in front of everything is all that is seen",
            "another object than the nearest is seen",
            lambda scene, level: (View((curtained(scene),)), View())),
        Law("order", "objects in reverse order", "what is seen depends on the objects' order: keep the nearest hit",
            _reordered),
        Law("behind the eye", "the same objects are added behind the camera, half as far",
            "objects behind the camera are seen: accept distances above 0 only", _behind_the_eye),
        Law("halves", "left and right half by cameras of their own",
            "a pixel's ray depends on the picture's size, not on K alone", _halved),
        Law("resolution", "a third of the pixels per side, and K with them",
            "pixel centers are not at whole numbers: half a pixel", _coarser),
        Law("rolled", "the camera turned upside down", "the camera's x or y has a place or a sign of its own",
            _changed(lambda scene: placed(scene, np.eye(3), flips=(-1, -1)), lambda x: x[0][::-1, ::-1])),
        Law("mirrored", "scene and picture mirrored",
            "handedness: an axis or a cross product has the wrong sign, or p1 is taken for p2",
            _changed(lambda scene: placed(scene, np.diag([-1.0, 1, 1]), flips=(-1, 1)), lambda x: x[0][:, ::-1])),
        Law("turned", "camera and scene turned together", "a direction is not in the frame that it is used in",
            _changed(lambda scene: placed(scene, TURN))),
        Law("moved", "camera and scene moved by 2000 units", "positions lose digits far from the origin (float32)",
            _changed(lambda scene: placed(scene, np.eye(3), SHIFT))),
        Law("scaled", "all lengths times 1/50", "a length is fixed in units, as an epsilon, or a vector is not unit",
            _changed(lambda scene: placed(scene, SHRINK * np.eye(3)))),
        Law("black", "albedo 0 under the sun alone is black", "light is added that comes from no source",
            lambda scene, level: (View((painted(lit(scene, sky=0), lambda albedo: BLACK),)), View())),
        Law("sun behind", "the sun straight behind a body leaves its near side black",
            "the sun lights what faces away from it: n·l is not clamped at 0, or the far root is taken", _sun_behind),
        Law("covered", "a ball between the sun and everything makes it black", "something casts or gets no shadow",
            _covered),
        Law("ball", "a white ball that fills the picture returns E cos θ / π", "the sun's part is not albedo/π E cos θ",
            _ball),
        Law("furnace", "albedo 1 under an even sky shows the sky's radiance everywhere",
            "the sky's part is not albedo times its radiance", _furnace),
        Law("half the albedo", "half the albedo returns half the sunlight",
            "radiance is not proportional to the albedo", _half_albedo),
        Law("light doubled", "sun and sky twice as bright",
            "radiance is not proportional to the light: a clamp, gamma or tone mapping",
            lambda scene, level: (View((lit(scene, 2, 2),), weight=0.5), View((scene,)))),
        Law("light split", "sun alone + sky alone = both", "a light is counted twice, or left out beside another",
            lambda scene, level: (View((lit(scene, sky=0), lit(scene, sun=0)), lambda x: np.add(*x)),
                                  View((scene,)))),
        Law("colours", "red, green and blue take turns", "a colour channel is computed from another",
            _changed(_recoloured, lambda x: np.roll(x[0], -1, axis=2))),
    )
}  # fmt: skip
"""name -> law, in the order in which a break names the cause. To add one, add its row."""

OF_RECTANGLES = "frame", "curtain"
"""Laws that put a rectangle into the scene."""
CAUSES: dict[tuple[str, ...], str] = {
    ("halves", "light doubled"): "pixels depend on the whole picture: values are divided by its maximum",
    ("black", "light doubled"): "light is added that comes from no source: an offset, or a background of its own",
    ("frame", "light doubled", "light split"): LAWS["light doubled"].cause,
    ("ball", "furnace", "light doubled"): "the sun's irradiance is left out",
    ("light doubled", "light split"): "values are rounded, or the light is not used as a factor",
    ("black", "half the albedo"): "the albedo is left out",
    ("ball", "furnace", "colours"): "the color channels are in another order",
    ("ball", "colours"): LAWS["colours"].cause,
    ("ball", "furnace", "light split"): "values are rounded, as by half floats",
    ("ball", "disc", "furnace"): "all radiance is multiplied by a factor",
    ("frame", "disc", "furnace"): "the background, or the sky's light, is not the sky's radiance",
    ("frame", "disc", "order"): "an object is left out",
    ("halves", "resolution"): LAWS["halves"].cause,
    ("resolution", "rolled"): "pixels are off by a part of one: half a pixel, or K rounded",
    ("frame", "disc", "halves"): "rows or columns of the picture are in another order",
    ("disc", "turned", "scaled"): "an offset of fixed length and direction is added",
    ("ball", "scaled", "turned"): "shadow rays hit the surface that they start from",
    ("rolled", "turned"): "a direction, as the sun's, is not in the frame that it is used in",
    ("rolled", "mirrored"): "the lens's coefficients are in another order, or the principal point is fixed",
    ("sun behind", "moved"): "the sun's direction is used as a place, or normals are taken from the origin",
    ("ball", "sun behind", "covered"): "the direction to the sun has the wrong sign",
    ("frame", "disc", "curtain"): "R and t are not used as p_cam = R p_board + t",
    ("frame", "curtain"): "rectangles are not hit where they are (without any in the renderer: --without planes)",
}
"""Laws that break together -> what does that; the first row whose laws are all broken counts."""
