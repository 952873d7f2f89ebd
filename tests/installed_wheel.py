"""The wheel, built once, and environments that have it with some of its extras, or none: installed, not imagined."""

import contextlib
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parent.parent


TEXTS = (
    "pyproject.toml", "setup.py", "mkdocs.yml", "MANIFEST.in", "README.md", "LICENSE", "CHANGELOG.md", "CITATION.cff",
    "SECURITY.md",
)  # fmt: skip
"""The files beside the folders."""


def clean_environment(home: Path) -> dict[str, str]:
    """A user's: nothing of this run's Python, and a home of its own."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "PYTEST", "VIRTUAL_ENV", "XDG_"))}
    return kept | {"HOME": str(home), "COLUMNS": "120"}


@pytest.fixture(scope="session")
def built(tmp_path_factory) -> Path:
    """A folder with the sdist, and the wheel made of it."""
    out, source = tmp_path_factory.mktemp("dist"), tmp_path_factory.mktemp("source")
    # Of a copy: building writes beside what it builds, where another run may be at it.
    for part in ("src", "scenes", "reference", "tests", "docs", ".ci", ".github"):
        shutil.copytree(ROOT / part, source / part, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info", "made"))
    for part in TEXTS:
        shutil.copy(ROOT / part, source)
    subprocess.run([sys.executable, "-m", "build", "--outdir", out, source], check=True, timeout=300)
    return out


@pytest.fixture(scope="session")
def environment_with(built, tmp_path_factory) -> Callable[..., Path]:
    """`environment_with("twin", ...)`: the Python of a fresh environment with the wheel and what these extras bring.

    The packages are this environment's own files, linked: no network is needed. `also`: further ones by name.
    """
    made: dict[tuple[str, ...], Path] = {}

    def make(*extras: str, also: tuple[str, ...] = ()) -> Path:
        if (key := (*extras, "/", *also)) not in made:
            home = tmp_path_factory.mktemp("environment")
            subprocess.run([sys.executable, "-m", "venv", "--without-pip", home], check=True, timeout=120)
            python = home / ("Scripts" if os.name == "nt" else "bin") / "python"
            pip = [sys.executable, "-m", "pip", "--python", python]  # one pip for all: to install it takes seconds
            install = [*pip, "install", "--quiet", "--no-deps", "--no-index", next(built.glob("*.whl"))]
            subprocess.run(install, check=True, env=clean_environment(home), timeout=120)
            ask = [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]
            site = Path(subprocess.run(ask, check=True, capture_output=True, text=True).stdout.strip())
            for name in sorted(required_by("raytwin", *extras) | set().union(*map(required_by, also), also)):
                link(name, site)
            made[key] = python
        return made[key]

    return make


def required_by(name: str, *extras: str) -> set[str]:
    """The distributions that one requires, with what those require, as far as they are installed here."""
    found: set[str] = set()
    todo = [(name, extra) for extra in ("", *extras)]
    done: set[tuple[str, str]] = set()
    while todo:
        name, extra = here = todo.pop()
        if here in done:
            continue
        done.add(here)
        for text in distribution(name).requires or ():
            wanted = Requirement(text)
            if wanted.marker is None or wanted.marker.evaluate({"extra": extra}):
                with contextlib.suppress(PackageNotFoundError):  # asked for on other machines
                    distribution(wanted.name)
                    found.add(wanted.name)
                    todo += [(wanted.name, other) for other in ("", *wanted.extras)]
    return found - {"raytwin"}


def link(name: str, site: Path) -> None:
    """A distribution's files in another environment: its own libraries beside site-packages too, but no scripts."""
    there = distribution(name)
    for file in there.files or ():
        source, to = Path(str(there.locate_file(file))), Path(os.path.normpath(site / file))
        if "bin" in file.parts[:4] or to.exists() or not source.is_file():
            continue
        to.parent.mkdir(parents=True, exist_ok=True)
        try:
            to.hardlink_to(source.resolve())
        except OSError:  # another file system
            shutil.copy2(source, to)
