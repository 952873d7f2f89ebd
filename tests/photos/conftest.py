import json

import pytest
from photo_helpers import BOARD, PlainRenderer, a_camera

from raytwin.photos.board import Board, BoardTag
from raytwin.photos.detect import Tag
from raytwin.photos.photographer import photograph

INCH = 0.0254


@pytest.fixture(scope="session")
def real_board(shared_photos):
    """boards.json's `coarse` or `fine`, in metres."""

    def load(name: str) -> Board:
        data = json.loads((shared_photos / "boards.json").read_text())[name]
        tags = tuple(BoardTag(int(i), (x * INCH, y * INCH)) for i, (x, y) in data["centers_xy"].items())
        return Board(data["family"], data["tag_black_edge"] * INCH, tags=tags)

    return load


@pytest.fixture(scope="session")
def real_tags(shared_photos):
    """A set's stored detections, in OpenCV's pixels, and its image size."""

    def load(name: str) -> tuple[dict[str, list[Tag]], tuple[int, int]]:
        images = json.loads((shared_photos / name / "detections.json").read_text())["images"]
        tags = {
            photo: [
                Tag(
                    t["id"],
                    tuple(c - 0.5 for c in t["center"]),
                    tuple(tuple(c - 0.5 for c in corner) for corner in t["corners"]),
                    t["margin"],
                )
                for t in image["tags"]
            ]
            for photo, image in images.items()
        }
        return tags, tuple(next(iter(images.values()))["size_wh"])

    return load


@pytest.fixture(scope="session")
def shoot(tmp_path_factory):
    """A folder of photos of the plain renderer's, and their truth; made once for the same arguments."""
    made = {}

    def take(count: int = 12, dist=(0.08, -0.16), width: int = 1008, height: int = 756, seed: int = 1):
        key = (count, dist, width, height, seed)
        if key not in made:
            out = tmp_path_factory.mktemp("photos")
            made[key] = out, photograph(BOARD, a_camera(width, height, dist), count, out, PlainRenderer(), seed=seed)
        return made[key]

    return take
