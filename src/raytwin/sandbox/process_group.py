"""What the processes of a submission use, read from /proc: how many, their memory, their seconds, nameless files."""

import contextlib
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

PAGE = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 4096
TICKS = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100


class Usage(NamedTuple):
    """`memory`: bytes; `seconds`: computed, by children that ended, too. Zeros where there is no /proc."""

    processes: int = 0
    memory: int = 0
    seconds: float = 0.0


class Member(NamedTuple):
    """A process of a group; `stat`: what /proc/PID/stat says after its name, which is free."""

    pid: int
    stat: list[bytes]


def members(group: int) -> list[Member]:
    """Return a process group. Who is dead and not waited for is among them: the filter of lock.py sees to it that
    nobody is reaped unseen (no SIGCHLD is ignored, and orphans are the first process's children)."""
    found = []
    for pid in _processes():
        with contextlib.suppress(OSError):
            # To ask for the group is far quicker than to read it.
            if os.getpgid(pid) == group and (stat := _stat(f"/proc/{pid}/stat")):
                found.append(Member(pid, stat))
    return found


def usage(found: Sequence[Member]) -> Usage:
    """Sum up what processes use."""
    pages = sum(int(m.stat[21]) for m in found if m.stat[0] != b"Z")
    # In user's and system's mode, its own seconds and those of children waited for.
    ticks = sum(int(x) for m in found for x in m.stat[11:15])
    return Usage(len(found), pages * PAGE, ticks / TICKS)


def awake(found: Sequence[Member]) -> bool:
    """Whether any thread of these processes computes, waits for a core to do so, or for a disk."""
    for member in found:
        with contextlib.suppress(OSError, IndexError):
            for thread in Path(f"/proc/{member.pid}/task").iterdir():
                if _stat(f"{thread}/stat")[0] in (b"R", b"D"):
                    return True
    return False


def nameless_bytes(found: Sequence[Member]) -> int:
    """Bytes on disk of files without a name that processes have open or mapped: no folder lists them."""
    sizes: dict[tuple[int, int], int] = {}
    for pid, _ in found:
        with contextlib.suppress(OSError):
            for name in os.listdir(f"/proc/{pid}/fd"):  # noqa: PTH208 - ten times a second
                with contextlib.suppress(OSError):
                    file = os.stat(f"/proc/{pid}/fd/{name}")  # noqa: PTH116
                    if file.st_nlink == 0:
                        sizes[file.st_dev, file.st_ino] = file.st_blocks * 512
        with contextlib.suppress(OSError):
            mapped = Path(f"/proc/{pid}/maps").read_bytes()
            for line in mapped.splitlines() if b" (deleted)\n" in mapped else ():
                if line.endswith(b" (deleted)"):
                    _add_mapped(sizes, line)
    return sum(sizes.values())


def _add_mapped(sizes: dict[tuple[int, int], int], line: bytes) -> None:
    """A line of /proc/PID/maps: the file reaches at least to the end of what is mapped."""
    match = re.match(rb"([0-9a-f]+)-([0-9a-f]+) \S+ ([0-9a-f]+) ([0-9a-f]+):([0-9a-f]+) (\d+)", line)
    if match:
        start, end, offset, major, minor = (int(match[i], 16) for i in range(1, 6))
        key = os.makedev(major, minor), int(match[6])
        sizes[key] = max(sizes.get(key, 0), offset + end - start)


def processes_of_user(uid: int) -> Iterator[int]:
    """Yield the processes of a user."""
    for pid in _processes():
        with contextlib.suppress(OSError):
            if Path(f"/proc/{pid}").stat().st_uid == uid:
                yield pid


def _stat(path: str) -> list[bytes]:
    return _start_of(path).rpartition(b")")[2].split()


def _processes() -> Iterator[int]:
    with contextlib.suppress(OSError), os.scandir("/proc") as entries:
        yield from (int(entry.name) for entry in entries if entry.name.isdigit())


def _start_of(path: str) -> bytes:
    """Its first bytes; a hundred files ten times a second, so no Path."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        return os.read(descriptor, 1024)
    finally:
        os.close(descriptor)
