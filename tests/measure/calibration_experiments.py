"""A camera from photos of a board, driven until it cannot be told: the real error beside the one that is stated, and
whether raytwin says so."""

import math
from collections.abc import Callable, Iterator
from functools import lru_cache

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from raytwin.atlas.experiment import Error, Experiment, Measure
from raytwin.atlas.poses import BOARD, MIDDLE
from raytwin.calib import photos
from raytwin.calib.photos import Tag, project
from raytwin.calib.photos.fit import MODELS
from raytwin.calib.photos.lens_model import linearise, of_pose
from raytwin.errors import InputError

SIZE, DIST = (1008, 756), (0.08, -0.16)
K = ((780.0, 0.0, 508.0), (0.0, 781.0, 375.0), (0.0, 0.0, 1.0))
VIEWS, NOISE = 12, 0.1

Stand = tuple[np.ndarray, np.ndarray]
Photos = dict[str, list[Tag]]

SERIOUS = frozenset(photos.CODES) - {"outlier-tags", "bent-board"}
"""Warnings that say more than what was mended: a rejected tag and a bend that was fitted do no harm any more."""


def stands(rng: np.random.Generator, count: int = VIEWS, tilt: float | None = None, share: float = 1.0) -> list[Stand]:
    """`count` poses; all tilted by `tilt` degrees, or by 10 to 45; the board within `share` of the frame, about its
    middle."""
    found = []
    for i in range(count):
        lean = math.radians(rng.uniform(10, 45) if tilt is None else tilt)
        side = 2.4 * i + rng.normal(0, 0.2)
        R = Rotation.from_rotvec([0, 0, rng.normal(0, 0.2)]) * Rotation.from_rotvec(
            lean * np.array([math.cos(side), math.sin(side), 0])
        )
        turned = R.as_matrix() @ np.diag([1.0, -1, -1])
        away = 0.33 / share * rng.uniform(1, 1.2)
        place = np.array([*(share * rng.uniform(-0.14, 0.14, 2) * away), away])
        found.append((turned, place - turned @ MIDDLE))
    return found


def shot(
    poses: list[Stand], rng: np.random.Generator, noise: float = NOISE, height: Callable[..., np.ndarray] | None = None
) -> Photos:
    """What is seen of the board from each; `height` (x, y) -> metres: how it is bent."""
    ids = list(BOARD.centers())
    points = BOARD.points(ids)
    if height is not None:
        points[:, 2] = height(points[:, 0], points[:, 1])
    found = {}
    for i, (R, t) in enumerate(poses):
        pixels = project(points, R, t, K, DIST)
        pixels = pixels + rng.normal(0, noise, pixels.shape)
        inside = np.all((pixels > 2) & (pixels < np.array(SIZE) - 3), axis=1).tolist()
        found[f"{i:02d}"] = [tag(n, p) for n, p, ok in zip(ids, pixels, inside, strict=True) if ok]
    return found


def tag(number: int, pixel: np.ndarray) -> Tag:
    place = float(pixel[0]), float(pixel[1])
    return Tag(number, place, (place,) * 4, 100.0)


def judged(seen: Photos, model: str = "k1k2", size: tuple[int, int] = SIZE) -> dict[str, Error]:
    """The relative error of the focal length (the worse of both): OpenCV's, raytwin's, the three sigmas that raytwin
    states, and raytwin's where it gives no warning."""
    found: dict[str, Error] = {OPENCV: opencv(seen)}
    try:
        made = photos.calibrate_detections(seen, size, BOARD, model)
    except InputError:
        return found | {"raytwin": None, STATED: None, UNWARNED: None}
    off = max(abs(made.K[i][i] / K[i][i] - 1) for i in (0, 1))
    stated = 3 * max(made.sigma[n] / f for n, f in (("fx", made.K[0][0]), ("fy", made.K[1][1])))
    warned = {w.code for w in made.warnings} & SERIOUS
    return found | {"raytwin": off, STATED: stated, UNWARNED: None if warned else off}


OPENCV, STATED, UNWARNED = "OpenCV's calibrateCamera", "three sigmas, as stated", "raytwin, where it does not warn"


def opencv(seen: Photos) -> float:
    points = [BOARD.points([t.id for t in tags]).astype(np.float32) for tags in seen.values()]
    pixels = [np.array([t.center for t in tags], np.float32) for tags in seen.values()]
    found = cv2.calibrateCamera(points, pixels, SIZE, None, None, flags=cv2.CALIB_FIX_TANGENT_DIST | cv2.CALIB_FIX_K3)[
        1
    ]
    return float(max(abs(found[i, i] / K[i][i] - 1) for i in (0, 1)))


def mean(rows: Iterator[dict[str, Error]]) -> dict[str, Error]:
    """The rms over several sets; None where most are."""
    every = list(rows)
    found: dict[str, Error] = {}
    for name in every[0]:
        given = [e for row in every if (e := row[name]) is not None]
        found[name] = math.sqrt(float(np.mean(np.square(given)))) if 2 * len(given) > len(every) else None
    return found


def sets(make: Callable[[float, np.random.Generator], Photos]) -> Measure:
    """What judges n sets that `make` makes of the parameter."""
    return lambda x, rng, n: mean(judged(make(x, rng)) for _ in range(n))


@lru_cache(maxsize=4096)
def least(tilt: float | None, count: int, noise: float, share: float) -> float:
    """σ √(S⁻¹)_ff / f, S what the views tell of the camera once each one's pose is taken out: Cramér and Rao."""
    rng, S = np.random.default_rng(5), np.zeros((6, 6))
    points = BOARD.points(BOARD.centers())
    for R, t in stands(rng, count, tilt, share):
        seen = points @ R.T + t
        _, of_lens, of_point = linearise(seen, np.zeros((len(seen), 2)), np.array(K), DIST, MODELS["k1k2"])
        A, B = of_lens.reshape(-1, 6), of_pose(seen, of_point).reshape(-1, 6)
        S += A.T @ (A - B @ np.linalg.lstsq(B, A, rcond=None)[0])
    scale = np.sqrt(np.diag(S))
    covariance = np.linalg.inv(S / np.outer(scale, scale)) / np.outer(scale, scale)
    return noise * math.sqrt(max(covariance[0, 0], covariance[1, 1])) / 780


def spoiled(x: float, rng: np.random.Generator) -> Photos:
    """The share x of the tags lies 20 px off, in any direction."""
    seen = shot(stands(rng), rng)
    for tags in seen.values():
        for k in np.flatnonzero(rng.random(len(tags)) < x).tolist():
            turn = rng.uniform(0, 2 * math.pi)
            tags[k] = tag(tags[k].id, tags[k].center + 20 * np.array([math.cos(turn), math.sin(turn)]))
    return seen


def foreign(x: float, rng: np.random.Generator) -> Photos:
    """One photo of the twelve was zoomed by the factor 1 + x, about its middle."""
    seen = shot(stands(rng), rng)
    middle = np.array([503.5, 377.5])
    near = [tag(t.id, middle + (np.array(t.center) - middle) * (1 + x)) for t in seen["03"]]
    return seen | {"03": [t for t in near if all(2 < c < side - 3 for c, side in zip(t.center, SIZE, strict=True))]}


def left_out(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """All pixels are x to the right: error of the centre, in focal lengths."""
    seen = {p: [tag(t.id, np.add(t.center, (x, 0))) for t in tags] for p, tags in shot(stands(rng), rng, 0.01).items()}
    made = photos.calibrate_detections(seen, SIZE, BOARD, "k1k2")
    return {"raytwin": abs(made.K[0][2] - K[0][2]) / 780, STATED: 3 * made.sigma["cx"] / 780}


def bowed(x: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """x mm from the middle of the board to its sides: no polynomial, so none that the fit could find exactly."""
    return lambda a, b: 1e-3 * x / 2 * (1 + np.cos(np.pi * (a - MIDDLE[0]) / 0.12))


ERROR, BOUND = "relative error of the focal length", 0.01
ZHANG = "Zhang, A flexible new technique for camera calibration (2000), section 5; Sturm and Maybank (1999)"
NAMES = OPENCV, "raytwin"

EXPERIMENTS = (
    Experiment(
        "calibration-tilt", "Calibrating from boards that hardly lean", "tilt of every view, degrees", ERROR, BOUND,
        (45.0, 25.0, 10.0, 5.0, 2.0, 1.0), sets(lambda x, rng: shot(stands(rng, tilt=x), rng)), (UNWARNED,),
        "A board seen straight on looks the same from twice as far with twice the focal length; only its lean tells "
        "them apart, with the square of its angle. No fit can do better than Cramér and Rao's bound, so raytwin states "
        "its sigma and warns.",
        ZHANG, dict.fromkeys(NAMES, lambda x: least(x, VIEWS, NOISE, 1.0)), slack=2.4, trials=2, many=20,
    ),
    Experiment(
        "calibration-views", "Calibrating from few photos", "photos", ERROR, BOUND, (30.0, 12.0, 8.0, 5.0, 4.0, 3.0),
        sets(lambda x, rng: shot(stands(rng, round(x)), rng)), (UNWARNED,),
        "Three photos determine a camera, and leave nothing to check it with: the residual falls as photos are taken "
        "away, while the error grows. With fewer than eight raytwin warns.",
        ZHANG, dict.fromkeys(NAMES, lambda x: least(None, round(x), NOISE, 1.0)), trials=2, many=20,
    ),
    Experiment(
        "calibration-coverage", "Calibrating from the middle of the frame",
        "share of the frame that the board moves in", ERROR,
        BOUND, (1.0, 0.5, 0.25, 0.1, 0.05), sets(lambda x, rng: shot(stands(rng, share=x), rng)), (UNWARNED,),
        "A small board in the middle sees almost no perspective, and none of the lens's bend. The error grows faster "
        "than the board shrinks, and the residual does not show it.",
        ZHANG, dict.fromkeys(NAMES, lambda x: least(None, VIEWS, NOISE, x)), slack=4, trials=2, many=20,
    ),
    Experiment(
        "calibration-noise", "Calibrating from noisy tags", "noise of a tag's coordinate, pixels", ERROR, BOUND,
        (0.03, 0.1, 0.3, 1.0, 3.0, 10.0), sets(lambda x, rng: shot(stands(rng), rng, x)), (UNWARNED,),
        "The error is proportional to the noise, and three stated sigmas hold it. Where these pass two per cent "
        "raytwin warns, and outliers are told from the noise by its own size.",
        ZHANG, dict.fromkeys(NAMES, lambda x: least(None, VIEWS, x, 1.0)), limit=1.0, slack=4, trials=2, many=20,
    ),
    Experiment(
        "calibration-wrong", "Tags that lie elsewhere", "share of tags that are 20 px off", ERROR, BOUND,
        (0.001, 0.003, 0.01, 0.03, 0.1, 0.3), sets(spoiled), (UNWARNED,),
        "Least squares believe every tag, and one that is 20 px off pulls two hundred times as hard as the noise. "
        "raytwin leaves out what disagrees with the median of all, and says which tags these were.",
        "Huber, Robust Statistics (1981)", trials=2, many=20,
    ),
    Experiment(
        "calibration-bend", "A board that is bent", "bend, mm on 25 cm", ERROR, BOUND,
        (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0),
        sets(lambda x, rng: shot(stands(rng), rng, height=bowed(x))), (UNWARNED,),
        "A sheet of paper bends by a millimetre, and a fit that takes it for flat puts the bend into the camera. "
        "raytwin fits the board's shape along with it where that predicts photos better, and says how much it found.",
        "Strobl and Hirzinger, More accurate pinhole camera calibration with imperfect planar target (2011)",
        limit=3.0, trials=2, many=20,
    ),
    Experiment(
        "calibration-foreign", "A photo from another camera among twelve", "its zoom, less 1", ERROR, BOUND,
        (0.003, 0.01, 0.03, 0.1, 0.3, 1.0), sets(foreign), (UNWARNED,),
        "One zoomed photo pulls the focal length by its share of what is known, about a twelfth of its zoom, and hides "
        "in the residual of all. raytwin leaves out each photo in turn, and names the one that is at odds with the "
        "rest.",
        "Bell and McCaffrey, Bias reduction in standard errors with multi-stage samples (2002)",
        {OPENCV: lambda x: x / VIEWS}, slack=3, trials=2, many=20,
    ),
    Experiment(
        "calibration-pixel", "A pixel convention that is not the camera's", "pixels left out",
        "error of the centre, focal lengths",
        BOUND, (0.01, 0.03, 0.1, 0.3, 0.5, 1.0, 3.0, 10.0, 30.0), left_out, (),
        "AprilTag counts pixels from the corner and OpenCV from the middle of the first: half a pixel left out moves "
        "the centre by half a pixel, exactly, and nothing in the photos can tell. So no method here holds; raytwin's "
        "own detector converts, and one convention holds everywhere.",
        "OpenCV, camera calibration; AprilTag 3, user guide", {"raytwin": lambda x: x / 780}, slack=1.5, trials=1,
        many=1,
    ),
)  # fmt: skip
