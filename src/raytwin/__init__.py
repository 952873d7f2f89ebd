"""Compare a hand-written ray tracer (the subject) with Mitsuba 3 (its twin), and explain the difference.

    photos of a board -> calibrate -> Camera --+
                                scene.toml ----+-> read_scene -> Scene
    Scene -> trace   (the subject, hand-written)  -> Image --+
    Scene -> render  (the twin, Mitsuba 3)        -> Image --+-> compare_images -> Comparison: verdict, reasons, numbers
    a scene -------------------------------------------------> compare_scene --> Result: all of this at once
    any two: arrays, files, lists of renders, functions -----> compare --------> Diff, with pictures
    a scene -> levels, bench: how much light it needs, and at what cost; time against error of every method
    Scene + photo -> augment_photo: the photo with the scene's spheres and their shadows
    a student's function -> check: is it correct, and if not, why
    a Camera -> mitsuba_sensor: for a Mitsuba scene of your own

Lengths are metres, pixels OpenCV's, radiance linear Rec. 709 in float32 (H, W, 3), row 0 on top. Wrong input raises
InputError(where, expected, got). Heavy libraries are imported when a function first needs them. Every result has
`to_dict()`, those with rows `table()` (pandas.DataFrame takes it). Images, two images compared, and measurements show
themselves in a notebook.

>>> import raytwin
>>> scene = raytwin.read_scene("scenes/single")
>>> image = raytwin.trace(scene, "shadow")
>>> image.shape
(480, 640, 3)
>>> raytwin.compare(image, image).verdict
'pass'
>>> raytwin.compare(1.5 * image.mean, image, scene=scene).cause
'the whole image, background too, is 1.5 times too bright'
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from raytwin.compare.sequential import SequentialComparison as SequentialComparison
    from raytwin.compare.verdict import compare as _compare_images
    from raytwin.errors import InputError as InputError
    from raytwin.images.image import Image as Image
    from raytwin.images.image_formats import read_image as read_image
    from raytwin.images.image_formats import write_image as write_image
    from raytwin.judging import DiffSettings as DiffSettings
    from raytwin.photos.augment import augment as augment_photo
    from raytwin.photos.boards import read_board as read_board
    from raytwin.photos.camera import calibrate as calibrate
    from raytwin.renderers.references import reference as reference
    from raytwin.scene import Camera as Camera
    from raytwin.scene import Rectangle as Rectangle
    from raytwin.scene import Scene as Scene
    from raytwin.scene import Sky as Sky
    from raytwin.scene import Sphere as Sphere
    from raytwin.scene import Sun as Sun
    from raytwin.scene.scene_files import read_scene as read_scene
    from raytwin.scene_folders import scenes as scenes
    from raytwin.study.bench import bench as bench
    from raytwin.study.compare_scene import compare_scene as compare_scene
    from raytwin.study.diff_files import compare as compare
    from raytwin.study.levels import levels as levels
    from raytwin.study.settings import CompareSettings as CompareSettings
    from raytwin.teach.contract.check import check as check
    from raytwin.teach.contract.subject import method as method
    from raytwin.tracer import trace as trace
    from raytwin.twin import mitsuba_sensor as mitsuba_sensor
    from raytwin.twin import render as render

    compare_images, diff_files = _compare_images, compare
    __version__: str

_HOME = {
    "Camera": "scene",
    "CompareSettings": "study.settings",
    "DiffSettings": "judging",
    "Image": "images.image",
    "InputError": "errors",
    "Rectangle": "scene",
    "Scene": "scene",
    "SequentialComparison": "compare",
    "Sky": "scene",
    "Sphere": "scene",
    "Sun": "scene",
    "augment_photo": "photos.augment:augment",
    "bench": "study.bench",
    "calibrate": "photos.camera",
    "check": "teach.contract.check",
    "compare": "study.diff_files",
    "compare_images": "compare:compare",
    "compare_scene": "study.compare_scene",
    "diff_files": "study.diff_files:compare",
    "levels": "study.levels",
    "method": "teach.contract.subject",
    "mitsuba_sensor": "twin",
    "read_board": "photos.boards",
    "read_image": "images.image_formats",
    "read_scene": "scene.scene_files",
    "reference": "renderers.references",
    "render": "twin",
    "scenes": "scene_folders",
    "trace": "tracer",
    "write_image": "images.image_formats",
}
"""Name -> its module, and after a colon its name there, where that differs or a module of raytwin has it."""

__all__ = sorted(_HOME)

PACKAGES = ("compare",)
"""Names that are packages, and functions too: `raytwin.compare(a, b)` beside `from raytwin.compare import METRICS`."""


def _found(name: str) -> Any:
    """Return what `name` of `_HOME` stands for. Raises MachineError where an extra is missing."""
    module, _, own = _HOME[name].partition(":")
    try:
        return getattr(import_module(f"{__name__}.{module}"), own or name)
    except ModuleNotFoundError as error:
        from raytwin.errors import extras_for, missing_package

        if not extras_for(error):
            raise
        raise missing_package(f"{__name__}.{name}", error) from None


class _Callable(ModuleType):
    """A package of PACKAGES: called, it is the function of its name."""

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        return _found(self.__name__.rpartition(".")[2])(*arguments, **options)

    @property
    def __signature__(self) -> Any:
        from inspect import signature

        return signature(_found(self.__name__.rpartition(".")[2]))


class _Face(ModuleType):
    """raytwin itself: Python sets a package as its attribute once it is imported, and so makes it callable."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name in PACKAGES and type(value) is ModuleType:
            value.__class__ = _Callable
        super().__setattr__(name, value)


if not TYPE_CHECKING:  # or every misspelt name would be one, of type Any
    sys.modules[__name__].__class__ = _Face

    def __getattr__(name: str) -> object:
        if name == "__version__":
            from importlib.metadata import version

            return version("raytwin")
        if name not in _HOME:
            from raytwin.removed import NAMES

            instead = f": removed in 0.2.0. {NAMES[name]}" if name in NAMES else ""
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}{instead}")
        return import_module(f"{__name__}.{name}") if name in PACKAGES else _found(name)


def __dir__() -> list[str]:
    return [*__all__, "__doc__", "__name__", "__path__"]
