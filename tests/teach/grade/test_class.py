"""A class is graded: each its verdict and points, whatever the others do; outputs that say so."""

import csv
import json
import re
import sys
import xml.etree.ElementTree as ET

import grimp
import msgspec
import numpy as np
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
from raytwin.teach.grade import job
from raytwin.teach.grade.class_run import jobs_of, run
from raytwin.teach.grade.follow_through import source_of
from raytwin.teach.grade.result import Marked, Part, Result
from raytwin.teach.grade.rubric import Exercise, Rubric, read_rubric
from raytwin.teach.grade.submission_code import code_of
from raytwin.tracer import trace

NO_SUBMISSION = ("empty", "syntax", "nested", "large", "many", STRANGE_NAME)


def test_everyone_has_a_result_and_a_right_tracer_all_points_and_the_bonus(graded):
    handed_in = {name.split("/")[0].removesuffix(".py").removesuffix(".ipynb") for name in HANDED_IN}
    assert set(graded.results) == handed_in | {"hangs", "many", STRANGE_NAME}
    for student in ("right", "book"):
        assert [e.status for e in graded.results[student].exercises] == ["pass"] * 3
        assert (graded.results[student].points, graded.results[student].of) == (42, 40)
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


def test_a_mistake_costs_its_own_exercise_and_no_other(graded):
    for student in ("no shadows", "raises", "hangs", "nan"):
        assert [e.status for e in graded.results[student].exercises[:2]] == ["pass", "pass"], student
    assert graded.results["pi"].exercises[0].status == "pass"
    assert graded.results["pi"].exercises[1].causes


def test_points_are_what_the_parts_earn(graded):
    for result in graded.results.values():
        for e in result.exercises:
            assert e.points == pytest.approx(e.of * np.mean([p.share for p in e.parts]), abs=1e-4)
            assert all(p.share == 1 for p in e.parts if p.passed)
    single, drawn = graded.image("no shadows").parts
    assert single.passed  # one sphere casts its shadow on nothing
    assert 0.25 <= drawn.share < 0.5
    assert drawn.error > 0.1
    assert drawn.wrong > 0.01


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


def test_nothing_is_kept_where_the_picture_is_wrong_itself(graded):
    assert graded.image("gamma").followed == 0
    assert graded.image("beside").points < 10  # as its error with a right shade earns


def test_beside_a_failed_function_the_second_mistake_is_named_alone(graded):
    picture = graded.image("beside")
    assert (picture.causes, picture.sureness) == (("bgr",), "proved")
    assert picture.sentences[0] == picture.faults[0][1]
    assert "`shade` makes it wrong, too" in picture.sentences


def test_the_sandbox_is_given_no_function_that_was_not_replaced():
    text = source_of(["shade", "intersect_sphere"])
    assert "def shade" in text
    assert "def render" not in text
    assert "def back_project" not in text
    made: dict = {}
    exec(source_of(["back_project"]), made)
    assert callable(made["undistort"])


# ------------------------------------------------------------------------------------------ pages


def test_pages_are_whole_and_share_their_scripts(graded):
    for page in [graded.out / "index.html", *(graded.out / "students").iterdir()]:
        for found in re.findall(r'(?:href|src)="([^":#]+)"', page.read_text()):
            assert (page.parent / found).is_file(), (page, found)
        assert page.stat().st_size < 300_000
    assert not any("<" in p.name for p in (graded.out / "students").iterdir())
    index = (graded.out / "index.html").read_text()
    for result in graded.results.values():
        assert pages.page_name(result) in index
    student = graded.page("gamma")
    assert '<p class="note">the values are encoded for display (gamma)' in index  # what the fault's name means
    assert student.index("✗ image") < student.index("✓ intersect_sphere")  # failures first
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
    for said in ('<b class="sure">proved</b>', 'href="results.csv"', "Graded 20", 'class="spark"', 'id="h-fast"'):
        assert said in index
    some = [graded.results["right"], graded.results["pi"]]
    assert [count for _, count, _ in pages.by_exercise(some, graded.rubric)] == [2, 1, 1]
    pages.write_class(some, graded.rubric, tmp_path)
    middle = pages.of_points(sum(r.points for r in some) / 2)
    assert f"<dt>Median</dt><dd>{middle} <small>" in (tmp_path / "index.html").read_text()


def test_near_identical_wrong_pictures_are_found_and_right_ones_are_none(graded):
    alike = pages.near_identical(list(graded.results.values()))
    assert {r.student for r, _ in alike[graded.results["gamma"].key]} == {"<script>"}
    assert not {graded.results[n].key for n in ("right", "nan")} & set(alike)


# ------------------------------------------------------------------------------------------ runs


def test_a_second_run_grades_nothing_and_finds_the_same(graded, monkeypatch):
    monkeypatch.setattr("raytwin.teach.grade.class_run.grade_submission", None)
    assert run(graded.jobs, graded.out, Workers()) == list(graded.results.values())


def test_a_result_that_is_half_written_is_made_again(graded, tmp_path):
    job = next(j for j in graded.jobs if j.student == "empty")
    made = tmp_path / "results" / f"{job.key}.json"
    made.parent.mkdir()
    made.write_bytes((graded.out / "results" / made.name).read_bytes()[:100])
    assert run([job], tmp_path, Workers())[0].student == "empty"
    assert msgspec.json.decode(made.read_bytes(), type=Result).key == job.key


def test_each_result_is_reported_once_it_is_there(graded, tmp_path):
    jobs = [j for j in graded.jobs if j.student in ("empty", "large")]
    told = []

    def each(result: Result) -> None:
        told.append((result.student, len(list((tmp_path / "results").glob("*.json")))))

    for _ in range(2):  # the second time nothing is new
        run(jobs, tmp_path, Workers(), each=each)
        assert [count for _, count in told] == [1, 2]
        assert {name for name, _ in told} == {"empty", "large"}


def test_another_rubric_another_text_or_another_grader_is_another_job(tmp_path, monkeypatch):
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
        monkeypatch.setattr("raytwin.teach.grade.job.GRADER", (tmp_path / number,))
        keys.add(jobs_of(tmp_path / "a.py", rubric)[0].key)
    assert len(keys) == 5


def test_what_grading_imports_is_part_of_the_key():
    decides_nothing = {"notebook", "parallel", "progress", "scene_folders", "viewer"}
    rooms = {room.removesuffix(".py") for room in job.GRADING_ROOMS} | decides_nothing
    graph = grimp.build_graph("raytwin", cache_dir=None)
    needed = {name.split(".")[1] for name in graph.find_upstream_modules("raytwin.teach.grade", as_package=True)}
    assert needed <= rooms
    assert all(place.exists() for place in job.GRADER)


# ------------------------------------------------------------------------------------------ outputs


def test_gradescope_gets_text_first_a_picture_a_failing_test_and_a_leaderboard(graded, tmp_path):
    sites.write_gradescope(graded.results["gamma"], graded.rubric, tmp_path / "r.json")
    told = json.loads((tmp_path / "r.json").read_text())
    assert [t["visibility"] for t in told["tests"]] == ["visible", "hidden", "visible"]
    assert [t["output_format"] for t in told["tests"]] == ["text", "text", "html"]
    assert sum(t["score"] for t in told["tests"]) == pytest.approx(told["score"])
    assert 'src="data:image/png;base64,' in told["tests"][2]["output"]
    seen = sum(t["score"] for t in told["tests"] if t["visibility"] == "visible")
    assert told["output"].startswith(f"{pages.of_points(seen)} of 30 points, of the exercises that are shown now")
    assert [row["name"] for row in told["leaderboard"]] == ["seconds per picture", "error"]
    for result in graded.results.values():
        sites.write_gradescope(result, graded.rubric, tmp_path / "r.json")
        assert (tmp_path / "r.json").stat().st_size < 1e6


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


@pytest.mark.nightly
def test_a_program_and_a_folder_of_images_are_graded(tmp_path):
    rubric = tmp_path / "rubric.toml"
    rubric.write_text(
        'title = "t"\n[[exercises]]\nstage = "render"\nscenes = ["single"]\nrung = "lambert"\npoints = 1\n'
    )
    held = references.load(references.path_of(references.SHIPPED, "single", "lambert"))
    picture = trace(held.origin(), "lambert")
    write_image(tmp_path / "in" / "images" / "single.png", picture)
    write_exr(tmp_path / "in" / "wrong" / "single.exr", type(picture)(picture.mean * 1.01))
    found = {r.student: r.points for r in run(jobs_of(tmp_path / "in", rubric), tmp_path / "out", Workers())}
    assert found == {"images": 1, "wrong": 0}
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
    write_text(program / "main.py", main)
    write_text(program / "tracer.py", tracers.RIGHT)
    done = run(jobs_of(program, rubric, whole=True), tmp_path / "out", Workers())
    assert done[0].points == 1, done[0].exercises[0].sentences
    assert jobs_of(tmp_path / "in", rubric)[0].student == "images"
    assert code_of(tmp_path / "in" / "images", read_rubric(rubric)).kind == "images"  # though others hand in programs
