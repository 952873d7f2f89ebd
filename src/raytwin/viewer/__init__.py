"""The one picture viewer: a script that every page of pictures, a live page or a notebook mounts, and what feeds it.

`pack` makes planes of two images; `script()` and `style()` are viewer.js and viewer.css. Knows images, and nothing of
what made them. In a page of pictures the data lies in the page; a live one pushes it:

    const panes = [{ key: "test", kind: "radiance", title: "Tracer", alt: "The scene" }];
    const viewer = mount(element, { width, height, names: { test: "tracer" }, panes });
    viewer.update("test", halves);          // a Uint16Array of half floats, a Float32Array, or a decoded JPEG
    viewer.feed(planes);                    // what `raw` gives of two images, each with its `words`, a Uint16Array
    viewer.set({ exposure: 1, map: "relative" });
    viewer.look(x, y, span);
"""

from importlib import resources

from raytwin.viewer.packing import Packed, Plane, pack, pack_one, raw

__all__ = ["Packed", "Plane", "module", "pack", "pack_one", "raw", "script", "style"]


def module() -> str:
    """viewer.js, an ES module that exports `mount(element, data)`, and what the live page takes from it."""
    return resources.files("raytwin.viewer").joinpath("viewer.js").read_text(encoding="utf-8")


def script() -> str:
    """The same as a plain script, which leaves `raytwin.mount`: a browser loads no module from a file beside a page."""
    body, mark, _ = module().rpartition("export {")
    assert mark, "viewer.js must end with its export"
    return f'"use strict";\n(() => {{\n{body}globalThis.raytwin = {{ mount }};\n}})();\n'


def style() -> str:
    return resources.files("raytwin.viewer").joinpath("viewer.css").read_text(encoding="utf-8")
