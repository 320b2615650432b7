"""The error budget in closed form: what each source makes of the range of a facing target.

To first order, a change δf of the charges of the line moves an estimate by g·δf, where g is the gradient of the
estimator. A source of noise whose charges have the covariance C therefore gives the estimate the variance gᵀ C g. For
the maximum-likelihood fit, g is that of weighted least squares for charge, position and width together, with the
variance v of all sources (:func:`~scanner_sim.analytic.noise.fit_gradient`). Variances are averaged over where in its
pixel the centre of the spot lies.

Two sources make nothing of a range: ``vibration`` turns and shifts scanner and beam as one, and R is the way along the
beam; ``power``, by which the charges of a line all scale alike, and with them neither centroid nor fit moves.

Not modelled: the light's slant, the loss above and below the pixels, the baseline's noise, noise that changes which
pixel is the brightest, the Earth's light; vibration within a dwell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic.array import SensorArray
from scanner_sim.analytic.beam import beam_radius
from scanner_sim.analytic.estimators import ESTIMATORS
from scanner_sim.analytic.noise import fit_gradient, width_spread
from scanner_sim.analytic.speckle import SpeckledSpot, averaged, pixel_covariance
from scanner_sim.analytic.spot import electrons, pixel_shares

Floats = NDArray[np.float64]

_LINE, _PHASES = 24, 16


@dataclass(frozen=True)
class InstrumentNumbers:
    """Plain numbers of an instrument and its target, SI; pixels for what ends in ``_px``.

    Attributes
    ----------
    estimator, corrected
        Key of :data:`~scanner_sim.analytic.estimators.ESTIMATORS`, or ``maximum_likelihood``; whether its systematic
        error is taken off.
    array
        The array behind the lens.
    transmission
        Of lens and filter together.
    power
        Of the laser.
    shot, contrast
        1 with shot noise, 0 without; contrast of the speckle, 0 without.
    read, dark, step, response
        Read noise, mean dark charge and step of the converter [electron], relative spread of the pixels; 0 where
        switched off.
    dwell, subtracted
        Time for which the laser shines, and that time over the one for which it is off; 0 where nothing is subtracted.
    sweep, half
        Angle by which the beam moves during a dwell; deflection to each side over which the shots are spread.
    sunlight, height
        Irradiance of the Sun on the target, as far as the filter passes it [W/m²]; height of the pixels.
    drift_zero, drift_scale, kelvins
        Change of a mirror's zero and scale by a kelvin; root mean square of the temperature's course.
    beam_width
        Least and largest image of the beam that the fit grants, relative to that on a facing surface.
    stray, pixels
        Share of the light that is scattered evenly over so many pixels.
    """

    estimator: str
    corrected: bool
    array: SensorArray
    baseline: float
    aperture: float
    transmission: float
    aberration: float
    diffusion: float
    wavelength: float
    power: float
    waist_radius: float
    waist_distance: float
    m_squared: float
    pitch: float
    efficiency: float
    dwell: float
    reflectance: float
    shot: float
    read: float
    dark: float
    step: float
    response: float
    contrast: float
    sweep: float
    jitter: float
    wobble: float
    synchronisation: float
    readout: float
    half: float
    subtracted: float = 0.0
    sunlight: float = 0.0
    height: float = 0.0
    drift_zero: float = 0.0
    drift_scale: float = 0.0
    kelvins: float = 0.0
    beam_width: tuple[float, float] = (0.7, 1.5)
    stray: float = 0.0
    pixels: int = 512


def range_budget(numbers: InstrumentNumbers, distance: float) -> dict[str, float]:
    """Return the standard deviation of the range [m] that each source makes at a distance [m], and ``all`` make.

    σ_p of the peak and of the angle between projection and reception, f (1 + p²/f²) σ_e, become R²σ_p/(f d) (eq 4 at
    Θ = 0) on an upright array; on others as :mod:`scanner_sim.analytic.array` has it. Errors σ_Θ of the deflection
    become ∂R/∂Θ σ_Θ with ∂R/∂Θ = d − R tanΘ, root mean square over ±half: √(d² + R² half²/3).

    Charge of the Sun on a pixel of the area S: E ρ/π · A S T/f² · QE t λ/(h c) (eq 18), with the scales along the array
    and across it for f². Where k times the charge without the laser is subtracted, light counts (1 + k) times in the
    variance of shot noise, and the converter's and the amplifier's noise (1 + k²) times; fixed patterns of the
    background go.

    Drift turns a mirror by ΔT (zero + scale Θ), and the range by ∂R/∂Θ of it: root mean square over ±half.

    Charge of the target: N = P T ρ A/(π R²) · QE t λ/(h c) (eq 19). Of the share s that is scattered (veiling glare,
    ISO 9358) each of n pixels has s N/n, and the spot 1 − s; the noise of that light is ``stray``. Speckle: the packets
    of :func:`~scanner_sim.analytic.speckle.pixel_covariance`, averaged over the sweep, which is along the line.
    """
    radius = float(
        beam_radius(
            distance, numbers.waist_radius, numbers.waist_distance, numbers.wavelength, numbers.m_squared
        )
    )
    scale, height = (float(one) for one in numbers.array.scale(distance))
    cell = numbers.wavelength * scale / numbers.aperture
    image = 0.5 * radius * scale / distance
    aberration = math.hypot(numbers.aberration * scale / height, numbers.array.blur(distance).along)
    grainy = SpeckledSpot(image, cell, aberration, numbers.diffusion, numbers.pitch)
    along = grainy.sigma / numbers.pitch
    spread = width_spread(numbers.beam_width, (image / grainy.sigma) ** 2)
    left = averaged((numbers.sweep * distance, 0.0), radius)
    watts = (
        numbers.power * numbers.transmission * numbers.reflectance * numbers.aperture**2 / (4.0 * distance**2)
    )
    whole = float(electrons(watts, numbers.dwell, numbers.wavelength, numbers.efficiency))
    charge, veil = (1.0 - numbers.stray) * whole, numbers.stray * whole / numbers.pixels
    k = numbers.subtracted
    collected = numbers.transmission * 0.25 * math.pi * numbers.aperture**2
    seen = (
        numbers.sunlight * numbers.reflectance / math.pi * numbers.pitch * numbers.height / (scale * height)
    )
    ambient = float(electrons(seen * collected, numbers.dwell, numbers.wavelength, numbers.efficiency))
    squares: dict[str, list[float]] = {
        name: [] for name in ("shot", "read", "quantisation", "response", "stray", "sun")
    }
    speckle, bias = [0.0], []
    for phase in (np.arange(_PHASES) + 0.5) / _PHASES - 0.5:
        centre = _LINE // 2 + float(phase)
        m = charge * pixel_shares(centre, along, _LINE)
        parts = {
            "shot": numbers.shot * (m + numbers.dark * (1.0 + k)),
            "read": np.full(_LINE, numbers.read**2 * (1.0 + k**2)),
            "quantisation": np.full(_LINE, numbers.step**2 / 12.0 * (1.0 + k**2)),
            "response": (numbers.response * (m + veil if k else m + veil + ambient)) ** 2,
            "stray": np.full(_LINE, numbers.shot * veil),
            "sun": np.full(_LINE, numbers.shot * ambient * (1.0 + k)),
        }
        variance = np.maximum(sum(parts.values(), np.zeros(_LINE)), 1.0)
        if numbers.contrast > 0.0:
            variance = variance + numbers.contrast**2 * grainy.single_variance(left) * charge * m
        if numbers.estimator == "maximum_likelihood":
            slopes = fit_gradient(centre, along, charge, variance, spread)
        else:
            slopes = _slopes(numbers.estimator, m)
        for name, values in parts.items():
            squares[name].append(float(slopes**2 @ values))
        if numbers.contrast > 0.0:
            covariance = pixel_covariance(grainy, centre, _LINE, left)
            speckle.append((numbers.contrast * charge) ** 2 * float(slopes @ covariance @ slopes))
        bias.append(_bias(numbers, m, centre))
    peak = {name: math.sqrt(float(np.mean(values))) for name, values in squares.items()}
    peak["speckle"] = math.sqrt(sum(speckle) / _PHASES)
    peak["estimator"] = math.sqrt(float(np.mean(np.square(bias))))
    per_metre = float(numbers.array.range_error(distance))
    found = {name: per_metre * numbers.pitch * value for name, value in peak.items()}
    found["synchronisation"] = per_metre * float(numbers.array.turned(distance)) * numbers.synchronisation
    by_theta = math.hypot(numbers.baseline, distance * numbers.half / math.sqrt(3.0))
    found |= {name: by_theta * getattr(numbers, name) for name in ("jitter", "wobble", "readout")}
    angle = np.linspace(-numbers.half, numbers.half, 201)
    turned = numbers.kelvins * (numbers.drift_zero + numbers.drift_scale * angle)
    found["drift"] = float(np.sqrt(np.mean(((numbers.baseline - distance * angle) * turned) ** 2)))
    found |= {"vibration": 0.0, "power": 0.0}
    found["all"] = math.sqrt(sum(value**2 for value in found.values()))
    return found


def _slopes(estimator: str, m: Floats) -> Floats:
    """Return ∂p̂/∂f of each pixel [pixel/electron] at the noise-free line."""
    slopes, change = np.zeros(_LINE), 1e-6 * float(m.max())
    for pixel in range(_LINE):
        lines = [m.copy(), m.copy()]
        lines[0][pixel] += change
        lines[1][pixel] -= change
        one, other = (ESTIMATORS[estimator](line.tolist()) for line in lines)
        slopes[pixel] = (one - other) / (2.0 * change)
    return slopes


def _bias(numbers: InstrumentNumbers, m: Floats, centre: float) -> float:
    if numbers.corrected or numbers.estimator == "maximum_likelihood":
        return 0.0
    return ESTIMATORS[numbers.estimator](m.tolist()) - centre
