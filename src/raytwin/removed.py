"""What 0.2.0 removed, and what to use instead: one line each, kept for one release."""

from collections.abc import Sequence

COMMANDS: dict[str, str] = {
    "bench --against": "Use pytest-benchmark (pip install 'raytwin[bench]'), as docs/howto/measure-speed.md shows.",
    "bench --flip": "Use diff --flip on two images.",
    "bench --save": "Use pytest-benchmark (pip install 'raytwin[bench]'), as docs/howto/measure-speed.md shows.",
    "bench --spheres": "Use pytest-benchmark (pip install 'raytwin[bench]') with scenes of so many spheres.",
    "bench calibration": "Use `python -m measure.calibration_cost`, in tests/ of the repository.",
    "bench paper": "Use `python -m measure.paper`, in tests/ of the repository.",
    "board --import": 'Use a board.toml: "Use your own photos" in the docs writes one from a trusted pickle.',
    "board --name": "Use a board.toml: one file per board.",
    "board --unit": "Use a board.toml, whose lengths are metres.",
    "board --y-down": "Use a board.toml, whose Y points up.",
    "calibrate --bend": "Use the number in mm that calibrate prints; --json has each tag's offset.",
    "calibrate --uncertainty": "Use -o camera.toml: the page beside it has the map of uncertainty.",
    "diff --allow-failures": "Use OpenImageIO's idiff -allowfailures.",
    "diff --allowfailures": "Use OpenImageIO's idiff -allowfailures.",
    "diff --fail": "Use OpenImageIO's idiff -fail.",
    "diff --fail-percent": "Use OpenImageIO's idiff -failpercent.",
    "diff --fail-relative": "Use OpenImageIO's idiff -failrelative.",
    "diff --failpercent": "Use OpenImageIO's idiff -failpercent.",
    "diff --failrelative": "Use OpenImageIO's idiff -failrelative.",
    "diff --hard-fail": "Use OpenImageIO's idiff -hardfail.",
    "diff --hard-warn": "Use OpenImageIO's idiff -hardwarn.",
    "diff --hardfail": "Use OpenImageIO's idiff -hardfail.",
    "diff --hardwarn": "Use OpenImageIO's idiff -hardwarn.",
    "diff --warn": "Use OpenImageIO's idiff -warn.",
    "diff --warn-percent": "Use OpenImageIO's idiff -warnpercent.",
    "diff --warn-relative": "Use OpenImageIO's idiff -warnrelative.",
    "diff --warnpercent": "Use OpenImageIO's idiff -warnpercent.",
    "diff --warnrelative": "Use OpenImageIO's idiff -warnrelative.",
    "grade --shard": "Use --jobs N on one machine, or --dask ADDRESS on several.",
    "ladder": "Use `raytwin levels SCENE`.",
    "matrix": "Use `raytwin bench SCENE... --subject A --subject B`, or pytest as docs/howto/pytest.md shows.",
    "needs": "Use `raytwin levels SCENE --tolerance T`.",
    "photograph --ball": "Use scenes/desk/lit: photos of two balls and a pin under a known light.",
    "photograph --exposure": "Scale the sun and the sky of the scene that --scene names.",
    "photograph --mirror": "Use scenes/desk/lit: photos of two balls and a pin under a known light.",
    "photograph --stand": "Use scenes/desk/lit: photos of two balls and a pin under a known light.",
    "reference make --shard": "Use --jobs N on one machine, or --dask ADDRESS on several.",
    "shrink --allow": "Use a scene.toml: shrink takes no Mitsuba files, which alone have plugins.",
}
"""Words of the command line ("bench paper", "diff --fail") -> what to use instead, a sentence."""

NAMES: dict[str, str] = {
    "ladder": "Use raytwin.levels(scene).",
    "needs": "Use raytwin.levels(scene, tolerance).",
    "SceneFile": "Use raytwin.Scene, which read_scene returns.",
    "chart": "Use pandas.DataFrame(result.table()).plot(x=..., y=...), which draws with matplotlib.",
}
"""Name of `raytwin` -> what to use instead, a sentence."""

SCALAR = "removed in 0.2.0. Use llvm_ad_rgb: pip install 'raytwin[llvm]' brings what it needs."
"""About Mitsuba's scalar variants, forced by name."""

RENDERERS: dict[str, str] = {
    "twin-scalar-": "Use the same name with llvm.",
    "mitsuba-scalar-": "Use the same name with llvm.",
}
"""How the names of removed renderers begin -> what to use instead, a sentence."""


def removed_renderer(name: str) -> str | None:
    """Return one line about a removed renderer; None for any other name.

    >>> removed_renderer("twin-scalar-shadow")
    '`twin-scalar-shadow` was removed in 0.2.0. Use the same name with llvm.'
    """
    instead = next((text for start, text in RENDERERS.items() if name.startswith(start)), None)
    return instead and f"`{name}` was removed in 0.2.0. {instead}"


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
        *command, last = name.split()
        if last.startswith("-"):
            found = given[: len(command)] == command and last in options
        else:
            found = given[: len(command) + 1] == [*command, last]
        if found:
            return f"`{name}` was removed in 0.2.0. {instead}"
    return None
