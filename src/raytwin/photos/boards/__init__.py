"""What a board of AprilTags is: its tags' places in metres, and its printed sheet."""

from raytwin.photos.boards.board import (
    FAMILIES,
    Board,
    BoardTag,
    Grid,
    Offsets,
    check_board,
    parse_board,
    read_board,
    write_board,
)
