"""Play with the live page as a hand would, and what it is like: `python tests/live/play.py [WxH ...]`.

The page itself drags a sphere to and fro: one pointer event at each of the screen's frames. While it moves: pictures a
second of tracer and twin, milliseconds from an event to the picture that shows it. At rest: half floats a second, a
wish each as soon as the last is shown, where both sides are of rung shadow.
"""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from raytwin import files
from raytwin.scene import Scene
from raytwin.speed import trace

DRAG = """async ([x, y, seconds]) => {
  const viewer = document.getElementById("viewer").viewer, { canvas } = viewer.panes.get("test"), seen = [];
  const send = (type, to) => {
    const box = canvas.getBoundingClientRect(), s = viewer.frame_of({ canvas }).s;
    const where = { clientX: box.left + (to + 0.5) * s, clientY: box.top + (y + 0.5) * s };
    const hand = { ...where, bubbles: true, pointerId: 1, isPrimary: true, buttons: 1 };
    canvas.dispatchEvent(new PointerEvent(type, hand));
  };
  const note = ({ detail }) => seen.push([detail.side, detail.ms]), start = performance.now();
  document.addEventListener("seen", note);
  send("pointerdown", x);
  for (let now = start; now - start < 1000 * seconds; now = await new Promise(requestAnimationFrame))
    send("pointermove", x + (viewer.data.width / 8) * Math.sin((now - start) / 300));
  send("pointermove", x);
  send("pointerup", x);
  document.removeEventListener("seen", note);
  return seen;
}"""

REST = """async (seconds) => {
  const slider = [...document.querySelectorAll("#controls label")].find((l) => l.textContent.startsWith("azimuth"));
  const input = slider.querySelector("input"), start = performance.now();
  let shown = 0, step = 1;
  while (performance.now() - start < 1000 * seconds) {
    const seen = new Promise((done) => document.addEventListener("seen", function next({ detail }) {
      if (detail.kind === "pair") { document.removeEventListener("seen", next); done(); }
    }));
    input.value = input.valueAsNumber + (step = -step);
    for (const kind of ["input", "change"]) input.dispatchEvent(new Event(kind));
    await seen;
    shown += 1;
  }
  return shown;
}"""


def middle_of(scene: Scene, name: str) -> tuple[int, int]:
    """The pixel in the middle of what is seen of an object."""
    seen = trace(scene, "surface").surface
    assert seen is not None
    v, u = (int(np.median(at)) for at in np.nonzero(seen.ids == scene.names.index(name)))
    return u, v


def processes(root: int) -> Iterator[int]:
    """A process and all that it started."""
    yield root
    for task in Path(f"/proc/{root}/task").iterdir():
        for child in (task / "children").read_text().split():
            yield from processes(int(child))


def memory(server: int) -> dict[str, int]:
    """MB that the server, and all processes of this one's browser, have for themselves; shared ones count once."""

    def held(process: int) -> float:
        text = Path(f"/proc/{process}/smaps_rollup").read_text()
        return next(int(line.split()[1]) for line in text.splitlines() if line.startswith("Pss:")) / 1024

    browser = [p for p in processes(os.getpid()) if Path(f"/proc/{p}/comm").read_text().startswith("chrom")]
    return {"server, MB": round(held(server)), "browser, MB": round(sum(map(held, browser)))}


def held(page: Any) -> dict[str, float]:
    """What a page's script holds on to once its garbage is collected."""
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable")
    session.send("HeapProfiler.collectGarbage")
    told = {m["name"]: m["value"] for m in session.send("Performance.getMetrics")["metrics"]}
    session.detach()
    heap = round(told["JSHeapUsedSize"] / 2**20, 2)
    return {"heap, MB": heap, "nodes": told["Nodes"], "listeners": told["JSEventListeners"]}


class Felt(NamedTuple):
    """Milliseconds of each picture of a side, over so many seconds."""

    side: str
    ms: np.ndarray
    seconds: float

    def __str__(self) -> str:
        if not len(self.ms):
            return f"{self.side}: none"
        median, late = np.percentile(self.ms, (50, 95))
        return f"{self.side}: {len(self.ms) / self.seconds:.1f} pictures/s, {median:.0f} ms, 95 % {late:.0f} ms"


def drag(page: Any, at: tuple[int, int], seconds: float) -> list[Felt]:
    """The sphere at a pixel, to and fro, for so long."""
    seen = page.evaluate(DRAG, [*at, seconds])
    return [Felt(side, np.array([ms for s, ms in seen if s == side]), seconds) for side in ("tracer", "twin")]


@contextlib.contextmanager
def playing(size: tuple[int, int]) -> Iterator[tuple[str, int]]:
    """(address, process) of a server of `overlap`."""
    scene, asked = str(files.SCENES / "overlap"), "{}x{}".format(*size)
    command = [sys.executable, "-u", "-m", "raytwin", "explore", scene, "--no-browser", "--size", asked]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            yield server.stdout.readline().split()[-1], server.pid
        finally:
            server.terminate()


def main(sizes: list[str]) -> None:
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from browser import ALONE, program
    from playwright.sync_api import sync_playwright

    base = files.read_scene(files.SCENES / "overlap")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program(), args=ALONE)
        for size in sizes:
            width, height = map(int, size.split("x"))
            at = middle_of(base.scene.with_camera(base.camera.resized(width, height)), base.scene.names[1])
            with playing((width, height)) as (address, _):
                page = browser.new_page(viewport={"width": 1400, "height": 1000})
                page.goto(address)
                page.wait_for_selector("body[data-rest]", timeout=600_000)
                paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
                print(f"{size}: first paint {paint:.0f} ms", flush=True)
                drag(page, at, 2)
                for rung in ("path", "shadow"):
                    page.locator("#controls label", has_text="light level").nth(1).locator("select").select_option(rung)
                    time.sleep(2)
                    print(f"  twin at {rung}: " + "; ".join(map(str, drag(page, at, 8))), flush=True)
                print(f"  at rest: {page.evaluate(REST, 6) / 6:.1f} half-float frames/s", flush=True)
                page.close()
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1:] or ["800x600", "1600x1200"])
