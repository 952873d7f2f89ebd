"""The folders of one submission: a copy of what was handed in, what it wrote and how much, and their removal."""

import contextlib
import os
import shutil
import threading
from pathlib import Path

from raytwin.errors import InputError

MEGA = 1_000_000
"""Bytes per MB, as the messages count."""
MOST_FILES = 10_000
"""Files and folders that a submission may hand in, and that it may write."""
DEEPEST = 2000
"""Characters of a path below the working folder: beyond, folders are nested to hide or to stall."""


REMOVAL_SECONDS = 1.0
"""Seconds that grading waits for the removal of a submission's folder."""


def copy_files(folder: Path, to: Path, most: int) -> None:
    """Copy the files in `folder`, without links and devices, which lead elsewhere. InputError above `most` bytes."""
    size, count = 0, 0
    for where, folders, names in os.walk(folder, followlinks=False):
        here = to / Path(where).relative_to(folder)
        here.mkdir(exist_ok=True)
        folders[:] = [f for f in folders if not f.startswith(".") and not (Path(where) / f).is_symlink()]
        count += len(folders)
        for name in names:
            path = Path(where) / name
            if path.is_symlink() or not path.is_file():
                continue
            size, count = size + path.stat().st_size, count + 1
            if size > most or count > MOST_FILES:
                raise InputError(folder.name, f"a submission of at most {most // MEGA} MB and 10 000 files", "more")
            shutil.copyfile(path, here / name)
            (here / name).chmod(0o755 if os.access(path, os.X_OK) else 0o644)


def excess(folder: Path, most: int, nameless: int = 0) -> str:
    """What is too much of all that lies below the folder, in words; `nameless`: bytes that count as well."""
    size, count, todo = nameless, 0, [str(folder)]
    longest = len(todo[0]) + DEEPEST
    while todo:
        with contextlib.suppress(OSError), os.scandir(todo.pop()) as entries:
            for entry in entries:
                count += 1
                if count > MOST_FILES:
                    return "it wrote more than 10 000 files: ended"
                if len(entry.path) > longest:
                    return "it nested folders too deep: ended"
                with contextlib.suppress(OSError):
                    if entry.is_dir(follow_symlinks=False):
                        todo.append(entry.path)
                    else:
                        size += entry.stat(follow_symlinks=False).st_blocks * 512
        if size > most:
            break
    return f"it wrote more than {most // MEGA} MB: ended" if size > most else ""


def remove_soon(folder: Path, patience: float = REMOVAL_SECONDS) -> threading.Thread:
    """Remove the folder; return after `patience` seconds; whatever is left goes while the next submission is graded.

    A disk may take 5 ms to remove a folder, and a submission can nest 20 000. The interpreter ends after the thread.
    """
    removing = threading.Thread(target=remove, args=(folder,), name=f"remove {folder.name}")
    removing.start()
    removing.join(patience)
    return removing


def remove(folder: Path) -> None:
    """Remove the folder, however deep and whatever its rights: down by one name and up by `..`, so no path grows.

    Windows opens no folders, and no other user's files lie there: there `shutil` does it.
    """
    if os.open not in os.supports_dir_fd or not hasattr(os, "O_NOFOLLOW"):
        shutil.rmtree(folder, ignore_errors=True)
        return
    way: list[str] = []
    with contextlib.suppress(OSError):
        here = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        try:
            while True:
                below = _emptied(here)
                if below:
                    os.chmod(below, 0o700, dir_fd=here)
                    way.append(below)
                    here = _moved(here, below)
                elif way:
                    here = _moved(here, "..")
                    os.rmdir(way.pop(), dir_fd=here)
                else:
                    break
        finally:
            os.close(here)
        folder.rmdir()


def _emptied(here: int) -> str:
    """Remove the files and empty folders in a folder; return the first folder that is not empty, if there is one."""
    with os.scandir(here) as entries:
        for entry in entries:
            if not entry.is_dir(follow_symlinks=False):
                os.unlink(entry.name, dir_fd=here)
                continue
            try:
                os.rmdir(entry.name, dir_fd=here)
            except OSError:
                return entry.name
    return ""


def _moved(here: int, to: str) -> int:
    there = os.open(to, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=here)
    os.close(here)
    return there
