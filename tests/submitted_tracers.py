"""A student's tracer, correct in every stage, in plain NumPy, and mistakes in it, as replacements of its text."""

import re

from starter_submissions import PLAIN

RIGHT = re.sub(r"(?s)def (estimate_pose|hit_points)\(.*?\n\n\n", "", PLAIN)
"""Without the exercises that no class here is asked for."""

WRONG = {
    "no shadows": ('if scene["rung"] == "shadow"', "if False"),
    "pi": ("albedo / np.pi *", "albedo *"),
    "gamma": ("return out.reshape", "out = np.clip(out, 0, 1) ** (1 / 2.2); return out.reshape"),
    "nan": ("return out.reshape", "out[0] = np.nan; return out.reshape"),
    "shape": ('return out.reshape(scene["height"], scene["width"], 3)', "return out"),
    "raises": ("return out.reshape", "raise ValueError('<b>no</b>'); return out.reshape"),
    "hangs": ("return out.reshape", "import time\n    while True: time.sleep(1)\n    return out.reshape"),
    "cached": (
        "def render(scene):",
        "CACHE = {}\ndef render(scene):\n    return CACHE.setdefault(len(scene), paint(scene))\ndef paint(scene):",
    ),
}  # fmt: skip
"""Name -> (old, new)."""


def tracer(mistake: str = "") -> str:
    if not mistake:
        return RIGHT
    old, new = WRONG[mistake]
    assert old in RIGHT
    return RIGHT.replace(old, new)
