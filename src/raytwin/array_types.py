"""Shapes and dtypes of arrays, as annotations: `Float32[np.ndarray, "h w 3"]`, after jaxtyping.

The tests check them at run time; otherwise each is plain `np.ndarray`, and jaxtyping is not even imported.
"""

import os
from typing import TYPE_CHECKING, Any

__all__ = ["Bool", "Float", "Float32", "Float64", "Int", "Int32", "UInt8"]

CHECKED = "RAYTWIN_CHECK_SHAPES"

if TYPE_CHECKING or CHECKED in os.environ:
    from jaxtyping import Bool, Float, Float32, Float64, Int, Int32, UInt8
else:

    class _Plain:
        """X[kind, shape] is the kind."""

        def __class_getitem__(cls, item: tuple[Any, str]) -> Any:
            return item[0]

    Bool = Float = Float32 = Float64 = Int = Int32 = UInt8 = _Plain
