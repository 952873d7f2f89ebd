"""The data of a viewer that shows any two of many pictures; its template is picture_pair.html.j2."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from raytwin.images.image import Image
from raytwin.show import viewer
from raytwin.show.data_urls import stops

STYLES, SCRIPTS = ("levels.css", viewer.style()), ("charts.js", viewer.script())
LINEAR = 0.1
"""Errors of a thousandth of this share of the light are still coloured."""


def picture_pair(images: Mapping[str, Image], first: tuple[str, str], like: str) -> dict[str, Any]:
    """Return `data` of the viewer, `pictures` to choose from, and `first`, the two that it opens with.

    `like`: the image whose exposure all have.
    """
    test, reference = (Image(images[name].mean) for name in first)
    packed = viewer.pack(test, reference, budget=1 << 40, most_pixels=1 << 40)
    panes = [
        {"key": "test", "kind": "radiance", "title": "A", "tab": "A", "alt": "picture A"},
        {"key": "reference", "kind": "radiance", "title": "B", "tab": "B", "alt": "picture B"},
        {"key": "map", "kind": "map", "title": "A − B", "tab": "A − B", "alt": "A minus B"},
    ]
    data = packed.for_page() | {
        "names": {"test": "A", "reference": "B"}, "panes": panes, "noisy": False,
        "bound": {"share": LINEAR, "scale": 1.0, "held": False}, "exposure": stops(images[like]),
    }  # fmt: skip
    pictures = {name: [asdict(plane) for plane in viewer.pack_one(image)] for name, image in images.items()}
    return {"data": data, "pictures": pictures, "first": first}
