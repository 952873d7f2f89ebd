"""The twin: the same scene through Mitsuba 3, the only home of Mitsuba.

`activate()` finds a backend that works on this machine, `render()` renders, `doctor()` says what was found. Mitsuba is
imported when the first of them is called, not before; `chosen()` does without.
"""

from raytwin.twin.backend import activate, chosen, doctor, versions
from raytwin.twin.mitsuba_render import mitsuba_provenance, named_shapes, render_mitsuba
from raytwin.twin.opencv_sensor import mitsuba_sensor
from raytwin.twin.rendering import MOST_SAMPLES, SAMPLINGS, provenance, render
from raytwin.twin.rounding import settle
