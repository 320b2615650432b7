"""The spectrum of the Sun as it arrives outside of the atmosphere.

Planck's law and the measured spectrum come from colour-science.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.constants import PLANCK, SPEED_OF_LIGHT
from scanner_sim.scene.light.lighting import Sun

Floats = NDArray[np.float64]

BOLTZMANN: Final = 1.380_649e-23
"""Boltzmann constant [J/K], exact (BIPM, *The International System of Units*, 9th ed., 2019)."""
SPECTRUM_ENDS: Final = {"planck": (50e-9, 1e-3), "astm_g173": (280e-9, 4000e-9)}
"""Wavelengths [m] between which the spectra are integrated: all of the black body but 1e-6, all of the table."""


def solar_irradiance(sun: Sun, wavelengths: ArrayLike) -> Floats:
    """Return the spectral irradiance of a surface square to the Sun [W/m²/m].

    Parameters
    ----------
    sun
        Its spectrum, temperature, radius and distance.
    wavelengths
        In vacuum [m], any shape; above zero.

    Returns
    -------
    ndarray
        Shape of ``wavelengths``. ``planck``: π B(λ, T) (R/D)², eq 17 of Blais et al. (2000), with the CODATA
        radiation constants (those of colour-science are ITS-90's, 3e-5 off at 1.5 µm). ``astm_g173``: the
        extraterrestrial column of ASTM G-173-03, interpolated linearly and zero outside of 280 to 4000 nm
        (1.5 % of the total); radius and distance do not change it.
    """
    wanted = np.asarray(wavelengths, dtype=np.float64)
    if sun.spectrum == "astm_g173":
        nodes, values = _astm_g173()
        return np.interp(wanted, nodes, values, left=0.0, right=0.0)
    # Loading colour-science changes how NumPy prints in the whole process, which is not ours to decide.
    with np.printoptions():
        from colour.colorimetry.blackbody import planck_law
    c1 = 2.0 * math.pi * PLANCK * SPEED_OF_LIGHT**2
    c2 = PLANCK * SPEED_OF_LIGHT / BOLTZMANN
    with np.errstate(over="ignore"):  # exp(c2/λT) overflows where nothing is emitted
        radiance = np.asarray(planck_law(wanted, sun.temperature, c1, c2), dtype=np.float64)
    return np.asarray(math.pi * (sun.radius / sun.distance) ** 2 * radiance.reshape(wanted.shape))


def irradiance_between(sun: Sun, shortest: float, longest: float) -> float:
    """Return the irradiance of a surface square to the Sun [W/m²] from ``shortest`` to ``longest`` [m].

    Trapezoidal rule on 20 001 wavelengths, evenly spaced in their logarithm: 1e-6 for the whole black body.
    """
    first, last = SPECTRUM_ENDS[sun.spectrum]
    shortest, longest = max(shortest, first), min(longest, last)
    if not shortest < longest:
        return 0.0
    nodes = np.geomspace(shortest, longest, 20_001)
    return float(np.trapezoid(solar_irradiance(sun, nodes), nodes))


def total_irradiance(sun: Sun) -> float:
    """Return the irradiance of a surface square to the Sun over its whole spectrum [W/m²]."""
    return irradiance_between(sun, *SPECTRUM_ENDS[sun.spectrum])


@cache
def _astm_g173() -> tuple[Floats, Floats]:
    """Return the table of ASTM G-173: wavelengths [m] and extraterrestrial irradiance [W/m²/m]."""
    with np.printoptions():
        from colour.plotting.datasets.astm_g_173 import SD_ASTMG173_ETR
    nodes = 1e-9 * np.asarray(SD_ASTMG173_ETR.wavelengths, dtype=np.float64)
    return nodes, 1e9 * np.asarray(SD_ASTMG173_ETR.values, dtype=np.float64)
