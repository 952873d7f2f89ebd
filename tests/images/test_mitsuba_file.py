import shutil
from pathlib import Path

import pytest
from counting import calls

from raytwin.errors import InputError
from raytwin.scene import mitsuba_file
from raytwin.scene.mitsuba_file import read_mitsuba
from raytwin.scene.scene_files import read_scene

HEAD = """<default name="w" value="12"/><integrator type="path"/><sensor type="perspective"><film type="hdrfilm">
<integer name="width" value="$w"/><integer name="height" value="9"/></film></sensor>"""
POT = '<shape type="ply"><string name="filename" value="{}"/></shape>'


def written(folder: Path, body: str = "", head: str = HEAD) -> Path:
    file = folder / "scene.xml"
    file.write_text(f'<scene version="3.0.0">{head}{body}</scene>')
    return file


@pytest.fixture
def folder(tmp_path) -> Path:
    made = tmp_path / "kitchen"
    (made / "parts").mkdir(parents=True)
    (made / "parts" / "pot.ply").write_text("a mesh")
    return made


def test_includes_parameters_and_search_folders_are_followed_as_mitsuba_does(folder):
    """Beside the including file, then beside those that include it; later <path>s first; parameters in names."""
    (folder / "parts" / "all.xml").write_text('<scene><include filename="parts/$which.xml"/></scene>')
    (folder / "parts" / "one.xml").write_text('<bsdf type="diffuse"><include filename="two.xml"/></bsdf>')
    (folder / "parts" / "two.xml").write_text('<texture version="3.0.0" type="checkerboard"/>')
    (folder / "pot.ply").write_text("another mesh")
    body = '<default name="which" value="one"/>{}<include filename="parts/all.xml"/><path value="parts"/>{}'
    found = read_mitsuba(written(folder, body.format(POT.format("pot.ply"), POT.format("pot.ply"))))
    inner = ("parts/all.xml", "parts/one.xml", "parts/pot.ply", "parts/two.xml")
    assert tuple(found.files) == (*inner, "pot.ply", "scene.xml")
    assert (found.name, found.image_size) == ("kitchen", (12, 9))
    assert read_mitsuba(folder) == found


def test_a_scene_is_known_by_its_content_and_size_and_that_of_its_files_alone(folder, tmp_path):
    body = POT.format("parts/pot.ply")
    scene = read_mitsuba(written(folder, body))
    assert read_mitsuba(written(folder, f"<!-- said -->\n{body}")).digest == scene.digest
    shutil.copytree(folder, tmp_path / "copy")
    assert read_mitsuba(tmp_path / "copy" / "scene.xml").digest == scene.digest
    assert read_mitsuba(written(folder, body, HEAD.replace("12", "13"))).digest != scene.digest
    assert read_mitsuba(written(folder, body, HEAD.replace("path", "direct"))).digest != scene.digest
    written(folder, body)
    (folder / "parts" / "pot.ply").write_text("another mesh")
    assert read_mitsuba(folder).digest != scene.digest


def test_what_is_wrong_with_a_file_is_said_in_one_line(folder, subtests):
    (folder / "parts" / "bad.xml").write_text("<shape>")
    cases = [
        (HEAD, "<shape>", "mismatched tag"),
        (HEAD, POT.format("no.ply"), "filename: expected a file, got no.ply: none there"),
        (HEAD, '<include filename="scene.xml"/>', "includes at most 15 deep"),
        (HEAD, '<include filename="parts/bad.xml"/>', "bad.xml.*no element found"),
        (HEAD, '<path value="nowhere"/>', "nowhere: none there"),
        ("", "", "no <sensor>"),
        (HEAD.replace("<integrator", "<other"), "", "no <integrator>"),
        *(
            (HEAD.replace("$w", width), "", "a width and a height in pixels")
            for width in ("-1", "1e9", "9" * 5000, "$x")
        ),
        (HEAD.replace("$w", "99999").replace('"9"', '"99999"'), "", "at most .* megapixels"),
    ]
    for head, body, said in cases:
        with subtests.test(said):
            with pytest.raises(InputError, match=said) as told:
                read_mitsuba(written(folder, body, head))
            assert ".xml" in str(told.value)
            assert "\n" not in str(told.value)
            assert len(str(told.value)) < 500
    (folder / "scene.xml").write_text('<bsdf type="diffuse"/>')
    with pytest.raises(InputError, match="whose outermost element is <scene>"):
        read_mitsuba(folder)


def test_a_command_that_needs_raytwins_own_scene_says_so(folder):
    with pytest.raises(InputError, match=r"a scene\.toml.*got XML"):
        read_scene(written(folder))


def test_four_times_the_shapes_and_parameters_take_four_times_the_calls_and_a_shared_file_is_read_once(
    folder, monkeypatch
):
    counts, read, content = [], [], mitsuba_file._content
    monkeypatch.setattr(mitsuba_file, "_content", lambda file: (read.append(file.name), content(file))[1])
    for count in (25, 100):
        body = "".join(f'<default name="p{i}" value="{i}"/>{POT.format("parts/pot.ply")}' for i in range(count))
        file = written(folder, body)
        counts.append(calls(lambda file=file: read_mitsuba(file)))
    assert counts[1] / counts[0] < 4.5
    assert read.count("pot.ply") == len(counts) * read.count("scene.xml") // len(counts)
