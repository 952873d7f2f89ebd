"""What the paper's pipeline draws, beside its truth, on photos whose camera is found, not given.

"An Image Augmentation Pipeline With Customized Data For AR Education": spheres that overlap. The photos are synthetic;
their truth is the same photo taken with the objects really there.
"""

import numpy as np
import pytest

from raytwin import twin
from raytwin.fast import trace
from raytwin.images.photo_files import list_photos, read_photo
from raytwin.photos import boards, synthetic_photos
from raytwin.photos.camera import calibrate, camera_of_photo
from raytwin.scene import Camera, Sphere
from raytwin.scene.scene_files import scene_and_photos, write_camera
from raytwin.scene.toml_json import plain, read_toml, write_toml
from raytwin.study.augment_photos import augment_photos
from raytwin.study.photograph import photograph_board

pytestmark = pytest.mark.nightly

SIZE, COUNT = (504, 378), 3
SPHERES = (
    Sphere((0.05, 0.09, 0.03), 0.03, (0.75, 0.3, 0.2)),
    Sphere((0.085, 0.105, 0.024), 0.024, (0.2, 0.45, 0.7)),
    Sphere((0.07, 0.06, 0.02), 0.02, (0.3, 0.6, 0.25)),
)


@pytest.fixture(scope="module")
def studio(scenes, tmp_path_factory):
    """A folder with a scene of these spheres, and photos of the board without them and with."""
    twin.activate()
    folder = tmp_path_factory.mktemp("studio")
    boards.write_board(folder / "board.toml", boards.read_board(scenes / "desk" / "board.toml"))
    desk = read_toml(scenes / "desk" / "scene.toml")
    write_toml(folder / "scene.toml", desk | {"spheres": plain(SPHERES)})
    for name, there in (("photos", False), ("with", True)):
        photograph_board(
            folder / "board.toml", folder / name, scene=folder, count=COUNT, size=SIZE, samples=8, with_objects=there
        )
    return folder


@pytest.fixture(scope="module")
def augmented(studio):
    """Each photo drawn on, its truth, and the errors by region; the camera is calibrated from the photos."""
    camera, board = studio / "camera.toml", boards.read_board(studio / "board.toml")
    taken = list_photos(studio / "photos")
    found = calibrate(taken, board, "k1k2")
    write_camera(camera, camera_of_photo(found, taken[0], board))
    rows = augment_photos(taken, studio, studio / "drawn", camera=camera, against=studio / "with")
    return [(read_photo(studio / "drawn" / p.name), read_photo(studio / "with" / p.name), row)
            for p, row in zip(taken, rows, strict=True)]  # fmt: skip


def region(row: dict, name: str) -> dict:
    return next(part for part in row["regions"] if part["region"] == name)


def test_drawn_spheres_look_as_if_they_had_been_there(augmented):
    for drawn, true, row in augmented:
        # Light that goes from sphere to sphere and to the board is missing: a few codes of 255.
        assert region(row, "all")["codes"] < 3.5
        assert region(row, "spheres")["share"] > 0.01
        assert region(row, "spheres")["codes"] < 14
        assert drawn.shape == true.shape == (SIZE[1], SIZE[0], 3)


def test_of_overlapping_spheres_the_nearest_is_seen(studio, augmented):
    """Which sphere a pixel shows is told by the truth's hue: red, blue and green albedos."""
    truth = synthetic_photos.read_truth(studio / "photos" / "truth.toml")
    cameras = [Camera(truth.image_size, truth.K, R, t, truth.dist) for R, t in truth.photos.values()]
    written, shown = scene_and_photos(studio)[0], set()
    for (drawn, true, _), camera in zip(augmented, cameras, strict=True):
        ids = trace(written.with_camera(camera), "surface").surface.ids
        # Inner pixels alone, where the light is good enough for a hue.
        inner = np.zeros(ids.shape, bool)
        inner[2:-2, 2:-2] = np.all([ids[2 + y : ids.shape[0] - 2 + y, 2 + x : ids.shape[1] - 2 + x] == ids[2:-2, 2:-2]
                                    for y in (-2, 0, 2) for x in (-2, 0, 2)], axis=0)  # fmt: skip
        lit = inner & (ids >= 0) & (ids < 3) & (true.max(axis=-1) > 60)
        shown |= set(np.unique(ids[lit]))
        assert (drawn.argmax(axis=-1) == true.argmax(axis=-1))[lit].mean() > 0.97
    assert shown == {0, 1, 2}
