"""Every way to an image that has a name of its own: what the bench measures, and what `--subject` takes."""

from collections.abc import Sequence
from fnmatch import fnmatchcase

from raytwin.errors import InputError
from raytwin.removed import removed_renderer
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.subject_renderers import Filled, PathTraced, Speculated, Traced
from raytwin.renderers.twin_renderers import Twin

COUNTS = (1, 4, 16, 64, 256, 1024)
VARIANTS = "llvm_ad_rgb", "cuda_ad_rgb"

RENDERERS: dict[str, Renderer] = {
    method.name: method
    for method in (
        Filled(),
        # One ray per pixel: engine, precision, rung, trim.
        *(Traced(rung, f"{library}{bits}", trim)
          for library in ("numpy", "drjit", "cuda") for bits in (32, 64)
          for rung, trims in (("lambert", ("none", "conic")), ("shadow", ("none", "corners", "conic")))
          for trim in trims),
        *(Traced(engine=engine, samples=n) for engine in ("numpy32", "drjit32", "cuda32") for n in (4, 16, 64)),
        # Light followed from surface to surface.
        *(PathTraced(rung, engine, n) for engine in ("drjit32", "cuda32") for rung in ("sky", "path") for n in COUNTS),
        # The paper's speculation, and ours.
        *(Speculated(engine="numpy32", way=way, step=n) for way in ("paper", "careful") for n in (1, 2, 4, 8, 16)),
        Speculated(engine="numpy32", way="paper", step=4, smoothed=True),
        *(Twin("shadow", variant) for variant in VARIANTS),
        *(Twin(rung, variant, n) for variant in VARIANTS for rung in ("sky", "path") for n in COUNTS),
    )
}  # fmt: skip
"""name -> method, in the order in which the bench lists them."""


def renderers_of(globs: Sequence[str] = ("*",)) -> list[Renderer]:
    """Return the methods whose name matches a pattern, in the table's order.

    Raises InputError for a pattern that matches none.
    """
    for glob in globs or [""]:
        if gone := removed_renderer(glob):
            raise InputError("--methods", "a renderer that raytwin has", gone)
        if not any(fnmatchcase(name, glob) for name in RENDERERS):
            raise InputError("--methods", "patterns of names as drjit32-* (`raytwin bench list`)", glob or "none")
    return [method for name, method in RENDERERS.items() if any(fnmatchcase(name, glob) for glob in globs)]
