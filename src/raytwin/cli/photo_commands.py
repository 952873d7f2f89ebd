"""raytwin photo: from photos of a board to camera and light, and back into photos."""

from pathlib import Path

from raytwin.cli.option_values import check_outputs, parse_placed
from raytwin.cli.options import Size
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say
from raytwin.errors import InputError, check_one_of
from raytwin.study.settings import AugmentSettings


def board_command(
    out: Path = Path("board.pdf"), tag: str = "30mm", columns: int = 5, rows: int = 7, pitch: str = "38mm",
    paper: str = "a4",
) -> None:  # fmt: skip
    """Make a board to print, as PDF and TOML.

    The PDF has the exact size and a bar to measure. Lengths need units: 30mm, 3cm, 0.8in.
    """
    from raytwin.photos import boards
    from raytwin.photos.boards import sheet
    from raytwin.photos.boards.lengths import parse_length

    for option, count in (("--columns", columns), ("--rows", rows)):
        if count < 1:
            raise InputError(option, "a whole number from 1", count)
    check_one_of("--paper", paper.lower(), sheet.PAPERS)
    grid = boards.Grid(columns, rows, parse_length(pitch, "--pitch"))
    board = boards.Board("tag36h11", parse_length(tag, "--tag"), grid)
    boards.check_board(board)
    toml = sheet.write_sheet(out, board, paper.lower())
    say(f"{columns * rows} tags on {paper.lower()}, print at 100 %: {out}, {toml}")


def calibrate_command(
    photos: list[Path], board: list[Path] | None = None, model: str = "auto", photo: str | None = None,
    json: Path | None = None, out: Path | None = None,
) -> None:  # fmt: skip
    """Calibrate a camera from photos of a board.

    Prints K, distortion and a pose per photo, with their uncertainty, and warns of doubtful results.
    """
    from raytwin.images.photo_files import list_photos
    from raytwin.photos import boards
    from raytwin.photos import camera as taken
    from raytwin.scene.toml_json import write_json
    from raytwin.show import calibration_page, terminal_text

    check_outputs(files=(json, out))
    if board and len(board) > 1:
        raise InputError("`photo calibrate --board`", "more than once was removed in 0.2.0. Use one board per call.")
    definition = boards.read_board(board[0] if board else _board_beside(photos))
    paths = [path for named in photos for path in list_photos(named)]
    with show_progress() as progress:
        check_one_of("--photo", photo or paths[0].name, (p.name for p in paths))
        calibration = taken.calibrate(paths, definition, model=model, progress=progress)
        if out:
            with progress.stage("page"):
                _write_camera(out, calibration, photo)
                calibration_page.write_calibration(calibration, out.with_suffix(".html"), out.name)
    if json:
        write_json(json, calibration.to_dict())
    say(terminal_text.calibration_summary(calibration))


def _board_beside(photos: list[Path]) -> Path:
    """board.toml in the photos' folder, or in the one above."""
    folder = photos[0] if photos[0].is_dir() else photos[0].parent
    found = [path / "board.toml" for path in (folder, folder.resolve().parent) if (path / "board.toml").is_file()]
    if not found:
        raise InputError("--board", "a board's TOML file, since no board.toml lies beside the photos", "nothing")
    say(f"Board {found[0]}")
    return found[0]


def _write_camera(out: Path, calibration, photo: str | None) -> None:
    """camera.toml with the pose of `photo`, the first one's by default."""
    from raytwin.photos import camera as taken

    views = {Path(view.photo).name: view for view in reversed(calibration.views)}
    name = photo or Path(calibration.views[0].photo).name
    check_one_of("--photo", name, views)
    comment = f"Calibrated from {len(calibration.views)} photos, rms {calibration.rms_px:.3f} px."
    taken.write_camera_file(out, taken.camera_at(calibration, views[name]), calibration.evidence.board, comment)


def light_command(
    photo: Path, camera: Path, out: Path, board: Path | None = None, ball: list[str] | None = None,
    stand: str | None = None, json: Path | None = None,
) -> None:  # fmt: skip
    """Estimate sun and sky from a photo.

    A mirror ball or a pin beside the board shows them; each number comes with its uncertainty. The page beside the
    light shows the board's axes, by which --ball and --stand are given, where the photo is refused, too.
    """
    from raytwin.photos.lighting.estimate_light import LightRefused, estimate_light
    from raytwin.photos.lighting.light_file import write_light
    from raytwin.scene.toml_json import write_json
    from raytwin.show import light_page

    if out.suffix.lower() != ".toml":
        raise InputError(out, "a name that ends in .toml", out.suffix or "no ending")
    check_outputs(files=(out, out.with_suffix(".exr"), out.with_suffix(".html"), json))
    if ball and len(ball) > 1:
        raise InputError("`photo light --ball`", "more than once was removed in 0.2.0. Use one mirror ball.")
    given = parse_placed(ball[0], "--ball", "x,y,z,r") if ball else None
    upright = parse_placed(stand, "--stand", "x,y,h") if stand else None
    board = board or _board_beside([photo])
    with show_progress() as progress:
        try:
            with progress.stage("light"):
                found = estimate_light(photo, board, camera, ball=given, stand=upright)
        except LightRefused as refused:
            light_page.write_light_page(refused.found, out.with_suffix(".html"))
            raise InputError(
                *refused.fields[:2], f"{refused.got} (axes to measure by: {out.with_suffix('.html')})"
            ) from None
    assert found.light is not None  # what shows no light was refused
    write_light(out, found.light, found.photo.paper_colour, f"The light of a photo: {found.light.name}.")
    if json:
        write_json(json, found.numbers())
    say(light_page.light_summary(found))
    light_page.write_light_page(found, out.with_suffix(".html"))
    say(f"{out}, report: {out.with_suffix('.html')}")


def simulate_command(
    out: Path, board: Path, scene: Path | None = None, count: int = 14, size: Size = None, samples: int = 32,
    seed: int = 1, with_objects: bool = False,
) -> None:  # fmt: skip
    """Render photos of a board with Mitsuba, and the true camera."""
    from raytwin.study.photograph import photograph_board

    check_outputs(folders=(out,))
    with show_progress() as progress:
        photograph_board(
            board,
            out,
            scene=scene,
            count=count,
            size=size or (2016, 1512),
            samples=samples,
            seed=seed,
            with_objects=with_objects,
            progress=progress,
        )
    say(f"{count} photos, board.toml and truth.toml: {out}")


def draw_command(
    photos: list[Path], scene: Path, out: Path, settings: AugmentSettings, json: Path | None = None,
) -> None:  # fmt: skip
    """Draw a scene's objects and their shadows into photos."""
    from raytwin.images.photo_files import list_photos, readable_photos
    from raytwin.scene.toml_json import write_json
    from raytwin.show import terminal_text
    from raytwin.study.augment_photos import augment_photos

    check_outputs(folders=(out,), files=(json,))
    taken, unread = readable_photos(path for named in photos for path in list_photos(named))
    with show_progress() as progress:
        rows = augment_photos(taken, scene, out, settings, progress=progress)
    if json:
        write_json(json, {"photos": rows})
    for photo, why in unread.items():
        say(f"{photo} was left out: {why}")
    say(terminal_text.augment_summary(rows))
    say(f"{len(rows)} photos: {out}")
