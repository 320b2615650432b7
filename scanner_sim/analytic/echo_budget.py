"""The error budget of time of flight in closed form: what each source makes of the range of a facing target.

A Gaussian pulse of standard deviation σ_p behind electronics of the response h, a Gaussian of σ_h, stands in noise
that h has coloured: the covariance at two samples Δ apart is that of white noise of the one-sided density S, S
e^(−Δ²/4σ_h²)/(4√π σ_h). Shot noise of the signal itself follows its light: with h(a) h(b) a Gaussian of σ_h²/2 about
the middle of a and b times e^(−Δ²/4σ_h²)/(2√π σ_h), the covariance is q M² F R₀ E G(middle; σ_p² + σ_h²/2)
e^(−Δ²/4σ_h²)/(2√π σ_h). The delay is estimated by weighted least squares with unknown height (Kay, *Fundamentals of
statistical signal processing: estimation theory*, 1993, sec. 3.9), w = (JᵀR⁻¹J)⁻¹JᵀR⁻¹ with R that of the dark, and a
source of the covariance C has the variance wᵀ C w.

Pulses that the amplifier clips are timed by the middle of their two edges at half of the saturation V: each crossing
errs by the noise over the slope, V √(2 ln(A/V))/σ, and the mean of two by 1/√2 of it.

Not modelled: pulses that are no Gaussians, the ways of timing that are no matched filter, the footprint's depth, the
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
_RIDGE = 1e-6
"""Share of the noise's variance that is white at least: keeps the matrix regular."""


@dataclass(frozen=True)
class EchoInstrument:
    """Plain numbers of a time-of-flight unit and its target, SI.

    ``energy`` of the pulse, ``pulse`` and ``response`` standard deviations σ_p and σ_h, ``aperture`` diameter and
    ``transmission`` of lens and filter; ``gain`` M, ``excess`` F, ``responsivity`` R₀, ``bulk`` and ``surface`` dark
    currents, ``amplifier`` density [A/√Hz], ``saturation`` current, infinite for none, ``interval`` between samples,
    ``step`` of the converter [A], ``jitter`` and ``drift`` of the clock; ``shot`` is 1 or 0, and so are 0 the others
    where they are switched off. ``sunlight`` is the irradiance that counts on the target [W/m²], ``field`` the full
    angle of the round field.
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


def echo_budget(bench: EchoInstrument, distance: float) -> dict[str, float]:
    """Return the standard deviation of the range [m] that each source makes at a distance [m], and ``all`` make.

    Share of the pulse that comes back: T ρ A/(π R²) (eq 19); σ_R = c σ_τ/2 (eq 2). ``clock`` holds the jitter, c
    jitter/2, and the drift's error R · drift. Light of the Sun on the diode: E ρ/π · Ω A T with Ω = π field²/4.
    """
    area = 0.25 * math.pi * bench.aperture**2 * bench.transmission
    share = area * bench.reflectance / (math.pi * distance**2)
    sky = bench.sunlight * bench.reflectance / math.pi * 0.25 * math.pi * bench.field**2 * area
    avalanche = bench.shot * _CHARGE * bench.gain**2 * bench.excess
    density = {
        "shot": 2.0 * avalanche * bench.bulk + 2.0 * bench.shot * _CHARGE * bench.surface,
        "amplifier": bench.amplifier**2,
        "sun": 2.0 * avalanche * bench.responsivity * sky,
    }
    received = (
        avalanche * bench.responsivity * bench.energy * share / (2.0 * math.sqrt(math.pi) * bench.response)
    )
    steady = {name: value / (4.0 * math.sqrt(math.pi) * bench.response) for name, value in density.items()}
    steady["quantisation"] = bench.step**2 / 12.0
    charge = bench.gain * bench.responsivity * bench.energy * share
    width = math.hypot(bench.pulse, bench.response)
    height = charge / (math.sqrt(2.0 * math.pi) * width)
    timed = _clipped if height > bench.saturation else _matched
    squares = timed(bench, steady, received, height, width)
    found = {name: 0.5 * SPEED_OF_LIGHT * math.sqrt(value) for name, value in squares.items()}
    found["clock"] = math.hypot(0.5 * SPEED_OF_LIGHT * bench.jitter, distance * bench.drift)
    found["all"] = math.sqrt(sum(value**2 for value in found.values()))
    return found


def fused_sigma(one: float, other: float) -> float:
    """Return 1/√(1/σ₁² + 1/σ₂²) [m], the best that two independent ranges allow (Aitken 1935)."""
    return one * other / math.hypot(one, other)


def _matched(
    bench: EchoInstrument, steady: dict[str, float], received: float, height: float, width: float
) -> dict[str, float]:
    """Return the variance of the delay [s²] by each source for a pulse within the amplifier's range."""
    half = math.ceil(_REACH * width / bench.interval)
    grid = bench.interval * np.arange(-half, half + 1)
    lag = grid[:, None] - grid[None, :]
    middle = 0.5 * (grid[:, None] + grid[None, :])
    colour = np.exp(-((lag / (2.0 * bench.response)) ** 2))
    white = np.eye(grid.size)
    dark = steady["shot"] + steady["amplifier"]
    R = dark * colour + steady["quantisation"] * white
    R = R + (_RIDGE * max(R[0, 0], 1e-30)) * white
    spread = bench.pulse**2 + 0.5 * bench.response**2
    sums: dict[str, list[float]] = {name: [] for name in steady}
    for phase in (np.arange(_PHASES) + 0.5) / _PHASES:
        t = grid - phase * bench.interval
        p = height * np.exp(-0.5 * (t / width) ** 2)
        J = np.stack([p * t / width**2, p], axis=1)
        solved = np.linalg.solve(R, J)
        w = np.linalg.solve(J.T @ solved, solved.T)[0]
        late = (middle - phase * bench.interval) ** 2
        light = np.exp(-0.5 * late / spread) / math.sqrt(2.0 * math.pi * spread)
        for name, variance in steady.items():
            covariance = variance * (white if name == "quantisation" else colour)
            if name == "shot":
                covariance = covariance + received * light * colour
            sums[name].append(float(w @ covariance @ w))
    return {name: float(np.mean(values)) for name, values in sums.items()}


def _clipped(
    bench: EchoInstrument, steady: dict[str, float], received: float, height: float, width: float
) -> dict[str, float]:
    """Return the same for a pulse that is clipped, from its two edges."""
    level = _LEVEL * bench.saturation
    early = math.sqrt(2.0 * math.log(height / level))
    spread = bench.pulse**2 + 0.5 * bench.response**2
    light = math.exp(-0.5 * (early * width) ** 2 / spread) / math.sqrt(2.0 * math.pi * spread)
    slope = level * early / width
    variance = steady | {"shot": steady["shot"] + received * light}
    return {name: 0.5 * value / slope**2 for name, value in variance.items()}
