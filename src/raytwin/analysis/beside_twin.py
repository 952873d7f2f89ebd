"""A subject's image beside the twin's: the comparison that each workflow and the live page make."""

from typing import Any

from raytwin import twin
from raytwin.compare import Comparison, compare
from raytwin.image import Image
from raytwin.scene import Scene, Tolerance


def compare_with_twin(
    test: Image, reference: Image, scene: Scene, tolerance: Tolerance | None = None, flip: bool = False, **options: Any
) -> Comparison:
    """Compare with the twin's `reference`, whose float32 may err (`twin.settle`). `flip`: with the perceptual metric.

    `options` are further ones of `compare`.
    """
    test, granted, said = twin.settle(test, reference, scene)
    half_steps = granted, None
    found = compare(test, reference, tolerance=tolerance or Tolerance(), half_steps=half_steps, flip=flip, **options)
    return found.saying(*said)
