"""Phong's highlight in Mitsuba, which has none of its own: a BSDF in Python.

    f = albedo/π + specular (n + 2)/(2π) max(0, r·v)ⁿ        r·v = 2 (n·l)(n·v) - l·v

`scene.shapes` says what is what. Directions are drawn with the cosine's density, so that a sample's weight is π f.
"""

from typing import Any

from raytwin.scene import Shape

NAME = "raytwin_phong"


def bsdf(thing: Shape, reflectance: dict[str, Any]) -> dict[str, Any]:
    """Mitsuba's dictionary for the object's material, with `reflectance` for its albedo."""
    if thing.highlight is None:
        return {"type": "diffuse", "reflectance": reflectance}
    specular, exponent = thing.highlight
    return {"type": NAME, "reflectance": reflectance, "specular": {"type": "rgb", "value": list(specular)},
            "exponent": exponent}  # fmt: skip


def register() -> None:
    """Make the BSDF known to Mitsuba's active variant, whose classes it is made of."""
    import drjit as dr
    import mitsuba as mi

    density = mi.warp.square_to_cosine_hemisphere_pdf

    class RaytwinPhong(mi.BSDF):
        def __init__(self, props: Any) -> None:
            super().__init__(props)
            self.reflectance, self.specular = props["reflectance"], props["specular"]
            self.exponent = float(props["exponent"])
            flags = mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide
            self.m_components, self.m_flags = [flags], flags

        def pi_f(self, si: Any, wo: Any, active: Any) -> Any:
            # r·v = 1 - x with x = |r - v|²/2. Rounding 1 - x changes the power n times as much: the last factor
            # corrects that.
            x = dr.squared_norm(mi.Vector3f(-wo.x, -wo.y, wo.z) - si.wi) / 2
            along, n = dr.maximum(1 - x, 0), self.exponent
            lobe = (n + 2) / 2 * along**n * (1 + n * ((1 - along) - x))
            colour = self.colour(self.reflectance, si, active) + self.colour(self.specular, si, active) * lobe
            return dr.select((si.wi.z > 0) & (wo.z > 0), colour, 0)

        def colour(self, value: Any, si: Any, active: Any) -> Any:
            """A texture's colour there, or the constant that Mitsuba hands to Python as numbers."""
            return value.eval(si, active) if hasattr(value, "eval") else mi.Color3f(*(float(c) for c in value))

        def sample(self, ctx: Any, si: Any, one: Any, two: Any, active: Any = True) -> tuple[Any, Any]:
            found = dr.zeros(mi.BSDFSample3f)
            found.wo, found.eta, found.sampled_component = mi.warp.square_to_cosine_hemisphere(two), 1.0, 0
            found.pdf, found.sampled_type = density(found.wo), mi.UInt32(self.m_flags)
            return found, self.pi_f(si, found.wo, active)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.pi_f(si, wo, active) * density(wo)

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return density(wo)

        def eval_diffuse_reflectance(self, si: Any, active: Any = True) -> Any:
            """Factor of an open, even sky's light: albedo + specular, by the definition of the light levels."""
            return self.colour(self.reflectance, si, active) + self.colour(self.specular, si, active)

        def to_string(self) -> str:
            return "RaytwinPhong[]"

    mi.register_bsdf(NAME, RaytwinPhong)
