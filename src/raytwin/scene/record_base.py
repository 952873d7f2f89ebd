"""What every record is made of: lengths in metres, vectors as tuples of three floats, matrices as tuples of rows.

All positions and directions are in the board frame (right-handed, X and Y in the board's plane, Z out of the printed
face towards the viewer) unless a name says otherwise. A record checks its own rules in `__post_init__`.
"""

import re
import reprlib
from copy import copy
from difflib import get_close_matches
from typing import Annotated, Any, Self, TypeVar

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

Struct = TypeVar("Struct", bound=msgspec.Struct)


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
        try:
            return msgspec.convert(values, type(self))
        except msgspec.ValidationError as error:
            raise input_error(error, values, type(self)).at(f"{type(self).__name__}.") from None


def unchecked(record: Struct, **values: Any) -> Struct:
    """Return a copy with other values of some fields, without the record's checks, which are for plain numbers."""
    made = copy(record)
    for name, value in values.items():
        msgspec.structs.force_setattr(made, name, value)
    return made


def input_error(error: msgspec.ValidationError, data: Any, kind: Any, prefix: str = "") -> InputError:
    """Return msgspec's error about `data`, to be a `kind`, in raytwin's words, with the value that was found.

    Its place is the field, such as `spheres[1].radius`, after `prefix`. The error of a record's own rule stays.
    """
    what, _, path = str(error).partition(" - at `$")
    path = path.rstrip("`").lstrip(".")
    field = _join(prefix, path)
    if isinstance(error.__cause__, InputError):
        return error.__cause__.at(f"{field}." if field else "")
    if match := re.match(r"Object contains unknown field `(.*)`", what):
        meant = get_close_matches(match[1], _keys(kind), 1)
        return InputError(_join(field, match[1]), f"is no known key.{f' Did you mean {meant[0]}?' if meant else ''}")
    if match := re.match(r"Object missing required field `(.*)`", what):
        return InputError(_join(field, match[1]), "is missing.")
    what = re.sub(r", got (`.*`|\d+)$", "", what.removeprefix("Expected "))
    for theirs, ours in _WORDS.items():
        what = what.replace(theirs, ours)
    if path.endswith("radius"):  # the only bounded length
        what = what.replace("a number", "metres")
    found: Any = data
    for key in re.findall(r"[^.\[\]]+", path):
        try:
            found = found[int(key)] if isinstance(found, list | tuple) else found[key]
        except (KeyError, IndexError, TypeError, ValueError):
            break
    return InputError(field, re.sub(r"(\d)\.0\b", r"\1", what), reprlib.repr(found))


_WORDS = {
    "`float`": "a number", "`int`": "a whole number", "`str`": "text", "`array`": "a list", "`object`": "a table",
    "`bool`": "true or false", "Number out of range": "a number that 64 bits hold",
}  # fmt: skip
"""msgspec's words -> ours."""


def _keys(kind: Any) -> list[str]:
    """Return the keys of the record and of those within it."""
    _, tables = msgspec.json.schema_components([kind])
    return [key for table in tables.values() for key in table.get("properties", ())]


def _join(prefix: str, field: str) -> str:
    return f"{prefix}.{field}" if prefix and field and not field.startswith("[") else f"{prefix}{field}"


def _listed(value: Any) -> Any:
    """Return an array, also one within a list, as lists; anything else as it is."""
    if isinstance(value, list | tuple):
        return tuple(map(_listed, value))
    return value.tolist() if hasattr(value, "tolist") else value
