"""Checks the annotated shapes, dtypes and types of tracer and speed on every call in the tests."""

import os

import jaxtyping
from beartype import BeartypeConf, beartype

# An int is a float here, as type checkers have it.
checked = beartype(conf=BeartypeConf(is_pep484_tower=True))
# Not records: a scene's are checked by msgspec where they are read, and engines put their own floats in; an Image may
# hold whatever a foreign file or a test hands over, which the comparison must tell in words.
ROOMS = ("raytwin.rungs", "raytwin.tracer", "raytwin.speed")
jaxtyping.install_import_hook(list(ROOMS), "shape_checks.checked")

# For this process alone: those that tests start are as light as a user's.
os.environ["RAYTWIN_CHECK_SHAPES"] = "1"
import raytwin.shapes  # noqa: E402

del os.environ["RAYTWIN_CHECK_SHAPES"]
assert raytwin.shapes.Float32 is jaxtyping.Float32
