"""The filter of system calls, run by an interpreter of classic BPF that is written here: kernel's filter.txt."""

import errno
import struct

import pytest

from raytwin.teach.sandbox.lock import DENIED, IOCTLS, MACHINES, assembled

ALLOW, KILL, REFUSE, ABSENT = 0x7FFF0000, 0x80000000, 0x50000 | errno.EPERM, 0x50000 | errno.ENOSYS
PID = 4321


def verdict(program: bytes, architecture: int, number: int, *arguments: int) -> int:
    """Run the filter on a struct seccomp_data: number, architecture, instruction pointer, six arguments."""
    padded = [*arguments, *[0] * (6 - len(arguments))]
    data = struct.pack("<IIQ6Q", number, architecture, 0, *(a & (2**64 - 1) for a in padded))
    lines = [struct.unpack_from("<HBBI", program, i) for i in range(0, len(program), 8)]
    accumulator, at = 0, 0
    while True:
        code, true, false, k = lines[at]
        at += 1
        if code == 0x06:
            return k
        if code == 0x20:
            (accumulator,) = struct.unpack_from("<I", data, k)
        elif code == 0x15:
            at += true if accumulator == k else false
        elif code == 0x35:
            at += true if accumulator >= k else false
        elif code == 0x45:
            at += true if accumulator & k else false
        else:
            raise AssertionError(f"code {code:#x}")


@pytest.fixture(params=["x86_64", "aarch64"])
def ask(request):
    """What the filter answers to a call: its numbers on both architectures, and its arguments."""
    architecture, column = MACHINES[request.param]
    program = assembled(architecture, column, PID)

    def of(numbers: tuple[int, int], *arguments: int) -> int:
        return verdict(program, architecture, numbers[column], *arguments)

    of.program, of.architecture, of.column = program, architecture, column
    return of


def test_every_call_on_the_list_is_refused(ask):
    for name, numbers in DENIED.items():
        if numbers[ask.column] >= 0:
            assert ask(numbers) == REFUSE, name


# Numbers from the kernel's own tables (arch/x86/entry/syscalls/syscall_64.tbl, include/uapi/asm-generic/unistd.h).
NEEDED = (
    (0, 63), (1, 64), (257, 56), (9, 222), (3, 57), (39, 172), (61, 260), (59, 221), (60, 93), (202, 98), (230, 115),
)  # fmt: skip
"""read, write, openat, mmap, close, getpid, wait4, execve, exit, futex, clock_nanosleep"""
USELESS = (
    (53, 199), (41, 198), (101, 117), (268, 53), (91, 52), (452, 452), (260, 54), (280, 88), (188, 5), (197, 14),
    (294, 26), (254, 27), (112, 157), (434, 434), (438, 438), (272, 97), (308, 268), (425, 425), (29, 194), (64, 190),
    (68, 186), (240, 180), (248, 217), (165, 40), (321, 280), (319, 279), (141, 140),
)  # fmt: skip
"""socketpair, socket, ptrace, fchmodat, fchmod, fchmodat2, fchownat, utimensat, setxattr, removexattr, inotify_init1,
inotify_add_watch, setsid, pidfd_open, pidfd_getfd, unshare, setns, io_uring_setup, shmget, semget, msgget, mq_open,
add_key, mount, bpf, memfd_create, setpriority: of all that are refused those that do something at once."""


def test_what_python_needs_is_allowed_and_what_a_submission_has_no_need_of_is_refused_by_the_kernels_numbers(ask):
    assert {ask(numbers, 17, 17, 17) for numbers in NEEDED} == {ALLOW}
    assert {ask(numbers) for numbers in USELESS} == {REFUSE}


def test_another_architecture_is_killed_and_x32_is_refused(ask):
    assert verdict(ask.program, ask.architecture ^ 1, 0) == KILL
    assert verdict(ask.program, ask.architecture, 0x40000000 | 41) == REFUSE


def test_children_are_made_in_the_same_namespaces_and_by_their_own_parent(ask):
    fork = 0x01200011  # CLONE_CHILD_SETTID | CLONE_CHILD_CLEARTID | SIGCHLD: glibc's fork
    thread = 0x3D0F00  # glibc's thread
    assert ask((56, 220), fork) == ask((56, 220), thread) == ask((56, 220), 0x4111) == ALLOW  # 0x4000: vfork
    for flag in (0x80, 0x20000, 0x02000000, 0x04000000, 0x08000000, 0x10000000, 0x20000000, 0x40000000, 0x8000):
        assert ask((56, 220), fork | flag) == REFUSE
    assert ask((435, 435)) == ABSENT


def test_signals_and_limits_are_for_itself_alone(ask):
    for kill in ((62, 129), (234, 131), (302, 261)):
        assert ask(kill, PID, 9) == ALLOW
        assert ask(kill, PID + 1, 9) == ask(kill, 1, 9) == ask(kill, -1, 9) == REFUSE
    assert ask((62, 129), 0) == ask((302, 261), 0) == ALLOW  # its group, itself
    assert ask((234, 131), 0) == REFUSE


def test_it_waits_for_its_children_ends_with_the_grader_and_shares_no_memory_without_a_file(ask):
    assert ask((13, 134), 17, 5) == REFUSE  # SIGCHLD
    assert ask((13, 134), 2, 5) == ask((13, 134), 16) == ask((13, 134), 18) == ALLOW
    assert ask((157, 167), 15, 1) == ask((157, 167), 4, 36) == ALLOW  # PR_SET_NAME
    assert ask((157, 167), 1) == ask((157, 167), 36, 1) == REFUSE
    private, shared, of_file = 0x22, 0x21, 0x01
    assert ask((9, 222), 0, 4096, 3, private) == ask((9, 222), 0x21, 0x21, 0x21, of_file) == ALLOW
    assert ask((9, 222), 0, 4096, 3, shared) == ask((9, 222), 0, 4096, 3, shared | 0x4000) == REFUSE


def test_descriptors_tell_nobody_else_and_pipes_stay_small(ask):
    assert ask((72, 25), 3, 1) == ask((72, 25), 3, 1032) == ask((16, 29), 3, 0x5401) == ALLOW
    for command in (8, 10, 15, 1024, 1026, 1031):
        assert ask((72, 25), 3, command) == REFUSE
        assert ask((72, 25), command, 3) == ALLOW
    for command in (0x8901, 0x8902, 0x5412, 0x541C, 0x40086602, 0x401C5820):
        assert ask((16, 29), 3, command) == REFUSE
    assert len(IOCTLS) == 6
