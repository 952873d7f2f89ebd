"""Which Mitsuba variant works here: every libLLVM is tried in a child process, because a wrong one aborts the process.

Order: the user's DRJIT_LIBLLVM_PATH, the one that pip installs, the system's, newest first; then `scalar_rgb`, which
needs none. The answer is remembered per machine. Importing this module imports no Mitsuba.

Environment: RAYTWIN_VARIANT forces a variant, RAYTWIN_NO_LLVM=1 hides every libLLVM, RAYTWIN_CACHE moves the cache.
"""

import contextlib
import hashlib
import json
import os
import platform
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import msgspec

from raytwin import files
from raytwin.errors import InputError, MachineError, missing_package

SCALAR = "scalar_rgb"
VARIANTS = ("llvm_ad_rgb", SCALAR, "cuda_ad_rgb")
PROBE = Path(__file__).with_name("probe.py")
PROBE_SECONDS = 120
"""Seconds until a probe without a picture is given up; the first kernel compiles for several."""
PACKAGES = ("raytwin", "mitsuba", "drjit", "numpy", "opencv-contrib-python-headless")
NO_LIBRARY = os.devnull
"""For DRJIT_LIBLLVM_PATH, where none works: left to itself, Dr.Jit takes one of the system's, and may abort with it."""
LLVM_FOLDERS = (
    "/usr/lib/llvm*/lib",
    "/usr/lib/*-linux-gnu",
    "/usr/lib64",
    "/usr/lib64/llvm*/lib*",
    "/usr/lib",
    "/usr/local/lib",
    "/opt/homebrew/opt/llvm*/lib",
    "/usr/local/opt/llvm*/lib",
    "C:/Program Files/LLVM/bin",
)


class Tried(msgspec.Struct, frozen=True):
    """One candidate: the library's path (or the variant's name, where it needs none) and how its probe went.

    `settled`: another try would end the same way; a probe that timed out may just have met a busy machine.
    """

    path: str
    ok: bool
    why: str
    settled: bool = True


class Backend(msgspec.Struct, frozen=True):
    """What renders: Mitsuba's variant, the libLLVM behind it, and how the choice was made.

    `seconds`: what this choice took (a remembered one takes next to nothing); `versions`: of the packages that matter.
    """

    variant: str
    libllvm: str | None
    llvm_version: str | None
    tried: tuple[Tried, ...]
    seconds: float
    versions: dict[str, str]


# Of this process, as Mitsuba's variant is: the choices made, and the current one.
_chosen: dict[tuple[str | None, bool, str | None], Backend] = {}
_current: Backend | None = None
_set_here: str | None = None  # the DRJIT_LIBLLVM_PATH that is ours and not the user's


def activate(variant: str | None = None) -> Backend:
    """Choose a backend that works here, make it Mitsuba's current variant, and say which it is.

    `variant` (or RAYTWIN_VARIANT) forces one of VARIANTS. Without either: the one that is active already, else
    `llvm_ad_rgb` where a libLLVM works, else `scalar_rgb`. Cheap to call again, also for another variant. Raises
    MachineError where a forced variant is unknown or does not work.
    """
    global _current
    backend = chosen(variant)
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
    package = Path(mi.__file__).parent
    if str(mi.file_resolver()[0]) != str(
        package
    ):  # else `plugins` of the current folder would stand in for Mitsuba's own
        mi.file_resolver().prepend(str(package))
    return backend


def chosen(variant: str | None = None) -> Backend:
    """What `activate` would make current, and all that Dr.Jit's own arrays need: Mitsuba is not imported.

    They use the same libLLVM if Dr.Jit is imported after this; where it was imported before, its library is the only
    one that this process can have.
    """
    global _set_here
    forced = variant or os.environ.get("RAYTWIN_VARIANT") or None
    if forced not in (None, *VARIANTS):
        raise MachineError("variant" if variant else "RAYTWIN_VARIANT", " or ".join(VARIANTS), forced)
    key = (forced, _llvm_hidden(), _users_llvm())
    backend = (_current if forced is None else None) or _chosen.get(key) or choose(forced)
    _chosen[key] = backend
    # Dr.Jit loads a libLLVM when it is imported, whatever the variant: let it be one that works.
    library = backend.libllvm
    if library is None and "drjit" not in sys.modules:
        library = choose().libllvm or NO_LIBRARY
    if library:
        os.environ["DRJIT_LIBLLVM_PATH"] = _set_here = library
    if library == NO_LIBRARY:
        with _no_words(), contextlib.suppress(ModuleNotFoundError):
            import drjit  # noqa: F401
    return backend


@contextlib.contextmanager
def _no_words() -> Iterator[None]:
    """Silence standard error below Python's level: there Dr.Jit reports a missing library, which is known already."""
    stderr, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(nowhere)


def choose(forced: str | None = None) -> Backend:
    """The backend that `activate` would make current: remembered on this machine, or found by probing."""
    start = time.perf_counter()
    if find_spec("mitsuba") is None:  # nothing to try, and nothing to remember: it may be installed tomorrow
        return Backend(forced or SCALAR, None, None, (), 0.0, versions())
    paths = llvm_candidates() if forced in (None, "llvm_ad_rgb") else []
    memory = files.cache_folder() / f"backend-{_machine(forced, paths)}.json"
    with contextlib.suppress(OSError, msgspec.MsgspecError):
        known = msgspec.json.decode(memory.read_bytes(), type=Backend)
        if known.variant not in VARIANTS or known.libllvm not in (None, *paths):
            raise msgspec.ValidationError("a backend that was not found here")
        return msgspec.structs.replace(known, seconds=time.perf_counter() - start)
    backend = _probe_all(forced, paths, start)
    if not all(t.settled for t in backend.tried):
        return backend  # asked again by the next process
    with contextlib.suppress(InputError):  # a cache that cannot be written costs a probe next time, nothing else
        files.write_json(memory, backend)
    return backend


def _probe_all(forced: str | None, paths: list[str], start: float) -> Backend:
    tried: list[Tried] = []
    found: tuple[str, str | None, str | None] = (SCALAR, None, None)
    if forced != SCALAR:
        wanted = forced or "llvm_ad_rgb"
        candidates: Sequence[str | None] = paths if wanted == "llvm_ad_rgb" else [None]
        for path in candidates:
            outcome, version = probe(wanted, path)
            tried.append(outcome)
            if outcome.ok:
                found = (wanted, path, version)
                break
        if forced is not None and found[0] != forced:
            what = "; ".join(f"{t.path}: {t.why}" for t in tried) or "no libLLVM at all"
            remedy = "pip install 'raytwin[llvm]' or DRJIT_LIBLLVM_PATH" if "llvm" in forced else "an NVIDIA GPU"
            needed = f"a machine where it works (needs {remedy}; {SCALAR} works everywhere)"
            raise MachineError(f"variant {forced}", needed, what)
    return Backend(*found, tuple(tried), time.perf_counter() - start, versions())


def probe(variant: str, libllvm: str | None = None) -> tuple[Tried, str | None]:
    """Render a sphere in a child process: whether it came out right, why not, and the version of LLVM."""
    name = libllvm or variant
    if libllvm and not Path(libllvm).is_file():
        return Tried(name, False, "no such file"), None
    environment = dict(os.environ) | ({"DRJIT_LIBLLVM_PATH": libllvm} if libllvm else {})
    try:
        # -P: this folder's modules must not hide anyone else's.
        child = subprocess.run(
            [sys.executable, "-P", str(PROBE), variant],
            env=environment, capture_output=True, text=True, errors="replace", timeout=PROBE_SECONDS,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return Tried(name, False, f"no picture after {PROBE_SECONDS} s", settled=False), None
    except OSError as error:
        return Tried(name, False, f"cannot start {sys.executable or 'Python'}: {error}", settled=False), None
    try:
        found = json.loads(child.stdout.strip().splitlines()[-1])
        version = ".".join(map(str, found["llvm"])) if found["llvm"] else None
        right = abs(found["depth"] - 3) < 1e-3 and found["lit"] == 1 and abs(found["light"] - 0.125) < 5e-3
    except (IndexError, ValueError, KeyError, TypeError):
        killed = child.returncode == -getattr(signal, "SIGKILL", 9)  # from outside, as where memory ends
        return Tried(name, False, _last_words(child.returncode, child.stderr), settled=not killed), None
    if child.returncode != 0 or not right:
        return Tried(name, False, f"a wrong picture: {found}" if child.returncode == 0 else "crashed at exit"), version
    return Tried(name, True, f"renders (LLVM {version})" if version else "renders"), version


def _last_words(code: int, text: str) -> str:
    """Why a child died: Dr.Jit's or LLVM's complaint where there is one, else the signal or the last line."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    telling = [line for line in lines if re.search(r"too old|cannot select|failed|not (be )?found|error", line, re.I)]
    what = (telling or lines[-1:] or ["no output"])[0][:160]
    return f"aborts the process (signal {-code}): {what}" if code < 0 else what


# ---------------------------------------------------------------------------------------------- candidates


def llvm_candidates() -> list[str]:
    """Paths of every libLLVM worth trying, best first, each library once; once Dr.Jit is imported, the one it has."""
    if _llvm_hidden():
        return []
    if loaded := loaded_llvm():
        return [loaded]
    found = [path] if (path := _users_llvm()) else []
    prefix = Path(sys.prefix)
    found += _newest_first([*prefix.glob("lib/libLLVM*"), *prefix.glob("Library/bin/LLVM-C.dll")])
    found += _newest_first(_system_llvm())
    unlike: dict[str, str] = {}
    for path in found:
        unlike.setdefault(os.path.realpath(path), path)
    return list(unlike.values())


def loaded_llvm() -> str | None:
    """The libLLVM that this process has loaded with Dr.Jit, for good: another can be had in another process only."""
    if "drjit" not in sys.modules:
        return None
    with contextlib.suppress(OSError):  # Linux alone says so
        mapped = (line.split(maxsplit=5) for line in Path("/proc/self/maps").read_text().splitlines())
        return next((m[5] for m in mapped if len(m) == 6 and Path(m[5]).name.startswith("libLLVM")), None)
    return None


def _llvm_hidden() -> bool:
    return os.environ.get("RAYTWIN_NO_LLVM", "0") not in ("", "0")


def _users_llvm() -> str | None:
    path = os.environ.get("DRJIT_LIBLLVM_PATH") or None
    return path if path != _set_here else None


def _system_llvm() -> Iterator[Path]:
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        listed = subprocess.run(["ldconfig", "-p"], capture_output=True, text=True, timeout=10).stdout
        yield from (Path(line.split("=> ")[1].strip()) for line in listed.splitlines() if "libLLVM" in line)
    for pattern in LLVM_FOLDERS:
        root, *rest = Path(pattern).parts
        with contextlib.suppress(OSError):
            for folder in Path(root).glob("/".join(rest)):
                yield from folder.glob("libLLVM*")
                yield from folder.glob("LLVM-C.dll")


def _newest_first(paths: list[Path] | Iterator[Path]) -> list[str]:
    """Shared libraries (not LTO, not static ones) by the version in their real name, newest first."""

    def version(path: str) -> tuple[int, ...]:
        return tuple(map(int, re.findall(r"\d+", Path(os.path.realpath(path)).name)))

    kind = re.compile(r"libLLVM([-.]\d+(\.\d+)*)?\.(so(\.\d+)*|dylib)$|LLVM-C\.dll$")
    return sorted({str(p) for p in paths if kind.search(p.name)}, key=lambda p: (version(p), p), reverse=True)


# ---------------------------------------------------------------------------------------------- what is remembered


def versions() -> dict[str, str]:
    """Python's version and those of the packages that decide what a render looks like."""
    return files.installed(PACKAGES)


def made_with(twin: str, variant: str) -> dict[str, str]:
    """What renders, as every provenance begins: versions, and Mitsuba's variant."""
    known = versions()
    own = {"raytwin": known.get("raytwin", "?"), "twin": twin}
    return own | {"mitsuba": known["mitsuba"], "drjit": known["drjit"], "variant": variant}


def _machine(forced: str | None, paths: list[str]) -> str:
    """A hash of everything that could change the answer: Python, packages, processor, candidates and their dates."""
    facts: list[Any] = [forced, sys.prefix, versions(), _processor(), PROBE.read_text()]
    for path in paths:
        try:
            known = Path(path).stat()
            facts.append((path, os.path.realpath(path), known.st_mtime_ns, known.st_size, known.st_ino))
        except OSError:
            facts.append((path, None, None))
    return hashlib.sha256(repr(facts).encode()).hexdigest()[:20]


def _processor() -> str:
    """Model and features: what LLVM compiles for, and why a library that works elsewhere may abort here."""
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return "\n".join(
            sorted({line for line in lines if re.match(r"(model name|flags|Features|CPU part)\s*:", line)})
        )
    return platform.machine() + platform.processor()


# ---------------------------------------------------------------------------------------------- doctor


def doctor() -> list[tuple[str, str]]:
    """(what, found) rows for `raytwin doctor`: versions, processor, cache, how each libLLVM fared, the choice."""
    rows = [*versions().items()]
    rows.append(("processor", next((s.split(":")[1].strip() for s in _processor().splitlines() if "model" in s), "?")))
    rows.append(("cores", str(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count())))
    rows.append(("cache", str(files.cache_folder())))
    settings = ("RAYTWIN_VARIANT", "RAYTWIN_NO_LLVM", "DRJIT_LIBLLVM_PATH")
    rows += [(name, os.environ[name]) for name in settings if os.environ.get(name) not in (None, "", _set_here)]
    candidates = llvm_candidates()
    try:
        backend = activate()
    except MachineError as error:
        return [*rows, ("backend", f"none: {error}")]
    tried = {t.path: t.why for t in backend.tried}
    rows += [(f"tried {path}", why) for path, why in tried.items()]
    rows += [(f"found {path}", "not needed") for path in candidates if path not in tried]
    library = f", {backend.libllvm} (LLVM {backend.llvm_version})" if backend.libllvm else ""
    slow = "" if backend.libllvm or "cuda" in backend.variant else ": works everywhere, tens of times slower"
    rows.append(("backend", f"{backend.variant}{library}{slow}, chosen in {backend.seconds:.2f} s"))
    return rows
