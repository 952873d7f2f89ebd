"""How paper bends: the tags' edges on a bent sheet, and the bow of synthetic photos."""

import msgspec
import numpy as np
import pytest
from photo_helpers import BOARD

from raytwin.photos.camera.bias import _edges
from raytwin.photos.synthetic_photos import bow_of


def test_the_edges_of_tags_on_a_parabola_rise_as_it_does():
    """z = c s²/2 of a tag's edge over that of its centre, to the outermost tags."""
    xy = np.array([*BOARD.centers().values()])
    s = (xy - xy.mean(axis=0)) @ (0.8, 0.6)
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
        row = (extent[3] - at[1]) / (extent[3] - extent[2]) * size[0]
        column = (at[0] - extent[0]) / (extent[1] - extent[0]) * size[1]
        assert np.abs(seen[int(row), int(column)] - p).max() < 2.5e-4  # a texel is 0.2 mm
