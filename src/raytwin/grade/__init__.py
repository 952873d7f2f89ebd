"""Students' tracers, graded."""
