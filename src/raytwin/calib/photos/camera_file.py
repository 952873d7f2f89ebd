"""camera.toml: the calibrated camera, and beside it the shape of the board that it was found with, if that is bent.

    [[boards]]
    board = "3f0c..."             # Board.digest: the shape is that of this board and of no other
    heights = { degree = 2, coefficients = [...] }    # metres

A board's pose is found with the shape it had while the camera was calibrated. Taken for flat, a sheet bent by 2 mm
moves what is drawn on it by pixels.
"""

import os
from collections.abc import Iterable

import msgspec

from raytwin import files
from raytwin.calib.boards import Board, Heights, check_heights
from raytwin.scene import Camera, Record


class BoardShape(Record, frozen=True):
    """The shape of the board whose `Board.digest` is `board`."""

    board: str
    heights: Heights


class _ShapesOnly(Record, frozen=True):
    boards: tuple[BoardShape, ...] = ()


def write_camera_file(path: str | os.PathLike, camera: Camera, board: Board, comment: str = "") -> None:
    """Write the camera, and the board's shape if it is bent."""
    table = files.plain(camera)
    if board.heights is not None:
        table["boards"] = files.plain([BoardShape(board.digest, board.heights)])
    files.write_toml(path, table, comment)


def read_board_shapes(path: str | os.PathLike) -> tuple[BoardShape, ...]:
    """Return the shapes in a camera.toml; none where it was written without."""
    data = files.read_toml(path)
    shapes = files.to_record(path, {k: v for k, v in data.items() if k == "boards"}, _ShapesOnly).boards
    for i, shape in enumerate(shapes):
        check_heights(shape.heights, f"{path}: boards[{i}]")
    return shapes


def with_shape(board: Board, shapes: Iterable[BoardShape]) -> Board:
    """Return the board with the shape that was found for it; unchanged where there is none for this board."""
    heights = next((s.heights for s in shapes if s.board == board.digest), None)
    return board if heights is None else msgspec.structs.replace(board, heights=heights)
