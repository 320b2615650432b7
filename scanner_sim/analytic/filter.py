"""The interference filter and what passes it, written apart from the simulator's.

A stack of layers passes the wavelengths that fit its optical thickness n t cosθ', where Snell's law gives the angle
within, n sinθ' = sinθ. For light that comes in at θ the whole band therefore lies at wavelengths shorter by the factor
cosθ' (Macleod, *Thin-film optical filters*, 4th ed., 2010, 8.2.4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import quad

from scanner_sim.analytic.sun import planck_irradiance


@dataclass(frozen=True)
class PassBand:
    """A pass band: centre at normal incidence and full width [m], effective index, blocking relative to the peak.

    ``cavities`` is the number of coupled cavities, 1/(1 + x^2m) at x half widths from the centre, or 0 for a flat band
    with steep edges.
    """

    centre: float
    width: float
    index: float
    blocking: float
    cavities: int = 0

    def centre_at(self, incidence: float) -> float:
        """Return the centre [m] at an incidence [rad]."""
        return self.centre * math.cos(math.asin(math.sin(incidence) / self.index))

    def passed(self, wavelength: float, incidence: float = 0.0) -> float:
        """Return the transmission of a wavelength [m] over the peak's, blocking included."""
        x = (wavelength - self.centre_at(incidence)) / (0.5 * self.width)
        inside = 1.0 / (1.0 + x ** (2 * self.cavities)) if self.cavities else float(abs(x) <= 1.0)
        return inside + self.blocking * (1.0 - inside)

    def counted(
        self, wavelength: float, response: tuple[float, float], incidence: float, temperature: float
    ) -> float:
        """Return the black-body Sun's irradiance behind the filter [W/m²], in watts of the laser's wavelength.

        ∫ E(λ) T(λ) λ/λ₀ dλ over the detector's response: a watt at λ frees λ/λ₀ times as many electrons as one at λ₀.
        Eq 18's bracket, but for the weight. By adaptive quadrature, split at the band's edges.
        """

        def counted(x: float) -> float:
            return float(planck_irradiance(x, temperature)) * self.passed(x, incidence) * x / wavelength

        low, high = response
        middle = self.centre_at(incidence)
        far = 0.5 * self.width
        edges = [middle + k * far for k in (-30.0, -3.0, -1.0, 1.0, 3.0, 30.0)]
        ends = [low, *sorted(edge for edge in edges if low < edge < high), high]
        parts = (quad(counted, *pair, limit=200)[0] for pair in pairwise(ends))
        return float(np.sum(list(parts)))
