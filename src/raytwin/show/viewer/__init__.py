"""The one picture viewer: a script that every page of pictures, a live page or a notebook mounts, and what feeds it.

`pack` makes planes of two images; `script()` is values.js (numbers), colour.js (maps), view.js (painting, pointer,
keys) and page.js (the controls around) in one, `style()` viewer.css. Knows images, and nothing of what made them. In a
page of pictures the data lies in the page; a live one pushes it:

    const panes = [{ key: "test", kind: "radiance", title: "Tracer", alt: "The scene" }];
    const viewer = mount(element, { width, height, names: { test: "tracer" }, panes });
    viewer.update("test", halves);          // a Uint16Array of half floats, a Float32Array, or a decoded JPEG
    viewer.feed(planes);                    // what `raw` gives of two images, each with its `words`, a Uint16Array
    viewer.set({ exposure: 1, map: "relative" });
    viewer.look(x, y, span);
"""

from importlib import resources

from raytwin.images.packing import Packed, Plane, pack, pack_one, pack_parts, raw, raw_parts

MODULES = "values", "colour", "view", "page"
EXPORTED = "digits", "el", "encode", "mount"
"""What the live page takes from the module."""

__all__ = ["Packed", "Plane", "module", "pack", "pack_one", "pack_parts", "raw", "raw_parts", "script", "style"]


def module() -> str:
    """Return the four modules as one that exports `mount(element, data)` and what the live page takes from it."""
    parts = [
        resources.files("raytwin.show.viewer").joinpath(f"{name}.js").read_text(encoding="utf-8") for name in MODULES
    ]
    lines = [line for part in parts for line in part.splitlines() if not line.startswith(("import {", "export {"))]
    return "\n".join([*lines, f"export {{ {', '.join(EXPORTED)} }};", ""])


def script() -> str:
    """Return the same as a plain script that leaves `raytwin.mount`: browsers load no module from a file by a page."""
    body, _, _ = module().rpartition("export {")
    return f'"use strict";\n(() => {{\n{body}globalThis.raytwin = {{ mount }};\n}})();\n'


def style() -> str:
    return resources.files("raytwin.show.viewer").joinpath("viewer.css").read_text(encoding="utf-8")
