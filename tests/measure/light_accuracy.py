"""How near `raytwin photo light` comes to the true light, and whether its standard deviations are true.

    python -m measure.light_accuracy photos FOLDER --first 300        # a photo under each of 20 random lights
    python -m measure.light_accuracy judge FOLDER --first 300 --record

Seeds below 300 may be tuned on.

Every light has a sun 25 to 70 degrees high and a sky that leaves 15 to 60 % of the paper's light in the shadow: every
other one a constant sky, the others a map of 16 rows with a gradient and three broad lamps. A mirror ball, an orange
ball and an upright stand beside or on the board; what the user says of them is off by a tenth of a radius, 1 % of it,
and half a millimetre.
"""

import argparse
import itertools
from pathlib import Path

import cv2
import numpy as np
from measure import light_photos, record
from photo_helpers import a_camera
from scene_of import scene_of

from raytwin.errors import InputError
from raytwin.photos import synthetic_photos
from raytwin.photos.augment import augment, printed
from raytwin.photos.boards import read_board
from raytwin.photos.boards.board import draw_board
from raytwin.photos.lighting import light_models as models
from raytwin.photos.lighting.estimate_light import LightEstimate, estimate_light
from raytwin.photos.synthetic_photos import sheet_of
from raytwin.scene import Camera, Environment, Sky, Sphere, Sun
from raytwin.scene.toml_json import write_json, write_toml
from raytwin.study.photograph import TABLE
from raytwin.tracer.lights.envmap_tables import REC_709

MIRROR = Sphere((-0.075, 0.05, 0.028), 0.03, (0.9, 0.9, 0.9))
ORANGE = Sphere((-0.065, 0.15, 0.018), 0.02, (0.75, 0.35, 0.08))
STAND = (0.095, 0.095, 0.03)
PAPER = 0.85


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
    light_photos.photograph(
        read_board(Path(__file__).parents[2] / "scenes" / "desk" / "board.toml"), a_camera(1008, 756),
        folder / "photos", (Sun(tuple(to_light), tuple(E)), sky), MIRROR, ORANGE, STAND, samples, seed + 1,
    )  # fmt: skip


BY = "stand", "mirror ball"
"""What the light is found by."""


def judge(folder: Path, seed: int) -> list[dict]:
    """Return a row per thing that shows the light: errors and z of the light that is found in `folder`."""
    truth = synthetic_photos.read_truth(folder / "photos" / "truth.toml")
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
