"""TOML and JSON from records, and TOML into records, or one line that names file, field and what was found."""

import math
import os
import re
import reprlib
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
import tomli_w

from raytwin.errors import InputError
from raytwin.safe_write import check_file, write_text
from raytwin.scene.record_base import explained

T = TypeVar("T")


def write_json(path: str | os.PathLike[str], value: Any) -> None:
    write_text(path, json_text(value))


def json_text(value: Any) -> str:
    """`value` (plain data, records, arrays as lists) as indented JSON; NaN and infinity become null."""
    return msgspec.json.format(msgspec.json.encode(value, enc_hook=_foreign), indent=2).decode() + "\n"


def write_toml(path: str | os.PathLike[str], value: Mapping[str, Any], comment: str = "") -> None:
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    write_text(path, head + tomli_w.dumps(plain(value)))


def plain(value: Any) -> Any:
    """Records, dataclasses and arrays as dicts, lists and numbers."""
    return msgspec.to_builtins(value, str_keys=True, enc_hook=_foreign)


def _foreign(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"cannot write {type(value).__name__}")


def read_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    path = check_file(path, "a TOML file")
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(path, "a TOML file", error.strerror) from None
    except UnicodeDecodeError as error:
        raise InputError(path, "UTF-8 text", f"byte {error.object[error.start]:#04x} at {error.start}") from None
    except (ValueError, RecursionError) as error:  # beside TOMLDecodeError: numbers too long, lists too deep
        raise InputError(path, "TOML", error) from None


def to_record(path: str | os.PathLike[str], data: Any, kind: type[T], prefix: str = "") -> T:
    """`data` (parsed TOML or JSON) as the record `kind`, or an InputError that names file, field and what was found."""
    try:
        record = msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        raise _readable(path, data, error, kind, prefix) from None
    except InputError as error:  # a rule of the record's own
        raise error.at(f"{path}: {f'{prefix}.' * bool(prefix)}") from None
    if bad := next(_not_finite(data, ""), None):
        raise InputError(f"{path}: {_join(prefix, bad[0])}", "a finite number", bad[1])
    return record


def _readable(
    path: str | os.PathLike[str], data: Any, error: msgspec.ValidationError, kind: Any, prefix: str
) -> InputError:
    """msgspec's error in this project's words, with the value that was found."""
    field, what = explained(error)
    found: Any = data
    for key in re.findall(r"[^.\[\]]+", field):
        try:
            found = found[int(key)] if isinstance(found, list) else found[key]
        except (KeyError, IndexError, TypeError, ValueError):
            break
    if match := re.match(r"Object contains unknown field `(.*)`", what):
        return unknown_key(path, _join(prefix, _join(field, match[1])), _keys(kind, field))
    if match := re.match(r"Object missing required field `(.*)`", what):
        return InputError(f"{path}: {_join(prefix, _join(field, match[1]))}", "is missing.")
    if field.endswith("radius"):  # the only bounded length
        what = what.replace("a number", "metres")
    shown = _SHORT.repr(found)
    return InputError(f"{path}: {_join(prefix, field)}", what, shown if len(shown) <= 60 else shown[:57] + "...")


def unknown_key(path: str | os.PathLike[str], field: str, known: Iterable[str] = ()) -> InputError:
    """The error for a key of a TOML file that is none of those `known`, with its line and what was meant."""
    meant = get_close_matches(field.rpartition(".")[2], list(known), 1)
    line = _line_of(path, field)
    place = f"{path}: {field}{f' (line {line})' if line else ''}"
    return InputError(place, f"is no known key.{f' Did you mean {meant[0]}?' if meant else ''}")


def _line_of(path: str | os.PathLike[str], field: str) -> int | None:
    """The line of a TOML file on which a key, or the table of that name, stands; None where no line is its own."""
    if not Path(path).is_file():
        return None
    table, counts = "", Counter[str]()
    for number, line in enumerate(Path(path).read_text(encoding="utf-8").splitlines(), start=1):
        if match := re.match(r"\s*(\[\[?)\s*([^\]]+?)\s*\]", line):
            table = match[2] if match[1] == "[" else f"{match[2]}[{counts[match[2]]}]"
            counts[match[2]] += 1
            if match[2] == field:
                return number
        elif (match := re.match(r"""\s*["']?([^=#]+?)["']?\s*=""", line)) and _join(table, match[1]) == field:
            return number
    return None


def _keys(kind: Any, field: str) -> list[str]:
    """The keys that the record `kind` has in the table `field`, as `spheres[1]`."""
    kinds = [msgspec.inspect.type_info(kind)]
    for key in ["", *re.findall(r"[^.\[\]]+", field)]:
        kinds = [inner for one in kinds for inner in (_inner(one, key) if key else [one])]
        kinds = [each for one in kinds for each in (one.types if isinstance(one, msgspec.inspect.UnionType) else [one])]
    return [f.encode_name for one in kinds if isinstance(one, msgspec.inspect.StructType) for f in one.fields]


def _inner(kind: Any, key: str) -> list[Any]:
    if isinstance(kind, msgspec.inspect.StructType):
        return [f.type for f in kind.fields if f.encode_name == key]
    return [getattr(kind, name) for name in ("item_type", "value_type") if hasattr(kind, name)]


_SHORT = reprlib.Repr()
vars(_SHORT).update(maxlevel=3, maxdict=8, maxlist=16, maxtuple=16, maxstring=80, maxlong=80, maxother=80)
"""A few nested lists can stand for gigabytes of text."""


def _join(prefix: str, field: str) -> str:
    return f"{prefix}.{field}" if prefix and field and not field.startswith("[") else f"{prefix}{field}"


def _not_finite(data: Any, where: str) -> Iterator[tuple[str, float]]:
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _not_finite(value, _join(where, key))
    elif isinstance(data, list):
        for i, value in enumerate(data):
            yield from _not_finite(value, f"{where}[{i}]")
    elif isinstance(data, float) and not math.isfinite(data):
        yield where, data
