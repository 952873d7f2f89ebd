"""Every method's seconds beside its error: RENDERERS, one run over them, and the frontier.

RENDERERS -> references -> first calls -> rounds in random order -> Measurement -> frontier -> report
"""

from raytwin.renderers.renderer_table import RENDERERS, renderers_of
from raytwin.study.bench.bench_record import Bench, Measurement, write_bench
from raytwin.study.bench.bench_run import bench, bench_scenes, on_frontier, staircase
