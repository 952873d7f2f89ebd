"""All that makes the subject fast, and changes no pixel of it: engines, boxes, lists, points, speculation, walks.

scene -> EyeScene (camera's frame, engine's floats) -> boxes -> plan (tiles and their lists) -> tracer -> canvas
"""

from raytwin.speed.boxes import TRIMS, corner_box, trim_box, trim_boxes
from raytwin.speed.engine import ENGINES
from raytwin.speed.frame import background, check_rows, draw, trace, with_solver
from raytwin.speed.path_tracing import PARTS, light_parts, walk
from raytwin.speed.speculation import WAYS, speculate, trace_points
