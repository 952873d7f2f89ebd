"""camera.toml: the calibrated camera, and as `[board]` the board that it was found with, if that is bent.

A pose is found with the shape that the board had while the camera was calibrated: taken for flat, a sheet bent by 2 mm
moves what is drawn on it by pixels.
"""

import os

from raytwin.photos.boards import Board, parse_board
from raytwin.scene import Camera
from raytwin.scene.toml_json import plain, read_toml, write_toml


def write_camera_file(path: str | os.PathLike, camera: Camera, board: Board, comment: str = "") -> None:
    """Write the camera, and the board if it is bent."""
    bent = {"board": plain(board)} if board.offsets is not None else {}
    write_toml(path, plain(camera) | bent, comment)


def with_shape(board: Board, path: str | os.PathLike) -> Board:
    """Return the board as bent as the camera.toml `path` has it; unchanged where that has none, or another board."""
    if (table := read_toml(path).get("board")) is None:
        return board
    stored = parse_board(table, path, "board")
    return stored if stored.flat() == board.flat() else board
