"""Render a sphere with one Mitsuba variant and print what came out: a script, run in a process of its own.

A wrong libLLVM does not raise, it aborts the process at the first kernel. So the probe uses what the twin uses, and the
parent looks at exit code and output. It imports nothing of raytwin, so that the child starts fast.
"""

import json
import os
import sys
from pathlib import Path

import drjit as dr
import mitsuba as mi

variant = sys.argv[1]
mi.set_variant(variant)
mi.file_resolver().prepend(str(Path(mi.__file__).parent))  # else `plugins` of the current folder would come first
sphere = {"type": "sphere", "center": [0, 0, 4], "bsdf": {"type": "diffuse", "reflectance": 0.5}}
scene = mi.load_dict({"type": "scene", "sphere": sphere, "sky": {"type": "constant", "radiance": 0.25}})
# The process id makes new kernels: a cached one would run even where this LLVM cannot compile it.
x = dr.linspace(dr.float64_array_t(mi.Float), -0.02, 0.02, 4096) * (1 + os.getpid() * 1e-12)
z = 1 / dr.sqrt(x * x + 1)
ray = mi.RayDifferential3f(mi.Ray3f(mi.Point3f(0), mi.Vector3f(mi.Float(x * z), 0, mi.Float(z))))
hit = scene.ray_intersect(ray)
lit = ~scene.ray_test(mi.Ray3f(hit.p + 1e-3 * hit.n, mi.Vector3f(0, 0, -1)))
sampler = mi.load_dict({"type": "independent"})
sampler.seed(0, 4096)
light = mi.load_dict({"type": "path", "max_depth": 4}).sample(scene, sampler, ray)[0]
found = {
    "depth": dr.min(hit.t)[0],  # head-on: 4 - 1
    "lit": dr.count(lit)[0] / 4096,  # the sun stands behind the eye: 1
    "light": dr.mean(light.y)[0],  # a convex body under a uniform sky: albedo Ls = 0.125
}
print(json.dumps(found | {"llvm": ".".join(map(str, dr.detail.llvm_version())) if "llvm" in variant else None}))
