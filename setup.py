"""What pyproject.toml cannot say: too old a Python is refused; scenes and references are packed from where they lie."""

import shutil
import sys
from pathlib import Path

# Before pip looks for old versions of all that is needed, which takes minutes.
if sys.version_info < (3, 11):  # noqa: UP036 (what pip ran this with may be older)
    sys.exit("raytwin needs Python 3.11 or newer; this is Python {}.{}".format(*sys.version_info[:2]))

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent
PACKED = {"scenes": ("*.toml", "*.xml", "*.ply", "*.jpg", "*.png", "*.exr", "*.py"), "reference": ("*.exr",)}


class WithScenes(build_py):
    """An installed raytwin finds both beside itself; an editable one finds them in the checkout."""

    def run(self):
        super().run()
        if self.editable_mode:
            return
        shipped = Path(self.build_lib, "raytwin", "shipped")
        shutil.rmtree(shipped, ignore_errors=True)
        for folder, patterns in PACKED.items():
            for source in sorted(f for pattern in patterns for f in (ROOT / folder).rglob(pattern)):
                target = shipped / source.relative_to(ROOT)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(source, target)


setup(cmdclass={"build_py": WithScenes})
