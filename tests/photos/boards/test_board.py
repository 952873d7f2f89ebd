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
    read_board,
    tag_cells,
    write_board,
)
from raytwin.photos.camera.detection import detect

GRID = Board("tag36h11", 0.03, Grid(3, 2, 0.04, first_id=5))
LIST = Board("tag36h11", 0.03, tags=tuple(BoardTag(i, (0.05 * (i % 2), 0.05 * (i // 2))) for i in range(4)))
BENT = msgspec.structs.replace(GRID, offsets=tuple((1e-5, 0.0, 1e-4 * i) for i in range(6)))


def test_a_grid_counts_to_the_right_then_up_or_down_from_the_first_tag_at_the_origin():
    up = {5: (0, 0), 6: (0.04, 0), 7: (0.08, 0), 8: (0, 0.04), 9: (0.04, 0.04), 10: (0.08, 0.04)}
    assert GRID.centers() == up
    down = msgspec.structs.replace(GRID, grid=msgspec.structs.replace(GRID.grid, order="down"))
    check_board(down)
    assert down.centers() == {i: (x, -y) for i, (x, y) in up.items()}


def test_a_board_written_and_read_is_the_same_its_shape_too(tmp_path):
    for board in (GRID, LIST, BENT):
        write_board(tmp_path / "board.toml", board)
        assert read_board(tmp_path / "board.toml") == board
    assert BENT.flat() == GRID
    assert np.allclose(BENT.points([7, 6]) - GRID.points([7, 6]), [(1e-5, 0, 2e-4), (1e-5, 0, 1e-4)])


def test_a_wrong_file_is_refused_with_the_field_that_is_wrong(subtests, tmp_path):
    head, grid, file = (
        'family = "tag36h11"\ntag_edge = 0.03\n',
        "[grid]\ncolumns=3\nrows=2\npitch=",
        tmp_path / "b.toml",
    )
    for text, field, said in (
        (head, "grid, tags", "neither"),
        (head.replace("0.03", "-0.03") + grid + "0.04", "tag_edge", ""),
        (head + grid + "0.03", "grid", "0.03 m"),
        (head + grid + "0.04\nfirst_id=582", "grid", "ids up to 587"),
        (head.replace("36h11", "36h99") + grid + "0.04", "family", "tag36h99"),
        (head + grid.replace("3", "5").replace("2", "1") + "0.04", "tags", "5 tags"),
        (head + grid + "0.04\nrow=1", "grid.row", ""),
        (head + grid.replace("3", "100000") + "0.04", "grid.columns", ""),
        (head + "border_bits = 2", "", "border_bits, removed in 0.2.0"),
    ):
        with subtests.test(text):
            file.write_text(text)
            with pytest.raises(InputError) as error:
                read_board(file)
            assert error.value.where == f"{file}: {field}".removesuffix(": ")
            assert said in error.value.got


def test_a_wrong_list_of_tags_or_shape_is_refused_with_what_is_wrong(subtests):
    *three, _ = LIST.tags
    for board, field, got in (
        (msgspec.structs.replace(LIST, tags=(*three, BoardTag(0, (0.2, 0.2)))), "tags", "0 twice"),
        (msgspec.structs.replace(LIST, tags=(*three, BoardTag(587, (0.2, 0.2)))), "tags", "ids up to 587"),
        (msgspec.structs.replace(LIST, tags=(*three, BoardTag(3, (0.01, 0.02)))), "tags", "0.02 m"),
        (msgspec.structs.replace(LIST, tags=LIST.tags[:3]), "tags", "3 tags"),
        (msgspec.structs.replace(LIST, grid=Grid(3, 2, 0.04)), "grid, tags", "both"),
        (msgspec.structs.replace(LIST, offsets=((0.0, 0.0, 1e-3),)), "offsets", "1"),
    ):
        with subtests.test(f"{field}: {got}"):
            with pytest.raises(InputError) as error:
                check_board(board, "b")
            assert (error.value.where, error.value.got) == (f"b: {field}", got)


def test_the_drawn_sheet_has_as_much_ink_as_its_black_cells_and_white_paper_around_them():
    density = 3456.7
    sheet, (x0, x1, y0, y1) = draw_board(GRID, density)
    black = sum((1 - tag_cells("tag36h11", i)).mean() for i in GRID.centers()) * GRID.tag_edge**2
    ink = (PAPER - sheet.astype(float)).sum() / density**2
    assert ink == pytest.approx(black * (PAPER - INK), rel=1e-5)
    assert sheet.shape == (round((y1 - y0) * density), round((x1 - x0) * density))
    assert (x0, x1, y0, y1) == pytest.approx((-0.03, 0.11, -0.03, 0.07), abs=1 / density)
    margin = int(0.015 * density) - 1
    assert (sheet[:margin] == np.float32(PAPER)).all()
    assert (sheet[:, :margin] == np.float32(PAPER)).all()


@pytest.mark.parametrize(("family", "last"), [("tag36h11", 586), ("tag25h9", 34), ("tag16h5", 29)])
def test_a_drawn_board_is_read_as_the_same_ids_upright_and_in_place(family, last):
    board = Board(family, 0.03, Grid(3, 2, 0.045, first_id=last - 5))
    density, half = 3333.0, board.tag_edge / 2
    sheet, (x0, _, _, y1) = draw_board(board, density)
    found = {tag.id: tag for tag in detect((sheet * 255).astype(np.uint8), family)}
    assert found.keys() == board.centers().keys()
    for tag_id, center in board.centers().items():
        # Metres to pixels whose centres are integers; the tag's own lower left corner comes first.
        xy = np.array(center) + half * np.array([(0, 0), (-1, -1), (1, -1), (1, 1), (-1, 1)])
        true = np.c_[(xy[:, 0] - x0) * density, (y1 - xy[:, 1]) * density] - 0.5
        off = np.abs(np.array([found[tag_id].center, *found[tag_id].corners]) - true)
        assert off.max() < 0.35
        assert off[0].max() < 0.15


def test_the_shipped_boards_are_the_courses_and_the_recipe_on_the_page_writes_them(
    real_board, scenes, tmp_path, monkeypatch
):
    """As the detector's own results hold them: the family in bytes, centres as arrays of three inches."""

    def same(one: Board, other: Board) -> bool:
        alike = (one.family, one.centers().keys()) == (other.family, other.centers().keys())
        return alike and np.allclose(one.points(one.centers()), other.points(one.centers()), rtol=0, atol=1e-9)

    for name in ("fine", "coarse"):
        assert same(read_board(scenes / "boards" / f"at_{name}board.toml"), real_board(name))
    shipped = read_board(scenes / "boards" / "at_fineboard.toml")
    tags = [
        {"tag_family": b"tag36h11", "tag_id": i, "center": np.array([x, y, 0]) / 0.0254}
        for i, (x, y) in shipped.centers().items()
    ]
    (tmp_path / "boards.pickle").write_bytes(pickle.dumps({"at_fineboard": tags}))
    page = (scenes.parent / "docs" / "photos.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    exec(page.partition("```python\n")[2].partition("```")[0], {})
    assert same(read_board("board.toml"), shipped)
