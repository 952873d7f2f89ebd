"""How near `raytwin photo light` comes to the true light, and whether its standard deviations are true.

    python -m measure.light_accuracy photos FOLDER --first 300        # a photo under each of 20 random lights
    python -m measure.light_accuracy judge FOLDER --first 300 --record

Seeds below 300 may be tuned on.

Every light has a sun 25 to 70 degrees high and a sky that leaves 15 to 60 % of the paper's light in the shadow: every
other one a constant sky, the others a map of 16 rows with a gradient and three broad lamps. A mirror ball, an orange
ball and an upright stand beside or on the board; what the user says of them is off by a tenth of a radius, 1 % of it,
and half a millimetre. Mitsuba's own path tracer renders them. It sees no sun in a mirror, since that is a direction:
`sun_glint` adds its image. The sunlight that the mirror throws on what surrounds it is left out.
"""

import argparse
import itertools
import math
from pathlib import Path

import cv2
import numpy as np
from measure import record
from photo_helpers import a_camera, read_truth
from scene_of import scene_of

from raytwin import twin
from raytwin.errors import InputError
from raytwin.images.photo_files import write_picture
from raytwin.photos.augment import augment, printed
from raytwin.photos.boards.board import Board, BoardTag, draw_board, read_board, write_board
from raytwin.photos.camera import lens_model
from raytwin.photos.lighting import light_models as models
from raytwin.photos.lighting.estimate_light import LightEstimate, estimate_light
from raytwin.photos.synthetic_photos import QUALITY, Truth, expose, poses, sheet_of, write_truth
from raytwin.scene import Camera, Environment, Matrix, Rectangle, Scene, Sky, Sphere, Sun, Vector
from raytwin.scene.toml_json import write_json, write_toml
from raytwin.study.photograph import TABLE
from raytwin.tracer.lights.envmap_tables import REC_709
from raytwin.twin.opencv_sensor import lens_at, mitsuba_sensor
from raytwin.twin.twin_scene import load, place_of, translate

MIRROR = Sphere((-0.075, 0.05, 0.028), 0.03, (0.9, 0.9, 0.9))
ORANGE = Sphere((-0.065, 0.15, 0.018), 0.02, (0.75, 0.35, 0.08))
STAND = (0.095, 0.095, 0.03)
PAPER = 0.85

TEXELS_PER_METRE = 4500.0
"""Of the board's texture: two per pixel at the nearest."""

SAMPLES_PER_PASS = 8
"""Samples per pixel that Mitsuba holds in memory at once."""

GLINT_BLUR = 0.7
"""Pixels, one standard deviation: how far a lens spreads the sun's image."""

POST_SHARE = 0.05
"""The pin's thickness, as a share of its height."""

BORDER = 5
"""Pixels between a ball's outline and the frame, at least."""


def random_light(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
    """Direction to the sun, E (3), the constant sky Ls (3) that lights level paper as much, and the map or None."""
    rng = np.random.default_rng(1000 + seed)
    high, turn = np.radians(rng.uniform(25, 70)), rng.uniform(0, 2 * np.pi)
    to_light = np.array([np.cos(high) * np.cos(turn), np.cos(high) * np.sin(turn), np.sin(high)])
    share, white = rng.uniform(0.15, 0.6), 0.75
    warm, cool = 1 + rng.uniform(0, 0.15) * np.array([1, 0, -1]), 1 + rng.uniform(0, 0.2) * np.array([-1, 0, 1])
    E = white * (1 - share) / PAPER * np.pi / to_light[2] * warm
    Ls = white * share / PAPER * cool
    if seed % 2 == 0:
        return to_light, E, Ls, None
    rows = 16
    v, u = np.mgrid[:rows, : 2 * rows] + 0.5
    theta, turn = v * np.pi / rows, (u / rows - 1) * np.pi
    d = np.stack([np.sin(theta) * np.sin(turn), np.sin(theta) * np.cos(turn), np.cos(theta)], axis=-1)
    sky = 0.3 + 0.3 * rng.uniform() * d[..., 2:] + np.zeros(3)
    for _ in range(3):
        m = rng.normal(size=3)
        m[2] = abs(m[2])
        m /= np.linalg.norm(m)
        sky = sky + rng.uniform(0.3, 1.2) * np.exp(rng.uniform(4, 12) * (d @ m - 1))[..., None] * rng.uniform(0.7, 1, 3)
    up = np.maximum(d[..., 2:], 0) * np.sin(theta)[..., None]
    mean = (sky * up).sum(axis=(0, 1)) / up.sum(axis=(0, 1))
    return to_light, E, Ls, (sky * Ls / mean).astype(np.float32)


def take(folder: Path, seed: int, samples: int) -> None:
    to_light, E, Ls, around = random_light(seed)
    sky = Sky(tuple(Ls)) if around is None else Environment(around.shape[1::-1], around.astype("<f4").tobytes())
    photograph(
        read_board(Path(__file__).parents[2] / "scenes" / "desk" / "board.toml"), a_camera(1008, 756),
        folder / "photos", (Sun(tuple(to_light), tuple(E)), sky), MIRROR, ORANGE, STAND, samples, seed + 1,
    )  # fmt: skip


def photograph(
    board: Board, camera: Camera, out: Path, lights: tuple[Sun, Sky | Environment], mirror: Sphere, ball: Sphere,
    pin: tuple[float, float, float], samples: int, seed: int,
) -> None:  # fmt: skip
    """Write a photo that shows all of board, balls and pin, photo_00.jpg, and board.toml and truth.toml to `out`.

    The camera's pose is not used. The mirror's albedo is its reflectance. `pin`: x and y of its foot, and its height.
    """
    twin.activate()
    rng = np.random.default_rng(seed)
    texture, extent = draw_board(board, TEXELS_PER_METRE)
    x, y, height = pin
    objects = (mirror, ball, sheet_of(extent), TABLE, *post(x, y, height))
    R, t = pose_of(board, camera, (mirror, ball, Sphere((x, y, height / 2), height / 2)), rng)
    view = Camera(camera.image_size, camera.K, R, t, camera.dist)
    light = rendered(scene_of("light", view, objects, lights), {2: texture}, samples, seed)
    pixels = expose(light + sun_glint(view, mirror, lights[0]), rng, view)
    write_picture(out / "photo_00.jpg", pixels, quality=QUALITY)
    write_board(out / "board.toml", board)
    write_truth(out / "truth.toml", Truth(camera.image_size, camera.K, camera.dist, {"photo_00.jpg": (R, t)}))


def pose_of(
    board: Board, camera: Camera, around: tuple[Sphere, ...], rng: np.random.Generator
) -> tuple[Matrix, Vector]:
    """Return a pose that shows all of the board and of the spheres: one of a wider board, which reaches as far."""
    corners = np.array(list(itertools.product((-1, 1), repeat=3)))
    points = np.concatenate([np.array(s.center) + s.radius * corners for s in around])
    flat = np.concatenate([points[:, :2], list(board.centers().values())])
    ends = zip(flat.min(axis=0).tolist(), flat.max(axis=0).tolist(), strict=True)
    wide = Board(
        board.family, board.tag_edge, tags=tuple(BoardTag(i, at) for i, at in enumerate(itertools.product(*ends)))
    )
    while True:
        ((R, t),) = poses(wide, camera, 1, rng)
        at = lens_model.project(points, R, t, camera.K, camera.dist)
        if (at > BORDER).all() and (at < np.array(camera.image_size) - 1 - BORDER).all():
            return R, t


def post(x: float, y: float, height: float) -> tuple[Rectangle, ...]:
    """A square post: four sides and a top."""
    a, grey = POST_SHARE * height / 2, (0.3, 0.3, 0.3)
    up = (0.0, 0.0, height / 2)
    sides = [((x + a * i, y + a * j, height / 2), (a * j, -a * i, 0.0)) for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    top = Rectangle((x, y, height), (a, 0.0, 0.0), (0.0, a, 0.0), grey)
    return (*(Rectangle(middle, along, up, grey) for middle, along in sides), top)


def rendered(scene: Scene, textures: dict[int, np.ndarray], samples: int, seed: int) -> np.ndarray:
    """Linear radiance (H, W, 3) by Mitsuba's path tracer; object 0 is a mirror, whose albedo is its reflectance."""
    import mitsuba as mi

    world = translate(scene, place := place_of(scene), textures)
    reflectance = {"type": "rgb", "value": list(scene.objects[0].albedo)}
    world["object-0"]["bsdf"] = {"type": "conductor", "material": "none", "specular_reflectance": reflectance}
    world["sensor"] = mitsuba_sensor(scene.camera) | lens_at(scene.camera, place.eye)
    world["integrator"] = {"type": "path", "max_depth": 8}
    loaded, passes = load(world), math.ceil(samples / SAMPLES_PER_PASS)
    total = np.zeros((scene.camera.height, scene.camera.width, 3))
    for number in np.random.SeedSequence(seed).generate_state(passes).tolist():
        total += np.asarray(mi.render(loaded, spp=SAMPLES_PER_PASS, seed=number))
    return total / passes


def sun_glint(camera: Camera, ball: Sphere, sun: Sun) -> np.ndarray:
    """(H, W, 3): the radiance that the sun's image in a mirror ball adds, blurred by GLINT_BLUR pixels.

    A point at infinity is seen where the normal halves the angle between eye and light. Its image holds, over all
    pixels, E times the reflectance times the area in pixels that a steradian about it fills in the mirror.
    """
    to_sun = np.array(sun.to_light)
    sideways = np.linalg.svd(to_sun[None])[2][1:]
    step = 1e-4
    lights = np.stack([to_sun, *(to_sun + step * s for s in sideways)])
    n = np.broadcast_to(to_sun, lights.shape)
    for _ in range(100):
        to_eye = np.array(camera.eye) - (np.array(ball.center) + ball.radius * n)
        half = to_eye / np.linalg.norm(to_eye, axis=1, keepdims=True) + lights
        n = half / np.linalg.norm(half, axis=1, keepdims=True)
    R, t = np.array(camera.R_cam_board), np.array(camera.t_cam_board)
    at = lens_model.project(np.array(ball.center) + ball.radius * n, R, t, np.array(camera.K), camera.dist)
    area = abs(np.linalg.det((at[1:] - at[0]) / step))
    x, y = np.arange(camera.width) - at[0, 0], np.arange(camera.height) - at[0, 1]
    spot = np.exp(-(y[:, None] ** 2 + x**2) / (2 * GLINT_BLUR**2)) / (2 * np.pi * GLINT_BLUR**2)
    return spot[..., None] * (area * np.array(sun.irradiance) * np.array(ball.albedo))


BY = "stand", "mirror ball"
"""What the light is found by."""


def judge(folder: Path, seed: int) -> list[dict]:
    """Return a row per thing that shows the light: errors and z of the light that is found in `folder`."""
    truth = read_truth(folder / "photos" / "truth.toml")
    R, t = truth.photos["photo_00.jpg"]
    write_toml(folder / "camera.toml", Camera(truth.image_size, truth.K, R, t, truth.dist).to_dict())
    to_light, E, Ls, around = random_light(seed)
    white = PAPER * (E * to_light[2] / np.pi + Ls) @ REC_709
    sky = around / white if around is not None else np.broadcast_to(np.float32(Ls / white), (16, 32, 3))
    true = models.Light(to_light, 0.0, E / white, E, Ls / white, Ls, sky)
    rng = np.random.default_rng(seed)
    ball = (*(MIRROR.center + rng.normal(0, 0.1 * MIRROR.radius, 3)), MIRROR.radius * (1 + rng.normal(0, 0.01)))
    given = {"stand": tuple(np.array(STAND) + rng.normal(0, 5e-4, 3))}, {"ball": ball}
    files, rows = (folder / "photos" / "photo_00.jpg", folder / "photos" / "board.toml", folder / "camera.toml"), []
    for by, numbers in zip(BY, given, strict=True):
        rows.append({"seed": seed, "sky": "constant" if around is None else "map", "by": by})
        try:
            rows[-1] |= judged(estimate_light(*files, **numbers), true)
        except InputError as error:
            rows[-1] |= {"failed": str(error)}
    return rows


def judged(found: LightEstimate, true: models.Light) -> dict:
    """Return what the light that was found is off."""
    light = found.light
    if light.to_light is None:
        return {"failed": "no sun found"}
    angle = np.degrees(np.arccos(np.clip(light.to_light @ true.to_light, -1, 1)))
    row = {"model": light.name, "angle": float(angle), "z_angle": float(angle / np.sqrt(2) / np.degrees(light.sigma))}
    for name in ("E", "Ls"):
        value, sd, exact = getattr(light, name), getattr(light, f"{name}_sd"), getattr(true, name)
        row[name] = float((value / exact - 1) @ REC_709)
        row[f"z_{name}"] = float((value - exact) @ REC_709 / (sd @ REC_709))
    up = models.NORMALS
    sky = light.Ls * (1 + up[:, 2:]) / 2 if light.around is None else models.received(light.around, up)
    row["irradiance"] = float(np.sqrt(((sky / models.received(true.around, up) - 1) ** 2).mean()))
    return row | {"codes": codes(found, light), "codes_true": codes(found, true)}


def codes(found: LightEstimate, light: models.Light) -> float:
    """Return the rms difference in 8-bit codes of the orange ball drawn under the light and the one in the photo, over
    means of 8 x 8 pixels, in which the photo's and the renderer's noise drop out."""
    photo, objects = found.photo, (ORANGE, sheet_of(draw_board(found.board, 500.0)[1]), TABLE)
    sun = Sun(tuple(light.to_light), tuple(light.E))
    scene = printed(scene_of("drawn", photo.camera, objects, (sun, light.sky)), found.board)
    result = augment(photo.pixels, scene, shadows=False, exposure=photo.value_of_one(photo.paper_colour))
    inside = (result.coverage == 1).astype(float)
    off = (result.pixels - photo.pixels.astype(float)) * inside[..., None]
    mean = cv2.boxFilter(off, -1, (8, 8))[inside == 1] / cv2.boxFilter(inside, -1, (8, 8))[inside == 1, None]
    return float(np.sqrt((mean**2).mean()))


COLUMNS = ("by", "sky", "lights", "sun, degrees", "worst", "z", "E", "z of E", "Ls", "z of Ls", "on a sphere",
           "codes", "true light")  # fmt: skip


def report(rows: list[dict], first: int) -> None:
    """Print a row per thing that shows the light and kind of sky: root mean squares, of codes the median."""
    table = []
    for by, kind in itertools.product(BY, ("constant", "map")):
        mine = [r for r in rows if r["by"] == by and r["sky"] == kind]
        good = [r for r in mine if "angle" in r]
        if not good:
            continue
        column = {k: np.array([r[k] for r in good]) for k in good[0] if k not in ("by", "model", "sky")}
        rms = {k: float(np.sqrt((v**2).mean())) for k, v in column.items()}
        table.append((
            by, kind, f"{len(good)} of {len(mine)}", f"{rms['angle']:.2f}", f"{column['angle'].max():.2f}",
            f"{rms['z_angle']:.2f}", f"{100 * rms['E']:.1f} %", f"{rms['z_E']:.2f}", f"{100 * rms['Ls']:.1f} %",
            f"{rms['z_Ls']:.2f}", f"{100 * rms['irradiance']:.1f} %", f"{np.median(column['codes']):.1f}",
            f"{np.median(column['codes_true']):.1f}",
        ))  # fmt: skip
    record.table(
        "light", f"lights-{first}", COLUMNS, table, f"python -m measure.light_accuracy judge FOLDER --first {first}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["photos", "judge"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--samples", type=int, default=64)
    asked, rows = parser.parse_args(record.arguments()), []
    for seed in range(asked.first, asked.first + asked.count):
        folder = asked.folder / f"{seed:02d}"
        if asked.what == "photos" and not (folder / "photos" / "truth.toml").exists():
            take(folder, seed, asked.samples)
        elif asked.what == "judge":
            rows += judge(folder, seed)
            for row in rows[-len(BY) :]:
                print({k: round(v, 3) if isinstance(v, float) else v for k, v in row.items()}, flush=True)
    if rows:
        write_json(asked.folder / "judged.json", rows)
        report(rows, asked.first)


if __name__ == "__main__":
    main()
