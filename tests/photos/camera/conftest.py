import hashlib
from pathlib import Path

import pytest
from photo_helpers import BOARD

from raytwin.photos.camera import Calibration, calibrate, detection


@pytest.fixture(scope="session")
def plain_found(shoot) -> Calibration:
    """Calibrated from photos of a flat board."""
    return calibrate(sorted(shoot()[0].glob("*.jpg")), BOARD)


@pytest.fixture(scope="session")
def bent_found(shoot) -> Calibration:
    """Calibrated from photos of a board bent by 3 mm."""
    return calibrate(sorted(shoot(14, bend=3e-3)[0].glob("*.jpg")), BOARD)


@pytest.fixture(autouse=True, scope="package")
def searched_once():
    """A photo that one test has searched for tags, another of the same bytes need not be searched for again."""
    known, search = {}, detection.detect_photo

    def detect_photo(path, kind="tag36h11"):
        key = hashlib.sha256(Path(path).read_bytes()).hexdigest(), kind
        if key not in known:
            known[key] = search(path, kind)
        return list(known[key])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(detection, "detect_photo", detect_photo)
        yield
