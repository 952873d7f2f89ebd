"""raytwin: a hand-written ray tracer beside its Mitsuba twin."""
