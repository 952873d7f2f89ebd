"""Results to report on: the tracer in float64 beside itself in float32, and the desk's calibration."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from browser import opened
from scene_of import changed

from raytwin.compare import Report, compare
from raytwin.compare.comparison import Part
from raytwin.explain.ledger import Ledger
from raytwin.fast import trace
from raytwin.images.image import Image, Surface
from raytwin.images.photo_files import list_photos, to_bytes
from raytwin.photos import boards
from raytwin.photos.camera import Calibration, calibrate
from raytwin.photos.camera.calibration_result import CalibrationWarning
from raytwin.scene import Scene
from raytwin.scene.scene_files import read_scene
from raytwin.show.compare_page import write_report
from raytwin.study.compare_scene import Result


@pytest.fixture(scope="session")
def make_result(scenes, calibration) -> Callable[..., Result]:
    """`make_result(size=(160, 120), photos=False, spoil=None)`; `spoil(tracer's image)`."""

    def make(size=(160, 120), photos=False, spoil=None) -> Result:
        written, rung = read_scene(scenes / "overlap"), "shadow"
        stage = written.with_camera(written.camera.resized(*size))
        tracer, twin = trace(stage, rung, "numpy64"), trace(stage, rung, "numpy32")
        if spoil is not None:
            tracer = spoil(copied(tracer))
        report = Report(
            stage.name,
            rung,
            compare(tracer, twin, tolerance=written.tolerance),
            {"tracer": 0.412, "twin": 0.24, "compare": 0.0031} | ({"calibrate": 2.31} if photos else {}),
            {"twin_variant": "llvm_ad_rgb", "tracer_engine": "numpy64", "libllvm": None},
        )
        result = Result(
            scene=stage,
            tolerance=written.tolerance,
            report=report,
            test=tracer,
            reference=twin,
            settings={"light level of the tracer": rung, "sphere solver": "robust", "trim boxes": "on"},
            versions={"python": "3.11.2", "raytwin": "0.1.0", "numpy": "2.4.6"},
        )
        return photographed(result, calibration) if photos else result

    return make


@pytest.fixture(scope="session")
def spoiled(make_result, tmp_path_factory) -> tuple[Result, Path]:
    """(result, page) with photos, where the tracer errs: a bright block, three pixels of another object, one NaN.

    And with a ledger that has one part, of every second pixel.
    """

    def spoil(image: Image) -> Image:
        image.mean[60:64, 20:30] *= 1.5
        image.surface.ids[70, 40:43] = -1
        image.mean[10, 11] = np.nan
        return image

    result = make_result(photos=True, spoil=spoil)
    picture = np.zeros((60, 80, 3), np.float32)
    picture[:50, :40], picture[:50, 40:] = 0.02, -0.03
    rows = (Part("sun's shadow", rmse=0.02, noise=0.001), Part("bounce 1", rmse=0.0), Part("noise", rmse=0.001))
    ledger = Ledger(rows, {"sun's shadow": picture, "bounce 1": np.zeros_like(picture)}, picture, 2)
    result = replace(result, ledger=ledger, report=msgspec.structs.replace(result.report, ledger=rows))
    page = tmp_path_factory.mktemp("spoiled") / "report.html"
    write_report(result, page)
    return result, page


@pytest.fixture(scope="session")
def calibration(scenes) -> Calibration:
    """The desk's camera."""
    folder = scenes / "desk"
    return calibrate(list_photos(folder / "photos"), boards.read_board(folder / "board.toml"))


@pytest.fixture(scope="session")
def base(scenes) -> Scene:
    """96 x 72 pixels of the scene `overlap`: what the live page is tested with."""
    written = read_scene(scenes / "overlap")
    return written.with_camera(written.camera.resized(96, 72))


def copied(image: Image) -> Image:
    s = image.surface
    return Image(image.mean.copy(), None, 1, Surface(s.ids.copy(), s.depth.copy(), s.normal.copy()))


def photographed(result: Result, calibration: Calibration) -> Result:
    """With a noisy photo of its planes, and the desk's calibration with a warning."""
    scene: Scene = result.scene
    rng = np.random.default_rng(7)
    empty = trace(changed(scene, objects=scene.planes), "lambert", "numpy32")
    photo = to_bytes(np.clip(empty.mean + rng.normal(0, 0.01, empty.mean.shape), 0, 1).astype(np.float32))
    planes = tuple(msgspec.structs.replace(p, in_photo=True) for p in scene.planes)
    scene = changed(scene, objects=(*scene.spheres, *planes))
    warning = CalibrationWarning("few_views", "12 photos: 15 or more would halve the standard deviations.")
    seen = result.subject.surface.ids
    drawn = (seen >= 0) & (seen < len(scene.spheres))
    augmented = np.where(drawn[..., None], to_bytes(result.subject.mean), photo)
    told = msgspec.structs.replace(calibration, warnings=(warning,))
    return replace(result, scene=scene, photo=photo, augmented=augmented, calibration=told, pose=told.views[2])


# ------------------------------------------------------------------------------------------ a browser

PROBE = """async () => {
  const until = async (test) => {
    for (const last = performance.now() + 60_000; !test(); await new Promise((done) => setTimeout(done, 20)))
      if (performance.now() > last) throw new Error(`never: ${test}`);
  };
  const root = document.getElementById("viewer");
  await until(() => document.body.dataset.ready || root?.dataset.ready);
  const viewer = root?.viewer, drawn = () => viewer.drawn();
  const texts = (id) => [...root.querySelectorAll(`.rt-${id} td`)].map((cell) => cell.textContent);
  const canvas = (key) => viewer.panes.get(key).canvas;
  const status = () => root.querySelector(".rt-status").textContent;
  // Read from a copy that is made for reading: the browser remarks on a page's own canvas that is read again and again.
  const pixels = (key, x = 0, y = 0, width = canvas(key).width, height = canvas(key).height) =>
    read(canvas(key), x, y, width, height);
  const read = (canvas, x, y, width, height) => {
    const copy = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
    copy.drawImage(canvas, x, y, width, height, 0, 0, width, height);
    return copy.getImageData(0, 0, width, height).data;
  };
  const result = {};
  %s
  return JSON.parse(JSON.stringify(result));
}"""


@pytest.fixture(scope="session")
def browse(chromium) -> Callable[..., tuple[dict, list[str]]]:
    """`browse(page, address="", script="")`: what the script put into `result`, and what stood on the console.

    The script runs in the ready page and knows `viewer`, `drawn()`, `texts(row)`, `status()`, `canvas(key)`,
    `read(canvas, x, y, width, height)` and `pixels(key, x, y, width, height)`. Nothing outside is reachable.
    """

    def open_page(path: Path, address: str = "", script: str = "") -> tuple[dict, list[str]]:
        with opened(chromium, path.as_uri() + address) as page:
            return page.evaluate(PROBE % script), page.said

    return open_page
