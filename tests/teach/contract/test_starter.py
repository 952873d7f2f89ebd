"""The file that students start from."""

import inspect
import subprocess
import sys

import pytest
from program import raytwin
from starter_submissions import PLAIN

from raytwin.teach.contract.stage_table import CONTRACT, LESSONS
from raytwin.teach.contract.starter import starter
from raytwin.teach.contract.submission import load


def test_the_starter_has_every_function_that_is_asked_for_with_its_docstring(tmp_path):
    path = tmp_path / "mine.py"
    assert raytwin("grade", "starter", "-o", path).returncode == 0
    made: dict = {"__name__": "mine"}
    exec(compile(path.read_text(), "mine.py", "exec"), made)
    assert "sample_cone" not in made
    assert "`python mine.py`" in made["__doc__"]
    exec(starter(stages=[*LESSONS]), made)
    for name, stage in LESSONS.items():
        assert f"{name}{inspect.signature(made[name])}" == stage.signature
        assert made[name].__doc__
        with pytest.raises(NotImplementedError):
            made[name](*stage.cases(0)[0].args)
    assert max(map(len, path.read_text().splitlines())) <= 120
    exec(PLAIN, other := {})
    scene = CONTRACT["render"].cases(0)[-2].args[0]
    for plane in scene["planes"]:  # the worked example is correct
        asked = *other["camera_rays"](scene), plane["center"], plane["half_u"], plane["half_v"]
        assert made["intersect_plane"](*asked) == pytest.approx(other["intersect_plane"](*asked))


@pytest.mark.nightly
def test_a_starter_that_is_filled_in_checks_itself_as_it_is_run(tmp_path):
    """As a student does: one function written, one written wrong, the others as they were."""
    text = starter()
    head, tail = text.split("def shade(")
    doc, rest = tail.split("    raise NotImplementedError\n", 1)
    body = "    return albedo * (np.maximum(0, normals @ to_light)[:, None] * irradiance + sky)\n"
    rest = rest.replace("\nif __name__", "\nhit_points = lambda scene: None\n\nif __name__")  # has no name of its own
    (tmp_path / "tracer.py").write_text(f"{head}def shade({doc}{body}{rest}")
    run = subprocess.run([sys.executable, tmp_path / "tracer.py"], capture_output=True, text=True)
    assert run.returncode == 1, run.stderr
    lines = run.stdout.splitlines()
    assert len(lines) == 7
    assert "pi is missing in `return albedo * (np.maximum(0, normals @ to_light)[:, None]" in lines[4]
    assert lines[3].startswith("FAIL  shade: the sun's part is π times too bright")
    assert lines[0] == "FAIL  back_project: it is not written yet"
    assert lines[5].startswith("FAIL  hit_points: it returned None")
    assert list(load(tmp_path / "tracer.py").stages) == ["shade", "hit_points"]
