from pathlib import Path

import pytest

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
