"""What processes use is what their own clocks say, children that ended and files without a name included."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from raytwin.sandbox.lock import _threads_of
from raytwin.sandbox.process_group import awake, members, nameless_bytes, processes_of_user, usage

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="/proc is Linux's")

PROGRAM = """
import mmap, os, sys, time
def compute(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end: pass
if os.fork() == 0:
    compute(0.2)
    os._exit(0)
os.wait()
if os.fork() == 0:
    compute(0.1)
    os._exit(0)  # nobody waits
compute(0.1)
held = bytearray(os.urandom(1 << 20) * 50)
a, b = open("a", "w+b"), open("b", "w+b")
for file in (a, b):
    os.unlink(file.name)
    file.write(os.urandom(1 << 20) * 2)
    file.flush()
mapped = mmap.mmap(b.fileno(), 2 << 20)
b.close()
c = os.dup(a.fileno())
time.sleep(0.3)
print(sum(os.times()[:4]) + 0.1, flush=True)
sys.stdin.read(1)
"""


@pytest.fixture
def program(tmp_path):
    """(process in a group of its own that sleeps now, seconds that it computed by its own account)"""
    running = subprocess.Popen(
        [sys.executable, "-IS", "-c", PROGRAM],
        cwd=tmp_path, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True,
    )  # fmt: skip
    seconds = float(running.stdout.readline())
    while awake(members(running.pid)):  # between its line and its sleep
        time.sleep(0.01)
    yield running, seconds
    running.kill()
    running.wait()
    running.stdin.close()
    running.stdout.close()


def test_seconds_memory_processes_and_nameless_files_are_counted(program):
    running, seconds = program
    group = members(running.pid)
    found = usage(group)
    assert found.seconds == pytest.approx(seconds, abs=0.08)  # 0.4 and Python's start
    assert found.processes == 2  # itself, and the dead child that nobody waits for
    assert sorted(m.stat[0] for m in group) == [b"S", b"Z"]
    status = Path(f"/proc/{running.pid}/status").read_text()
    resident = int(status.split("VmRSS:")[1].split()[0]) * 1024
    assert found.memory == pytest.approx(resident, rel=0.1)
    assert nameless_bytes(group) == pytest.approx(4 << 20, rel=0.02)  # each file once, by name or mapping
    assert not awake(group)
    assert running.pid in set(processes_of_user(os.getuid()))
    assert _threads_of(os.getuid()) > 1


def test_a_group_that_is_not_there_uses_nothing(program):
    running, _ = program
    running.kill()
    running.wait()
    assert members(1 << 30) == []
    assert usage([]) == (0, 0, 0.0)
    assert nameless_bytes([]) == nameless_bytes(members(running.pid)) == 0
    assert not awake([])


def test_who_computes_is_awake():
    assert awake(members(os.getpgid(0)))
