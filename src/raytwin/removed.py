"""What 0.2.0 removed, and what to use instead: one line each, kept for one release."""

from collections.abc import Sequence

COMMANDS: dict[str, str] = {}
"""Words of the command line ("bench paper", "diff --fail") -> what to use instead, a sentence."""
COMMANDS: dict[str, str] = {
    "diff --fail": "Use OpenImageIO's idiff -fail.",
    "diff --failrelative": "Use OpenImageIO's idiff -failrelative.",
    "diff --fail-relative": "Use OpenImageIO's idiff -failrelative.",
    "diff --failpercent": "Use OpenImageIO's idiff -failpercent.",
    "diff --fail-percent": "Use OpenImageIO's idiff -failpercent.",
    "diff --hardfail": "Use OpenImageIO's idiff -hardfail.",
    "diff --hard-fail": "Use OpenImageIO's idiff -hardfail.",
    "diff --allowfailures": "Use OpenImageIO's idiff -allowfailures.",
    "diff --allow-failures": "Use OpenImageIO's idiff -allowfailures.",
    "diff --warn": "Use OpenImageIO's idiff -warn.",
    "diff --warnrelative": "Use OpenImageIO's idiff -warnrelative.",
    "diff --warn-relative": "Use OpenImageIO's idiff -warnrelative.",
    "diff --warnpercent": "Use OpenImageIO's idiff -warnpercent.",
    "diff --warn-percent": "Use OpenImageIO's idiff -warnpercent.",
    "diff --hardwarn": "Use OpenImageIO's idiff -hardwarn.",
    "diff --hard-warn": "Use OpenImageIO's idiff -hardwarn.",
    "bench --flip": "Use diff --flip on two images.",
}
"""Words of the command line ("bench paper") -> what to use instead, a sentence. May end in an option ("diff --fail")."""

NAMES: dict[str, str] = {}
"""Name of `raytwin` -> what to use instead, a sentence."""


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
