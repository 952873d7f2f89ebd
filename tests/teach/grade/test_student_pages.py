"""What a student's page shows: one mistake once, its lines, and, where it is handed out, nothing of the grader's."""

import re
from pathlib import Path

from msgspec.structs import replace

from raytwin.show import class_page as pages
from raytwin.show.student_page import for_student, seen_as, student_page
from raytwin.teach.grade.marks import lines_of
from raytwin.teach.grade.result import CodeLine, Marked, MarkedPart, Result
from raytwin.teach.grade.rubric import Exercise, Rubric
from raytwin.teach.sandbox.sandbox import Code

RUBRIC = Rubric("t", tuple(Exercise("render", 10, name) for name in "ab"), seed=271828)


def wrong(name: str = "a", *said: str, **more) -> Marked:
    return Marked(name, "render", "fail", 0, 10, sentences=said, parts=(MarkedPart("single, shadow", False),), **more)


def test_a_page_that_is_handed_out_is_whole_and_says_nothing_of_the_grader(graded, tmp_path):
    results = [replace(r, open_locks=("other uid: /root/.pyenv",)) for r in graded.results.values()]
    assert pages.write_class(results, graded.rubric, tmp_path, for_students=True) == []
    handed_out = sorted((tmp_path / pages.FOR_STUDENTS).iterdir())
    assert len(handed_out) == len(results)
    assert not [p.name for p in handed_out if re.search(r"-[0-9a-f]{6}\.html", p.name)]
    for page in handed_out:
        text = page.read_text()
        assert all(address.startswith(("#", "data:")) for address in re.findall(r'(?:href|src)="([^"]*)"', text)), page
        shown = re.sub(r"(?s)<script.*?</script>|<style.*?</style>", "", text)
        for secret in ("seed", ".pyenv", "sandbox", str(graded.out), "/tmp", *(r.key for r in results)):
            assert secret not in shown, (page, secret)
        assert not re.search(r'aria-labelledby="[^"]*">\s*<h2[^>]*>.{0,80}shade', shown)  # it is hidden
    assert '"width"' in (tmp_path / pages.FOR_STUDENTS / "gamma.html").read_text()  # the viewer's data


def test_no_folder_of_the_graders_machine_is_handed_out():
    for text, left in (
        ("PermissionError: '/root/.pyenv/lib/python3.11/encodings/__init__.py'", "PermissionError: '__init__.py'"),
        ('File "/home/ann/grading/in/ada.py", line 3', 'File "ada.py", line 3'),
        (r"C:\Users\ann\ada.py is wrong", "ada.py is wrong"),
        (f"in {Path.cwd()}/class/ada.py", "in ada.py"),
        ("../class/ada.py: expected UTF-8", "ada.py: expected UTF-8"),
        ("albedo/pi, 1 / 2, m/s, a[0]/b/c, (x)/y/z", "albedo/pi, 1 / 2, m/s, a[0]/b/c, (x)/y/z"),
    ):
        result = Result("a", "k", "t", (wrong("a", text), wrong("b")), problem=text, printed=text, notes=(text,))
        told = for_student(result, RUBRIC)
        assert {told.problem, told.printed, *told.notes, *told.exercises[0].sentences} == {left}


def test_what_is_not_visible_is_not_handed_out_nor_the_graders_own_fault():
    words = "wrong on drawn 12, right on single"
    hidden = replace(wrong("b"), visibility="after_due_date", parts=(MarkedPart("drawn 12, shadow", False),))
    told = for_student(Result("s", "k", "t", (wrong("a", words, same_as="b"), hidden), seed=3), RUBRIC)
    assert [e.name for e in told.exercises] == ["a"]
    assert told.exercises[0].sentences == ("wrong on a scene that is not shown, right on single",)
    assert (told.key, told.seed, told.exercises[0].same_as) == ("", 0, "another exercise")
    fault = for_student(Result("s", "k", "t", (), problem="KeyError: 17", grader_fault=True), RUBRIC)
    assert "KeyError" not in student_page(fault, RUBRIC, True)
    assert "not your doing" in fault.problem
    assert "No exercise is shown yet." in student_page(Result("s", "k", "t", (hidden,)), RUBRIC, True)


def test_one_mistake_in_two_exercises_is_one_to_mend_and_has_a_sign_of_its_own(graded):
    page = graded.page("pi")
    for said in ("✗ 1 of 3 to mend", "It makes image wrong, too.", '<section class="exercise follows"'):
        assert said in page
    assert [seen_as(e) for e in graded.results["pi"].exercises] == ["pass", "fail", "follows"]
    assert '<span class="cell follows"' in (graded.out / "index.html").read_text()


SOURCE = "import numpy as np\n\n\ndef render(scene):\n    a = 1\n    b = a\n    return b\n"


def test_the_lines_that_sentences_speak_of_are_shown_with_their_neighbours():
    for sentence, here in (
        ("a place to mend it: line 5: the sign", {5}),
        ("ValueError: no\nada.py, line 6, in render: b = a", {6}),
        ("two changes: line 1: x; and line 7: y", {1, 7}),
        ("ValueError: no\nhelper.py, line 6, in f: 1", None),
        ("wrong everywhere", None),
        ("line 99: beyond the end", None),
    ):
        lines = lines_of(wrong("a", sentence), Code(source=SOURCE, file="my ada.py"))
        assert {line.number for line in lines if line.here} == (here or set()), sentence
        if here:
            near = {n + k for n in here for k in (-2, -1, 0, 1, 2)} & set(range(1, 8))
            assert lines == tuple(CodeLine(n, SOURCE.splitlines()[n - 1], n in here) for n in sorted(near))
            made = Result("a", "k", "t", (wrong("a", sentence, code=lines),))
            assert f"<i>{min(here)}</i>" in student_page(made, RUBRIC)


def test_a_mistake_that_is_known_by_its_line_is_counted_and_a_name_that_is_no_cause_is_not():
    by_line = wrong("a", "line 5: the sign", repair="the sign is wrong", faults=(("gamma", "no"),), sureness="proved")
    proved = replace(by_line, mistakes=("gamma",))
    follows = wrong("b", same_as="a", faults=(("bgr", "no"),))
    some = [Result(name, name, "t", (e, follows)) for name, e in (("x", by_line), ("y", by_line), ("z", proved))]
    counted = [(name, [r.student for r, _ in who]) for name, _, who in pages.faults(some)]
    assert counted == [("render: the sign is wrong", ["x", "y"]), ("gamma", ["z"])]


def test_what_to_look_at_first_comes_first_then_what_lost_most_and_what_is_not_written_comes_last():
    some = (
        replace(wrong("written", same_as="worst"), status="missing"), replace(wrong("passed"), status="pass"),
        replace(wrong("follows", because=("shade",)), points=-5), replace(wrong("little"), points=9), wrong("much"),
        replace(wrong("worst"), status="limit", points=9.5),
    )  # fmt: skip
    page = student_page(Result("a", "k", "t", some), RUBRIC)
    order = re.findall(r"<h2[^>]*>. (\w+)", page)
    assert order == ["worst", "much", "little", "follows", "passed", "written"]


def test_names_sort_alike_in_any_case(tmp_path):
    some = [Result(name, name, "t", (wrong("a"), wrong("b"))) for name in ("bo", "Cy", "ada", "Bo")]
    pages.write_class(some, RUBRIC, tmp_path, for_students=True)
    rows = (tmp_path / "results.csv").read_text().splitlines()[1:]
    index = re.findall(r'<th scope="row"><a href="students/[^"]*">(\w+)', (tmp_path / "index.html").read_text())
    assert [row.partition(",")[0] for row in rows] == index[:4] == ["ada", "Bo", "bo", "Cy"]
    names = sorted(p.name for p in (tmp_path / pages.FOR_STUDENTS).iterdir())
    assert names == ["Bo.html", "Cy.html", "ada.html", "bo-2.html"]
