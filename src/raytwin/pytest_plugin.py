"""pytest plugin: compare any renderer with reference images.

    def test_my_renderer(raytwin_reference):
        reference = raytwin_reference("overlap", "shadow")
        reference.check(render(reference.scene_dict))

Loaded by every pytest run on a machine that has raytwin: so this file imports nothing but pytest at load.
"""

import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Generator

    from raytwin.reference_check import ReferenceCheck
    from raytwin.scene import Scene
    from raytwin.study.laws import Laws


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("raytwin", "renders beside reference images")
    group.addoption(
        "--raytwin-update",
        action="store_true",
        help="Make references that are missing, damaged or stale; take images without a scene as their own reference.",
    )
    group.addoption("--raytwin-report", metavar="DIR", help="Write a page for each comparison, and an index of them.")
    parser.addini("raytwin_references", "Folder of your own references (default: reference), before those shipped.")
    parser.addini("raytwin_scenes", "Folder of the scenes that they are made from (default: scenes).")


# ------------------------------------------------------------------------------------------ fixtures


@pytest.fixture
def raytwin_reference(request: pytest.FixtureRequest) -> "Callable[..., ReferenceCheck]":
    """`raytwin_reference(scene, rung="shadow")`: the reference, with `.check(image)`, `.scene` and `.camera`.

    A Mitsuba file has one rung, `path`. `image=True`: there is no scene of that name, and --raytwin-update takes the
    image under test for the reference.
    """

    def find(scene: str, rung: str = "shadow", image: bool = False) -> "ReferenceCheck":
        __tracebackhide__ = True
        from raytwin.reference_check import ReferenceCheck

        return ReferenceCheck(request, scene, rung, image)

    return find


@pytest.fixture
def raytwin_laws(request: pytest.FixtureRequest) -> "Callable[..., Laws]":
    """`raytwin_laws(render, rung="shadow", without="")`: fail unless `render` keeps the laws that need no reference.

    `render` is a function as `raytwin.method` takes it; `scene` is changed in the place of the built-in one, `sampling`
    says where rays go, and `without="planes"` that the renderer has no rectangles. Returns what was found.
    """

    def judge(
        render: Any, rung: str = "shadow", scene: "Scene | None" = None, sampling: str = "center", without: str = ""
    ) -> "Laws":
        __tracebackhide__ = True
        from raytwin.errors import InputError
        from raytwin.reference_check import numbered, report_folder
        from raytwin.renderers.user_renderers import of_function
        from raytwin.show import check_page, laws_page
        from raytwin.study.laws import laws

        try:
            found = laws(of_function(render, "", rung, sampling), scene, without=without)
            text = laws_page.laws_summary(found)
            if (folder := report_folder(request.config)) is not None:
                page = check_page.write_laws(folder, *numbered(request.node, found.verdict), found)
                text += f"\n  page: {page}"
        except InputError as error:
            raise pytest.fail.Exception(str(error)) from None
        if found.verdict != "pass":
            pytest.fail(text)
        return found

    return judge


# ------------------------------------------------------------------------------------------ report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> "Generator[None, Any, Any]":
    """List a test that ended by an error of its own, too."""
    report = yield
    ours = {"raytwin_laws", "raytwin_reference"} & set(getattr(item, "fixturenames", ()))
    if ours and report.failed and item.config.getoption("--raytwin-report"):
        from raytwin.reference_check import list_crash

        list_crash(item, call)
    return report


_TOLD = pytest.StashKey[str]()
"""What the run says of its report in the end."""


def _index_folder(config: pytest.Config) -> Path | None:
    """Under pytest-xdist, tests run in workers, and only the session that started them writes the index."""
    asked = config.getoption("--raytwin-report")
    return config.invocation_params.dir / asked if asked and not hasattr(config, "workerinput") else None


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    if (folder := _index_folder(session.config)) is not None:
        from raytwin.errors import InputError
        from raytwin.show import check_page

        try:
            check_page.prepare(folder)
        except InputError as error:
            raise pytest.UsageError(f"--raytwin-report: {error}") from None


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    if (folder := _index_folder(session.config)) is not None:
        from raytwin.errors import InputError
        from raytwin.show import check_page
        from raytwin.show.terminal_text import counted

        try:
            count, failed = check_page.write_index(folder)
            told = f"{counted(count, 'comparison')}, {failed} failed: {folder / check_page.INDEX}"
        except InputError as error:
            told = f"no report: {error}"
            session.exitstatus = session.exitstatus or pytest.ExitCode.USAGE_ERROR
        session.config.stash[_TOLD] = told


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    if told := config.stash.get(_TOLD, None):
        terminalreporter.write_line(f"raytwin: {told}")
    reports = itertools.chain.from_iterable(terminalreporter.stats.values())
    told_of = [own for report in reports for own in getattr(report, "user_properties", ())]
    for written in dict.fromkeys(text for name, text in told_of if name == "raytwin"):
        terminalreporter.write_line(f"raytwin: {written}")
