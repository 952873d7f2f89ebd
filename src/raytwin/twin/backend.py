"""Which libLLVM Mitsuba works with here: each is tried in a child process, because a wrong one aborts the process.

Order: the user's DRJIT_LIBLLVM_PATH, the one that pip installs, Dr.Jit's own choice. The answer is stored per machine.
Importing this module imports no Mitsuba.

Environment: RAYTWIN_VARIANT forces a variant, RAYTWIN_CACHE moves the cache.
"""

import contextlib
import hashlib
import json
import os
import platform
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import msgspec

from raytwin.errors import InputError, MachineError, missing_package
from raytwin.images.cache import cache_folder, installed
from raytwin.removed import SCALAR
from raytwin.scene.toml_json import write_json

LLVM, CUDA = VARIANTS = ("llvm_ad_rgb", "cuda_ad_rgb")
LIBRARY = "DRJIT_LIBLLVM_PATH"
USERS_LLVM = os.environ.get(LIBRARY) or None
"""The user's LIBRARY, before this module sets it for Dr.Jit."""
OWN_CHOICE = "Dr.Jit's own choice"
"""The libLLVM that Dr.Jit finds where DRJIT_LIBLLVM_PATH is not set."""
PROBE = Path(__file__).with_name("probe.py")
PROBE_SECONDS = 120
"""Limit for one probe. The first kernel alone takes several to compile."""
PACKAGES = ("raytwin", "mitsuba", "drjit", "numpy", "opencv-contrib-python-headless", "pupil-apriltags")


class Tried(msgspec.Struct, frozen=True):
    """One candidate, a library's path or CUDA, and how its probe went."""

    path: str
    ok: bool
    why: str


class Backend(msgspec.Struct, frozen=True):
    """Mitsuba's variant (None where none works), its libLLVM, and the candidates tried."""

    variant: str | None
    libllvm: str | None = None
    tried: tuple[Tried, ...] = ()


# Mitsuba's variant belongs to the process, and so do the choices made and the current one.
_chosen: dict[str, Backend] = {}
_current: Backend | None = None


def activate(variant: str | None = None) -> Backend:
    """Choose a backend that works here, make it Mitsuba's current variant, and say which it is.

    `variant` (or RAYTWIN_VARIANT) forces one of VARIANTS. Without either: the one that is active already, else
    `llvm_ad_rgb`. Cheap to call again, also for another variant. Raises MachineError where it does not work.
    """
    global _current
    backend = chosen(variant)
    if backend.variant is None and find_spec("mitsuba"):
        what = "; ".join(f"{t.path}: {t.why}" for t in backend.tried) or "no libLLVM at all"
        needed = "an NVIDIA GPU" if what.startswith(CUDA) else f"pip install 'raytwin[llvm]' or {LIBRARY}"
        raise MachineError("Mitsuba", f"a machine where it works (needs {needed})", what)
    try:
        import mitsuba as mi
    except ModuleNotFoundError as error:
        raise missing_package("the twin", error) from None
    _current = backend
    try:
        mi.set_variant(backend.variant)
    except ImportError as error:  # Dr.Jit was imported before, and found no libLLVM then
        needed = f"a libLLVM when Dr.Jit was imported: import it after raytwin, or set {LIBRARY}"
        raise MachineError(f"variant {backend.variant}", needed, error) from None
    package = str(Path(mi.__file__).parent)
    if str(mi.file_resolver()[0]) != package:  # else `plugins` of the current folder would stand in for Mitsuba's own
        mi.file_resolver().prepend(package)
    return backend


def chosen(variant: str | None = None) -> Backend:
    """What `activate` would make current. Dr.Jit, imported after this, uses the same libLLVM; Mitsuba is not imported.

    Where Dr.Jit was imported before, its library is the only one that this process can have.
    """
    forced = variant or os.environ.get("RAYTWIN_VARIANT")
    wanted = forced or (_current.variant if _current else None) or LLVM
    if wanted not in VARIANTS:
        got = f"{wanted}: {SCALAR}" if wanted.startswith("scalar") else wanted
        raise MachineError("variant" if variant else "RAYTWIN_VARIANT", " or ".join(VARIANTS), got)
    if wanted not in _chosen:
        _chosen[wanted] = find_backend(wanted)
    backend = _chosen[wanted]
    if backend.variant is None and wanted == LLVM:
        os.environ[LIBRARY] = os.devnull  # or Dr.Jit takes its own choice, and may abort
    elif backend.libllvm not in (None, OWN_CHOICE):
        os.environ[LIBRARY] = backend.libllvm
    return backend


def find_backend(variant: str = LLVM) -> Backend:
    """The backend that renders as `variant`: the stored one of this machine, or the first whose probe is correct."""
    if find_spec("mitsuba") is None:
        return Backend(None)
    candidates = [CUDA] if variant == CUDA else llvm_candidates()
    memory = cache_folder() / f"backend-{_machine(candidates)}.json"
    with contextlib.suppress(OSError, msgspec.MsgspecError):
        known = msgspec.json.decode(memory.read_bytes(), type=Backend)
        if known.variant == variant and known.libllvm in (None, *candidates):
            return known
    tried: list[Tried] = []
    for path in candidates:
        tried.append(probe(variant, path))
        if tried[-1].ok:  # a failure is not stored: a probe may just have met a busy machine
            backend = Backend(variant, None if path == CUDA else path, tuple(tried))
            with contextlib.suppress(InputError):  # a cache that cannot be written costs a probe next time alone
                write_json(memory, backend)
            return backend
    return Backend(None, tried=tuple(tried))


def probe(variant: str, path: str) -> Tried:
    """Render a sphere in a child process."""
    environment = {key: value for key, value in os.environ.items() if key != LIBRARY}
    if path not in (CUDA, OWN_CHOICE):
        if not Path(path).is_file():
            return Tried(path, False, "no such file")
        environment[LIBRARY] = path
    try:
        # -P: this folder's modules must not hide anyone else's.
        child = subprocess.run(
            [sys.executable, "-P", str(PROBE), variant],
            env=environment, capture_output=True, text=True, errors="replace", timeout=PROBE_SECONDS,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return Tried(path, False, f"no picture after {PROBE_SECONDS} s")
    except OSError as error:  # Python is embedded in another program, and cannot be started
        return Tried(path, False, str(error))
    try:
        found = json.loads(child.stdout.strip().splitlines()[-1])
        correct = abs(found["depth"] - 3) < 1e-3 and found["lit"] == 1 and abs(found["light"] - 0.125) < 5e-3
        version = f" (LLVM {found['llvm']})" if found["llvm"] else ""
    except (IndexError, ValueError, KeyError, TypeError):
        return Tried(path, False, _last_words(child.returncode, child.stderr))
    if child.returncode != 0 or not correct:
        return Tried(path, False, f"a wrong picture: {found}" if child.returncode == 0 else "crashed at exit")
    return Tried(path, True, f"renders{version}")


def _last_words(code: int, text: str) -> str:
    """Why a child died: the first line that names an error, else the last one."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    telling = [line for line in lines if re.search(r"too old|cannot select|failed|not (be )?found|error", line, re.I)]
    what = (telling or lines[-1:] or ["no output"])[0][:160]
    return f"aborts the process (signal {-code}): {what}" if code < 0 else what


def llvm_candidates() -> list[str]:
    """The libLLVMs worth trying, best first. Once Dr.Jit is imported, only the one that it was given."""
    if _drjit_is_imported():
        return [os.environ.get(LIBRARY) or OWN_CHOICE]
    names = ("lib/libLLVM.so.*", "lib/libLLVM.dylib", "Library/bin/LLVM-C.dll")
    by_pip = sorted((str(path) for name in names for path in Path(sys.prefix).glob(name)), reverse=True)
    return [*([USERS_LLVM] if USERS_LLVM else []), *by_pip[:1], OWN_CHOICE]


def _drjit_is_imported() -> bool:
    return "drjit" in sys.modules


def versions() -> dict[str, str]:
    """Python's version and those of the packages that decide what a render looks like."""
    return installed(PACKAGES)


def made_with(twin: str, variant: str | None) -> dict[str, str]:
    """What renders, as every provenance begins: versions, and Mitsuba's variant."""
    known = {"raytwin": "?"} | versions()
    return {"twin": twin, "variant": str(variant)} | {name: known[name] for name in ("raytwin", "mitsuba", "drjit")}


def _machine(candidates: list[str]) -> str:
    """A hash of everything that could change the answer: Python, packages, processor, candidates and their dates."""
    dates = [Path(path).stat().st_mtime_ns for path in candidates if Path(path).is_file()]
    facts = (sys.prefix, versions(), _processor(), PROBE.read_text(), candidates, dates)
    return hashlib.sha256(repr(facts).encode()).hexdigest()[:20]


def _processor() -> str:
    """Model and features of the processor, for which LLVM compiles."""
    with contextlib.suppress(OSError):
        told = re.findall(r"^(?:model name|flags|Features|CPU part)\s*:.*$", Path("/proc/cpuinfo").read_text(), re.M)
        return "\n".join(sorted(set(told)))
    return platform.machine() + platform.processor()


def doctor() -> list[tuple[str, str]]:
    """(what, found) rows for `raytwin doctor`: versions, processor, cache, how each libLLVM fared, the choice."""
    model = re.search(r"model name\s*: (.*)", _processor())
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    rows = [*versions().items(), ("processor", model[1] if model else "?")]
    rows += [("cores", str(cores)), ("cache", str(cache_folder()))]
    settings = {"RAYTWIN_VARIANT": os.environ.get("RAYTWIN_VARIANT"), LIBRARY: USERS_LLVM}
    rows += [(name, value) for name, value in settings.items() if value]
    try:
        rows += [(f"tried {t.path}", t.why) for t in chosen().tried]
        backend = activate()
    except MachineError as error:
        return [*rows, ("backend", f"none: {error}")]
    return [*rows, ("backend", ", ".join(part for part in (backend.variant, backend.libllvm) if part))]
