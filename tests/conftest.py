from pathlib import Path

import hypothesis
import pytest

# The same examples every time: a run that passed passes again.
hypothesis.settings.register_profile("raytwin", derandomize=True, deadline=None)
hypothesis.settings.load_profile("raytwin")

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def scenes() -> Path:
    """The shipped scenes."""
    return ROOT / "scenes"


@pytest.fixture(scope="session")
def shared_photos() -> Path:
    """Third-party photos beside the repository; they are not part of it."""
    folder = ROOT.parent / "shared" / "photos"
    if not folder.is_dir():
        pytest.skip("real photos: ../shared/photos is not there")
    return folder
