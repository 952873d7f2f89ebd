"""Count the files that one pixel visits, and how often its computation goes from one file to another.

`python -m measure.one_pixel [SCENE] [RUNG]`, in tests/ (single, lambert), traces one pixel by the plain tracer. A call
into another file of raytwin is a change, and its return another; `arrays`, the arithmetic's own names, counts apart,
and so does what an image of any size needs once: the scene in the camera's frame, its lens and light.
"""

import sys
from collections import Counter
from itertools import pairwise
from pathlib import Path
from types import FrameType

import raytwin
from raytwin.scene.scene_files import read_scene
from raytwin.tracer import trace

ROOT = Path(raytwin.__file__).parent


ONCE = "_set_up", "blacken", "without_ray"
"""Functions of an image, whatever its pixels; what they call counts apart."""


def visited(scene_name: str, rung: str, whole: bool) -> list[str]:
    """The files in the order of the visits; `whole`: with what is done once for an image."""
    scene = read_scene(ROOT.parents[1] / "scenes" / scene_name)
    scene = scene.with_camera(scene.camera.resized(1, 1))
    trace(scene, rung)  # what is computed once is no pixel's
    stack: list[str] = []
    seen: list[str] = []
    once: list[FrameType] = []

    def note(frame: FrameType, event: str, _: object) -> None:
        file = frame.f_code.co_filename
        if event not in ("call", "return") or not file.startswith(str(ROOT)):
            return
        if not whole and event == "call" and frame.f_code.co_name in ONCE:
            once.append(frame)
        if once:
            if event == "return" and frame is once[-1]:
                once.pop()
            return
        if event == "call":
            stack.append(file)
        elif stack:
            stack.pop()
        if stack and seen[-1:] != stack[-1:]:
            seen.append(stack[-1])

    sys.setprofile(note)
    try:
        trace(scene, rung)
    finally:
        sys.setprofile(None)
    return [str(Path(file).relative_to(ROOT)) for file in seen]


def main(scene: str = "single", rung: str = "lambert") -> None:
    """Print the counts, and how often each file is entered."""
    for what, whole in (("one pixel", False), ("with what an image needs once", True)):
        found = visited(scene, rung, whole)
        steps = [file for file in found if file != "tracer/arrays.py"]
        changes = sum(a != b for a, b in pairwise(steps))
        told = f"{len(set(found))} files, {len(found) - 1} changes of file, {changes} but for arithmetic"
        print(f"{scene}, {rung}, {what}: {told}")
    for file, count in Counter(visited(scene, rung, whole=False)).most_common():
        print(f"  {count:4d}  {file}")


if __name__ == "__main__":
    main(*sys.argv[1:])
