"""What a student cannot know of the sandbox is explained where it is why a function fails."""

import pytest

from raytwin.teach.sandbox.importable import ALWAYS, importable
from raytwin.teach.sandbox.sandbox import Code, Sandbox

WORKS = """
import os, tempfile
import numpy as np
from pathlib import Path
import helper

def saves_a_frame():
    np.save("frame.npy", np.ones(3))
    with open("frame.txt", "w") as file: file.write("mine")
    os.makedirs("out/frames")
    with tempfile.TemporaryDirectory() as folder: Path(folder, "a").write_text("b")
    Path("old.txt").write_text("x")
    os.replace("old.txt", "new.txt")
    return np.load("frame.npy")

def reads_its_own_file(): return np.array(float(Path(__file__).with_name("data.txt").read_text()))
def reads_its_file_by_name(): return np.array(float(open("data.txt").read()))
def saves_beside_the_file(): Path(__file__).with_name("frame.txt").write_text("mine")
def saves_elsewhere(): open("/tmp/frame.txt", "w")
def reads_the_machines(): return open("/etc/passwd").read()
def connects(): import socket; socket.socket()
def imports_another():
    import mitsuba
def misses(): open("no-such-file.txt")
def imports_scipy():
    import scipy.optimize
    return 1.0
def asks_what_is_there():
    import importlib.util
    return np.array([importlib.util.find_spec(n) is not None for n in ("mitsuba", "scipy", "PIL", "helper", "json")])
"""
NAMES = tuple(line.split("(")[0][4:] for line in WORKS.splitlines() if line.startswith("def "))


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    folder = tmp_path_factory.mktemp("handed-in")
    (folder / "tracer.py").write_text(WORKS)
    (folder / "helper.py").write_text("x = 1")
    (folder / "data.txt").write_text("7")
    with Sandbox(Code(source=WORKS, file="tracer.py", folder=folder, asked=NAMES)) as child:
        assert not child.problem.problem, child.problem
        return {name: child.call(name) for name in NAMES}


def test_what_a_student_may_do_works_and_what_not_is_explained_in_words(outcome):
    for name in ("saves_a_frame", "reads_its_own_file", "imports_scipy"):
        assert outcome[name].problem == "", name
    for name, said in (
        ("saves_beside_the_file", 'A submission writes to its working folder alone: a relative path, as "frame.png"'),
        ("saves_elsewhere", "writes to its working folder alone"),
        ("reads_the_machines", "It reads no files but its own"),
        ("reads_its_file_by_name", "Path(__file__).with_name(...) is a file beside yours"),
        ("connects", "The sandbox allows no network"),
        ("imports_another", "A submission may import the standard library, its own files, numpy, scipy."),
    ):
        assert outcome[name].sort == "error", name
        assert said in outcome[name].problem.splitlines()[0]
    assert outcome["misses"].problem.splitlines()[0].endswith("'no-such-file.txt'")
    assert outcome["asks_what_is_there"].arrays[0].tolist() == [False, True, False, True, True]


def test_what_a_rubric_names_can_be_imported_with_all_that_it_requires():
    source = "import PIL.Image, jinja2\ndef f(): return jinja2.Template('{{ x }}').render(x=1) == '1'"
    with Sandbox(Code(source=source, asked=("f",), packages=("Pillow>=1", "jinja2; python_version > '3'"))) as child:
        assert child.call("f").arrays[0] == 1, child.call("f").problem  # jinja2 requires markupsafe


def test_packages_that_give_the_same_module_stand_in_for_each_other_and_extras_are_not_followed():
    numpy_alone = importable(())
    assert set(ALWAYS) <= set(numpy_alone.modules)
    assert {"numpy", "numpy.libs"} <= set(numpy_alone.entries)
    assert "cv2" not in numpy_alone.modules
    assert "cv2" in importable(("opencv-python>=4.11",)).modules
    some = importable(("OpenCV_contrib.Python-headless[all]", "jinja2", "pytest", "not-installed"))
    assert {"cv2", "markupsafe"} <= set(some.modules)
    assert "hypothesis" not in some.modules  # pytest[dev]
    assert "not_installed" in some.entries
