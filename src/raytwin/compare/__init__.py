"""Two images in, one Comparison out: metrics, geometry, statistics, the verdict and heat maps.

Knows images, not renderers. `compare` judges (`judge_limits`: by counts alone), `METRICS` measures, `error_map`
colours.
"""

from raytwin.compare.comparison import Comparison, Geometry, Part, Perceptual, Radiance, Statistics
from raytwin.compare.heatmap import KINDS, error_map, error_scale
from raytwin.compare.limits import Limits, judge_limits
from raytwin.compare.metrics import METRICS, Metric, measure
from raytwin.compare.verdict import compare

__all__ = [
    "KINDS",
    "METRICS",
    "Comparison",
    "Geometry",
    "Limits",
    "Metric",
    "Part",
    "Perceptual",
    "Radiance",
    "Statistics",
    "compare",
    "error_map",
    "error_scale",
    "judge_limits",
    "measure",
]
