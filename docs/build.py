"""Build the site: gallery and figures, then mkdocs with warnings as errors, then a check of every local link.

python docs/build.py                # gallery and figures are made once, and reused
python docs/build.py --again        # make them again
python docs/build.py --no-gallery   # the text alone
"""

import argparse
import contextlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import fault_gallery
import figures
import gallery

ROOT = Path(__file__).resolve().parent.parent
SITE = ROOT / "site"
QUIET = {"NO_MKDOCS_2_WARNING": "1", "DISABLE_MKDOCS_2_WARNING": "true"}
MOST_BYTES = 15e6
"""Of the whole site."""
STAGES = {"gallery": gallery.make, "figures": figures.make, "faults": fault_gallery.make}
"""What is made before the pages, by the name that is printed."""


class Page(HTMLParser):
    """Collects what a page links to and loads, and the names that links may end at."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.anchors: set[str] = {"", "top"}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("id", "name") and value:
                self.anchors.add(value)
            elif name in ("href", "src") and value is not None:
                is_link = tag == "a" or "canonical" in (dict(attrs).get("rel") or "")
                (self.links if is_link else self.loads).append(value)


def faults(site: Path) -> list[str]:
    """Return one line per link that leads nowhere, and per file that a page would load from elsewhere."""
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in sorted(site.rglob("*.html"))}
    found = []
    for path, page in pages.items():
        if path.name == "404.html":  # served at any address, so its links begin with a slash
            continue
        here = path.relative_to(site)
        found += [f"{here}: loads {link}" for link in page.loads if urlsplit(link).scheme in ("http", "https")]
        for link in page.links + page.loads:
            address = urlsplit(link)
            if address.scheme or address.netloc:
                continue
            target = (path.parent / unquote(address.path)).resolve() if address.path else path
            if target.is_dir():
                target /= "index.html"
            if not target.exists():
                found.append(f"{here}: {link} leads nowhere")
            elif (
                target in pages
                and not gallery.is_made(target)
                and unquote(address.fragment) not in pages[target].anchors
            ):
                found.append(f"{here}: {link}: {target.name} has no such heading")
    return found


@contextlib.contextmanager
def stage(name: str) -> Iterator[None]:
    """Say what is being done, and then how many seconds it took."""
    began = time.perf_counter()
    print(f"{name} ...", end=" ", flush=True)
    yield
    print(f"{time.perf_counter() - began:.1f} s", flush=True)


def main() -> int:
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--again", action="store_true", help="make the gallery and the figures again")
    asked.add_argument("--no-gallery", action="store_true", help="make neither gallery nor figures")
    asked.add_argument("--site", type=Path, default=SITE, metavar="DIR", help="folder of the site")
    options = asked.parse_args()
    if options.again:
        shutil.rmtree(gallery.MADE, ignore_errors=True)
    for name, make in STAGES.items() if not options.no_gallery else ():
        with stage(name):
            make()
    command = [sys.executable, "-m", "mkdocs", "--quiet", "build", "--clean", "--site-dir", str(options.site)]
    with stage("pages"):
        code = subprocess.run(command, cwd=ROOT, env=os.environ | QUIET, check=False).returncode
    if code:
        return code
    for path in options.site.rglob("*.map"):  # for who debugs the theme's scripts: a tenth of the site
        path.unlink()
    shutil.rmtree(options.site / "assets" / "javascripts" / "lunr")  # search in other languages than English
    size = sum(path.stat().st_size for path in options.site.rglob("*") if path.is_file())
    print(f"site: {len(list(options.site.rglob('*.html')))} pages, {size / 1e6:.1f} MB")
    with stage("links"):
        broken = faults(options.site)
    wrong = broken + ([f"site: {size / 1e6:.1f} MB, allowed {MOST_BYTES / 1e6:.0f} MB"] if size > MOST_BYTES else [])
    print(*wrong, f"{len(wrong)} broken", sep="\n")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
