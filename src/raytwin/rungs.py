"""The ladder of light transport: what each rung adds to the one below it. Subject and twin map a row to a function.

To add a rung, add a row, its function to `tracer.shading.RADIANCE` and its kernel to the twin's table.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Rung:
    """One row: its `name` and, in words, its `reach`, which ends "a tracer that stops at".

    `shadows`: the sun may be hidden. `sky`: how its light is summed, `none`, `open` (nothing hides it) or `occluded`.
    `depth`: the surfaces that light may have met where it is followed from one to the next, counted as Mitsuba does
    (light, surface, eye: 2); None where a formula gives the radiance. `noisy`: it is found by random samples.
    `background`: a ray that meets nothing sees the sky; if not, black.
    """

    name: str
    reach: str
    shadows: bool = True
    sky: str = "open"
    depth: int | None = None
    noisy: bool = False
    background: bool = True

    def lacks(self, part: str, depth: int | None = None) -> bool:
        """Return whether it lacks a part of the light, one of `fast.part_names`; `depth` replaces the rung's own."""
        if part.startswith("bounce"):
            return int(part.removeprefix("bounce").rstrip("+")) + 2 > (depth or self.depth or 0)
        return not {"open": self.lit, "shadow": self.shadows, "occlusion": self.sky == "occluded"}[part]

    @property
    def lit(self) -> bool:
        """There is light at all."""
        return self.shadows or self.sky != "none"

    def sampled(self, sampling: str) -> bool:
        """Random samples make it where rays go as `sampling`, one of SAMPLINGS, says."""
        return self.noisy or (sampling == "area" and self.lit)


RUNGS = {
    rung.name: rung
    for rung in (
        # Which object, how far, which way it faces.
        Rung("surface", "geometry", shadows=False, sky="none", background=False),
        # Sun without shadows and sky without occlusion: the paper's model.
        Rung("lambert", "unshadowed light", shadows=False),
        Rung("shadow", "shadows"),
        Rung("sky", "the sky's occlusion", sky="occluded", depth=2, noisy=True),
        Rung("path", "bounced light", sky="occluded", depth=8, noisy=True),
    )
}
"""name -> row, from the least light to all of it."""

SAMPLINGS = "center", "area"
"""Where rays go: through the pixel's center, or anywhere on its area."""
MOST_SAMPLES = 1 << 24
"""Samples per pixel of a render of the twin, all followed at once: 2 GB. For more, average renders of several seeds."""
