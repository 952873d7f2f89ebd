import re
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from photo_helpers import BOARD, SMALL, a_camera, seen
from PIL import Image as Pillow

from raytwin.errors import InputError
from raytwin.images.photo_files import read_photo, write_picture
from raytwin.photos.boards.board import Board, BoardTag, Grid
from raytwin.photos.camera import calibrate, calibrate_detections, pose_of_tags
from raytwin.photos.camera.fit import ModelSpec, fit
from raytwin.photos.camera.pose import rotation_degrees
from raytwin.photos.synthetic_photos import poses

SIZE = (1008, 756)


def _views(dist=(0.08, -0.16), count: int = 12, noise: float = 0.05, seed: int = 0):
    camera = a_camera(*SIZE, dist=dist)
    rng = np.random.default_rng(seed)
    stands = poses(BOARD, camera, count, rng)
    return camera, stands, seen(camera, stands, noise=noise, rng=rng)


def test_from_exact_detections_the_camera_and_every_pose_are_the_truth():
    camera, stands, tags = _views(noise=0)
    found = calibrate_detections(tags, SIZE, SMALL, "k1k2")
    assert np.abs(np.array(found.K) - camera.K).max() < 2e-3
    assert found.dist == pytest.approx(camera.dist, abs=1e-5)
    for view, (R, t) in zip(found.views, stands, strict=True):
        assert rotation_degrees(np.array(view.R_cam_board), np.array(R)) < 1e-3
        assert np.abs(np.array(view.t_cam_board) - t).max() < 2e-6


def test_photos_taken_with_a_known_camera_give_that_camera_back(shoot, plain_found):
    (_, truth), found = shoot(), plain_found
    K, true = np.array(found.K), np.array(truth.K)
    sigma = np.array([found.sigma[n] for n in ("fx", "fy", "cx", "cy")])
    off = np.abs((K - true)[[0, 1, 0, 1], [0, 1, 2, 2]])
    assert (off < np.minimum(4 * sigma, [1e-3 * true[0, 0], 1e-3 * true[1, 1], 1, 1])).all()
    assert (found.model, found.warnings, found.board.offsets) == ("k1k2", (), None)
    assert len(found.views) == len(truth.photos)
    for view in found.views:
        R, t = (np.array(a) for a in truth.photos[view.photo])
        assert rotation_degrees(np.array(view.R_cam_board), R) < 0.1
        assert np.linalg.norm(np.array(view.t_cam_board) - t) < 1e-3


def test_the_same_detections_give_the_same_camera_to_the_last_bit_and_opencv_keeps_its_threads(real_tags, real_board):
    (tags, size), board = real_tags("april_fine"), real_board("fine")
    threads = cv2.getNumThreads()
    cv2.setNumThreads(8)
    try:
        views = {p: [t for t in seen if t.id in board.centers()] for p, seen in tags.items()}
        made = (fit(views, size, board, ModelSpec("full5")) for _ in range(8))
        assert len({(c.shared.tobytes(), c.R.tobytes(), c.t.tobytes()) for c in made}) == 1
        assert cv2.getNumThreads() == 8
    finally:
        cv2.setNumThreads(threads)


def test_auto_takes_the_model_that_made_the_views_and_keeps_the_held_out_error_of_all():
    for dist, model in (((), "none"), ((0.08, -0.16), "k1k2"), ((0.1, -0.2, 0.004, 0.003, 0.2), "full5")):
        camera, _, tags = _views(dist)
        found = calibrate_detections(tags, SIZE, SMALL)
        assert found.model == found.evidence.taken == model
        assert len(found.dist) == len(dist)
        assert abs(found.K[0][0] - camera.fx) < 1e-3 * camera.fx
        errors = found.evidence.held_out_px
        assert list(errors) == ["full5", "full5, bent", "k1k2", "none"]
        assert model == "none" or errors[model] < 0.5 * errors["none"]


def test_its_json_has_exactly_the_promised_keys():
    _, _, tags = _views()
    found = calibrate_detections(dict(list(tags.items())[:5]), SIZE, SMALL, "k1k2")
    assert found.evidence.held_out_px.keys() == {"k1k2", "k1k2, bent"}
    data = found.to_dict()
    assert list(data["sigma"]) == ["fx", "fy", "cx", "cy", "k1", "k2"]
    assert list(data) == ["image_size", "model", "K", "dist", "sigma", "rms_px", "views", "warnings", "boards"]
    assert list(data["views"][0]) == ["photo", "tags", "rms_px", "R_cam_board", "t_cam_board", "influence"]
    assert list(data["boards"][0]) == ["offsets", "bend_mm", "bend_sigma_mm"]
    assert list(data["warnings"][0]) == ["code", "text"]
    assert tuple(data["image_size"]) == SIZE


@pytest.mark.nightly
def test_real_sets_are_bent_predict_better_so_and_the_degenerate_one_has_the_lowest_error(real_tags, real_board):
    boards = {"april_fine": "fine", "desk_tilted": "coarse", "desk_degenerate": "coarse"}
    found = {name: calibrate_detections(*real_tags(name), real_board(board)) for name, board in boards.items()}
    codes = {name: {w.code for w in c.warnings} for name, c in found.items()}
    assert min(found, key=lambda n: found[n].rms_px) == "desk_degenerate"
    assert "degenerate-views" in codes["desk_degenerate"]
    assert codes["april_fine"] == set()
    assert not codes["desk_tilted"] & {"degenerate-views", "few-views", "odd-photo"}
    for c in found.values():
        errors = c.evidence.held_out_px
        assert errors[c.evidence.taken] < 0.8 * errors["full5"]
    # Taken for flat, cy = 638 ± 29 by OpenCV's word; the image's middle is 1511.5.
    assert abs(found["desk_degenerate"].K[1][2] - 1511.5) < 100


def test_a_part_of_the_frame_that_the_lens_folds_over_is_named():
    """Nothing in the middle of the frame says what happens at its corner: a strong k1 folds back there."""
    rng = np.random.default_rng(6)
    stands = [(R, np.array(t) * (1, 1, 2.2)) for R, t in poses(BOARD, a_camera(*SIZE, dist=()), 12, rng)]
    tags = seen(a_camera(*SIZE, dist=(-0.55,)), stands, noise=0.001, rng=rng)
    found = calibrate_detections(tags, SIZE, SMALL, "k1k2")
    assert found.dist[0] == pytest.approx(-0.55, abs=0.01)
    (text,) = [w.text for w in found.warnings if w.code == "unconverged-distortion"]
    assert "no ray belongs to" in text


def test_misplaced_tags_are_rejected_and_named():
    _, _, tags = _views()
    clean = calibrate_detections(tags, SIZE, SMALL, "k1k2")
    spoiled = {p: list(t) for p, t in tags.items()}
    for photo, by in (("view_01", (9.0, 3.0)), ("view_04", (-200.0, 90.0))):
        tag = spoiled[photo][6]
        spoiled[photo][6] = msgspec.structs.replace(tag, center=tuple(np.array(tag.center) + by))
    found = calibrate_detections(spoiled, SIZE, SMALL, "k1k2")
    named = {w.text.split(":")[0]: w.text for w in found.warnings if w.code == "outlier-tags"}
    assert named.keys() == {"view_01", "view_04"}
    assert named["view_01"].endswith(f"tags {tags['view_01'][6].id}")
    assert found.K[0][0] == pytest.approx(clean.K[0][0], abs=0.2)


def test_a_view_that_fits_two_poses_is_named():
    camera, stands, _ = _views()
    tilt = np.deg2rad(25)
    R = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]]) @ np.diag([1, -1, -1])
    tags = seen(camera, [*stands, (R, (0.0, 0.0, 6.0))], noise=0.3, rng=np.random.default_rng(2))
    found = calibrate_detections(tags, SIZE, SMALL, "k1k2")
    assert [w.text.split(":")[0] for w in found.warnings if w.code == "ambiguous-pose"] == ["view_12"]


def test_photos_without_tags_and_files_that_cannot_be_read_are_left_out_and_named(shoot, tmp_path):
    photos = [tmp_path / f"photo_0{i}.{kind}" for i, kind in enumerate(("webp", "tif", "bmp", "jpg"))]
    for photo in photos:
        Pillow.fromarray(read_photo(shoot()[0] / f"{photo.stem}.jpg")).save(photo)
    whole, selfie = photos[3].read_bytes(), read_photo(photos[0])[:, ::-1]
    write_picture(tmp_path / "blank.jpg", np.full((756, 1008, 3), 99, np.uint8))
    write_picture(tmp_path / "selfie.jpg", selfie)
    (tmp_path / "cut.jpg").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "._photo_03.jpg").write_bytes(b"Mac OS X")
    for name in "abcde":
        (tmp_path / f"{name}.heic").write_bytes(b"heic")
    found = calibrate(tmp_path, BOARD, "k1k2")
    assert len(found.views) == 4
    assert sorted(w.text.split(" (")[0] for w in found.warnings if w.code == "no-tags") == [
        "._photo_03.jpg was left out: a file of another kind, or a damaged header",
        "a.heic, b.heic, c.heic and 2 more were left out: HEIC: save it as JPEG or PNG",
        "blank.jpg was left out: no tag that appears once",
        "cut.jpg was left out: a damaged one",
        "selfie.jpg was left out: a mirrored photo",
    ]
    with pytest.raises(InputError, match=r"a\.heic: expected a photo"):
        calibrate(sorted(tmp_path.glob("*.heic")), BOARD)
    write_picture(tmp_path / "turned.jpg", np.swapaxes(read_photo(photos[0]), 0, 1))
    with pytest.raises(InputError, match=r"turned.jpg: expected 1008 x 756 pixels, as the first .*, got 756 x 1008"):
        calibrate(tmp_path, BOARD)
    mirrored = [tmp_path / f"mirrored_{i}.jpg" for i in range(3)]
    for photo in mirrored:
        write_picture(photo, selfie)
    with pytest.raises(InputError, match=r"expected photos of tag36h11 tags, got mirrored_0.jpg: a mirrored photo"):
        calibrate(mirrored, BOARD)


def test_every_code_that_the_docs_list_is_provoked_by_a_test_and_no_other():
    tests = "".join(file.read_text() for file in Path(__file__).parent.glob("test_*.py"))
    page = Path(__file__).parents[3] / "docs" / "photos.md"
    listed = set(re.findall(r"^\| `([a-z-]+)` \|", page.read_text(), re.MULTILINE))
    assert set(re.findall(r'"([a-z]+(?:-[a-z]+)+)"', tests)) == listed


def test_too_few_photos_or_views_other_ids_and_models_are_refused(shoot):
    for times, got in ((0, 0), (3, 1)):
        with pytest.raises(InputError, match=rf"at least 3 photos of the board, from different sides, got {got}"):
            calibrate([shoot()[0] / "photo_00.jpg"] * times, BOARD)
    with pytest.raises(InputError, match=r"model: expected one of auto, none, .*full5, got k9"):
        calibrate([], SMALL, "k9")
    camera, _, tags = _views(count=4)
    few = {p: (t if i < 2 else t[:2]) for i, (p, t) in enumerate(tags.items())}
    with pytest.raises(
        InputError, match=r"at least 3 photos that show the board, got 2; view_02: too few tags of the board"
    ):
        calibrate_detections(few, SIZE, SMALL)
    other = Board("tag36h11", 0.03, Grid(4, 4, 0.05, first_id=200))
    for find in (
        lambda: calibrate_detections(tags, SIZE, other),
        lambda: pose_of_tags(camera.K, camera.dist, tags["view_00"], other),
    ):
        with pytest.raises(InputError, match=r"tags of the board \(ids 200\.\.215\), got other tags \(ids 0\.\.34\)"):
            find()


TRUE = Board("tag36h11", 0.022, Grid(6, 6, 0.0286))


def _of_true() -> dict:
    rng = np.random.default_rng(0)
    return seen(a_camera(*SIZE), poses(TRUE, a_camera(*SIZE), 6, rng), TRUE, 0.1, rng)


def _grid(columns: int, rows: int, first_id: int = 0, order: str = "up") -> Board:
    return msgspec.structs.replace(TRUE, grid=Grid(columns, rows, 0.0286, first_id, order))


def test_photos_of_another_board_give_no_camera_and_no_pose(subtests):
    """Of 5 columns the fit was singular; of 4 and 9 its rms was hundreds of pixels; of 3 and 12 a pixel's fifth."""
    said = r"tags that lie as the board's file says, got \d+ of \d+ that do|3 photos that show the board, got 0"
    ids, tags, camera = np.random.default_rng(0).permutation(36).tolist(), _of_true(), a_camera(*SIZE)
    listed = tuple(BoardTag(i, at) for i, at in zip(ids, TRUE.centers().values(), strict=True))
    grids = (5, 6), (4, 9), (9, 4), (12, 3), (3, 12), (18, 2)
    for board in (*(_grid(*n) for n in grids), _grid(7, 5, order="down"), Board("tag36h11", 0.022, tags=listed)):
        with subtests.test(str(board)[:200]), pytest.raises(InputError, match=said):
            calibrate_detections(tags, SIZE, board)
    with pytest.raises(InputError, match=said):
        pose_of_tags(camera.K, camera.dist, tags["view_00"], _grid(9, 4))


def test_the_board_with_its_rows_cut_its_ids_moved_mirrored_or_two_tags_read_wrongly_gives_a_camera():
    swapped = _of_true()
    for found in swapped.values():
        ids = found[20].id, found[7].id
        found[7], found[20] = (msgspec.structs.replace(found[i], id=new) for i, new in zip((7, 20), ids, strict=True))
    boards = TRUE, _grid(6, 5), _grid(6, 6, first_id=6), _grid(6, 6, order="down")
    for tags, board in (*((_of_true(), board) for board in boards), (swapped, TRUE)):
        assert calibrate_detections(tags, SIZE, board, "k1k2").rms_px < 0.3, board
