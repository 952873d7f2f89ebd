"""A class is graded: each its verdict and points, whatever the others do; outputs that say so."""

import csv
import json
import os
import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import msgspec
import numpy as np
import pytest
import submitted_tracers as tracers

from raytwin import files
from raytwin.grade.class_run import collect, jobs_of, run
from raytwin.grade.result import Marked, Part, Result
from raytwin.grade.rubric import Exercise, Rubric, read_rubric
from raytwin.grade.submission_code import code_of
from raytwin.parallel import Workers, map_parallel
from raytwin.report import autograder_sites as sites
from raytwin.report import class_page as pages
from raytwin.tracer import trace

TESTS = str(Path(__file__).parents[1])

RUBRIC = """
title = "Six < seven"
seed = 5
follow_through = 1.0
hints = 0
[[exercises]]
stage = "intersect_sphere"
points = 10
[[exercises]]
stage = "shade"
points = 10
visibility = "hidden"
[[exercises]]
name = "image"
stage = "render"
scenes = ["single"]
drawn = 1
points = 20
credit = [[1e-1, 0.5], [10.0, 0.25]]
[speed]
of = "image"
bonus = 2
fast = 100.0
slow = 1000.0
[limits]
seconds = 3600
seconds_a_call = 3600
"""
HASTY = RUBRIC.replace("seconds = 3600\nseconds_a_call = 3600", "seconds = 60\nseconds_a_call = 5")
"""For the one who hangs: on a busy machine the others may take long."""


@pytest.fixture(scope="module")
def graded(tmp_path_factory):
    """(results by student, folder of outputs, jobs, rubric's path)"""
    folder = tmp_path_factory.mktemp("class")
    (folder / "rubric.toml").write_text(RUBRIC)
    (folder / "hasty.toml").write_text(HASTY)
    for name in ("", *(n for n in tracers.WRONG if n != "cached")):
        path = folder / ("hasty" if name == "hangs" else "in") / f"{name or 'right'}.py"
        files.write_text(path, tracers.tracer(name))
    files.write_text(folder / "in" / "<script>" / "tracer.py", "import helper\nrender = helper.render\n")
    files.write_text(folder / "in" / "<script>" / "helper.py", tracers.tracer("gamma"))
    files.write_text(folder / "in" / "empty.py", "")
    files.write_text(folder / "in" / "syntax.py", "def render(:")
    jobs = [*jobs_of(folder / "hasty", folder / "hasty.toml"), *jobs_of(folder / "in", folder / "rubric.toml")]
    results = run(jobs, folder / "out", Workers(1))
    rubric = read_rubric(folder / "rubric.toml")
    pages.write_class(results, rubric, folder / "out")
    return {r.student: r for r in results}, folder / "out", jobs, rubric


def image(graded, student: str):
    return graded[0][student].exercises[2]


def test_a_right_tracer_gets_all_points_and_the_bonus(graded):
    assert [e.status for e in graded[0]["right"].exercises] == ["pass"] * 3
    assert (graded[0]["right"].points, graded[0]["right"].of) == (42, 40)


@pytest.mark.parametrize(
    ("student", "status", "word"),
    [
        ("no shadows", "fail", "there are no cast shadows"),
        ("gamma", "fail", "the values are encoded for display (gamma)"),
        ("nan", "fail", "1 pixel is NaN or infinite, the first at (x=0, y=0)"),
        ("shape", "error", "is wanted"),
        ("raises", "error", "ValueError: <b>no</b>"),
        ("hangs", "limit", "not done after 5 s, asleep"),
        ("exits", "broken", "exit code 3"),
        ("empty", "missing", "render is not written"),
        ("syntax", "error", "SyntaxError"),
    ],
)
def test_each_mistake_has_its_verdict_and_its_reason(graded, student, status, word):
    assert image(graded, student).status == status
    assert any(word in text for text in image(graded, student).sentences)


PARTS = tracers.RIGHT.replace("def render", "def own")
"""A tracer without a function for the whole."""


@pytest.mark.parametrize(
    ("old", "new", "points", "said"),
    [
        ("", "", 20, "this is made of your back_project and intersect_sphere and shade, the rest is ours"),
        ("np.pi *", "1 *", 0, "the sun's part is π times too bright"),
        ("def shade", "def shade_", 0, "render is not written"),
        ("return t\n", "return t, t, t\n", 0, "intersect_sphere: it returned 3 arrays"),
        ("np.where(hit, disc, 0)", "np.where(hit, disc[:5], 0)", 0, "ValueError"),
        (
            "def own(scene):",
            "def render(scene):\n    raise NotImplementedError\ndef own(scene):",
            20,
            "is made of your",
        ),
    ],
)
def test_end_to_end_a_picture_is_made_of_the_parts_where_there_is_no_render(tmp_path, old, new, points, said):
    (tmp_path / "r.toml").write_text(
        'title = "t"\n[[exercises]]\nstage = "render"\nscenes = ["eclipse"]\npoints = 20\n'
    )
    (tmp_path / "a.py").write_text(PARTS.replace(old, new) if old else PARTS)
    (result,) = run(jobs_of(tmp_path / "a.py", tmp_path / "r.toml"), tmp_path / "out", Workers())
    assert result.points == points
    assert any(said in sentence for sentence in result.exercises[0].sentences), result.exercises[0].sentences


def test_a_cache_that_is_keyed_too_coarsely_shows(tmp_path):
    (tmp_path / "r.toml").write_text(
        'title = "t"\n[[exercises]]\nstage = "render"\nscenes = ["single", "wedge"]\nrung = "lambert"\npoints = 1\n'
    )
    (tmp_path / "a.py").write_text(tracers.tracer("cached"))
    (result,) = run(jobs_of(tmp_path / "a.py", tmp_path / "r.toml"), tmp_path / "out", Workers())
    assert sorted(p.passed for p in result.exercises[0].parts) == [False, True]


def test_seconds_are_those_of_drawn_scenes_since_a_named_one_may_be_stored(tmp_path):
    speed = '[speed]\nof = "image"\nbonus = 2\nfast = 0.2\nslow = 0.3\n'
    (tmp_path / "r.toml").write_text(
        'title = "t"\n[[exercises]]\nname = "image"\nstage = "render"\nscenes = ["single"]\ndrawn = 1\n'
        f'rung = "lambert"\npoints = 1\n{speed}'
    )
    slow = tracers.RIGHT.replace("def render", "def own") + (
        "\ndef render(scene):\n    import time\n"
        "    until = time.process_time() + 0.7 * scene['name'].startswith('random')\n"
        "    while time.process_time() < until: pass\n"
        "    return own(scene)\n"
    )
    (tmp_path / "a.py").write_text(slow)
    (result,) = run(jobs_of(tmp_path / "a.py", tmp_path / "r.toml"), tmp_path / "out", Workers())
    assert result.all_passed
    assert result.speed[0][1] > 0.65  # counted in steps of 10 ms
    assert result.bonus == 0


def test_a_mistake_costs_its_own_exercise_and_no_other(graded):
    for student in ("no shadows", "raises", "hangs", "exits", "nan"):
        assert [e.status for e in graded[0][student].exercises[:2]] == ["pass", "pass"], student
    assert graded[0]["pi"].exercises[0].status == "pass"
    assert graded[0]["pi"].exercises[1].causes


def test_points_are_what_the_parts_earn(graded):
    for result in graded[0].values():
        for e in result.exercises:
            assert e.points == pytest.approx(e.of * np.mean([p.share for p in e.parts]), abs=1e-4)
            assert all(p.share == 1 for p in e.parts if p.passed)
    single, drawn = image(graded, "no shadows").parts
    assert single.passed  # one sphere casts its shadow on nothing
    assert 0.25 <= drawn.share < 0.5
    assert drawn.error > 0.1
    assert drawn.wrong > 0.01


def test_helpers_beside_the_file_are_imported_and_names_that_are_html_are_escaped(graded):
    assert image(graded, "<script>").status == "fail"
    assert image(graded, "<script>").parts[1].seconds > 0
    for page in [graded[1] / "index.html", *(graded[1] / "students").iterdir()]:
        text = page.read_text()
        assert "<script>" not in text
        assert "<b>no</b>" not in text
    assert not any("<" in p.name for p in (graded[1] / "students").iterdir())


def test_pages_are_whole_and_share_their_scripts(graded):
    results, out, _, _ = graded
    for page in [out / "index.html", *(out / "students").iterdir()]:
        for found in re.findall(r'(?:href|src)="([^":#]+)"', page.read_text()):
            assert (page.parent / found).is_file(), (page, found)
        assert page.stat().st_size < 300_000
    index = (out / "index.html").read_text()
    for result in results.values():
        assert pages.page_name(result) in index
    student = (out / "students" / pages.page_name(results["gamma"])).read_text()
    assert '<p class="note">the values are encoded for display (gamma)' in index  # what the fault's name means
    assert student.index("✗ image") < student.index("✓ intersect_sphere")  # failures first
    data = json.loads(re.search(r'<script type="application/json">(.*?)</script>', student, re.DOTALL)[1])
    assert (data["width"], data["height"]) in ((336, 252), (120, 88))


def test_a_picture_that_another_function_spoils_keeps_its_points(graded):
    shade, picture = graded[0]["pi"].exercises[1:]
    assert shade.points < shade.of
    assert (picture.status, picture.points) == ("fail", 20)
    assert picture.followed > 10  # the rest is partial credit
    assert picture.sentences[0].startswith("with a right shade in place of yours this is right")
    assert "you lose points for your shade, and keep" in picture.sentences[-1]
    assert image(graded, "gamma").followed == 0  # render's own mistake


def test_a_students_page_says_first_what_to_do_and_speaks_to_the_student(graded):
    results, out, _, _ = graded
    for student, said in (("pi", 'Start with <a href="#e1">shade</a>:</b> the sun'), ("empty", "Write ")):
        page = (out / "students" / pages.page_name(results[student])).read_text()
        assert said in page[: page.index('<section class="exercise')]
        assert not re.search(r"cause \(|squared error|drawn \d|\bits\b", page[page.index("<header") :])
    text = (out / "students" / pages.page_name(results["raises"])).read_text()
    assert "Run render yourself" in text


def test_the_class_page_has_certainty_dates_histograms_and_links(graded):
    index = (graded[1] / "index.html").read_text()
    for said in ('<b class="sure">proved</b>', 'href="results.csv"', "Graded 20", 'class="spark"', 'id="h-fast"'):
        assert said in index
    assert [count for _, count, _ in pages.by_exercise([graded[0]["right"], graded[0]["pi"]], graded[3])] == [2, 1, 1]


def test_near_identical_wrong_pictures_are_found_and_right_ones_are_none(graded):
    results, alike = graded[0], pages.near_identical(list(graded[0].values()))
    assert {r.student for r, _ in alike[results["gamma"].key]} == {"<script>"}
    assert not {results[n].key for n in ("right", "pi", "nan")} & set(alike)


def test_a_second_run_grades_nothing_and_finds_the_same(graded, monkeypatch):
    results, out, jobs, _ = graded
    monkeypatch.setattr("raytwin.grade.class_run.grade_submission", None)
    assert run(jobs, out, Workers(1)) == list(results.values())
    assert collect(jobs, out) == list(results.values())


def test_a_result_that_is_half_written_is_made_again(graded, tmp_path):
    _, out, jobs, _ = graded
    job = next(j for j in jobs if j.student == "empty")
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / f"{job.key}.json").write_bytes((out / "results" / f"{job.key}.json").read_bytes()[:100])
    assert run([job], tmp_path, Workers(1))[0].student == "empty"
    assert msgspec.json.decode((tmp_path / "results" / f"{job.key}.json").read_bytes(), type=Result).key == job.key


def test_another_rubric_another_text_or_another_grader_is_another_job(graded, tmp_path, monkeypatch):
    rubric = tmp_path / "rubric.toml"
    (tmp_path / "a.py").write_text("a = 1")
    keys = set()
    said = f'[[feedback]]\nstage = "shade"\nsentence = "no"\nfingerprint = "{"0.1 " * 16}"\n'
    for text, code in (
        (RUBRIC, "a = 1"),
        (RUBRIC.replace("seed = 5", "seed = 6"), "a = 1"),
        (RUBRIC, "a = 2"),
        (RUBRIC + said, "a = 2"),
    ):
        rubric.write_text(text)
        (tmp_path / "a.py").write_text(code)
        keys.add(jobs_of(tmp_path / "a.py", rubric)[0].key)
    (tmp_path / "a.py").write_text("a = 1")
    for number in "12":  # what grades
        (tmp_path / number).write_text(number)
        monkeypatch.setattr("raytwin.grade.job.GRADER", (tmp_path / number,))
        keys.add(jobs_of(tmp_path / "a.py", rubric)[0].key)
    assert len(keys) == 5


# ------------------------------------------------------------------------------------------ outputs


def test_gradescope_gets_text_first_a_picture_a_failing_test_and_a_leaderboard(graded, tmp_path):
    results, _, _, rubric = graded
    sites.write_gradescope(results["gamma"], rubric, tmp_path / "r.json")
    told = json.loads((tmp_path / "r.json").read_text())
    assert [t["visibility"] for t in told["tests"]] == ["visible", "hidden", "visible"]
    assert [t["output_format"] for t in told["tests"]] == ["text", "text", "html"]
    assert sum(t["score"] for t in told["tests"]) == pytest.approx(told["score"])
    assert 'src="data:image/png;base64,' in told["tests"][2]["output"]
    seen = sum(t["score"] for t in told["tests"] if t["visibility"] == "visible")
    assert told["output"].startswith(f"{pages.of_points(seen)} of 30 points, of the exercises that are shown now")
    assert [row["name"] for row in told["leaderboard"]] == ["seconds a picture", "error"]
    for result in results.values():
        sites.write_gradescope(result, rubric, tmp_path / "r.json")
        assert (tmp_path / "r.json").stat().st_size < 1e6


def test_each_result_is_told_as_it_is_there(tmp_path):
    (tmp_path / "rubric.toml").write_text('title = "t"\n[[exercises]]\nstage = "shade"\npoints = 1\n')
    for name in "ab":
        files.write_text(tmp_path / "in" / f"{name}.py", "def shade(:")
    told = []

    def each(result: Result) -> None:
        told.append((result.student, len(list((tmp_path / "out" / "results").glob("*.json")))))

    jobs = jobs_of(tmp_path / "in", tmp_path / "rubric.toml")
    run(jobs, tmp_path / "out", Workers(1), each=each)
    assert told == [("a", 1), ("b", 2)]
    run(jobs, tmp_path / "out", Workers(1), each=each)
    assert len(told) == 2  # nothing is new


def test_what_is_shown_names_no_scene_of_an_exercise_that_is_hidden():
    """One cause is looked for in all pictures, so its words may name any of them."""
    words = "cause (proved): the sun is too bright; wrong on drawn 12 and single, right on drawn 1"
    shown, hidden = (
        Marked(name, "render", "fail", 0, 10, visibility, "", 1e-5, sentences=(words,), parts=tuple(parts))
        for name, visibility, parts in (
            ("a", "visible", [Part("single, shadow", False, 0), Part("drawn 1, shadow", True, 1)]),
            ("b", "hidden", [Part("drawn 12, shadow", False, 0)]),
        )
    )
    result = Result("s", "k", "t", (shown, hidden))
    rubric = Rubric("t", tuple(Exercise("render", 10, name=name) for name in "ab"))
    text = sites.gradescope(result, rubric)["tests"][0]["output"]
    assert "wrong on a scene that is not shown and single, right on drawn 1" in text
    assert "drawn 12" not in text
    assert "drawn 12" in sites.gradescope(result, rubric)["tests"][1]["output"]


def test_pictures_go_where_a_result_would_be_too_large(graded, tmp_path, monkeypatch):
    results, _, _, rubric = graded
    monkeypatch.setattr(sites, "MOST_BYTES", 4000)
    sites.write_gradescope(results["gamma"], rubric, tmp_path / "r.json")
    assert "base64" not in (tmp_path / "r.json").read_text()
    assert "no room" in (tmp_path / "r.json").read_text()


def test_junit_csv_and_json_agree(graded, tmp_path):
    results, out, _, _ = graded
    sites.write_grade_junit(list(results.values()), tmp_path / "j.xml")
    suites = {s.get("name"): s for s in ET.parse(tmp_path / "j.xml").getroot()}
    rows = {row["student"]: row for row in csv.DictReader((out / "results.csv").read_text().splitlines())}
    told = {r["student"]: r for r in json.loads((out / "results.json").read_text())["results"]}
    assert set(suites) == set(rows) == set(told) == set(results)
    for name, result in results.items():
        failing = sum(e.status != "pass" for e in result.exercises)
        assert int(suites[name].get("failures")) + int(suites[name].get("errors")) == failing
        assert float(rows[name]["points"]) == pytest.approx(result.points, abs=0.006)
        assert told[name]["points"] == result.points
    assert rows["hangs"]["image: status"] == "limit"
    assert "asleep" in rows["hangs"]["problem"]
    assert "ValueError: <b>no</b>" in rows["raises"]["problem"]
    assert (rows["gamma"]["causes"], rows["gamma"]["certainty"]) == ("; ".join(results["gamma"].faults), "proved")


# ------------------------------------------------------------------------------------------ kinds of submissions


def test_a_notebook_a_program_and_a_folder_of_images_are_graded(tmp_path):
    rubric = tmp_path / "rubric.toml"
    rubric.write_text(
        'title = "t"\n[[exercises]]\nstage = "render"\nscenes = ["single"]\nrung = "lambert"\npoints = 1\n'
    )
    cells = [{"cell_type": "code", "source": text} for text in (tracers.RIGHT, "1 / 0", "%matplotlib inline")]
    files.write_text(tmp_path / "in" / "book.ipynb", json.dumps({"cells": cells, "nbformat": 4}))
    (tmp_path / "in" / "images").mkdir()
    from raytwin import references

    held = references.load(references.path_of(references.SHIPPED, "single", "lambert"))
    picture = trace(held.origin(), "lambert")
    files.write_image(tmp_path / "in" / "images" / "single.png", picture)
    (tmp_path / "in" / "wrong").mkdir()
    files.write_exr(tmp_path / "in" / "wrong" / "single.exr", type(picture)(picture.mean * 1.01))
    found = {r.student: r for r in run(jobs_of(tmp_path / "in", rubric), tmp_path / "out", Workers(1))}
    assert {n: r.points for n, r in found.items()} == {"book": 1, "images": 1, "wrong": 0}
    assert "ZeroDivisionError" in found["book"].notes[0]
    rubric.write_text(f'command = "{sys.executable} main.py {{scene}} {{out}}.pfm"\n' + rubric.read_text())
    program = tmp_path / "program" / "ann"
    main = (
        "import json, sys\nimport numpy as np\nfrom tracer import render\n"
        "def whole(v): return {k: whole(x) for k, x in v.items()} if isinstance(v, dict) else "
        "[whole(x) for x in v] if v == [] or isinstance(v, list) and isinstance(v[0], dict) else "
        "np.array(v) if isinstance(v, list) else v\n"
        "made = render(whole(json.load(open(sys.argv[1])))).astype('<f4')[::-1]\n"
        "open(sys.argv[2], 'wb').write(b'PF\\n%d %d\\n-1\\n' % made.shape[1::-1] + made.tobytes())\n"
    )
    files.write_text(program / "main.py", main)
    files.write_text(program / "tracer.py", tracers.RIGHT)
    done = run(jobs_of(program, rubric, whole=True), tmp_path / "out", Workers(1))
    assert done[0].points == 1, done[0].exercises[0].sentences
    assert jobs_of(tmp_path / "in", rubric)[1].student == "images"
    assert code_of(tmp_path / "in" / "images", read_rubric(rubric)).kind == "images"  # though others hand in programs


# ------------------------------------------------------------------------------------------ many


def test_shards_share_all_things_out():
    things = list(range(17))
    shares = [Workers(shard=(k, 5)).share(things) for k in range(1, 6)]
    assert sorted(x for share in shares for x in share) == things
    assert max(map(len, shares)) - min(map(len, shares)) == 1


def test_an_error_costs_its_own_thing_alone():
    done = {
        d.thing: d.result if d.error is None else str(d.error)
        for d in map_parallel(tracers.square, [2, -1, 3], Workers(1))
    }
    assert done == {2: 4, -1: "-1", 3: 9}


@pytest.mark.skipif(os.name != "posix", reason="the test's module is found by fork's path alone")
def test_a_process_that_is_killed_takes_nothing_with_it(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([TESTS, os.environ.get("PYTHONPATH", "")]))
    done = list(map_parallel(tracers.die_once, [str(tmp_path / "a"), str(tmp_path / "b")], Workers(2)))
    assert [d.result for d in done] == ["alive", "alive"]
