"""The paper's way: a double Python loop over the pixels, plain floats, one ray each; no arrays at all.

It stays as the slowest method of the bench, and as a second opinion: nothing of the tracer's arithmetic is used but the
undoing of the lens. The quadratic of the sphere is solved as in textbooks, in float64.
"""

from collections.abc import Sequence
from math import inf, pi, sqrt

import numpy as np

from raytwin.fast import TRIMS, background
from raytwin.fast.frame import newton_steps
from raytwin.rungs import RUNGS
from raytwin.scene import Scene, Shape, Sphere, Vector
from raytwin.scene.lens import without_ray
from raytwin.tracer.pixel_to_ray import undistort


def loop(scene: Scene, rung: str = "lambert", trim: str = "none") -> np.ndarray:
    """Radiance (H, W, 3) float32: for every pixel a ray, for every ray the nearest object, for every hit its light.

    `trim`: the box of each object outside which it is not tested.
    """
    scene.check_lambertian("the loop")
    camera = scene.camera
    out = background(scene, rung)
    (fx, cx), (fy, cy) = (camera.fx, camera.cx), (camera.fy, camera.cy)
    dist, steps = camera.coefficients, newton_steps(camera)
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = camera.R_cam_board
    eye, to_light = camera.eye, scene.sun.to_light
    things = list(scene.objects)
    boxes = TRIMS[trim](things, camera).tolist()
    if not boxes:
        return out
    x0, y0, x1, y1 = (list(side) for side in zip(*boxes, strict=True))
    lost = without_ray(camera)
    for v in range(min(y0), max(y1)):
        row = [i for i, box in enumerate(boxes) if box[1] <= v < box[3]]
        for u in range(min(x0), max(x1)):
            near, seen = inf, None
            tests = [i for i in row if boxes[i][0] <= u < boxes[i][2]]
            if not tests or (lost is not None and lost[v, u]):
                continue
            x, y = (u - cx) / fx, (v - cy) / fy
            x, y = undistort(x, y, dist, steps)
            length = sqrt(x * x + y * y + 1)
            x, y, z = x / length, y / length, 1 / length
            d = (r00 * x + r10 * y + r20 * z, r01 * x + r11 * y + r21 * z, r02 * x + r12 * y + r22 * z)
            for i in tests:
                t = distance(eye, d, things[i])
                if t < near:
                    near, seen = t, i
            if seen is None:
                continue
            thing = things[seen]
            p = (eye[0] + near * d[0], eye[1] + near * d[1], eye[2] + near * d[2])
            n = normal(p, thing)
            if n[0] * d[0] + n[1] * d[1] + n[2] * d[2] > 0:
                n = (-n[0], -n[1], -n[2])
            light = max(0.0, n[0] * to_light[0] + n[1] * to_light[1] + n[2] * to_light[2]) / pi
            if RUNGS[rung].shadows and light > 0 and shaded(p, to_light, things, seen, n):
                light = 0.0
            out[v, u] = [
                a * (light * e + s)
                for a, e, s in zip(thing.material.albedo, scene.sun.irradiance, scene.sky_radiance, strict=True)
            ]
    return out


def distance(o: Vector, d: Vector, thing: Shape) -> float:
    """The least t > 0 where the ray o + t d (unit) meets the object; infinity for a miss."""
    if isinstance(thing, Sphere):
        c = thing.center
        f = (o[0] - c[0], o[1] - c[1], o[2] - c[2])
        b = f[0] * d[0] + f[1] * d[1] + f[2] * d[2]
        disc = b * b - (f[0] * f[0] + f[1] * f[1] + f[2] * f[2] - thing.radius * thing.radius)
        if disc < 0:
            return inf
        root = sqrt(disc)
        return -b - root if -b - root > 0 else -b + root if root - b > 0 else inf
    n, c, u, v = thing.normal, thing.center, thing.half_u, thing.half_v
    slope = n[0] * d[0] + n[1] * d[1] + n[2] * d[2]
    if slope == 0:
        return inf
    t = (n[0] * (c[0] - o[0]) + n[1] * (c[1] - o[1]) + n[2] * (c[2] - o[2])) / slope
    if t <= 0:
        return inf
    q = (o[0] + t * d[0] - c[0], o[1] + t * d[1] - c[1], o[2] + t * d[2] - c[2])
    for half in (u, v):
        if abs(q[0] * half[0] + q[1] * half[1] + q[2] * half[2]) > half[0] ** 2 + half[1] ** 2 + half[2] ** 2:
            return inf
    return t


def normal(p: Vector, thing: Shape) -> Vector:
    (x, y, z), k = thing.facing
    c = thing.center
    return x + k * (p[0] - c[0]), y + k * (p[1] - c[1]), z + k * (p[2] - c[2])


def shaded(p: Vector, to_light: Vector, things: Sequence[Shape], own: int, n: Vector) -> bool:
    """Does another object stand between p and the sun, or its own sphere round it?"""
    for i, thing in enumerate(things):
        if i != own and distance(p, to_light, thing) < inf:
            return True
        if i == own and thing.facing[1]:
            out = normal(p, thing)
            if out[0] * n[0] + out[1] * n[1] + out[2] * n[2] < 0:
                return True
    return False
