import pytest
from hypothesis import given
from hypothesis import strategies as st

from raytwin.errors import InputError
from raytwin.photos.boards.lengths import LONGEST, parse_length, parse_paper


def test_a_length_is_the_double_nearest_to_what_is_written():
    for text, metres in (
        ("30mm", 0.03), ("3 cm", 0.03), (".03m", 0.03), ("0.8in", 0.02032), ("0.8 INCH", 0.02032), (" 1.mm ", 0.001),
        (f"{LONGEST:g}m", LONGEST),
    ):  # fmt: skip
        assert parse_length(text, "--tag") == metres, text
    assert parse_length("0mm", "--bend", zero=True) == 0


def test_papers_have_their_standard_sizes():
    sizes = {
        "A4": (0.21, 0.297), "letter": (0.2159, 0.2794), "legal": (0.2159, 0.3556), "tabloid": (0.2794, 0.4318),
        "20cm x 12in": (0.2, 0.3048),
    }  # fmt: skip
    assert {name: parse_paper(name, "--paper") for name in sizes} == sizes


def test_what_is_no_length_or_paper_is_refused(subtests):
    lengths = ["30", "", "mm", "-3mm", "0mm", "nanmm", "infin", "1e3mm", "3mm3mm", "30px", "1,5cm", "٣mm", "6m"]
    for text in [*lengths, "9" * 99 + "mm"]:
        with subtests.test(text), pytest.raises(InputError, match=r"^--tag: "):
            parse_length(text, "--tag")
    for text in ["b5", "200x300", "200mm", "200mmx", "x", "200mmx300mmx400mm", "0mmx3mm"]:
        with subtests.test(text), pytest.raises(InputError):
            parse_paper(text, "--paper")
    with pytest.raises(InputError, match=r"--tag: expected more than 0 to 5 m, got 0mm"):
        parse_length(" 0mm", "--tag")
    with pytest.raises(InputError, match=r"--bend: expected 0 to 5 m, got 5.001m"):
        parse_length("5.001m", "--bend", zero=True)


@given(st.text(max_size=30))
def test_any_text_is_in_range_or_refused(text):
    for parse in (lambda: [parse_length(text, "--tag")], lambda: parse_paper(text, "--paper")):
        try:
            found = parse()
        except InputError:
            continue
        assert all(0 < metres <= LONGEST for metres in found)
