"""camera.toml: the calibrated camera, and beside it the shape of the board that it was found with, if that is bent.

    [[boards]]
    board = "3f0c..."                     # Board.digest: the shape is that of this board and of no other
    offsets = [[0.0, 0.0, 0.001], ...]    # metres, a row per tag: see Board.offsets

A board's pose is found with the shape it had while the camera was calibrated. Taken for flat, a sheet bent by 2 mm
moves what is drawn on it by pixels.
"""

import os
from collections.abc import Iterable
from typing import Any

import msgspec

from raytwin.photos.boards import Board, Offsets, check_offsets, refuse_removed
from raytwin.scene import Camera, Record
from raytwin.scene.toml_json import plain, read_toml, to_record, write_toml


class BoardShape(Record, frozen=True):
    """The shape of the board whose `Board.digest` is `board`."""

    board: str
    offsets: Offsets


def write_camera_file(path: str | os.PathLike, camera: Camera, board: Board, comment: str = "") -> None:
    """Write the camera, and the board's shape if it is bent."""
    table = plain(camera)
    if board.offsets is not None:
        table["boards"] = plain([BoardShape(board.digest, board.offsets)])
    write_toml(path, table, comment)


def read_board_shapes(path: str | os.PathLike) -> tuple[BoardShape, ...]:
    """Return the shapes in a camera.toml; none where it was written without."""
    boards = to_record(path, read_toml(path).get("boards", []), list[dict[str, Any]], "boards")
    for i, shape in enumerate(boards):
        refuse_removed(shape, f"{path}: boards[{i}]")
    return to_record(path, boards, tuple[BoardShape, ...], "boards")


def with_shape(board: Board, shapes: Iterable[BoardShape]) -> Board:
    """Return the board with the shape that was found for it; unchanged where there is none for this board."""
    offsets = next((s.offsets for s in shapes if s.board == board.digest), None)
    check_offsets(offsets, len(board.centers()), "boards")
    return board if offsets is None else msgspec.structs.replace(board, offsets=offsets)
