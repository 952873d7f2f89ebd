"""The machine's own Chromium, driven by Playwright, one a process; and what axe-core finds in a page."""

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
ALONE = ("--no-sandbox", "--disable-gpu", "--disable-quic", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1")
PATIENCE = 300_000
"""Milliseconds to wait for anything in a page: a busy machine fails no test."""
VIEWS = ("light", 390), ("light", 800), ("light", 1100), ("dark", 1400)
"""Colours and width of the window in which a page is looked at: by day from a phone on, by night on a desk."""

SIDEWAYS = """(width) => new Promise((done) => {
  const until = performance.now() + 10_000, look = () => {
    const wide = document.documentElement.scrollWidth > width;
    if (!wide || performance.now() > until) done(wide);
    else requestAnimationFrame(look);
  };
  look();
})"""
"""Whether a page stays wider than its window once its canvases have followed it."""


SKIPPED = """() => {
  const seen = [...document.querySelectorAll("h1, h2, h3, h4, h5, h6")].filter((h) => h.checkVisibility());
  const level = (h) => Number(h.tagName[1]);
  return seen.filter((h, i) => level(h) > (i ? level(seen[i - 1]) : 0) + 1).map((h) => `${h.tagName} ${h.textContent}`);
}"""
"""Headings more than one level below the heading before them."""

OVERPRINTED = """() => [...document.querySelectorAll("svg, .rt-ticks")].flatMap((chart) => {
  const texts = [...chart.querySelectorAll("text, span")].filter((t) => t.checkVisibility() && t.textContent.trim());
  const boxes = texts.map((t) => [t.textContent, t.getBoundingClientRect()]), found = [];
  boxes.forEach(([a, p], i) => boxes.slice(i + 1).forEach(([b, q]) => {
    const wide = Math.min(p.right, q.right) - Math.max(p.left, q.left);
    const high = Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top);
    if (wide > 1 && high > 0.35 * Math.min(p.height, q.height)) found.push(`${a} | ${b}`);
  }));
  return found;
})"""
"""Texts of a chart or a colour bar that lie over each other: lines of a font may touch by its leading."""


def program() -> str | None:
    return next(filter(None, map(shutil.which, BROWSERS)), None)


@pytest.fixture(scope="session")
def chromium():
    """A browser that reaches nothing but this machine."""
    playwright = pytest.importorskip("playwright.sync_api")
    if program() is None:
        pytest.skip(f"a browser to open the page in: none of {', '.join(BROWSERS)} is installed")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program(), args=ALONE, timeout=PATIENCE)
        yield browser
        browser.close()


@contextlib.contextmanager
def opened(chromium, address: str, width: int = 1400, height: int = 1200, **options) -> Iterator:
    """A page of Playwright's at an address; what its console says is in `page.said`."""
    with chromium.new_context(viewport={"width": width, "height": height}, **options) as context:
        context.set_default_timeout(PATIENCE)
        page = context.new_page()
        page.said = []
        page.on("console", lambda message: page.said.append(message.text))
        page.on("pageerror", lambda error: page.said.append(str(error)))
        page.goto(address)
        yield page


def barriers(page) -> list[str]:
    """What axe-core calls serious or critical in a page of Playwright's on a phone and a desk, and where; the widths
    at which the page scrolls sideways; headings out of order; and texts of a chart over each other."""
    from axe_playwright_python.sync_playwright import Axe

    found = []
    for scheme, width in VIEWS:
        page.emulate_media(color_scheme=scheme)
        page.set_viewport_size({"width": width, "height": 1000})
        if page.evaluate(SIDEWAYS, width):
            found.append(f"{width}: it scrolls sideways")
        found += [f"{scheme} {width}: heading out of order: {heading}" for heading in page.evaluate(SKIPPED)]
        found += [f"{scheme} {width}: overprinted: {texts}" for texts in page.evaluate(OVERPRINTED)]
        rules = Axe().run(page).response["violations"] if width in (VIEWS[0][1], VIEWS[-1][1]) else ()
        found += [
            f"{scheme}: {rule['id']}: {node['html'][:120]} {' '.join(node.get('failureSummary', '').split())[:200]}"
            for rule in rules
            if rule["impact"] in ("serious", "critical")
            for node in rule["nodes"]
        ]
    return found


def barriers_of(chromium, path: Path) -> list[str]:
    """The same of a page in a file, all its folded parts opened."""
    with opened(chromium, path.as_uri()) as page:
        page.evaluate("for (const part of document.querySelectorAll('details')) part.open = true")
        page.wait_for_function("[...document.querySelectorAll('.rt')].every((root) => root.dataset.ready)")
        return barriers(page)
