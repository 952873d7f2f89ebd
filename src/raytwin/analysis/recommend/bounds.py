"""What closed forms prove of a scene's light before any render: the most that a part of it can be.

The bound on bounces goes by pairs of objects. Let F_ij be the largest share of the hemisphere over a point of surface i
that object j fills, weighted by cosines, and a_i the albedo. Light that has met one surface is on surface i at most

    L_0i = a_i (E/π + L_s)          a sun of irradiance E that shines head on, and all of a sky of radiance L_s

since a/π E max(0, n·l) <= a/π E and the sky's part of the hemisphere is at most all of it. Each further surface gathers

    L_ki = a_i ∫ L_{k-1} dF <= a_i max Σ_j f_j L_{k-1,j}          over all shares f_j <= F_ij with Σ_j f_j <= 1

because directions that meet no object bring no light that has met one; the brightest objects first make the most of it.
This step keeps order and scale: if L_{k+2} <= c L_k everywhere with c < 1, every two further ones shrink by c too, and

    Σ_{m>=k} L_m <= (L_k + L_{k+1}) / (1 - c),

per colour channel, wherever the eye looks. Between two surfaces this shrinks by both albedos in turn, where the largest
albedo a and the largest share F alone, L_0 (a F)^{n+1} / (1 - a F), would prove less. It proves nothing where c = 1.

A highlight adds a second such sum, with `specular` for a: its lobe sends on at most that of an even light (Lafortune
and Willems, 1994), and π times it is nowhere more than (n + 2)/2 of that, so that its shares are (n + 2)/2 F_ij or 1,
at most; of the sun that factor is sent on.

Of a map, L_s is the largest radiance where a lobe or a gap may show it alone. Where all of it lights a Lambertian
surface it is the largest even sky by harmonics, and what those leave out: with Â_l the cosine's, whose squares weighed
by (2 l + 1) / 4π sum to ∫ max(0, cos)² dω = 2π/3, and to 127π/192 up to l = 2, by Cauchy and Schwarz

    |E - E_harmonics| / π <= √(π/192) ‖L - mean‖ / π = σ(L) / √48          σ: over the sphere

A sphere fills at most r²/d² of the hemisphere over a point at the distance d from its centre (Howell, B; equality where
it stands over the point), a rectangle of area A that is nowhere nearer than d at most A/(π d²), anything at most 1.
"""

import numpy as np

from raytwin.lights.envmap_tables import tabulate
from raytwin.scene import Rectangle, Scene, Shape, Sphere
from raytwin.speed.path_tracing import area_boxes
from raytwin.tracer.hit import NO_SPECULAR
from raytwin.tracer.world import specular_of


class Bounds:
    """What closed forms say of a scene's light, before any render; all radiances are the largest of the channels.

    `seen`: the objects that some pixel's area may see; `covered`: the largest share of the frame that they fill.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, n = scene, len(scene.objects)
        boxes = area_boxes(scene)
        self.seen = np.asarray((boxes[:, 2:] > boxes[:, :2]).all(axis=1), bool)
        w, h = scene.camera.image_size
        mask = np.zeros((h, w), bool)
        for x0, y0, x1, y1 in boxes.tolist():
            mask[y0:y1, x0:x1] = True
        self.covered = float(mask.mean())
        shares = np.array([[_share(scene, i, j) for j in range(n)] for i in range(n)]).reshape(n, n)
        glosses = [specular_of(thing) or NO_SPECULAR for thing in scene.objects]
        peak = np.array([(gloss.exponent + 2) / 2 for gloss in glosses]).reshape(n, 1)
        albedo = np.array([thing.material.albedo for thing in scene.objects]).reshape(n, 3)
        specular = np.array([gloss.share for gloss in glosses]).reshape(n, 3)
        self.shares = shares
        self.lobes = [(albedo, shares)] + ([(specular, np.minimum(peak * shares, 1.0))] if scene.glossy else [])
        self.sky, self.even, self.unlike = _skies(scene)
        self.sun = (albedo + peak * specular) * np.array(scene.sun.irradiance) / np.pi
        self.glint = specular * np.maximum(self.sky, self.even)
        self.shades = shading(scene) | np.diag(np.diag(shares) > 0)  # a sphere seen from within shades itself
        self.q = self._filled().max(axis=0, initial=0.0)
        self.series = [self.sun + albedo * self.even + self.glint]

    def beyond(self, bounces: int) -> float:
        """The most that all bounces beyond the n-th bring to any pixel."""
        if not self.seen.any():
            return 0.0
        for _ in range(bounces + 4 - len(self.series)):
            self.series.append(np.sum([_gathered(a, f, self.series[-1]) for a, f in self.lobes], axis=0))
        first, second, third = self.series[bounces + 1 : bounces + 4]
        with np.errstate(divide="ignore", invalid="ignore"):
            shrinks = np.where(first > 0, third / first, np.where(third > 0, np.inf, 0.0)).max(axis=0)
            tail = np.where(shrinks < 1, (first + second) / (1 - shrinks), np.where(first + second > 0, np.inf, 0.0))
        return float(tail[self.seen].max())

    def occlusion(self) -> float:
        """a F L_s: the most of the sky's light that other objects take from any point that is seen.

        And what the open sky of `lambert` and `shadow` errs by: of a map, and of a highlight, which the horizon cuts.
        """
        (albedo, shares), *_ = self.lobes
        lost = albedo * (np.minimum(_full(shares) * self.sky, self.even) + self.unlike) + self.glint
        return float(lost[self.seen].max(initial=0.0))

    def shadow(self) -> float:
        """a E/π, where something may stand between the sun and a point that is seen."""
        shaded = self.seen & self.shades.any(axis=1)
        return float(self.sun[shaded].max(initial=0.0))

    def without(self, j: int) -> float:
        """The most by which the light of what is seen changes where object j is taken away.

        On surface i the sun may come free, and a share F_ij of the hemisphere shows something else, whose radiance was
        and is at most M: a_i (E/π + F_ij M). All surfaces then change by at most D <= max of that + q D.
        """
        most = np.maximum(self.sky, self._tail(self.series[0].max(axis=0, initial=0.0)))
        others = np.arange(len(self.seen)) != j
        shown = sum(a * shares[:, j, None] for a, shares in self.lobes)
        with np.errstate(invalid="ignore"):  # nothing of an infinite bound is nothing
            first = self.shades[:, j, None] * self.sun + np.nan_to_num(shown * most, nan=0.0, posinf=np.inf)
            spread = self._tail(first[others].max(axis=0, initial=0.0))
            again = np.nan_to_num(self._filled() * spread, nan=0.0, posinf=np.inf)
        return float((first + again)[others & self.seen].max(initial=0.0))

    def _filled(self) -> np.ndarray:
        """What each object sends on of an even light from all others (n, 3)."""
        return np.asarray(np.sum([a * _full(shares) for a, shares in self.lobes], axis=0))

    def _tail(self, factor: np.ndarray) -> np.ndarray:
        return np.where(self.q < 1, factor / np.where(self.q < 1, 1 - self.q, 1.0), np.where(factor > 0, np.inf, 0.0))

    def of_metric(self, metric: str, largest: float) -> float | None:
        """The most that `metric` can be where no value errs by more than `largest`, and none beyond what is covered.

        None where nothing is proven.
        """
        found = {
            "rmse": largest * self.covered**0.5, "mae": largest * self.covered, "p999_rel": 100 * largest,
            "relmse": 100 * largest**2 * self.covered,
        }.get(metric, largest)  # fmt: skip
        return found if np.isfinite(found) else None


def shading(scene: Scene) -> np.ndarray:
    """(n, n) bool: another object, j, may cast a shadow on object i; never too few.

    Both are put into balls. Seen along the sun's rays these are discs, which must overlap, and the caster's ball must
    not lie behind the other's.
    """
    center = np.array([thing.center for thing in scene.objects]).reshape(-1, 3)
    radius = np.array([thing.radius if isinstance(thing, Sphere) else _reach(thing) for thing in scene.objects])
    radius = radius * (1 + 1e-4) + 1e-6 * np.abs(center).max(initial=0)  # for float32's rounding
    apart, both, to_light = center - center[:, None], radius + radius[:, None], np.array(scene.sun.to_light)
    ahead = apart @ to_light
    across = np.linalg.norm(apart - ahead[..., None] * to_light, axis=-1)
    return np.asarray((across <= both) & (ahead >= -both) & ~np.eye(len(center), dtype=bool))


def _full(shares: np.ndarray) -> np.ndarray:
    """(n, 1): the share that all others fill together."""
    return np.asarray(np.minimum(shares.sum(axis=1, keepdims=True), 1.0))


def _gathered(a: np.ndarray, shares: np.ndarray, light: np.ndarray) -> np.ndarray:
    """a_i max Σ_j f_j L_j (n, 3), from L (n, 3): the brightest objects' shares first, until all is full."""
    found = np.zeros_like(light)
    for channel, L in enumerate(light.T):
        order = np.argsort(-L)
        full = np.minimum(np.cumsum(shares[:, order], axis=1), 1.0)
        found[:, channel] = a[:, channel] * (np.diff(full, axis=1, prepend=0.0) @ L[order])
    return found


def _skies(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(3,) each: the largest radiance, the largest even sky that lights as much, by how much harmonics miss that."""
    if (found := scene.environment) is None:
        radiance = np.array(scene.sky.radiance)
        return radiance, radiance, np.zeros(3)
    light = found.radiance.astype(float)
    h, w = light.shape[:2]
    heights = np.cos(np.linspace(0, np.pi, h + 1))
    share = np.repeat((heights[:-1] - heights[1:])[:, None] / (2 * w), w, axis=1)[..., None]
    off = np.square(light - (share * light).sum(axis=(0, 1)))
    # Between centres it is bilinear: round a row its squares are at most the columns' mean, weighed as it weighs
    # them; down a column at most the largest.
    off = (np.roll(off, -1, axis=1) + 6 * off + np.roll(off, 1, axis=1)) / 8
    off = np.maximum.reduce([off, np.concatenate([off[:1], off[:-1]]), np.concatenate([off[1:], off[-1:]])])
    unlike = np.sqrt((share * off).sum(axis=(0, 1)) / 48)
    even = []
    for k in np.array(
        tabulate(found.size, found.texels).harmonics
    ):  # k0 + b.n + n.Q n, with a sphere's largest b.n and n.Q n
        Q = np.array(
            [[k[7] - k[8], k[4] / 2, k[6] / 2], [k[4] / 2, -k[7] - k[8], k[5] / 2], [k[6] / 2, k[5] / 2, 2 * k[8]]]
        )
        even.append(max(k[0] + np.linalg.norm(k[1:4]) + np.linalg.eigvalsh(Q)[-1], 0.0))
    return light.max(axis=(0, 1)), np.array(even) + unlike, unlike


def _share(scene: Scene, i: int, j: int) -> float:
    """F_ij: the most of the hemisphere over any point of object i that object j fills."""
    here, there = scene.objects[i], scene.objects[j]
    if i == j:
        return 1.0 if isinstance(here, Sphere) and _entered(scene, i) else 0.0
    if isinstance(there, Sphere):
        gap = _gap(here, there.center)
        return 1.0 if gap <= there.radius else (there.radius / gap) ** 2
    area = 4 * float(np.linalg.norm(there.half_u) * np.linalg.norm(there.half_v))
    if isinstance(here, Sphere):
        gap = max(_gap(there, here.center) - here.radius, 0.0)
    else:
        if _coplanar(here, there):
            return 0.0
        gap = max(float(np.linalg.norm(np.subtract(here.center, there.center))) - _reach(here) - _reach(there), 0.0)
    return min(1.0, area / (np.pi * gap * gap)) if gap > 0 else 1.0


def _entered(scene: Scene, i: int) -> bool:
    """The inside of sphere i may be met: the eye is within. From without no way leads through an opaque surface."""
    ball = scene.objects[i]
    assert isinstance(ball, Sphere)
    return bool(np.linalg.norm(np.subtract(scene.camera.eye, ball.center)) <= ball.radius)


def _apart(a: Shape, b: Shape) -> float:
    return float(np.linalg.norm(np.subtract(a.center, b.center)))


def _gap(thing: Shape, point: tuple[float, float, float]) -> float:
    """The distance of a point from the nearest of a surface."""
    off = np.subtract(point, thing.center)
    if isinstance(thing, Sphere):
        return abs(float(np.linalg.norm(off)) - thing.radius)
    for half in (np.array(thing.half_u), np.array(thing.half_v)):
        off = off - half * np.clip(off @ half / (half @ half), -1, 1)
    return float(np.linalg.norm(off))


def _reach(plane: Rectangle) -> float:
    return float(np.hypot(np.linalg.norm(plane.half_u), np.linalg.norm(plane.half_v)))


def _coplanar(a: Rectangle, b: Rectangle) -> bool:
    """To rounding: neither sees the other then."""
    n, size = np.array(a.normal), _reach(a) + _reach(b) + _apart(a, b)
    offs = [
        np.subtract(b.center, a.center) + i * np.array(b.half_u) + k * np.array(b.half_v)
        for i in (-1, 1)
        for k in (-1, 1)
    ]
    return bool(np.abs(np.array(offs) @ n).max() <= 1e-12 * size)
