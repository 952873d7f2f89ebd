import pytest
from hypothesis import given
from hypothesis import strategies as st

from raytwin.errors import InputError
from raytwin.photos.boards.lengths import LONGEST, parse_length, parse_paper


@pytest.mark.parametrize(
    ("text", "metres"),
    [("30mm", 0.03), ("3 cm", 0.03), (".03m", 0.03), ("0.8in", 0.02032), ("0.8 INCH", 0.02032), (" 1.mm ", 0.001)],
)
def test_a_length_is_the_double_nearest_to_what_is_written(text, metres):
    assert parse_length(text, "--tag") == metres


@pytest.mark.parametrize(
    "text",
    ["30", "", "mm", "-3mm", "0mm", "nanmm", "infin", "1e3mm", "3mm3mm", "30px", "1,5cm", "٣mm", "6m", "9" * 99 + "mm"],
)
def test_what_is_no_length_is_refused(text):
    with pytest.raises(InputError) as error:
        parse_length(text, "--tag")
    assert error.value.where == "--tag"


@given(st.text(max_size=30))
def test_any_text_is_in_range_or_refused(text):
    for parse in (lambda: [parse_length(text, "--tag")], lambda: parse_paper(text, "--paper")):
        try:
            found = parse()
        except InputError:
            continue
        assert all(0 < metres <= LONGEST for metres in found)


def test_papers_have_their_standard_sizes():
    assert parse_paper("A4", "--paper") == (0.21, 0.297)
    assert parse_paper("letter", "--paper") == (0.2159, 0.2794)
    assert parse_paper("legal", "--paper") == (0.2159, 0.3556)
    assert parse_paper("tabloid", "--paper") == (0.2794, 0.4318)
    assert parse_paper("20cm x 12in", "--paper") == (0.2, 0.3048)


@pytest.mark.parametrize("text", ["b5", "200x300", "200mm", "200mmx", "x", "200mmx300mmx400mm", "0mmx3mm"])
def test_what_is_no_paper_is_refused(text):
    with pytest.raises(InputError):
        parse_paper(text, "--paper")


def test_the_longest_length_is_a_length_and_nought_is_one_where_allowed():
    assert parse_length(f"{LONGEST:g}m", "--tag") == LONGEST
    assert parse_length("0mm", "--margin", zero=True) == 0
    with pytest.raises(InputError, match=r"--tag: expected more than 0 to 5 m, got 0mm"):
        parse_length(" 0mm", "--tag")
    with pytest.raises(InputError, match=r"--margin: expected 0 to 5 m, got 5.001m"):
        parse_length("5.001m", "--margin", zero=True)
