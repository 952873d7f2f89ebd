"""Tags kept between runs: the same as found anew, and never stale."""

import numpy as np
import pytest

from raytwin import files
from raytwin.calib.boards.board import Board, Grid, draw_board
from raytwin.calib.photos import NoTags, tag_cache
from raytwin.calib.photos.tag_cache import detect_photo_once
from raytwin.errors import InputError

KIND = "tag36h11"


@pytest.fixture
def photo(tmp_path, monkeypatch):
    """A photo of four tags, and an empty cache."""
    monkeypatch.setenv("RAYTWIN_CACHE", str(tmp_path / "cache"))
    albedo, _ = draw_board(Board(KIND, 0.03, Grid(2, 2, 0.04)), 1500)
    files.write_picture(tmp_path / "photo.png", (albedo * 255).astype(np.uint8))
    return tmp_path / "photo.png"


@pytest.fixture
def searched(monkeypatch):
    """How often a photo was searched."""
    times, search = [], tag_cache.detect_photo
    monkeypatch.setattr(tag_cache, "detect_photo", lambda path, kind: times.append(path) or search(path, kind))
    return times


def test_a_photo_of_the_same_bytes_is_searched_once_and_any_other_anew(photo, searched, monkeypatch):
    first = detect_photo_once(photo, KIND)
    copy = photo.with_name("copy.png")
    copy.write_bytes(photo.read_bytes())
    assert [t.id for t in first] == [0, 1, 2, 3]
    assert detect_photo_once(copy, KIND) == first == tag_cache.detection.detect_photo(photo, KIND)
    assert searched == [photo]
    assert tag_cache.key_of(photo.read_bytes(), KIND) != tag_cache.key_of(photo.read_bytes(), "tag36h11/2")
    files.write_picture(photo, files.read_grey(photo)[::-1, ::-1])
    assert detect_photo_once(photo, KIND) != first
    monkeypatch.setattr(files, "made_by", lambda *_: "another")
    detect_photo_once(photo, KIND)
    assert len(searched) == 3


@pytest.mark.parametrize(
    "damage", [lambda b: b"", lambda b: b[:40], lambda b: b"[]", lambda b: b.replace(b'"id"', b"0")]
)
def test_a_damaged_file_is_made_anew(photo, searched, damage):
    first = detect_photo_once(photo, KIND)
    file = tag_cache.CACHE.path(tag_cache.key_of(photo.read_bytes(), KIND))
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    assert detect_photo_once(photo, KIND) == first
    assert len(searched) == 2
    assert file.read_bytes() == whole


def test_photos_that_cannot_be_read_or_show_no_tag_are_refused_as_without_the_cache(photo):
    files.write_picture(photo, np.full((40, 60), 200, np.uint8))
    with pytest.raises(NoTags, match="no tag that appears once"):
        detect_photo_once(photo, KIND)
    with pytest.raises(InputError, match="no such file"):
        detect_photo_once(photo.with_name("none.png"), KIND)
    photo.write_bytes(b"\x89PNG")
    with pytest.raises(InputError, match="photo"):
        detect_photo_once(photo, KIND)
