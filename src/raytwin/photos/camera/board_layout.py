"""Whether the tags' neighbours in the photos are those that the board's file gives them."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence

import numpy as np

from raytwin.errors import InputError
from raytwin.photos.boards import Board
from raytwin.photos.camera.detection import Tag

NEIGHBOUR_DISTANCE = 1.5
"""A tag's neighbours lie within this many times the distance to its nearest tag: the diagonal is not among them."""

FARTHER = 1.2
"""A neighbour is another tag's if the file puts it this many times farther off. A diagonal is 1.41 times as far."""


def check_layout(views: Sequence[Sequence[Tag]], board: Board, where: str) -> None:
    """Raise InputError if the board's file gives the tags other neighbours than the photos show."""
    votes: dict[tuple[int, int, bool], list[bool]] = defaultdict(list)
    for tags in views:
        for a, b, up, agrees in _neighbours(tags, board):
            votes[a, b, up].append(agrees)
    wrong = sorted(pair for pair, agree in votes.items() if 2 * sum(agree) < len(agree))
    # Of another number of columns all pairs along one side are wrong, of two ids exchanged or of rows moved a few.
    if not any(2 * sum(w[2] == up for w in wrong) > sum(v[2] == up for v in votes) for up in (True, False)):
        return
    a, b, up = wrong[0]
    if board.grid is None:
        raise InputError(where, "the board that its file describes", f"another: id {b} lies beside id {a}")
    # Along one side of the tags ids rise by one, along the other by a row.
    steps = {u: Counter(abs(b - a) for a, b, along in votes if along == u).most_common(1) for u in (True, False)}
    columns, up = max((step[0][0], u) for u, step in steps.items() if step)
    a, b = next(((a, b) for a, b, u in wrong if u == up and abs(b - a) == columns), (a, b))
    g = board.grid
    want = f"a board of {g.columns} columns and {g.rows} rows, as its file says"
    side = "above" if up else "beside"
    raise InputError(where, want, f"one where id {b} lies {side} id {a}, so it has {columns} columns")


def _neighbours(tags: Sequence[Tag], board: Board) -> Iterator[tuple[int, int, bool, bool]]:
    """Yield (id, id of the tag above or right of it, whether above, whether the file has it there, too)."""
    known = board.centers()
    tags = [tag for tag in tags if tag.id in known]
    if len(tags) < 2:
        return
    pixels, filed = np.array([tag.center for tag in tags]), np.array([known[tag.id] for tag in tags])
    for i, tag in enumerate(tags):
        # Places in this tag's own directions and edges: perspective changes little from a tag to the next.
        a, b, c, d = np.array(tag.corners)
        at = (pixels - pixels[i]) @ np.linalg.pinv(np.stack([b - a + c - d, d - a + c - b]) / 2)
        away, by_file = np.linalg.norm(at, axis=1), np.linalg.norm(filed - filed[i], axis=1)
        away[i] = by_file[i] = np.inf
        for up in (True, False):
            along, across = at[:, int(up)], at[:, 1 - int(up)]
            ahead = np.where(along > 2 * np.abs(across), away, np.inf)
            j = int(ahead.argmin())
            if ahead[j] <= NEIGHBOUR_DISTANCE * away.min():
                agrees = by_file[j] * away.min() <= FARTHER * away[j] * by_file.min()
                yield tag.id, tags[j].id, up, bool(agrees)
