"""Which libLLVM is taken, and what is said where none works."""

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
    for name in ("RAYTWIN_VARIANT", "DRJIT_LIBLLVM_PATH"):
        monkeypatch.setenv(name, "")  # so that what a test leaves in it is undone, even if it was not set before
        monkeypatch.delenv(name)
    for name, value in {"USERS_LLVM": None, "_chosen": {}, "_current": None}.items():
        monkeypatch.setattr(backend, name, value)
    monkeypatch.setattr(backend, "_drjit_is_imported", lambda: False)


@pytest.fixture
def damaged(tmp_path) -> str:
    """The path of a file that is no library."""
    (tmp_path / "libLLVM.so").write_text("this is no library")
    return str(tmp_path / "libLLVM.so")


def test_without_any_llvm_there_is_no_variant_and_dr_jit_takes_no_library_on_its_own(monkeypatch):
    monkeypatch.setattr(backend, "llvm_candidates", list)
    found = backend.chosen()
    assert (found.variant, found.libllvm, found.tried) == (None, None, ())
    assert os.environ["DRJIT_LIBLLVM_PATH"] == os.devnull
    with pytest.raises(MachineError, match=r"raytwin\[llvm\].*no libLLVM at all"):
        backend.activate("llvm_ad_rgb")


def test_a_wrong_path_falls_on_to_the_next_which_is_taken_and_stays(monkeypatch, tmp_path, damaged):
    works = backend.find_backend().libllvm
    if works is None:
        pytest.skip("no libLLVM works here")
    for memory in tmp_path.glob("backend-*.json"):
        memory.unlink()
    monkeypatch.setattr(backend, "llvm_candidates", lambda: [str(tmp_path / "none.so"), damaged, works])
    found = backend.activate("llvm_ad_rgb")
    assert [t.ok for t in found.tried] == [False, False, True]
    assert found.tried[0].why == "no such file"
    assert "LLVM" in found.tried[1].why
    assert backend.activate() == found
    assert (found.libllvm, found.variant) == (works, "llvm_ad_rgb")
    if works != backend.OWN_CHOICE:
        assert os.environ["DRJIT_LIBLLVM_PATH"] == works


def test_the_answer_is_remembered_until_its_file_is_damaged_or_a_candidate_is_new(monkeypatch, tmp_path, damaged):
    probed, candidates = [], [damaged]
    answer = backend.Tried(damaged, True, "renders")
    monkeypatch.setattr(backend, "probe", lambda variant, path: probed.append(path) or answer)
    monkeypatch.setattr(backend, "llvm_candidates", lambda: candidates)
    for expected in (1, 1):
        assert backend.find_backend().libllvm == damaged
        assert len(probed) == expected
    (memory,) = tmp_path.glob("backend-*.json")
    memory.write_text('{"variant": 3')
    assert backend.find_backend().libllvm == damaged
    assert len(probed) == 2
    candidates.append(str(tmp_path / "new.so"))
    backend.find_backend()
    assert len(probed) == 3


def drawn(**found: float) -> str:
    """The source of a probe that draws this instead of a sphere."""
    return f"print({json.dumps(json.dumps({'depth': 3.0, 'lit': 1.0, 'light': 0.125, 'llvm': '99'} | found))})"


RENDERS = "renders (LLVM 99)"

PROBES = [
    ("import time; time.sleep(60)", "no picture after 1 s"),
    ("print('nan')", "no output"),
    ("import os, sys; print('LLVM ERROR: Cannot select: fmaximum', file=sys.stderr); os.abort()",
     "aborts the process (signal 6): LLVM ERROR: Cannot select: fmaximum"),
    (drawn(depth=3 + 0.9e-3), RENDERS), (drawn(depth=3 - 1.1e-3), "a wrong picture"),
    (drawn(lit=1 - 1 / 4096), "a wrong picture"), (drawn(light=0.125 + 4.9e-3), RENDERS),
    (drawn(light=0.125 - 5.1e-3), "a wrong picture"), (drawn(light=math.nan), "a wrong picture"),
]  # fmt: skip


def test_a_candidate_that_hangs_aborts_or_draws_more_than_noise_wrong_is_passed_over_and_asked_again(
    monkeypatch, tmp_path, subtests
):
    for i, (source, why) in enumerate(PROBES):
        with subtests.test(why):
            script = tmp_path / f"{i}.py"
            script.write_text(source)
            monkeypatch.setattr(backend, "PROBE", script)
            monkeypatch.setattr(backend, "PROBE_SECONDS", 1 if "sleep" in source else 60)
            monkeypatch.setattr(backend, "llvm_candidates", lambda script=script: [str(script)])
            found, works = backend.find_backend(), why == RENDERS
            assert why in found.tried[0].why
            assert (found.variant == "llvm_ad_rgb") == found.tried[0].ok == works
            assert len([*tmp_path.glob("backend-*.json")]) == works  # what works is remembered
            for memory in tmp_path.glob("backend-*.json"):
                memory.unlink()


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
    monkeypatch.setattr(backend, "probe", lambda variant, path: backend.Tried(path, False, "no device"))
    with pytest.raises(MachineError, match=r"an NVIDIA GPU.*no device"):
        backend.activate("cuda_ad_rgb")
    assert "DRJIT_LIBLLVM_PATH" not in os.environ  # a missing GPU says nothing about LLVM


def test_doctor_tells_versions_candidates_and_choice(monkeypatch):
    monkeypatch.setattr(backend, "USERS_LLVM", "/nowhere/libLLVM.so")
    rows = dict(backend.doctor())
    assert {"python", "mitsuba", "drjit", "cores", "cache", "backend"} <= rows.keys()
    assert rows["tried /nowhere/libLLVM.so"] == "no such file"
    monkeypatch.setenv("RAYTWIN_VARIANT", "nonsense")
    assert "nonsense" in dict(backend.doctor())["backend"]


def test_dr_jit_imported_without_any_library_is_an_error_of_one_line(damaged):
    """Before that, importing the twin has imported neither of them."""
    code = "import sys, raytwin.twin; assert not {'mitsuba', 'drjit'} & {*sys.modules}; import drjit; "
    environment = os.environ | {"DRJIT_LIBLLVM_PATH": damaged}
    run = subprocess.run([sys.executable, "-c", code + "raytwin.twin.activate()"],
                         capture_output=True, text=True, env=environment)  # fmt: skip
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
