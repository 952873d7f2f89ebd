"""Phong's highlight in Mitsuba, which has none of its own: a BSDF in Python, and the same formula by NumPy.

    f = albedo/π + specular (n + 2)/(2π) max(0, r·v)ⁿ        r·v = 2 (n·l)(n·v) - l·v

`scene.Phong` says what is what. Directions are drawn with the cosine's density, so that a sample's weight is π f.
"""

from typing import Any

import numpy as np

from raytwin.scene import Phong, Scene, Shape

NAME = "raytwin_phong"


def lobe(xp: Any, n: Any, to_light: Any, d: Any, exponent: Any) -> Any:
    """π times the highlight over its `specular`: (n + 2)/2 max(0, r·v)ⁿ, v = -d; vectors as three components each.

    r·v = 1 - x with x = |r - v|²/2. The power makes n times as much of rounding 1 - x; the last factor takes it back.
    """
    twice = 2 * (n[0] * to_light[0] + n[1] * to_light[1] + n[2] * to_light[2])
    x = sum((twice * n[k] - to_light[k] + d[k]) ** 2 for k in range(3)) / 2
    along = xp.maximum(1 - x, 0)
    return (exponent + 2) / 2 * along**exponent * (1 + exponent * ((1 - along) - x))


def highlights(scene: Scene) -> np.ndarray:
    """Each object's specular and exponent, by id (n + 1, 4): none in a Lambertian's row, and the last, of id -1."""
    return np.array([*(_numbers(thing) for thing in scene.objects), (0.0, 0.0, 0.0, 1.0)])


def _numbers(thing: Shape) -> tuple[float, ...]:
    material = thing.material
    return (*material.specular, material.exponent) if isinstance(material, Phong) else (0.0, 0.0, 0.0, 1.0)


def pi_f(scene: Scene, ids: np.ndarray, albedo: np.ndarray, normal: np.ndarray, d: np.ndarray, to: Any) -> np.ndarray:
    """(k, 3): π f of what rays along d (k, 3) meet, for light from `to`; all unit, in the same axes."""
    if not scene.glossy:
        return albedo
    rows = highlights(scene)[ids]
    return np.asarray(albedo + rows[:, :3] * lobe(np, normal.T, np.transpose(to), d.T, rows[:, 3])[:, None])


def bsdf(thing: Shape, reflectance: dict[str, Any]) -> dict[str, Any]:
    """Mitsuba's dictionary for the object's material, whose albedo is `reflectance`."""
    if not isinstance(thing.material, Phong):
        return {"type": "diffuse", "reflectance": reflectance}
    specular = {"type": "rgb", "value": list(thing.material.specular)}
    return {"type": NAME, "reflectance": reflectance, "specular": specular, "exponent": thing.material.exponent}


def _colour(value: Any) -> Any:
    """(si, active) -> the colour there: of a texture, or, as Mitsuba hands a plain one to Python, always the same."""
    import mitsuba as mi

    if hasattr(value, "eval"):
        return value.eval
    plain = mi.Color3f(*(float(c) for c in value))
    return lambda si, active: plain


def register() -> None:
    """Make the BSDF known to Mitsuba's active variant, whose classes it is made of."""
    import drjit as dr
    import mitsuba as mi

    scalar = mi.variant().startswith("scalar")

    class RaytwinPhong(mi.BSDF):
        def __init__(self, props: Any) -> None:
            super().__init__(props)
            self.reflectance, self.specular = (_colour(props[name]) for name in ("reflectance", "specular"))
            self.exponent = float(props["exponent"])
            flags = mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide
            self.m_components, self.m_flags = [flags], flags

        def pi_f(self, si: Any, wo: Any, active: Any) -> Any:
            shine = self.specular(si, active) * lobe(dr, (0, 0, 1), wo, -si.wi, self.exponent)
            return dr.select((si.wi.z > 0) & (wo.z > 0), self.reflectance(si, active) + shine, 0)

        def sample(self, ctx: Any, si: Any, one: Any, two: Any, active: Any = True) -> tuple[Any, Any]:
            found = mi.BSDFSample3f() if scalar else dr.zeros(mi.BSDFSample3f)
            found.wo, found.eta, found.sampled_component = mi.warp.square_to_cosine_hemisphere(two), 1.0, 0
            found.pdf, found.sampled_type = mi.warp.square_to_cosine_hemisphere_pdf(found.wo), mi.UInt32(self.m_flags)
            return found, self.pi_f(si, found.wo, active)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.pi_f(si, wo, active) * self.pdf(ctx, si, wo, active)

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return mi.warp.square_to_cosine_hemisphere_pdf(wo)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
            return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

        def eval_diffuse_reflectance(self, si: Any, active: Any = True) -> Any:
            return self.reflectance(si, active)

        def to_string(self) -> str:
            return "RaytwinPhong[]"

    mi.register_bsdf(NAME, RaytwinPhong)
