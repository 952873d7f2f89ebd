"""The contract of every kind of page: it opens offline, keeps names as text, fits a phone, and axe-core finds nothing.

A row of KINDS writes the pages of a kind into a folder, with EVIL where a name from outside stands. To add a kind of
page, add a row.
"""

import os
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import quote

import msgspec
import numpy as np
import pytest
from browser import barriers_of
from test_bench_page import every_method

from raytwin.compare import Report, compare
from raytwin.compare.comparison import Part
from raytwin.explain.ledger import Ledger
from raytwin.images.exr import write_exr
from raytwin.images.image import Image
from raytwin.images.photo_files import list_photos, to_bytes
from raytwin.photos import boards
from raytwin.photos.camera import CalibrationWarning, calibrate
from raytwin.photos.lighting import light_models
from raytwin.photos.lighting.estimate_light import LightEstimate
from raytwin.photos.lighting.linear_photo import LinearPhoto
from raytwin.scene import Camera
from raytwin.show import atlas_page, check_page, class_page, laws_page, light_page, merged_page, sampler_page, viewer
from raytwin.show.bench_page import write_bench_page
from raytwin.show.calibration_page import write_calibration
from raytwin.show.compare_page import write_report
from raytwin.show.data_urls import png_url
from raytwin.show.levels_page import write_levels
from raytwin.show.view import view_of
from raytwin.study.atlas import Atlas
from raytwin.study.atlas.experiment import Curve, Found
from raytwin.study.diff_files import compare as compare_files
from raytwin.study.laws import LawRow, Laws, builtin_scene
from raytwin.study.levels import Levels, Row, Table
from raytwin.study.levels import Part as LightPart
from raytwin.teach.contract.stage_table import LESSONS
from raytwin.teach.grade.result import CodeLine, Marked, MarkedPart, Picture, Result
from raytwin.teach.grade.rubric import Exercise, Rubric

pytestmark = pytest.mark.nightly

EVIL = "<img src=x onerror=alert(1)>\"'&_with_sixty_or_more_characters_and_no_blank_in_them"
SIZE = 24, 36
"""Height and width: a portrait frame is written as well, turned."""
FROM_ABOVE = (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)
Write = Callable[..., list[Path]]


def noise(shape: tuple[int, ...] = SIZE, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.1, 0.9, (*shape, 3)).astype(np.float32)


def comparison(folder: Path, make_result, scenes, spoiled: bool) -> list[Path]:
    """A photographed scene that passes, or one in portrait that fails for three reasons, with a ledger."""

    def spoil(image: Image) -> Image:
        image.mean[60:64, 20:30] *= 1.5
        image.mean[10, 11] = np.nan
        return image

    result = make_result(photos=not spoiled, size=(90, 120) if spoiled else (120, 90), spoil=spoil if spoiled else None)
    h, w = result.twin.shape[:2]
    picture = np.full((h // 2, w // 2, 3), 0.01, np.float32)
    rows = (Part("sun's shadow", rmse=0.01, noise=0.001, share_of_light=0.1), Part("noise", rmse=0.1))
    told = msgspec.structs.replace(result.report.saying(EVIL), scene=EVIL, ledger=rows)
    scene = msgspec.structs.replace(result.scene, name=EVIL)
    ledger = Ledger(rows, {"sun's shadow": picture}, picture, 2)
    write_report(replace(result, scene=scene, report=told, ledger=ledger), folder / "report.html")
    return [folder / "report.html"]


def two_sizes(folder: Path, make_result, scenes) -> list[Path]:
    for name, shape in (("a", SIZE), ("b", SIZE[::-1])):
        write_exr(folder / f"{name} <b>.exr", Image(noise(shape)))
    write_report(view_of(compare_files(folder / "a <b>.exr", folder / "b <b>.exr")), folder / "diff.html")
    return [folder / "diff.html"]


def test_run(folder: Path, make_result, scenes) -> list[Path]:
    image, wrong = Image(noise()), Image(noise() * 1.2)
    check_page.prepare(folder)
    for number, test in enumerate((image, wrong)):
        told = Report(EVIL, "shadow", compare(test, image))
        check_page.write_check(folder, f"test_it.py::test[{EVIL}]", number, told, (EVIL,), test, image)
    check_page.write_crash(folder, f"test_it.py::crash[{EVIL}]", 0, EVIL, f"ValueError: {EVIL}")
    assert check_page.write_index(folder) == (3, 2)
    return sorted(folder.glob("*.html"))


def merged(folder: Path, make_result, scenes) -> list[Path]:
    machines = [folder / name for name in ("linux", "mac", "windows")]
    for machine in machines:
        test_run(machine, make_result, scenes)
    next(machines[1].glob("check-*[0-9a-f].json")).unlink()
    merged_page.write_merged(merged_page.merge(machines), machines, folder / "all")
    return [folder / "all" / "index.html"]


def laws(folder: Path, make_result, scenes) -> list[Path]:
    rows = tuple(LawRow(f"{verdict} {EVIL}", EVIL, verdict, (EVIL,), EVIL) for verdict in laws_page.SIGN)
    pictures = {rows[0].law: (Image(noise()), Image(noise(seed=2)))}
    laws_page.write_laws(Laws(EVIL, builtin_scene(), "shadow", rows, pictures), folder)
    return [folder / "laws.html"]


def bench(folder: Path, make_result, scenes) -> list[Path]:
    found = msgspec.structs.replace(every_method(((400, 300),)), scene=EVIL, machine={"cpu": EVIL})
    subjects = "numpy32-shadow-conic", EVIL
    rows = tuple(msgspec.structs.replace(r, verdict="fail", reason=EVIL) for r in found.rows)
    wrong = msgspec.structs.replace(found, scene=f"{EVIL}2", rows=rows, subjects=subjects)
    images = {name: Image(noise(seed=i)) for i, name in enumerate((*subjects, "reference path-area"))}
    write_bench_page([msgspec.structs.replace(found, subjects=subjects), wrong], folder / "bench.html", images)
    return [folder / "bench.html"]


def atlas(folder: Path, make_result, scenes) -> list[Path]:
    curves = {"textbook": Curve((1e-7, 1e-2, 1.0), 20.0, 30.0), "robust": Curve((1e-7, 1e-7, None), None, None)}
    found = Found("sphere-far", "radii", (1.0, 10.0, 100.0), 1e-3, curves, EVIL, EVIL)
    atlas_page.write_atlas(Atlas((found,)), folder)
    return [folder / "atlas.html"]


def levels(folder: Path, make_result, scenes) -> list[Path]:
    images = {name: Image(noise(seed=i)) for i, name in enumerate(("tracer: shadow", "reference: all light"))}
    rows = tuple(Row(EVIL, side, "shadow", None, "center", 1, 1.5, 0.002, 0.0144, 0.015) for side in ("tracer", "twin"))
    parts = (LightPart(EVIL, 0.014, 0.015, -0.0191, True),)
    found = Table(EVIL, *SIZE[::-1], "rmse", 0.02, rows[0], EVIL, rows, parts, 64, 0.002, 1.0)
    write_levels(Levels(found, images), folder)
    return [folder / "levels.html"]


def sampler(folder: Path, make_result, scenes) -> list[Path]:
    def wrong(u):
        directions, pdf, weight = LESSONS["sample_cosine"].reference(u)
        return directions, 2 * pdf, weight

    sampler_page.write_sampler("sample_cosine", wrong, folder / "sampler.html")
    return [folder / "sampler.html"]


def calibration(folder: Path, make_result, scenes) -> list[Path]:
    desk = scenes / "desk"
    found = calibrate(list_photos(desk / "photos")[:4], boards.read_board(desk / "board.toml"))
    views = (msgspec.structs.replace(found.views[0], photo=EVIL), *found.views[1:])
    warning = (CalibrationWarning("few_views", EVIL),)
    write_calibration(msgspec.structs.replace(found, views=views, warnings=warning), folder / "camera.html", EVIL)
    return [folder / "camera.html"]


def light(folder: Path, make_result, scenes) -> list[Path]:
    """A photo in which nothing was outlined, and a map with a sun in it."""
    camera = Camera(SIZE[::-1], ((30.0, 0.0, 18.0), (0.0, 30.0, 12.0), (0.0, 0.0, 1.0)), FROM_ABOVE, (0.0, 0.0, 1.0))
    pixels = to_bytes(noise())
    photo = LinearPhoto(EVIL, camera, noise(), np.zeros(SIZE, bool), pixels, np.ones(3), np.ones(SIZE))
    up, grey = np.array([0.0, 0.6, 0.8]), np.full(3, 0.4)
    sun_and_map = light_models.Light(up, 0.01, grey, 0.1 * grey, grey, 0.1 * grey, noise((8, 16)))
    board = boards.read_board(scenes / "desk" / "board.toml")
    found = LightEstimate(photo, board, light=sun_and_map, warnings=[EVIL], drawn=pixels)
    light_page.write_light_page(found, folder / "light.html")
    return [folder / "light.html"]


def graded_class(folder: Path, make_result, scenes) -> list[Path]:
    """Two students with the same wrong numbers and one who handed in nothing that runs; pages of all, a handout."""
    exercises = (Exercise("shade", 10, name=EVIL), Exercise("render", 20, name="image", drawn=1))
    rubric = Rubric(EVIL, exercises)
    parts = (MarkedPart(EVIL, False, 0.25, 0.1, 0.5, problem=EVIL),)
    image = Marked("image", "render", "fail", 0, 20, "hidden", EVIL, 1e-5, sentences=(EVIL,), parts=parts)
    shade = msgspec.structs.replace(
        image, name=EVIL, stage="shade", of=10, visibility="visible", causes=("pi",), sureness="proved",
        faults=((EVIL, EVIL),), inputs=EVIL, expected=EVIL, got=EVIL,
        code=(CodeLine(1, EVIL, True), CodeLine(2, EVIL, False)),
    )  # fmt: skip
    packed = viewer.pack(Image(noise()), Image(noise(seed=2)), surfaces=False).for_page()
    thumb = png_url(to_bytes(noise()))
    pictures = (Picture("image", EVIL, thumb, msgspec.json.encode(packed).decode()), Picture("image", EVIL, thumb))
    wrong = Result(f"a {EVIL}", "a", EVIL, (shade, image), printed=EVIL, notes=(EVIL,), open_locks=(EVIL,),
                   pictures=pictures, graded="2026-01-01 00:00")  # fmt: skip
    same, none = msgspec.structs.replace(wrong, student="b", key="b"), Result(f"c {EVIL}", "c", EVIL, (), problem=EVIL)
    done = tuple(msgspec.structs.replace(e, status="pass") for e in (shade, image))
    right = msgspec.structs.replace(wrong, student="d", key="d", exercises=done)
    kept = msgspec.structs.replace(same, exercises=(shade, msgspec.structs.replace(image, same_as=EVIL, followed=2.0)))
    assert class_page.write_class((wrong, kept, none, right), rubric, folder, for_students=True) == []
    handed_out = min((folder / "for-students").iterdir())
    return [folder / "index.html", *sorted((folder / "students").iterdir())[:3], handed_out]


KINDS: dict[str, Write] = {
    "compare, pass": partial(comparison, spoiled=False),
    "compare, fail": partial(comparison, spoiled=True),
    "diff of two sizes": two_sizes,
    "pytest": test_run,
    "merged": merged,
    "laws": laws,
    "bench": bench,
    "stability": atlas,
    "levels": levels,
    "sampler": sampler,
    "calibrate": calibration,
    "light": light,
    "grade": graded_class,
}
test_run.__test__ = False  # a kind, and no test


class Tags(HTMLParser):
    """The addresses that a page's tags name, and the attributes that run scripts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.urls: list[str] = []
        self.acts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.urls += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "data", "action")]
        self.acts += [name for name, _ in attrs if name.startswith("on")]


@pytest.mark.parametrize("kind", KINDS)
def test_a_page_opens_offline_keeps_names_as_text_and_shuts_nobody_out(kind, make_result, scenes, tmp_path, chromium):
    for page in KINDS[kind](tmp_path, make_result, scenes):
        text = page.read_text(encoding="utf-8")
        own = {quote(os.path.relpath(p, page.parent)) for p in tmp_path.rglob("*")}
        tags = Tags(text)
        outside = [url for url in tags.urls if not url.startswith(("data:", "#"))]
        assert {quote(url) for url in outside} <= own, page
        assert tags.acts == [], page
        styles = re.sub(r"<script\b[^>]*>.*?</script>", "", text, flags=re.DOTALL)
        assert not re.search(r"(?:@import|url\()\s*[\"']?(?!data:|#)", styles), page
        assert barriers_of(chromium, page) == [], page
