"""A tag's corners to its centre: where the diagonals cross, in pixels whose integers are the pixels' centres."""

from typing import Any

import numpy as np

from raytwin.teach.contract.stage import Arrays, Case, Stage, text_variants


def tag_centers(corners: Any) -> Any:
    """The images (N, 2) of the tags' centres, in OpenCV's pixels: (0, 0) is the centre of the top-left pixel."""
    a, b, c, d = np.moveaxis(np.asarray(corners, float), 1, 0)
    return _crossing(a, c, b, d) - 0.5


def _crossing(a: Any, c: Any, b: Any, d: Any) -> np.ndarray:
    """Where a + s (c - a) meets the line b d."""
    s = _cross(b - a, d - b) / _cross(c - a, d - b)
    return np.asarray(a + s[:, None] * (c - a))


def _cross(p: Any, q: Any) -> Any:
    return p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]


def cases(seed: int) -> list[Case]:
    """Tags of some 40 pixels, seen head on and from the side."""
    rng = np.random.default_rng(seed)
    square = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
    made = []
    for shows, lean in (("tags seen head on", 0.0), ("tags seen from the side", 0.35)):
        turn = rng.uniform(0, 2 * np.pi, 12)
        away = lean * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        scale = 1 / (1 + square @ away.T).T[..., None]  # (12, 4, 1): farther corners are nearer to the middle
        corners = rng.uniform(100, 500, (12, 1, 2)) + rng.uniform(15, 30, (12, 1, 1)) * square * scale
        made.append(Case(shows, (corners,), (tag_centers(corners),)))
    return made


def errors(case: Case, got: Arrays) -> np.ndarray:
    """The distance from where it should be, in pixels."""
    return np.asarray(np.linalg.norm(got[0] - case.expected[0], axis=-1))


STAGE = Stage(tag_centers, ("centers",), cases, errors, 1e-3, "pixels", text_variants(tag_centers))
