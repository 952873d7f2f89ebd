"""A sampler is judged by the density that it draws: correct maps pass, and mistakes are named by what they draw."""

import numpy as np
import pytest
from correct_samplers import CORRECT, PLAIN

import raytwin
from raytwin.errors import InputError
from raytwin.show.sampler_page import density_maps
from raytwin.teach.contract.check_function import judge, judge_function
from raytwin.teach.contract.loading import arrays_of
from raytwin.teach.contract.stage_table import LESSONS
from raytwin.teach.contract.stages.samplers import SAMPLERS, Drawn, faults


def test_a_correct_sampler_passes_whatever_its_formula():
    """At a stated rate of 1e-6 per case, eleven samplers by 10 seeds of two cases alarm in one of 4500 runs."""
    wrong = [(name, seed) for name, (stage, sampler) in CORRECT.items() for seed in range(10)
             if not judge_function(LESSONS[stage], sampler, seed).passed]  # fmt: skip
    assert wrong == []


@pytest.mark.parametrize("name", SAMPLERS)
def test_each_way_of_each_mistake_fails_and_is_named(name):
    """Each way is drawn with its numbers swapped, which no other form of the textbook does."""
    stage = LESSONS[name]
    cases = stage.cases(5)
    assert len(faults(name)) >= 10
    for fault, sentence, ways in faults(name):
        for way in ways:
            found = judge(stage, cases, [arrays_of(way(c.args[0][:, ::-1], *c.args[1:])) for c in cases])
            assert (found.passed, found.causes, found.sentence) == (False, (fault,), sentence), fault


def test_what_no_mistake_predicts_has_its_numbers_instead_of_a_name():
    draw, stage = PLAIN["sample_cosine"], LESSONS["sample_cosine"]

    def too_large(u):
        directions, pdf, weight = draw(u)
        return directions, 1.1 * pdf, weight

    for wrong, said in (
        (lambda u: draw(u ** [1.1, 1.0]), "chi-square p "), (too_large, "the pdf integrates to 1.1"),
        (lambda u: draw(u[:, [0, 0]]), "no single common mistake fits"),
        (lambda u: (-draw(u)[0], u[:, 0], u[:, 1]), "the pdf integrates to nan"),
        (lambda u: tuple(np.nan * a for a in draw(u)), "no single common mistake fits"),
        (lambda u: draw(u)[0], "it returned an array"),
    ):  # fmt: skip
        found = judge_function(stage, wrong)
        assert (found.passed, found.causes, said in found.sentence) == (False, (), True), found.sentence
    assert "not unit" in judge_function(stage, lambda u: (2 * u[:, [0, 0, 1]], u[:, 0], u[:, 1])).causes
    # A pdf is named whichever pdf the weight is of.
    flat = judge_function(stage, lambda u: (draw(u)[0], np.full(len(u), 1 / np.pi), draw(u)[2]))
    assert (flat.causes, flat.sureness) == (("cosine missing in the pdf",), "proved")


def test_the_numbers_that_are_told_are_the_known_ones():
    """The weight is 2 cos θ, of variance 4 / 3 - 1: 16384 draws are within 0.02. Twice the pdf integrates to 2."""
    (case, _) = LESSONS["sample_hemisphere"].cases(0)
    directions, pdf, weight = PLAIN["sample_hemisphere"](*case.args)
    drawn = Drawn(SAMPLERS["sample_hemisphere"], case, (directions, 2 * pdf, weight))
    assert drawn.integral() == pytest.approx(2, abs=1e-9)
    assert drawn.variance() == pytest.approx(1 / 3, abs=0.02)
    assert 1e-6 < drawn.p_value(SAMPLERS["sample_hemisphere"]) < 1


def test_pictures_have_the_density_per_steradian():
    """16384 draws have a mean density within 0.8 %: 5 % are six of it."""
    for name, sampler in PLAIN.items():
        for case in LESSONS[name].cases(1):
            maps = density_maps(Drawn(SAMPLERS[name], case, sampler(*case.args)), case)
            drawn, claimed, asked = (image.mean[..., 0] for image in maps.values())
            assert drawn.mean() == pytest.approx(asked.mean(), rel=0.05), (name, case.shows)
            assert claimed[24, 24] == pytest.approx(asked[24, 24], rel=0.05)


def test_a_page_shows_what_is_drawn_beside_what_is_claimed(tmp_path, monkeypatch):
    page = tmp_path / "sampler.html"
    raytwin.check("sample_cosine", lambda u: PLAIN["sample_hemisphere"](u), hints=0, page=page)
    text = page.read_text(encoding="utf-8")
    assert "even over the hemisphere" in text
    assert all(f'"numbers at random: {key}"' in text for key in ("drawn", "claimed", "asked for"))
    with pytest.raises(InputError, match="sampler: expected one of sample_cosine"):
        raytwin.check("shade", LESSONS["shade"].reference, page=page)
    with pytest.raises(InputError, match="sample_cosine: expected arrays"):
        raytwin.check("sample_cosine", lambda u: u, hints=0, page=page)
