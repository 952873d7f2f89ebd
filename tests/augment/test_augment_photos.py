"""`raytwin augment` on photos of the synthetic photographer, against photos with the spheres really there."""

import json

import numpy as np
import pytest
from PIL import Image as Pillow

from raytwin import files, photographer
from raytwin.errors import InputError
from raytwin.jobs.augment import augment_photos
from raytwin.jobs.camera import list_photos
from raytwin.jobs.photograph import photograph_board
from raytwin.scene import Camera

SIZE, COUNT = (672, 504), 4


@pytest.fixture(scope="module")
def taken(scenes, tmp_path_factory):
    """(photos without, photos with the spheres): the same poses and noise, 4 small photos each."""
    from raytwin import twin

    twin.activate()
    folder = tmp_path_factory.mktemp("taken")
    for name, really_there in (("without", False), ("with", True)):
        photograph_board(
            scenes / "desk" / "board.toml",
            folder / name,
            scene=scenes / "desk",
            count=COUNT,
            size=SIZE,
            samples=32,
            with_objects=really_there,
        )
    truth = photographer.read_truth(folder / "without" / "truth.toml")
    R, t = truth.photos["photo_00.jpg"]
    camera = Camera(truth.image_size, truth.K, R, t, truth.dist)
    files.write_camera(folder / "camera.toml", camera)
    return folder


@pytest.fixture(scope="module")
def rows(taken, scenes, tmp_path_factory):
    return augment_photos(
        list_photos(taken / "without"),
        scenes / "desk",
        tmp_path_factory.mktemp("drawn"),
        camera=taken / "camera.toml",
        against=taken / "with",
    )


def test_the_two_sets_differ_only_where_the_spheres_act(taken):
    """Same poses, same noise: far from spheres and shadows the photos are alike but for light paths."""
    a = files.read_photo(taken / "without" / "photo_00.jpg").astype(int)
    b = files.read_photo(taken / "with" / "photo_00.jpg").astype(int)
    assert np.median(np.abs(a - b)) <= 2
    assert np.quantile(np.abs(a - b), 0.98) > 30


@pytest.mark.parametrize(("region", "codes"), [("board", 4.0), ("rest", 4.0), ("shadows", 12.0), ("spheres", 20.0)])
def test_an_augmented_photo_is_near_the_true_one_in_every_region(rows, region, codes):
    """Direct light alone misses what the board and the spheres send each other: the spheres are too dark."""
    assert len(rows) == COUNT
    for row in rows:
        part = next(p for p in row["regions"] if p["region"] == region)
        if part["share"] > 1e-3:
            assert part["codes"] < codes, (row["photo"], part)


def test_drawing_beats_not_drawing(taken, rows):
    for row in rows:
        plain = files.read_photo(taken / "without" / row["photo"]).astype(int)
        true = files.read_photo(taken / "with" / row["photo"])
        drawn = next(p for p in row["regions"] if p["region"] == "all")
        assert drawn["codes"] < 0.5 * np.abs(plain - true).mean()


def test_a_turned_photo_comes_out_upright(taken, scenes, tmp_path):
    """The sensor's pixels are drawn on, then turned as the EXIF orientation asks, and the tag is gone."""
    photo = Pillow.open(taken / "without" / "photo_00.jpg")
    exif = photo.getexif()
    exif[0x0112] = 6
    photo.save(tmp_path / "photo_00.jpg", exif=exif, quality=95)
    augment_photos([tmp_path / "photo_00.jpg"], scenes / "desk", tmp_path / "out", camera=taken / "camera.toml")
    with Pillow.open(tmp_path / "out" / "photo_00.jpg") as drawn:
        assert drawn.size == SIZE[::-1]
        assert not drawn.getexif()


def test_a_photo_whose_pixels_were_turned_does_not_fit_the_camera_and_is_said_to_be_turned(taken, scenes, tmp_path):
    files.write_picture(tmp_path / "photo_00.jpg", np.rot90(files.read_photo(taken / "without" / "photo_00.jpg")))
    with pytest.raises(InputError, match=r"photo_00\.jpg: .* as the camera's, got .*: the same, turned by a quarter"):
        augment_photos([tmp_path / "photo_00.jpg"], scenes / "desk", tmp_path / "out", camera=taken / "camera.toml")
    assert not (tmp_path / "out").exists()


def test_all_orientations_turn_as_pillow_turns_them():
    from PIL import ImageOps

    pixels = np.random.default_rng(0).integers(0, 255, (5, 7, 3), dtype=np.uint8)
    for orientation in range(1, 9):
        picture = Pillow.fromarray(pixels)
        picture.getexif()[0x0112] = orientation
        assert np.array_equal(files.upright(pixels, orientation), np.asarray(ImageOps.exif_transpose(picture)))


def test_the_pyramid_is_drawn(taken, scenes, tmp_path):
    photo = taken / "without" / "photo_00.jpg"
    augment_photos([photo], scenes / "desk" / "pyramid.toml", tmp_path, camera=taken / "camera.toml")
    changed = (
        np.abs(files.read_photo(tmp_path / "photo_00.jpg").astype(int) - files.read_photo(photo)).max(axis=-1) > 40
    )
    assert 0.005 < changed.mean() < 0.3


def test_the_photos_own_folder_is_never_written_to(taken, scenes):
    photo = taken / "without" / "photo_00.jpg"
    before = photo.read_bytes()
    with pytest.raises(InputError, match="--out"):
        augment_photos([photo], scenes / "desk", photo.parent, camera=taken / "camera.toml")
    assert photo.read_bytes() == before


def test_a_photo_of_another_size_is_named(taken, scenes, tmp_path):
    files.write_picture(tmp_path / "small.jpg", files.read_photo(taken / "without" / "photo_00.jpg")[:400])
    with pytest.raises(InputError, match=r"small\.jpg: expected 672 x 504 pixels.*got 672 x 400"):
        augment_photos([tmp_path / "small.jpg"], scenes / "desk", tmp_path / "o", camera=taken / "camera.toml")


def test_the_rows_are_plain_data(rows):
    assert json.loads(json.dumps(rows)) == rows
