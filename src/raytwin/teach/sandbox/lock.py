"""A process locks itself in: rlimits, another uid, Landlock, seccomp; what the machine lacks is said, never assumed.

Standard library alone: a submission's process loads this file before any of the submission's code. Each lock holds for
the process and all that it starts, and cannot be taken back.
"""

import contextlib
import ctypes
import errno
import math
import os
import platform
import site
import struct
import sys
import sysconfig
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

LOCKS = {
    "process group": "left-over processes are killed",
    "rlimits": "memory, CPU seconds, size of files, number of processes",
    "other uid": "reads and kills nothing of the grader's",
    "Landlock": "sees Python, the packages that the rubric names, its own files and an empty folder",
    "seccomp": "no sockets, no ptrace, no other namespaces, no signals to others, no change of files' rights or times",
}
"""What can hold, and what it is for."""

HOLDS = "holds"

BYTES_OF_LIBRARIES = 1_000_000_000
"""Addresses that files take, which are mapped and hardly read; what a process writes counts as its data as well."""
SUBMISSIONS_AT_ONCE = max(8, os.cpu_count() or 1)
"""Submissions that an ordinary user may grade at the same time: RLIMIT_NPROC counts the threads of all of them."""
SPARE_CPU_SECONDS = 1
"""From SIGXCPU, which says why a process ends, to SIGKILL, which no submission can catch."""


def lock(
    folder: Path, submission: Path, limits: dict[str, int], hidden: Sequence[str], entries: Sequence[str]
) -> dict[str, str]:
    """Apply every lock; return for each of them `HOLDS`, or why it does not hold.

    `folder` alone can be written to. `hidden` folders cannot be read, nor installed packages but for these `entries`.
    """
    unseen = [*hidden, *(str(Path(p, "raytwin")) for p in sys.path), *_other_packages(entries)]
    steps = {
        "process group": _own_group,
        "rlimits": lambda: _limit(limits),
        "Landlock": lambda: _landlock(folder, submission, [Path(h).resolve() for h in unseen]),
        "other uid": lambda: _drop(folder, limits["processes"]),
        "seccomp": _seccomp,
    }
    found = {}
    for name, step in steps.items():
        try:
            step()
            found[name] = HOLDS
        except _Lacking as reason:
            found[name] = str(reason)
        except (OSError, AttributeError, ImportError, ValueError) as error:
            found[name] = f"{type(error).__name__}: {error}"
    return found


class _Lacking(Exception):
    """A lock that this machine has not."""


# ------------------------------------------------------------------------------------------ group, limits, uid


def _own_group() -> None:
    if not hasattr(os, "getpgid"):
        raise _Lacking("not on this system")
    if os.getpgid(0) != os.getpid():
        raise _Lacking("it is in another's group")
    if sys.platform == "linux":
        _prctl(1, 9)  # PR_SET_PDEATHSIG: killed with the grader
        _prctl(38, 1)  # PR_SET_NO_NEW_PRIVS: no setuid program helps
        _prctl(36, 1)  # PR_SET_CHILD_SUBREAPER: orphans become its children, not the grader's
        with contextlib.suppress(OSError):  # where memory ends, this process ends, not the grader
            Path("/proc/self/oom_score_adj").write_text("1000")


def _limit(limits: dict[str, int]) -> None:
    try:
        import resource
    except ImportError:
        raise _Lacking("not on this system") from None
    asked = {
        "RLIMIT_CORE": 0,
        "RLIMIT_DATA": limits["memory"],
        "RLIMIT_AS": limits["memory"] + BYTES_OF_LIBRARIES,
        "RLIMIT_CPU": math.ceil(time.process_time()) + limits["cpu"] + SPARE_CPU_SECONDS,
        "RLIMIT_FSIZE": limits["file"],
        "RLIMIT_NOFILE": 64,
        "RLIMIT_MSGQUEUE": 0,
        "RLIMIT_MEMLOCK": 0,
    }
    if os.getuid() != 0:
        asked["RLIMIT_NPROC"] = _threads_of(os.getuid()) + SUBMISSIONS_AT_ONCE * limits["processes"]
    for name, value in asked.items():
        if (kind := getattr(resource, name, None)) is not None:
            most = resource.getrlimit(kind)[1]
            value = value if most == resource.RLIM_INFINITY else min(value, most)
            resource.setrlimit(kind, (value, value))
    allow_cpu(limits["cpu"])


def allow_cpu(seconds: float) -> None:
    """Let this process compute for so many seconds from now on, within its hard limit: SIGXCPU ends it."""
    try:
        import resource
    except ImportError:
        return
    most = resource.getrlimit(resource.RLIMIT_CPU)[1]
    if most != resource.RLIM_INFINITY:
        soft = min(math.ceil(time.process_time() + seconds), most - SPARE_CPU_SECONDS)
        resource.setrlimit(resource.RLIMIT_CPU, (soft, most))


def _threads_of(uid: int) -> int:
    """How many threads the user runs."""
    count = 0
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if entry.stat().st_uid == uid:
                count += sum(1 for _ in (entry / "task").iterdir())
        except OSError:  # it has ended, or is another's
            continue
    return count


def _drop(folder: Path, processes: int) -> None:
    """Change to a uid that no other process has. The folder is its alone, and it may pass through the one above."""
    if not hasattr(os, "getuid") or os.getuid() != 0:
        raise _Lacking("the grader is not root")
    for name in ("numpy", "encodings"):  # what lies where the uid cannot read could not be imported any more
        file = Path(getattr(sys.modules.get(name), "__file__", None) or sys.executable).resolve()
        for place in (file, *file.parents):
            if not place.stat().st_mode & (0o001 if place.is_dir() else 0o004):
                raise OSError(errno.EACCES, "another uid cannot read Python's packages", str(place))
    uid = 60_000 + os.getpid() % 5_000
    os.chown(folder, uid, uid)
    os.chown(folder.parent, -1, uid)
    folder.parent.chmod(0o710)
    import resource

    resource.setrlimit(resource.RLIMIT_NPROC, (processes, processes))
    os.setgroups([])
    os.setresgid(uid, uid, uid)
    os.setresuid(uid, uid, uid)
    if sys.platform == "linux":
        _prctl(1, 9)  # a change of uid has taken it back


def _prctl(option: int, value: int) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(option, ctypes.c_ulong(value), *(ctypes.c_ulong(0),) * 3):
        raise OSError(ctypes.get_errno(), f"prctl {option}")


# ------------------------------------------------------------------------------------------ Landlock


EXECUTE, WRITE_FILE, READ_FILE, READ_DIR = 1, 2, 4, 8
SPECIAL = 1 << 6 | 1 << 9 | 1 << 11 | 1 << 15 | 1 << 16
"""MAKE_CHAR, MAKE_SOCK, MAKE_BLOCK, IOCTL_DEV, RESOLVE_UNIX: nobody's."""
RIGHTS = {1: 13, 2: 14, 3: 15, 5: 16, 9: 17}
"""How many rights (bits, from EXECUTE on) Landlock knows from a version of its ABI on: linux/landlock.h."""
TCP, SCOPES = (4, 3), (6, 3)
"""(Version of the ABI, bits) of bind and connect, and of abstract sockets and signals to outside."""


def _landlock(folder: Path, submission: Path, hidden: Sequence[Path]) -> None:
    if sys.platform != "linux":
        raise _Lacking("not on this system")
    libc = ctypes.CDLL(None, use_errno=True)
    version = libc.syscall(444, None, ctypes.c_size_t(0), 1)
    if version < 1:
        raise _Lacking("not in this kernel")
    known = (1 << max(count for since, count in RIGHTS.items() if since <= version)) - 1
    handled = struct.pack("=QQQ", known, *(bits if version >= since else 0 for since, bits in (TCP, SCOPES)))
    rules = _checked(libc.syscall(444, handled, ctypes.c_size_t(len(handled)), 0))
    reading = READ_FILE | READ_DIR | EXECUTE
    try:
        for path, listed in readable(hidden):
            _allow(libc, rules, path, READ_DIR if listed else reading)
        _allow(libc, rules, Path("/dev/null"), READ_FILE | WRITE_FILE)
        _allow(libc, rules, submission, reading)
        _allow(libc, rules, folder, known & ~SPECIAL)
        _prctl(38, 1)
        _checked(libc.syscall(446, rules, 0))
    finally:
        os.close(rules)


def _allow(libc: ctypes.CDLL, rules: int, path: Path, rights: int) -> None:
    """Add a rule for all below the path: a struct landlock_path_beneath_attr. What has just gone needs none."""
    with contextlib.suppress(FileNotFoundError):
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
        try:
            if not path.is_dir():
                rights &= READ_FILE | WRITE_FILE
            _checked(libc.syscall(445, rules, 1, struct.pack("=Qi", rights, place), 0))
        finally:
            os.close(place)


def _checked(result: int) -> int:
    if result < 0:
        raise OSError(number := ctypes.get_errno(), os.strerror(number))
    return result


def readable(hidden: Sequence[Path]) -> Iterator[tuple[Path, bool]]:
    """Yield Python, the system's libraries and packages, without what is hidden; True: only the names in it."""
    roots = [sys.prefix, sys.base_prefix, *sys.path, "/usr", "/lib", "/lib64", "/bin"]
    files = ["/etc/ld.so.cache", "/etc/localtime", "/dev/urandom", "/dev/zero", "/proc/cpuinfo", "/proc/meminfo"]
    files += ["/sys/devices/system/cpu"]
    there = {Path(p).resolve() for p in [*roots, *files] if p and Path(p).exists()} - {Path("/")}
    for root in sorted(there):
        for path, listed in _without(str(root), frozenset(map(str, hidden))):
            yield Path(path), listed


def _without(root: str, hidden: Iterable[str]) -> Iterator[tuple[str, bool]]:
    """The root, or what lies in it, without what is hidden. A hidden folder above it is no reason to hide it."""
    inside = frozenset(h for h in hidden if h == root or h.startswith(f"{root}/"))
    if root in inside:
        return
    if not inside:
        yield root, False
        return
    yield root, True
    with os.scandir(root) as entries:
        for child in sorted(entry.path for entry in entries if not entry.is_symlink()):
            yield from _without(child, inside)


def _other_packages(entries: Sequence[str]) -> Iterator[str]:
    """What lies in folders of installed packages beside these entries; the standard library is no such folder."""
    library = [sysconfig.get_path("stdlib"), sysconfig.get_path("platstdlib")]
    library += [os.path.join(folder, "lib-dynload") for folder in library]  # noqa: PTH118
    folders = {p for p in sys.path if p not in library} | set(site.getsitepackages([sys.prefix, sys.base_prefix]))
    prefixes = [Path(p).resolve() for p in (sys.prefix, sys.base_prefix)]  # the grader's folder may hold its Python
    folders |= {str(p) for root in ("/usr", "/usr/local") for p in Path(root).glob("lib/python3*/*-packages")}
    for folder in sorted(folders):
        with contextlib.suppress(OSError):
            for path in Path(folder).resolve().iterdir():
                if path.name not in entries and not any(prefix.is_relative_to(path) for prefix in prefixes):
                    yield str(path)


# ------------------------------------------------------------------------------------------ seccomp

DENIED: dict[str, tuple[int, int]] = {
    # sockets; a pair holds memory of the kernel's that nobody counts
    "socketpair": (53, 199), "socket": (41, 198), "connect": (42, 203), "accept": (43, 202), "accept4": (288, 242),
    "bind": (49, 200), "listen": (50, 201), "sendmmsg": (307, 269),
    # other processes
    "ptrace": (101, 117), "process_vm_readv": (310, 270), "process_vm_writev": (311, 271), "kcmp": (312, 272),
    "pidfd_open": (434, 434), "pidfd_getfd": (438, 438), "pidfd_send_signal": (424, 424), "tkill": (200, 130),
    "rt_sigqueueinfo": (129, 138), "rt_tgsigqueueinfo": (297, 240), "process_madvise": (440, 440),
    "process_mrelease": (448, 448), "migrate_pages": (256, 238), "move_pages": (279, 239), "setpriority": (141, 140),
    "sched_setaffinity": (203, 122), "sched_setscheduler": (144, 119), "sched_setparam": (142, 118),
    "sched_setattr": (314, 274), "ioprio_set": (251, 30),
    # out of the group that is killed in the end
    "setsid": (112, 157), "setpgid": (109, 154),
    # namespaces, mounts, handles of files
    "unshare": (272, 97), "setns": (308, 268), "mount": (165, 40), "umount2": (166, 39), "pivot_root": (155, 41),
    "chroot": (161, 51), "open_tree": (428, 428), "move_mount": (429, 429), "fsopen": (430, 430),
    "fsconfig": (431, 431), "fsmount": (432, 432), "fspick": (433, 433), "mount_setattr": (442, 442),
    "name_to_handle_at": (303, 264), "open_by_handle_at": (304, 265), "fanotify_init": (300, 262),
    # rights, owners, times and attributes of files, whose paths Landlock does not ask for; watching folders
    "chmod": (90, -1), "fchmod": (91, 52), "fchmodat": (268, 53), "fchmodat2": (452, 452), "chown": (92, -1),
    "fchown": (93, 55), "lchown": (94, -1), "fchownat": (260, 54), "utime": (132, -1), "utimes": (235, -1),
    "futimesat": (261, -1), "utimensat": (280, 88), "setxattr": (188, 5), "lsetxattr": (189, 6), "fsetxattr": (190, 7),
    "setxattrat": (463, 463), "removexattr": (197, 14), "lremovexattr": (198, 15), "fremovexattr": (199, 16),
    "removexattrat": (466, 466), "file_setattr": (469, 469), "inotify_init": (253, -1), "inotify_init1": (294, 26),
    "inotify_add_watch": (254, 27),
    # ways round a filter, and into the kernel
    "io_uring_setup": (425, 425), "io_uring_enter": (426, 426), "io_uring_register": (427, 427), "bpf": (321, 280),
    "perf_event_open": (298, 241), "userfaultfd": (323, 282), "add_key": (248, 217), "request_key": (249, 218),
    "keyctl": (250, 219), "init_module": (175, 105), "finit_module": (313, 273), "delete_module": (176, 106),
    "kexec_load": (246, 104), "kexec_file_load": (320, 294), "personality": (135, 92), "syslog": (103, 116),
    # the machine's
    "reboot": (169, 142), "swapon": (167, 224), "swapoff": (168, 225), "quotactl": (179, 60), "acct": (163, 89),
    "settimeofday": (164, 170), "clock_settime": (227, 112), "adjtimex": (159, 171), "clock_adjtime": (305, 266),
    "sethostname": (170, 161), "setdomainname": (171, 162), "vhangup": (153, 58),
    # memory that outlives the process, or that no limit counts
    "shmget": (29, 194), "semget": (64, 190), "msgget": (68, 186), "mq_open": (240, 180), "memfd_create": (319, 279),
    "memfd_secret": (447, 447),
}  # fmt: skip
"""System calls that are refused: their numbers on x86_64 and on aarch64, -1 where there is none."""

PARTLY = {
    "clone": (56, 220), "clone3": (435, 435), "kill": (62, 129), "tgkill": (234, 131), "prlimit64": (302, 261),
    "fcntl": (72, 25), "ioctl": (16, 29), "rt_sigaction": (13, 134), "prctl": (157, 167), "mmap": (9, 222),
}  # fmt: skip
"""Refused for some arguments."""

MACHINES = {"x86_64": (0xC000003E, 0), "amd64": (0xC000003E, 0), "aarch64": (0xC00000B7, 1), "arm64": (0xC00000B7, 1)}
"""AUDIT_ARCH_*, and the column above."""

NEW_NAMESPACES, CLONE_PARENT = 0x7E020080, 0x8000
"""CLONE_NEWNS, CGROUP, UTS, IPC, USER, PID, NET, TIME; and a child of the grader's, whom nobody waits for."""
SIGCHLD = 17
"""Children that ended count as processes until they are waited for: a submission may not have them dropped."""
PRCTLS = {"PR_SET_PDEATHSIG": 1, "PR_SET_CHILD_SUBREAPER": 36}
"""What ends it with the grader, and makes its orphans its own children."""
MAP_SHARED, MAP_ANONYMOUS = 1, 0x20
"""Both: memory without a file that outlives the process that fills it."""
FCNTLS = {
    "F_SETOWN": 8, "F_SETSIG": 10, "F_SETOWN_EX": 15, "F_SETLEASE": 1024, "F_NOTIFY": 1026, "F_SETPIPE_SZ": 1031,
}  # fmt: skip
IOCTLS = {
    "FIOSETOWN": 0x8901, "SIOCSPGRP": 0x8902, "TIOCSTI": 0x5412, "TIOCLINUX": 0x541C,
    "FS_IOC_SETFLAGS": 0x40086602, "FS_IOC_FSSETXATTR": 0x401C5820,
}  # fmt: skip

_LOAD, _EQUAL, _AT_LEAST, _ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
_ALLOW, _KILL, _ERRNO = 0x7FFF0000, 0x80000000, 0x00050000
_REFUSE, _ABSENT = _ERRNO | errno.EPERM, _ERRNO | errno.ENOSYS


def _seccomp() -> None:
    if sys.platform != "linux" or platform.machine().lower() not in MACHINES:
        raise _Lacking("not on this system")
    program = assembled(*MACHINES[platform.machine().lower()], os.getpid())
    text = ctypes.create_string_buffer(program, len(program))

    class Program(ctypes.Structure):
        _fields_ = [("length", ctypes.c_ushort), ("filter", ctypes.c_void_p)]

    filter_ = Program(len(program) // 8, ctypes.addressof(text))
    _prctl(38, 1)
    libc = ctypes.CDLL(None, use_errno=True)
    call = {0: 317, 1: 277}[MACHINES[platform.machine().lower()][1]]
    if libc.syscall(call, 1, 1, ctypes.byref(filter_)) and libc.prctl(22, 2, ctypes.byref(filter_), 0, 0):
        raise OSError(ctypes.get_errno(), "the kernel takes no filter")


def assembled(architecture: int, column: int, pid: int) -> bytes:
    """The filter, in classic BPF. Another architecture's calls are refused, and x32's, whose numbers are others."""
    code: list[tuple[int, int, int, int]] = [(_LOAD, 0, 0, 4), (_EQUAL, 1, 0, architecture), (_RETURN, 0, 0, _KILL)]
    code += [(_LOAD, 0, 0, 0), (_AT_LEAST, 0, 1, 0x40000000), (_RETURN, 0, 0, _REFUSE)]
    number = {name: both[column] for name, both in PARTLY.items()}
    for refused in (both[column] for both in DENIED.values() if both[column] >= 0):
        code += [(_EQUAL, 0, 1, refused), (_RETURN, 0, 0, _REFUSE)]
    code += [(_EQUAL, 0, 1, number["clone3"]), (_RETURN, 0, 0, _ABSENT)]  # its flags lie in memory: clone comes next
    code += _refused(number["clone"], 0, (_ANY_BIT, NEW_NAMESPACES | CLONE_PARENT))
    code += _refused(number["mmap"], 3, (_ANY_BIT, MAP_SHARED), (_ANY_BIT, MAP_ANONYMOUS))
    code += _allowed(number["kill"], 0, (pid, 0))
    code += _allowed(number["tgkill"], 0, (pid,))
    code += _allowed(number["prlimit64"], 0, (pid, 0))
    code += _refused(number["rt_sigaction"], 0, (_EQUAL, SIGCHLD))
    for name, argument, values in (("prctl", 0, PRCTLS), ("fcntl", 1, FCNTLS), ("ioctl", 1, IOCTLS)):
        for value in values.values():
            code += _refused(number[name], argument, (_EQUAL, value))
    code.append((_RETURN, 0, 0, _ALLOW))
    return b"".join(struct.pack("<HBBI", *line) for line in code)


def _refused(number: int, argument: int, *tests: tuple[int, int]) -> list[tuple[int, int, int, int]]:
    """The call of that number, refused where its argument passes all tests, each a comparison and its value."""
    body = [(_LOAD, 0, 0, 16 + 8 * argument)]
    body += [(test, 0, len(tests) - i, value) for i, (test, value) in enumerate(tests)]
    body += [(_RETURN, 0, 0, _REFUSE), (_LOAD, 0, 0, 0)]
    return [(_EQUAL, 0, len(body), number), *body]


def _allowed(number: int, argument: int, values: Sequence[int]) -> list[tuple[int, int, int, int]]:
    """The call of that number, refused where its argument is none of the values."""
    body = [(_LOAD, 0, 0, 16 + 8 * argument)]
    body += [(_EQUAL, len(values) - i, 0, value) for i, value in enumerate(values)]
    body += [(_RETURN, 0, 0, _REFUSE), (_LOAD, 0, 0, 0)]
    return [(_EQUAL, 0, len(body), number), *body]
