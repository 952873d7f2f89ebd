"""Make docs/images/explore.webp, the README's moving picture: a sphere is dragged in the live page, all else follows.

python docs/moving_picture.py

Chromium photographs `raytwin explore` after each step, once difference and ledger have caught up: run it on an idle
machine.
"""

import io
import math
import re
import subprocess
import sys

import gallery
from PIL import Image as Picture
from playwright.sync_api import sync_playwright

TARGET = gallery.ROOT / "docs" / "images" / "explore.webp"
WINDOW = {"width": 1280, "height": 760}
WIDTH = 880
"""Of the moving picture, pixels."""
FRAMES, MILLISECONDS = 24, 160
"""Steps of one turn, and how long each is shown."""
SETTLE = 1500
"""Milliseconds for difference and ledger to catch up."""
GRIP = (0.62, 0.55)
"""Where the blue sphere is in the picture of the scene `overlap`, as a share of width and height."""
REACH = (0.10, 0.05)
"""Half axes of the ellipse along which it is dragged, the same."""


def photographed(address: str) -> list[Picture.Image]:
    """Return the page after each step of a drag that ends where it began."""
    frames = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=gallery.find_browser(), args=["--no-sandbox"])
        page = browser.new_page(viewport=WINDOW)
        page.goto(address)
        page.wait_for_timeout(6 * SETTLE)
        box = page.locator("canvas").first.bounding_box()
        assert box is not None
        for k in range(FRAMES + 1):
            angle = 2 * math.pi * k / FRAMES
            share = GRIP[0] + REACH[0] * math.sin(angle), GRIP[1] + REACH[1] * (1 - math.cos(angle))
            page.mouse.move(box["x"] + share[0] * box["width"], box["y"] + share[1] * box["height"], steps=3)
            if k:  # let go at each step: the ledger is computed at rest
                page.mouse.up()
            page.wait_for_timeout(SETTLE)
            frames.append(Picture.open(io.BytesIO(page.screenshot())).convert("RGB"))
            page.mouse.down()
        browser.close()
    return frames[:-1]


def main() -> None:
    command = [sys.executable, "-m", "raytwin", "explore", "overlap", "--size", "480x360", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        address = next(found[0] for line in server.stdout if (found := re.search(r"http://\S+", line)))
        try:
            frames = photographed(address)
        finally:
            server.terminate()
    size = WIDTH, WIDTH * WINDOW["height"] // WINDOW["width"]
    small = [frame.resize(size, Picture.Resampling.LANCZOS) for frame in frames]
    small[0].save(TARGET, save_all=True, append_images=small[1:], duration=MILLISECONDS, loop=0, quality=60, method=6)
    print(f"{TARGET.name}: {len(small)} frames, {TARGET.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
