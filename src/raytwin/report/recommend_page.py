"""What a scene needs, as text."""

from raytwin.analysis.recommend import Needs, Row

SHOWN = 6
"""Ways that were rejected; the JSON has all."""


def needs_summary(found: Needs) -> str:
    """The choice, what was cheaper and fails, what else would do, and what is not needed."""
    lines = [f"{found.scene}: {found.metric} <= {found.tolerance:g} against the whole light over the pixels' area"]
    if found.choice is None:
        lines.append(f"NONE    {found.reason}")
    else:
        lines += [f"CHOICE  {_described(found.choice)}", f"        {found.choice.reason}{_on(found.choice)}"]
    for row in found.rejected[:SHOWN]:
        lines.append(f"not     {row.method}: {row.reason}")
    if (more := len(found.rejected) - SHOWN) > 0:
        lines.append(f"        and {more} more")
    for thing in found.not_needed:
        unit = " px" if thing.what.startswith("distortion") else ""
        proven = "nothing proven" if thing.bound is None else f"proven <= {thing.bound:.2g}{unit}"
        measured = "" if thing.measured is None else f", measured {thing.measured:.2g}{unit}"
        lines.append(f"spare   {thing.what}: {thing.why} ({proven}{measured})")
    t = found.truth
    deeper = "nothing is proven of deeper light" if t.beyond is None else f"deeper light adds {t.beyond:.2g} at most"
    lines.append(
        f"truth   {t.samples} samples at {t.pixels} pixels, depth {t.depth} ({deeper}); its noise {t.noise:.2g}; "
        f"{found.seconds:.1f} s"
    )
    return "\n".join(lines)


def _described(row: Row) -> str:
    depth = f" to depth {row.depth}" if row.depth else ""
    rays = "one ray through each pixel's centre" if row.samples == 1 and row.sampling == "center" else (
        f"{row.samples} rays {'over each pixel' if row.sampling == 'area' else 'through each centre'}"
    )  # fmt: skip
    guessed = f", every {row.speculation}-th pixel traced" if row.speculation > 1 else ""
    trim = f", trim {row.trim}" if row.trim else ""
    seconds = "" if row.seconds is None else f": {row.seconds:.3g} s{'' if row.calls else ' (scaled from fewer rays)'}"
    return f"{row.rung}{depth}, {row.engine} ({row.precision} bits), {rays}{guessed}{trim}{seconds}"


def _on(row: Row) -> str:
    """On how much of the frame the error was taken."""
    share = row.pixels or 0.0
    return ", verified at full size" if share == 1 else f", verified on {100 * share:.2g} % of the frame's pixels"
