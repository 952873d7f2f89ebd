"""raytwin photo board: a board to print."""

from pathlib import Path

from raytwin.cli.terminal import say
from raytwin.errors import InputError, check_one_of


def board_command(
    out: Path = Path("board.pdf"), tag: str = "30mm", columns: int = 5, rows: int = 7, pitch: str = "38mm",
    paper: str = "a4", first_id: int = 0, family: str = "tag36h11",
) -> None:  # fmt: skip
    """Make a board to print, as PDF and TOML.

    The PDF has the exact size and a bar to measure. Lengths need units: 30mm, 3cm, 0.8in.
    """
    from raytwin.photos import boards
    from raytwin.photos.boards import sheet
    from raytwin.photos.boards.lengths import parse_length

    for option, count, least in (("--columns", columns, 1), ("--rows", rows, 1), ("--first-id", first_id, 0)):
        if count < least:
            raise InputError(option, f"a whole number from {least}", count)
    grid = boards.Grid(columns, rows, parse_length(pitch, "--pitch"), first_id)
    check_one_of("--family", family, boards.FAMILIES)
    check_one_of("--paper", paper.lower(), sheet.PAPERS)
    board = boards.Board(family, parse_length(tag, "--tag"), grid)
    boards.check_board(board)
    toml = sheet.write_sheet(out, board, paper.lower())
    say(f"{columns * rows} tags on {paper.lower()}, print at 100 %: {out}, {toml}")
