"""Where labels go on a crowded chart: near their point, never over another label, a leader where they stand away.

Greedy: each label in turn takes the nearest free place of those around its point. All is in pixels of the frame, x to
the right, y up.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

WIDTH, BOLD_WIDTH = 0.62, 0.69
"""Average width of a character of DejaVu Sans, a wide font, as a share of the font's size."""

REACHES = (9, 15, 24, 36, 50, 68, 90, 115, 145, 180)
TURNS = 20
"""Directions from its mark in which a label's place is tried."""


@dataclass(frozen=True)
class Label:
    """`text` at its point (x, y); `size`: of the font, pixels. `others`: points that would do as well."""

    text: str
    x: float
    y: float
    size: float = 11.0
    bold: bool = False
    others: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Place:
    """The text's left end and middle; `leader`: from the point to the text, None where they are close."""

    x: float
    y: float
    leader: tuple[float, float, float, float] | None


def place(
    labels: Sequence[Label], points: Sequence[tuple[float, float]], width: float, height: float
) -> list[Place | None]:
    """A place for each label within the frame, in the order of their importance; None where every place is taken."""
    boxes = np.empty((0, 4))
    marks = np.asarray(points, float).reshape(-1, 2)
    ways = [(np.cos(a), np.sin(a)) for a in np.arange(TURNS) * 2 * np.pi / TURNS]
    # To the right first, then the other sides: ties go to the first.
    ways.sort(key=lambda w: -w[0])
    out: list[Place | None] = []
    for label in labels:
        w = (BOLD_WIDTH if label.bold else WIDTH) * label.size * len(label.text) + 2
        h = label.size + 2
        found = []
        for px, py in ((label.x, label.y), *label.others):
            for reach in REACHES:
                for cx, cy in ways:
                    # The box's nearest side stands `reach` from the point.
                    middle_x, middle_y = px + cx * (reach - 4 + w / 2), py + cy * (reach - 4 + h / 2)
                    found.append(
                        (middle_x - w / 2, middle_y - h / 2, middle_x + w / 2, middle_y + h / 2, reach, px, py)
                    )
        c = np.array(found)
        inside = (c[:, 0] > 1) & (c[:, 1] > 1) & (c[:, 2] < width - 1) & (c[:, 3] < height - 1)
        free = inside & ~_overlap(c, boxes).any(axis=1)
        hidden = _overlap(c, np.column_stack([marks - 4, marks + 4])).sum(axis=1) if len(marks) else 0
        cost = np.where(free, c[:, 4] + 25 * hidden, np.inf)
        best = int(np.argmin(cost))
        if not np.isfinite(cost[best]):
            out.append(None)
            continue
        x0, y0, x1, y1, reach, px, py = c[best]
        boxes = np.vstack([boxes, c[best, :4]])
        end = float(np.clip(px, x0, x1)), float(np.clip(py, y0, y1))
        out.append(Place(float(x0) + 1, float(y0 + y1) / 2, (float(px), float(py), *end) if reach > 15 else None))
    return out


def _overlap(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n, m) bool of boxes (x0, y0, x1, y1)."""
    a, b = a[:, None], b[None]
    return (a[..., 0] < b[..., 2]) & (b[..., 0] < a[..., 2]) & (a[..., 1] < b[..., 3]) & (b[..., 1] < a[..., 3])
