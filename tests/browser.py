"""The machine's own Chromium, driven by Playwright, and axe-core's findings in a page."""

import shutil
from pathlib import Path

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
ALONE = ("--no-sandbox", "--disable-gpu", "--disable-quic", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1")


def program() -> str | None:
    return next(filter(None, map(shutil.which, BROWSERS)), None)


@pytest.fixture(scope="module")
def chromium():
    """A browser that reaches nothing but this machine; one for a file's tests, since its loop runs in their thread."""
    playwright = pytest.importorskip("playwright.sync_api")
    if program() is None:
        pytest.skip(f"a browser to open the page in: none of {', '.join(BROWSERS)} is installed")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program(), args=ALONE)
        yield browser
        browser.close()


def barriers(page) -> list[str]:
    """What axe-core calls serious or critical in a page of Playwright's, and where."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    return [
        f"{rule['id']}: {node['html'][:120]} {' '.join(node.get('failureSummary', '').split())[:200]}"
        for rule in found
        if rule["impact"] in ("serious", "critical")
        for node in rule["nodes"]
    ]


def barriers_of(chromium, path: Path) -> list[str]:
    """The same of a page in a file, all its folded parts opened: on a phone by day, on a desk by night."""
    found = []
    with chromium.new_page() as page:
        page.goto(path.as_uri())
        page.evaluate("for (const part of document.querySelectorAll('details')) part.open = true")
        page.wait_for_function("[...document.querySelectorAll('.rt')].every((root) => root.dataset.ready)")
        for scheme, width in (("light", 390), ("dark", 1400)):
            page.emulate_media(color_scheme=scheme)
            page.set_viewport_size({"width": width, "height": 1000})
            found += [f"{scheme}, {width}: {line}" for line in barriers(page)]
            if page.evaluate("document.documentElement.scrollWidth") > width:
                found.append(f"{width}: it scrolls sideways")
    return found
