import msgspec
import numpy as np
import pytest

from raytwin.errors import InputError
from raytwin.photos.boards import Board, Grid, check_board, read_board, write_board
from raytwin.photos.camera.bias import _edges
from raytwin.photos.camera.fit import drawn_in
from raytwin.photos.synthetic_photos import bow_of

BOARD = Board("tag36h11", 0.030, Grid(5, 7, 0.038))
XY = np.array(list(BOARD.centers().values()))


def apart(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, None] - points[None], axis=-1)


@pytest.mark.parametrize("degrees", [0, 35, 90])
def test_a_sheet_rolled_to_a_parabola_is_not_stretched(degrees):
    """z = c s²/2: places d apart, a of it along s, come k² a⁴ / (24 d) nearer on a curve of curvature k."""
    n = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    s = (XY - XY.mean(axis=0)) @ n
    curvature = 8 * 0.002 / np.ptp(s) ** 2  # 2 mm of bend
    height = curvature * s**2 / 2
    flat, lifted = apart(np.c_[XY, 0 * s]), apart(np.c_[XY, height])
    chord = flat - curvature**2 * (s[:, None] - s) ** 4 / 24 / np.maximum(flat, 1e-9)
    rolled = apart(np.c_[XY + drawn_in(XY, height), height])
    assert np.abs(rolled - chord).max() < 5e-6
    assert np.abs(lifted - chord).max() > 3e-5  # heights alone stretch it


def test_the_edges_of_tags_on_a_parabola_rise_as_it_does():
    """z = c s²/2 of a tag's edge over that of its centre, to the outermost tags."""
    s = (XY - XY.mean(axis=0)) @ (0.8, 0.6)
    board = msgspec.structs.replace(BOARD, offsets=tuple((0.0, 0.0, float(z)) for z in s**2 / 8))
    for (at, edges), along in zip(_edges(board).items(), s, strict=True):
        there = along + edges[..., :2] @ (0.8, 0.6)
        assert np.allclose(edges[..., 2], (there**2 - along**2) / 8, atol=1e-6), at


def test_a_bow_is_as_long_as_the_flat_sheet():
    """Neighbours along the bow: the chord of an arc of length d and curvature k is d - k² d³ / 24."""
    bow = bow_of(BOARD, 0.003)
    along = np.linspace(-1, 1, 201)[:, None] * bow.reach * bow.across + bow.middle
    steps = np.linalg.norm(np.diff(bow.bent(along), axis=0), axis=1)
    assert np.allclose(steps, bow.reach / 100, rtol=1e-5)
    assert np.ptp(bow.bent(along)[:, 2]) == pytest.approx(0.003, rel=1e-3)


def test_what_an_eye_sees_of_a_bow_is_what_it_would_see_of_the_bent_sheet():
    """A dot printed at p is seen on the flat sheet where the ray to its place in space crosses z = 0."""
    bow, eye = bow_of(BOARD, 0.003), np.array([0.3, -0.2, 0.4])
    extent, size = (-0.02, 0.172, -0.02, 0.248), (1340, 960)
    rows, columns = np.mgrid[: size[0], : size[1]].astype(np.float32)
    x = extent[0] + (columns + 0.5) * (extent[1] - extent[0]) / size[1]
    y = extent[3] - (rows + 0.5) * (extent[3] - extent[2]) / size[0]
    seen = np.stack([bow.seen_from(t.astype(np.float32), extent, eye) for t in (x, y)], axis=-1)
    for p in ([0.05, 0.1], [0.12, 0.2], [0.01, 0.03]):
        q = bow.bent(np.array([p]))[0]
        at = eye + (q - eye) * eye[2] / (eye[2] - q[2])
        row, column = (
            (extent[3] - at[1]) / (extent[3] - extent[2]) * size[0],
            (at[0] - extent[0]) / (extent[1] - extent[0]) * size[1],
        )
        assert np.abs(seen[int(row), int(column)] - p).max() < 2.5e-4  # a texel is 0.2 mm


def test_a_grid_counted_downwards_is_the_mirror_of_one_counted_upwards():
    down = msgspec.structs.replace(BOARD, grid=msgspec.structs.replace(BOARD.grid, order="down"))
    check_board(down)
    assert down.centers() == {i: (x, -y) for i, (x, y) in BOARD.centers().items()}


def test_a_boards_shape_is_written_and_read(tmp_path):
    bent = msgspec.structs.replace(BOARD, offsets=tuple((1e-5, 0.0, 1e-4 * i) for i in range(35)))
    write_board(tmp_path / "board.toml", bent)
    assert read_board(tmp_path / "board.toml") == bent
    assert bent.flat() == BOARD
    assert np.allclose(bent.points([7, 3]) - BOARD.points([7, 3]), [(1e-5, 0, 7e-4), (1e-5, 0, 3e-4)])


@pytest.mark.parametrize("offsets", [((0.0, 0.0, 1e-3),), ((np.nan, 0.0, 0.0),) * 35])
def test_a_shape_of_other_than_three_numbers_for_each_tag_is_refused(offsets):
    with pytest.raises(InputError, match=r"offsets: expected three finite numbers for each of 35 tags"):
        check_board(msgspec.structs.replace(BOARD, offsets=offsets))
