import numpy as np
import pytest
from photo_helpers import BOARD, PlainRenderer, a_camera

from raytwin.errors import InputError
from raytwin.images.photo_files import from_bytes, srgb_decode, srgb_encode
from raytwin.photos.camera import diagnostics, lens_model
from raytwin.photos.synthetic_photos import expose, photograph, poses, read_truth
from raytwin.scene.toml_json import plain, write_toml

CAMERA = a_camera()


def test_a_dozen_poses_tilt_to_fifty_degrees_every_way_cover_the_frame_and_see_the_printed_face():
    points = BOARD.points(BOARD.centers())
    for seed in (1, 2):
        stands = [(np.array(R), np.array(t)) for R, t in poses(BOARD, CAMERA, 12, np.random.default_rng(seed))]
        tilts = [np.degrees(np.arccos(-R[2, 2])) for R, _ in stands]
        assert min(tilts) < 8
        assert 40 < max(tilts) <= 50
        pixels = np.concatenate([lens_model.project(points, R, t, CAMERA.K, CAMERA.dist) for R, t in stands])
        inside = ((pixels >= 0) & (pixels <= np.array(CAMERA.image_size) - 1)).all(axis=1)
        assert inside.mean() > 0.65
        assert len(np.unique(np.floor((pixels[inside] + 0.5) * 10 / CAMERA.image_size), axis=0)) > 75
        assert diagnostics.normal_spread([R for R, _ in stands]) > 60
        for R, t in stands:
            assert R[:, 2] @ t < 0  # the board's normal points to the camera
            assert (points @ R.T + t)[:, 2].min() > 0
    with pytest.raises(InputError, match="pixels enough for tags"):
        poses(BOARD, a_camera(64, 48), 3, np.random.default_rng(0))


def test_the_sensors_noise_is_the_roots_of_its_electrons():
    full, read = 8000.0, 4.0
    radiance = np.full((300, 400, 3), 0.2, np.float32)
    pixels = expose(radiance, np.random.default_rng(1), CAMERA, vignetting=0, full_well=full, read_noise=read)
    linear = from_bytes(pixels).astype(float)
    expected = (0.2 * full + read**2) / full**2
    # Rounding to a byte adds a step's variance over twelve: sRGB's slope turns the step into a linear one.
    step = np.gradient(srgb_decode(np.arange(256) / 255))[round(255 * srgb_encode(np.array(0.2)).item())]
    assert linear.mean() == pytest.approx(0.2, abs=2e-4)
    assert linear.var() == pytest.approx(expected + step**2 / 12, rel=0.02)


def test_natural_vignetting_falls_with_the_fourth_power_of_the_cosine_and_more_than_white_is_clipped():
    radiance = np.full((756, 1008, 3), 0.5, np.float32)
    pixels = expose(radiance, np.random.default_rng(1), CAMERA, vignetting=1, full_well=1e9, read_noise=0)
    linear = from_bytes(pixels)[..., 0]
    bright = expose(2.2 * radiance, np.random.default_rng(1), CAMERA, vignetting=0, full_well=1e9, read_noise=0)
    assert (bright == 255).all()
    corner = np.linalg.inv(np.array(CAMERA.K)) @ (0, 0, 1)
    assert linear[376, 508] == pytest.approx(0.5, rel=0.01)
    assert linear[0, 0] == pytest.approx(0.5 / (corner @ corner) ** 2, rel=0.02)


def test_the_same_seed_takes_the_same_photos_and_another_does_not(tmp_path):
    small = a_camera(336, 252)
    for out, seed in (("a", 1), ("b", 1), ("c", 2)):
        photograph(BOARD, small, 2, tmp_path / out, PlainRenderer(1), seed=seed)
    a, b, c = ([(tmp_path / out / f"photo_0{i}.jpg").read_bytes() for i in (0, 1)] for out in "abc")
    assert a == b
    assert a != c


def test_a_truth_is_read_back_and_one_that_is_no_rotation_refused(shoot, tmp_path):
    folder, truth = shoot()
    assert read_truth(folder / "truth.toml") == truth
    assert sorted(p.name for p in folder.iterdir()) == sorted(["board.toml", "truth.toml", *truth.photos])
    data = plain(truth)
    R, t = data["photos"]["photo_00.jpg"]
    data["photos"]["photo_00.jpg"] = [[[R[0][0] + 0.1, *R[0][1:]], *R[1:]], t]
    write_toml(tmp_path / "truth.toml", data)
    with pytest.raises(InputError, match=r"photos\.photo_00\.jpg\.R_cam_board: expected a rotation matrix"):
        read_truth(tmp_path / "truth.toml")
