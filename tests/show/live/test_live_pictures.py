"""What the live page is sent: pixels as the viewer would show them, and light paths that end before the eye."""

import io

import msgspec
import numpy as np
import pytest
from PIL import Image as Pillow

from raytwin.fast import trace
from raytwin.show.live.light_path import NEAR_METRES, _project
from raytwin.show.live.progressive import Session, picture, to_screen
from raytwin.show.live.view_state import Look, wanted_of


def srgb(x: float) -> float:
    """IEC 61966-2-1, written once more."""
    return 12.92 * x if x <= 0.0031308 else 1.055 * x ** (1 / 2.4) - 0.055


def test_a_pictures_pixels_are_the_radiance_as_the_viewer_would_show_it(base):
    values = (0.0, 0.002, 0.05, 0.25, 0.5, 0.9, 1.0, 3.0)
    for exposure in (0.0, 1.0):
        pixels = to_screen(np.tile(np.array(values, np.float32)[:, None, None], (1, 8, 3)), exposure)
        for value, row in zip(values, pixels, strict=True):
            shown = 255 * srgb(min(2**exposure * value, 1))
            assert row == pytest.approx(shown, abs=1), (exposure, value)  # half floats, then a rounding
        assert to_screen(np.full((1, 1, 3), -1, np.float32), exposure).max() == 0
    image = trace(base, "shadow")
    event, (jpeg,) = picture("test", image, Look(), 0.5, 1)
    sent = np.asarray(Pillow.open(io.BytesIO(jpeg)).convert("RGB"), float)
    assert (event["pane"], event["seconds"], event["samples"]) == ("test", 0.5, 1)
    assert np.mean(np.abs(sent - to_screen(image.mean, 0.0))) < 4  # JPEG's own loss


def test_while_the_view_moves_two_pictures_are_sent_and_no_surface_is_kept(base):
    session, still = Session(base), wanted_of(base, "numpy32")
    moving = msgspec.structs.replace(still, moving=True)
    assert [event["kind"] for event, _ in session.passes(moving)] == ["picture", "picture"]
    for level in ("shadow", "path"):
        for wish in (still, moving):
            tracer = session.tracer(msgspec.structs.replace(wish, rung=level), 1)
            assert tracer.surface == (wish is still)


def test_a_path_that_runs_to_the_eyes_plane_or_behind_it_ends_before_it(base):
    camera = msgspec.structs.replace(base.camera, dist=())
    (fx, _, cx), (_, fy, cy) = camera.K[:2]
    start = (0.5, 0.2, 1.0)
    assert _project(camera, (0.3, -0.2, 2.0), start) == pytest.approx((fx * 0.15 + cx, -fy * 0.1 + cy))
    for x, z in ((-0.3, -1.0), (0.0, -1.0), (0.3, -1.0), (0.0, 0.0)):
        # The line from `start` to (x, 0, z) meets NEAR_METRES after this share of it.
        share = (1 - NEAR_METRES) / (1 - z)
        end = (0.5 + (x - 0.5) * share) / NEAR_METRES, (0.2 - 0.2 * share) / NEAR_METRES
        expected = fx * end[0] + cx, fy * end[1] + cy
        assert _project(camera, (x, 0.0, z), start) == pytest.approx(expected), (x, z)
