"""What differs between two scenes: `sun.irradiance 3 -> 3.2`."""

from collections.abc import Iterator
from typing import Any

import msgspec

from raytwin.scene.scene import Scene

DECIDE = ("camera", "spheres", "planes", "sun", "sky", "tolerance")
"""What decides how a scene looks, and when two images of it agree."""
MOST_NAMED = 4
"""Changes that `summary` names; of further ones it gives the number."""


def summary(old: Scene, new: Scene) -> str:
    """The changes in one line; empty where there are none."""
    found = list(changes(old, new))
    more = [f"and {len(found) - MOST_NAMED} more"] if len(found) > MOST_NAMED else []
    return ", ".join([*found[:MOST_NAMED], *more])


def changes(old: Scene, new: Scene) -> Iterator[str]:
    """Every value that differs, by its key: `spheres[1].radius 0.03 -> 0.04`."""
    for name in DECIDE:
        yield from _differences(name, *(msgspec.to_builtins(getattr(scene, name)) for scene in (old, new)))


def _differences(key: str, old: Any, new: Any) -> Iterator[str]:
    if old == new:
        return
    if isinstance(old, dict) and isinstance(new, dict):
        for name in dict.fromkeys((*old, *new)):
            if name == "name":  # of an object: it decides nothing
                continue
            yield from _differences(f"{key}.{name}", old.get(name), new.get(name))
    elif _is_table(old) and _is_table(new):
        for i in range(max(len(old), len(new))):
            yield from _differences(f"{key}[{i}]", *(rows[i] if i < len(rows) else None for rows in (old, new)))
    elif old is None or new is None:
        yield f"{key} {'added' if old is None else 'removed'}"
    elif isinstance(old, str) and len(old) > 100:
        yield f"{key} changed"  # an environment map's pixels
    else:
        yield f"{key} {_shown(old)} -> {_shown(new)}"


def _is_table(value: Any) -> bool:
    """Whether it is a list of spheres, planes or their like, and no vector."""
    return isinstance(value, list | tuple) and all(isinstance(row, dict) for row in value)


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    if isinstance(value, list | tuple):
        shown = [_shown(part) for part in value]
        return shown[0] if shown and len(set(shown)) == 1 and len(shown) == 3 else f"[{', '.join(shown)}]"
    return str(value)
