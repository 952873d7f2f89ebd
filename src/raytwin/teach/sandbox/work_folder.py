"""The folders of one submission: a copy of what was handed in, what it wrote and how much, and their removal."""

import contextlib
import os
import shutil
import subprocess
import threading
from pathlib import Path

from raytwin.errors import InputError

MEGA = 1_000_000
"""Bytes per MB, as the messages count."""
MOST_FILES = 10_000
"""Files and folders that a submission may hand in, and that it may write."""

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


def excess(folder: Path, most: int) -> str:
    """What is too much of all that lies below the folder, in words."""
    size, count = 0, 0
    for where, folders, names in os.walk(folder):
        count += len(folders) + len(names)
        if count > MOST_FILES:
            return "it wrote more than 10 000 files: ended"
        for name in names:
            with contextlib.suppress(OSError):
                size += os.lstat(f"{where}/{name}").st_size
    return f"it wrote more than {most // MEGA} MB: ended" if size > most else ""


def remove(folder: Path) -> None:
    """Remove the folder in a process of its own, and wait for that for a second: thousands of folders take longer.

    The process goes on even if the grader ends. A folder that its owner may not read is opened first.
    """
    if os.name != "posix":
        shutil.rmtree(folder, ignore_errors=True)
        return
    command = ["sh", "-c", 'rm -rf "$0" || { chmod -R u+rwx "$0"; rm -rf "$0"; }', str(folder)]
    quiet = {"stderr": subprocess.DEVNULL, "start_new_session": True}
    removing = threading.Thread(target=subprocess.run, args=(command,), kwargs=quiet, daemon=True)
    removing.start()
    removing.join(REMOVAL_SECONDS)
