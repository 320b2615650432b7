"""The error budget in closed form: what each source makes of the range of a facing target.

First order throughout: an estimate moves by g·δf when the line of charges f moves by δf, so that a source with the
covariance C of the pixels has the variance gᵀ C g. g is the gradient of the estimator or, for the maximum-likelihood
fit, that of weighted least squares, g_i = (m'_i/v_i)/Σ (m'_j²/v_j) with m' = ∂m/∂µ and the variance v of all sources
(Winick, *J. Opt. Soc. Am. A* 3, 1986). Averages are over the place of the spot in its pixel.

Not modelled: the light's slant, the loss above and below the pixels, the baseline's noise, noise that changes which
pixel is the brightest, the Earth's light.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic.beam import beam_radius
from scanner_sim.analytic.estimators import ESTIMATORS
from scanner_sim.analytic.geometry import range_error
from scanner_sim.analytic.speckle import SpeckledSpot, averaged, pixel_covariance
from scanner_sim.analytic.spot import electrons, pixel_shares

Floats = NDArray[np.float64]

_LINE, _PHASES = 24, 16


@dataclass(frozen=True)
class InstrumentNumbers:
    """Plain numbers of an instrument and its target, SI; pixels for what ends in ``_px``.

    ``estimator`` is a key of :data:`~scanner_sim.analytic.estimators.ESTIMATORS` or ``maximum_likelihood``;
    ``corrected`` says whether its systematic error is taken off. ``power`` is the laser's, ``transmission`` that of
    lens and filter. ``read``, ``dark`` and ``step`` are read noise, mean dark charge and step of the converter
    [electron], ``response`` the pixels' relative spread; any of them is 0 where it is switched off, and so are ``shot``
    (1 or 0) and the ``contrast`` of the speckle. ``dwell`` is the time for which the laser shines, ``subtracted`` that
    time over the one in which it is off, 0 where nothing is subtracted. ``sweep`` is the angle by which the beam moves
    meanwhile, ``half`` the deflection to each side over which shots are spread. ``sunlight`` is the Sun's irradiance
    that counts on the target [W/m²] and ``height`` that of the pixels; ``drift_zero`` and ``drift_scale`` are what a
    kelvin does to the mirrors and ``kelvins`` the root mean square of their course.
    """

    estimator: str
    corrected: bool
    focal_length: float
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


def range_budget(bench: InstrumentNumbers, distance: float) -> dict[str, float]:
    """Return the standard deviation of the range [m] that each source makes at a distance [m], and ``all`` make.

    σ_p of the peak and of the angle between projection and reception, f (1 + p²/f²) σ_e, become R²σ_p/(f d) (eq 4 at
    Θ = 0). Errors σ_Θ of the deflection become ∂R/∂Θ σ_Θ with ∂R/∂Θ = d − R tanΘ, root mean square over ±half:
    √(d² + R² half²/3).

    Charge of the Sun on a pixel of the area S: E ρ/π · A S T/f² · QE t λ/(h c) (eq 18). Where k times the charge
    without the laser is subtracted, light counts (1 + k) times in the variance of shot noise, and the converter's and
    the amplifier's noise (1 + k²) times; fixed patterns of the background go.

    Drift turns a mirror by ΔT (zero + scale Θ), and the range by ∂R/∂Θ of it: root mean square over ±half.

    Charge of the target: N = P T ρ A/(π R²) · QE t λ/(h c) (eq 19). Speckle: the packets of
    :func:`~scanner_sim.analytic.speckle.pixel_covariance`, averaged over the sweep, which is along the line.
    """
    radius = float(
        beam_radius(distance, bench.waist_radius, bench.waist_distance, bench.wavelength, bench.m_squared)
    )
    cell = bench.wavelength * bench.focal_length / bench.aperture
    image = 0.5 * radius * bench.focal_length / distance
    grainy = SpeckledSpot(image, cell, bench.aberration, bench.diffusion, bench.pitch)
    along = grainy.sigma / bench.pitch
    left = averaged((bench.sweep * distance, 0.0), radius)
    watts = bench.power * bench.transmission * bench.reflectance * bench.aperture**2 / (4.0 * distance**2)
    charge = float(electrons(watts, bench.dwell, bench.wavelength, bench.efficiency))
    k = bench.subtracted
    collected = bench.transmission * 0.25 * math.pi * bench.aperture**2
    seen = bench.sunlight * bench.reflectance / math.pi * bench.pitch * bench.height / bench.focal_length**2
    ambient = float(electrons(seen * collected, bench.dwell, bench.wavelength, bench.efficiency))
    squares: dict[str, list[float]] = {
        name: [] for name in ("shot", "read", "quantisation", "response", "sun")
    }
    speckle, bias = [0.0], []
    for phase in (np.arange(_PHASES) + 0.5) / _PHASES - 0.5:
        centre = _LINE // 2 + float(phase)
        m = charge * pixel_shares(centre, along, _LINE)
        parts = {
            "shot": bench.shot * (m + bench.dark * (1.0 + k)),
            "read": np.full(_LINE, bench.read**2 * (1.0 + k**2)),
            "quantisation": np.full(_LINE, bench.step**2 / 12.0 * (1.0 + k**2)),
            "response": (bench.response * (m if k else m + ambient)) ** 2,
            "sun": np.full(_LINE, bench.shot * ambient * (1.0 + k)),
        }
        variance = np.maximum(sum(parts.values(), np.zeros(_LINE)), 1.0)
        if bench.contrast > 0.0:
            variance = variance + bench.contrast**2 * grainy.single_variance(left) * charge * m
        slopes = _slopes(bench.estimator, m, centre, along, charge, variance)
        for name, values in parts.items():
            squares[name].append(float(slopes**2 @ values))
        if bench.contrast > 0.0:
            covariance = pixel_covariance(grainy, centre, _LINE, left)
            speckle.append((bench.contrast * charge) ** 2 * float(slopes @ covariance @ slopes))
        bias.append(_bias(bench, m, centre))
    peak = {name: math.sqrt(float(np.mean(values))) for name, values in squares.items()}
    peak["speckle"] = math.sqrt(sum(speckle) / _PHASES)
    peak["estimator"] = math.sqrt(float(np.mean(np.square(bias))))
    per_metre = float(range_error(distance, 0.0, bench.focal_length, bench.baseline, 1.0))
    found = {name: per_metre * bench.pitch * value for name, value in peak.items()}
    p = bench.focal_length * bench.baseline / distance
    apart = bench.focal_length * (1.0 + (p / bench.focal_length) ** 2) * bench.synchronisation
    found["synchronisation"] = per_metre * apart
    by_theta = math.hypot(bench.baseline, distance * bench.half / math.sqrt(3.0))
    found |= {name: by_theta * getattr(bench, name) for name in ("jitter", "wobble", "readout")}
    angle = np.linspace(-bench.half, bench.half, 201)
    turned = bench.kelvins * (bench.drift_zero + bench.drift_scale * angle)
    found["drift"] = float(np.sqrt(np.mean(((bench.baseline - distance * angle) * turned) ** 2)))
    found["all"] = math.sqrt(sum(value**2 for value in found.values()))
    return found


def _slopes(
    estimator: str, m: Floats, centre: float, along: float, charge: float, variance: Floats
) -> Floats:
    """Return ∂p̂/∂f of each pixel [pixel/electron] at the noise-free line."""
    if estimator == "maximum_likelihood":
        step = 1e-4
        ahead, behind = (pixel_shares(centre + sign * step, along, _LINE) for sign in (1.0, -1.0))
        moved = charge * (ahead - behind) / (2.0 * step)
        return np.asarray(moved / variance / np.sum(moved**2 / variance))
    slopes, change = np.zeros(_LINE), 1e-6 * float(m.max())
    for pixel in range(_LINE):
        lines = [m.copy(), m.copy()]
        lines[0][pixel] += change
        lines[1][pixel] -= change
        one, other = (ESTIMATORS[estimator](line.tolist()) for line in lines)
        slopes[pixel] = (one - other) / (2.0 * change)
    return slopes


def _bias(bench: InstrumentNumbers, m: Floats, centre: float) -> float:
    if bench.corrected or bench.estimator == "maximum_likelihood":
        return 0.0
    return ESTIMATORS[bench.estimator](m.tolist()) - centre
