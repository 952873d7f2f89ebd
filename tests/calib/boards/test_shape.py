import msgspec
import numpy as np
import pytest

from raytwin.calib.boards import Board, Grid, Heights, check_board, read_board, write_board
from raytwin.calib.boards.shape import bending, count, heights_at
from raytwin.calib.synthetic_photos import bow_of
from raytwin.errors import InputError

BOARD = Board("tag36h11", 0.030, Grid(5, 7, 0.038))
XY = np.array(list(BOARD.centers().values()))


def apart(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, None] - points[None], axis=-1)


@pytest.mark.parametrize("degrees", [0, 35, 90])
def test_a_sheet_rolled_to_a_parabola_is_not_stretched(degrees):
    """z = c s²/2: a neighbour at 38 mm stays at 38 mm along the sheet, whose chord is shorter by (k d)² d / 24 only.

    The chord between two places of a curve is the arc length less k² arc³ / 24, to second order in its slope.
    """
    n = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    s = (XY - XY.mean(axis=0)) @ n
    curvature = 8 * 0.002 / np.ptp(s) ** 2  # 2 mm of bend
    bent = bending(tuple(BOARD.centers().values()), 2)
    flat = np.c_[np.ones(len(XY)), XY, bent.heights]
    c = np.linalg.lstsq(flat, curvature * s**2 / 2, rcond=None)[0][3:]
    moved = np.c_[XY, np.zeros(len(XY))] + bent.move(c)
    arc = np.abs(s[:, None] - s[None])
    chord = apart(np.c_[XY, np.zeros(len(XY))]) - curvature**2 * arc**4 / 24 / np.maximum(apart(XY), 1e-9)
    assert np.abs(apart(moved) - chord).max() < 1e-6
    assert np.abs(apart(np.c_[XY, (bent.heights @ c)[:, None]]) - chord).max() > 3e-5  # heights alone stretch it


def test_how_points_move_with_the_coefficients_is_that_of_differences():
    bent = bending(tuple(BOARD.centers().values()), 4)
    c = np.random.default_rng(0).normal(0, 1e-3, count(4))
    for i, step in enumerate(1e-7 * np.eye(count(4))):
        assert np.allclose((bent.move(c + step) - bent.move(c - step)) / 2e-7, bent.moves(c)[:, i], atol=1e-8)


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
    bent = msgspec.structs.replace(BOARD, heights=Heights(2, (1e-3, -2e-3, 5e-4)))
    write_board(tmp_path / "board.toml", bent)
    assert read_board(tmp_path / "board.toml") == bent
    assert bent.flat() == BOARD
    assert np.ptp(bent.points(bent.centers())[:, 2]) > 1e-3
    assert np.allclose(bent.rise(XY), bent.points(bent.centers())[:, 2])


@pytest.mark.parametrize("coefficients", [(1e-3,), (np.nan, 0.0, 0.0)])
def test_a_shape_of_other_than_its_degrees_numbers_is_refused(coefficients):
    with pytest.raises(InputError, match=r"heights\.coefficients: expected 3 finite numbers for degree 2"):
        check_board(msgspec.structs.replace(BOARD, heights=Heights(2, coefficients)))


@pytest.mark.parametrize(("columns", "rows", "free"), [(6, 4, 12 - 1), (5, 7, 12), (3, 3, 12 - 4 - 2), (7, 2, 6)])
def test_a_grid_of_few_rows_leaves_out_the_degrees_that_they_do_not_tell(columns, rows, free):
    """Of x^i y^j with 2 <= i + j <= 4, those with i < columns and j < rows are told, and no others."""
    x, y = np.meshgrid(0.03 * np.arange(columns), 0.03 * np.arange(rows))
    bent = bending(tuple(zip(x.ravel().tolist(), y.ravel().tolist(), strict=True)), 4)
    told = [i < columns and j < rows for d in (2, 3, 4) for i, j in ((d - k, k) for k in range(d + 1))]
    assert sum(told) == free
    assert (np.abs(bent.heights).max(axis=0) > 0).tolist() == told
    assert (np.abs(bent.slopes).max(axis=(0, 1)) > 0).tolist() == told


def test_beyond_the_outermost_centers_the_sheet_goes_on_straight():
    low, high = XY.min(axis=0), XY.max(axis=0)
    xy = tuple(map(tuple, XY))
    inside = low + (high - low) * np.random.default_rng(1).uniform(size=(20, 2))
    assert np.allclose(heights_at(inside, xy, 4), heights_at(inside, xy, 4, straight=False))
    out = [np.array([high[0] + d, inside[0, 1]]) for d in (-1e-7, 0.01, 0.02, 0.04)]
    near, one, two, four = (heights_at(at, xy, 4) for at in out)
    assert np.allclose(two - one, one - near, atol=1e-5)
    assert np.allclose(four - two, 2 * (two - one), atol=1e-9)
    assert not np.allclose(heights_at(out[3], xy, 4, straight=False), four, atol=1e-2)
