import os
import sys
from pathlib import Path

import hypothesis
import pytest
import shape_checks  # before anything of raytwin is imported
import threadpoolctl

pytest_plugins = ["engines", "browser", "installed_wheel", "no_skips"]

# One thread of OpenBLAS each: beside other processes its second spins, and small fits cost five times as much. The
# variable is for the processes that tests start; NumPy is here already.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
threadpoolctl.threadpool_limits(1, user_api="blas")

# pytest-xdist gives its workers 80 columns, at which sentences would be broken: `program.py` asks for a wide terminal.
os.environ.pop("COLUMNS", None)

# The same examples every time: a run that passed passes again.
hypothesis.settings.register_profile("raytwin", derandomize=True, deadline=None, max_examples=60)
hypothesis.settings.load_profile("raytwin")

ROOT = Path(__file__).resolve().parent.parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first: in the end no process waits for another's."""
    long = {item.path for item in items if item.get_closest_marker("nightly")}
    items.sort(key=lambda item: item.path not in long)


TOGETHER = (
    ("tests/photos/camera/", "tests/test_photographer.py"),
    (
        "tests/teach/grade/test_class.py",
        "tests/teach/grade/test_grader_faults.py",
        "tests/teach/grade/test_student_pages.py",
    ),
)
"""Files, or folders, that share what costs most: a folder of photos, a class that is graded."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log):
    """Run the tests of a file, and of TOGETHER, in one process, in the order above: their fixtures are made once."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return next((group[0] for group in TOGETHER if nodeid.startswith(group)), super()._split_scope(nodeid))

    config.option.loadscopereorder = False
    return Scheduling(config, log)


def pytest_runtest_setup(item: pytest.Item) -> None:
    shape_checks.next_test(foreign=item.get_closest_marker("foreign") is not None)


@pytest.fixture(autouse=True, scope="session")
def own_cache(tmp_path_factory):
    """No test reads or writes the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAYTWIN_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(autouse=True)
def own_variant():
    """The Mitsuba variant that a test makes the current one is not the next test's."""
    before = getattr(sys.modules.get("raytwin.twin.backend"), "_current", None)
    yield
    backend = sys.modules.get("raytwin.twin.backend")
    if backend is not None and backend._current is not before:
        backend._current = None
        backend.activate(before and before.variant)


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


@pytest.fixture(scope="session")
def real_board(shared_photos):
    """boards.json's `coarse` or `fine`, in metres."""
    from photo_helpers import stored_board

    return lambda name: stored_board(shared_photos, name)


@pytest.fixture(scope="session")
def real_tags(shared_photos):
    """A set's stored detections, in OpenCV's pixels, and its image size."""
    from photo_helpers import stored_tags

    return lambda name: stored_tags(shared_photos, name)


@pytest.fixture(scope="session")
def shoot(tmp_path_factory):
    """A folder of photos of the plain renderer's, and their truth; made once for the same arguments."""
    from photo_helpers import BOARD, BentRenderer, PlainRenderer, a_camera

    from raytwin.photos.synthetic_photos import photograph

    made = {}

    def take(
        count: int = 12, dist=(0.08, -0.16), width: int = 1008, height: int = 756, seed: int = 1, bend: float = 0.0
    ):
        key = (count, dist, width, height, seed, bend)
        if key not in made:
            out = tmp_path_factory.mktemp("photos")
            render = BentRenderer(BOARD, bend) if bend else PlainRenderer()
            made[key] = out, photograph(BOARD, a_camera(width, height, dist), count, out, render, seed=seed)
        return made[key]

    return take
