import subprocess
import sys

import msgspec
import numpy as np
import pytest
from photo_helpers import BOARD

from raytwin.errors import InputError
from raytwin.images.photo_files import write_picture
from raytwin.photos.boards.board import Board, Grid, draw_board
from raytwin.photos.camera import detection, lens_model
from raytwin.photos.camera.bias import _edges, unbiased
from raytwin.photos.camera.detection import SEARCH_SIDE, detect, detect_photo, detect_photos


@pytest.fixture(scope="module")
def sheet() -> np.ndarray:
    """A 2 x 2 board as grey uint8, 150 px a tag."""
    albedo, _ = draw_board(Board("tag36h11", 0.03, Grid(2, 2, 0.04)), 5000)
    return (albedo * 255).astype(np.uint8)


def test_an_id_seen_twice_and_a_tag_that_the_frame_touches_are_dropped_and_the_others_stay(sheet):
    half = sheet.shape[1] // 2
    assert [t.id for t in detect(np.hstack([sheet, sheet[:, :half]]))] == [1, 3]
    # The white ring of the left tags, and a little of their black edge, is outside.
    assert [t.id for t in detect(sheet[:, 78:])] == [1, 3]


@pytest.fixture(scope="module")
def large(sheet) -> np.ndarray:
    """The sheet in a photo that is searched at a reduced scale."""
    pixels = np.full((SEARCH_SIDE + 1, 600), 216, np.uint8)
    pixels[: sheet.shape[0], : sheet.shape[1]] = sheet
    return pixels


def test_a_large_photo_is_searched_at_the_coarsest_scale_that_shows_its_tags_and_loses_no_accuracy(
    sheet, large, monkeypatch
):
    def searched(pixels, scale):
        with monkeypatch.context() as patch:
            patch.setattr(detection, "REDUCTIONS", (scale,))
            return detect(pixels)

    full, quarter = (np.array([t.center for t in found]) for found in (detect(sheet), searched(large, 4.0)))
    assert 0 < np.abs(quarter - full).max() < 0.15
    assert detect(large) == searched(large, 4.0)
    # 50 px a tag, 12 at a quarter; 25 px, for which full scale alone will do.
    for part, scale, coarser in ((large[::3, ::3], 2.0, 4.0), (large[2::6, 2::6], 1.0, 2.0)):
        small = np.full_like(large, 216)
        small[: part.shape[0], : part.shape[1]] = part
        assert detect(small) == searched(small, scale) != searched(small, coarser)
        assert [t.id for t in detect(small)] == [0, 1, 2, 3]


def test_photos_read_side_by_side_give_what_each_gives_alone_in_their_order(shoot):
    folder, _ = shoot()
    photos = sorted(folder.glob("*.jpg"))[::-1]
    steps = []
    found, wrong = detect_photos(photos, "tag36h11", lambda *step: steps.append(step))
    assert found == {str(p): detect_photo(p) for p in photos}
    assert list(found) == [str(p) for p in photos]
    assert (wrong, steps) == ({}, [("detect", i, 12) for i in range(13)])


def test_a_process_that_has_read_several_families_ends_well():
    code = (
        "import numpy as np; from raytwin.photos.camera import detect;"
        "[detect(np.zeros((99, 99), np.uint8), f) for f in ('tag36h11', 'tag25h9', 'tag16h5')]"
    )
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0


def test_a_mirrored_photo_is_called_mirrored(sheet, tmp_path):
    file = tmp_path / "selfie.png"
    write_picture(file, sheet[:, ::-1])
    with pytest.raises(InputError, match=r"a mirrored photo \(its mirror image shows 4 tags\)"):
        detect_photo(file)


def test_found_centres_are_where_the_camera_projects_them_once_the_bias_is_taken_out(shoot):
    folder, truth = shoot()
    raw, mended = [], []
    for name, (R, t) in truth.photos.items():
        tags = detect_photo(folder / name)
        true = lens_model.project(BOARD.points(tag.id for tag in tags), R, t, truth.K, truth.dist)
        raw.append(np.array([tag.center for tag in tags]) - true)
        straight = unbiased(tags, BOARD, R, t, truth.K, truth.dist)
        mended.append(np.array([tag.center for tag in straight]) - true)
    raw, mended = np.concatenate(raw), np.concatenate(mended)
    # A half pixel's shift would show in the mean; the bias of bent edges shows in the spread.
    assert np.abs(mended.mean(axis=0)).max() < 0.02
    assert np.sqrt((raw**2).sum(axis=1).mean()) < 0.25
    assert np.sqrt((mended**2).sum(axis=1).mean()) < 0.65 * np.sqrt((raw**2).sum(axis=1).mean())


def test_the_edges_of_tags_on_a_parabola_rise_as_it_does():
    """z = c s²/2 of a tag's edge over that of its centre, to the outermost tags."""
    xy = np.array([*BOARD.centers().values()])
    s = (xy - xy.mean(axis=0)) @ (0.8, 0.6)
    board = msgspec.structs.replace(BOARD, offsets=tuple((0.0, 0.0, float(z)) for z in s**2 / 8))
    for (at, edges), along in zip(_edges(board).items(), s, strict=True):
        there = along + edges[..., :2] @ (0.8, 0.6)
        assert np.allclose(edges[..., 2], (there**2 - along**2) / 8, atol=1e-6), at
