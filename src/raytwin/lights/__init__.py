"""Lights as rays meet them: in the rays' frame and the engine's floats."""
