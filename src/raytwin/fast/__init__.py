"""All that makes the subject fast, and changes no pixel of it: engines, boxes, lists, points, speculation, walks.

scene -> EyeScene (camera's frame, engine's floats) -> boxes -> plan (tiles and their lists) -> tracer -> canvas
"""

from raytwin.fast.boxes import TRIMS, corner_box, trim_boxes
from raytwin.fast.engine import ENGINES
from raytwin.fast.frame import background, check_rows, draw, trace
from raytwin.fast.path_tracing import PARTS, light_parts, walk
from raytwin.fast.speculation import WAYS, speculate
