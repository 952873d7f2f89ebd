"""Drawing into photos: a scene's objects with their shadows, and transparent pyramids."""

from raytwin.calib.augment.colour import of_three_channels, to_rec709
from raytwin.calib.augment.objects import REGIONS, Augmented, augment, drawn_ids, errors_by_region, regions_of
from raytwin.calib.augment.pyramid import draw_pyramid

__all__ = [
    "REGIONS",
    "Augmented",
    "augment",
    "draw_pyramid",
    "drawn_ids",
    "errors_by_region",
    "of_three_channels",
    "regions_of",
    "to_rec709",
]
