"""The Mitsuba BSDF ``retroreflector``: sheets of glass beads and arrays of corner cubes.

:func:`scanner_sim.render.device.activate` registers it; elsewhere call :func:`register_retroreflector`. Then::

    <bsdf type="twosided">
        <bsdf type="retroreflector">
            <string name="kind" value="bead_sheet"/>
            <spectrum name="reflectance" value="0.5"/>
            <float name="retro_share" value="0.185"/>
            <float name="half_width" value="6.13e-3"/>
        </bsdf>
    </bsdf>

*Lobe.* A GGX lobe (Walter et al., *EGSR*, 2007) that is evaluated with the incident direction mirrored about the
normal: h along Mω_i + ω_o, M = diag(−1, −1, 1), the back vector of Belcour et al. (*JOSA A* 31, 2561,
2014). Exchanging the directions mirrors h, which an isotropic lobe does not notice: it is reciprocal. Light that
enters along the normal returns at the observation angle δ about facets tilted by δ/2, so the gain over a white
Lambertian surface is s ρ E/(4 α²) at δ = 0 and half of it where tan(δ/2) = α √(√2 − 1), the ``half_width``.

*Entrance.* Of light that enters at the angle β the share s E(β) goes into the lobe:

- ``bead_sheet``: E = 2^(−(tan β/tan β_½)²), ``entrance_half_angle`` β_½;
- ``corner_cube``: aperture and its image at the cube's apex overlap by
  E = (2/π)(arccos x − x √(1 − x²)), x = √2 tan β', sin β' = sin β/n, ``refractive_index`` n (Degnan, *Contributions of
  space geodesy to geodynamics* 25, 1993, whose factor cos β is the projection of the aperture, which a BSDF has
  apart); it is 0 beyond x = 1.

Between two angles the smaller E counts, which keeps the lobe reciprocal and never adds energy.

*Base.* What the lobe does not return scatters diffusely, with (1 − a_i)(1 − a_o)/(1 − ā) instead of Lambert's 1, where
a(β) is the lobe's albedo (s E, less what the smaller E, masking and the horizon take) and ā = 2∫a μ dμ: at every angle
of incidence both together return the ``reflectance``. (Kelemen, Szirmay-Kalos, *Eurographics* 2001, short papers.)

*Not modelled:* polarisation; interference and diffraction rings; the six-lobed pattern of real cubes and its change
with their orientation; failure of total reflection by azimuth; the displacement of the returned ray by up to a
cube's width, and with it the longer path inside; specular reflection by the front face.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, get_args

import drjit as dr
import mitsuba as mi
import numpy as np

from scanner_sim.foundation.device_types import (
    Float,
    Mask,
    Spectrum,
    SurfaceInteraction3f,
    Vector2f,
    Vector3f,
)
from scanner_sim.scene.files.plugins import once_per_variant
from scanner_sim.scene.retroreflectors import (
    BEAD_HALF_ANGLE,
    CUBE_INDEX,
    NARROWEST,
    WIDEST,
    RetroKind,
    roughness,
)

_NODES = 129
"""Entries of the table of the lobe's albedo, over sin β from 0 to 1."""
_STRATA = 48
"""Facets per entry along each of two directions: the albedo is then good to 1e-3."""
_TINY = 1e-12


@once_per_variant
def register_retroreflector() -> type:
    """Make ``retroreflector`` known to Mitsuba's present variant, and return its class.

    Call it again after every change of the variant: a plugin belongs to the variant in which it was made.
    """
    made = _bsdf_class()
    mi.register_bsdf("retroreflector", made)
    return made


def bead_entrance(cosine: Float, half_angle: Float) -> Float:
    """Return the entrance law of a bead sheet, E = 2^(−(tan β/tan β_½)²).

    Parameters
    ----------
    cosine
        cos β, Dr.Jit.
    half_angle
        Angle β_½ [rad] at which it is 1/2, Dr.Jit.
    """
    tangent2 = dr.rcp(dr.maximum(dr.square(cosine), _TINY)) - 1.0
    return dr.exp2(-dr.maximum(tangent2, 0.0) / dr.square(dr.tan(half_angle)))


def cube_entrance(cosine: Float, index: Float) -> Float:
    """Return the entrance law of a corner cube with a round aperture: the overlap of two discs.

    Parameters
    ----------
    cosine
        cos β, Dr.Jit.
    index
        Index of refraction n; 1 for a hollow cube. Dr.Jit.

    Notes
    -----
    The apex of the cube lies √2 radii below its aperture, so the aperture's image is displaced by 2√2 tan β' radii.
    """
    sine2 = dr.maximum(1.0 - dr.square(cosine), 0.0) / dr.square(index)
    shift = dr.minimum(dr.sqrt(2.0 * sine2 / dr.maximum(1.0 - sine2, _TINY)), 1.0)
    return (2.0 / math.pi) * (dr.acos(shift) - shift * dr.sqrt(1.0 - dr.square(shift)))


def _mirror(direction: Vector3f) -> Vector3f:
    """Return a local direction mirrored about the normal."""
    return mi.Vector3f(-direction.x, -direction.y, direction.z)


def _bsdf_class() -> type:
    """Return the plugin for the present variant, whose types its base class fixes."""
    lobe_flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
    base_flags = mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide

    class Retroreflector(mi.BSDF):
        """A lobe about the way the light came, over a diffuse base; see the module."""

        def __init__(self, props: Any) -> None:
            super().__init__(props)
            self.kind = str(props.get("kind", "bead_sheet"))
            if self.kind not in get_args(RetroKind):
                raise ValueError(
                    f"retroreflector: kind is {self.kind!r}; it is one of {', '.join(get_args(RetroKind))}."
                )
            self.reflectance = props.get_texture("reflectance", 0.5)
            self.retro_share = _number(props, "retro_share", 0.2, 0.0, 1.0)
            self.half_width = _number(props, "half_width", math.radians(0.35), NARROWEST, WIDEST)
            if self.kind == "bead_sheet":
                self.entrance_half_angle = _number(props, "entrance_half_angle", BEAD_HALF_ANGLE, 0.05, 1.5)
            else:
                self.refractive_index = _number(props, "refractive_index", CUBE_INDEX, 1.0, 4.0)
            self.m_components = [lobe_flags, base_flags]
            self.m_flags = lobe_flags | base_flags
            self._prepare()

        def _prepare(self) -> None:
            """Find the roughness, and the lobe's albedo by evenly spread facets."""
            self.alpha = dr.opaque(mi.Float, roughness(_host(self.half_width)))
            lane = dr.arange(mi.UInt32, _NODES * _STRATA**2)
            facet = lane % _STRATA**2
            sine = mi.Float(lane // _STRATA**2) / (_NODES - 1)
            # Exactly grazing light has no visible facets; the entrance law is 0 there anyway.
            back = mi.Vector3f(-sine, 0.0, dr.maximum(dr.safe_sqrt(1.0 - dr.square(sine)), 1e-3))
            # Gauss's points crowd at the edges, which the tail of the lobe is drawn from.
            point, weight = np.polynomial.legendre.leggauss(_STRATA)
            table = mi.Float((0.5 * (point + 1.0)).astype(np.float32))
            sample = [dr.gather(mi.Float, table, index) for index in (facet % _STRATA, facet // _STRATA)]
            half, _ = self._facets().sample(back, mi.Point2f(*sample))
            out = mi.reflect(back, half)
            masked = self._facets().G(back, out, half) / self._facets().smith_g1(back, half)
            smaller = dr.minimum(self._entrance(back.z), self._entrance(out.z))
            kept = dr.select(out.z > 0.0, self.retro_share * smaller * masked, 0.0)
            values = np.asarray(kept.numpy(), dtype=np.float64).reshape(_NODES, _STRATA, _STRATA)
            albedo = np.einsum("nab,a,b->n", values, 0.5 * weight, 0.5 * weight)
            # ā = ∫ a d(sin² β), exactly for a table that is read linearly.
            v = np.linspace(0.0, 1.0, _NODES)
            mean = np.sum(
                (np.diff(v) / 3.0)
                * (albedo[:-1] * (2.0 * v[:-1] + v[1:]) + albedo[1:] * (v[:-1] + 2.0 * v[1:]))
            )
            self.albedo = mi.Float(albedo.astype(np.float32))
            self.base = dr.opaque(mi.Float, 1.0 - float(mean))

        def _lobe_albedo(self, direction: Vector3f) -> Float:
            """Return the share of the light from a direction that the lobe returns."""
            position = (_NODES - 1) * dr.safe_sqrt(1.0 - dr.square(direction.z))
            cell = dr.minimum(mi.UInt32(position), _NODES - 2)
            low, high = dr.gather(mi.Float, self.albedo, cell), dr.gather(mi.Float, self.albedo, cell + 1)
            return low + (position - mi.Float(cell)) * (high - low)

        def traverse(self, cb: Any) -> None:
            """Show the parameters that may be changed."""
            cb.put("reflectance", self.reflectance, mi.ParamFlags.Differentiable)
            for name in self._numbers():
                cb.put(name, getattr(self, name), mi.ParamFlags.NonDifferentiable)

        def parameters_changed(self, keys: Sequence[str] = ()) -> None:  # noqa: ARG002
            """Follow changed parameters."""
            for name in self._numbers():
                # A plain number would become part of the kernels, and every change compile them again.
                setattr(self, name, dr.opaque(mi.Float, _host(getattr(self, name))))
            self._prepare()

        def _numbers(self) -> tuple[str, str, str]:
            own = "entrance_half_angle" if self.kind == "bead_sheet" else "refractive_index"
            return "retro_share", "half_width", own

        def _entrance(self, cosine: Float) -> Float:
            if self.kind == "bead_sheet":
                return bead_entrance(cosine, self.entrance_half_angle)
            return cube_entrance(cosine, self.refractive_index)

        def _facets(self) -> Any:
            renderer: Any = mi  # its type stubs know the type of microfacets by another name
            return renderer.MicrofacetDistribution(mi.MicrofacetType.GGX, self.alpha, True)

        def _parts(
            self, ctx: mi.BSDFContext, wi: Vector3f, wo: Vector3f, active: Mask
        ) -> tuple[Float, Float]:
            """Return BSDF times cos θ_o per reflectance, and the density under ``sample``."""
            cos_in, cos_out = mi.Frame3f.cos_theta(wi), mi.Frame3f.cos_theta(wo)
            active = active & (cos_in > 0.0) & (cos_out > 0.0)
            smaller = dr.minimum(self._entrance(cos_in), self._entrance(cos_out))
            albedo_in, albedo_out = self._lobe_albedo(wi), self._lobe_albedo(wo)
            back = _mirror(wi)
            half = dr.normalize(back + wo)
            facets, towards = self._facets(), dr.maximum(dr.dot(wo, half), _TINY)
            lobe_pdf = facets.pdf(back, half) / (4.0 * towards)
            lobe = facets.eval(half) * facets.G(back, wo, half) / (4.0 * dr.maximum(cos_in, _TINY))
            base_pdf = mi.warp.square_to_cosine_hemisphere_pdf(wo)
            base = (1.0 - albedo_in) * (1.0 - albedo_out) / self.base * base_pdf
            value, density = mi.Float(0.0), mi.Float(0.0)
            chance = self._chance(ctx, albedo_in)
            if ctx.is_enabled(mi.BSDFFlags.GlossyReflection, 0):
                value += self.retro_share * smaller * lobe
                density += chance * lobe_pdf
            if ctx.is_enabled(mi.BSDFFlags.DiffuseReflection, 1):
                value += base
                density += (1.0 - chance) * base_pdf
            return dr.select(active, value, 0.0), dr.select(active, density, 0.0)

        def _chance(self, ctx: mi.BSDFContext, albedo: Float) -> Float:
            """Return the probability with which ``sample`` takes the lobe."""
            if not ctx.is_enabled(mi.BSDFFlags.DiffuseReflection, 1):
                return mi.Float(1.0)
            if not ctx.is_enabled(mi.BSDFFlags.GlossyReflection, 0):
                return mi.Float(0.0)
            return albedo

        def sample(
            self,
            ctx: mi.BSDFContext,
            si: SurfaceInteraction3f,
            sample1: Float,
            sample2: Vector2f,
            active: Mask = True,
        ) -> tuple[Any, Spectrum]:
            """Choose lobe or base, then a direction; return it and BSDF times cosine over density."""
            chance = self._chance(ctx, self._lobe_albedo(si.wi))
            to_lobe = sample1 < chance
            back = _mirror(si.wi)
            facet, _ = self._facets().sample(back, sample2)
            bs: Any = dr.zeros(mi.BSDFSample3f)
            bs.wo = dr.select(to_lobe, mi.reflect(back, facet), mi.warp.square_to_cosine_hemisphere(sample2))
            value, density = self._parts(ctx, si.wi, bs.wo, active)
            bs.pdf = density
            bs.eta = 1.0
            bs.sampled_component = dr.select(to_lobe, mi.UInt32(0), mi.UInt32(1))
            bs.sampled_type = dr.select(
                to_lobe,
                mi.UInt32(int(mi.BSDFFlags.GlossyReflection)),
                mi.UInt32(int(mi.BSDFFlags.DiffuseReflection)),
            )
            valid = active & (density > 0.0)
            weight = self.reflectance.eval(si, valid) * (value / dr.maximum(density, _TINY))
            return bs, dr.select(valid, weight, 0.0)

        def eval(
            self, ctx: mi.BSDFContext, si: SurfaceInteraction3f, wo: Vector3f, active: Mask = True
        ) -> Spectrum:
            """Return BSDF times cos θ_o."""
            value, _ = self._parts(ctx, si.wi, wo, active)
            return self.reflectance.eval(si, active) * value

        def pdf(
            self, ctx: mi.BSDFContext, si: SurfaceInteraction3f, wo: Vector3f, active: Mask = True
        ) -> Float:
            """Return the density of a direction under ``sample`` [1/sr]."""
            return self._parts(ctx, si.wi, wo, active)[1]

        def eval_pdf(
            self, ctx: mi.BSDFContext, si: SurfaceInteraction3f, wo: Vector3f, active: Mask = True
        ) -> tuple[Spectrum, Float]:
            """Return BSDF times cos θ_o, and the density."""
            value, density = self._parts(ctx, si.wi, wo, active)
            return self.reflectance.eval(si, active) * value, density

        def eval_diffuse_reflectance(self, si: SurfaceInteraction3f, active: Mask = True) -> Spectrum:
            """Return the reflectance, which denoisers take for the surface's colour."""
            return self.reflectance.eval(si, active)

        def to_string(self) -> str:
            """Return the parameters in one line."""
            numbers = ", ".join(f"{name}={_host(getattr(self, name)):g}" for name in self._numbers())
            return f"Retroreflector[kind={self.kind}, reflectance={self.reflectance}, {numbers}]"

    return Retroreflector


def _number(props: Any, name: str, default: float, low: float, high: float) -> Float:
    value = float(props.get(name, default))
    if not low <= value <= high:
        raise ValueError(f"retroreflector: {name} is {value:g}; it lies between {low:g} and {high:g}.")
    return dr.opaque(mi.Float, value)


def _host(value: Float) -> float:
    return float(np.ravel(value.numpy())[0])
