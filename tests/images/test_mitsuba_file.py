import shutil
from pathlib import Path

import pytest
from counting import calls

from raytwin.errors import InputError
from raytwin.scene import mitsuba_file
from raytwin.scene.mitsuba_file import ALLOW, as_loaded, mitsuba_plugins, read_mitsuba
from raytwin.scene.scene_files import read_scene

HEAD = """<default name="w" value="12"/><integrator type="path"/><sensor type="perspective"><film type="hdrfilm">
<integer name="width" value="$w"/><integer name="height" value="9"/></film></sensor>"""


CROP = '<integer name="crop_offset_x" value="{x}"/><integer name="crop_width" value="{w}"/></film>'


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
    found = read_mitsuba(written(folder, body))
    assert (found.name, found.image_size, found.names) == ("kitchen", (12, 9), ("ply-0", "box"))
    assert set(found.files) == {"more.xml", "parts/pot.ply"}
    assert read_mitsuba(folder) == found


def test_a_scene_is_known_by_its_content_and_that_of_its_files_alone(folder, tmp_path):
    body = '<shape type="ply"><string name="filename" value="parts/pot.ply"/></shape>'
    before = read_mitsuba(written(folder, body)).digest
    assert read_mitsuba(written(folder, f"<!-- said -->\n{body}")).digest == before
    shutil.copytree(folder, tmp_path / "copy")
    assert read_mitsuba(tmp_path / "copy" / "scene.xml").digest == before
    (folder / "parts" / "pot.ply").write_text("another mesh")
    assert read_mitsuba(folder).digest != before


def test_an_include_and_a_search_folder_are_looked_for_where_mitsuba_looks(folder):
    """Beside the including file, then beside those that include it; later <path>s first; parameters in names."""
    (folder / "parts" / "all.xml").write_text('<scene><include filename="parts/$which.xml"/></scene>')
    (folder / "parts" / "one.xml").write_text(
        '<bsdf version="3.0.0" type="diffuse" name="lost"><include name="reflectance" filename="two.xml"/></bsdf>'
    )
    (folder / "parts" / "two.xml").write_text('<texture version="3.0.0" type="checkerboard"/>')
    (folder / "pot.ply").write_text("another mesh")
    pot = '<shape type="ply"><string name="filename" value="pot.ply"/><include filename="parts/all.xml" /></shape>'
    found = read_mitsuba(written(folder, f'<default name="which" value="one"/>{pot}<path value="parts"/>'))
    assert set(found.files) == {"parts/all.xml", "parts/one.xml", "parts/two.xml", "parts/pot.ply"}
    assert '<bsdf type="diffuse"><texture type="checkerboard" name="reflectance" /></bsdf>' in found.text


def test_every_plugin_that_mitsuba_brings_is_its_own():
    brought = mitsuba_plugins()
    assert brought >= {"path", "hdrfilm", "d65", "sphere"}  # libraries
    assert brought >= {"prb", "prb_basic", "prb_projective", "prbvolpath", "direct_projective"}  # in Python


def test_a_plugin_may_be_allowed_by_name(folder, monkeypatch):
    monkeypatch.setenv(ALLOW, "mine")
    assert 'type="mine"' in read_mitsuba(written(folder, '<bsdf type="mine"/>')).text


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
    found = read_mitsuba(written(folder, body))
    assert set(found.files) == named
    text = as_loaded(found).findall("integrator")[1].find("string").get("value")
    assert text == (str(folder / value) if named else value)


BAD = {
    '<integrator type="path"><string name="table" value="../outside.ply"/></integrator>': "in the scene's folder",
    "<shape>": "mismatched tag",
    '<float name="a" value="$x"/>': "<default>",
    '<shape type="ply"><string name="filename" value="no.ply"/></shape>': "none there",
    '<shape type="ply"><string name="filename" value="../outside.ply"/></shape>': "in the scene's folder",
    '<shape type="ply"><string name="filename" value="link.ply"/></shape>': "in the scene's folder",
    '<include filename="/etc/hostname"/>': "in the scene's folder",
    '<path value=".."/>': "in the scene's folder",
    '<include filename="scene.xml"/>': "includes, 15 deep",
    '<float name="a" value="$x"/><default name="x" value="1"/>': "a <default> before it",
    '<include filename="many.xml"/>': "at most 1000 includes",
    "<bsdf>" * 3000 + "</bsdf>" * 3000: "elements at most 100 deep",
    "<default name='a0' value='xx'/>" + "".join(f"<default name='a{i + 1}' value='$a{i}$a{i}'/>" for i in range(60)):
        "at most 64 MB of XML",
    "<default name='a' value='" + 2**17 * "x" + "'/>" + 600 * "<float name='b' value='$a'/>": "at most 64 MB of XML",
    '<include filename="big.xml"/>' * 9: "at most 64 MB of XML",
    '<emitter type="area"><spectrum name="radiance" type="evil"/></emitter>': "a plugin of Mitsuba's",
    '<shape type="../evil"/>': "a plugin of Mitsuba's",
    '<default name="t" value="evil"/><bsdf type="$t" id="a"/><alias id="a" as="b"/><ref id="b"/>':
        "a plugin of Mitsuba's",
    '<include filename="parts/evil.xml"/>': "a plugin of Mitsuba's",
    '<include filename="parts/up.xml"/>': "in the scene's folder",
    '<include filename="parts/bare.xml"/>': "whose outermost element is <scene>",
}  # fmt: skip


@pytest.mark.parametrize("body", BAD)
def test_what_is_wrong_with_a_file_is_said_in_one_line(folder, body):
    (folder / "link.ply").symlink_to(folder.parent / "outside.ply")
    (folder / "many.xml").write_text("<scene>" + '<include filename="few.xml"/>' * 40 + "</scene>")
    (folder / "few.xml").write_text("<scene>" + '<include filename="none.xml"/>' * 40 + "</scene>")
    (folder / "none.xml").write_text("<scene/>")
    (folder / "big.xml").write_text(f"<scene><!--{' ' * (1 << 23)}--></scene>")
    (folder / "parts" / "evil.xml").write_text('<medium version="3.0.0" type="evil"/>')
    (folder / "parts" / "up.xml").write_text('<scene><include filename="../../outside.ply"/></scene>')
    (folder / "parts" / "bare.xml").write_text('<default version="3.0.0" name="a" value="1"/>')
    with pytest.raises(InputError, match=BAD[body]) as told:
        read_mitsuba(written(folder, body))
    assert ".xml" in str(told.value)
    assert "\n" not in str(told.value)
    assert len(str(told.value)) < 500


@pytest.mark.parametrize(
    ("head", "said"),
    [("", "no <sensor>")]
    + [(HEAD.replace("$w", width), "pixels, from 1 to 100000") for width in ("-1", "1e9", "9" * 5000)]
    + [(HEAD.replace("</film>", CROP.format(x=x, w=w)), "a window inside the film") for x, w in ((0, 13), (6, 7))],
)
def test_a_scene_without_a_camera_or_size_is_refused(folder, head, said):
    with pytest.raises(InputError, match=said):
        read_mitsuba(written(folder, head=head))


def test_entities_are_refused_before_they_are_expanded(folder):
    (folder / "scene.xml").write_text('<!DOCTYPE a [<!ENTITY x "y">]><scene>&x;</scene>')
    with pytest.raises(InputError, match="DOCTYPE"):
        read_mitsuba(folder)


def test_a_file_elsewhere_may_be_allowed_by_name(folder, monkeypatch):
    monkeypatch.setenv(ALLOW, str(folder.parent / "outside.ply"))
    body = '<shape type="ply"><string name="filename" value="../outside.ply"/></shape>'
    assert set(read_mitsuba(written(folder, body)).files) == {"../outside.ply"}


def test_a_command_that_needs_raytwins_own_scene_says_so(folder):
    with pytest.raises(InputError, match=r"a scene\.toml.*got XML"):
        read_scene(written(folder))


def test_four_times_the_shapes_and_parameters_take_four_times_the_calls_to_read(folder):
    counts = []
    for count in (25, 100):
        pot = '<shape type="ply"><string name="filename" value="parts/pot.ply"/></shape>'
        body = "".join(f'<default name="p{i}" value="{i}"/>{pot}' for i in range(count))
        file = written(folder, body)
        read_mitsuba(file)
        counts.append(calls(lambda file=file: read_mitsuba(file)))
    assert counts[1] / counts[0] < 4.5


def test_a_file_that_many_shapes_share_is_read_once(folder, monkeypatch):
    read, content = [], mitsuba_file._content
    monkeypatch.setattr(mitsuba_file, "_content", lambda file, *kind: (read.append(file.name), content(file, *kind))[1])
    body = '<shape type="ply"><string name="filename" value="parts/pot.ply"/></shape>' * 20
    assert len(read_mitsuba(written(folder, body)).names) == 20
    assert read.count("pot.ply") == 1
