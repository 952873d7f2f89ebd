"""How near `raytwin photo light` comes to the true light, and whether its standard deviations are true.

    python -m measure.light_accuracy photos FOLDER --first 300        # two photos under each of 30 random lights
    python -m measure.light_accuracy judge FOLDER --first 300 --record

Seeds below 300 may be tuned on.

Every light has a sun 25 to 70 degrees high and a sky that leaves 15 to 60 % of the paper's light in the shadow: every
other one a constant sky, the others a map of 16 rows with a gradient and three broad lamps. A mirror ball, an orange
ball and an upright stand beside or on the board; what the user says of them is off by a tenth of a radius, 1 % of it,
and half a millimetre.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from measure import light_photos, record
from photo_helpers import a_camera
from scene_of import scene_of

from raytwin.errors import InputError
from raytwin.images.photo_files import list_photos
from raytwin.photos import synthetic_photos
from raytwin.photos.augment import augment, printed
from raytwin.photos.boards import read_board
from raytwin.photos.boards.board import draw_board
from raytwin.photos.lighting import light_models as models
from raytwin.photos.lighting.estimate_light import estimate_light
from raytwin.photos.lighting.linear_photo import value_of_one
from raytwin.photos.synthetic_photos import sheet_of
from raytwin.scene import Camera, Environment, Lambert, Sky, Sphere, Sun
from raytwin.scene.scene_files import write_camera
from raytwin.scene.toml_json import write_json
from raytwin.study.photograph import TABLE
from raytwin.tracer.lights.envmap_tables import REC_709

MIRROR = Sphere((-0.075, 0.05, 0.028), 0.03, Lambert((0.9, 0.9, 0.9)))
ORANGE = Sphere((-0.065, 0.15, 0.018), 0.02, Lambert((0.75, 0.35, 0.08)))
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
        read_board(Path(__file__).parents[2] / "scenes" / "desk" / "board.toml"), a_camera(1008, 756), 2,
        folder / "photos", (Sun(tuple(to_light), tuple(E)), sky), MIRROR, ORANGE, STAND, samples, seed + 1,
    )  # fmt: skip


MODES = {"stand": (False, True), "mirror ball": (True, False), "all": (True, True)}
"""By what -> whether the mirror ball and the stand are used."""


def judge(folder: Path, seed: int) -> list[dict]:
    """A row per mode: errors and z of the light that is found in `folder`."""
    truth = synthetic_photos.read_truth(folder / "photos" / "truth.toml")
    R, t = truth.photos["photo_00.jpg"]
    write_camera(folder / "camera.toml", Camera(truth.image_size, truth.K, R, t, truth.dist))
    to_light, E, Ls, around = random_light(seed)
    white = PAPER * (E * to_light[2] / np.pi + Ls) @ REC_709
    rng = np.random.default_rng(seed)
    radius = MIRROR.radius
    near = (*(np.array(MIRROR.center) + rng.normal(0, 0.1 * radius, 3)), radius * (1 + rng.normal(0, 0.01)))
    stand = tuple(np.array(STAND) + rng.normal(0, 5e-4, 3))
    rows: list[dict] = []
    start = time.process_time()
    try:
        whole = estimate_light(
            list_photos(folder / "photos"), folder / "photos" / "board.toml", folder / "camera.toml",
            balls=[near], stand=stand,
        )  # fmt: skip
    except InputError as error:
        return [{"seed": seed, "map": around is not None, "mode": mode, "failed": str(error)} for mode in MODES]
    for mode, (with_ball, with_stand) in MODES.items():
        row: dict = {"seed": seed, "map": around is not None, "mode": mode}
        rows.append(row)
        e = whole.evidence
        part = models.Evidence(e.paper, e.shadow if with_stand else None, e.mirrors if with_ball else [])
        if not (part.shadow or part.mirrors):
            row["failed"] = "no shadow"
            continue
        light, trials, taken = models.simplest_light(part)
        found = replace(whole, evidence=part, light=light, trials=trials, taken=taken)
        row |= {"model": found.trials[found.taken].name, "seconds": time.process_time() - start}
        if light.to_light is None:
            row["failed"] = "no sun found"
            continue
        if with_ball:
            ball = e.mirrors[0].ball
            off = ball.numbers - np.array([*MIRROR.center, MIRROR.radius])
            row |= {"z_ball": float(np.sqrt((off[:3] @ off[:3]) / (ball.sigma[:3] @ ball.sigma[:3])))}
            row |= {"z_radius": float(off[3] / ball.sigma[3]), "ball_mm": float(1000 * np.linalg.norm(off[:3]))}
        angle = np.degrees(np.arccos(np.clip(light.to_light @ to_light, -1, 1)))
        row |= {"angle": float(angle), "z_angle": float(angle / np.sqrt(2) / np.degrees(light.sigma))}
        for name, value, sd, true in (("E", light.E, light.E_sd, E / white), ("Ls", light.Ls, light.Ls_sd, Ls / white)):
            row |= {
                name: float((value / true - 1) @ REC_709),
                f"z_{name}": float((value - true) @ REC_709 / (sd @ REC_709)),
            }
        row["irradiance"] = irradiance_error(light, Ls / white, None if around is None else around / white)
        row |= drawn(found, folder, to_light, E / white, Ls / white, None if around is None else around / white)
    return rows


def irradiance_error(light, Ls: np.ndarray, around: np.ndarray | None) -> float:
    """Relative rms over normals that look up of the irradiance that the sky's upper half gives."""
    k = np.arange(400)
    z = (k + 0.5) / 400
    n = np.stack([np.sqrt(1 - z * z) * np.cos(2.399963 * k), np.sqrt(1 - z * z) * np.sin(2.399963 * k), z], axis=1)

    def of(map_: np.ndarray | None, constant: np.ndarray) -> np.ndarray:
        fine = (
            np.broadcast_to(constant, (64, 128, 3))
            if map_ is None
            else np.repeat(np.repeat(map_, 64 // len(map_), 0), 64 // len(map_), 1)
        )
        v, u = np.mgrid[:64, :128] + 0.5
        theta, turn = v * np.pi / 64, (u / 64 - 1) * np.pi
        d = np.stack([np.sin(theta) * np.sin(turn), np.sin(theta) * np.cos(turn), np.cos(theta)], axis=-1)[:32].reshape(
            -1, 3
        )
        return np.maximum(n @ d.T, 0) @ (fine[:32] * np.sin(theta)[:32, :, None]).reshape(-1, 3)

    true, found = of(around, Ls), of(light.around, light.Ls)
    return float(np.sqrt(((found / true - 1) ** 2).mean()))


def drawn(found, folder: Path, to_light: np.ndarray, E: np.ndarray, Ls: np.ndarray, around: np.ndarray | None) -> dict:
    """Codes rms on the orange ball: drawn under the light found, and under the true one, against the photo; and the two
    against each other."""
    photo = found.photos[0]
    pixels = []
    for sun, sky, map_ in ((found.light.E, found.light.Ls, found.light.around), (E, Ls, around)):
        direction = found.light.to_light if sun is found.light.E else to_light
        constant = Sky(tuple(sky))
        shown = constant if map_ is None else Environment(map_.shape[1::-1], map_.astype("<f4").tobytes())
        objects = ORANGE, sheet_of(draw_board(found.board, 500.0)[1]), TABLE
        scene = printed(
            scene_of("drawn", photo.camera, objects, (Sun(tuple(direction), tuple(sun)), shown)), found.board
        )
        result = augment(photo.pixels, scene, shadows=False, exposure=value_of_one(photo, found.paper))
        inside = result.coverage == 1
        pixels.append(result.pixels[inside].astype(float))
    real = photo.pixels[inside].astype(float)

    def rms(a, b):
        """Over the means of squares of 8 pixels, in which the photo's and the renderer's noise drop out."""
        off = np.zeros((*photo.pixels.shape[:2], 3))
        off[inside] = a - b
        weight = cv2.boxFilter(inside.astype(float), -1, (8, 8))
        mean = cv2.boxFilter(off, -1, (8, 8))[inside] / weight[inside, None]
        return float(np.sqrt((mean**2).mean()))

    return {"codes": rms(pixels[0], real), "codes_true": rms(pixels[1], real), "codes_between": rms(*pixels)}


COLUMNS = ("by", "sky", "lights", "sun, degrees", "worst", "z", "E", "z of E", "Ls", "z of Ls", "on a sphere",
           "codes", "true light")  # fmt: skip


def report(rows: list[dict], first: int) -> None:
    """A row per mode and kind of sky: root mean squares, of codes the median."""
    table = []
    for mode in MODES:
        for kind in (False, True):
            mine = [r for r in rows if r["mode"] == mode and r["map"] == kind]
            good = [r for r in mine if "angle" in r]
            column = {
                k: np.array([r[k] for r in good]) for k in (good[0] if good else ()) if k not in ("mode", "model")
            }
            if not good:
                continue
            rms = {k: float(np.sqrt((v**2).mean())) for k, v in column.items()}
            table.append((
                mode, "map" if kind else "constant", f"{len(good)} of {len(mine)}", f"{rms['angle']:.2f}",
                f"{column['angle'].max():.2f}", f"{rms['z_angle']:.2f}", f"{100 * rms['E']:.1f} %", f"{rms['z_E']:.2f}",
                f"{100 * rms['Ls']:.1f} %", f"{rms['z_Ls']:.2f}", f"{100 * rms['irradiance']:.1f} %",
                f"{np.median(column['codes']):.1f}", f"{np.median(column['codes_true']):.1f}",
            ))  # fmt: skip
    name = f"lights-{first}"
    record.table("light", name, COLUMNS, table, f"python -m measure.light_accuracy judge FOLDER --first {first}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["photos", "judge"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--samples", type=int, default=192)
    asked = parser.parse_args(record.arguments())
    for seed in range(asked.first, asked.first + asked.count):
        folder = asked.folder / f"{seed:02d}"
        if asked.what == "photos" and not (folder / "photos" / "truth.toml").exists():
            take(folder, seed, asked.samples)
            print(folder, flush=True)
    if asked.what == "judge":
        rows = []
        for seed in range(asked.first, asked.first + asked.count):
            if (asked.folder / f"{seed:02d}" / "photos" / "truth.toml").exists():
                rows += judge(asked.folder / f"{seed:02d}", seed)
                for row in rows[-len(MODES) :]:
                    print({k: round(v, 3) if isinstance(v, float) else v for k, v in row.items()}, flush=True)
        write_json(asked.folder / "judged.json", rows)
        report(rows, asked.first)


if __name__ == "__main__":
    main()
