"""raytwin board: a board to print, or one from a pickle."""

from pathlib import Path
from typing import TypeVar

from raytwin.cli.terminal import say
from raytwin.errors import InputError, check_one_of

T = TypeVar("T")


def board_command(
    out: Path | None = None, tag: str | None = None, columns: int | None = None, rows: int | None = None,
    pitch: str | None = None, paper: str | None = None, margin: str | None = None, landscape: bool | None = None,
    first_id: int | None = None, family: str | None = None, pickle: Path | None = None, name: str | None = None,
    unit: str | None = None, y_down: bool | None = None,
) -> None:  # fmt: skip
    """Make a board to print, as PDF and TOML.

    The PDF has the exact size and a bar to measure. Lengths need units: 30mm, 3cm, 0.8in.
    """
    drawing = {
        "--columns": columns, "--rows": rows, "--pitch": pitch, "--paper": paper, "--margin": margin,
        "--landscape": landscape, "--first-id": first_id, "--family": family,
    }  # fmt: skip
    importing = {"--name": name, "--unit": unit, "--y-down": y_down}
    for option, value in (importing if pickle is None else drawing).items():
        if value is not None:
            raise InputError(option, f"nothing {'without' if pickle is None else 'with'} --import", value)
    if pickle is None:
        grid = _counted("--columns", columns, 1), _counted("--rows", rows, 1), needed("--pitch", pitch)
        first = _counted("--first-id", first_id or 0, 0)
        _draw(grid, needed("--tag", tag), needed("--out", out), paper, margin, landscape, first, family or "tag36h11")
    elif name is None:  # who asks for the names needs to know nothing else
        _import(pickle, None, unit or "m", tag or "1m", bool(y_down), out or Path("board.toml"))
    else:
        _import(pickle, name, needed("--unit", unit), needed("--tag", tag), bool(y_down), needed("--out", out))


def needed(option: str, value: T | None) -> T:
    if value is None:
        raise InputError(option, "a value", "nothing")
    return value


def _counted(option: str, value: int | None, least: int) -> int:
    if (count := needed(option, value)) < least:
        raise InputError(option, f"a whole number from {least}", count)
    return count


def _draw(
    grid: tuple[int, int, str], tag: str, out: Path, paper: str | None, margin: str | None, landscape: bool | None,
    first_id: int, family: str,
) -> None:  # fmt: skip
    from raytwin.calib import boards
    from raytwin.calib.boards import lengths, sheet

    columns, rows, pitch = grid
    edge, step = lengths.parse_length(tag, "--tag"), lengths.parse_length(pitch, "--pitch")
    blank = lengths.parse_length(margin, "--margin", zero=True) if margin is not None else 0.005
    size = lengths.parse_paper(paper or "a4", "--paper")
    check_one_of("--family", family, boards.FAMILIES)
    definition = boards.Board(family, edge, boards.Grid(columns, rows, step, first_id))
    sheet.check_gap(definition)
    boards.check_board(definition)
    laid = sheet.lay_out(definition, size, blank, landscape)
    toml = sheet.write_sheet(out, laid)
    width, height = (f"{v * 1000:.5g}" for v in laid.paper)
    say(f"{columns * rows} tags on {width} x {height} mm, print at 100 %: {out}, {toml}")


def _import(pickle: Path, name: str | None, unit: str, tag: str, y_down: bool, out: Path) -> None:
    from raytwin.calib.boards import lengths, pickled, write_board

    if out.suffix.lower() != ".toml":
        raise InputError(out, "a name that ends in .toml", out.suffix or "no ending")
    edge, metres = lengths.parse_length(tag, "--tag"), lengths.parse_unit(unit, "--unit")
    board = pickled.read_pickled(pickle, name, edge, metres, y_down)
    write_board(out, board, f"Imported from {pickle.name}: {name}.")
    say(f"{len(board.centers())} tags of {name}: {out}")
