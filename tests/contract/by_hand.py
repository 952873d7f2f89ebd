"""The six stages as a student might write them: right, and by other formulas than the reference's."""

import numpy as np


def back_project(K, dist, width, height):
    """The distortion undone by 60 steps of the fixed-point iteration."""
    k1, k2, p1, p2, k3 = dist
    rays = np.empty((height, width, 3))
    for v in range(height):
        xd = (np.arange(width) - K[0, 2]) / K[0, 0]
        yd = np.full(width, (v - K[1, 2]) / K[1, 1])
        x, y = xd, yd
        for _ in range(60):
            r2 = x**2 + y**2
            g = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
            x, y = (xd - 2 * p1 * x * y - p2 * (r2 + 2 * x**2)) / g, (yd - p1 * (r2 + 2 * y**2) - 2 * p2 * x * y) / g
        rays[v] = np.column_stack([x, y, np.ones(width)])
    return rays / np.sqrt((rays**2).sum(axis=2))[:, :, np.newaxis]


def estimate_pose(K, dist, object_points, image_points):
    """OpenCV's, whose t is a column."""
    import cv2

    _, rvec, t = cv2.solvePnP(object_points, image_points, K, dist)
    return cv2.Rodrigues(rvec)[0], t


def intersect_sphere(origins, directions, center, radius):
    """Geometrically, in single precision: the foot of the centre on the ray, half the chord to either side of it."""
    o, d = origins.astype(np.float32), directions.astype(np.float32)
    length = np.linalg.norm(d, axis=1)
    d = d / length[:, None]
    to_center = np.asarray(center, np.float32) - o
    along = np.einsum("ij,ij->i", to_center, d)
    height2 = np.linalg.norm(np.cross(to_center, d), axis=1) ** 2
    half = np.sqrt(np.maximum(radius**2 - height2, 0))
    t = np.where(along - half > 1e-6, along - half, along + half) / length
    return np.where((height2 <= radius**2) & (t > 1e-6), t, np.inf)


def shade(points, normals, albedo, to_light, irradiance, sky):
    """A loop over points and channels, in single precision."""
    out = np.zeros((len(points), 3), np.float32)
    albedo = np.broadcast_to(albedo, out.shape)
    for i in range(len(points)):
        cosine = max(0.0, float(sum(normals[i] * to_light)))
        for c in range(3):
            out[i, c] = albedo[i, c] * (irradiance[c] * cosine / np.pi + sky[c])
    return out


def eye_and_rays(scene):
    R, t = scene["R_cam_board"], scene["t_cam_board"]
    rays = back_project(scene["K"], scene["dist"], scene["width"], scene["height"]).reshape(-1, 3)
    rays = rays * np.linspace(0.5, 2, len(rays))[:, None]  # of any length
    return np.broadcast_to(-np.linalg.inv(R) @ t, rays.shape), rays @ R


def hit_points(scene):
    eye, d = eye_and_rays(scene)
    best, points = np.full(len(d), np.inf), np.full(d.shape, np.nan)
    for s in scene["spheres"]:
        t = intersect_sphere(eye, d, s["center"], s["radius"])
        closer = t < best
        best[closer] = t[closer]
        points[closer] = eye[closer] + t[closer, None] * d[closer]
    return points.reshape(scene["height"], scene["width"], 3)


def intersect_plane(o, d, plane):
    """By Cramer's rule: o + t d = center + a half_u + b half_v."""
    t = np.full(len(o), np.inf)
    for i in range(len(o)):
        M = np.column_stack([-d[i], plane["half_u"], plane["half_v"]])
        if abs(np.linalg.det(M)) > 1e-15:
            s, a, b = np.linalg.solve(M, o[i] - plane["center"])
            if s > 1e-9 and abs(a) <= 1 and abs(b) <= 1:
                t[i] = s
    return t


def render(scene):
    """Shadow rays start a little off the surface, as usual."""
    eye, d = eye_and_rays(scene)
    things = scene["planes"] + scene["spheres"]

    def meet(o, d):
        return np.array([
            intersect_sphere(o, d, x["center"], x["radius"]) if "radius" in x else intersect_plane(o, d, x)
            for x in things
        ])  # fmt: skip

    ts = meet(eye, d)
    image = np.repeat(scene["sky"]["radiance"][None], len(d), axis=0)
    for k, thing in enumerate(things):
        mine = np.isfinite(ts[k]) & (ts[k] == ts.min(axis=0))
        if not mine.any():
            continue
        p = eye[mine] + ts[k, mine, None] * d[mine]
        n = p - thing["center"] if "radius" in thing else np.cross(thing["half_u"], thing["half_v"]) + 0 * p
        n = n / np.linalg.norm(n, axis=1)[:, None]
        n = n * -np.sign((n * d[mine]).sum(axis=1))[:, None]
        E = np.tile(scene["sun"]["irradiance"], (len(p), 1))
        if scene["rung"] == "shadow":
            to_light = np.tile(scene["sun"]["to_light"], (len(p), 1))
            E = E * ~np.isfinite(meet(p + 1e-5 * n, to_light)).any(axis=0)[:, None]
        cosine = np.maximum(0, n @ scene["sun"]["to_light"])[:, None]
        image[mine] = thing["albedo"] / np.pi * E * cosine + thing["albedo"] * scene["sky"]["radiance"]
    return image.reshape(scene["height"], scene["width"], 3)
