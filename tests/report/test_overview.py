"""The small picture of a comparison: its size, whatever the frame's."""

from types import SimpleNamespace

import numpy as np
import pytest

from raytwin.image import Image
from raytwin.report.overview import GAP, overview, panel_size
from raytwin.scene import Tolerance


@pytest.mark.parametrize(
    ("frame", "panel"),
    [((600, 800), (300, 400)), ((3, 4), (300, 400)), ((1600, 400), (1600, 400)), ((30_000, 2), (1600, 1)),
     ((2, 30_000), (1, 400)), ((3200, 400), (1600, 200))],
)  # fmt: skip
def test_a_panel_is_400_pixels_wide_or_1600_high(frame, panel):
    assert panel_size(*frame) == panel


def test_the_overview_of_a_frame_of_2_by_30000_pixels_is_small():
    image = Image(np.full((30_000, 2, 3), 0.5, np.float32))
    made = SimpleNamespace(photo=None, augmented=None, test=image, reference=image, tolerance=Tolerance())
    assert overview(made).shape == (1600, 3 * 1 + 2 * GAP, 3)
