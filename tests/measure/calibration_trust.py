"""How true a calibration's sigmas are, and what it predicts beside a plain cv2.calibrateCamera: a table, not a test.

    python -m measure.calibration_trust [SET...]

Each set is split 20 times at random into halves. z: by how many of their joint sigmas fx, fy, cx and cy of the two
calibrations differ (rms; 1 is honest); beside it between what sigmas that are true would put it in 95 of 100 sets, for
all splits are of the same photos. ratio: the median distance of a half's tags, as detected, from where the camera
calibrated from the other half says that they will be detected, over the same with five coefficients on a flat board by
OpenCV, which knows of no detector's bias; the tags' poses alone are fitted; the median over both ways and all splits,
and the worst. Then the same from where either camera sees the true centres: of tags as detected (a plain fit takes the
detector's bias for a little of the lens, and is rewarded for it), and of tags without that bias. Of synthetic sets the
whole's K stands beside the truth. Then z of two disjoint draws of 4, 6, 8 and 10 photos each, and the median of |z|
over what it is for true sigmas, 0.674: sigma of so few is itself uncertain, and its rms z has long tails.
"""

import json
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import cv2
import msgspec
import numpy as np
from photo_helpers import BOARD, PlainRenderer, a_camera

from raytwin import files
from raytwin.calib.boards import Board, BoardTag, Grid, read_board
from raytwin.calib.photos import Calibration, Tag, calibrate_detections, detect_photos
from raytwin.calib.photos.bias import unbiased
from raytwin.calib.photos.fit import ModelSpec, Sighting, fit, solve_scaled
from raytwin.calib.photos.model import degree_of
from raytwin.calib.synthetic_photos import Truth, photograph
from raytwin.scene import Camera
from raytwin.scene.lens import undone

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared" / "photos"
SPLITS = 20
FEW = (4, 6, 8, 10)
SPOILED = 4
INCH = 0.0254

Set = tuple[Board, dict[str, list[Tag]], tuple[int, int], Truth | None]


def stored(name: str, board: str) -> Set:
    """A set's stored detections, in OpenCV's pixels."""
    data = json.loads((SHARED / "boards.json").read_text())[board]
    tags = tuple(BoardTag(int(i), (x * INCH, y * INCH)) for i, (x, y) in data["centers_xy"].items())
    images = json.loads((SHARED / name / "detections.json").read_text())["images"]
    found = {
        photo: [
            Tag(
                t["id"],
                tuple(c - 0.5 for c in t["center"]),
                tuple(tuple(c - 0.5 for c in p) for p in t["corners"]),
                1.0,
            )
            for t in image["tags"]
        ]
        for photo, image in images.items()
    }
    return Board(data["family"], data["tag_black_edge"] * INCH, tags=tags), found, tuple(
        next(iter(images.values()))["size_wh"]
    ), None  # fmt: skip


def shipped() -> Set:
    folder = ROOT / "scenes" / "desk"
    board = read_board(folder / "board.toml")
    taken = sorted((folder / "photos").glob("*.jpg"))
    return board, by_name(detect_photos(taken, board.kind)[0]), files.photo_size(taken[0]), None


def by_name(found: Mapping[str, list[Tag]]) -> dict[str, list[Tag]]:
    return {Path(p).name: tags for p, tags in found.items()}


def taken(
    count: int,
    bend: float = 0.0,
    seed: int = 1,
    spoil: Callable[[np.ndarray, int], np.ndarray] | None = None,
    board: Board = BOARD,
    camera: Camera | None = None,
) -> Set:
    """Photos by the plain renderer, searched by the detector. `spoil(pixels, i)` changes the i-th photo."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        truth = photograph(board, camera or a_camera(), count, out, PlainRenderer(), seed=seed, bend=bend)
        photos = sorted(out.glob("*.jpg"))
        for i, photo in enumerate(photos):
            if spoil is not None:
                files.write_picture(photo, spoil(files.read_photo(photo), i))
        return board, by_name(detect_photos(photos, board.kind)[0]), truth.image_size, truth


def other(bend: float = 0.0, count: int = 12) -> Set:
    """Another board of few rows, a barrel lens with all five numbers, other poses."""
    board = Board("tag25h9", 0.024, Grid(6, 4, 0.034))
    return taken(count, bend, seed=77, board=board, camera=a_camera(1100, 900, (-0.21, 0.07, 0.0011, -0.0008, -0.012)))


def strong(bend: float = 0.0) -> Set:
    """Large tags under a strong lens: the detector's bias is several times its noise."""
    board = Board("tag36h11", 0.021, Grid(8, 5, 0.028))
    camera = a_camera(1280, 960, (0.15, -0.35, -0.0007, 0.0009, 0.2))
    return taken(16, bend, seed=123, board=board, camera=camera)


def held_back(bend: float = 0.0, spoil=None) -> Set:
    """Looked at once, when the method stood: to be replaced by another when it changes."""
    board = Board("tag36h11", 0.026, Grid(6, 6, 0.034))
    return taken(15, bend, seed=2026, spoil=spoil, board=board, camera=a_camera(1200, 800, (-0.11, 0.05, 0.0006)))


def blurred(pixels: np.ndarray, i: int) -> np.ndarray:
    return cv2.GaussianBlur(pixels, (0, 0), (0.3, 2.5, 1.0, 3.5)[i % 4])


def zoomed(pixels: np.ndarray, i: int) -> np.ndarray:
    """The fourth photo, cut at 85 % of its sides and enlarged again."""
    h, w = pixels.shape[:2]
    y, x = round(0.06 * h), round(0.1 * w)
    return cv2.resize(pixels[y : y + round(0.85 * h), x : x + round(0.85 * w)], (w, h)) if i == SPOILED else pixels


def turned(pixels: np.ndarray, i: int) -> np.ndarray:
    return np.ascontiguousarray(pixels[::-1, ::-1]) if i == SPOILED else pixels


SIZES = (1008, 756), (1200, 800), (756, 1008), (960, 720), (1280, 720)


def by_chance(seed: int, count: int = 14, bend: float = 0.0, spoil=None) -> Set:
    """A frame, a lens, a board and poses drawn at random: sets that nothing was tuned on."""
    rng = np.random.default_rng([20261122, seed])
    while True:
        size, k1 = SIZES[rng.integers(len(SIZES))], rng.uniform(-0.25, 0.15)
        f, (cx, cy) = max(size) * rng.uniform(0.65, 1.1), (np.array(size) - 1) / 2 + rng.normal(0, 0.01, 2) * size
        dist = (k1, -k1 * rng.uniform(0.2, 1.2), *rng.normal(0, 1e-3, 2), rng.uniform(-0.05, 0.05))
        dist = dist[: rng.choice([1, 2, 4, 5])]
        K = ((float(f), 0.0, float(cx)), (0.0, float(f * rng.uniform(0.998, 1.002)), float(cy)), (0.0, 0.0, 1.0))
        if not undone(K, dist, size).fault:
            break
    edge, columns, rows = rng.uniform(0.018, 0.04), *rng.integers(4, 9, 2).tolist()
    family = "tag25h9" if columns * rows <= 35 else "tag36h11"
    board = Board(family, float(edge), Grid(columns, rows, float(edge * rng.uniform(1.2, 1.35))))
    camera = msgspec.structs.replace(a_camera(*size), K=K, dist=tuple(map(float, dist)))
    return taken(count, bend, 5000 + seed, spoil, board, camera)


def foreign(count: int) -> Set:
    """One photo more, by a camera of a shorter lens."""
    board, tags, size, truth = taken(count)
    camera = a_camera()
    K = ((0.8 * camera.fx, 0.0, 490.0), (0.0, 0.8 * camera.fy, 390.0), (0.0, 0.0, 1.0))
    with tempfile.TemporaryDirectory() as folder:
        other = msgspec.structs.replace(camera, K=K, dist=(-0.05,))
        photograph(BOARD, other, 2, Path(folder), PlainRenderer(), seed=9)
        more = by_name(detect_photos([Path(folder) / "photo_01.jpg"], BOARD.kind)[0])
    return board, tags | {"foreign": more["photo_01.jpg"]}, size, truth


def wrong_tags(count: int, bend: float = 0.0) -> Set:
    """Every thirtieth tag has another one's id."""
    board, tags, size, truth = taken(count, bend)
    rng = np.random.default_rng(3)
    spoiled = {}
    for photo, found in tags.items():
        missing = [i for i in board.centers() if i not in {t.id for t in found}] or [found[0].id]
        spoiled[photo] = [
            msgspec.structs.replace(t, id=int(rng.choice(missing))) if rng.uniform() < 1 / 30 else t for t in found
        ]
    return board, spoiled, size, truth


SETS: dict[str, Callable[[], Set]] = {
    "april_fine": lambda: stored("april_fine", "fine"),
    "desk_tilted": lambda: stored("desk_tilted", "coarse"),
    "desk_degenerate": lambda: stored("desk_degenerate", "coarse"),
    "shipped": shipped,
    "bend 0, 14": lambda: taken(14),
    "bend 0.5, 14": lambda: taken(14, 0.5e-3),
    "bend 1, 14": lambda: taken(14, 1e-3),
    "bend 3, 14": lambda: taken(14, 3e-3),
    "bend 0, 8": lambda: taken(8, seed=2),
    "bend 1, 20": lambda: taken(20, 1e-3, seed=3),
    "blur, 14": lambda: taken(14, spoil=blurred),
    "blur, bend 1, 14": lambda: taken(14, 1e-3, spoil=blurred),
    "wrong tags, 14": lambda: wrong_tags(14),
    "zoomed, 14": lambda: taken(14, spoil=zoomed),
    "turned, 14": lambda: taken(14, spoil=turned),
    "foreign, 14": lambda: foreign(14),
    "other, bend 0, 12": other,
    "other, bend 2, 12": lambda: other(2e-3),
    "other, bend 0, 24": lambda: other(count=24),
    "strong, bend 0": strong,
    "strong, bend 1.2": lambda: strong(1.2e-3),
    "held back, bend 0": held_back,
    "held back, bend 3": lambda: held_back(3e-3),
    "held back, turned": lambda: held_back(spoil=turned),
}
for _seed in range(5):
    SETS |= {f"chance {_seed}, bend {b}": partial(by_chance, _seed, bend=1e-3 * b) for b in (0, 1, 3)}
    SETS |= {f"chance {_seed}, {f.__name__}": partial(by_chance, _seed, spoil=f) for f in (blurred, zoomed, turned)}
    SETS |= {f"chance {_seed}, {n} photos": partial(by_chance, _seed, n) for n in (8, 20)}


def plain(tags: Mapping[str, Sequence[Tag]], size: tuple[int, int], board: Board) -> tuple[np.ndarray, np.ndarray]:
    """K and five coefficients by cv2.calibrateCamera, of every photo with four tags."""
    points = [board.points(t.id for t in found).astype(np.float32) for found in tags.values()]
    pixels = [np.array([t.center for t in found], np.float32) for found in tags.values()]
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 1000, 1e-10)
    _, K, dist, _, _ = cv2.calibrateCamera(points, pixels, size, None, None, criteria=criteria)
    return K, dist.ravel()


def distances(
    tags: Mapping[str, Sequence[Tag]], board: Board, K: np.ndarray, dist: Sequence[float], straight: bool = False
) -> np.ndarray:
    """Of every tag from where the camera sees it, in pixels, the photos' poses alone being fitted.

    `straight`: of the tags without the detector's bias, as this camera tells it.
    """
    K, dist, found = np.array(K), np.array([*dist, *(0.0,) * (5 - len(dist))]), []
    for seen in tags.values():
        points, pixels = board.points(t.id for t in seen), np.array([t.center for t in seen])
        _, turn, shift = cv2.solvePnP(board.flat().points(t.id for t in seen), pixels, K, dist)
        turn, shift = cv2.solvePnPRefineLM(points, pixels, K, dist, turn, shift)
        if straight:
            tags_there = unbiased(seen, board, cv2.Rodrigues(turn)[0], shift.ravel(), K, dist)
            pixels = np.array([t.center for t in tags_there])
            turn, shift = cv2.solvePnPRefineLM(points, pixels, K, dist, turn, shift)
        found.append(np.linalg.norm(cv2.projectPoints(points, turn, shift, K, dist)[0][:, 0] - pixels, axis=1))
    return np.concatenate(found)


def of_true_sigmas(whole: Calibration, tags: Mapping, board: Board, splits: Sequence, draws: int = 400) -> np.ndarray:
    """(2,): between which the rms z of these splits (each two lists of photos' numbers) lies in 95 of 100 sets, were
    sigma true: g_i ~ N(0, H_i) for each photo, to first order."""
    views = [Sighting(photo, tuple(tags[photo])) for photo in sorted(tags)]
    degree = degree_of(whole.basis.taken)
    H = fit(views, whole.image_size, [board], ModelSpec(whole.model, degree)).H
    rng, m = np.random.default_rng(1), H.shape[1]
    scale = 1 / np.sqrt(np.maximum(np.diagonal(H, axis1=1, axis2=2), 1e-300))
    size, axes = np.linalg.eigh(H * scale[:, :, None] * scale[:, None])
    root = axes * np.sqrt(np.maximum(size, 0))[:, None] / scale[..., None]
    g = np.einsum("vij,vdj->vdi", root, rng.standard_normal((len(H), draws, m)))
    squares = np.zeros(draws)
    for halves in splits:
        C = [solve_scaled(H[half].sum(axis=0), np.eye(m)) for half in halves]
        apart = sum(sign * g[half].sum(axis=0) @ c for sign, half, c in zip((1, -1), halves, C, strict=True))
        squares += (apart[:, :4] ** 2 / np.diag(sum(C))[:4]).mean(axis=1)
    return np.quantile(np.sqrt(squares / len(splits)), (0.025, 0.975))


def four(c: Calibration) -> np.ndarray:
    return np.array([c.K[0][0], c.K[1][1], c.K[0][2], c.K[1][2]])


def z_between(found: Sequence[Calibration]) -> np.ndarray:
    """(4,): by how many of their joint sigmas fx, fy, cx, cy of two calibrations differ."""
    return (four(found[0]) - four(found[1])) / np.hypot(
        *([c.sigma[n] for n in ("fx", "fy", "cx", "cy")] for c in found)
    )


def of_few(tags: Mapping, board: Board, size: tuple[int, int]) -> str:
    rng, names, told = np.random.default_rng(0), sorted(tags), []
    for n in FEW:
        if 2 * n <= len(names):
            draws = [rng.permutation(len(names)) for _ in range(SPLITS)]
            halves = [[{names[i]: tags[names[i]] for i in part} for part in (d[:n], d[n : 2 * n])] for d in draws]
            z = [z_between([calibrate_detections(seen, size, board) for seen in both]) for both in halves]
            told.append(f"{np.sqrt(np.mean(np.square(z))):.2f} ({np.median(np.abs(z)) / 0.6745:.2f}) of {n}")
    return "    z " + ", ".join(told)


def measure(name: str) -> str:
    board, tags, size, truth = SETS[name]()
    known = board.centers()
    tags = {p: [t for t in seen if t.id in known] for p, seen in tags.items()}
    tags = {p: seen for p, seen in tags.items() if len(seen) >= 6}
    begin = time.perf_counter()
    whole = calibrate_detections(tags, size, board)
    seconds = time.perf_counter() - begin
    rng = np.random.default_rng(0)
    names = sorted(tags)
    z, ratios, raw, straightened = [], [], [], []
    splits = [np.array_split(rng.permutation(len(names)), 2) for _ in range(SPLITS)]
    for split in splits:
        halves = [{names[i]: tags[names[i]] for i in part} for part in split]
        found = []
        for seen, unseen in (halves, halves[::-1]):
            c = calibrate_detections(seen, size, board)
            theirs = plain(seen, size, board)
            ours, plains = (
                [float(np.median(distances(unseen, b, K, dist, straight))) for straight in (False, True)]
                for b, K, dist in ((c.shaped(board), c.K, c.dist), (board, *theirs))
            )
            ratios.append(ours[1] / plains[0])
            raw.append(ours[0] / plains[0])
            straightened.append(ours[1] / plains[1])
            found.append(c)
        z.append(z_between(found))
    square = np.square(z)
    bend = ", ".join(f"{b.bend_mm:.2f} ± {b.bend_sigma_mm:.2f} mm" for b in whole.boards if b.heights) or "flat"
    each = " ".join(f"{v:.2f}" for v in np.sqrt(square.mean(axis=0)))
    low, high = of_true_sigmas(whole, tags, board, splits)
    row = [
        f"{name:<18} {len(tags):>3} photos  {whole.evidence.taken:<16} {bend:<16} rms {whole.rms_px:.3f} px, "
        f"{seconds:.2f} s",
        f"    z {np.sqrt(square.mean()):.2f} ({each}), true sigmas' {low:.2f} to {high:.2f}"
        f"  ratio {np.median(ratios):.3f}, worst {max(ratios):.3f}; of true centres to tags as detected "
        f"{np.median(raw):.3f}, without bias {np.median(straightened):.3f}",
    ]
    sigma = np.array([whole.sigma[n] for n in ("fx", "fy", "cx", "cy")])
    if truth is not None:
        true = np.array([truth.K[0][0], truth.K[1][1], truth.K[0][2], truth.K[1][2]])
        row.append(
            "    off by " + "  ".join(f"{d:+.2f} ± {s:.2f}" for d, s in zip(four(whole) - true, sigma, strict=True))
        )
    else:
        row.append("    K " + "  ".join(f"{v:.1f} ± {s:.2f}" for v, s in zip(four(whole), sigma, strict=True)))
    row += [of_few(tags, board, size), *(f"    {w.code}: {w.text}" for w in whole.warnings)]
    return "\n".join(row)


if __name__ == "__main__":
    for asked in sys.argv[1:] or SETS:
        print(measure(asked), flush=True)
