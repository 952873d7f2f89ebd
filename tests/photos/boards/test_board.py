import pickle

import msgspec
import numpy as np
import pytest

from raytwin.errors import InputError
from raytwin.photos.boards.board import (
    INK,
    PAPER,
    Board,
    BoardTag,
    Grid,
    check_board,
    draw_board,
    family_size,
    read_board,
    tag_cells,
    write_board,
)
from raytwin.photos.camera.detection import detect

GRID = Board("tag36h11", 0.03, Grid(3, 2, 0.04, first_id=5))
LIST = Board("tag36h11", 0.03, tags=tuple(BoardTag(i, (0.05 * (i % 2), 0.05 * (i // 2))) for i in range(4)))


def test_a_grid_counts_to_the_right_then_up_from_the_first_tag_at_the_origin():
    assert GRID.centers() == {
        5: (0, 0), 6: (0.04, 0), 7: (0.08, 0),
        8: (0, 0.04), 9: (0.04, 0.04), 10: (0.08, 0.04),
    }  # fmt: skip


@pytest.mark.parametrize("board", [GRID, LIST])
def test_a_board_written_and_read_is_the_same(board, tmp_path):
    write_board(tmp_path / "board.toml", board)
    assert read_board(tmp_path / "board.toml") == board


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ('family = "tag36h11"\ntag_edge = 0.03', "grid, tags"),
        ('family = "tag36h11"\ntag_edge = -0.03\n[grid]\ncolumns=3\nrows=2\npitch=0.04', "tag_edge"),
        ('family = "tag36h11"\ntag_edge = 0.03\n[grid]\ncolumns=3\nrows=2\npitch=0.03', "grid.pitch"),
        ('family = "tag36h11"\ntag_edge = 0.03\n[grid]\ncolumns=3\nrows=2\npitch=0.04\nfirst_id=582', "grid"),
        ('family = "tag36h99"\ntag_edge = 0.03\n[grid]\ncolumns=3\nrows=2\npitch=0.04', "family"),
        ('family = "tag36h11"\ntag_edge = 0.03\n[grid]\ncolumns=5\nrows=1\npitch=0.04', "tags"),
        ('family = "tag36h11"\ntag_edge = 0.03\n[grid]\ncolumns=3\nrows=2\npitch=0.04\nrow=1', "grid.row (line 7)"),
        ('family = "tag36h11"\ntag_edge = 0.03\n[grid]\ncolumns=100000\nrows=100000\npitch=0.04', "grid.columns"),
        ('family = "tag36h11"\ntag_edge = nan\n[grid]\ncolumns=3\nrows=2\npitch=0.04', "tag_edge"),
    ],
)
def test_a_wrong_board_is_refused_with_the_field_that_is_wrong(text, field, tmp_path):
    file = tmp_path / "board.toml"
    file.write_text(text)
    with pytest.raises(InputError) as error:
        read_board(file)
    assert error.value.where == f"{file}: {field}"


def _with(i: int, **changes) -> Board:
    tags = list(LIST.tags)
    tags[i] = msgspec.structs.replace(tags[i], **changes)
    return msgspec.structs.replace(LIST, tags=tuple(tags))


@pytest.mark.parametrize(
    ("board", "field", "got"),
    [
        (_with(2, id=0), "tags[2].id", "0, as tags[0] has"),
        (_with(1, id=587), "tags[1].id", "587"),
        (_with(3, center=(0.01, 0.02)), "tags", "ids 0 and 3 closer"),
        (msgspec.structs.replace(LIST, tags=LIST.tags[:3]), "tags", "3 tags"),
        (msgspec.structs.replace(LIST, grid=Grid(3, 2, 0.04)), "grid, tags", "both"),
    ],
)
def test_a_wrong_list_of_tags_is_refused_with_what_is_wrong(board, field, got):
    with pytest.raises(InputError) as error:
        check_board(board, "b")
    assert (error.value.where, error.value.got) == (f"b: {field}", got)


@pytest.mark.parametrize("density", [2111.0, 3456.7])
def test_the_drawn_sheet_has_as_much_ink_as_its_black_cells_at_any_resolution(density):
    sheet, (x0, x1, y0, y1) = draw_board(GRID, density)
    black = sum((1 - tag_cells("tag36h11", i)).mean() for i in GRID.centers()) * GRID.tag_edge**2
    ink = (PAPER - sheet.astype(float)).sum() / density**2
    assert ink == pytest.approx(black * (PAPER - INK), rel=1e-5)
    assert sheet.shape == (round((y1 - y0) * density), round((x1 - x0) * density))


def test_the_margin_is_white_paper_around_the_outermost_tags():
    sheet, (x0, x1, y0, y1) = draw_board(GRID, 2000)
    assert (x0, x1, y0, y1) == pytest.approx((-0.03, 0.11, -0.03, 0.07), abs=1 / 2000)
    assert (sheet[:28] == np.float32(PAPER)).all()
    assert (sheet[:, :28] == np.float32(PAPER)).all()


@pytest.mark.parametrize("family", ["tag36h11", "tag25h9", "tag16h5"])
def test_a_drawn_board_is_read_as_the_same_ids_upright_and_in_place(family):
    board = Board(family, 0.03, Grid(3, 2, 0.045, first_id=family_size(family) - 6))
    density = 3333.0
    sheet, (x0, _, _, y1) = draw_board(board, density)
    found = {tag.id: tag for tag in detect((sheet * 255).astype(np.uint8), family)}
    assert found.keys() == board.centers().keys()
    for tag_id, (x, y) in board.centers().items():
        half = board.tag_edge / 2
        # Metres to pixels whose centres are integers; the tag's own lower left corner comes first.
        around = np.array(
            [(x, y), (x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)]
        )
        true = np.c_[(around[:, 0] - x0) * density, (y1 - around[:, 1]) * density] - 0.5
        assert np.abs(np.array([found[tag_id].center, *found[tag_id].corners]) - true).max() < 0.35
        assert np.abs(np.array(found[tag_id].center) - true[0]).max() < 0.15


@pytest.mark.parametrize(("name", "shipped"), [("fine", "at_fineboard"), ("coarse", "at_coarseboard")])
def test_the_shipped_boards_are_the_courses(real_board, scenes, name, shipped):
    assert read_board(scenes / "boards" / f"{shipped}.toml").digest == real_board(name).digest


def test_the_recipe_on_the_page_writes_the_board_of_a_pickle(scenes, tmp_path, monkeypatch):
    """As the detector's own results hold it: the family in bytes, centres as arrays of three inches."""
    shipped = read_board(scenes / "boards" / "at_fineboard.toml")
    tags = [
        {"tag_family": b"tag36h11", "tag_id": i, "center": np.array([x, y, 0]) / 0.0254}
        for i, (x, y) in shipped.centers().items()
    ]
    (tmp_path / "boards.pickle").write_bytes(pickle.dumps({"at_fineboard": tags}))
    page = (scenes.parent / "docs" / "photos.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    exec(page.partition("```python\n")[2].partition("```")[0], {})
    assert read_board("board.toml").digest == shipped.digest


def test_a_border_of_two_bits_is_refused_as_removed(tmp_path):
    (tmp_path / "b.toml").write_text('family = "tag36h11"\ntag_edge = 0.03\nborder_bits = 2\n')
    with pytest.raises(InputError, match=r"b.toml: expected tags with a border of one bit, got border_bits, removed"):
        read_board(tmp_path / "b.toml")
