import numpy as np
import pytest
from photo_helpers import BOARD, PlainRenderer, a_camera, read_truth

from raytwin.errors import InputError
from raytwin.images.photo_files import from_bytes, srgb_decode, srgb_encode
from raytwin.photos.camera import diagnostics, lens_model
from raytwin.photos.synthetic_photos import expose, photograph, poses

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


def test_a_sensor_has_the_noise_of_its_electrons_a_lens_falloff_and_a_white():
    """Noise is the root of the electrons; natural vignetting the fourth power of the cosine, of which 0.3 is left."""
    width, height = CAMERA.image_size
    pixels = expose(np.full((height, width, 3), 0.2, np.float32), np.random.default_rng(1), CAMERA)
    linear = from_bytes(pixels).astype(float)
    middle = linear[height // 2 - 60 : height // 2 + 60, width // 2 - 60 : width // 2 + 60]
    expected = (0.2 * 8000 + 4.0**2) / 8000**2
    # Rounding to a byte adds a step's variance over twelve: sRGB's slope turns the step into a linear one.
    step = np.gradient(srgb_decode(np.arange(256) / 255))[round(255 * srgb_encode(np.array(0.2)).item())]
    assert middle.mean() == pytest.approx(0.2, rel=0.01)
    assert middle.var() == pytest.approx(expected + step**2 / 12, rel=0.05)
    corner = np.linalg.inv(np.array(CAMERA.K)) @ (0, 0, 1)
    assert linear[:20, :20].mean() == pytest.approx(0.2 / (corner @ corner) ** 0.6, rel=0.03)
    assert (expose(np.full((9, 9, 3), 2.2, np.float32), np.random.default_rng(1), a_camera(9, 9)) == 255).all()


def test_the_same_seed_takes_the_same_photos_and_another_does_not(tmp_path):
    small = a_camera(336, 252)
    for out, seed in (("a", 1), ("b", 1), ("c", 2)):
        photograph(BOARD, small, 2, tmp_path / out, PlainRenderer(1), seed=seed)
    a, b, c = ([(tmp_path / out / f"photo_0{i}.jpg").read_bytes() for i in (0, 1)] for out in "abc")
    assert a == b
    assert a != c


def test_the_truth_and_the_board_lie_beside_the_photos(shoot):
    folder, truth = shoot()
    assert read_truth(folder / "truth.toml") == truth
    assert sorted(p.name for p in folder.iterdir()) == sorted(["board.toml", "truth.toml", *truth.photos])
