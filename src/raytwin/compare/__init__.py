"""Two images in, one Comparison out: metrics, geometry, statistics, the verdict and heat maps.

Knows images, not renderers. `compare` decides, `METRICS` measures, `error_map` colours. A `Report` is a
Comparison with its scene and its costs.

Called, this package is `raytwin.compare(a, b)`: see `help(raytwin.diff_files)`.
"""

from raytwin.compare.comparison import Comparison, Geometry, Part, Perceptual, Radiance, Report, Statistics, Verdict
from raytwin.compare.exact import scaled
from raytwin.compare.heatmap import error_map, error_scale
from raytwin.compare.metrics import METRICS, Metric, measure
from raytwin.compare.sequential import SequentialComparison
from raytwin.compare.verdict import compare
from raytwin.judging import Judging
