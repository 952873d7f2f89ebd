"""The page of light levels: the recommendation in words, any two of its pictures, and its chart."""

import msgspec
import numpy as np

from raytwin.images.image import Image
from raytwin.show.levels_page import answer, error_chart, levels_summary, words, write_levels
from raytwin.study.levels import Levels, Part, Row, Table

SIZE = 24, 32
FILL = Row("fill", "tracer", "none", None, "center", 1, 0.0, 1e-5, 0.2, 0.2)
SHADOW = Row("drjit32-shadow-conic", "tracer", "shadow", None, "center", 1, 1.5, 0.002, 0.0144, 0.0145)
PATH = Row("drjit32-path-depth4-16", "tracer", "path", 4, "area", 16, 35.0, 0.03, 0.0076, 0.0079)
TWIN = Row("twin-llvm-path-16", "twin", "path", 8, "area", 16, 36.0, 0.3, 0.0074, 0.0077)
PARTS = (
    Part("all bounces", 0.0184, 0.0185, 0.0276, False),
    Part("bounces beyond 1", 0.0074, 0.0075, 0.0086, True),
    Part("bounces beyond 2", 0.0015, 0.0016, 0.0013, True),
    Part("shadows of the sun", 0.003, 0.003, 0.02, True),
)
FOUND = Table("made <up>", *SIZE[::-1], "rmse", 0.01, PATH, "", (FILL, SHADOW, PATH, TWIN), PARTS, 256, 8e-4, 3.0)


def test_any_two_pictures_are_shown_to_eleven_bits_by_button_and_by_key(browse, tmp_path):
    """A digit chooses the first picture, with shift the second: anywhere but in a field that takes digits."""
    rng = np.random.default_rng(3)
    names = "tracer: shadow", "twin: path", "reference: all light"
    images = {name: Image(rng.uniform(0.1, 0.9, (*SIZE, 3)).astype(np.float32)) for name in names}
    write_levels(Levels(FOUND, images), tmp_path)
    script = """
      const shown = () => root.dataset.shown, press = (on, code, shiftKey) =>
        on.dispatchEvent(new KeyboardEvent("keydown", { code, key: code.at(-1), shiftKey, bubbles: true }));
      await until(shown);
      result.first = shown();
      [...document.querySelectorAll('[data-picture="B"]')].find((b) => b.textContent === "twin: path").click();
      await until(() => shown() === "tracer: shadow | twin: path");
      const here = viewer.read(7, 5);
      for (const [key, name] of [["a", "test"], ["b", "reference"]]) result[key] = here[name].map(([v]) => v);
      result.d = [0, 1, 2].map((c) => viewer.values.d[3 * (5 * 32 + 7) + c]);
      result.text = document.body.innerText;
      press(document.body, "Digit2", false);
      press(document.querySelector("#viewer canvas"), "Digit1", true);
      await until(() => shown() === "twin: path | tracer: shadow");
      press(document.querySelector("#viewer input"), "Digit3", false);
      press(document.body, "Digit9", false);
      result.keyed = [shown(), viewer.state.mode];
      result.pressed = document.querySelectorAll('[data-picture][aria-pressed="true"]').length;"""
    read, console = browse(tmp_path / "levels.html", "", script)
    assert console == []
    assert read["first"] == "tracer: shadow | reference: all light"
    a, b = (images[name].mean[5, 7] for name in ("tracer: shadow", "twin: path"))
    np.testing.assert_allclose(read["a"], a, rtol=2**-11)
    np.testing.assert_allclose(read["b"], b, rtol=2**-11)
    np.testing.assert_allclose(read["d"], a - b, atol=2**-11)
    assert read["keyed"] == ["twin: path | tracer: shadow", "grid"]
    assert read["pressed"] == 2
    assert read["text"].index("Cheapest with rmse <= 0.01") < read["text"].index("4 methods")
    assert "+2.76 %" in read["text"]
    assert {p.name for p in tmp_path.iterdir()} == {"levels.html", "levels.json", "levels.svg"}


def test_the_recommendation_names_the_choice_the_next_cheaper_one_and_what_can_be_dropped():
    assert answer(FOUND) == [
        "Cheapest with rmse <= 0.01: light with at most 2 bounces, 16 samples per pixel (drjit32-path-depth4-16).",
        "Its rmse is 0.0076.",
        "It costs 35 rays per pixel, shadow rays included.",
        "The next cheaper, drjit32-shadow-conic, has 0.014, which exceeds it.",
        "Any one of these can be left out and rmse <= 0.01 still holds: bounces beyond 1, shadows of the sun.",
    ]
    tied = msgspec.structs.replace(SHADOW, error=0.0099, error_most=0.0102)
    told = answer(msgspec.structs.replace(FOUND, rows=(FILL, tied, PATH, TWIN)))
    assert told[3] == "The next cheaper, drjit32-shadow-conic, has 0.0099, which cannot be told from it."
    single = msgspec.structs.replace(PATH, rays=1.0)
    told = answer(msgspec.structs.replace(FOUND, rows=(FILL, single), choice=single))
    assert told[2] == "It costs 1 ray per pixel, shadow rays included."


def test_no_recommendation_says_why_and_no_tolerance_how_to_get_one():
    failed = msgspec.structs.replace(FOUND, choice=None, reason="no method meets it")
    assert answer(failed) == ["No method is recommended for rmse <= 0.01: no method meets it."]
    assert "--tolerance T" in answer(msgspec.structs.replace(FOUND, choice=None, tolerance=None))[-1]


def test_a_method_is_described_in_words():
    for row, said in (
        (FILL, "the background alone"),
        (SHADOW, "cast shadows of the sun, sky without occlusion, one ray per pixel"),
        (TWIN, "light with at most 6 bounces, 16 samples per pixel (Mitsuba)"),
        (msgspec.structs.replace(PATH, depth=3, samples=1), "light with at most 1 bounce, 1 sample per pixel"),
    ):
        assert words(row) == said


def test_the_summary_has_a_line_per_method_and_part_and_the_chart_a_point_and_both_mark_the_choice():
    lines, chart = levels_summary(FOUND).splitlines(), error_chart(FOUND)
    assert [line.split()[-1] for line in lines if line.startswith("*")] == ["drjit32-path-depth4-16"]
    assert any("2.0 ms" in line and "0.0144" in line and line.endswith("drjit32-shadow-conic") for line in lines)
    assert any("+2 %" in line and line.endswith("shadows of the sun") for line in lines)
    assert {(p.x, p.y) for p in chart.points} == {(1.5, 0.0144), (35.0, 0.0076), (36.0, 0.0074)}  # not the fill's 0
    assert [p.name for p in chart.points if p.strong] == ["drjit32-path-depth4-16"]
