"""raytwin calibrate, photograph, augment: from photos of a board to a camera, and back into photos."""

from pathlib import Path
from typing import Annotated

import typer

from raytwin.cli.options import JsonFile, check_outputs, parse_numbers, parse_size, parse_sphere, parse_stand
from raytwin.cli.progress_bar import print_seconds, show_progress
from raytwin.cli.terminal import say
from raytwin.errors import InputError, check_one_of
from raytwin.scene import Lambert
from raytwin.workflows.augment_settings import AugmentSettings

MIRROR, ORANGE = Lambert((0.9, 0.9, 0.9)), Lambert((0.75, 0.35, 0.08))
"""What `photograph` puts beside the board: the first's albedo is its reflectance."""


def calibrate_command(
    photos: Annotated[list[Path], typer.Argument(metavar="PHOTOS...", help="Photos of the board, or their folder.")],
    board: Annotated[
        list[Path], typer.Option(metavar="BOARD", help="TOML file of the board; repeat for several boards.")
    ],
    model: Annotated[str, typer.Option(help="Lens model: auto, none, k1, k1k2, k1k2p1p2, k1k2k3 or full5.")] = "auto",
    photo: Annotated[str | None, typer.Option(metavar="NAME", help="Photo whose pose is written (the first).")] = None,
    json: JsonFile = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Write the camera, as TOML, and a page beside it."),
    ] = None,
    uncertainty: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw how far off each pixel may be.")
    ] = None,
    bend: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw the board's bend; a second board goes to FILE_2.png.")
    ] = None,
    export: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write K and distortion for another program.")
    ] = None,
    export_as: Annotated[
        str | None, typer.Option("--format", help="opencv, ros, kalibr or mrcal (from --export's ending).")
    ] = None,
    against: Annotated[
        Path | None, typer.Option(metavar="OTHER.toml", help="Compare with another camera by where they project.")
    ] = None,
    distance: Annotated[
        float | None, typer.Option(metavar="M", help="Distance of the compared points (the boards'), or inf.")
    ] = None,
    difference: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw the difference found by --against.")
    ] = None,
) -> None:
    """Calibrate a camera from photos of a board: K, distortion and a pose per photo, with uncertainty."""
    from raytwin import files, report
    from raytwin.calib import boards
    from raytwin.calib import photos as taken

    check_outputs(files=(json, out, uncertainty, bend, export, difference))
    _check_pictures({"--uncertainty": uncertainty, "--bend": bend, "--difference": difference})
    if export:
        taken.export_format(export, export_as)
    other = _read_other(against, distance, difference)
    definitions = [boards.read_board(path) for path in board]
    paths = [path for named in photos for path in files.list_photos(named)]
    with show_progress() as progress:
        check_one_of("--photo", photo or paths[0].name, (p.name for p in paths))
        calibration = taken.calibrate(paths, definitions, model=model, progress=progress)
    if json:
        files.write_json(json, calibration.numbers())
    if out:
        _write_camera(out, calibration, paths, definitions, photo)
        report.write_calibration(calibration, out.with_suffix(".html"), out.name)
    if uncertainty:
        report.write_uncertainty(calibration, uncertainty)
    if bend:
        report.write_bends(calibration, bend)
    if export:
        taken.export_camera(export, calibration, export_as)
    say(report.calibration_summary(calibration))
    if other is not None:
        apart = taken.projection_difference(calibration, other, distance)
        if difference:
            report.write_difference(calibration, apart, difference)
        say(report.difference_summary(apart))
    print_seconds(progress)


def _check_pictures(pictures: dict[str, Path | None]) -> None:
    for option, picture in pictures.items():
        if picture and picture.suffix.lower() != ".png":
            raise InputError(option, "a name that ends in .png", picture)


def _read_other(against: Path | None, distance: float | None, difference: Path | None):
    """The camera to compare with, None without one; InputError for options that need one."""
    from raytwin import files

    if against is None and (difference or distance is not None):
        raise InputError("--against", "a camera to compare with", "none")
    if distance is not None and not distance > 0:
        raise InputError("--distance", "metres > 0, or inf", f"{distance:g}")
    return files.read_camera(against) if against else None


def _write_camera(out: Path, calibration, paths: list[Path], definitions: list, photo: str | None) -> None:
    """camera.toml with the pose of `photo`, the first one's by default. Of several boards, the pose is that of the
    first that the photo shows."""
    from raytwin.calib import photos as taken

    shown = {view.photo: view.board for view in reversed(calibration.views)}
    name = photo or calibration.views[0].photo
    check_one_of("--photo", name, shown)
    path = next(p for p in paths if name in (p.name, str(p)))
    pose = taken.pose_of_photo(calibration, path, definitions[shown[name]])
    camera = taken.camera_at(calibration, pose.refined)
    comment = f"Calibrated from {len(shown)} photos, rms {calibration.rms_px:.3f} px."
    taken.write_camera_file(out, camera, calibration.basis.boards, comment)


def photograph_command(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the photos and truth.toml.")],
    board: Annotated[Path, typer.Option(metavar="BOARD", help="TOML file of the board.")],
    scene: Annotated[Path | None, typer.Option(help="Take sun, sky and table (its planes) from this scene.")] = None,
    count: Annotated[int, typer.Option(min=1, max=1000, help="Number of photos.")] = 14,
    size: Annotated[str, typer.Option(metavar="WxH", help="Size of a photo in pixels.")] = "2016x1512",
    focal: Annotated[float, typer.Option(help="Focal length in pixels of a photo 2016 wide.")] = 1560.0,
    dist: Annotated[str, typer.Option(help="Distortion: k1,k2,p1,p2,k3 or a prefix.")] = "0.08,-0.16",
    samples: Annotated[int, typer.Option(min=1, help="Light paths per pixel.")] = 32,
    seed: Annotated[int, typer.Option(help="Seed of poses, light paths and sensor noise.")] = 1,
    bend: Annotated[float, typer.Option(min=0.0, metavar="MM", help="Bend the sheet by this many millimetres.")] = 0.0,
    with_objects: Annotated[
        bool, typer.Option("--with-objects", help="Put the scene's objects into the photos (for augment --against).")
    ] = False,
    mirror: Annotated[
        str | None, typer.Option(metavar="X,Y,Z,R", help="Put a mirror ball there: center and radius, metres.")
    ] = None,
    ball: Annotated[
        str | None, typer.Option(metavar="X,Y,Z,R", help="Put a matt orange ball there: center and radius, metres.")
    ] = None,
    stand: Annotated[
        str | None, typer.Option(metavar="X,Y,H", help="Put a thin upright there: foot and height, metres.")
    ] = None,
    exposure: Annotated[
        str, typer.Option(help="Linear pixel value of radiance 1; several, separated by commas, are used by turns.")
    ] = "1",
) -> None:
    """Render photos of an AprilTag board with Mitsuba, and write the true camera."""
    from raytwin.workflows.photograph import photograph_board

    check_outputs(folders=(out,))
    shown = parse_numbers(exposure, "--exposure")
    if not shown or min(shown) <= 0:
        raise InputError("--exposure", "numbers > 0", exposure)
    with show_progress() as progress:
        photograph_board(
            board,
            out,
            scene=scene,
            count=count,
            size=parse_size(size, "--size"),
            focal=focal,
            dist=parse_numbers(dist, "--dist", 5),
            samples=samples,
            seed=seed,
            with_objects=with_objects,
            bend=bend / 1000,
            mirror=parse_sphere(mirror, "--mirror", MIRROR) if mirror else None,
            ball=parse_sphere(ball, "--ball", ORANGE) if ball else None,
            stand=parse_stand(stand, "--stand") if stand else None,
            exposures=shown,
            progress=progress,
        )
    print_seconds(progress)
    say(f"{count} photos, board.toml and truth.toml: {out}")


def augment_command(
    photos: Annotated[list[Path], typer.Argument(metavar="PHOTO...", help="Photos that show the board.")],
    scene: Annotated[Path, typer.Option(metavar="SCENE", help="Scene whose objects are drawn.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the drawn photos.")],
    settings: AugmentSettings,
    json: JsonFile = None,
) -> None:
    """Draw a scene's objects and their shadows into photos."""
    from raytwin import files, report
    from raytwin.workflows.augment_photos import augment_photos

    check_outputs(folders=(out,), files=(json,))
    pages = report.Against(out) if settings.against else None
    with show_progress() as progress:
        each = pages.add if pages else None
        rows = augment_photos(photos, scene, out, settings, each=each, progress=progress)
    if json:
        files.write_json(json, {"photos": rows})
    say(report.augment_summary(rows))
    print_seconds(progress)
    if pages:
        say(f"report: {pages.finish()}")
    say(f"{len(rows)} photos: {out}")
