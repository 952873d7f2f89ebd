"""Tags kept between runs: the same as found anew, never stale, never taken from a file that no detector wrote."""

import json
import os

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


def test_a_photo_of_the_same_bytes_is_searched_once_and_its_tags_are_the_same_to_the_last_bit(photo, searched):
    first = detect_photo_once(photo, KIND)
    copy = photo.with_name("copy.png")
    copy.write_bytes(photo.read_bytes())
    assert [t.id for t in first] == [0, 1, 2, 3]
    assert detect_photo_once(copy, KIND) == first == tag_cache.detection.detect_photo(photo, KIND)
    assert searched == [photo]


def test_other_bytes_another_kind_of_tag_and_another_detector_are_searched_anew(photo, searched, monkeypatch):
    known = {tag_cache.key_of(photo.read_bytes(), KIND), tag_cache.key_of(photo.read_bytes(), "tag36h11/2")}
    assert len(known) == 2
    detect_photo_once(photo, KIND)
    files.write_picture(photo, files.read_grey(photo)[::-1, ::-1])
    assert detect_photo_once(photo, KIND)[0].center != (0, 0)
    monkeypatch.setattr(files, "made_by", lambda *_: "another")
    detect_photo_once(photo, KIND)
    assert len(searched) == 3


def test_what_no_detector_can_have_written_is_made_anew(photo, searched):
    first = detect_photo_once(photo, KIND)
    file = tag_cache.CACHE.path(tag_cache.key_of(photo.read_bytes(), KIND))
    whole, sound = file.read_bytes(), json.loads(file.read_bytes())
    tag = sound[0]
    crafted = [
        [], [tag, tag], sound[::-1], [tag | {"center": [-1.0, 5.0]}], [tag | {"center": [1.0, 2.0, 3.0]}],
        [tag | {"center": [1.0, 1e5]}], [tag | {"corners": tag["corners"][:3]}], [tag | {"id": -1}], {"id": 0},
        [tag | {"corners": [[0, 0], [0, 1], [1, 1], [1, -2]]}], [tag | {"id": "0"}], [tag | {"center": [None, 1]}],
    ]  # fmt: skip
    damaged = [b"", b"nonsense", whole[:40], b"[" * 100_000, json.dumps([tag | {"center": [float("nan"), 1]}]).encode()]
    damaged += [json.dumps(wrong).encode() for wrong in crafted]
    for n, wrong in enumerate(damaged, start=2):
        file.write_bytes(wrong)
        assert detect_photo_once(photo, KIND) == first, wrong[:80]
        assert len(searched) == n, wrong[:80]
        assert file.read_bytes() == whole


def test_a_pipe_in_the_cache_is_not_waited_for(photo):
    first = detect_photo_once(photo, KIND)
    file = tag_cache.CACHE.path(tag_cache.key_of(photo.read_bytes(), KIND))
    file.unlink()
    os.mkfifo(file)
    assert detect_photo_once(photo, KIND) == first


def test_a_cache_that_cannot_be_written_is_no_error(photo, monkeypatch):
    monkeypatch.setenv("RAYTWIN_CACHE", str(photo))
    assert len(detect_photo_once(photo, KIND)) == 4


def test_photos_that_cannot_be_read_or_show_no_tag_are_told_as_ever(photo):
    files.write_picture(photo, np.full((40, 60), 200, np.uint8))
    with pytest.raises(NoTags, match="none"):
        detect_photo_once(photo, KIND)
    with pytest.raises(InputError, match="no such file"):
        detect_photo_once(photo.with_name("none.png"), KIND)
    photo.write_bytes(b"\x89PNG")
    with pytest.raises(InputError, match="photo"):
        detect_photo_once(photo, KIND)
