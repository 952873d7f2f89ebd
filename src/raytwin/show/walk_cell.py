"""What a learner sees: the check's sentence, and the picture so far beside the twin's."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from raytwin.images.image import Image
from raytwin.images.photo_files import to_bytes, write_picture
from raytwin.show import viewer
from raytwin.show.notebook_page import Pictures, pair_figures, small_picture
from raytwin.show.viewer.widget import in_notebook, pane
from raytwin.teach.contract.check import check
from raytwin.teach.contract.stage_table import LESSONS

FOLDER = Path("walk")
"""Where a script's pictures go."""


def mine(stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, checked; raytwin's own where it is empty or not correct yet, so that the walk goes on."""
    if getattr(getattr(function, "__code__", None), "co_code", b"") == _empty.__code__.co_code:
        print(f"TODO  {stage}: yours to write (until then raytwin's own takes its place)")
        return LESSONS[stage].reference
    result = check(stage, function)
    if in_notebook():
        from IPython.display import display

        display(result)
    if result.passed:
        return function
    print(f"       (raytwin's own {stage} takes its place in what follows)")
    return LESSONS[stage].reference


def _empty() -> None:
    """As the lessons' functions are before anyone fills them."""
    ...


def show(name: str, yours: np.ndarray, twin: np.ndarray | Image | None = None) -> Any:
    """Two images (H, W, 3) of linear radiance beside each other: the viewer in a notebook, else a file in walk/."""
    other = twin.mean if isinstance(twin, Image) else twin
    pair = np.asarray(yours, np.float32), None if other is None else np.asarray(other, np.float32)
    caption = name
    if pair[1] is not None:
        caption += f": RMSE {np.sqrt(np.mean(np.square(pair[0] - pair[1], dtype=float))):.2g} beside the twin"
    if in_notebook():
        print(caption)
        return viewed(name, *pair)
    FOLDER.mkdir(exist_ok=True)
    path = FOLDER / f"{name.replace(' ', '-')}.png"
    gap = np.ones((pair[0].shape[0], 8, 3), np.float32)
    row = pair[0] if pair[1] is None else np.concatenate([pair[0], gap, pair[1]], axis=1)
    write_picture(path, to_bytes(row))
    print(f"{caption}, {path}")
    return None


def viewed(name: str, yours: np.ndarray, twin: np.ndarray | None) -> Pictures:
    """Return the two as a notebook's cell shows them."""
    panes, names = [pane("test", f"{name}: yours", "yours", f"{name}, yours")], {"test": "yours"}
    test, reference = Image(yours), Image(yours if twin is None else twin)
    figures = [(small_picture(test, 1.0), panes[0]["title"])]
    if twin is not None:
        panes.append(pane("reference", "The twin's", "twin", f"{name}, the twin's"))
        panes.append(pane("map", "Difference", "difference", "Their difference", kind="map"))
        names["reference"] = "twin"
        figures = pair_figures(test, reference, [one["title"] for one in panes], gain=1.0)
    packed = viewer.pack(test, reference, surfaces=False)
    return Pictures(figures, packed.for_page() | {"names": names, "panes": panes})
