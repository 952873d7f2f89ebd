"""A subject's image beside the twin's: the comparison that each workflow and the live page make."""

from typing import Any

from raytwin import twin
from raytwin.compare import Comparison, compare
from raytwin.image import Image
from raytwin.scene import Scene, Tolerance


def compare_with_twin(
    test: Image, reference: Image, scene: Scene, tolerance: Tolerance | None = None, flip: bool = False, **options: Any
) -> Comparison:
    """Compare with the twin's `reference`; float32 may put its highlights off. `flip`: with the perceptual metric.

    `options` are further ones of `compare`.
    """
    surface = reference.surface if scene.glossy else None
    steep = None if surface is None else twin.highlight_rounding(scene, surface)
    return compare(test, reference, tolerance=tolerance or Tolerance(), half_steps=(steep, None), flip=flip, **options)
