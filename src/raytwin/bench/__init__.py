"""Every method's seconds beside its error: RENDERERS, one run over them, the frontier, and two runs compared.

RENDERERS -> prepare -> measure (interleaved) -> truth -> Bench (JSON) -> frontier, fits, against -> report
"""

from raytwin.bench.bench_record import (
    Bench,
    Converged,
    Deviation,
    Growth,
    LeftOut,
    Measurement,
    Repeats,
    read_bench,
    write_bench,
)
from raytwin.bench.bench_run import GROWTH, bench
from raytwin.bench.frontier import fit_power, on_frontier, ratio_interval, staircase
from raytwin.bench.regression import Changes, MethodChange, against
from raytwin.renderers.renderer_table import RENDERERS, choose
