"""README and docs/: commands run as written, links lead somewhere, code works.

Shell blocks marked `sh` are run, those marked `bash` are only parsed (a cluster, a page that waits). A block after
`<!-- file: NAME -->` is written to that file first.
"""

import doctest
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import truths
from program import parse, raytwin

ROOT = Path(__file__).resolve().parent.parent
README = ROOT / "README.md"
TEXTS = [
    README,
    *(
        p
        for folder in (".github", "docs", "scenes", "reference", "tests", "src")
        for p in sorted((ROOT / folder).rglob("*.md"))
    ),
]
DOCS = ROOT / "docs"
NOT_RUN = "contributing.md", "measured.md"
"""Pages whose commands set up, or measure for hours. Those of all others are run, in a folder of each page's own."""
READ_FIRST = [README, *(DOCS / f"{name}.md" for name in ("start", "teach", "learn"))]
"""What a newcomer reads: what commands are said to print, they print."""
GENERATED = {"gallery.md", "faults.md", "changelog.md", "commands.md", "api.md"}
"""What docs/hooks.py writes when the site is built, which checks links to these."""
SET_UP = ("python3 -m venv", ".venv/bin/pip install", ".venv/bin/python ", ".venv/bin/ruff", "source ")


def blocks(text: Path, language: str) -> list[str]:
    """The blocks of a language, those within a list too."""
    found = re.findall(rf"^( *)```{language}\n(.*?)^ *```$", text.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    return [re.sub(rf"^{indent}", "", block, flags=re.MULTILINE) for indent, block in found]


def commands(text: Path) -> list[str]:
    """Every line of a shell block, and every `raytwin ...` of a table that has no placeholder; set-up left out."""
    lines = [line for block in blocks(text, "sh") for line in block.splitlines()]
    lines += [part for kind in ("bash", "yaml") for block in blocks(text, kind) for part in within(block)]
    lines += re.findall(r"`(raytwin (?:[^`A-Z]|[A-Z](?![A-Z]{2}))+?)`", text.read_text(encoding="utf-8"))
    return [line for line in dict.fromkeys(lines) if not line.startswith((*SET_UP, "python "))]


def within(script: str) -> list[str]:
    """Every `raytwin ...` of a script, also between others on a line and in `sh -c '...'`."""
    parts = re.split(r"\n|;|&&|\|\||sh -c ['\"]|- run: ", script)
    return [part.strip() for part in parts if part.strip().startswith("raytwin ")]


def raytwin_words(command: str) -> list[str]:
    words = shlex.split(command, comments=True)
    assert words[0] in ("raytwin", ".venv/bin/raytwin"), command
    return words[1:]


def test_links_lead_to_files_that_are_there():
    for text in TEXTS:
        links = re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", text.read_text(encoding="utf-8"))
        assert [link for link in links if "://" not in link and not is_there(text.parent / link)] == [], text


def is_there(path: Path) -> bool:
    path = Path(os.path.normpath(path))
    return path.exists() or (path.is_relative_to(DOCS) and path.relative_to(DOCS).as_posix() in GENERATED)


def test_every_page_has_its_place_in_the_sites_navigation():
    _, navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n")
    listed = set(re.findall(r"[\w/-]+\.md", navigation))
    assert listed == {p.name for p in DOCS.rglob("*.md")} - {"sessions.md"} | GENERATED


def test_one_block_of_the_readme_is_marked_as_the_test_command():
    assert README.read_text(encoding="utf-8").count("<!-- test command -->\n```sh\n") == 1


def test_the_devcontainer_is_set_up_by_the_readmes_commands():
    """Then it writes the walk's notebook: the last command is parsed as those of every page are."""
    made = json.loads((ROOT / ".devcontainer" / "devcontainer.json").read_text(encoding="utf-8"))
    *set_up, walk = made["postCreateCommand"].split(" && ")
    assert set_up == blocks(README, "sh")[0].splitlines()[:2]
    assert parse(raytwin_words(walk)) is None


def test_every_command_and_option_that_is_named_exists():
    """Each command is parsed by the program itself, to the last option; nothing runs."""
    for command in (c for text in TEXTS for c in commands(text) if not any(sign in c for sign in ("|", "...", "["))):
        refused = parse(words := raytwin_words(command))
        if refused == "InputError" and any(word.startswith("out/") for word in words):
            continue  # an earlier command makes the scene
        # In a sentence a command may lack what it needs.
        assert refused in (None, "MissingParameter", "NoArgsIsHelpError", "BadOptionUsage"), (command, refused)


def test_a_command_that_is_none_would_be_noticed_within_another_too():
    script = "git bisect run sh -c 'make || exit 125; raytwin compare ball --subject \"./a {scene} {out}\"; exit $?'\n"
    assert within(script) == ['raytwin compare ball --subject "./a {scene} {out}"']
    assert parse(raytwin_words(within(script.replace("compare", "reference check"))[0])) == "NoSuchOption"
    assert parse(["reference", "shows"]) == "UsageError"
    assert parse(["bench", "single", "--sizes", "1", "--nonsense"]) == "NoSuchOption"
    assert parse(["bench", "single", "--sizes", "1"]) is None


@pytest.fixture(scope="module")
def checkout(tmp_path_factory) -> Path:
    """A folder that looks like the repository's root, where commands may write."""
    folder = tmp_path_factory.mktemp("checkout")
    for name in ("scenes", "reference", "src", "pyproject.toml"):
        (folder / name).symlink_to(ROOT / name)
    return folder


def run(words: list[str], cwd: Path) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(ROOT / "src"), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {"PYTHONPATH": path, "RAYTWIN_CACHE": str(cwd / "cache")}
    return subprocess.run(words, cwd=cwd, env=environment, capture_output=True, text=True, timeout=300, check=False)


PAGES_RUN = [p for p in (README, *sorted(DOCS.glob("*.md"))) if blocks(p, "sh") and p.name not in NOT_RUN]


@pytest.mark.nightly
@pytest.mark.parametrize("text", PAGES_RUN, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_command_of_a_page_runs_as_written(text, tmp_path, monkeypatch):
    """In the order of the page, since later ones read what earlier ones wrote; a comment gives another exit code."""
    for name in ("scenes", "reference", "src", "pyproject.toml"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.setenv("RAYTWIN_CACHE", str(ROOT / ".pytest_cache" / "pages"))
    files = re.findall(r"<!-- file: (\S+) -->\n```\w+\n(.*?)^```$", text.read_text(encoding="utf-8"), re.DOTALL | re.M)
    printed = ""
    for command in (line for block in blocks(text, "sh") for line in block.splitlines()):
        if command.startswith(SET_UP):
            continue
        words = shlex.split(command, comments=True)[1:]
        if words[0] != "grade" or words[1] != "starter":
            write(files, tmp_path)  # a starter file that a page goes on to fill in
        expected = given[1] if (given := re.search(r"# exits with (\d(?: or \d)*)", command)) else "0"
        fresh = text == README and "raytwin compare" in command
        if fresh or command.startswith("python "):  # a newcomer meets it in a process of its own, without a cache
            done = run([sys.executable, *(["-m", "raytwin"] if fresh else ()), *words], tmp_path)
        else:
            done = raytwin(*words, cwd=tmp_path)
        printed += done.stdout
        assert str(done.returncode) in expected.split(" or "), f"{command}\n{done.stdout}\n{done.stderr}"
        assert "Traceback" not in done.stderr
    if text in READ_FIRST:
        # A line that begins so shows an error in a file of the reader's, whatever the commands above it did.
        texts = (line for block in blocks(text, "text") for line in block.splitlines())
        shown = [line for line in texts if not line.startswith("raytwin: ")]
        lines = {without_numbers(line) for line in printed.splitlines()}
        assert [line for line in shown if without_numbers(line) not in lines] == []


def without_numbers(line: str) -> str:
    """Points and errors follow the drawn cases; the words do not."""
    return re.sub(r"[\d.]+", "0", " ".join(line.split()))


def write(files: list[tuple[str, str]], folder: Path) -> None:
    for name, content in files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content, encoding="utf-8")


@pytest.mark.nightly
def test_the_instructors_test_passes_with_a_right_renderer_and_fails_with_a_wrong_one(checkout):
    code = next(block for block in blocks(DOCS / "renderer.md", "python") if "raytwin_reference" in block)
    code = code[code.index("def test_my_renderer") :]
    for rung in ("shadow", "lambert"):
        imports = "import raytwin\nfrom raytwin.renderers.scene_exchange import as_scene\n\n\n"
        render = f'{imports}def render(scene):\n    return raytwin.trace(as_scene(scene), "{rung}").mean\n\n\n'
        write([(f"class/test_{rung}.py", render + code)], checkout)
    told = run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", "class", "class"], checkout
    )
    assert "1 failed, 1 passed" in told.stdout
    assert re.search(r"^FAILED \S*test_lambert.py", told.stdout, re.M)


@pytest.mark.nightly
def test_the_python_of_a_page_runs_and_prints_what_is_said_of_it(checkout, monkeypatch, capsys):
    def printed(page: Path, part: str = "") -> str:
        code = "\n".join(block for block in blocks(page, "python") if part in block)
        return printed_by(code, checkout, monkeypatch, capsys)

    assert printed(DOCS / "python.md", "back_project(") == "(3,) (600, 800, 3)\n"
    assert printed(DOCS / "start.md") == "pass\n"
    learnt = [float(v) for v in re.findall(r"[\d.]+", printed(README, "raytwin.trace"))]
    albedo, sky = (0.8, 0.4, 0.2), (0.1, 0.12, 0.15)
    expected = [a / 3.141592653589793 * 3 + a * s for a, s in zip(albedo, sky, strict=True)]
    assert learnt == pytest.approx(expected, rel=1e-4)
    assert "fail the whole image is 2" in printed(README)
    assert re.match(r"fail \d+ the whole image is \d\.\d+ % too bright", printed(DOCS / "noise.md", "exponential"))


@pytest.mark.nightly
def test_every_exported_name_has_an_example_that_prints_what_the_page_says(tmp_path, monkeypatch):
    import raytwin as package

    text = (DOCS / "sessions.md").read_text(encoding="utf-8")
    sections = re.findall(r"^### raytwin\.(\w+)\n.*?^```pycon\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    assert sorted(name for name, _ in sections) == sorted(package.__all__)
    assert [name for name, code in sections if f"raytwin.{name}" not in code] == []
    for name in ("scenes", "reference"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    session = doctest.DocTestParser().get_doctest("\n".join(code for _, code in sections), {}, "examples", None, 0)
    wrong: list[str] = []
    doctest.DocTestRunner(verbose=False).run(session, out=wrong.append)
    assert session.examples
    assert "".join(wrong) == ""


PRINTS = re.compile(r"^```python\n((?:(?!```).*\n)+)```\n\n```text\n((?:(?!```).*\n)+)```$", re.MULTILINE)
"""Code, and directly below it what it prints."""


@pytest.mark.nightly
@pytest.mark.parametrize("page", ["python", "noise"])
def test_python_prints_what_stands_below_it(page, checkout, monkeypatch, capsys):
    scripts = PRINTS.findall((DOCS / f"{page}.md").read_text(encoding="utf-8"))
    assert scripts
    for code, printed in scripts:
        assert printed_by(code, checkout, monkeypatch, capsys) == printed


def printed_by(code: str, folder: Path, monkeypatch, capsys) -> str:
    """What a page's Python prints, run in the folder."""
    monkeypatch.chdir(folder)
    exec(compile(code, "page", "exec"), {"__name__": "script"})
    return capsys.readouterr().out


def test_the_numbers_of_the_closed_forms_are_those_of_their_formulas():
    page = (DOCS / "closed-forms.md").read_text(encoding="utf-8")
    for name in ("from_element", "in_wedge", "parallel", "perpendicular"):
        table = page.split(f"<!-- closed form: {name} -->\n")[1].strip().split("\n\n")[0]
        rows = [[float(cell) for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]]
        for *given, value in rows:
            if name == "in_wedge":
                given = [given[0], given[1], given[1], given[2]]  # both planes have the same albedo
            assert getattr(truths, name)(*given) == pytest.approx(value, rel=1e-11), name
