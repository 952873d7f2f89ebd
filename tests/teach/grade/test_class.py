"""A class is graded: each its verdict and points, whatever the others do; outputs that say so."""

import csv
import json
import re
import sys
import xml.etree.ElementTree as ET

import grimp
import msgspec
import pytest
import submitted_tracers as tracers
from class_handed_in import HANDED_IN, RUBRIC, STRANGE_NAME

from raytwin.images.exr import write_exr
from raytwin.images.image_formats import write_image
from raytwin.parallel import Workers
from raytwin.renderers import references
from raytwin.safe_write import write_text
from raytwin.show import autograder_sites as sites
from raytwin.show import class_page as pages
from raytwin.teach.grade import grade_submission as grading
from raytwin.teach.grade.class_run import RESULTS_FOLDER, jobs_of, run
from raytwin.teach.grade.follow_through import source_of
from raytwin.teach.grade.result import Result
from raytwin.teach.grade.rubric import read_rubric
from raytwin.teach.grade.submission_code import code_of
from raytwin.tracer import trace

NO_SUBMISSION = ("empty", "syntax", "nested", "large", "many", STRANGE_NAME)


def test_everyone_has_a_result_and_a_right_tracer_all_points(graded):
    handed_in = {name.split("/")[0].removesuffix(".py").removesuffix(".ipynb") for name in HANDED_IN}
    assert set(graded.results) == handed_in | {"hangs", "many", STRANGE_NAME}
    for student in ("right", "book"):
        assert [e.status for e in graded.results[student].exercises] == ["pass"] * 3
        assert (graded.results[student].points, graded.results[student].of) == (40, 40)
    assert "ZeroDivisionError" in graded.results["book"].notes[0]
    assert {graded.results[student].points for student in NO_SUBMISSION} == {0}


def test_each_mistake_has_its_verdict_and_its_reason(graded):
    for student, status, word in (
        ("no shadows", "fail", "there are no cast shadows"),
        ("gamma", "fail", "the values are encoded for display (gamma)"),
        ("nan", "fail", "1 pixel is NaN or infinite, the first at (x=0, y=0)"),
        ("raises", "error", "ValueError: <b>no</b>"),
        ("hangs", "limit", "not done after 10 s of the clock"),
        ("cached", "fail", "is wanted"),  # the first scene's picture for the second as well
        ("parts", "fail", "render is not written: this is made of your back_project and intersect_sphere and shade"),
        ("empty", "missing", "render is not written"),
        ("syntax", "error", "SyntaxError"),
        ("nested", "missing", "RecursionError"),
        ("large", "missing", "at most 3 MB"),
        ("many", "missing", "10 000 files"),
        (STRANGE_NAME, "error", "SyntaxError"),
    ):
        assert graded.image(student).status == status, student
        assert any(word in text for text in (*graded.image(student).sentences, graded.results[student].problem))
    assert sorted(p.passed for p in graded.image("cached").parts) == [False, True]


def test_a_mistake_costs_its_own_exercise_and_no_other_and_leaves_partial_credit(graded):
    for student in ("no shadows", "raises", "hangs", "nan"):
        assert [e.status for e in graded.results[student].exercises[:2]] == ["pass", "pass"], student
    single, drawn = graded.image("no shadows").parts
    assert (single.passed, single.share) == (True, 1)  # one sphere casts its shadow on nothing
    assert 0.25 <= drawn.share < 0.5
    assert min(drawn.error, 10 * drawn.wrong) > 0.1
    assert graded.image("no shadows").points == pytest.approx(20 * (1 + drawn.share) / 2, abs=1e-4)


# ------------------------------------------------------------------------------------------ one mistake, two exercises


def test_a_picture_that_another_function_spoils_keeps_its_points(graded):
    for student, points in (("pi", 20), ("parts", 20 * 2 / 3)):  # two of three functions are theirs
        shade, picture = graded.results[student].exercises[1:]
        assert shade.points < shade.of
        assert (picture.status, picture.points) == ("fail", pytest.approx(points, abs=1e-3))
        assert picture.followed == pytest.approx(points - picture.of * 0.25, abs=5)  # the rest is partial credit
        assert picture.sentences[0] == "Caused by `shade`. Once `shade` is correct, so is this picture."
        kept = pages.of_points(picture.followed)
        assert picture.said[-1] == f"`shade` has cost you points already, so you keep {kept} here."


def test_beside_a_failed_function_the_second_mistake_is_named_alone_and_nothing_is_kept(graded):
    assert graded.image("gamma").followed == 0
    picture = graded.image("beside")
    assert picture.points < 10  # as its error with a correct shade earns
    assert (picture.causes, picture.sureness) == (("bgr",), "proved")
    assert picture.sentences[0] == picture.faults[0][1]
    assert "`shade` makes it wrong, too" in picture.sentences


def test_the_sandbox_is_given_the_function_that_is_replaced_with_what_it_calls_and_no_other():
    text = source_of(["back_project"])
    assert re.findall(r"^def ([a-z]\w*)", text, re.MULTILINE) == ["back_project", "through", "undistort", "pixel"]


# ------------------------------------------------------------------------------------------ pages


def test_pages_are_whole_and_share_their_scripts(graded):
    index, student = (graded.out / "index.html").read_text(), graded.page("gamma")
    assert all(pages.page_name(result) in index for result in graded.results.values())
    for page in [graded.out / "index.html", *(graded.out / "students").iterdir()]:
        assert "<" not in page.name
        for found in re.findall(r'(?:href|src)="([^":#]+)"', page.read_text()):
            assert (page.parent / found).is_file(), (page, found)
    assert '<p class="note">the values are encoded for display (gamma)' in index  # what the fault's name means
    data = json.loads(re.search(r'<script type="application/json">(.*?)</script>', student, re.DOTALL)[1])
    assert (data["width"], data["height"]) in ((336, 252), (120, 88))


def test_a_students_page_says_first_what_to_do_and_speaks_to_the_student(graded):
    for student, said in (("pi", 'Start with <a href="#e1">shade</a>:</b> the sun'), ("empty", "Write ")):
        page = graded.page(student)
        assert said in page[: page.index('<section class="exercise')]
        assert not re.search(r"cause \(|squared error|drawn \d|\bits\b", page[page.index("<header") :])
    assert "Run render yourself" in graded.page("raises")


def test_the_class_page_has_certainty_dates_a_median_histograms_and_links(graded, tmp_path):
    index = (graded.out / "index.html").read_text()
    for said in ('<b class="sure">proved</b>', 'href="results.csv"', "Graded 20", 'class="spark"'):
        assert said in index
    some = [graded.results["right"], graded.results["pi"]]
    assert [count for _, count, _ in pages.by_exercise(some, graded.rubric)] == [2, 1, 1]
    pages.write_class(some, graded.rubric, tmp_path)
    middle = pages.of_points(sum(r.points for r in some) / 2)
    assert f"<dt>Median</dt><dd>{middle} <small>" in (tmp_path / "index.html").read_text()


# ------------------------------------------------------------------------------------------ runs


def test_a_second_run_grades_nothing_and_finds_the_same(graded, monkeypatch):
    monkeypatch.setattr("raytwin.teach.grade.class_run.grade_submission", None)
    assert run(graded.jobs, graded.out, Workers()) == list(graded.results.values())[1:]


def test_results_are_stored_and_one_that_is_half_written_is_made_again(graded, tmp_path):
    jobs = [j for j in graded.jobs if j.student in ("empty", "large")]
    run(jobs, tmp_path, Workers())
    half, whole = (tmp_path / RESULTS_FOLDER / f"{job.key}.json" for job in jobs)
    half.write_bytes(half.read_bytes()[:100])
    before = whole.stat().st_mtime_ns
    run(jobs, tmp_path, Workers())
    assert msgspec.json.decode(half.read_bytes(), type=Result).key == jobs[0].key
    assert whole.stat().st_mtime_ns == before


def test_another_rubric_another_text_or_another_grader_is_another_job(tmp_path, monkeypatch):
    rubric, text = tmp_path / "rubric.toml", tmp_path / "a.py"

    def key(of_rubric: str, of_text: str) -> str:
        rubric.write_text(of_rubric)
        text.write_text(of_text)
        return jobs_of(text, rubric)[0].key

    keys = {key(RUBRIC, "a = 1"), key(RUBRIC.replace("seed = 5", "seed = 6"), "a = 1"), key(RUBRIC, "a = 2")}
    other_points = RUBRIC.replace("points = 10", "points = 3.5").replace("[10, 0.25]", "[20, 0.125]")
    other_words = other_points.replace('name = "image"', 'name = "i"')
    assert key(other_words.replace('visibility = "hidden"', 'name = "light"'), "a = 2") in keys
    for number in "12":  # what grades
        (tmp_path / number).write_text(number)
        monkeypatch.setattr("raytwin.teach.grade.grade_submission.GRADER", (tmp_path / number,))
        keys.add(key(RUBRIC, "a = 1"))
    assert len(keys) == 5


def test_what_grading_imports_is_part_of_the_key():
    decides_nothing = {"notebook", "parallel", "progress", "scene_folders", "viewer"}
    rooms = {room.removesuffix(".py") for room in grading.GRADING_ROOMS} | decides_nothing
    graph = grimp.build_graph("raytwin", cache_dir=None)
    needed = {name.split(".")[1] for name in graph.find_upstream_modules("raytwin.teach.grade", as_package=True)}
    assert needed <= rooms
    assert all(place.exists() for place in grading.GRADER)


# ------------------------------------------------------------------------------------------ outputs


def test_gradescope_gets_text_first_a_picture_where_there_is_room(graded, tmp_path, monkeypatch):
    sites.write_gradescope(graded.results["gamma"], graded.rubric, tmp_path / "r.json")
    told = json.loads((tmp_path / "r.json").read_text())
    assert [t["visibility"] for t in told["tests"]] == ["visible", "hidden", "visible"]
    assert [t["output_format"] for t in told["tests"]] == ["text", "text", "html"]
    assert sum(t["score"] for t in told["tests"]) == pytest.approx(told["score"])
    assert 'src="data:image/png;base64,' in told["tests"][2]["output"]
    seen = sum(t["score"] for t in told["tests"] if t["visibility"] == "visible")
    assert told["output"].startswith(f"{pages.of_points(seen)} of 30 points, of the exercises that are shown now")
    monkeypatch.setattr(sites, "MOST_BYTES", 4000)
    sites.write_gradescope(graded.results["gamma"], graded.rubric, tmp_path / "r.json")
    assert "base64" not in (tmp_path / "r.json").read_text()
    assert "no room" in (tmp_path / "r.json").read_text()


def test_junit_csv_and_json_agree(graded, tmp_path):
    results = graded.results
    sites.write_grade_junit(list(results.values()), tmp_path / "j.xml")
    suites = {s.get("name"): s for s in ET.parse(tmp_path / "j.xml").getroot()}
    rows = {row["student"]: row for row in csv.DictReader((graded.out / "results.csv").read_text().splitlines())}
    told = {r["student"]: r for r in json.loads((graded.out / "results.json").read_text())["results"]}
    assert set(suites) == set(rows) == set(told) == set(results)
    for name, result in results.items():
        failing = sum(e.status != "pass" for e in result.exercises)
        assert int(suites[name].get("failures")) + int(suites[name].get("errors")) == failing
        assert float(rows[name]["points"]) == pytest.approx(result.points, abs=0.006)
        assert told[name]["points"] == result.points
    assert rows["hangs"]["image: status"] == "limit"
    assert "of the clock" in rows["hangs"]["problem"]
    assert "ValueError: <b>no</b>" in rows["raises"]["problem"]
    assert (rows["gamma"]["causes"], rows["gamma"]["certainty"]) == ("; ".join(results["gamma"].faults), "proved")


# ------------------------------------------------------------------------------------------ kinds of submissions


PROGRAM = """
import json, sys
import numpy as np
from tracer import render

def arrays(v):
    if isinstance(v, dict): return {key: arrays(value) for key, value in v.items()}
    if isinstance(v, list) and (not v or isinstance(v[0], dict)): return [arrays(value) for value in v]
    return np.array(v) if isinstance(v, list) else v

made = render(arrays(json.load(open(sys.argv[1])))).astype("<f4")[::-1]
open(sys.argv[2], "wb").write(b"PF\\n%d %d\\n-1\\n" % made.shape[1::-1] + made.tobytes())
"""


@pytest.mark.nightly
def test_a_program_and_a_folder_of_images_are_graded(tmp_path):
    rubric = tmp_path / "rubric.toml"
    exercise = 'title = "t"\n[[exercises]]\nstage = "render"\nscenes = ["single"]\nrung = "lambert"\npoints = 1\n'
    rubric.write_text(exercise)
    picture = trace(references.load(references.path_of(references.SHIPPED, "single", "lambert")).origin(), "lambert")
    write_image(tmp_path / "in" / "images" / "single.png", picture)
    write_exr(tmp_path / "in" / "wrong" / "single.exr", type(picture)(picture.mean * 1.01))
    found = {r.student: r.points for r in run(jobs_of(tmp_path / "in", rubric), tmp_path / "out", Workers())}
    assert found == {"images": 1, "wrong": 0}
    rubric.write_text(f'command = "{sys.executable} main.py {{scene}} {{out}}.pfm"\n{exercise}')
    write_text(tmp_path / "program" / "main.py", PROGRAM)
    write_text(tmp_path / "program" / "tracer.py", tracers.RIGHT)
    (done,) = run(jobs_of(tmp_path / "program", rubric, whole=True), tmp_path / "out", Workers())
    assert done.points == 1, done.exercises[0].sentences
    assert code_of(tmp_path / "in" / "images", read_rubric(rubric)).kind == "images"  # though others hand in programs
