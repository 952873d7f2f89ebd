"""The gallery: real pages, made small by the program itself, each with a thumbnail and a sentence."""

import contextlib
import io
import re
import shutil
import subprocess
import sys
import tempfile
from html import escape
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
MADE = ROOT / "docs" / "made"
"""Where the pages go: ignored by git, part of the site."""
WIDTH, HEIGHT = 1100, 760
"""Of the browser's window for a thumbnail, pixels."""
LINKED = ("results.csv", "results.json")
"""Files of numbers that a page links to."""
THUMB = 420
"""A thumbnail's width, pixels."""


class Entry(NamedTuple):
    """A page of the gallery. `commands` run one after the other in `folder`; `page` lies in it."""

    folder: str
    page: str
    title: str
    sentence: str
    commands: tuple[str, ...]
    codes: tuple[int, ...] = (0,)
    """Exit codes of the last command that are expected."""


ENTRIES = (
    Entry(
        "pass", "out/report.html", "A pass",
        "Tracer and Mitsuba agree to rounding. Zoom both together, change the exposure, read any pixel.",
        ("compare overlap --size 240x180 -o out",),
    ),
    Entry(
        "cause", "out/report.html", "A failure with its cause",
        "A student's `shade` lacks the division by π. The first line of the page says so.",
        ("compare overlap --rung shadow --subject class/cleo.py --size 160x120 -o out",), (1,),
    ),
    Entry(
        "diff", "out/report.html", "Two images of any renderers",
        "`raytwin diff` of a render without shadows and a reference with them.",
        ("diff {root}/reference/overlap/lambert.exr {root}/reference/overlap/shadow.exr -o out",), (1,),
    ),
    Entry(
        "path", "out/report.html", "Direct light beside all light",
        "An expected difference, split into named parts that add up to it: shadows, the sky's occlusion, each bounce.",
        ("compare overlap --rung path --samples 64 --size 160x120 -o out",),
    ),
    Entry(
        "levels", "out/levels.html", "How much light is enough",
        "Each light level's error and cost, and the cheapest one for a tolerance.",
        ("levels overlap --tolerance 0.01 --size 160x120 -o out",),
    ),
    Entry(
        "atlas", "out/atlas.html", "The atlas of failures",
        "Three experiments: each method is driven until it fails, beside what theory predicts.",
        ("stability sphere-far sphere-ground shadow-small -o out",),
    ),
    Entry(
        "calibration", "camera.html", "A calibration and how wrong it may be",
        "Uncertainty over the frame, each tag's residual, and the lens models tried.",
        ("calibrate {root}/scenes/desk/photos --board {root}/scenes/desk/board.toml -o camera.toml",),
    ),
    Entry(
        "bench", "out/bench.html", "Speed against accuracy",
        "A student's tracer and a few methods on two scenes: verdicts, and the frontier of error against time.",
        (
            "bench single overlap --subject class/cleo.py --methods"
            " numpy32-shadow-*,drjit32-shadow-*,twin-llvm-direct-*"
            " --sizes 0.01 --budget 50 -o out",
        ), (1,),
    ),
    Entry(
        "class", "out/index.html", "A class",
        "The three submissions of the instructor's tutorial: points, mistakes by frequency, and a page per student.",
        ("grade class --rubric rubric.toml -o out",),
    ),
    Entry(
        "light", "light.html", "The light of a photo",
        "Sun and sky from a mirror ball in a photo, and a ball drawn in under them.",
        (
            "photo light {root}/scenes/desk/lit/photo_00.jpg --board {root}/scenes/desk/board.toml"
            " --camera {root}/scenes/desk/lit/camera.toml --ball=-0.075,0.05,0.028,0.03 -o light.toml",
        ),
    ),
    Entry(
        "augment", "out/report.html", "Spheres drawn into photos",
        "Synthetic photos with a known camera: calibrated, drawn into, and compared with the truth.",
        (
            "photo board --columns 5 --rows 7 --tag 30mm --pitch 38mm --paper letter -o board.pdf",
            "photo simulate --board board.toml --scene desk --count 6 --size 480x360 --samples 4 -o plain",
            "photo simulate --board board.toml --scene desk --count 6 --size 480x360 --samples 4"
            " --with-objects -o true",
            "photo calibrate plain --board board.toml -o camera.toml",
            "photo draw plain/photo_00.jpg --scene desk --board board.toml --camera camera.toml -o out",
            "diff out/photo_00.jpg true/photo_00.jpg -o out",
        ), (1,),
    ),
)  # fmt: skip


def is_made(path: Path) -> bool:
    """Tell whether a file of the site is a page of the gallery."""
    return MADE.name in path.parts


def make() -> None:
    """Make the pages that are not there yet, each in a folder of its own that appears when it is complete."""
    for entry in ENTRIES:
        if not (folder := MADE / entry.folder).exists():
            shutil.rmtree(unfinished := MADE / f"{entry.folder}.unfinished", ignore_errors=True)
            unfinished.mkdir(parents=True)
            write_files((ROOT / "docs" / "teach.md").read_text(encoding="utf-8"), unfinished)
            for number, command in enumerate(entry.commands, 1):
                code = run(command, unfinished)
                if code not in (entry.codes if number == len(entry.commands) else (0,)):
                    raise SystemExit(f"gallery: {command}: exit code {code}")
            thumbnail(unfinished / entry.page, unfinished / "thumb.webp")
            keep_page(unfinished / entry.page, unfinished)
            unfinished.rename(folder)


def write_files(text: str, folder: Path) -> None:
    """Write each block of a page that `<!-- file: NAME -->` precedes to its name."""
    for name, code in re.findall(r"<!-- file: (\S+) -->\n```\w+\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(code, encoding="utf-8")


def run(command: str, folder: Path) -> int:
    """Run a raytwin command in this process, which imports once, and return its exit code."""
    from raytwin.cli import main

    sys.argv = ["raytwin", *(word.format(root=ROOT) for word in command.split())]
    with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()) as printed:
        try:
            main()
        except SystemExit as ended:
            if ended.code == 2:
                print(printed.getvalue(), file=sys.stderr)
            return int(ended.code or 0)
    return 0


def keep_page(page: Path, folder: Path) -> None:
    """Delete what no page loads or links to: EXRs, numbers, charts as files."""
    for path in sorted(folder.rglob("*"), reverse=True):
        if path.is_file() and path.suffix not in (".html", ".js", ".css", ".webp") and path.name not in LINKED:
            path.unlink()
        elif path.is_dir() and not any(path.iterdir()):
            path.rmdir()


def find_browser() -> str | None:
    """Return the path of the machine's Chromium, None where there is none."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


def thumbnail(page: Path, target: Path) -> None:
    """Photograph the top of a page with Chromium; without one, there is no thumbnail."""
    from PIL import Image

    if (browser := find_browser()) is None:
        return
    shot = target.with_suffix(".png")
    with tempfile.TemporaryDirectory() as profile:
        command = [
            browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--virtual-time-budget=4000",
            f"--user-data-dir={profile}", f"--window-size={WIDTH},{HEIGHT}", f"--screenshot={shot}", page.as_uri(),
        ]  # fmt: skip
        done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)
    if not shot.exists():
        raise SystemExit(f"gallery: {browser} made no picture of {page}: {done.stderr[-500:]}")
    with Image.open(shot) as image:
        image.convert("RGB").resize((THUMB, THUMB * HEIGHT // WIDTH), Image.Resampling.LANCZOS).save(target, quality=75)


def page() -> str:
    """Return the gallery's page: what is made, and what would make it."""
    parts = [
        "# Gallery\n\nThese are raytwin's own pages, made small by the commands beside them. They need no network:"
        " open one, zoom, change the exposure, click a pixel.\n"
    ]
    for entry in ENTRIES:
        folder, address = MADE / entry.folder, f"{MADE.name}/{entry.folder}"
        sentence = re.sub("`(.*?)`", r"<code>\1</code>", entry.sentence)
        about = [f"<b>{entry.title}</b>", sentence]
        if (folder / entry.page).exists():
            about[0] = f'<b><a href="{address}/{entry.page}">{entry.title}</a></b>'
        else:
            about.append("<code>python docs/build.py</code> makes this page.")
        picture = f'<img src="{address}/thumb.webp" alt="{entry.title}: the page">'
        if (folder / "thumb.webp").exists():
            about.insert(0, f'<a href="{address}/{entry.page}" tabindex="-1" aria-hidden="true">{picture}</a>')
        shown = "<br>".join(escape(f"raytwin {command}".replace("{root}/", "")) for command in entry.commands)
        parts.append(f'<div class="card">{" ".join(about)}<p class="made-by"><code>{shown}</code></p></div>')
    return "\n".join([parts[0], '<div class="cards">', *parts[1:], "</div>", ""])
