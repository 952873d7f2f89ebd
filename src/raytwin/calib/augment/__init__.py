"""Drawing into photos: a scene's objects with their shadows, and transparent pyramids."""

from raytwin.calib.augment.box_outlines import draw_boxes
from raytwin.calib.augment.colour import of_three_channels, to_rec709
from raytwin.calib.augment.objects import augment, errors_by_region, printed, regions_of
from raytwin.calib.augment.pyramid import draw_pyramid
