"""Photos of an AprilTag board in, a calibrated camera out; and the photographer who makes such photos, with the truth.

board -> detect -> calibrate -> pose; `lens` holds the distortion, `judge` the doubts about a calibration.
"""
