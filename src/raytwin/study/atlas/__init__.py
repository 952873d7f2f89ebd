"""Where each numerical method fails: driven there, beside what theory predicts. `EXPERIMENTS` is the table.

Experiment (a row: a parameter, methods, a truth, a bound, laws) -> run -> Found (errors, edges) -> Atlas -> JSON, page

To add an experiment, write a function (x, rng, trials) -> errors by method, and a row in its file's EXPERIMENTS.
"""

from raytwin.errors import check_one_of
from raytwin.progress import Progress, silent
from raytwin.study.atlas import lenses, poses, spheres, surfaces, trims
from raytwin.study.atlas.experiment import Atlas, Curve, Experiment, Found, digits, run

__all__ = ["EXPERIMENTS", "Atlas", "Curve", "Experiment", "Found", "atlas", "digits", "run"]

FILES = spheres, surfaces, lenses, trims, poses
EXPERIMENTS: dict[str, Experiment] = {e.name: e for file in FILES for e in file.EXPERIMENTS}
"""name -> row, in the order of the page."""


def atlas(names: tuple[str, ...] = (), progress: Progress = silent) -> Atlas:
    """The experiments of these names, or all. Raises InputError for an unknown one."""
    for name in names:
        check_one_of("experiment", name, EXPERIMENTS)
    chosen = [e for e in EXPERIMENTS.values() if not names or e.name in names]
    found = []
    for i, experiment in enumerate(chosen):
        progress("experiments", i, len(chosen))
        found.append(run(experiment))
    progress("experiments", len(chosen), len(chosen))
    return Atlas(tuple(found))
