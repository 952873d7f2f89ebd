"""Laws without a reference: correct renderers keep them, each can be broken, and those broken name the cause."""

import json
from collections.abc import Callable
from functools import cache

import cv2
import numpy as np
import pytest
from planted_renderers import FAULTS, Planted, camera, light, objects, only, picture, scaled
from program import raytwin
from submitted_tracers import tracer

from raytwin.errors import InputError
from raytwin.fast import trace
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.subject_renderers import PathTraced, Traced
from raytwin.rungs import RUNGS
from raytwin.scene import Environment, Rectangle, Scene, Sphere, Sun
from raytwin.scene.scene_files import read_scene
from raytwin.study.laws import _Trial, builtin_scene, laws
from raytwin.study.rounds import Budget
from raytwin.study.scene_laws import CAUSES, LAWS, Level, placed
from raytwin.teach.contract.subject import find_subject, method

SIZE = (72, 54)
SMALL = builtin_scene().with_(size=SIZE)


def broken(renderer: Renderer, **options) -> list[str]:
    return [row.law for row in laws(renderer, size=SIZE, **options).broken]


def planted(fault: Callable) -> Renderer:
    """A renderer of Scene records without noise."""
    return method(lambda scene: fault(scene, "shadow").mean, rung="shadow", records=True)


# ------------------------------------------------------------------------------------------ correct renderers


@pytest.mark.parametrize("rung", ["lambert", "shadow"])
def test_the_tracer_keeps_every_law_that_holds_at_its_light_level(rung):
    found = laws(Traced(rung), size=SIZE)
    assert (found.verdict, found.exit_code, found.cause) == ("pass", 0, "")
    skipped = [row.law for row in found.rows if row.verdict == "skipped"]
    assert skipped == ([] if RUNGS[rung].shadows else ["covered"])


@pytest.mark.nightly
@pytest.mark.parametrize("rung", ["shadow", "path"])
def test_so_do_other_engines_mitsuba_and_path_tracers(rung, subtests):
    """With these seeds; a correct path tracer breaks a law in 1 run of 1000."""
    names = {
        "shadow": ["numpy32-shadow-conic", "drjit32-shadow-conic", "twin-llvm-shadow"],
        "path": ["drjit32-path-16", "drjit32-sky-16", "twin-llvm-path-16"],
    }
    for name in names[rung]:
        with subtests.test(name):
            assert laws(find_subject(name, rung), size=SIZE).verdict == "pass"


@cache
def exact(scene: Scene) -> np.ndarray:
    return trace(scene, "shadow").mean


def noisy(fault: Callable[[np.ndarray], np.ndarray] = lambda mean: mean) -> Renderer:
    """A renderer with noise of a fifth of each value per sample, for whose mean `fault` is responsible."""

    def render(scene: Scene, samples: int, seed: int) -> np.ndarray:
        noise = np.random.default_rng(seed).exponential(size=(*scene.image_size[::-1], 3)) - 1
        return fault(exact(scene)) * (1 + 0.2 * noise / np.sqrt(samples))

    return method(render, rung="shadow", records=True)


def test_noise_breaks_no_law_and_hides_no_fault():
    """With these seeds; a correct one breaks a law in 1 run of 1000."""
    assert laws(noisy(), size=SIZE).verdict == "pass"
    found = laws(noisy(lambda mean: np.minimum(mean, 0.2)), size=SIZE)
    assert "light doubled" in [row.law for row in found.broken]
    assert "clamp" in found.cause
    assert laws(noisy(), size=SIZE, budget=Budget(samples=4)).verdict == "undecided"


# ------------------------------------------------------------------------------------------ faults


def behind(scene: Scene, rung: str) -> np.ndarray:
    """Objects behind the camera are seen before it, as at a negative distance."""
    eye, forward = np.array(scene.camera.eye), scene.camera.R_cam_board[2]

    def seen(thing):
        away = np.subtract(thing.center, eye)
        return thing if away @ forward > 0 else thing.with_(center=eye - away)

    things = [seen(thing).with_(name=f"thing {i}") for i, thing in enumerate(scene.objects)]
    return trace(scene.with_(objects=things), rung)


def rounded(thing: Sphere | Rectangle) -> Sphere | Rectangle:
    return thing.with_(center=np.float32(thing.center).astype(float))


def no_sun_beside_a_sky(scene: Scene, rung: str) -> np.ndarray:
    return trace(scene.with_(sun=None) if any(scene.sky_radiance) else scene, rung)


BREAKS = {
    "frame": FAULTS["planes too wide"],
    "disc": FAULTS["large spheres"],
    "curtain": FAULTS["first over all"],
    "order": FAULTS["one sphere forgotten"],
    "behind the eye": behind,
    "halves": FAULTS["mirrored"],
    "resolution": FAULTS["half a pixel"],
    "rolled": FAULTS["bottom row black"],
    "mirrored": camera(lambda c: c.with_(dist=(*c.dist[:2], *c.dist[3:1:-1], *c.dist[4:]))),
    "turned": FAULTS["spheres too high"],
    "moved": objects(rounded),
    "scaled": objects(only(Sphere, radius=lambda r: r + 1e-3)),
    "black": FAULTS["offset"],
    "sun behind": light(Sun, lambda sun: Sun(tuple(-x for x in sun.to_light), sun.irradiance)),
    "covered": FAULTS["no shadows"],
    "ball": light(Sun, only(Sun, irradiance=scaled(1.001))),
    "furnace": FAULTS["sky twice"],
    "half the albedo": FAULTS["albedo squared"],
    "light doubled": picture(lambda mean: np.minimum(mean, 0.5)),
    "light split": no_sun_beside_a_sky,
    "colours": FAULTS["red and blue exchanged"],
}
"""Law -> a renderer that breaks it."""


def test_each_law_is_broken_by_a_renderer_that_errs_so_and_by_no_other_engine(subtests):
    level = Level(RUNGS["shadow"], "center", noisy=False)
    assert set(LAWS) == set(BREAKS)
    for name, fault in BREAKS.items():
        with subtests.test(name):
            pair = LAWS[name].views(SMALL, level)
            *_, wrong = _Trial(planted(fault), SMALL, Budget()).decide(*pair)
            *_, right = _Trial(Traced("shadow"), SMALL, Budget()).decide(*pair)
            assert (wrong.verdict, right.verdict) == ("fail", "pass")


def test_laws_that_break_together_name_the_cause(subtests):
    wanted = {
        "half a pixel": "half a pixel", "offset": "no source", "sky twice": "sky", "one sphere forgotten": "left out",
        "sun from below": "wrong sign", "not a number": "NaN",
    }  # fmt: skip
    for name, words in wanted.items():
        with subtests.test(name):
            assert words in laws(Planted("shadow", name), size=SIZE).cause
    assert {law for together in CAUSES for law in together} <= set(LAWS)


def test_a_renderer_of_spheres_alone_is_told_so_and_can_be_judged_without_planes():
    spheres = planted(lambda scene, rung: trace(scene.with_(objects=scene.spheres), rung))
    assert "--without planes" in laws(spheres, size=SIZE).cause
    found = laws(spheres, size=SIZE, without="planes")
    assert found.verdict == "pass"
    skipped = {row.law: row.reasons for row in found.rows if row.verdict == "skipped"}
    assert skipped == dict.fromkeys(("frame", "curtain"), ("the renderer has no rectangles",))
    for fault, law in ((FAULTS["no shadows"], "covered"), (FAULTS["twice as bright"], "ball")):
        wrong = planted(lambda scene, rung, fault=fault: fault(scene.with_(objects=scene.spheres), rung))
        assert law in broken(wrong, without="planes")
    with pytest.raises(InputError, match="--without: expected one of planes"):
        laws(spheres, size=SIZE, without="spheres")


def test_a_renderer_that_ends_in_a_changed_scene_breaks_its_law():
    def fragile(scene: Scene) -> np.ndarray:
        if len(scene.planes) == 3:
            raise ZeroDivisionError("curtain")
        return exact(scene)

    found = laws(method(fragile, rung="shadow", records=True), size=SIZE)
    assert {row.law for row in found.broken} == {"curtain"}
    assert "ZeroDivisionError: curtain" in found.broken[0].reasons[0]


def test_a_picture_of_one_colour_is_judged_by_no_law():
    blank = method(lambda scene: np.full((scene["height"], scene["width"], 3), 0.5), rung="shadow")
    assert broken(blank) == ["picture"]
    elsewhere = SMALL.with_(objects=[Sphere((0.0, 0.0, -1e4), 1.0)])
    assert laws(blank, elsewhere).verdict == "undecided"  # perhaps nothing is in view


# ------------------------------------------------------------------------------------------ where laws hold


def test_laws_that_do_not_hold_are_skipped_with_the_reason():
    found = laws(PathTraced("path", "numpy32", samples=4), size=(25, 18), budget=Budget(samples=1))
    reasons = {row.law: row.reasons[0] for row in found.rows if row.verdict == "skipped"}
    assert reasons == {
        "disc": "pixels of the outline hold a part of each",
        "behind the eye": "what stands behind the camera hides sky there",
        "resolution": "25 x 18 pixels cannot be divided by 3",
        "half the albedo": "bounced light is not proportional to the albedo",
    }


def test_a_scene_or_a_renderer_without_laws_is_refused(tmp_path, subtests):
    map_ = Environment((4, 2), np.ones((2, 4, 3), "<f4").tobytes())
    grey = tmp_path / "grey.pfm"
    grey.write_bytes(b"PF\n1 1\n-1.0\n" + np.ones(3, "<f4").tobytes())
    shiny = SMALL.spheres[2].with_(specular=(0.1, 0.1, 0.1), exponent=9.0)
    cases = {
        "scene of a renderer": (find_subject(str(grey), "shadow"), SMALL),
        "light level": (Traced("surface"), SMALL),
        "same radiance": (Traced("shadow"), SMALL.with_(sky=map_)),
        "highlight": (Traced("shadow"), SMALL.with_(objects=[shiny])),
        "objects": (Traced("shadow"), SMALL.with_(objects=[])),
    }  # fmt: skip
    for name, (subject, scene) in cases.items():
        with subtests.test(name), pytest.raises(InputError):
            laws(subject, scene)


@pytest.mark.parametrize("flips", [(1, 1), (-1, -1), (-1, 1)])
def test_a_placed_scene_is_seen_where_opencv_projects_it(flips):
    """What is at pixel (u, v) stays there, or moves to the other side of a flipped axis."""
    scene = read_scene("distorted")
    mirror = np.diag([flips[0] * flips[1], 1.0, 1.0])
    turn = cv2.Rodrigues(np.array([0.3, -1.1, 0.7]))[0]
    A, d = 0.2 * turn @ mirror, np.array([3.0, -5.0, 8.0])
    points = np.random.default_rng(1).uniform(-0.1, 0.1, (50, 3))
    cameras = scene.camera, placed(scene, A, d, flips).camera
    seen = []
    for one, where in zip(cameras, (points, points @ A.T + d), strict=True):
        R, *others = (np.array(x) for x in (one.R_cam_board, one.t_cam_board, one.K, one.dist))
        pixels, _ = cv2.projectPoints(where, cv2.Rodrigues(R)[0], *others)
        seen.append(pixels[:, 0])
    for axis, flip in enumerate(flips):
        side = scene.image_size[axis] - 1
        np.testing.assert_allclose(
            seen[1][:, axis], seen[0][:, axis] if flip > 0 else side - seen[0][:, axis], atol=1e-8
        )


# ------------------------------------------------------------------------------------------ command


def test_the_command_says_the_answer_first_and_writes_page_and_json(tmp_path):
    done = raytwin("laws", "numpy64-lambert-conic", "--size", "48x36", "-o", "out", "--json", "l.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == "PASS  numpy64-lambert-conic, lambert: No law is broken."
    assert lines[1] == "  21 of 21 laws hold; not applicable: 1."
    found = json.loads((tmp_path / "l.json").read_text())
    assert found == json.loads((tmp_path / "out" / "laws.json").read_text())
    assert [row["law"] for row in found["laws"]] == ["picture", *LAWS]
    assert found["verdict"] == "pass"
    page = (tmp_path / "out" / "laws.html").read_text()
    assert page.count("data:image/png") == 3 * 21
    assert "https://" not in page


@pytest.mark.nightly
def test_a_students_file_is_judged_in_a_process_of_its_own(tmp_path):
    (tmp_path / "tracer.py").write_text(tracer("pi"))
    done = raytwin("laws", "tracer.py", "--size", "48x36", "--scene", "overlap", cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    assert done.stdout.startswith("FAIL  tracer.py, shadow: The sun's part is not albedo/π E cos θ.")
    (tmp_path / "tracer.py").write_text(tracer())
    assert raytwin("laws", "tracer.py", "--size", "48x36", cwd=tmp_path).returncode == 0
