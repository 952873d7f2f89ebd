"""TOML and JSON from records, and TOML into records, or one line that names file, field and what was found."""

import math
import os
import re
import reprlib
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

import msgspec
import numpy as np
import tomli_w

from raytwin.errors import InputError
from raytwin.files.safe_write import check_file, write_text
from raytwin.scene.record_base import explained

T = TypeVar("T")


def write_json(path: str | os.PathLike, value: Any) -> None:
    write_text(path, json_text(value))


def json_text(value: Any) -> str:
    """`value` (plain data, records, arrays as lists) as indented JSON; NaN and infinity become null."""
    return msgspec.json.format(msgspec.json.encode(value, enc_hook=_foreign), indent=2).decode() + "\n"


def write_toml(path: str | os.PathLike, value: Mapping[str, Any], comment: str = "") -> None:
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


def read_toml(path: str | os.PathLike) -> dict[str, Any]:
    path = check_file(path, "a TOML file")
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(path, "a TOML file", error.strerror) from None
    except UnicodeDecodeError as error:
        raise InputError(path, "UTF-8 text", f"byte {error.object[error.start]:#04x} at {error.start}") from None
    except (ValueError, RecursionError) as error:  # beside TOMLDecodeError: numbers too long, lists too deep
        raise InputError(path, "TOML", error) from None


def to_record(path: str | os.PathLike, data: Any, kind: type[T], prefix: str = "") -> T:
    """`data` (parsed TOML or JSON) as the record `kind`, or an InputError that names file, field and what was found."""
    try:
        record = msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        raise _readable(path, data, error, prefix) from None
    except InputError as error:  # a rule of the record's own
        raise InputError(f"{path}: {_join(prefix, error.where)}", error.expected, error.got) from None
    if bad := next(_not_finite(data, ""), None):
        raise InputError(f"{path}: {_join(prefix, bad[0])}", "a finite number", bad[1])
    return record


def _readable(path: str | os.PathLike, data: Any, error: msgspec.ValidationError, prefix: str) -> InputError:
    """msgspec's error in this project's words, with the value that was found."""
    field, what = explained(error)
    found: Any = data
    for key in re.findall(r"[^.\[\]]+", field):
        try:
            found = found[int(key)] if isinstance(found, list) else found[key]
        except (KeyError, IndexError, TypeError, ValueError):
            break
    if match := re.match(r"Object contains unknown field `(.*)`", what):
        name = match[1]
        known = "only known keys"
        return InputError(f"{path}: {_join(prefix, _join(field, name))}", known, f"the unknown key {name!r}")
    if match := re.match(r"Object missing required field `(.*)`", what):
        return InputError(f"{path}: {_join(prefix, _join(field, match[1]))}", "a value", "nothing")
    if field.endswith("radius"):  # the only bounded length
        what = what.replace("a number", "metres")
    shown = _SHORT.repr(found)
    return InputError(f"{path}: {_join(prefix, field)}", what, shown if len(shown) <= 60 else shown[:57] + "...")


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
