"""The result of a calibration: the camera with its uncertainty, the views, warnings, and the evidence behind it.

camera.toml holds the camera, and as `[board]` the board that it was found with, if that is bent: taken for flat, a
sheet bent by 2 mm moves what is drawn on it by pixels.
"""

import os
from typing import Any

import msgspec

from raytwin.photos.boards import Board, Offsets, parse_board
from raytwin.scene import Camera, Matrix, Record, Vector
from raytwin.scene.toml_json import plain, read_toml, write_toml


class View(Record, frozen=True):
    """The board in one photo: number of tags used, their rms distance, `p_cam = R_cam_board @ p_board + t_cam_board`.

    `influence`: by how many of their standard deviations fx, fy, cx and cy move (rms) when the photo is left out.
    """

    photo: str
    tags: int
    rms_px: float
    R_cam_board: Matrix
    t_cam_board: Vector
    influence: float = 0.0


class FoundBoard(Record, frozen=True):
    """The board as fitted: `offsets` is None if it is flat. `bend_mm`: from the lowest tag to the highest,
    `bend_sigma_mm` one standard deviation of it."""

    offsets: Offsets | None = None
    bend_mm: float = 0.0
    bend_sigma_mm: float = 0.0


class CalibrationWarning(Record, frozen=True):
    code: str
    text: str


class Evidence(Record, frozen=True):
    """What a calibration rests on; not part of its JSON, and empty where none was made here.

    `held_out_px`: each model's error in unseen photos, that of the one `taken` among them. `board`: with its shape.
    `seen`: the tags' centres, by view; `residuals`: projected minus seen of each, pixels.
    """

    held_out_px: dict[str, float] = msgspec.field(default_factory=dict)
    taken: str = ""
    board: Board | None = None
    seen: tuple[tuple[float, float], ...] = ()
    residuals: tuple[tuple[float, float], ...] = ()


class Calibration(Record, frozen=True):
    """The camera and how well it is known.

    `K` in OpenCV's pixels; `dist` is a prefix of k1, k2, p1, p2, k3; `sigma` holds one standard deviation of fx, fy,
    cx, cy and of each coefficient that was fitted; `rms_px` is over all tags used.
    """

    image_size: tuple[int, int]
    model: str
    K: Matrix
    dist: tuple[float, ...]
    sigma: dict[str, float]
    rms_px: float
    views: tuple[View, ...]
    board: FoundBoard = FoundBoard()
    warnings: tuple[CalibrationWarning, ...] = ()
    evidence: Evidence = Evidence()

    def to_dict(self) -> dict[str, Any]:
        """What the JSON holds; `boards` is a list of one."""
        fields = {k: v for k, v in msgspec.structs.asdict(self).items() if k not in ("evidence", "board")}
        built: dict[str, Any] = msgspec.to_builtins(fields | {"boards": [self.board]})
        return built

    def table(self) -> list[dict[str, Any]]:
        """A row per photo, for `pandas.DataFrame`."""
        return [view.to_dict() for view in self.views]

    def __repr__(self) -> str:
        found = f"fx {self.K[0][0]:.6g}, fy {self.K[1][1]:.6g}, rms {self.rms_px:.3f} px"
        return f"<raytwin.calibrate {len(self.views)} photos, model {self.model}, {found}>"

    def shaped(self, board: Board) -> Board:
        """The board with the shape that was found for it; another board is returned as it is."""
        found = self.evidence.board
        return found if found is not None and found.flat() == board.flat() else board


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
