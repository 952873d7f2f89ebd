"""What mkdocs takes from the program itself: commands from `--help`, the Python API, the gallery, the figures."""

import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import click
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from typer.main import get_command
from typer.testing import CliRunner

import raytwin
from raytwin.cli import app

sys.path.insert(0, str(Path(__file__).resolve().parent))
import fault_gallery
import figures
import gallery

WIDTH = "100"
"""Columns of a command's help text."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages, which lie in no folder, to the written ones."""
    pages = {
        "commands.md": commands_page(),
        "api.md": api_page(),
        "gallery.md": gallery.page(),
        "faults.md": fault_gallery.page(),
        "changelog.md": (gallery.ROOT / "CHANGELOG.md").read_text(encoding="utf-8"),
    }
    for path, text in pages.items():
        files.append(File.generated(config, path, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Put the figures that are made where the page names them."""
    up = "../" * page.file.src_uri.count("/")

    def picture(found: re.Match[str]) -> str:
        file = figures.FIGURES[found[1]][0]
        shown = (figures.FOLDER / file).exists()
        return f"![{found[2]}]({up}made/{figures.FOLDER.name}/{file})\n\n*{found[2]}*" if shown else ""

    return re.sub(r"<!-- figure: (\S+): (.*?) -->", picture, markdown, flags=re.DOTALL)


def commands_page() -> str:
    """Return the page of all commands: one heading each, with the text that `--help` prints."""
    parts = [
        "# Commands\n\nThis page is what each command prints under `--help`. A scene is a folder, a `scene.toml`, or"
        " the name of a built-in scene. [Exit codes](files.md#exit-codes) mean the same for all of them.\n"
    ]
    for name in walk(get_command(app), "raytwin"):
        shown = CliRunner(env={"COLUMNS": WIDTH}).invoke(app, [*name.split()[1:], "--help"], prog_name="raytwin").output
        parts.append(f"## {name}\n\n```text\n{shown.strip()}\n```\n")
    return "\n".join(parts)


def walk(command: click.Command, name: str) -> Iterator[str]:
    """Yield a command's full name, then those of its subcommands in their order."""
    yield name
    for child in getattr(command, "commands", {}):
        if child.strip():  # what a group does by itself has no name
            yield from walk(command.commands[child], f"{name} {child}")


def api_page() -> str:
    """Return the page of what `raytwin` exports, one mkdocstrings block per name."""
    parts = [
        "# Python API\n\n`import raytwin` gives these names and imports nothing heavy before it is needed. Lengths are"
        " metres, images are linear Rec. 709 in float32 (H, W, 3) with row 0 on top:"
        " see [conventions](scene.md#conventions). The examples build on each other: paste them into a Python prompt"
        " from the top.\n"
    ]
    shown = examples()
    for name in raytwin.__all__:
        if name in raytwin._HOME:
            module, _, own = raytwin._HOME[name].partition(":")
            parts.append(
                f"## raytwin.{name}\n\n::: {defined_in(f'raytwin.{module}', own or name)}\n    options:\n"
                "      show_root_heading: false\n      show_root_toc_entry: false\n      heading_level: 3\n"
                f"\n{shown[name]}\n"
            )
    return "\n".join(parts)


def examples() -> dict[str, str]:
    """Return the block of code of each name's section in sessions.md."""
    text = (gallery.ROOT / "docs" / "sessions.md").read_text(encoding="utf-8")
    return dict(re.findall(r"^### raytwin\.(\w+)\n.*?^(```pycon\n.*?^```)$", text, re.DOTALL | re.MULTILINE))


def defined_in(module: str, name: str) -> str:
    """Return the dotted path of the file that defines a name, which its package only re-exports."""
    return f"{getattr(importlib.import_module(module), name).__module__}.{name}"
