from pathlib import Path

import pytest

from raytwin import files
from raytwin.errors import InputError

HEAD = """<integrator type="path"/><sensor type="perspective"><film type="hdrfilm">
<integer name="width" value="$w"/><integer name="height" value="9"/></film></sensor><default name="w" value="12"/>"""


def written(folder: Path, body: str = "", head: str = HEAD) -> Path:
    file = folder / "scene.xml"
    file.write_text(f'<scene version="3.0.0">{head}{body}</scene>')
    return file


@pytest.fixture
def folder(tmp_path) -> Path:
    made = tmp_path / "kitchen"
    (made / "parts").mkdir(parents=True)
    (made / "parts" / "pot.ply").write_text("a mesh")
    (tmp_path / "outside.ply").write_text("another's")
    return made


def test_a_files_parameters_includes_and_search_folders_are_put_in(folder):
    (folder / "more.xml").write_text(
        '<scene><shape type="ply"><string name="filename" value="pot.ply"/></shape></scene>'
    )
    body = '<path value="parts"/><include filename="more.xml"/><shape type="cube" id="box"/>'
    found = files.read_mitsuba(written(folder, body))
    assert (found.name, found.image_size, found.names) == ("kitchen", (12, 9), ("ply-0", "box"))
    assert set(found.files) == {"more.xml", "parts/pot.ply"}
    assert files.read_mitsuba(folder) == found


def test_a_scene_is_known_by_its_content_and_that_of_its_files_alone(folder, tmp_path):
    body = '<shape type="ply"><string name="filename" value="parts/pot.ply"/></shape>'
    before = files.read_mitsuba(written(folder, body)).digest
    assert files.read_mitsuba(written(folder, f"<!-- said -->\n{body}")).digest == before
    copied = files.write_mitsuba(files.read_mitsuba(folder), tmp_path / "copy")
    assert copied.digest == before
    assert files.read_mitsuba(tmp_path / "copy" / "scene.xml").digest == before
    (folder / "parts" / "pot.ply").write_text("another mesh")
    assert files.read_mitsuba(folder).digest != before


@pytest.mark.parametrize(
    ("value", "named"),
    [
        ("albedo/left:albedo", set()),
        ("depth/" * 900, set()),  # longer than a file's name can be
        ("12 samples/pixel", set()),
        ("parts/pot.ply", {"parts/pot.ply"}),
    ],
)
def test_a_text_with_a_slash_is_a_file_only_where_it_leads_to_one(folder, value, named):
    body = f'<integrator type="aov"><string name="aovs" value="{value}"/></integrator>'
    found = files.read_mitsuba(written(folder, body))
    assert set(found.files) == named
    text = files.as_loaded(found).findall("integrator")[1].find("string").get("value")
    assert text == (str(folder / value) if named else value)


BAD = {
    '<integrator type="mine"><string name="table" value="../outside.ply"/></integrator>': "in the scene's folder",
    "<shape>": "mismatched tag",
    '<float name="a" value="$x"/>': "<default>",
    '<shape type="ply"><string name="filename" value="no.ply"/></shape>': "none there",
    '<shape type="ply"><string name="filename" value="../outside.ply"/></shape>': "in the scene's folder",
    '<shape type="ply"><string name="filename" value="link.ply"/></shape>': "in the scene's folder",
    '<include filename="/etc/hostname"/>': "in the scene's folder",
    '<path value=".."/>': "in the scene's folder",
    '<include filename="scene.xml"/>': "includes at most 8 deep",
}


@pytest.mark.parametrize("body", BAD)
def test_what_is_wrong_with_a_file_is_said_in_one_line(folder, body):
    (folder / "link.ply").symlink_to(folder.parent / "outside.ply")
    with pytest.raises(InputError, match=BAD[body]) as told:
        files.read_mitsuba(written(folder, body))
    assert "scene.xml" in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("head", "said"), [("", "no <sensor>"), (HEAD.replace("$w", "-1"), "pixels"), (HEAD.replace("$w", "1e9"), "pixels")]
)
def test_a_scene_without_a_camera_or_size_is_refused(folder, head, said):
    with pytest.raises(InputError, match=said):
        files.read_mitsuba(written(folder, head=head))


def test_entities_are_refused_before_they_are_expanded(folder):
    (folder / "scene.xml").write_text('<!DOCTYPE a [<!ENTITY x "y">]><scene>&x;</scene>')
    with pytest.raises(InputError, match="DOCTYPE"):
        files.read_mitsuba(folder)


def test_a_file_elsewhere_may_be_allowed_by_name(folder, monkeypatch):
    monkeypatch.setenv(files.ALLOW, str(folder.parent / "outside.ply"))
    body = '<shape type="ply"><string name="filename" value="../outside.ply"/></shape>'
    assert set(files.read_mitsuba(written(folder, body)).files) == {"../outside.ply"}


def test_a_command_that_needs_raytwins_own_scene_says_so(folder):
    with pytest.raises(InputError, match=r"a scene\.toml.*got XML"):
        files.read_scene(written(folder))
