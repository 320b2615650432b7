"""The materials of a space station at 1.5 µm, as numbers with their sources.

A renderer's named metals and RGB colours are tabulated over the visible spectrum and are wrong at
1.5 µm, so every material here is a reflectance, and for metals a complex index of refraction, at
the laser's wavelength. Nothing in this module needs the renderer: :func:`mitsuba_bsdf` writes a
plain dictionary.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from scanner_sim.foundation.errors import InputError
from scanner_sim.scene.retroreflectors import RetroLobe

Fraction = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
MaterialKind = Literal["diffuse", "rough_conductor", "mixed", "retroreflector"]

FRESNEL_TOLERANCE = 2e-3
"""How far a metal's stated reflectance may lie from the one of its (n, k): the third digit."""


class UnknownMaterialError(InputError, LookupError):
    """A material was asked for by a name that the library does not have."""


def normal_reflectance(eta: float, k: float) -> float:
    """Fresnel reflectance of a conductor at normal incidence.

    Parameters
    ----------
    eta, k
        Real and imaginary part of the index of refraction, dimensionless.

    Returns
    -------
    float
        ((n − 1)² + k²) / ((n + 1)² + k²), dimensionless.

    Notes
    -----
    Born and Wolf, *Principles of Optics*, 7th ed., section 14.2.
    """
    return ((eta - 1.0) ** 2 + k**2) / ((eta + 1.0) ** 2 + k**2)


@lru_cache(maxsize=64)
def ggx_albedo(alpha: float) -> float:
    """Share of light that a rough, perfectly reflecting GGX surface returns after a single bounce.

    Parameters
    ----------
    alpha
        GGX roughness, above 0.

    Returns
    -------
    float
        Albedo at normal incidence, dimensionless: 0.99 at alpha 0.1, 0.79 at 0.4.

    Notes
    -----
    A facet tilted by θ sends light from the normal to 2θ. With t = tan²θ the tilts seen along the
    normal have the density α²/(α² + t)², light from t > 1 goes into the surface, and the rest is
    masked by Smith's G₁(2θ): A = ∫₀¹ α²/(α² + t)² G₁ dt (Walter et al. 2007, eqs 33 and 34). The rest
    would bounce on between facets, which the lobe leaves out.
    """
    node, weight = np.polynomial.legendre.leggauss(64)
    top = 1.0 / (1.0 + alpha**2)
    share = 0.5 * top * (node + 1.0)
    t = alpha**2 * share / (1.0 - share)
    tan2_exit = 4.0 * t / (1.0 - t) ** 2
    masking = 2.0 / (1.0 + np.sqrt(1.0 + alpha**2 * tan2_exit))
    return float(0.5 * top * np.sum(weight * masking))


class Material(BaseModel):
    """An opaque surface at the laser's wavelength.

    Four kinds: ``diffuse`` is Lambertian; ``rough_conductor`` is a GGX metal, and a polished one,
    because the lobe by itself loses 1 − :func:`ggx_albedo`; ``mixed`` is ``specular_share`` of the
    GGX lobe and the rest Lambertian, with the Lambertian part chosen so that both together give
    ``reflectance``; ``retroreflector`` sends part of its reflectance back the way the light came.

    Attributes
    ----------
    name
        Identifier, also the id of the BSDF in scene files.
    kind
        One of the four kinds above.
    reflectance
        Hemispherical reflectance at 1.5 µm and normal incidence, 0 to 1.
    reflectance_out_of_band
        The same as a mean over the Sun's photons from 0.9 to 1.7 µm, which the filter blocks but for a
        millionth; None where it is taken to be ``reflectance``.
    reflectance_visible
        The same in visible light, for a scenario's own materials; those of the library stand in
        :data:`scanner_sim.scene.visible.VISIBLE`. None where it is not known.
    eta, k
        Complex index of refraction of the specular lobe, n + ik; None for ``diffuse``.
    alpha
        GGX roughness of the specular lobe; None for ``diffuse``.
    specular_share
        Weight of the specular lobe, 0 to 1: 0 for ``diffuse`` and ``retroreflector``, 1 for ``rough_conductor``.
    retro
        Lobe of a ``retroreflector``; None for the other kinds.
    depolarisation
        Share of the reflected laser light that has lost its polarisation; None is an assumption: metal and
        retro-reflecting lobes keep it, light scattered within a material loses it.
    source
        Where the numbers come from; "assumption" with the reasonable range where nobody knows.

    Raises
    ------
    pydantic.ValidationError
        If a number is outside its range or the numbers contradict one another.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Annotated[str, Field(min_length=1)]
    kind: MaterialKind = "diffuse"
    reflectance: Fraction
    reflectance_out_of_band: Fraction | None = None
    reflectance_visible: Fraction | None = None
    eta: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None
    k: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | None = None
    alpha: Annotated[float, Field(gt=0.0, le=1.0, allow_inf_nan=False)] | None = None
    specular_share: Fraction = 0.0
    retro: RetroLobe | None = None
    depolarisation: Fraction | None = None
    source: Annotated[str, Field(min_length=1)] = "given by the user"

    @model_validator(mode="after")
    def _check_consistency(self) -> Self:
        metal = (self.eta, self.k, self.alpha)
        if (self.retro is None) == (self.kind == "retroreflector"):
            raise ValueError("a retroreflector has a retro lobe, and nothing else has one")
        if self.kind in ("diffuse", "retroreflector"):
            if any(number is not None for number in metal) or self.specular_share != 0.0:
                raise ValueError(f"a {self.kind} material has no eta, k, alpha and no specular_share")
            return self
        if self.eta is None or self.k is None or self.alpha is None:
            raise ValueError(f"a {self.kind} material needs eta, k and alpha")
        if self.kind == "rough_conductor":
            metal_reflectance = normal_reflectance(self.eta, self.k)
            if self.specular_share != 1.0:
                raise ValueError("a rough_conductor has specular_share 1; use kind mixed for less")
            if abs(metal_reflectance - self.reflectance) > FRESNEL_TOLERANCE:
                raise ValueError(
                    f"eta {self.eta:g} and k {self.k:g} reflect {metal_reflectance:.3f}, "
                    f"but reflectance is {self.reflectance:g}"
                )
            return self
        if not 0.0 < self.specular_share < 1.0:
            raise ValueError("a mixed material has a specular_share between 0 and 1")
        if not 0.0 <= self.diffuse_reflectance <= 1.0:
            raise ValueError(
                f"reflectance {self.reflectance:g} cannot be reached: the specular share gives "
                f"{self.specular_reflectance:.3f}, and the diffuse rest would have to reflect "
                f"{self.diffuse_reflectance:.3f}"
            )
        return self

    @property
    def diffuse_reflectance(self) -> float:
        """Reflectance of the Lambertian part by itself, dimensionless; 0 for a metal.

        With share s, the metal's normal reflectance F and the lobe's albedo A,
        ρ = s F A + (1 − s) ρ_d: what multiple bounces inside a rough surface bring back leaves it
        in all directions and is counted with the Lambertian part. Of a retro-reflector it is what its
        lobe leaves at normal incidence.
        """
        if self.retro is not None:
            return self.reflectance * (1.0 - self.retro.retro_share)
        if self.kind == "diffuse":
            return self.reflectance
        if self.kind == "rough_conductor":
            return 0.0
        return (self.reflectance - self.specular_reflectance) / (1.0 - self.specular_share)

    @property
    def depolarised_share(self) -> float:
        """Share of the reflected laser light that has lost its polarisation, dimensionless."""
        if self.depolarisation is not None:
            return self.depolarisation
        return 1.0 - (self.specular_share if self.retro is None else self.retro.retro_share)

    @property
    def specular_reflectance(self) -> float:
        """What the GGX lobe adds to the reflectance at normal incidence, dimensionless: s F A."""
        if self.eta is None or self.k is None or self.alpha is None:
            return 0.0
        return self.specular_share * normal_reflectance(self.eta, self.k) * ggx_albedo(self.alpha)


RAKIC = "Rakic 1995, Appl. Opt. 34, 4755: n 1.45, k 16.0 at 1.5 µm"
RAKIC_98 = "mean of Rakić et al. 1998, Appl. Opt. 37, 5271 (Lorentz–Drude)"
NICKEL = "Ordal et al. 1987, Appl. Opt. 26, 744: n 3.36, k 7.05 at 1.5 µm"


def _library(*materials: Material) -> Mapping[str, Material]:
    return MappingProxyType({entry.name: entry for entry in materials})


MATERIALS: Mapping[str, Material] = _library(
    Material(
        name="evaporated_aluminium",
        kind="rough_conductor",
        reflectance=0.978,
        reflectance_out_of_band=0.956,
        eta=1.45,
        k=16.0,
        alpha=0.05,
        specular_share=1.0,
        source=f"{RAKIC}; alpha is an assumption, 0.01 to 0.1; out of band: {RAKIC_98}",
    ),
    Material(
        name="weathered_aluminium",
        kind="mixed",
        reflectance=0.807,
        reflectance_out_of_band=0.79,
        eta=1.45,
        k=16.0,
        alpha=0.35,
        specular_share=0.4,
        source=(
            "hemispherical reflectance 0.807 at 1.5 µm is an assumption, 0.6 to 0.95: clean metal has 0.98 (Spisz et "
            "al., NASA TN D-5353, 1969, Table II), and oxide and dirt take from it what nobody has published for this "
            f"surface; lobe from {RAKIC}; share and alpha are assumptions, 0.2 to 0.7 and 0.2 to 0.5"
            "; out of band: falls as the bare metal does"
        ),
    ),
    Material(
        name="nickel",
        kind="rough_conductor",
        reflectance=0.804,
        reflectance_out_of_band=0.77,
        eta=3.36,
        k=7.05,
        alpha=0.1,
        specular_share=1.0,
        source=f"{NICKEL}; alpha is an assumption, 0.05 to 0.2; out of band: {RAKIC_98}, scaled to the value in band",
    ),
    Material(
        name="z93_white",
        reflectance=0.84,
        reflectance_out_of_band=0.9,
        source="assumption, 0.80 to 0.88; out of band: assumption, 0.85 to 0.93, as water bands begin at 1.4 µm",
    ),
    Material(
        name="beta_cloth",
        reflectance=0.78,
        reflectance_out_of_band=0.8,
        source="assumption, 0.70 to 0.85; out of band: assumption, 0.70 to 0.85",
    ),
    Material(
        name="aluminised_kapton",
        kind="mixed",
        reflectance=0.84,
        reflectance_out_of_band=0.82,
        eta=1.45,
        k=16.0,
        alpha=0.15,
        specular_share=0.7,
        source=(
            f"assumption, 0.80 to 0.88; lobe of the aluminium behind the film from {RAKIC}; creases "
            "finer than a mesh are alpha (0.05 to 0.3) and the diffuse share (0.2 to 0.5)"
            "; out of band: the metal behind the film falls, assumption, 0.75 to 0.88"
        ),
    ),
    Material(name="black_paint", reflectance=0.05, source="assumption, 0.04 to 0.06"),
    Material(
        name="dyed_black_anodise",
        reflectance=0.45,
        reflectance_out_of_band=0.4,
        source=(
            "assumption, 0.3 to 0.6: organic dyes are transparent beyond 0.9 µm; out of band: assumption, "
            "0.2 to 0.6, as they begin to absorb near that"
        ),
    ),
    Material(name="black_oxide", reflectance=0.10, source="assumption, 0.05 to 0.15"),
    Material(
        name="oxidised_inconel",
        kind="mixed",
        reflectance=0.20,
        reflectance_out_of_band=0.19,
        eta=3.36,
        k=7.05,
        alpha=0.4,
        specular_share=0.1,
        source=f"assumption, 0.10 to 0.30; lobe of its main component, {NICKEL}; out of band: falls as nickel does",
    ),
    Material(
        name="solar_cell",
        kind="mixed",
        reflectance=0.30,
        reflectance_out_of_band=0.21,
        eta=1.45,
        k=16.0,
        alpha=0.05,
        specular_share=0.25,
        source=(
            "assumption, 0.1 to 0.5: silicon is transparent at 1.5 µm and the metal behind it is "
            f"seen through the cover glass; lobe from {RAKIC}"
            "; out of band: a third of the photons lie below silicon's edge at 1.1 µm and are absorbed but for 0.05"
        ),
    ),
    Material(
        name="target_black",
        reflectance=0.05,
        source="assumption, 0.04 (paint) to 0.6 (dyed anodise); a parameter of the target",
    ),
    Material(
        name="target_white",
        reflectance=0.80,
        source="assumption, 0.5 to 0.88; a parameter of the target",
    ),
    Material(name="grey_reference", reflectance=0.50, source="by definition: a 50 % Lambertian reference"),
    Material(
        name="retro_sheet",
        kind="retroreflector",
        reflectance=0.5,
        retro=RetroLobe(kind="bead_sheet", retro_share=0.185, half_width=math.radians(0.35)),
        source=(
            "lobe fitted to the least values of white sheeting with glass beads, ASTM D4956 type III: 250 and 95 "
            "cd/lx/m² at 0.2° and 0.5°, gains of 785 and 298; measured with visible light, assumed at 1.5 µm; "
            "reflectance an assumption, 0.3 to 0.7"
        ),
    ),
    Material(
        name="corner_cube_array",
        kind="retroreflector",
        reflectance=0.65,
        retro=RetroLobe(
            kind="corner_cube", retro_share=0.4, half_width=math.radians(0.34), refractive_index=1.57
        ),
        source=(
            "lobe fitted to the least values of white sheeting with micro-prisms, ASTM D4956 type VIII: 700 and 250 "
            "cd/lx/m² at 0.2° and 0.5°, gains of 2200 and 785; polycarbonate n 1.57; measured with visible light, "
            "assumed at 1.5 µm; reflectance an assumption, 0.4 to 0.8; precise cubes have lobes of arcseconds"
        ),
    ),
)
"""Every material of the library by name, read-only."""


def material(name: str) -> Material:
    """Look a material up in the library.

    Parameters
    ----------
    name
        A key of :data:`MATERIALS`.

    Returns
    -------
    Material
        The entry.

    Raises
    ------
    UnknownMaterialError
        If there is none of that name; the message names the nearest one and lists all.
    """
    try:
        return MATERIALS[name]
    except KeyError:
        near = difflib.get_close_matches(name, MATERIALS, n=1)
        hint = f"Did you mean '{near[0]}'? " if near else ""
        raise UnknownMaterialError(
            f"There is no material '{name}'.", remedy=f"{hint}The library has: {', '.join(MATERIALS)}."
        ) from None


def _uniform(value: float) -> dict[str, Any]:
    return {"type": "uniform", "value": value}


def mitsuba_bsdf(material: Material) -> dict[str, Any]:
    """Write a material as a Mitsuba BSDF for the ``mono`` variants.

    Both sides of a surface reflect alike, so a sheet may be seen from either.

    Parameters
    ----------
    material
        Any material, from the library or not.

    Returns
    -------
    dict
        A ``twosided`` BSDF in the form that ``mitsuba.load_dict`` reads; only numbers in it.

    Notes
    -----
    GGX: Walter et al. 2007, EGSR, "Microfacet models for refraction through rough surfaces".
    """
    diffuse = {"type": "diffuse", "reflectance": _uniform(material.diffuse_reflectance)}
    if material.kind == "diffuse":
        return {"type": "twosided", "nested": diffuse}
    if material.retro is not None:
        name, value = material.retro.entrance
        lobe = {
            "type": "retroreflector",
            "kind": material.retro.kind,
            "reflectance": _uniform(material.reflectance),
            "retro_share": material.retro.retro_share,
            "half_width": material.retro.half_width,
            name: value,
        }
        return {"type": "twosided", "nested": lobe}
    specular = {
        "type": "roughconductor",
        "distribution": "ggx",
        "alpha": material.alpha,
        "eta": _uniform(material.eta or 0.0),
        "k": _uniform(material.k or 0.0),
    }
    if material.kind == "rough_conductor":
        return {"type": "twosided", "nested": specular}
    blend = {
        "type": "blendbsdf",
        "weight": material.specular_share,
        "diffuse": diffuse,
        "specular": specular,
    }
    return {"type": "twosided", "nested": blend}
