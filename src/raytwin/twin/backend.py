"""Which Mitsuba variant works here: each libLLVM is tried in a child process, because a wrong one aborts the process.

Order: the user's DRJIT_LIBLLVM_PATH, the one that pip installs, Dr.Jit's own choice. The answer is remembered per
machine. Importing this module imports no Mitsuba.

Environment: RAYTWIN_VARIANT forces a variant, RAYTWIN_NO_LLVM=1 hides every libLLVM, RAYTWIN_CACHE moves the cache.
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
from typing import Any

import msgspec

from raytwin.errors import InputError, MachineError, missing_package
from raytwin.images.cache import cache_folder, installed
from raytwin.removed import SCALAR
from raytwin.scene.toml_json import write_json

LLVM, CUDA = VARIANTS = ("llvm_ad_rgb", "cuda_ad_rgb")
OWN_CHOICE = "Dr.Jit's own choice"
"""Stands for the libLLVM that Dr.Jit finds where DRJIT_LIBLLVM_PATH is not set."""
PROBE = Path(__file__).with_name("probe.py")
PROBE_SECONDS = 120
"""Seconds until a probe without a picture is given up; the first kernel compiles for several."""
PACKAGES = ("raytwin", "mitsuba", "drjit", "numpy", "opencv-contrib-python-headless", "pupil-apriltags")


class Tried(msgspec.Struct, frozen=True):
    """One candidate: the library's path (or the variant's name, where it needs none) and how its probe went."""

    path: str
    ok: bool
    why: str


class Backend(msgspec.Struct, frozen=True):
    """What renders: Mitsuba's variant, None where none works, the libLLVM behind it, and how the choice was made.

    `versions`: of the packages that matter.
    """

    variant: str | None
    libllvm: str | None
    llvm_version: str | None
    tried: tuple[Tried, ...]
    versions: dict[str, str]


# Of this process, as Mitsuba's variant is: the choices made, and the current one.
_chosen: dict[tuple[str | None, bool, str | None], Backend] = {}
_current: Backend | None = None
_set_here: str | None = None  # the DRJIT_LIBLLVM_PATH that is ours and not the user's


def activate(variant: str | None = None) -> Backend:
    """Choose a backend that works here, make it Mitsuba's current variant, and say which it is.

    `variant` (or RAYTWIN_VARIANT) forces one of VARIANTS. Without either: the one that is active already, else
    `llvm_ad_rgb`. Cheap to call again, also for another variant. Raises MachineError where it does not work.
    """
    global _current
    backend = chosen(variant)
    if backend.variant is None and find_spec("mitsuba"):
        forced = variant or os.environ.get("RAYTWIN_VARIANT") or LLVM
        what = "; ".join(f"{t.path}: {t.why}" for t in backend.tried) or "no libLLVM at all"
        remedy = "pip install 'raytwin[llvm]' or DRJIT_LIBLLVM_PATH" if forced == LLVM else "an NVIDIA GPU"
        raise MachineError(f"variant {forced}", f"a machine where it works (needs {remedy})", what)
    try:
        import mitsuba as mi
    except ModuleNotFoundError as error:
        raise missing_package("the twin", error) from None
    _current = backend
    try:
        mi.set_variant(backend.variant)
    except ImportError as error:  # Dr.Jit was imported before, and found no libLLVM then
        needed = "a libLLVM when Dr.Jit was imported: import it after raytwin, or set DRJIT_LIBLLVM_PATH"
        raise MachineError(f"variant {backend.variant}", needed, error) from None
    package = str(Path(mi.__file__).parent)
    if str(mi.file_resolver()[0]) != package:  # else `plugins` of the current folder would stand in for Mitsuba's own
        mi.file_resolver().prepend(package)
    return backend


def chosen(variant: str | None = None) -> Backend:
    """What `activate` would make current, and all that Dr.Jit's own arrays need: Mitsuba is not imported.

    They use the same libLLVM if Dr.Jit is imported after this; where it was imported before, its library is the only
    one that this process can have.
    """
    global _set_here
    forced = variant or os.environ.get("RAYTWIN_VARIANT") or None
    where = "variant" if variant else "RAYTWIN_VARIANT"
    if forced and forced.startswith("scalar"):
        raise MachineError(where, " or ".join(VARIANTS), f"{forced}: {SCALAR}")
    if forced not in (None, *VARIANTS):
        raise MachineError(where, " or ".join(VARIANTS), forced)
    key = (forced, _llvm_hidden(), _users_llvm())
    backend = (_current if forced is None else None) or _chosen.get(key) or find_backend(forced)
    _chosen[key] = backend
    if backend.variant is None:
        os.environ["DRJIT_LIBLLVM_PATH"] = _set_here = os.devnull  # or Dr.Jit takes its own choice, and may abort
    elif backend.libllvm not in (None, OWN_CHOICE):
        os.environ["DRJIT_LIBLLVM_PATH"] = _set_here = backend.libllvm
    return backend


def find_backend(forced: str | None = None) -> Backend:
    """The backend that `activate` would make current: remembered on this machine, or found by probing."""
    if find_spec("mitsuba") is None:  # nothing to try, and nothing to remember: it may be installed tomorrow
        return Backend(forced, None, None, (), versions())
    candidates = [CUDA] if forced == CUDA else llvm_candidates()
    memory = cache_folder() / f"backend-{_machine(candidates)}.json"
    with contextlib.suppress(OSError, msgspec.MsgspecError):
        known = msgspec.json.decode(memory.read_bytes(), type=Backend)
        if known.variant in VARIANTS and known.libllvm in (None, *candidates):
            return known
    backend = Backend(None, None, None, (), versions())
    for path in candidates:
        library = None if path == CUDA else path
        outcome, version = probe(forced or LLVM, library)
        backend = msgspec.structs.replace(backend, tried=(*backend.tried, outcome))
        if outcome.ok:  # else the next process asks again: a probe may just have met a busy machine
            backend = msgspec.structs.replace(backend, variant=forced or LLVM, libllvm=library, llvm_version=version)
            with contextlib.suppress(InputError):  # a cache that cannot be written costs a probe next time alone
                write_json(memory, backend)
            break
    return backend


def probe(variant: str, libllvm: str | None = None) -> tuple[Tried, str | None]:
    """Render a sphere in a child process: whether it came out correctly, why not, and the version of LLVM."""
    name = libllvm or variant
    environment = {key: value for key, value in os.environ.items() if key != "DRJIT_LIBLLVM_PATH"}
    if libllvm and libllvm != OWN_CHOICE:
        if not Path(libllvm).is_file():
            return Tried(name, False, "no such file"), None
        environment["DRJIT_LIBLLVM_PATH"] = libllvm
    try:
        # -P: this folder's modules must not hide anyone else's.
        child = subprocess.run(
            [sys.executable, "-P", str(PROBE), variant],
            env=environment, capture_output=True, text=True, errors="replace", timeout=PROBE_SECONDS,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return Tried(name, False, f"no picture after {PROBE_SECONDS} s"), None
    except OSError as error:  # no Python that can be started: embedded in another program
        return Tried(name, False, str(error)), None
    try:
        found = json.loads(child.stdout.strip().splitlines()[-1])
        version = ".".join(map(str, found["llvm"])) if found["llvm"] else None
        right = abs(found["depth"] - 3) < 1e-3 and found["lit"] == 1 and abs(found["light"] - 0.125) < 5e-3
    except (IndexError, ValueError, KeyError, TypeError):
        return Tried(name, False, _last_words(child.returncode, child.stderr)), None
    if child.returncode != 0 or not right:
        return Tried(name, False, f"a wrong picture: {found}" if child.returncode == 0 else "crashed at exit"), version
    return Tried(name, True, f"renders (LLVM {version})" if version else "renders"), version


def _last_words(code: int, text: str) -> str:
    """Why a child died: Dr.Jit's or LLVM's complaint where there is one, else the signal or the last line."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    telling = [line for line in lines if re.search(r"too old|cannot select|failed|not (be )?found|error", line, re.I)]
    what = (telling or lines[-1:] or ["no output"])[0][:160]
    return f"aborts the process (signal {-code}): {what}" if code < 0 else what


def llvm_candidates() -> list[str]:
    """The libLLVMs worth trying, best first; once Dr.Jit has loaded one, that alone."""
    if _llvm_hidden():
        return []
    if loaded := loaded_llvm():
        return [loaded]
    prefix = Path(sys.prefix)
    by_pip = [
        *prefix.glob("lib/libLLVM.so.*"),
        *prefix.glob("lib/libLLVM.dylib"),
        *prefix.glob("Library/bin/LLVM-C.dll"),
    ]
    return [*filter(None, [_users_llvm()]), *sorted(map(str, by_pip), reverse=True)[:1], OWN_CHOICE]


def loaded_llvm() -> str | None:
    """The libLLVM that this process has loaded with Dr.Jit, for good: another can be had in another process only."""
    if "drjit" in sys.modules:
        with contextlib.suppress(OSError):  # Linux alone says so
            mapped = (line.split(maxsplit=5) for line in Path("/proc/self/maps").read_text().splitlines())
            return next((m[5] for m in mapped if len(m) == 6 and Path(m[5]).name.startswith("libLLVM")), None)
    return None


def _llvm_hidden() -> bool:
    return os.environ.get("RAYTWIN_NO_LLVM", "0") not in ("", "0")


def _users_llvm() -> str | None:
    path = os.environ.get("DRJIT_LIBLLVM_PATH") or None
    return path if path != _set_here else None


def versions() -> dict[str, str]:
    """Python's version and those of the packages that decide what a render looks like."""
    return installed(PACKAGES)


def made_with(twin: str, variant: str | None) -> dict[str, str]:
    """What renders, as every provenance begins: versions, and Mitsuba's variant."""
    known = versions()
    own = {"raytwin": known.get("raytwin", "?"), "twin": twin}
    return own | {"mitsuba": known["mitsuba"], "drjit": known["drjit"], "variant": str(variant)}


def _machine(candidates: list[str]) -> str:
    """A hash of everything that could change the answer: Python, packages, processor, candidates and their dates."""
    facts: list[Any] = [sys.prefix, versions(), _processor(), PROBE.read_text()]
    for path in candidates:
        with contextlib.suppress(OSError):
            known = Path(path).stat()
            facts.append((os.path.realpath(path), known.st_mtime_ns, known.st_size, known.st_ino))
    return hashlib.sha256(repr((candidates, facts)).encode()).hexdigest()[:20]


def _processor() -> str:
    """Model and features: what LLVM compiles for, and why a library that works elsewhere may abort here."""
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        wanted = re.compile(r"(model name|flags|Features|CPU part)\s*:")
        return "\n".join(sorted({line for line in lines if wanted.match(line)}))
    return platform.machine() + platform.processor()


def doctor() -> list[tuple[str, str]]:
    """(what, found) rows for `raytwin doctor`: versions, processor, cache, how each libLLVM fared, the choice."""
    rows = [*versions().items()]
    rows.append(("processor", next((s.split(":")[1].strip() for s in _processor().splitlines() if "model" in s), "?")))
    rows.append(("cores", str(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count())))
    rows.append(("cache", str(cache_folder())))
    settings = ("RAYTWIN_VARIANT", "RAYTWIN_NO_LLVM", "DRJIT_LIBLLVM_PATH")
    rows += [(name, os.environ[name]) for name in settings if os.environ.get(name) not in (None, "", _set_here)]
    try:
        backend = chosen()
        rows += [(f"tried {t.path}", t.why) for t in backend.tried]
        backend = activate()
    except MachineError as error:
        return [*rows, ("backend", f"none: {error}")]
    library = f", {backend.libllvm} (LLVM {backend.llvm_version})" if backend.libllvm else ""
    rows.append(("backend", f"{backend.variant}{library}"))
    return rows
