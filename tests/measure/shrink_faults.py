"""raytwin shrink on planted mistakes: objects left, comparisons, seconds, and whether the failure is still the same.

    python -m measure.shrink_faults [SCENE ...]    in tests/

Each small scene is judged again by the whole comparison, with other seeds: the kind of failure and the first cause that
it names must be those of the whole scene. Seconds are of this process's processor.
"""

import os
import re
import sys
import tempfile
from pathlib import Path

from planted_renderers import FAULTS, Planted

from raytwin.errors import InputError
from raytwin.workflows.compare_scene import compare_scene
from raytwin.workflows.shrink import Shrunk, kind_of, shrink

SCENES = "overlap", "studio", "distorted"
SIZE = 160, 120
MOST = 20
"""Mistakes that fail, of each scene."""


def seconds() -> float:
    spent = os.times()
    return spent.user + spent.system


def still(found: Shrunk, subject: Planted) -> bool:
    """Whether the small scene fails in the same way, by a comparison that knows nothing of the search."""
    with tempfile.TemporaryDirectory() as folder:
        file = found.after.write(Path(folder) / "small", "")
        try:
            made = compare_scene(file, subject=subject, rung=found.after.rung, seed=4711).comparison
        except InputError as error:
            return found.failure.kind.startswith("no image") and type(error) is InputError
    reasons = tuple(reason for reason in made.reasons if not reason.startswith(("cause", "or, with", "this explains")))
    alike = made.verdict == "fail" and kind_of(made.__class__("fail", reasons)) == found.failure.kind
    fitted, before = (re.sub(r"[\d.]+", "#", cause) for cause in (made.cause, found.failure.cause))
    return alike and (not found.failure.causes or fitted == before)


def main() -> None:
    print(f"{'scene':<10} {'mistake':<24} objects  pixels   tried  cpu s  same  cause")
    for scene in sys.argv[1:] or SCENES:
        rows = []
        for fault in FAULTS:
            subject, began = Planted("shadow", fault), seconds()
            try:
                found = shrink(scene, subject=subject, size=SIZE)
            except InputError:
                continue  # nothing of it is seen in this scene
            spent, same = seconds() - began, still(found, subject)
            rows.append((found, spent, same))
            size = "{}x{}".format(*found.after.image_size)
            objects = f"{found.before.count} to {found.after.count}"
            cause = (found.failure.cause or found.failure.reason)[:60]
            row = f"{scene:<10} {fault:<24} {objects:>7} {size:>8} {found.evaluations:>6} {spent:>6.1f}  {same!s:<5}"
            print(row, cause)
            sys.stdout.flush()
            if len(rows) == MOST:
                break
        left = [found.after.count for found, _, _ in rows]
        tried, spent_on = sorted(f.evaluations for f, _, _ in rows), sorted(s for _, s, _ in rows)
        print(
            f"{scene}: {len(rows)} mistakes, at most {max(left)} objects left, two or fewer in "
            f"{sum(n <= 2 for n in left)}; {tried[len(rows) // 2]} comparisons and {spent_on[len(rows) // 2]:.1f} s "
            f"(median), {spent_on[-1]:.1f} s at most; the same failure in {sum(same for _, _, same in rows)}"
        )


if __name__ == "__main__":
    main()
