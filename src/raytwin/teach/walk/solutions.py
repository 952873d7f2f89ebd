"""Every function of the walk, filled in: one way of several."""

import numpy as np


def tag_centers(corners):
    """Each line through two points is their cross product, and so is the point where two lines cross."""
    a, b, c, d = np.moveaxis(np.concatenate([corners, np.ones((len(corners), 4, 1))], axis=-1), 1, 0)
    crossing = np.cross(np.cross(a, c), np.cross(b, d))
    return crossing[:, :2] / crossing[:, 2:] - 0.5


def intrinsics(homographies):
    """In thousands of pixels, so that no equation outweighs another."""
    H = np.diag([1e-3, 1e-3, 1]) @ homographies

    def v(i, j):
        a, b = H[:, :, i].T, H[:, :, j].T
        return np.stack(
            [a[0] * b[0], a[1] * b[1], a[0] * b[2] + a[2] * b[0], a[1] * b[2] + a[2] * b[1], a[2] * b[2]], 1
        )

    rows = np.concatenate([v(0, 1), v(0, 0) - v(1, 1)])
    B11, B22, B13, B23, B33 = np.linalg.svd(rows / np.linalg.norm(rows, axis=1, keepdims=True))[2][-1]
    cx, cy = -B13 / B11, -B23 / B22
    s = B33 + cx * B13 + cy * B23
    return np.array([[1e3 * np.sqrt(s / B11), 0, 1e3 * cx], [0, 1e3 * np.sqrt(s / B22), 1e3 * cy], [0, 0, 1]])


def back_project(K, dist, width, height):
    """Undone by the fixed-point iteration."""
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    seen_x, seen_y = (u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]
    k1, k2, p1, p2, k3 = dist
    x, y = seen_x, seen_y
    for _ in range(100):
        rr = x * x + y * y
        g = 1 + k1 * rr + k2 * rr**2 + k3 * rr**3
        x, y = (
            (seen_x - 2 * p1 * x * y - p2 * (rr + 2 * x * x)) / g,
            (seen_y - p1 * (rr + 2 * y * y) - 2 * p2 * x * y) / g,
        )
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def intersect_sphere(origins, directions, center, radius):
    """Both roots; the first that is positive."""
    f = origins - center
    a, b, c = (directions**2).sum(axis=1), (f * directions).sum(axis=1), (f**2).sum(axis=1) - radius**2
    square = b * b - a * c
    root = np.sqrt(np.maximum(square, 0))
    near, far = (-b - root) / a, (-b + root) / a
    return np.where(square < 0, np.inf, np.where(near > 0, near, np.where(far > 0, far, np.inf)))


def shade(points, normals, albedo, to_light, irradiance, sky):
    """Sun and sky."""
    cosine = np.maximum(0, normals @ to_light)[:, None]
    return albedo / np.pi * irradiance * cosine + albedo * sky


def sun_visible(points, to_light, centers, radii):
    """From a little off the surface: along the way to the sun, which leads away from the own sphere."""
    visible = np.ones(len(points))
    for center, radius in zip(centers, radii, strict=True):
        f = points + 1e-6 * to_light - center
        b, c = f @ to_light, (f**2).sum(axis=1) - radius**2
        outside = np.abs(np.linalg.norm(points - center, axis=1) / radius - 1) > 1e-6
        visible[outside & (b * b > c) & (b < 0)] = 0
    return visible


def sky_visible(points, normals, centers, radii):
    """What the spheres hide, one after the other."""
    share = np.ones(len(points))
    for center, radius in zip(centers, radii, strict=True):
        f = center - points
        d = np.linalg.norm(f, axis=1)
        share -= (radius / d) ** 2 * np.maximum(0, (f * normals).sum(axis=1) / d)
    return share


def sample_cosine(u):
    """Malley's."""
    r, z, angle = np.sqrt(u[:, 0]), np.sqrt(1 - u[:, 0]), 2 * np.pi * u[:, 1]
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=-1), z / np.pi, np.ones(len(u))
