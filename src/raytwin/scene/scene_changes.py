"""What differs between two scenes: `spheres[1].radius 0.03 -> 0.04`."""

import reprlib
from collections.abc import Iterator
from typing import Any

from raytwin.scene.scene import Scene
from raytwin.scene.toml_json import plain

MAX_CHANGES_NAMED = 4
"""Changes that `summary` names; of further ones it gives the number."""


def summary(old: Scene, new: Scene) -> str:
    """Return the changes in one line; empty where there are none."""
    found = list(changes(old, new))
    more = [f"and {len(found) - MAX_CHANGES_NAMED} more"] if len(found) > MAX_CHANGES_NAMED else []
    return ", ".join([*found[:MAX_CHANGES_NAMED], *more])


def changes(old: Scene, new: Scene) -> Iterator[str]:
    """Yield every value that differs and decides how the scene looks or when two images of it agree, by its key."""
    before, after = (_tables(scene) for scene in (old, new))
    for key in dict.fromkeys((*before, *after)):
        yield from _differences(key, before.get(key), after.get(key))


def _tables(scene: Scene) -> dict[str, Any]:
    found: dict[str, Any] = {kind: plain(getattr(scene, kind)) for kind in ("camera", "sun", "sky", "tolerance")}
    for kind in ("spheres", "planes"):
        found |= {f"{kind}[{i}]": plain(thing) for i, thing in enumerate(getattr(scene, kind))}
    return found


def _differences(key: str, old: Any, new: Any) -> Iterator[str]:
    if isinstance(old, dict) and isinstance(new, dict):
        for name in dict.fromkeys((*old, *new)):
            if name != "name":  # of an object: it decides nothing
                yield from _differences(f"{key}.{name}", old.get(name), new.get(name))
    elif old != new and (old is None or new is None):
        yield f"{key} {'added' if old is None else 'removed'}"
    elif old != new:
        yield f"{key} {_shown(old)} -> {_shown(new)}"


def _shown(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_shown, value))}]"
    return f"{value:.12g}" if isinstance(value, float) else reprlib.repr(value)
