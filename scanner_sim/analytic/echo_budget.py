"""The error budget of time of flight in closed form: what each source makes of the range of a facing target.

The pulse is a Gaussian of standard deviation σ_p, and the response of the electronics a Gaussian of σ_h. White noise of
the one-sided density S that has passed the electronics has, at two samples Δ apart, the covariance

S e^(−Δ²/4σ_h²)/(4√π σ_h).

Shot noise of the signal follows the light of the signal: at samples whose middle is m its covariance is

q M² F R₀ E G(m; σ_p² + σ_h²/2) e^(−Δ²/4σ_h²)/(2√π σ_h),

since the product of the two responses is a Gaussian of variance σ_h²/2 about m times e^(−Δ²/4σ_h²)/(2√π σ_h).

The delay is estimated by weighted least squares together with the unknown height (Kay, *Fundamentals of statistical
signal processing: estimation theory*, 1993, sec. 3.9): its weights are w = (JᵀR⁻¹J)⁻¹JᵀR⁻¹, with the covariance R of
the noise in the dark, and a source of the covariance C gives it the variance wᵀ C w.

A pulse that the amplifier clips is timed by the middle of its two edges at half of the saturation V. Each crossing errs
by the noise over the slope, V √(2 ln(A/V))/σ, and the mean of the two by 1/√2 of it.

``vibration`` and ``power`` make nothing: R is the way along a beam that is shaken with the scanner, and a pulse's place
does not depend on its height, nor does the middle of two edges.

Not modelled: other shapes of pulses, other ways of timing than the matched filter, the depth of the footprint, the
drift of the clock within the echo.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.constants import SPEED_OF_LIGHT

Floats = NDArray[np.float64]

_CHARGE = 1.602176634e-19
_PHASES = 16
_REACH = 7.0
"""Standard deviations of the pulse to each side that are summed."""
_LEVEL = 0.5
"""Level of the edges of clipped pulses, over the saturation."""
_NOTHING = ("vibration", "power")
"""Sources that make nothing of a range."""
_RIDGE = 1e-6
"""Share of the noise's variance that is white at least: keeps the matrix regular."""


@dataclass(frozen=True)
class EchoInstrument:
    """Plain numbers of a time-of-flight unit and its target, SI.

    What can be switched off is then 0; ``shot`` is 1 or 0.

    Attributes
    ----------
    energy, pulse, response
        Energy of the pulse; standard deviations σ_p and σ_h of pulse and electronics.
    aperture, transmission
        Diameter of the lens; transmission of lens and filter together.
    gain, excess, responsivity
        Gain M and excess noise factor F of the avalanche; responsivity R₀ before it.
    bulk, surface, amplifier
        Dark currents with and without the avalanche; density of the amplifier's noise [A/√Hz].
    saturation, interval, step
        Largest current, infinite for none; time between samples; step of the converter [A].
    jitter, drift
        Of the clock.
    sunlight, field
        Irradiance of the Sun on the target, as far as the filter passes it [W/m²]; full angle of the round field.
    """

    energy: float
    pulse: float
    response: float
    aperture: float
    transmission: float
    reflectance: float
    gain: float
    excess: float
    responsivity: float
    bulk: float
    surface: float
    shot: float
    amplifier: float
    saturation: float
    interval: float
    step: float
    jitter: float
    drift: float
    sunlight: float
    field: float


def echo_budget(unit: EchoInstrument, distance: float) -> dict[str, float]:
    """Return the standard deviation of the range [m] that each source makes at a distance [m], and ``all`` make.

    Share of the pulse that comes back: T ρ A/(π R²) (eq 19); σ_R = c σ_τ/2 (eq 2). ``clock`` holds the jitter, c
    jitter/2, and the drift's error R · drift. Light of the Sun on the diode: E ρ/π · Ω A T with Ω = π field²/4.
    NaN for a diode that none of the pulse reaches.
    """
    area = 0.25 * math.pi * unit.aperture**2 * unit.transmission
    share = area * unit.reflectance / (math.pi * distance**2)
    sky = unit.sunlight * unit.reflectance / math.pi * 0.25 * math.pi * unit.field**2 * area
    avalanche = unit.shot * _CHARGE * unit.gain**2 * unit.excess
    density = {
        "shot": 2.0 * avalanche * unit.bulk + 2.0 * unit.shot * _CHARGE * unit.surface,
        "amplifier": unit.amplifier**2,
        "sun": 2.0 * avalanche * unit.responsivity * sky,
    }
    received = (
        avalanche * unit.responsivity * unit.energy * share / (2.0 * math.sqrt(math.pi) * unit.response)
    )
    steady = {name: value / (4.0 * math.sqrt(math.pi) * unit.response) for name, value in density.items()}
    steady["quantisation"] = unit.step**2 / 12.0
    charge = unit.gain * unit.responsivity * unit.energy * share
    width = math.hypot(unit.pulse, unit.response)
    height = charge / (math.sqrt(2.0 * math.pi) * width)
    if height <= 0.0:
        return dict.fromkeys((*steady, "clock", *_NOTHING, "all"), math.nan)
    timed = _clipped if height > unit.saturation else _matched
    squares = timed(unit, steady, received, height, width)
    found = {name: 0.5 * SPEED_OF_LIGHT * math.sqrt(value) for name, value in squares.items()}
    found["clock"] = math.hypot(0.5 * SPEED_OF_LIGHT * unit.jitter, distance * unit.drift)
    found |= dict.fromkeys(_NOTHING, 0.0)
    found["all"] = math.sqrt(sum(value**2 for value in found.values()))
    return found


def fused_sigma(one: float, other: float) -> float:
    """Return 1/√(1/σ₁² + 1/σ₂²) [m], the best that two independent ranges allow (Aitken 1935)."""
    return one * other / math.hypot(one, other)


def _matched(
    unit: EchoInstrument, steady: dict[str, float], received: float, height: float, width: float
) -> dict[str, float]:
    """Return the variance of the delay [s²] by each source for a pulse within the amplifier's range."""
    half = math.ceil(_REACH * width / unit.interval)
    grid = unit.interval * np.arange(-half, half + 1)
    lag = grid[:, None] - grid[None, :]
    middle = 0.5 * (grid[:, None] + grid[None, :])
    colour = np.exp(-((lag / (2.0 * unit.response)) ** 2))
    white = np.eye(grid.size)
    dark = steady["shot"] + steady["amplifier"]
    R = dark * colour + steady["quantisation"] * white
    R = R + (_RIDGE * max(R[0, 0], 1e-30)) * white
    spread = unit.pulse**2 + 0.5 * unit.response**2
    sums: dict[str, list[float]] = {name: [] for name in steady}
    for phase in (np.arange(_PHASES) + 0.5) / _PHASES:
        t = grid - phase * unit.interval
        p = height * np.exp(-0.5 * (t / width) ** 2)
        J = np.stack([p * t / width**2, p], axis=1)
        solved = np.linalg.solve(R, J)
        w = np.linalg.solve(J.T @ solved, solved.T)[0]
        late = (middle - phase * unit.interval) ** 2
        light = np.exp(-0.5 * late / spread) / math.sqrt(2.0 * math.pi * spread)
        for name, variance in steady.items():
            covariance = variance * (white if name == "quantisation" else colour)
            if name == "shot":
                covariance = covariance + received * light * colour
            sums[name].append(float(w @ covariance @ w))
    return {name: float(np.mean(values)) for name, values in sums.items()}


def _clipped(
    unit: EchoInstrument, steady: dict[str, float], received: float, height: float, width: float
) -> dict[str, float]:
    """Return the same for a pulse that is clipped, from its two edges."""
    level = _LEVEL * unit.saturation
    early = math.sqrt(2.0 * math.log(height / level))
    spread = unit.pulse**2 + 0.5 * unit.response**2
    light = math.exp(-0.5 * (early * width) ** 2 / spread) / math.sqrt(2.0 * math.pi * spread)
    slope = level * early / width
    variance = steady | {"shot": steady["shot"] + received * light}
    return {name: 0.5 * value / slope**2 for name, value in variance.items()}
