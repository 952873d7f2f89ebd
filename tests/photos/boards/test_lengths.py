import pytest

from raytwin.errors import InputError
from raytwin.photos.boards.lengths import parse_length


def test_a_length_is_the_number_that_is_written_in_metres_and_any_other_text_is_refused(subtests):
    for text, metres in (
        ("30mm", 0.03), ("3 cm", 0.03), (".03m", 0.03), ("0.8in", 0.02032), ("0.8 IN", 0.02032), (" 1.mm ", 0.001),
    ):  # fmt: skip
        assert parse_length(text, "--tag") == metres, text
    assert parse_length("0mm", "--stand", zero=True) == 0
    for text in ("30", "", "mm", "-3mm", "0mm", "nanmm", "infin", "1e3mm", "3mm3mm", "30px", "1,5cm", "٣mm", "9" * 99):
        with subtests.test(text), pytest.raises(InputError, match=r"^--tag: expected a length with its unit"):
            parse_length(text, "--tag")
