"""Sunlight against laser light in closed form: eqs 17 to 19, Figures 16 and 17.

Equation 18 is damaged in print: the solid angle of the detector is S_CCD/f², not S_CCD/f; the Lambertian law
needs 1/π, as eq 19 has it; dλ is missing twice. The ``physical`` model is the repaired one. The ``printed``
model leaves the 1/π out and repairs the rest, without which the units do not fit: its SNR is π times lower.
"""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import zeta

from scanner_sim.foundation.constants import PLANCK, SPEED_OF_LIGHT

# Loading colour-science changes how NumPy prints in the whole process.
_PRINTED = np.get_printoptions()
from colour.plotting.datasets import astm_g_173  # noqa: E402

np.set_printoptions(**_PRINTED)

Floats = NDArray[np.float64]
Model = Literal["physical", "printed"]

BOLTZMANN: Final = 1.380_649e-23
"""Boltzmann constant [J/K], exact."""
TEMPERATURE: Final = 5770.0
"""Temperature of the black body [K], section 5."""
SUN_RADIUS: Final = 695_000e3
"""Radius of the Sun [m]; 69 500 km in print, where a zero was lost."""
SUN_DISTANCE: Final = 149.68e9
"""Mean distance of the Sun [m], section 5."""
BLOCKING: Final = 1e-6
"""B_s/B_p, the paper's 60 dB."""


def planck_irradiance(wavelength: ArrayLike, T: float = TEMPERATURE) -> Floats:
    """Return E_λ = 2π h c² / (λ⁵ (exp(hc/λkT) − 1)) (R_s/D_s)² [W/m²/m], shape of ``wavelength`` [m]: eq 17."""
    wavelength = np.asarray(wavelength, dtype=np.float64)
    with np.errstate(over="ignore"):
        photons = np.expm1(PLANCK * SPEED_OF_LIGHT / (wavelength * BOLTZMANN * T))
        emitted = 2.0 * np.pi * PLANCK * SPEED_OF_LIGHT**2 / (wavelength**5 * photons)
    return np.asarray(emitted * (SUN_RADIUS / SUN_DISTANCE) ** 2)


def fraction_below(wavelength: ArrayLike, T: float = TEMPERATURE) -> Floats:
    """Return the share of a black body's power at wavelengths shorter than ``wavelength`` [m], its shape.

    (15/π⁴) Σ_n e^(−nx) (x³/n + 3x²/n² + 6x/n³ + 6/n⁴) with x = hc/λkT (Siegel and Howell, *Thermal Radiation
    Heat Transfer*, 4th ed., 2002, eq 1-37). Good to 1e-9 up to 50 µm at the Sun's temperature.
    """
    x = PLANCK * SPEED_OF_LIGHT / (np.asarray(wavelength, dtype=np.float64)[..., None] * BOLTZMANN * T)
    n = np.arange(1.0, 2001.0)
    terms = np.exp(-n * x) * (x**3 / n + 3.0 * x**2 / n**2 + 6.0 * x / n**3 + 6.0 / n**4)
    return np.asarray(15.0 / np.pi**4 * terms.sum(axis=-1))


def total_irradiance(T: float = TEMPERATURE) -> float:
    """Return ∫ E_λ dλ = σ T⁴ (R_s/D_s)² [W/m²], with σ = 2π⁵k⁴/(15 h³c²): Stefan and Boltzmann's law."""
    # ∫ x³/(eˣ − 1) dx = Γ(4) ζ(4) = π⁴/15.
    integral = 6.0 * float(zeta(4.0))
    emitted = 2.0 * np.pi * (BOLTZMANN * T) ** 4 * integral / (PLANCK**3 * SPEED_OF_LIGHT**2)
    return float(emitted * (SUN_RADIUS / SUN_DISTANCE) ** 2)


def band_irradiance(wavelength: float, bandwidth: float, T: float = TEMPERATURE) -> float:
    """Return the black body's irradiance [W/m²] within ``bandwidth`` about ``wavelength`` [m]."""
    low, high = fraction_below(np.array([wavelength - bandwidth / 2.0, wavelength + bandwidth / 2.0]), T)
    return total_irradiance(T) * float(high - low)


def effective_irradiance(
    wavelength: float, bandwidth: float, blocking: float = BLOCKING, T: float = TEMPERATURE
) -> float:
    """Return E_eff = ∫_band E + (B_s/B_p) ∫₀^∞ E [W/m²]: the bracket of eq 18."""
    return band_irradiance(wavelength, bandwidth, T) + blocking * total_irradiance(T)


def sun_power(
    reflectance: float, S: float, f: float, B_p: float, E_eff: float, model: Model = "physical"
) -> float:
    """Return the sunlight on a detector of area S that looks at a sunlit plane [W]: eq 18, repaired.

    I = (T_r/π) (S/f²) B_p E_eff; without the 1/π where ``model`` is ``printed``. It does not depend on the range.

    Parameters
    ----------
    reflectance
        T_r of the plane, square to the Sun.
    S, f
        Area of the detector that counts [m²] and focal length [m].
    B_p
        Aperture area times all transmissions at the peak [m²].
    E_eff
        :func:`effective_irradiance` [W/m²].
    """
    lambert = 1.0 / np.pi if model == "physical" else 1.0
    return float(lambert * reflectance * S / f**2 * B_p * E_eff)


def signal_to_sun(
    R: ArrayLike, P: float, f: float, S: float, E_eff: float, model: Model = "physical"
) -> Floats:
    """Return SNR = I_laser/I_sun = P f² / (R² S E_eff), the shape of ``R`` [m]: eq 19 over eq 18.

    Reflectance, transmission and aperture cancel. ``P`` [W] is the laser's power; π times lower where ``model``
    is ``printed``.
    """
    lambert = 1.0 if model == "physical" else 1.0 / np.pi
    return np.asarray(lambert * P * f**2 / (np.asarray(R, dtype=np.float64) ** 2 * S * E_eff))


def equal_range(P: float, f: float, S: float, E_eff: float, model: Model = "physical") -> float:
    """Return the range [m] at which laser and Sun are equally strong: √(P f² / (S E_eff)) where SNR = 1."""
    return float(np.sqrt(signal_to_sun(1.0, P, f, S, E_eff, model)))


class SolarSpectra(NamedTuple):
    """The curves of Figure 16: spectral irradiances [W/m²/m] over wavelengths [m], each of shape (n,).

    Attributes
    ----------
    wavelength
        Ascending.
    planck
        Black body of 5770 K, eq 17.
    outside
        Measured outside of the atmosphere.
    ground
        Measured on the ground through 1.5 air masses, on a plane tilted by 37° (direct and sky).
    """

    wavelength: Floats
    planck: Floats
    outside: Floats
    ground: Floats


def solar_spectra() -> SolarSpectra:
    """Return the curves of Figure 16, from 280 nm to 4 µm.

    The measured ones are those of ASTM G-173-03, which stand in for the paper's references 10 and 11. The
    standard is read through colour-science.
    """
    outside, ground = astm_g_173.SD_ASTMG173_ETR, astm_g_173.SD_ASTMG173_GLOBAL_TILT
    wavelength = 1e-9 * np.asarray(outside.wavelengths, dtype=np.float64)
    measured = (1e9 * np.asarray(curve.values, dtype=np.float64) for curve in (outside, ground))
    return SolarSpectra(wavelength, planck_irradiance(wavelength), *measured)
