"""The steps of the tracer as data: to change one, `STAGES._replace(lambert=...)`; the others stay as they are."""

from collections.abc import Callable
from typing import Any, NamedTuple


class Stages(NamedTuple):
    """Each a function of the tracer, or one that takes its place: a learner's, or a fault that is to be shown."""

    undistort: Callable[[Any, Any, tuple], Any]
    back_project: Callable[..., Any]
    intersect_sphere: Callable[[Any, Any, Any], Any]
    intersect_rectangle: Callable[[Any, Any, Any], Any]
    nearer: Callable[[Any, Any], Any]
    normal: Callable[[Any, Any], Any]
    lambert: Callable[..., Any]
    sun_visible: Callable[..., Any]
