"""Writing safely: under a temporary name first, then renamed: an interrupted run leaves the old file or the new one."""

import contextlib
import os
import secrets
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from raytwin.errors import InputError


@contextlib.contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """A temporary path beside `path`, renamed to it when the block ends well and removed when it does not.

    An existing file's mode is kept. An existing link is replaced, never followed, so that whoever planted it does not
    choose what is overwritten. A device or pipe, or a link to one (/dev/stdout), is yielded unchanged.
    """
    path = Path(path)
    temporary = path.parent / f".{path.stem}-{secrets.token_hex(4)}{path.suffix}"
    try:
        if path.is_dir():
            raise InputError(path, "a file to write", "a folder")
        if (path.exists() and not path.is_file()) or _is_of_the_system(path):
            yield path
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.touch(exist_ok=False)
        yield temporary
        if path.is_file() and not path.is_symlink():
            temporary.chmod(stat.S_IMODE(path.stat().st_mode) & 0o777)
        temporary.replace(path)
    except OSError as error:
        raise InputError(path, "a writable path", error.strerror or error) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def replacing_files(folder: str | os.PathLike) -> Iterator[Path]:
    """A temporary folder whose files are moved into `folder` when the block ends well, and removed when it does not."""
    folder = Path(folder)
    try:
        above = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.is_dir())
        with tempfile.TemporaryDirectory(dir=above, prefix=".raytwin-") as temporary:
            yield Path(temporary)
            folder.mkdir(parents=True, exist_ok=True)
            for path in sorted(Path(temporary).iterdir()):
                path.replace(folder / path.name)
    except OSError as error:
        raise InputError(folder, "a writable folder", error.strerror or error) from error


def _is_of_the_system(path: Path) -> bool:
    """/dev/stdout, /proc/self/fd/1: where these lead to a file, replacing it would leave the opened one behind."""
    return path.absolute().parts[1:2] in (("dev",), ("proc",))


def check_file(path: str | os.PathLike, kind: str) -> Path:
    """`path` if it is a file, which `kind` names: no folder, and no device or pipe, which may never end."""
    path = Path(path)
    try:
        whole = path.is_file()
    except OSError as error:  # a folder above that may not be entered
        raise InputError(path, kind, error.strerror or error) from None
    if not whole:
        what = "a folder" if path.is_dir() else "a device or a pipe" if path.exists() else "no such file"
        raise InputError(path, kind, what)
    return path


def write_text(path: str | os.PathLike, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
