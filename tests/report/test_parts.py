"""Small pictures of the ledger's parts."""

import base64
import io

import numpy as np
import pytest
from PIL import Image as Pillow

from raytwin.analysis.ledger import Ledger
from raytwin.report.ledger_pictures import WIDE, small_pictures


def shown(url: str) -> np.ndarray:
    return np.asarray(Pillow.open(io.BytesIO(base64.b64decode(url.partition(",")[2]))).convert("RGB"), int)


@pytest.mark.parametrize("size", [(9, 12), (301, 400), (3, 1000)])
def test_too_bright_is_red_too_dark_is_blue_and_nothing_has_no_picture(size):
    picture = np.zeros((*size, 3), np.float32)
    picture[:, : size[1] // 2] = 0.02
    picture[:, -(size[1] // 3) :] = -0.02
    noise = picture + np.where((np.indices(size).sum(axis=0) % 2)[..., None], 0.5, -0.5).astype(np.float32)
    nothing = np.zeros_like(picture)
    found = small_pictures(Ledger((), {"some": picture, "grey": noise, "none": nothing}, picture, 1))
    assert set(found) == {"some", "grey"}
    some = found["some"]
    pixels = shown(some.url)
    assert pixels.shape == (some.height, some.width, 3)
    assert some.width <= WIDE
    assert some.scale == pytest.approx(0.02)
    left, right = pixels[:, 1], pixels[:, -2]
    assert (left[:, 0] > left[:, 2] + 50).all()
    assert (right[:, 2] > right[:, 0] + 50).all()
    assert (pixels[:, int(0.58 * some.width)] == 255).all()
    if size == (301, 400):  # blocks of 3 x 3, whose 9 alternating values leave a ninth
        assert found["grey"].scale < 0.2
    assert small_pictures(None) == {}
