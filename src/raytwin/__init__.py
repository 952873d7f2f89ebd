"""Compare a hand-written ray tracer (the subject) with Mitsuba 3 (its twin), and explain the difference.

    photos of a board -> calibrate -> Camera --+
                                scene.toml ----+-> read_scene -> SceneFile -> Scene
    Scene -> trace   (the subject, hand-written)  -> Image --+
    Scene -> render  (the twin, Mitsuba 3)        -> Image --+-> compare_images -> Comparison: verdict, reasons, numbers
    a scene.toml -------------------------------------------> compare_scene --> Result: all of this at once
    two files, of any renderers ------------------------------> diff_files -----> Diff
    Scene + photo -> augment_photo: the photo with the scene's spheres and their shadows
    a student's function -> check: is it right, and if not, why

Lengths are metres, pixels OpenCV's, radiance linear Rec. 709 in float32 (H, W, 3), row 0 on top. Wrong input raises
InputError(where, expected, got). Heavy libraries are imported when a function first needs them.

>>> import raytwin
>>> scene = raytwin.read_scene("scenes/single").scene
>>> image = raytwin.trace(scene, "shadow")
>>> image.shape
(480, 640, 3)
>>> raytwin.compare_images(image, image).verdict
'pass'
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from raytwin.calib.augment import augment as augment_photo
    from raytwin.calib.boards import read_board
    from raytwin.calib.photos import calibrate
    from raytwin.compare import compare as compare_images
    from raytwin.contract.check import check
    from raytwin.errors import InputError
    from raytwin.files import read_image, read_scene, write_image
    from raytwin.image import Image
    from raytwin.scene import Camera, Lambert, Rectangle, Scene, SceneFile, Sky, Sphere, Sun
    from raytwin.tracer import trace
    from raytwin.twin import render
    from raytwin.workflows.compare_scene import compare_scene
    from raytwin.workflows.diff_files import diff as diff_files

    __version__: str

_HOME = {
    "Camera": "scene",
    "Image": "image",
    "InputError": "errors",
    "Lambert": "scene",
    "Rectangle": "scene",
    "Scene": "scene",
    "SceneFile": "scene",
    "Sky": "scene",
    "Sphere": "scene",
    "Sun": "scene",
    "augment_photo": "calib.augment:augment",
    "calibrate": "calib.photos",
    "check": "contract.check",
    "compare_images": "compare:compare",
    "compare_scene": "workflows.compare_scene",
    "diff_files": "workflows.diff_files:diff",
    "read_board": "calib.boards",
    "read_image": "files",
    "read_scene": "files",
    "render": "twin",
    "trace": "tracer",
    "write_image": "files",
}
"""Name -> its module, and after a colon its name there, where a module of raytwin has that name."""

__all__ = [
    "Camera",
    "Image",
    "InputError",
    "Lambert",
    "Rectangle",
    "Scene",
    "SceneFile",
    "Sky",
    "Sphere",
    "Sun",
    "augment_photo",
    "calibrate",
    "check",
    "compare_images",
    "compare_scene",
    "diff_files",
    "read_board",
    "read_image",
    "read_scene",
    "render",
    "trace",
    "write_image",
]


if not TYPE_CHECKING:  # or every misspelt name would be one, of type Any

    def __getattr__(name: str) -> object:
        if name == "__version__":
            from importlib.metadata import version

            return version("raytwin")
        if name not in _HOME:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module, _, own = _HOME[name].partition(":")
        try:
            return getattr(import_module(f"{__name__}.{module}"), own or name)
        except ModuleNotFoundError as error:
            from raytwin.errors import extras_for, missing_package

            if not extras_for(error):
                raise
            raise missing_package(f"{__name__}.{name}", error) from None


def __dir__() -> list[str]:
    return [*__all__, "__doc__", "__name__", "__path__"]
