"""What every record is made of: lengths in metres, vectors as tuples of three floats, matrices as tuples of rows.

All positions and directions are in the board frame (right-handed, X and Y in the board's plane, Z out of the printed
face towards the viewer) unless a name says otherwise.
"""

from typing import Annotated

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0)]
Fraction = Annotated[float, msgspec.Meta(ge=0, le=1)]
PixelCount = Annotated[int, msgspec.Meta(ge=1, le=100_000)]

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]
Albedo = tuple[Fraction, Fraction, Fraction]
Radiance = tuple[NonNegative, NonNegative, NonNegative]


class Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The base of every record: immutable, compared by value, strict about unknown fields."""
