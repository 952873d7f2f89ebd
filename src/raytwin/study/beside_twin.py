"""A subject's image beside the twin's: the comparison that each workflow and the live page make."""

from typing import Any

from raytwin import twin
from raytwin.compare import Comparison, compare
from raytwin.images.image import Image
from raytwin.images.stored_precision import rounding_of
from raytwin.scene import Scene, Tolerance


def compare_with_twin(
    test: Image, reference: Image, scene: Scene, tolerance: Tolerance | None = None, flip: bool = False, **options: Any
) -> Comparison:
    """Compare with the twin's `reference`, whose float32 may err (`twin.settle`). `flip`: with the perceptual metric.

    What the format of the test's file has rounded off is not counted. `options` are further ones of `compare`.
    """
    rounding = rounding_of(test)
    test, said = twin.settle(test, reference, scene)
    shown, half_steps = rounding.shown(reference), (rounding.half, None)
    found = compare(test, shown, tolerance=tolerance or Tolerance(), half_steps=half_steps, flip=flip, **options)
    return found.saying(*said)
