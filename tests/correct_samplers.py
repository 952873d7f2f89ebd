"""Samplers that are correct, by other formulas than the textbook's: (stage, function) by name."""

import numpy as np


def direction(z, turn):
    """Unit directions of cos θ and of a share of the whole turn."""
    rho = np.sqrt(np.maximum(1 - z * z, 0))
    return np.stack([rho * np.cos(2 * np.pi * turn), rho * np.sin(2 * np.pi * turn), z], axis=-1)


def lambertian(directions):
    pdf = directions[:, 2] / np.pi
    return directions, pdf, np.ones(len(directions))


def concentric(u):
    """Shirley and Chiu 1997."""
    x, y = 2 * u.T - 1
    wide = np.abs(x) > np.abs(y)
    with np.errstate(all="ignore"):
        angle = np.where(wide, np.pi / 4 * y / x, np.pi / 2 - np.pi / 4 * x / y)
    r = np.where(wide, x, y)
    return lambertian(np.stack([r * np.cos(angle), r * np.sin(angle), np.sqrt(1 - r * r)], axis=-1))


def polar(u):
    r, angle = np.sqrt(u[:, 0]), 2 * np.pi * u[:, 1]
    return lambertian(np.stack([r * np.cos(angle), r * np.sin(angle), np.sqrt(1 - u[:, 0])], axis=-1))


def rejection(u):
    """Points of the square until one is in the disk, of numbers that u seeds."""
    rng = np.random.default_rng(np.ascontiguousarray(u[:2]).view(np.uint64).ravel())
    x, y = rng.uniform(-1, 1, (2, 2 * len(u)))
    inside = x * x + y * y < 1
    x, y = x[inside][: len(u)], y[inside][: len(u)]
    return lambertian(np.stack([x, y, np.sqrt(1 - x * x - y * y)], axis=-1))


def normal_plus_sphere(u):
    moved = direction(2 * u[:, 0] - 1, u[:, 1]) + np.array([0.0, 0.0, 1.0])
    return lambertian(moved / np.linalg.norm(moved, axis=-1, keepdims=True))


def stratified(u):
    """A jittered grid of as many cells as there are numbers."""
    side = int(np.sqrt(len(u)))
    cell = np.indices((side, side)).reshape(2, -1).T
    return polar((cell + u[: side * side]) / side) if side * side == len(u) else polar(u)


def hemisphere(u):
    z = u[:, 1]
    return direction(z, u[:, 0]), np.full(len(u), 0.5 / np.pi), 2 * z


def cone(u, cos_max):
    """A point of the unit sphere's cap by its height, which is even (Archimedes)."""
    solid = 2 * np.pi * (1 - cos_max)
    return (
        direction(cos_max + u[:, 0] * (1 - cos_max), 0.25 - u[:, 1]),
        np.full(len(u), 1 / solid),
        np.full(len(u), solid),
    )


def phong(u, exponent):
    z = np.exp(np.log(np.maximum(u[:, 1], 1e-300)) / (exponent + 1))
    pdf = (exponent + 1) / (2 * np.pi) * z**exponent
    return direction(z, u[:, 0]), pdf, np.full(len(u), (exponent + 2) / (exponent + 1))


PLAIN = {"sample_cosine": polar, "sample_hemisphere": hemisphere, "sample_cone": cone, "sample_phong": phong}
CORRECT = {
    "polar (Malley)": ("sample_cosine", polar),
    "concentric": ("sample_cosine", concentric),
    "rejection": ("sample_cosine", rejection),
    "z is the root of u": ("sample_cosine", lambda u: lambertian(direction(np.sqrt(u[:, 0]), u[:, 1]))),
    "mirrored": ("sample_cosine", lambda u: lambertian(polar(u)[0] * [-1, 1, 1])),
    "permuted axes": ("sample_cosine", lambda u: lambertian(polar(u[:, ::-1])[0][:, [1, 0, 2]])),
    "stratified": ("sample_cosine", stratified),
    "normal plus a point of the sphere": ("sample_cosine", normal_plus_sphere),
    "hemisphere": ("sample_hemisphere", hemisphere),
    "cone": ("sample_cone", cone),
    "Phong": ("sample_phong", phong),
}
"""Name -> the stage that it passes, and the function."""
