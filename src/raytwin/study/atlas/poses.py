"""Where a camera stood, from one photo of a board: the homography's pose, OpenCV's, and raytwin's, beside the least
error that the tags' noise allows (Cramér and Rao)."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from raytwin.errors import InputError
from raytwin.photos.boards import Board, BoardTag, Grid
from raytwin.photos.camera import Tag, project, refined_pose
from raytwin.photos.camera.lens_model import linearise, of_pose
from raytwin.photos.camera.pose import ambiguous
from raytwin.study.atlas.experiment import Error, Experiment

BOARD = Board("tag36h11", 0.001, Grid(5, 7, 0.038))
"""Tags so small that no lens bends their edges: their centres are seen without bias."""

SIZE = (1008, 756)
K = ((780.0, 0.0, 504.0), (0.0, 780.0, 378.0), (0.0, 0.0, 1.0))
MIDDLE = np.append(np.mean(list(BOARD.centers().values()), axis=0), 0.0)

OURS = "least squares: raytwin"
HOMOGRAPHY = "homography"


@dataclass(frozen=True)
class BoardPhoto:
    """A photo: the board leans by `tilt` degrees, its middle `distance` m away; `noise` px (sd) of a tag's coordinate;
    `tags` of the board's 35 are seen; across their longest line they are drawn together to `narrow` of it."""

    tilt: float = 30.0
    distance: float = 0.6
    noise: float = 0.3
    tags: int = 35
    narrow: float = 1.0

    def points(self, rng: np.random.Generator) -> dict[int, np.ndarray]:
        """Board points by id."""
        ids = sorted(rng.permutation(35)[: self.tags].tolist()) if self.tags < 35 else range(35)
        centers = BOARD.centers()
        middle = MIDDLE[:2]
        found = {i: (np.array(centers[i]) - middle) * (self.narrow, 1) + middle for i in ids}
        return {i: np.append(p, 0.0) for i, p in found.items()}

    def pose(self, azimuth: float) -> tuple[np.ndarray, np.ndarray]:
        lean = math.radians(self.tilt) * np.array([math.cos(azimuth), math.sin(azimuth), 0])
        R = Rotation.from_rotvec(lean).as_matrix() @ np.diag([1.0, -1, -1])
        return R, np.array([0, 0, self.distance]) - R @ MIDDLE


def turn_of(R: np.ndarray, true: np.ndarray) -> float:
    """Radians."""
    return float(Rotation.from_matrix(R @ true.T).magnitude())


def least_turn(photo: BoardPhoto, points: np.ndarray, azimuth: float) -> float:
    """√ tr of the rotation's part of σ² (JᵀJ)⁻¹: the least rms angle of any unbiased pose, radians."""
    R, t = photo.pose(azimuth)
    seen = points @ R.T + t
    _, _, of_point = linearise(seen, np.zeros((len(seen), 2)), np.array(K), ())
    J = of_pose(seen, of_point).reshape(-1, 6)
    return photo.noise * math.sqrt(np.trace(np.linalg.pinv(J.T @ J)[:3, :3]))


def trials(
    photo: BoardPhoto, rng: np.random.Generator, n: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, Board, Any]]:
    """(true R, points, pixels, board, tags) of n photos."""
    for _ in range(n):
        azimuth = rng.uniform(0, 2 * math.pi)
        chosen = photo.points(rng)
        R, t = photo.pose(azimuth)
        points = np.array(list(chosen.values()))
        pixels = project(points, R, t, K, ()) + rng.normal(0, photo.noise, (len(points), 2))
        tags = [Tag(i, (u, v), ((u, v),) * 4) for i, (u, v) in zip(chosen, pixels.tolist(), strict=True)]
        yield R, points, pixels, board_of(chosen), tags


def board_of(points: dict[int, np.ndarray]) -> Board:
    return Board("tag36h11", 0.001, tags=tuple(BoardTag(i, (float(p[0]), float(p[1]))) for i, p in points.items()))


def homography_turn(points: np.ndarray, pixels: np.ndarray) -> np.ndarray | None:
    """The rotation nearest to a homography's columns r1, r2 and r1 x r2, as the paper takes it; None without one.

    K^-1 H ~ (r1 r2 t), scaled so that |r1| |r2| = 1. Zhang, A flexible new technique (2000), section 3.1, appendix C.
    """
    H, _ = cv2.findHomography(points[:, :2], pixels)
    if H is None:
        return None
    H = np.linalg.solve(K, H)
    H = H / math.sqrt(np.linalg.norm(H[:, 0]) * np.linalg.norm(H[:, 1]))
    r1, r2, _ = H.T * np.sign(H[2] @ [*points[:, :2].mean(axis=0), 1.0])  # the board is in front of the camera
    U, _, Vt = np.linalg.svd(np.stack([r1, r2, np.cross(r1, r2)], axis=1))
    return np.asarray(U @ Vt)


def errors(photo: BoardPhoto, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """The rms angle over n photos; raytwin's over those not called ambiguous, None where most are."""
    squares: dict[str, list[float]] = {HOMOGRAPHY: [], "OpenCV's IPPE": [], "OpenCV's iterative": [], OURS: []}
    doubted = 0
    for R, points, pixels, board, tags in trials(photo, rng, n):
        try:
            pose, ambiguity = refined_pose(K, (), tags, board)
        except InputError:  # tags in one line
            doubted += 1
            continue
        turn = homography_turn(points, pixels)
        squares[HOMOGRAPHY].append(math.pi**2 if turn is None else turn_of(turn, R) ** 2)
        for name, flag in (("OpenCV's IPPE", cv2.SOLVEPNP_IPPE), ("OpenCV's iterative", cv2.SOLVEPNP_ITERATIVE)):
            found, rvec, _ = cv2.solvePnP(points, pixels, np.array(K), None, flags=flag)
            squares[name].append(turn_of(cv2.Rodrigues(rvec)[0], R) ** 2 if found else math.pi**2)
        if ambiguous(ambiguity, len(points)):
            doubted += 1
        else:
            squares[OURS].append(turn_of(np.array(pose.R_cam_board), R) ** 2)
    rms: dict[str, Error] = {name: math.sqrt(float(np.mean(s))) if s else None for name, s in squares.items()}
    return rms | ({OURS: None} if doubted > n / 2 else {})


ANGLE, BOUND = "rms angle from the true pose, radians", 0.02
SOURCE = "Collins and Bartoli, Infinitesimal plane-based pose estimation (2014); Zhang, A flexible new technique (2000)"


def over_photos(
    name: str, title: str, parameter: str, values: tuple[float, ...], photo: Callable[[float], BoardPhoto], why: str,
    **options: Any,
) -> Experiment:  # fmt: skip
    """Return an experiment over the photos `photo(parameter)`. Its law is the best pose's error, averaged over four
    sides that the board leans to."""

    def law(x: float) -> float:
        rng = np.random.default_rng(0)
        of = [least_turn(s := photo(x), np.array(list(s.points(rng).values())), k * math.pi / 4) for k in range(4)]
        return math.sqrt(float(np.mean(np.square(of))))

    return Experiment(
        name, title, parameter, ANGLE, BOUND, values, lambda x, rng, n: errors(photo(x), rng, n), (OURS,), why,
        SOURCE, {OURS: law}, **options,
    )  # fmt: skip


EXPERIMENTS = (
    over_photos(
        "pose-noise", "A pose from noisy tags", "noise of a tag's coordinate, pixels",
        (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0), lambda x: BoardPhoto(noise=x),
        "No unbiased pose errs less than the bound of Cramér and Rao, which grows with the noise, and least squares "
        "reach it. The homography minimises an error that is not the pixels', and can bear a third of the noise.",
        limit=1.0, slack=2, trials=12,
    ),
    over_photos(
        "pose-tags", "A pose from few tags", "tags", (35.0, 20.0, 12.0, 8.0, 6.0, 5.0, 4.0),
        lambda x: BoardPhoto(tags=round(x)),
        "Four tags hold two numbers more than a pose has, so that the wrong one of a plane's two poses may fit as well "
        "by chance, and three in a line leave the homography open. How much better the first must fit is told by "
        "Fisher's F; from four tags that is 32 times, and most photos are called ambiguous.",
        trials=16,
    ),
    over_photos(
        "pose-tilt", "A board that faces the camera", "tilt, degrees", (45.0, 30.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.1),
        lambda x: BoardPhoto(tilt=x),
        "Seen straight on, a small turn of the board changes only how its far edge shrinks, and a plane's two poses "
        "come together; IPPE's first one is then off by degrees. Least squares from it, on pixels, hold the bound.",
        trials=12,
    ),
    over_photos(
        "pose-far", "A board that is far away", "distance, m", (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0),
        lambda x: BoardPhoto(distance=x),
        "Far away perspective fades, and with it what tells a plane's two poses apart: from some 5 m on, noise chooses "
        "between them, and every method returns the wrong one half of the time. raytwin says so instead.",
        trials=12,
    ),
    over_photos(
        "pose-line", "Tags that lie nearly in a line", "width of the board / its own",
        (1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001), lambda x: BoardPhoto(narrow=x),
        "About a line of tags the board may turn freely: the error grows as the line's width falls. Where tags are in "
        "one line to 1 in 1000 the pose is refused, before that it is called ambiguous.",
        trials=12,
    ),
)  # fmt: skip
