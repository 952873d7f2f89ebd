"""Shapes and dtypes of arrays, as annotations: `Float32[np.ndarray, "h w 3"]`, after jaxtyping.

To a type checker each is `np.ndarray`, which needs no package but NumPy. The tests check shapes at run time, with
jaxtyping, which nothing else imports.
"""

import os
from typing import TYPE_CHECKING, Any

__all__ = ["Bool", "Float", "Float32", "Float64", "Int", "Int32", "UInt8"]

CHECKED = "RAYTWIN_CHECK_SHAPES"

if TYPE_CHECKING:
    from typing import Annotated as Bool
    from typing import Annotated as Float
    from typing import Annotated as Float32
    from typing import Annotated as Float64
    from typing import Annotated as Int
    from typing import Annotated as Int32
    from typing import Annotated as UInt8
elif CHECKED in os.environ:
    from jaxtyping import Bool, Float, Float32, Float64, Int, Int32, UInt8
else:

    class _Plain:
        """X[kind, shape] is the kind."""

        def __class_getitem__(cls, item: tuple[Any, str]) -> Any:
            return item[0]

    Bool = Float = Float32 = Float64 = Int = Int32 = UInt8 = _Plain
