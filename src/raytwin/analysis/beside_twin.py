"""A subject's image beside the twin's: the comparison that each workflow and the live page make."""

from typing import Any

from raytwin import files, twin
from raytwin.compare import Comparison, compare
from raytwin.image import Image
from raytwin.scene import Scene, Tolerance


def compare_with_twin(
    test: Image, reference: Image, scene: Scene, tolerance: Tolerance | None = None, flip: bool = False, **options: Any
) -> Comparison:
    """Compare with the twin's `reference`; float32 may put its highlights off. `flip`: with the perceptual metric.

    What the format of the test's file has rounded off is not counted. `options` are further ones of `compare`.
    """
    surface = reference.surface if scene.glossy else None
    rounding = files.rounding_of(test)
    half = rounding.half
    if surface is not None:
        half = twin.highlight_rounding(scene, surface) + (0 if half is None else half)
    shown = rounding.shown(reference)
    return compare(test, shown, tolerance=tolerance or Tolerance(), half_steps=(half, None), flip=flip, **options)
