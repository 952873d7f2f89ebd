"""Hostile submissions: what each tries, and the verdict that it must get.

ATTACKS: functions of one submission; each gives 1.0 where it has worked, 0.0 (or an error) where not. What the filter
of system calls refuses is tried in test_filter.py; here are some of each kind, which show that it is in force. ENDINGS:
submissions whose process does not live to tell; the sort of verdict, and a word of it.
"""

import time
from pathlib import Path
from typing import NamedTuple


def goes(folder: Path) -> bool:
    """Whether the folder is removed within a minute: a slow disk takes seconds for many nested ones."""
    until = time.monotonic() + 60
    while folder.exists() and time.monotonic() < until:
        time.sleep(0.02)
    return not folder.exists()


ATTACKS = '''
import ctypes, errno, os, resource, socket, subprocess, sys
import numpy as np

libc = ctypes.CDLL(None, use_errno=True)
HOME = os.getcwd()
PARENT = os.getppid()

def tried(attack):
    def call(*arguments):
        try:
            return np.array(1.0 if attack(*arguments) else 0.0)
        except (OSError, ValueError, ImportError, MemoryError, subprocess.SubprocessError):
            return np.array(0.0)
    return call

def opens(path, mode="r"):
    with open(path, mode) as file:
        file.read(1) if mode == "r" else file.write("hacked")
    return True

@tried
def has_the_graders_descriptors(told):
    mine = [fd for fd in range(3, 256) if is_open(fd)]
    return len(mine) > 2  # requests and answers
@tried
def reads_the_references(told): return opens(told["reference"])
@tried
def lists_the_graders_folder(told): return bool(os.listdir(told["folder"]))
@tried
def writes_the_results(told): return opens(told["results"], "w")
@tried
def reads_the_parents_environment(told): return opens(f"/proc/{PARENT}/environ")
@tried
def writes_to_tmp(told): return opens(f"/tmp/{told['name']}", "w")
@tried
def writes_beside_its_folder(told): return opens(os.path.join(HOME, "..", "submission", "hacked"), "w")
@tried
def leaves_by_a_link(told):
    os.symlink(told["folder"], "out")
    return opens("out/results.json", "w") or opens("out/results.json")
@tried
def leaves_by_a_hard_link(told):
    os.link(told["reference"], "hard")
    return opens("hard")
@tried
def connects_by_tcp(told):
    with socket.socket() as s:
        s.settimeout(1)
        s.connect(("127.0.0.1", told["port"]))
        return True
@tried
def connects_by_unix(told):
    with socket.socket(socket.AF_UNIX) as s:
        s.connect("\\0" + told["name"])
        return True
@tried
def kills_the_parent(told):
    os.kill(PARENT, 0)
    return True
@tried
def traces_the_parent(told):
    return libc.ptrace(16, PARENT, 0, 0) == 0  # PTRACE_ATTACH
@tried
def reads_the_parents_memory(told):
    buffer = ctypes.create_string_buffer(8)
    vector = (ctypes.c_void_p * 2)(ctypes.addressof(buffer), 8)
    done = libc.process_vm_readv(PARENT, ctypes.byref(vector), 1, ctypes.byref(vector), 1, 0)
    return done >= 0 or ctypes.get_errno() != errno.EPERM
@tried
def leaves_its_session(told):
    os.setsid()
    return True
@tried
def raises_its_limits(told):
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (2 * hard, 2 * hard))
    return True
@tried
def gains_rights(told):
    os.setuid(0)
    return os.getuid() == 0 and opens("/etc/shadow")
@tried
def takes_all_memory(told): return np.ones(1 << 40).sum() > 0
@tried
def fills_a_file(told):
    with open("big", "wb") as file:
        file.truncate(1 << 40)
    return True
@tried
def asks_raytwin_for_the_answers(told):
    sys.modules.pop("raytwin", None)
    import raytwin.tracer
    return True
@tried
def closes_a_neighbours_file(told):
    os.chmod(told["results"], 0)
    return True
@tried
def opens_many_files(told):
    there = []
    try:
        while len(there) < 100: there.append(open("/dev/null"))
    finally:
        for file in there: file.close()
    return True
@tried
def finds_the_graders_folders_in_a_frame(told):
    frame = sys._getframe()
    found = ""
    while frame is not None:
        found += repr(frame.f_locals)
        frame = frame.f_back
    return told["backwards"][::-1] in found
@tried
def imports_a_renderer(told):
    import importlib.machinery
    sys.meta_path.append(importlib.machinery.PathFinder)
    import PIL.Image  # as good as any: it is always installed, and no rubric names it
    return True
@tried
def empties_the_results(told): os.truncate(told["results"], 0); return True
@tried
def offers_the_parent_to_the_killer_of_memory(told): return opens(f"/proc/{PARENT}/oom_score_adj", "w")
@tried
def reads_others_environments(told):
    others = [p for p in os.listdir("/proc") if p.isdigit() and int(p) != os.getpid()]
    return any([tried(opens)(f"/proc/{p}/environ") for p in others])
@tried
def opens_a_terminal(told): return os.open("/dev/tty", os.O_RDWR) >= 0
def is_open(fd):
    try:
        os.fstat(fd)
        return True
    except OSError:
        return False

def leaves_a_child_behind():
    """Answers, and leaves a process that sleeps."""
    if (pid := os.fork()) == 0:
        import time
        time.sleep(600)
        os._exit(0)
    return np.array(pid)

def digs_deep():
    """A folder 900 deep, in which nobody may look."""
    for _ in range(900):
        os.mkdir("d")
        os.chdir("d")
    os.chdir(HOME)
    os.mkdir("shut", 0)
    return np.array(1.0)

def breaks_numpy():
    np.allclose = lambda *a, **k: True
    np.ndarray.tobytes  # cannot be changed: a type of C
    return np.array([np.nan, np.inf])

class Bomb:
    def __reduce__(self): return os.system, (f"touch /tmp/raytwin-{PARENT}",)

def returns_a_pickle_bomb(): return Bomb()
def returns_objects(): return np.array([Bomb(), None])
def returns_nothing(): return None
def returns_far_too_much(): return np.broadcast_to(np.float64(1), (1 << 14, 1 << 14))
def returns_another_shape(): return np.zeros((3, 0, 5), bool)
def ends_python(): sys.exit(0)

class Mute(Exception):
    def __str__(self): raise self

def raises_what_cannot_be_printed(): raise Mute
def recurses(): return recurses()
'''


class Ending(NamedTuple):
    """`f` is called twice, if it answers; `sort` and `word` are of the verdict on the last call."""

    source: str
    sort: str
    word: str


ENDINGS = {
    "an endless loop": Ending("def f():\n while True: pass", "limit", "computing"),
    "a sleep": Ending("import time\ndef f(): time.sleep(600)", "limit", "clock"),
    "a print without end": Ending("def f():\n while True: print('x' * 100_000)", "error", "File too large"),
    "a fork bomb": Ending(
        "import os, time\ndef f():\n"
        " for _ in range(60):\n  try:\n   os.fork()\n  except OSError: pass\n time.sleep(600)",
        "limit", "",
    ),
    "memory, bit by bit": Ending("def f():\n x = []\n while True: x.append(bytearray(10**7))", "error limit", ""),
    "many files": Ending(
        "def f():\n i = 0\n while True:\n  open(str(i), 'wb').write(b'x' * 1000_000)\n  i += 1", "limit", "wrote more"
    ),
    "os._exit": Ending("import os\ndef f(): os._exit(0)", "broken", "exit code 0"),
    "a crash": Ending("import ctypes\ndef f(): ctypes.string_at(0)", "broken", "SIGSEGV"),
    "all descriptors closed": Ending("import os\ndef f(): os.closerange(0, 256)", "broken", "without an answer"),
    "noise in the grader's pipe": Ending(
        "import os\ndef f():\n for fd in range(3, 20):\n  try: os.write(fd, b'\\xff' * 64)\n  except OSError: pass",
        "broken", "pipe",
    ),
    "an import that is not there": Ending("import torch_of_mine", "error", "ModuleNotFoundError"),
    "an end while it is loaded": Ending("import sys\nsys.exit(3)", "error", "SystemExit"),
}  # fmt: skip

ENDINGS |= {
    f"a forged {which} message: {text[:40]}": Ending(
        f"import os\nhead = {text!r}.encode()\n"
        "text = (8 + len(head)).to_bytes(8, 'little') + len(head).to_bytes(8, 'little') + head\n"
        "def forge():\n for fd in range(3, 20):\n  try: os.write(fd, text)\n  except OSError: pass\n"
        + ("forge()\ndef f(): return 1.0" if which == "second" else "def f(): forge(); return 1.0"),
        "broken", "grader's pipe",
    )
    for which, texts in {
        "second": ('{"value": {"table": {"functions": 5, "notes": []}}, "arrays": []}', '{}'),
        "later": (
            '{"value": {}, "arrays": []}', 'null', '{"value": {"table": {"call": 2, "arrays": []}}, "arrays": []}',
            '{"value": {"array": 0}, "arrays": [["<f8", Infinity]]}',
        ),
    }.items()
    for text in texts
}  # fmt: skip
"""Messages in the place of the sandbox's second one and of an answer."""
