"""What the paper's pipeline draws, each picture against its truth, on photos whose camera is found, not given.

"An Image Augmentation Pipeline With Customized Data For AR Education": a transparent pyramid, one sphere, several that
overlap, high-resolution speculation, trimming by bounding boxes. The photos are synthetic; their truth is the same
photo taken with the objects really there, or a renderer that shares no code with the one under test.
"""

import shutil
from functools import partial

import msgspec
import numpy as np
import pytest

from raytwin import files, twin
from raytwin.calib import boards, photos, synthetic_photos
from raytwin.calib.photos.lens_model import project, undistort
from raytwin.scene import Camera, Pyramid, WrittenSphere
from raytwin.speed import trace
from raytwin.speed.speculation import speculate
from raytwin.workflows.augment_photos import augment_photos
from raytwin.workflows.photograph import photograph_board

SIZE, COUNT = (504, 378), 3
ONE = (WrittenSphere((0.05, 0.09, 0.03), 0.03, (0.75, 0.3, 0.2)),)
SEVERAL = (
    WrittenSphere((0.05, 0.09, 0.03), 0.03, (0.75, 0.3, 0.2)),
    WrittenSphere((0.085, 0.105, 0.024), 0.024, (0.2, 0.45, 0.7)),
    WrittenSphere((0.07, 0.06, 0.02), 0.02, (0.3, 0.6, 0.25)),
)
PYRAMID = Pyramid(
    ((0.02, 0.04, 0.0), (0.13, 0.05, 0.0), (0.07, 0.16, 0.0), (0.075, 0.085, 0.09)), (0.1, 0.5, 0.9), 0.35
)


@pytest.fixture(scope="module")
def studio(scenes, tmp_path_factory):
    """`studio(spheres)`: a folder whose scene has these spheres, photos of the board without them and, if any, with."""
    twin.activate()
    made = {}
    desk = files.read_toml(scenes / "desk" / "scene.toml")
    board = boards.read_board(scenes / "desk" / "board.toml")
    take = partial(photograph_board, count=COUNT, size=SIZE, samples=8)

    def make(spheres: tuple[WrittenSphere, ...], pyramids: tuple[Pyramid, ...] = ()):
        if (spheres, pyramids) in made:
            return made[spheres, pyramids]
        folder = tmp_path_factory.mktemp("studio")
        boards.write_board(folder / "board.toml", board)
        text = {k: v for k, v in desk.items() if k not in ("spheres", "pyramids")}
        text["spheres"] = files.plain(spheres)
        if pyramids:
            text["pyramids"] = files.plain(pyramids)
        files.write_toml(folder / "scene.toml", text)
        if made:  # of the bare board, whatever is drawn on it
            shutil.copytree(next(iter(made.values())) / "photos", folder / "photos")
        else:
            take(folder / "board.toml", folder / "photos", scene=folder)
        if spheres:
            take(folder / "board.toml", folder / "with", scene=folder, with_objects=True)
        made[spheres, pyramids] = folder
        return folder

    return make


def augmented(folder, truth: str = "with"):
    """Each photo drawn on, its truth, and the errors by region; the camera is calibrated from the photos."""
    camera, board = folder / "camera.toml", boards.read_board(folder / "board.toml")
    taken = files.list_photos(folder / "photos")
    found = photos.calibrate(taken, board, "k1k2")
    files.write_camera(camera, photos.camera_of_photo(found, taken[0], board))
    rows = augment_photos(taken, folder, folder / "drawn", camera=camera, against=folder / truth)
    return [(files.read_photo(folder / "drawn" / p.name), files.read_photo(folder / truth / p.name), row)
            for p, row in zip(taken, rows, strict=True)]  # fmt: skip


def region(row: dict, name: str) -> dict:
    return next(part for part in row["regions"] if part["region"] == name)


def true_cameras(folder) -> dict:
    truth = synthetic_photos.read_truth(folder / "photos" / "truth.toml")
    return {name: Camera(truth.image_size, truth.K, R, t, truth.dist) for name, (R, t) in truth.photos.items()}


@pytest.mark.parametrize("spheres", [ONE, SEVERAL], ids=["one", "several"])
def test_drawn_spheres_look_as_if_they_had_been_there(studio, spheres):
    for drawn, true, row in augmented(studio(spheres)):
        # Light that goes from sphere to sphere and to the board is missing: a few codes of 255.
        assert region(row, "all")["codes"] < 3.5
        assert region(row, "spheres")["share"] > 0.01
        assert region(row, "spheres")["codes"] < 14
        assert drawn.shape == true.shape == (SIZE[1], SIZE[0], 3)


def test_of_overlapping_spheres_the_nearest_is_seen(studio):
    """Which sphere a pixel shows is told by the truth's hue: red, blue and green albedos."""
    folder = studio(SEVERAL)
    written, shown = files.read_scene(folder), set()
    for (drawn, true, _), camera in zip(augmented(folder), true_cameras(folder).values(), strict=True):
        ids = trace(written.at(camera), "surface").surface.ids
        # Inner pixels alone, where the light is good enough for a hue.
        inner = np.zeros(ids.shape, bool)
        inner[2:-2, 2:-2] = np.all([ids[2 + y : ids.shape[0] - 2 + y, 2 + x : ids.shape[1] - 2 + x] == ids[2:-2, 2:-2]
                                    for y in (-2, 0, 2) for x in (-2, 0, 2)], axis=0)  # fmt: skip
        lit = inner & (ids >= 0) & (ids < 3) & (true.max(axis=-1) > 60)
        shown |= set(np.unique(ids[lit]))
        assert (drawn.argmax(axis=-1) == true.argmax(axis=-1))[lit].mean() > 0.97
    assert shown == {0, 1, 2}


def through(camera, pyramid: Pyramid, samples: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """By ray casting against four triangles: how many faces each pixel sees through (mean), and whether all alike."""
    w, h = camera.image_size
    steps = (np.arange(samples) + 0.5) / samples - 0.5
    counts = np.zeros((samples * samples, h, w), int)
    R, eye = np.array(camera.R_cam_board), np.array(camera.eye)
    corners = np.array(pyramid.vertices)
    # Beyond its corners by more than the lens can bend an edge there is nothing to see.
    seen = project(corners, R, np.array(camera.t_cam_board), camera.K, camera.dist)
    (x0, y0), (x1, y1) = seen.min(axis=0).astype(int) - 8, seen.max(axis=0).astype(int) + 10
    x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, w), min(y1, h)
    for row, dy in enumerate(steps):
        for column, dx in enumerate(steps):
            u, v = np.meshgrid(np.arange(x0, x1) + dx, np.arange(y0, y1) + dy)
            xy = undistort(np.stack([u.ravel(), v.ravel()], axis=-1), camera.K, camera.dist)
            d = np.c_[xy, np.ones(len(xy))] @ R
            count = np.zeros(len(d), int)
            for skip in range(4):
                a, b, c = np.delete(corners, skip, axis=0)
                # Moller and Trumbore's: barycentric coordinates by Cramer's rule.
                p = np.cross(d, c - a)
                det = p @ (b - a)
                s = ((eye - a) * p).sum(axis=-1) / det
                q = np.cross(eye - a, b - a)
                t = d @ q / det
                count += (s > 0) & (t > 0) & (s + t < 1) & (q @ (c - a) / det > 0)
            counts[row * samples + column, y0:y1, x0:x1] = count.reshape(u.shape)
    return counts.mean(axis=0), (counts == counts[0]).all(axis=0)


def test_the_transparent_pyramid_lets_through_what_two_faces_let_through(studio):
    folder = studio((), (PYRAMID,))
    for (drawn, _, _), (name, camera) in zip(augmented(folder, "photos"), true_cameras(folder).items(), strict=True):
        faces, sure = through(camera, PYRAMID)
        photo = files.read_photo(folder / "photos" / name)
        # Edges are drawn as lines: leave three pixels to each side of any change of count out.
        for _ in range(3):
            sure[1:-1, 1:-1] = sure[1:-1, 1:-1] & sure[:-2, 1:-1] & sure[2:, 1:-1] & sure[1:-1, :-2] & sure[1:-1, 2:]
        inside, outside = sure & (faces == 2), sure & (faces == 0)
        assert inside.mean() > 0.01
        # What a JPEG loses, more so in the blocks that the outline crosses.
        assert np.quantile(np.abs(drawn[outside].astype(int) - photo[outside]), 0.999) <= 6
        kept = (1 - PYRAMID.opacity) ** 2
        face = np.float32(1 - kept) * np.array(PYRAMID.color, np.float32)
        expected = files.to_bytes(files.from_bytes(photo) * np.float32(kept) + face)
        error = np.abs(drawn[inside].astype(int) - expected[inside])
        # The inner edges cross the faces: a few per cent of the pixels.
        assert np.median(error) <= 3
        assert (error.max(axis=-1) > 8).mean() < 0.2


def test_speculation_on_a_photos_own_camera_errs_less_than_a_thousandth_where_it_is_careful(studio):
    folder = studio(SEVERAL)
    view = files.read_scene(folder).at(next(iter(true_cameras(folder).values())))
    truth = trace(view, "shadow").mean
    for n in (2, 4, 8, 16):
        careful, paper = (np.abs(speculate(view, n, "shadow", way=way)[0] - truth) for way in ("careful", "paper"))
        assert np.quantile(careful, 0.999) < 1e-3 * truth.max()
        assert np.quantile(paper, 0.999) > 10 * np.quantile(careful, 0.999)


def test_trimming_on_a_photos_own_camera_changes_nothing_and_skips_most(studio):
    folder = studio(SEVERAL)
    for camera in true_cameras(folder).values():
        view = files.read_scene(folder).at(camera)
        view = msgspec.structs.replace(view, objects=view.spheres)
        full = trace(view, "shadow", trim="none")
        for trim in ("conic", "corners"):
            np.testing.assert_array_equal(trace(view, "shadow", trim=trim).mean, full.mean)
