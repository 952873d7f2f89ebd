"""Drawing into photos: a scene's objects with their shadows, and transparent pyramids."""

from raytwin.photos.augment.box_outlines import draw_boxes
from raytwin.photos.augment.colour import of_three_channels, to_rec709
from raytwin.photos.augment.objects import augment, printed
from raytwin.photos.augment.pyramid import draw_pyramid
