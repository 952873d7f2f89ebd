"""Drawing into photos: a scene's objects with their shadows, and transparent pyramids."""

from raytwin.photos.augment.objects import augment, draw_boxes, printed
from raytwin.photos.augment.pyramid import draw_pyramid
