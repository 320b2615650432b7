"""Light from a retro-reflecting sheet that faces the laser: in closed form, for a receiver beside it or around it.

The sheet reflects ρ in all. The share s returns about the way it came: mirror facets, whose tilts θ from the back
direction have the cumulative distribution tan²θ/(α² + tan²θ) (the law of Trowbridge and Reitz, *JOSA* 65, 531, 1975),
send light along the normal to the observation angle δ = 2θ. The rest is diffuse.

What a coaxial lens collects does not depend on the range until the returning cone, of tangent about 2α, is wider than
the lens; then it falls as 1/R². A lens at the base d sees the cone's flank: I ∝ R²/(R² + b²)², b = d/(2α), which
*rises* as R² at short range, is highest at R = b and falls as 1/R² beyond.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import quad

Floats = NDArray[np.float64]


class Sheet(NamedTuple):
    """A sheet, as numbers.

    Attributes
    ----------
    reflectance, retro_share
        ρ and s.
    half_width
        Observation angle at which the lobe has half its gain [rad].
    half_angle
        Entrance angle at which a sheet of beads returns half [rad]; None for corner cubes.
    refractive_index
        Index of refraction of corner cubes.
    """

    reflectance: float
    retro_share: float
    half_width: float
    half_angle: float | None = None
    refractive_index: float = 1.0

    @property
    def alpha(self) -> float:
        """Width α of the facets' tilts: (1 + tan²(δ_½/2)/α²)² = 2."""
        return float(np.tan(self.half_width / 2.0) / np.sqrt(np.sqrt(2.0) - 1.0))


def entrance_share(sheet: Sheet, beta: ArrayLike) -> Floats:
    """Return E(β), the share that is still retro-reflected at the entrance angle ``beta`` [rad], its shape.

    Beads: 2^(−(tan β/tan β_½)²), a fit. Cubes of round aperture: the overlap of two discs whose centres are
    2√2 tan β' radii apart, (2φ − sin 2φ)/π with cos φ = √2 tan β' and β' refracted (Degnan 1993).
    """
    beta = np.asarray(beta, dtype=np.float64)
    if sheet.half_angle is not None:
        return np.asarray(0.5 ** (np.tan(beta) / np.tan(sheet.half_angle)) ** 2)
    apart = np.sqrt(2.0) * np.tan(np.arcsin(np.sin(beta) / sheet.refractive_index))
    phi = np.arccos(np.clip(apart, -1.0, 1.0))
    return np.asarray((2.0 * phi - np.sin(2.0 * phi)) / np.pi)


def mean_entrance(sheet: Sheet) -> float:
    """Return ∫ E(β) sin 2β dβ from 0 to π/2: the mean over light from all sides."""
    value, _ = quad(lambda beta: float(entrance_share(sheet, beta)) * np.sin(2.0 * beta), 0.0, np.pi / 2.0)
    return float(value)


def lobe_within(sheet: Sheet, angle: ArrayLike) -> Floats:
    """Return the share of the lobe within ``angle`` [rad] of the way back, its shape: t²/(α² + t²), t = tan(δ/2)."""
    t2 = np.tan(np.asarray(angle, dtype=np.float64) / 2.0) ** 2
    return np.asarray(t2 / (sheet.alpha**2 + t2))


def lobe_intensity(sheet: Sheet, observation: ArrayLike) -> Floats:
    """Return the intensity of a lobe that holds 1 W [W/sr], shape of ``observation`` [rad].

    The derivative of :func:`lobe_within` over the solid angle 2π sin δ dδ: α² sec⁴(δ/2)/(4π (α² + tan²(δ/2))²).
    """
    t2 = np.tan(np.asarray(observation, dtype=np.float64) / 2.0) ** 2
    return np.asarray(sheet.alpha**2 * (1.0 + t2) ** 2 / (4.0 * np.pi * (sheet.alpha**2 + t2) ** 2))


def lobe_albedo(sheet: Sheet) -> float:
    """Return the share of light along the normal that the lobe returns: s ∫ E(δ) I_lobe 2π sin δ dδ.

    A reciprocal sheet passes no more from 0 to δ than from δ to 0, so the smaller entrance share counts, E(δ).
    """
    s = sheet.retro_share

    def part(u: float) -> float:
        """Return E where the lobe holds the share u within: tan²(δ/2) = α² u/(1 − u)."""
        delta = 2.0 * np.arctan(sheet.alpha * np.sqrt(u / (1.0 - u)))
        return float(entrance_share(sheet, min(delta, np.pi / 2.0))) if delta < np.pi / 2.0 else 0.0

    value, _ = quad(part, 0.0, 1.0)
    return float(s * value)


def intensity(sheet: Sheet, observation: ArrayLike) -> Floats:
    """Return the intensity per incident power [1/sr] of a sheet lit along its normal, shape of ``observation`` [rad].

    ρ [s E(δ) I_lobe + (1 − a)(1 − s E(δ))/(1 − s Ē) cos δ/π], a from :func:`lobe_albedo`; the second factor is
    exact to the first order in the width of the lobe.
    """
    delta = np.asarray(observation, dtype=np.float64)
    s, E = sheet.retro_share, entrance_share(sheet, delta)
    rest = (1.0 - lobe_albedo(sheet)) * (1.0 - s * E) / (1.0 - s * mean_entrance(sheet))
    return np.asarray(
        sheet.reflectance * (s * E * lobe_intensity(sheet, delta) + rest * np.cos(delta) / np.pi)
    )


def gain(sheet: Sheet, observation: ArrayLike) -> Floats:
    """Return how many times brighter than a white Lambertian surface the sheet is, shape of ``observation`` [rad].

    Lit along the normal: π I(δ)/cos δ. In the terms of sheet makers, π times the coefficient of
    retro-reflection [cd/lx/m²] at small angles.
    """
    delta = np.asarray(observation, dtype=np.float64)
    return np.asarray(np.pi * intensity(sheet, delta) / np.cos(delta))


def offset_power(R: ArrayLike, P: float, sheet: Sheet, d: float, aperture: float, T: float) -> Floats:
    """Return the power [W] that a lens beside the laser collects, the shape of ``R``: I(δ) A cosδ T P/(R² + d²).

    Parameters
    ----------
    R
        Ranges [m].
    P
        Power of the laser [W].
    sheet
        The sheet, square to the beam.
    d
        Base: distance of the lens from the laser [m], well above the radii of lens and beam, whose size counts
        relatively as 2 (radius/d)².
    aperture, T
        Diameter of the lens [m] and transmission.
    """
    R = np.asarray(R, dtype=np.float64)
    delta = np.arctan2(d, R)
    solid_angle = np.pi / 4.0 * aperture**2 * np.cos(delta) / (R**2 + d**2)
    return np.asarray(P * T * intensity(sheet, delta) * solid_angle)


def coaxial_power(R: ArrayLike, P: float, sheet: Sheet, aperture: float, T: float) -> Floats:
    """Return the power [W] that a lens around the laser collects, the shape of ``R``.

    P T ρ [s t²/(α² + t²) + (1 − a)(1 − s)/(1 − s Ē) sin²γ], t = tan(γ/2), tan γ = aperture/(2R): the lobe and
    Lambert's law integrated over the lens, for E = 1 within it. The beam must be thin against lens and cone.
    Parameters as in :func:`offset_power`.
    """
    cone = np.arctan2(0.5 * aperture, np.asarray(R, dtype=np.float64))
    s = sheet.retro_share
    rest = (1.0 - lobe_albedo(sheet)) * (1.0 - s) / (1.0 - s * mean_entrance(sheet))
    lobe = s * lobe_within(sheet, cone)
    return np.asarray(P * T * sheet.reflectance * (lobe + rest * np.sin(cone) ** 2))
