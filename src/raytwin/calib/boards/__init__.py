"""What a board of AprilTags is: its tags' places in metres, and its printed sheet."""

from raytwin.calib.boards.board import (
    FAMILIES,
    Board,
    BoardTag,
    Grid,
    check_board,
    check_heights,
    draw_board,
    read_board,
    write_board,
)
from raytwin.calib.boards.shape import Heights
