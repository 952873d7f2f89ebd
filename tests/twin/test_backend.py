import json
import math
import os
import subprocess
import sys

import pytest

from raytwin.errors import MachineError
from raytwin.twin import backend


@pytest.fixture(autouse=True)
def fresh(monkeypatch, tmp_path):
    """A process that has chosen nothing yet, with an empty memory and no wishes."""
    monkeypatch.setenv("RAYTWIN_CACHE", str(tmp_path))
    for name in ("RAYTWIN_VARIANT", "RAYTWIN_NO_LLVM", "DRJIT_LIBLLVM_PATH"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(backend, "USERS_LLVM", None)
    monkeypatch.setattr(backend, "_chosen", {})
    monkeypatch.setattr(backend, "_current", None)
    monkeypatch.setattr(backend, "_drjit_is_imported", lambda: False)


@pytest.fixture
def llvm() -> str:
    found = backend.find_backend()
    if found.libllvm is None:
        pytest.skip("no libLLVM works here")
    return found.libllvm


def test_without_any_llvm_there_is_no_variant_and_dr_jit_takes_no_library_on_its_own(monkeypatch):
    monkeypatch.setenv("RAYTWIN_NO_LLVM", "1")
    found = backend.chosen()
    assert (found.variant, found.libllvm, found.tried) == (None, None, ())
    assert os.environ["DRJIT_LIBLLVM_PATH"] == os.devnull
    with pytest.raises(MachineError, match=r"raytwin\[llvm\].*no libLLVM at all"):
        backend.activate("llvm_ad_rgb")


def test_a_wrong_path_falls_on_to_the_next_with_a_reason(monkeypatch, tmp_path, llvm):
    """The next is a library that works, so that only the answer to the wrong one is in question."""
    text = tmp_path / "libLLVM.so"
    text.write_text("this is no library")
    monkeypatch.setattr(backend, "llvm_candidates", lambda: [str(tmp_path / "none.so"), str(text), llvm])
    found = backend.find_backend()
    assert [t.ok for t in found.tried] == [False, False, True]
    assert found.tried[0].why == "no such file"
    assert "LLVM" in found.tried[1].why
    assert found.libllvm == llvm


def test_the_answer_is_remembered_until_its_file_is_damaged_or_a_candidate_is_new(monkeypatch, tmp_path):
    library, probed = tmp_path / "libLLVM.so.19", []

    def probe(variant: str, path: str) -> backend.Tried:
        probed.append(path)
        return backend.Tried(path, True, "renders", "19.1")

    library.touch()
    candidates = [str(library)]
    monkeypatch.setattr(backend, "probe", probe)
    monkeypatch.setattr(backend, "llvm_candidates", lambda: candidates)
    for expected in (1, 1):
        assert backend.find_backend().libllvm == str(library)
        assert len(probed) == expected
    (memory,) = tmp_path.glob("backend-*.json")
    memory.write_text('{"variant": 3')
    assert backend.find_backend().libllvm == str(library)
    assert len(probed) == 2
    candidates.append(str(tmp_path / "new.so"))
    backend.find_backend()
    assert len(probed) == 3


def drawn(**found: float) -> str:
    """The source of a probe that draws this instead of a sphere."""
    return f"print({json.dumps(json.dumps({'depth': 3.0, 'lit': 1.0, 'light': 0.125, 'llvm': '99'} | found))})"


PROBES = [
    ("import time; time.sleep(60)", "no picture after 1 s"),
    ("print('nan')", "no output"),
    ("import os, sys; print('LLVM ERROR: Cannot select: fmaximum', file=sys.stderr); os.abort()",
     "aborts the process (signal 6): LLVM ERROR: Cannot select: fmaximum"),
    (drawn(depth=3 + 0.9e-3), "renders"), (drawn(depth=3 - 1.1e-3), "a wrong picture"),
    (drawn(lit=1 - 1 / 4096), "a wrong picture"), (drawn(light=0.125 + 4.9e-3), "renders"),
    (drawn(light=0.125 - 5.1e-3), "a wrong picture"), (drawn(light=math.nan), "a wrong picture"),
]  # fmt: skip


def test_a_candidate_that_hangs_aborts_or_draws_more_than_noise_wrong_is_passed_over_and_asked_again(
    monkeypatch, tmp_path, subtests
):
    probed, probe = [], backend.probe
    monkeypatch.setattr(backend, "probe", lambda *a: probed.append(a) or probe(*a))
    for i, (source, why) in enumerate(PROBES):
        with subtests.test(why):
            script = tmp_path / f"{i}.py"
            script.write_text(source)
            monkeypatch.setattr(backend, "PROBE", script)
            monkeypatch.setattr(backend, "PROBE_SECONDS", 1 if "sleep" in source else 60)
            monkeypatch.setattr(backend, "llvm_candidates", lambda script=script: [str(script)])
            probed.clear()
            found, again = backend.find_backend(), backend.find_backend()
            assert why in found.tried[0].why
            assert (found.variant == "llvm_ad_rgb") == found.tried[0].ok == (why == "renders")
            assert len(probed) == (1 if found.tried[0].ok else 2)  # what works is remembered
            assert again.variant == found.variant


def test_a_variant_can_be_forced_and_stays(llvm):
    assert backend.activate("llvm_ad_rgb").libllvm == llvm
    assert backend.activate().variant == "llvm_ad_rgb"
    if llvm != backend.OWN_CHOICE:
        assert os.environ["DRJIT_LIBLLVM_PATH"] == llvm


def test_a_variant_that_is_no_choice_is_named_with_what_to_use(monkeypatch):
    for wanted, said in (
        ("scalar_rgb", r"removed in 0\.2\.0\. Use llvm_ad_rgb"),
        ("llvm_spectral", "expected llvm_ad_rgb.*got llvm_spectral"),
    ):
        with pytest.raises(MachineError, match=f"variant.*{said}"):
            backend.activate(wanted)
        monkeypatch.setenv("RAYTWIN_VARIANT", wanted)
        with pytest.raises(MachineError, match=f"RAYTWIN_VARIANT.*{said}"):
            backend.activate()


def test_cuda_is_used_only_when_asked_for():
    if backend.probe("cuda_ad_rgb", "cuda_ad_rgb").ok:
        assert backend.find_backend().variant != "cuda_ad_rgb"
    else:
        with pytest.raises(MachineError, match="NVIDIA"):
            backend.activate("cuda_ad_rgb")


def test_doctor_tells_versions_candidates_and_choice(monkeypatch):
    monkeypatch.setattr(backend, "USERS_LLVM", "/nowhere/libLLVM.so")
    rows = dict(backend.doctor())
    assert {"python", "mitsuba", "drjit", "cores", "cache", "backend"} <= rows.keys()
    assert rows["tried /nowhere/libLLVM.so"] == "no such file"
    monkeypatch.setenv("RAYTWIN_VARIANT", "nonsense")
    assert "nonsense" in dict(backend.doctor())["backend"]


def test_importing_the_twin_imports_no_mitsuba():
    code = "import sys, raytwin.twin; print([m for m in ('mitsuba', 'drjit', 'cv2') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_dr_jit_imported_without_any_library_is_an_error_of_one_line(tmp_path):
    text = tmp_path / "libLLVM.so"
    text.write_text("this is no library")
    code = "import drjit; from raytwin.twin import activate; activate()"
    environment = os.environ | {"DRJIT_LIBLLVM_PATH": str(text)}
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert run.returncode == 1
    assert "MachineError: Mitsuba: expected a machine where it works" in run.stderr.splitlines()[-1]


def test_the_users_library_comes_first_then_the_one_that_pip_installs_then_dr_jits_own_choice(monkeypatch, tmp_path):
    (tmp_path / "lib").mkdir()
    for name in ("libLLVM.so.19.1", "libLLVM.so.23.1", "libLLVMAnalysis.a"):
        (tmp_path / "lib" / name).touch()
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    monkeypatch.setattr(backend, "USERS_LLVM", "/mine/libLLVM.so")
    pip = str(tmp_path / "lib" / "libLLVM.so.23.1")
    assert backend.llvm_candidates() == ["/mine/libLLVM.so", pip, backend.OWN_CHOICE]
    monkeypatch.setattr(backend, "_drjit_is_imported", lambda: True)  # its choice is made
    assert backend.llvm_candidates() == [backend.OWN_CHOICE]
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/good/libLLVM.so")
    assert backend.llvm_candidates() == ["/good/libLLVM.so"]
    monkeypatch.setenv("RAYTWIN_NO_LLVM", "1")
    assert backend.llvm_candidates() == []
