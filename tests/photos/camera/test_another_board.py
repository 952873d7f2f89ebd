"""Photos of another board than its file describes give no camera."""

import msgspec
import numpy as np
import pytest
from photo_helpers import a_camera, seen

from raytwin.errors import InputError
from raytwin.photos.boards import Board, BoardTag, Grid
from raytwin.photos.camera import calibrate_detections, pose_of_tags
from raytwin.photos.synthetic_photos import poses

SIZE = (1008, 756)
OTHER = r"tags that lie as the board's file says, got \d+ of \d+ that do|3 photos that show the board, got 0"
TRUE = Board("tag36h11", 0.022, Grid(6, 6, 0.0286))


def _tags(seed: int = 0, count: int = 6) -> dict:
    rng = np.random.default_rng(seed)
    camera = a_camera(*SIZE)
    return seen(camera, poses(TRUE, camera, count, rng), TRUE, 0.1, rng)


def _grid(columns: int, rows: int, first_id: int = 0, order: str = "up") -> Board:
    return msgspec.structs.replace(TRUE, grid=Grid(columns, rows, 0.0286, first_id, order))


def _listed() -> Board:
    """The same tags in other places."""
    ids = np.random.default_rng(0).permutation(36).tolist()
    listed = tuple(BoardTag(i, at) for i, at in zip(ids, TRUE.centers().values(), strict=True))
    return Board("tag36h11", 0.022, tags=listed)


def test_another_board_gives_no_camera_and_no_pose(subtests):
    """Of 5 columns the fit was singular; of 4 and 9 its rms was hundreds of pixels; of 3 and 12 a pixel's fifth."""
    grids = (5, 6), (4, 9), (9, 4), (12, 3), (3, 12), (18, 2)
    for board in (*(_grid(*n) for n in grids), _grid(7, 5, order="down"), _listed()):
        with subtests.test(str(board)[:200]), pytest.raises(InputError, match=OTHER):
            calibrate_detections(_tags(), SIZE, board)
    camera = a_camera(*SIZE)
    with pytest.raises(InputError, match=OTHER):
        pose_of_tags(camera.K, camera.dist, _tags()["view_00"], _grid(9, 4))


def test_the_board_itself_its_rows_cut_its_ids_moved_by_a_row_or_its_mirror_image_give_a_camera():
    for board in (TRUE, _grid(6, 5), _grid(6, 6, first_id=6), _grid(6, 6, order="down")):
        assert calibrate_detections(_tags(), SIZE, board, "k1k2").rms_px < 0.3, board


def test_a_tag_that_is_read_wrongly_says_nothing_of_the_board():
    tags = _tags()
    for found in tags.values():
        found[7], found[20] = (
            msgspec.structs.replace(found[7], id=found[20].id),
            msgspec.structs.replace(found[20], id=found[7].id),
        )
    assert calibrate_detections(tags, SIZE, TRUE, "k1k2").rms_px < 0.3


def test_an_rms_that_no_lens_explains_gives_no_camera():
    """Neighbours are where they should be, but each photo is bent by another amount."""
    tags, rng = _tags(), np.random.default_rng(3)
    for found, push in zip(tags.values(), rng.normal(0, 40, (len(tags), 2)), strict=True):
        for i, tag in enumerate(found):
            at = np.array(tag.center)
            found[i] = msgspec.structs.replace(tag, center=tuple((at + push * ((at - 500) / 500) ** 2).clip(0, 755)))
    with pytest.raises(InputError, match=r"tags at most .* px \(rms\) off where some camera sees them"):
        calibrate_detections(tags, SIZE, TRUE)
