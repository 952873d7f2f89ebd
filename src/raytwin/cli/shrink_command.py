"""raytwin shrink: the least of a scene in which a renderer still fails."""

import shlex
from pathlib import Path

from raytwin.cli.option_values import check_outputs
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say
from raytwin.workflows.settings import CompareSettings


def shrink_command(
    scene: Path, settings: CompareSettings, time_limit: float = 300, json: Path | None = None,
    out: Path | None = None, allow: list[str] | None = None,
) -> None:  # fmt: skip
    """Find the smallest scene in which a renderer still fails.

    It fails as on this scene, and is written for a bug report. Each step keeps the reason, and the cause if one was
    named. Exit code 2 means that it does not fail.
    """
    from raytwin import files
    from raytwin.workflows.shrink import shrink

    check_outputs(folders=(out or Path("out"),), files=(json,))
    with show_progress() as progress:
        found = shrink(scene, settings, time_limit=time_limit, progress=progress)
    name, small = found.before.name, found.after
    folder = out or Path("out") / f"shrink-{name}"
    file = folder / small.file_name
    rung = f" --rung {small.rung}" if small.rung else ""
    samples = f" --samples {settings.samples}" if settings.samples else ""
    shown = f"raytwin compare {shlex.quote(str(file))} --subject {shlex.quote(str(settings.subject))}{rung}{samples}"
    said = (f"{name}, reduced by raytwin shrink.", *found.sentences)
    small.write(folder, "\n".join((*said, "bug.md has the command that reproduces it.")))
    files.write_text(folder / "bug.md", "\n\n".join((*said, f"To reproduce: `{shown}`\n")))
    if json:
        files.write_json(json, found.numbers() | {"scene": str(file), "command": shown})
    for line in (*found.sentences, f"To reproduce: {shown}"):
        say(line)
    say(f"{found.before.count} objects to {found.after.count}, {found.evaluations} comparisons, {found.seconds:.1f} s")
    say(f"scene: {file}")
