import numpy as np
import pytest
from scene_of import changed, small
from tracers_by_students import CORRECT, MISTAKES, mistaken, run

from raytwin.explain import draw_scene
from raytwin.explain.catalogue import ACNE, AVERAGED, FAULTS
from raytwin.explain.changes import FAULT_STAGES
from raytwin.explain.diagnosis import SPECKLED_FROM, Cause, diagnose, explain
from raytwin.explain.localize import whereabouts
from raytwin.explain.pixel_sample import SubmittedImage, mixed, sample_pixels
from raytwin.explain.predict import NO_MISTAKE, predictor
from raytwin.explain.search import Hypothesis, ranked
from raytwin.images.image import Image
from raytwin.images.photo_files import srgb_decode, srgb_encode
from raytwin.images.stored_precision import half_code
from raytwin.renderers.scene_exchange import as_arrays
from raytwin.tracer import trace

SIZES = {"eclipse": (80, 60), "overlap": (88, 66), "distorted": (88, 66)}


SCENES = [small(name, size) for name, size in SIZES.items()]
DRAWN = [draw_scene.draw_scene(seed, (60, 44)) for seed in (1, 2)]


def planted(way, scene):
    """The picture of a tracer with this fault."""
    made = predictor(scene)
    made.brightest = 1.0
    return made.picture(way).reshape(scene.camera.height, scene.camera.width, 3)


def fault(name):
    return next(f for f in FAULTS if f.name == name)


def names(diagnosis):
    return [diagnosis.cause.name] if diagnosis.cause else []


def views(pictures):
    return [SubmittedImage(scene, picture) for scene, picture in zip(SCENES, pictures, strict=False)]


def test_the_catalogue_has_its_faults_each_under_its_own_name_and_stage():
    assert len({f.name for f in FAULTS}) == len(FAULTS) >= 60
    assert {f.stage for f in FAULTS} <= set(FAULT_STAGES)
    assert all((f.ways or f.alone) and f.sentence for f in FAULTS)


ALIKE = {
    "half-pixel": (SCENES, {"half-pixel"}),
    "sky-missing": (SCENES, {"sky-missing"}),
    "nothing-met": (SCENES[:2], {"nothing-met"}),
    "last-wins": (SCENES[1:2], {"last-wins", "planes-on-top"}),  # there the plane is the last object tested
    "no-spheres": (DRAWN[:1], {"no-spheres", "factor-in-quadratic"}),
    "light-reversed-in-shading": (DRAWN[:1], {"all-normals-inward", "light-reversed-in-shading"}),
    AVERAGED[0].name: (DRAWN, {AVERAGED[0].name}),
}
"""A fault that is planted alone -> the scenes, and the faults that give the same pictures of them."""


@pytest.mark.nightly
@pytest.mark.parametrize("name", ALIKE)
def test_a_fault_that_is_planted_alone_is_proved_or_told_beside_those_that_give_the_same_pictures(name):
    scenes, expected = ALIKE[name]
    way = (AVERAGED[0] if name == AVERAGED[0].name else fault(name)).ways[0]
    made = diagnose([SubmittedImage(scene, planted(way, scene)) for scene in scenes])
    assert {*names(made), *(cause.name for cause in made.causes)} == expected
    assert made.certainty == ("proved" if len(expected) == 1 else "likely")


FIRST = ("transposed-R", "far-root", "diameter", "first-wins", "normal-inward", "no-clamp", "pi-missing",
         "sky-missing", "no-shadow", "bgr", "upside-down", "acne")  # fmt: skip
CHOSEN = {name: next(m for m in MISTAKES if m[0][0] == name) for name in FIRST}


@pytest.mark.parametrize("name", CHOSEN)
def test_a_students_mistake_is_named(name):
    """measure/named_causes.py has all of them."""
    wanted, text, old, new = CHOSEN[name]
    made = diagnose(views(run(mistaken(text, old, new), [as_arrays(scene) for scene in SCENES[:2]])))
    assert made.cause.name in wanted


@pytest.mark.parametrize("form", [0, 1, 3, 6])
def test_a_tracer_that_is_correct_in_its_own_way_is_not_blamed(form):
    made = diagnose(views(run(mistaken(*CORRECT[form]), [as_arrays(scene) for scene in SCENES[:2]])))
    assert not made.cause


def test_several_rays_a_pixel_are_told():
    scene = SCENES[1]
    corners = [fault("half-pixel").ways[0], NO_MISTAKE, *fault("half-pixel").ways[2:]]
    mean = np.mean([planted(way, scene) for way in corners], axis=0)
    assert names(diagnose([SubmittedImage(scene, mean)])) == ["averaged-from-corner"]


@pytest.mark.nightly
def test_of_two_faults_the_one_that_explains_most_is_named_and_that_something_else_is_wrong_too():
    both = [fault("pi-missing").ways[0], fault("background-black").ways[0]]
    made = diagnose(views([planted((*both[0], *both[1]), scene) for scene in SCENES[:2]]))
    assert names(made) == ["pi-missing"]
    assert made.certainty == "likely"
    assert "something else is wrong, too: wrong only in the background" in made.sentences[-1]


@pytest.mark.parametrize("name", ["first-wins", "wrong-eye"])
@pytest.mark.parametrize("composed", [True, False])
def test_points_that_are_composed_say_nothing_of_the_order_and_the_eye(composed, name):
    """There both are ours: correct points speak against such a mistake in the submission's own functions alone."""
    camera = SCENES[1].camera
    right = predictor(changed(SCENES[1], objects=SCENES[1].spheres)).points()
    sample = sample_pixels(
        SubmittedImage(SCENES[1], right.reshape(camera.height, camera.width, 3), points=True, composed=composed)
    )
    cost = sample.squared(sample.predict(fault(name).ways[0]))
    assert (cost == 0) == composed


def test_of_one_fault_the_way_that_costs_least_stands_and_of_two_alike_the_usual_one():
    def guess(name, cost, usual):
        return Hypothesis(Cause(name, "", ""), NO_MISTAKE, cost, usual=usual)

    ways = [guess("mirrored", 0.0, False), guess("upside-down", 0.002, True), guess("upside-down", 0.0001, False)]
    found = [(g.cause.name, g.cost) for g in ranked(ways, FAULTS, 0.001)]
    assert found == [("upside-down", 0.0001), ("mirrored", 0.0), ("upside-down", 0.002)]
    ways.append(guess("mirrored", 0.0003, True))
    assert ranked(ways, FAULTS, 0.001)[0].cause.name == "mirrored"


def test_of_few_wrong_pixels_it_is_said_where_they_are():
    sample = sample_pixels(SubmittedImage(SCENES[0], trace(SCENES[0]).mean)).everywhere(10_000)
    errors = np.where(np.arange(sample.index.size) == 2400, 1.0, 0.0)
    sample.weight *= 1e-3
    assert whereabouts([sample], [errors]).startswith("wrong in single pixels (0.021 %), most ")


def test_eight_bits_hide_no_cause():
    scene = SCENES[1]
    code = np.rint(srgb_encode(planted(fault("pi-twice").ways[0], scene)) * 255) / 255
    shown = srgb_decode(code)
    made = diagnose([SubmittedImage(scene, shown, half=half_code(shown), clipped=True)])
    assert names(made) == ["pi-twice"]


@pytest.mark.nightly
def test_where_nothing_explains_it_is_said_where_it_is_wrong():
    pictures = [trace(scene).mean.copy() for scene in SCENES[:2]]
    rng = np.random.default_rng(1)
    seen = predictor(SCENES[0]).seen().ids.reshape(60, 80)
    on = np.isin(seen, [0, 1])
    pictures[0][on] *= rng.uniform(0.5, 1.5, (on.sum(), 1)).astype(np.float32)
    made = diagnose(views(pictures))
    assert not made.cause
    assert made.findings[0].reason.startswith("cause unknown: wrong only on spheres, correct elsewhere")
    assert "all of overlap is correct" in made.findings[0].reason


def test_points_are_told_from_the_points_that_a_fault_would_give():
    scene = SCENES[1]
    balls = changed(scene, objects=scene.spheres)
    shown = predictor(balls).points(fault("t-along-z").ways[0]).reshape(66, 88, 3)
    assert names(diagnose([SubmittedImage(scene, shown, points=True)])) == ["t-along-z"]


@pytest.mark.nightly
def test_nan_an_empty_scene_and_a_black_picture_are_no_obstacle():
    scene = SCENES[0]
    shown = trace(scene).mean.copy()
    shown[20:30, 20:30] = np.nan
    assert diagnose([SubmittedImage(scene, shown)]).certainty != "correct"
    empty = changed(scene, objects=())
    assert names(diagnose([SubmittedImage(empty, 2 * trace(empty).mean)]))
    assert names(diagnose([SubmittedImage(scene, 0 * trace(scene).mean)])) == ["empty"]


P = np.random.default_rng(2).random((40, 50, 3))
APPEARANCE = {
    "mirrored left to right": P[:, ::-1], "upside down": P[::-1], "half a turn": P[::-1, ::-1],
    "red and blue are swapped": P[..., ::-1], "encoded for display (gamma)": P ** (1 / 2.2),
    "decoded once too often": P**2.2, "too dark by a factor of 3.142 = π": P / np.pi,
    "3.142 = π times too bright": P * np.pi, "1.3 times too bright": P * 1.3, "0.2 is added": P + 0.2,
}  # fmt: skip


def test_of_an_unknown_scene_what_a_writer_of_pictures_does_wrong_is_named():
    for name, picture in APPEARANCE.items():
        assert name in explain(Image(np.ascontiguousarray(picture)), Image(P))[0].reason


def test_of_an_unknown_scene_an_error_without_such_a_cause_gets_no_words():
    t = P.copy()
    t[20:30, 20:30] = 0
    assert explain(Image(t), Image(P)) == ()
    assert explain(Image(P + 0.1 * np.random.default_rng(3).random(P.shape)), Image(P)) == ()
    assert explain(Image(P[:, :20]), Image(P)) == ()


def test_pixels_that_are_wrong_by_chance_are_speckled_and_regions_are_not():
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(np.arange(120), np.arange(90))
    for share in (0.01, 0.1, 0.5, 0.9):
        disc = (x - 60) ** 2 + (y - 45) ** 2 < share * 120 * 90 / np.pi
        assert mixed(disc) < SPECKLED_FROM < mixed(rng.random(disc.shape) < share)
        assert mixed(disc | (rng.random(disc.shape) < 0.05)) > SPECKLED_FROM


@pytest.mark.nightly
def test_a_row_and_a_column_that_are_left_out_are_named_and_no_others():
    made = []
    for inner in (0, 1):
        pictures = [planted(NO_MISTAKE, scene) for scene in SCENES[:2]]
        for picture in pictures:
            picture[-1], picture[:, -1] = 0, 0
            picture[-1 - inner, :30] = 0
        made.append(diagnose(views(pictures)))
    assert names(made[0]) == ["border-alone"]
    assert made[0].sentences[0].startswith("only the last row and the last column of the image are wrong")
    assert names(made[1]) != ["border-alone"]


def test_acne_that_darkens_most_of_a_table_is_named_and_nothing_is_searched(monkeypatch):
    """Points in single precision, tested for shadows at t > 0: nearly all of the table, and half of the spheres."""
    monkeypatch.delattr("raytwin.explain.diagnosis.Search")
    scene = small("distorted", SIZES["distorted"])
    right = trace(scene, "shadow").mean
    dark = planted(ACNE.ways[1], scene)
    rng = np.random.default_rng(3)
    spoilt = np.where((rng.random(right.shape[:2]) < 0.85)[..., None], dark, right)
    found = diagnose([SubmittedImage(scene, spoilt, right)])
    assert names(found) == ["acne"]
