"""What 0.2.0 removed, and what to use instead: one line each, kept for one release."""

from collections.abc import Sequence
from fnmatch import fnmatchcase

COMMANDS: dict[str, str] = {
    "bench --against --save --spheres": "Use pytest-benchmark (extra `bench`), as docs/renderer.md shows.",
    "bench --flip": "Use diff --flip on two images.",
    "bench --repeats --truth-samples": "Use --budget, or repeats and truth_samples of raytwin.bench.",
    "bench calibration": "Use `python -m measure.calibration_cost`, in tests/ of the repository.",
    "bench paper": "Use `python -m measure.paper`, in tests/ of the repository.",
    "compare --must-see": "Use --detectable-bias.",
    "diff --allow-failures --allowfailures --fail --fail-percent --fail-relative --failpercent --failrelative"
    " --hard-fail --hard-warn --hardfail --hardwarn --warn --warn-percent --warn-relative --warnpercent"
    " --warnrelative": "Use OpenImageIO's idiff, which has these options.",
    "diff --must-see": "Use --detectable-bias.",
    "diff --part": "Use --layer with the part's name.",
    "grade --shard": "Use --jobs N on one machine, or --dask ADDRESS on several.",
    "ladder": "Use `raytwin levels SCENE`.",
    "matrix": "Use `raytwin bench SCENE... --subject A --subject B`, or pytest as docs/renderer.md shows.",
    "needs": "Use `raytwin levels SCENE --tolerance T`.",
    "photo board --family --first-id --import --name --unit --y-down": "Use a board.toml, as docs/photos.md shows.",
    "photo board --landscape --margin --portrait": "Leave it out: the board fits the paper, 5 mm from each edge.",
    "photo calibrate --bend --uncertainty": "Use -o camera.toml: the page beside it has the numbers.",
    "photo draw --against": "Use `raytwin diff DRAWN TRUE` on two photos.",
    "photo draw --no-shadows --shadows": "Use shadows=False of raytwin.augment_photo.",
    "photo simulate --bend": "Leave it out: a synthetic board is flat.",
    "photo simulate --dist --focal": "Leave it out: the camera is that of truth.toml. --size changes its pixels.",
    "photo simulate --exposure": "Scale the sun and the sky of the scene that --scene names.",
    "reference check --samples": "Use --budget.",
    "reference diff": "Use `reference make --again`, which shows changes and asks.",
    "reference make --dask --shard": "Use one `reference make SCENE` per machine.",
    "reference make --jobs -j": "Leave it out: Mitsuba renders on every core.",
    "reference make --seed": "Leave it out: one seed is as good as another.",
    "reference show --all": "Name one reference, and all that is known of it is printed.",
    "scenes export --json": "Leave it out: JSON is written unless --mitsuba-xml is given.",
    "stability sum-samples": "Use np.cumsum of float32 values, which shows it.",
    "walk --solved": "Leave it out: raytwin's own function stands in for each that is not yet correct.",
}
"""Words of the command line ("bench paper"), or a command with options that went -> what to use instead, a sentence."""

MOVED: dict[str, str] = {
    "augment": "photo draw",
    "board": "photo board",
    "calibrate": "photo calibrate",
    "export": "scenes export",
    "grade gradescope-zip": "grade zip",
    "light": "photo light",
    "photograph": "photo simulate",
}
"""Old name of a command -> its name today. The old name does the same, and `--help` does not list it."""

NAMES: dict[str, str] = {
    "camera_rays": "Use back_project and to_board of raytwin.tracer.pixel_to_ray, as docs/python.md shows.",
    "Lambert": "Write the albedo itself: raytwin.Sphere(center, radius, (0.8, 0.2, 0.2)).",
    "ladder": "Use raytwin.levels(scene).",
    "needs": "Use raytwin.levels(scene, tolerance).",
    "SceneFile": "Use raytwin.Scene, which read_scene returns.",
    "chart": "Use pandas.DataFrame(result.table()).plot(x=..., y=...), which draws with matplotlib.",
}
"""Name of `raytwin` -> what to use instead, a sentence."""

BOARD_KEYS = {
    "heights": "offsets, as `raytwin photo calibrate -o` writes them now",
    "border_bits": "tags with a border of one bit",
}
"""Keys of a board's file, and of its shape in a camera.toml -> what is expected instead."""

RUBRIC_KEYS = {
    "feedback": "Leave it out: causes and lines are named by the grader alone.",
    "inside": "Leave the exercise out: `render` is seen from outside spheres.",
    "measure": "Leave it out: `credit` counts the error.",
    "output_mb": "Leave it out: what a submission prints may be as long as a file, `file_mb`.",
    "speed": "Leave it out: pages and results.csv show seconds, which earn no points.",
}
"""Keys of a rubric and of its exercises -> what to do instead, a sentence."""

SCALAR = "removed in 0.2.0. Use llvm_ad_rgb: pip install 'raytwin[llvm]' brings what it needs."
"""About Mitsuba's scalar variants, forced by name."""

RENDERERS: dict[str, str] = {
    "*-inplace": "Use the same name with conic.",
    "loop-*": "Use numpy64 in the place of loop.",
    "mitsuba-*": "Use twin-llvm-direct-N or twin-llvm-path-N: the same Mitsuba, with its variance.",
    "twin-scalar-*": "Use the same name with llvm.",
}
"""Patterns of the names of removed renderers -> what to use instead, a sentence."""


def removed_renderer(name: str) -> str | None:
    """Return one line about a removed renderer; None for any other name.

    >>> removed_renderer("twin-scalar-shadow")
    '`twin-scalar-shadow` was removed in 0.2.0. Use the same name with llvm.'
    """
    instead = next((text for pattern, text in RENDERERS.items() if fnmatchcase(name, pattern)), None)
    return instead and f"`{name}` was removed in 0.2.0. {instead}"


def moved_command(words: Sequence[str]) -> list[str]:
    """Return the command line's words with the name that a command has today.

    >>> moved_command(["augment", "photo.jpg"])
    ['photo', 'draw', 'photo.jpg']
    """
    for old, new in MOVED.items():
        length = len(old.split())
        if " ".join(words[:length]) == old:
            return [*new.split(), *words[length:]]
    return list(words)


def removed_command(words: Sequence[str]) -> str | None:
    """Return one line about the first removed command or option among the command line's words; None without any.

    >>> COMMANDS["diff --old"] = "Use --new."
    >>> removed_command(["diff", "a.exr", "b.exr", "--old=3"])
    '`diff --old` was removed in 0.2.0. Use --new.'
    >>> del COMMANDS["diff --old"]
    """
    given = list(words[: words.index("--")] if "--" in words else words)
    options = {word.partition("=")[0] for word in given if word.startswith("-")}
    for name, instead in COMMANDS.items():
        command, *gone = name.split(" -")
        found = options & {f"-{option}" for option in gone}
        if given[: len(command.split())] == command.split() and (found or not gone):
            return f"`{' '.join((command, *sorted(found)[:1]))}` was removed in 0.2.0. {instead}"
    return None
