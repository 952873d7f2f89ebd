"""A Mitsuba file's render beside closed forms."""

import os
import subprocess
import sys
from itertools import product

import numpy as np
import pytest

from raytwin import twin
from raytwin.errors import InputError
from raytwin.scene.mitsuba_file import read_mitsuba
from raytwin.twin import mitsuba_render

BALL = """<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="6"/></integrator>
<sensor type="perspective"><float name="fov" value="60"/><float name="near_clip" value="0.5"/>
<transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="21"/><integer name="height" value="15"/><rfilter type="box"/></film>
</sensor>
<shape type="sphere" id="ball"><bsdf type="diffuse"><rgb name="reflectance" value="0.8 0.5 0.2"/></bsdf></shape>
<emitter type="constant"><rgb name="radiance" value="2 2 2"/></emitter></scene>"""
FILM = BALL[BALL.index("<film") : BALL.index("</sensor>")]
WALL = BALL.replace('type="sphere"', 'type="cube"')

PATH = '<integrator type="path"/>'
AOV = '<integrator type="aov"><string name="aovs" value="depth:depth,where:position"/>{}</integrator>'
FORMAT = '<rfilter type="box"/><string name="pixel_format" value="{}"/>'
RGB = (2.0, 4.0, 1.0)
GREY = 0.212671 * RGB[0] + 0.715160 * RGB[1] + 0.072169 * RGB[2]


@pytest.fixture
def scene_of(tmp_path):
    """The scene of a file with this text."""
    return lambda text: (tmp_path / "scene.xml").write_text(text) and read_mitsuba(tmp_path)


def test_a_ball_under_an_even_sky_has_its_albedo_times_the_sky_and_is_where_it_is(scene_of):
    image = twin.render_mitsuba(scene_of(BALL), 16)
    surface = image.surface
    inside = np.zeros((15, 21), bool)
    inside[5:10, 8:13] = True
    off = image.mean[inside].mean(axis=0) - [1.6, 1.0, 0.4]  # a convex body's light is a Ls, by the white furnace
    sigma = np.sqrt(image.variance[inside].sum(axis=0)) / inside.sum()
    assert (np.abs(off) < 5 * sigma).all()
    assert (sigma < 0.03).all()
    assert np.allclose(image.mean[0, 0], 2)
    assert (image.samples, image.batches) == (16, 16)
    assert (surface.ids[7, 10], surface.ids[0, 0]) == (0, -1)
    assert surface.depth[7, 10] == pytest.approx(3, rel=1e-6)  # from the eye, not from near_clip
    assert surface.normal[7, 10] == pytest.approx([0, 0, 1], abs=1e-5)
    assert not surface.depth[0, 0]


def test_a_film_of_any_colours_is_linear_rec_709(scene_of, subtests):
    lit, path = BALL.replace("2 2 2", "2 4 1"), BALL[BALL.index("<integrator") : BALL.index("<sensor")]
    around = PATH, AOV.format(2 * PATH), f'<integrator type="moment">{PATH}</integrator>'
    for name, integrator in product(("RGBA", "luminance"), around):
        with subtests.test(f"{name} {integrator}"):
            text = lit.replace('<rfilter type="box"/>', FORMAT.format(name)).replace(path, integrator)
            image = twin.render_mitsuba(scene_of(text), 1)
            assert image.mean[0, 0] == pytest.approx((GREY,) * 3 if name == "luminance" else RGB, rel=1e-4)


def test_plugins_of_the_current_folder_stand_in_for_none_of_mitsubas_own(tmp_path):
    """Neither where a variant is tried, nor where a scene of raytwin's own is loaded."""
    (tmp_path / "plugins").mkdir()
    for name, end in product(("sphere", "constant", "diffuse", "prb"), ("so", "dylib", "dll")):
        (tmp_path / "plugins" / f"{name}.{end}").write_text("what would be run")
    script = """if True:
        from raytwin import twin
        print(twin.activate().variant)
        import mitsuba
        mitsuba.load_dict({"type": "scene", "ball": {"type": "sphere"}})
        """
    run = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, env=os.environ | {"RAYTWIN_CACHE": str(tmp_path / "cache")},
        capture_output=True, text=True,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == [twin.activate().variant]


def test_each_pixels_shape_is_found_by_its_place_among_the_named(scene_of):
    names, balls = [f"ball-{k}" if k % 2 else f"shape-{k}" for k in range(16)], ""
    for k, name in enumerate(names):
        named = f'id="{name}"' if k % 2 else ""
        balls += f'<shape type="sphere" {named}><float name="radius" value="0.4"/>'
        balls += f'<point name="center" x="{k % 4 - 1.5}" y="{k // 4 - 1.5}" z="0"/></shape>'
    scene = scene_of(f"{BALL[: BALL.index('<shape')]}{balls}</scene>")
    assert twin.named_shapes(scene) == tuple(names)
    ids = twin.render_mitsuba(scene, 1).surface.ids
    middle = np.array([np.argwhere(ids == k).mean(axis=0) for k in range(16)]).reshape(4, 4, 2)
    assert (np.diff(middle[..., 0], axis=0) < -1).all()  # y is up
    assert (np.diff(middle[..., 1], axis=1) > 1).all()


def test_batches_share_no_random_number_and_seeds_none_either(scene_of, monkeypatch):
    """The variance that batches tell is the spread between seeds, also of more than were asked for."""
    scene = scene_of(WALL)
    monkeypatch.setattr(mitsuba_render, "LANES", 21 * 15)
    many = [twin.render_mitsuba(scene, 8, seed, 4) for seed in range(20)]
    assert many[0].batches == 8  # none holds more than one launch
    assert np.array_equal(many[0].mean, twin.render_mitsuba(scene, 8, 0, 4).mean)
    spread = np.var([image.mean for image in many], axis=0, ddof=1).mean()
    # Some 900 noisy values of 19 degrees of freedom each: the ratio's standard deviation is below 3 %.
    assert spread == pytest.approx(np.mean([image.variance for image in many]), rel=0.1)
    # Twice the samples: half the variance.
    monkeypatch.undo()
    whole = [twin.render_mitsuba(scene, 16, seed, 4).variance for seed in range(20)]
    assert np.mean(whole) == pytest.approx(spread / 2, rel=0.1)


def test_what_mitsuba_refuses_is_said_in_one_line(scene_of, subtests):
    for old, new, said in (
        ('type="sphere"', 'type="sphre"', "sphre"),
        ('name="fov"', 'name="vof"', "unreferenced property"),
        ('value="0.8 0.5 0.2"', 'value="red"', "red"),
        ('<rfilter type="box"/>', FORMAT.format("xyz"), "a film in RGB or luminance, got XYZ"),
        (FILM, '<ref id="f"/>', "a <film> within its <sensor> that says the size, got 21 x 15"),
    ):
        with subtests.test(said):
            shared = FILM.replace('"hdrfilm"', '"hdrfilm" id="f"') if old == FILM else ""
            with pytest.raises(InputError, match=said) as told:
                twin.render_mitsuba(scene_of(BALL.replace(old, new).replace("<integ", f"{shared}<integ", 1)), 4)
            assert "\n" not in str(told.value)
            assert str(told.value).count("scene.xml") == 1


def test_a_cached_render_is_that_of_the_same_file_alone(scene_of, monkeypatch):
    monkeypatch.setattr("raytwin.twin.render_cache.WORTH_KEEPING", 0.0)
    scene = scene_of(BALL)
    first = twin.render_mitsuba(scene, 4)
    monkeypatch.setattr(mitsuba_render, "_loaded", None)  # it would raise
    assert np.array_equal(first.mean, twin.render_mitsuba(scene, 4).mean)
    with pytest.raises(TypeError, match="not callable"):
        twin.render_mitsuba(scene_of(BALL.replace("0.8", "0.7")), 4)
