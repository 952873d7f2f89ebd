"""Writing safely: under a temporary name first, then renamed: an interrupted run leaves the old file or the new one."""

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

from raytwin.errors import InputError


@contextlib.contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """A temporary path beside `path`, renamed to it when the block ends well and removed when it does not.

    Links are followed. A device or a pipe (/dev/stdout) is handed out as it is: a rename would replace it.
    """
    real = Path(os.path.realpath(path))
    if real.is_dir():
        raise InputError(path, "a file to write", "a folder")
    temporary = real.parent / f".{real.stem}-{secrets.token_hex(4)}{real.suffix}"
    try:
        if real.exists() and not real.is_file():
            yield real
            return
        real.parent.mkdir(parents=True, exist_ok=True)
        temporary.touch(exist_ok=False)
        yield temporary
        temporary.replace(real)
    except OSError as error:
        raise InputError(path, "a place that can be written", error.strerror or error) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_text(path: str | os.PathLike, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
