# %% [markdown]
# # From photos to the twin, in eight stages
#
# A board of tags lies on a desk; someone took photos of it. In eight stages they become a camera, the camera becomes
# rays, and the rays a picture of two spheres that are not there. You write one function in each. `mine` checks it, says
# in words what is wrong, and lends you raytwin's own until yours is right, so that you may go on and come back.
#
# The picture so far stands beside that of the *twin*, the same scene by Mitsuba 3, a physically based renderer.

# %%
import numpy as np

from raytwin.tutorial import Desk, mine, show
from raytwin.tutorial.desk import around

desk = Desk()

# %% [markdown]
# ## 1. Detect
#
# A library finds the tags: it gives the corners $a, b, c, d$ of each. A lens keeps lines straight (nearly), so a tag's
# centre is seen where the diagonals cross, $a + s\,(c - a) = b + r\,(d - b)$, and not at the mean of the corners: what
# is farther away is seen smaller. And mind the pixels: the library's (0, 0) is the outer *corner* of the top-left
# pixel, OpenCV's, which is ours, is its *centre*.


# %%
def tag_centers(corners):
    """(N, 2): the tags' centres in OpenCV's pixels, from their corners (N, 4, 2) in the library's."""
    ...  # yours


tag_centers = mine("tag_centers", tag_centers)

marked = desk.photo.astype(np.float32) / 255
for u, v in np.round(tag_centers(desk.corners)).astype(int):
    marked[v - 16 : v + 17, u - 2 : u + 3] = marked[v - 2 : v + 3, u - 16 : u + 17] = (1, 0.1, 0.1)
show("1 detect", marked**2.2)

# %% [markdown]
# ## 2. Calibrate
#
# Each view of the flat board gives a homography $H = s\,K\,(r_1\; r_2\; t)$. Since $r_1$ and $r_2$ are unit and
# perpendicular, $B = K^{-\top} K^{-1}$ obeys two equations a view,
# $$h_1^\top B\, h_2 = 0, \qquad h_1^\top B\, h_1 = h_2^\top B\, h_2 ,$$
# linear in $B_{11}, B_{22}, B_{13}, B_{23}, B_{33}$ (no skew: $B_{12} = 0$). Stack them, take the singular vector of
# the smallest singular value, and read off $c_x = -B_{13}/B_{11}$, $c_y = -B_{23}/B_{22}$, $f_x^2 = s/B_{11}$,
# $f_y^2 = s/B_{22}$ with $s = B_{33} + c_x B_{13} + c_y B_{23}$ (Zhang 2000).


# %%
def intrinsics(homographies):
    """K (3, 3) of the camera that took all views (N, 3, 3)."""
    ...  # yours


intrinsics = mine("intrinsics", intrinsics)

desk.calibrated()
print("K from your homographies:", np.round(intrinsics(desk.homographies(tag_centers)), 1).tolist())
print("by least squares, the lens's distortion included:", np.round(desk.full_K, 1).tolist())

# %% [markdown]
# ## 3. Back-project
#
# Pixel $(u, v)$ sees along $(x, y, 1)$, made unit. The lens moved $(x, y)$ to
# $x' = (u - c_x)/f_x$, $y' = (v - c_y)/f_y$:
# $$x' = x\,g + 2 p_1 x y + p_2 (r^2 + 2x^2), \quad y' = y\,g + p_1 (r^2 + 2y^2) + 2 p_2 x y, \quad
# g = 1 + k_1 r^2 + k_2 r^4 + k_3 r^6 .$$
# That is to be undone: iterate $x \leftarrow (x' - \text{tangential})/g$ until nothing moves. The picture shows the
# directions as colours.


# %%
def back_project(K, dist, width, height):
    """Unit rays (height, width, 3) in the camera frame through the pixels' centres; dist: k1, k2, p1, p2, k3."""
    ...  # yours


back_project = mine("back_project", back_project)

rays = back_project(desk.K, desk.dist, desk.width, desk.height).reshape(-1, 3)
directions = rays @ desk.R  # p_cam = R p_board + t, so a direction goes back by R's transpose
show("3 back-project", desk.picture((directions + 1) / 2))

# %% [markdown]
# ## 4. Intersect
#
# $|o + t d - c|^2 = r^2$ is $a t^2 + 2 b t + c' = 0$ with $f = o - c$, $a = d\cdot d$, $b = f\cdot d$,
# $c' = f\cdot f - r^2$. The smallest $t > 0$ counts; no root, no hit. The picture shows the normals, and the twin's.


# %%
def intersect_sphere(origins, directions, center, radius):
    """(N,): the smallest t > 0 where origin + t direction meets the sphere; np.inf for a miss."""
    ...  # yours


intersect_sphere = mine("intersect_sphere", intersect_sphere)

hits = desk.first_hits(desk.eye, directions, intersect_sphere)
normals_seen = np.where(hits.seen[:, None], (hits.normals + 1) / 2, 0)
show("4 intersect", desk.picture(normals_seen), desk.twin("surface"))

# %% [markdown]
# ## 5. Shade
#
# A Lambertian surface under a sun of irradiance $E$ in the direction $l$, and a sky of radiance $L_s$:
# $$L = \frac{\rho}{\pi} E \max(0, n\cdot l) + \rho L_s .$$
# The sky's irradiance is $\pi L_s$, so its $\pi$ cancels.


# %%
def shade(points, normals, albedo, to_light, irradiance, sky):
    """(N, 3): the radiance that each point sends back."""
    ...  # yours


shade = mine("shade", shade)

lambert = shade(hits.points, hits.normals, hits.albedo, desk.to_light, desk.irradiance, desk.sky)
show("5 shade", desk.picture(lambert, hits), desk.twin("lambert"))

# %% [markdown]
# ## 6. Shadow
#
# A point is in shadow where its ray to the sun meets a sphere: the same equation, asked only whether $t > 0$ exists. A
# sphere is not in the way of its own points, though rounding may say so. (The few pixels in which the twin differs are
# the sheet's own shadow on the table.)


# %%
def sun_visible(points, to_light, centers, radii):
    """(N,): 1 where the sun is seen, 0 where a sphere is in the way."""
    ...  # yours


sun_visible = mine("sun_visible", sun_visible)

visible = sun_visible(hits.points, desk.to_light, desk.centers, desk.radii)[:, None]
dark = shade(hits.points, hits.normals, hits.albedo, desk.to_light, 0 * desk.irradiance, desk.sky)
shadow = dark + visible * (lambert - dark)
show("6 shadow", desk.picture(shadow, hits), desk.twin("shadow"))

# %% [markdown]
# ## 7. Sky
#
# The sky lights a surface element from the whole hemisphere, and a sphere of radius $r$ at the distance $d$, seen at
# the angle $\theta$ from the normal, takes $(r/d)^2 \cos\theta$ of it: the projected solid angle over $\pi$. That is
# exact where the sphere is wholly above the horizon. Where it is cut (on the spheres, beside their feet), the
# difference shows what is missing.


# %%
def sky_visible(points, normals, centers, radii):
    """(N,): the share of the sky's light that is left."""
    ...  # yours


sky_visible = mine("sky_visible", sky_visible)

own = np.linalg.norm(hits.points[:, None] - desk.centers, axis=-1) / desk.radii < 1 + 1e-6
left = np.ones(len(hits.points))
for k in range(len(desk.radii)):  # a sphere hides nothing from its own points; the desk hides what lies below it
    left += np.where(own[:, k], 0, sky_visible(hits.points, hits.normals, desk.centers[[k]], desk.radii[[k]]) - 1)
left -= np.where(own.any(axis=1), (1 - hits.normals[:, 2]) / 2, 0)
sky = shadow + (left[:, None] - 1) * hits.albedo * desk.sky
show("7 sky", desk.picture(sky, hits), desk.twin("sky"))

# %% [markdown]
# ## 8. Path
#
# What reaches a surface is what other surfaces send, and so on:
# $$L(x) = \frac{\rho}{\pi} \int L(\text{first surface along } \omega) \max(0, n\cdot\omega)\, d\omega .$$
# Draw $\omega$ with the density $\cos\theta/\pi$ and the cosine and the $\pi$ cancel: the mean of $\rho L$ over some
# directions is the integral, with noise. The sun is a single direction, which no random ray finds; its part is added at
# every surface. Draw a point evenly in the unit disk and raise it to the hemisphere: radius $\sqrt a$, angle $2\pi b$,
# $z = \sqrt{1 - a}$.


# %%
def hemisphere(a, b):
    """(N, 3): unit directions about (0, 0, 1) with density cos θ / π, from numbers (N,) in [0, 1)."""
    ...  # yours


hemisphere = mine("hemisphere", hemisphere)


def radiance(hits, surfaces, rng):
    """What each point sends back, of light that met so many surfaces at most: one random way each."""
    sun = shade(hits.points, hits.normals, hits.albedo, desk.to_light, desk.irradiance, 0 * desk.sky)
    light = sun * sun_visible(hits.points, desk.to_light, desk.centers, desk.radii)[:, None]
    onward = around(hits.normals, hemisphere(*rng.random((2, len(hits.t)))))
    there = desk.first_hits(hits.points + 1e-7 * hits.normals, onward, intersect_sphere)
    further = radiance(there, surfaces - 1, rng) if surfaces > 1 else 0 * light
    return light + hits.albedo * np.where(there.seen[:, None], further, desk.sky)


rng = np.random.default_rng(1)
path = np.mean([radiance(hits, 2, rng) for _ in range(16)], axis=0)
show("8 path", desk.picture(path, hits), desk.twin("path", depth=3))

# %% [markdown]
# ## Where to go from here
#
# - `raytwin.check("estimate_pose", f)`, `"hit_points"` and `"render"`: the stages between these, and the whole.
# - `raytwin explore desk`: turn the sun, drag the spheres, and see each part of the light come and go.
# - `raytwin ladder desk`: all rungs beside each other, with what each leaves out and what it costs.
# - `src/raytwin/tracer/`: the same in some hundred lines, which is what the twin is held against.
