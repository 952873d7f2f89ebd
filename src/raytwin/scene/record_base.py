"""What every record is made of: lengths in metres, vectors as tuples of three floats, matrices as tuples of rows.

All positions and directions are in the board frame (right-handed, X and Y in the board's plane, Z out of the printed
face towards the viewer) unless a name says otherwise.
"""

import re
from typing import Annotated, Any, Self

import msgspec

from raytwin.errors import InputError, check_one_of

Positive = Annotated[float, msgspec.Meta(gt=0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0)]
Fraction = Annotated[float, msgspec.Meta(ge=0, le=1)]
PixelCount = Annotated[int, msgspec.Meta(ge=1, le=100_000)]

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]
Albedo = tuple[Fraction, Fraction, Fraction]
Radiance = tuple[NonNegative, NonNegative, NonNegative]


class Row(msgspec.Struct, frozen=True):
    """A record that is only written and shown: read back, a file of a later version may have more fields."""

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, nested records as dicts: what `json` and `pandas.DataFrame` take."""
        plain: dict[str, Any] = msgspec.to_builtins(self)
        return plain


class Record(Row, frozen=True, forbid_unknown_fields=True):
    """The base of every record: immutable, compared by value, strict about unknown fields."""

    def with_(self, **changes: Any) -> Self:
        """Return the same record with other values of some fields. Raises InputError for one that cannot be.

        >>> from raytwin.scene import Sphere
        >>> Sphere((0, 0, 1), 1).with_(radius=0.5).radius
        0.5
        """
        for name in changes:
            check_one_of(type(self).__name__, name, self.__struct_fields__)
        known = {k: v for k, v in msgspec.structs.asdict(self).items() if v is not msgspec.UNSET}
        values = {name: _listed(value) for name, value in (known | changes).items()}
        tag = self.__struct_config__.tag
        try:
            return msgspec.convert(({"type": tag} if tag else {}) | values, type(self))
        except msgspec.ValidationError as error:
            path, right = explained(error)
            field = re.split(r"[.\[]", path)[0]
            raise InputError(f"{type(self).__name__}.{field}", right, repr(values.get(field))) from None


def explained(error: msgspec.ValidationError) -> tuple[str, str]:
    """Return the field, as `spheres[1].radius`, and what was expected there, of msgspec's `Expected ... - at `$...`."""
    what, _, field = str(error).partition(" - at `$")
    what = re.sub(r", got (`.*`|\d+)$", "", what.removeprefix("Expected "))
    for theirs, ours in _WORDS.items():
        what = what.replace(theirs, ours)
    return field.rstrip("`").lstrip("."), re.sub(r"(\d)\.0\b", r"\1", what)


_WORDS = {
    "`float`": "a number", "`int`": "a whole number", "`str`": "text", "`array`": "a list", "`object`": "a table",
    "`bool`": "true or false", "Number out of range": "a number that 64 bits hold",
}  # fmt: skip
"""msgspec's words -> ours."""


def _listed(value: Any) -> Any:
    """Return an array, also one within a list, as lists; anything else as it is."""
    if isinstance(value, list | tuple):
        return tuple(map(_listed, value))
    return value.tolist() if hasattr(value, "tolist") else value
