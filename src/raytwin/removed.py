"""What 0.2.0 removed, and what to use instead: one line each, kept for one release."""

from collections.abc import Sequence

COMMANDS: dict[str, str] = {
    "needs --out": "Use --json FILE for the answer and `raytwin ladder SCENE` for a picture of each light level.",
    "needs -o": "Use --json FILE for the answer and `raytwin ladder SCENE` for a picture of each light level.",
}
"""Words of the command line ("bench paper") -> what to use instead, a sentence. May end in an option ("diff --fail")."""

NAMES: dict[str, str] = {
    "chart": "Use pandas.DataFrame(result.table()).plot(x=..., y=...), which draws with matplotlib.",
}
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
