"""TOML and JSON from records, and TOML into records, or one line that names file, field and what was found."""

import math
import os
import tomllib
from collections.abc import Mapping
from typing import Any, TypeVar

import msgspec
import numpy as np
import tomli_w

from raytwin.errors import InputError
from raytwin.safe_write import check_file, write_text
from raytwin.scene.record_base import input_error

T = TypeVar("T")


def write_json(path: str | os.PathLike[str], value: Any) -> None:
    write_text(path, json_text(value))


def json_text(value: Any) -> str:
    """Return `value` (plain data, records, arrays as lists) as indented JSON; NaN and infinity become null."""
    return msgspec.json.format(msgspec.json.encode(value, enc_hook=_foreign), indent=2).decode() + "\n"


def write_toml(path: str | os.PathLike[str], value: Mapping[str, Any], comment: str = "") -> None:
    write_text(path, comment_lines(comment) + tomli_w.dumps(plain(value)))


def comment_lines(comment: str) -> str:
    return "".join(f"# {line}\n" for line in comment.splitlines())


def plain(value: Any) -> Any:
    """Return records, dataclasses and arrays as dicts, lists and numbers."""
    return msgspec.to_builtins(value, str_keys=True, enc_hook=_foreign)


def _foreign(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"cannot write {type(value).__name__}")


def read_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the file's tables; NaN and infinity are text, which no record takes for a number."""
    path = check_file(path, "a TOML file")
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"), parse_float=_finite)
    except OSError as error:
        raise InputError(path, "a TOML file", error.strerror) from None
    except UnicodeDecodeError as error:
        raise InputError(path, "UTF-8 text", f"byte {error.object[error.start]:#04x} at {error.start}") from None
    except (ValueError, RecursionError) as error:  # beside TOMLDecodeError: numbers too long, lists too deep
        raise InputError(path, "TOML", error) from None


def _finite(text: str) -> float | str:
    return value if math.isfinite(value := float(text)) else text


def to_record(path: str | os.PathLike[str], data: Any, kind: type[T], prefix: str = "") -> T:
    """Return `data` (parsed TOML or JSON) as the record `kind`; `prefix` names the table that it is.

    Raises InputError that names file, field and what was found.
    """
    try:
        return msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        raise input_error(error, data, kind, prefix).at(f"{path}: ") from None
