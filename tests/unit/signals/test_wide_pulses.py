"""When a pulse is too wide to be of one surface: the filter of its width, and what a surface may stretch."""

from __future__ import annotations

import math
from typing import Any

import drjit.auto.ad as auto
import numpy as np
import pytest
from prototype import Digitiser, Laser
from scipy.stats import norm

from scanner_sim.analytic.beam import beam_radius
from scanner_sim.detector.photodiode.pulse_response import PulseResponse
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.signals.waveform.filter import PHASES, Noise
from scanner_sim.signals.waveform.fit import PulseFit
from scanner_sim.signals.waveform.overlap import OverlapTest, width_filter

WIDTH, SIGMA = 1.3, 0.66
NOISE = Noise(2.0, 5.0, 0.3, SIGMA)

pytestmark = pytest.mark.usefixtures("device")


def pulse(time: Any, variance: float) -> np.ndarray:
    """Return a Gaussian of the area that makes the plain pulse's peak 1."""
    whole = WIDTH**2 + SIGMA**2
    return np.asarray(math.sqrt(whole / variance) * np.exp(-0.5 * np.asarray(time) ** 2 / variance))


def test_the_taps_tell_the_width_and_nothing_else() -> None:
    """Claim: a small change of a pulse's variance, times its height, is the taps' sum; neither height nor delay
    counts."""
    weights, _ = width_filter(PulseResponse(WIDTH**2), NOISE)
    half, whole = weights.shape[1] // 2, WIDTH**2 + SIGMA**2
    for row in (10, PHASES, PHASES + 40):
        off = np.arange(-half, half + 1.0) - (row / PHASES - 1.0)
        assert weights[row] @ (3.0 * pulse(off, whole)) == pytest.approx(0.0, abs=1e-3)
        assert weights[row] @ (pulse(off - 1e-3, whole) - pulse(off, whole)) == pytest.approx(0.0, abs=1e-6)
        wider = 0.01 * whole
        assert weights[row] @ (3.0 * (pulse(off, whole + wider) - pulse(off, whole))) == pytest.approx(
            3.0 * wider, rel=0.03
        )


def test_the_taps_err_by_the_noise_of_their_samples() -> None:
    """Claim: coloured noise of the correlation exp(−Δ²/4σ²), white noise, and shot noise of the light in the middle of
    two samples, behind half of the electronics' variance, at the phase of the pulse: by sums over all pairs."""
    weights, moments = width_filter(PulseResponse(WIDTH**2), NOISE)
    half = weights.shape[1] // 2
    away = np.arange(-half, half + 1.0)
    alike = np.exp(-0.25 * ((away[:, None] - away) / SIGMA) ** 2)
    for row in (10, PHASES + 45):
        taps, middle = weights[row], 0.5 * (away[:, None] + away) - (row / PHASES - 1.0)
        assert moments.white[row] == pytest.approx(taps @ taps, rel=1e-9)
        assert moments.coloured[row] == pytest.approx(taps @ alike @ taps, rel=1e-9)
        light = alike * pulse(middle, WIDTH**2 + 0.5 * SIGMA**2)
        assert moments.shot[row] == pytest.approx(taps @ light @ taps, rel=1e-6)


@pytest.mark.parametrize("delay", [0.0, 150.0])
def test_a_pulse_is_too_wide_beyond_noise_and_the_steepest_surface(delay: float) -> None:
    """Claim: beyond 3.72 σ of the taps' sum (a level of 10⁻⁴), a hundredth of the pulse's own variance, and that of a
    surface at 80°, (w tan 80°/c)² of the beam at the pulse's range; just inside it passes, just outside not."""
    laser, clock = Laser(waist_radius=1e-4, waist_distance=4.0), Digitiser(gate=(9.0, 60.0))
    response = PulseResponse(WIDTH**2)
    made = OverlapTest.of(response, NOISE, laser, clock)
    weights, moments = width_filter(response, NOISE)
    row, height, current = PHASES + 45, 200.0, 150.0
    R = 0.5 * SPEED_OF_LIGHT * (clock.start + delay / clock.rate)
    beam = float(beam_radius(R, 1e-4, 4.0, laser.wavelength))
    stretch = (beam * math.tan(math.radians(80.0)) / SPEED_OF_LIGHT * clock.rate) ** 2
    given = (2.0, 5.0, 0.3)
    variance = (
        moments.coloured[row] * given[0]
        + moments.white[row] * given[1]
        + moments.shot[row] * given[2] * current
    )
    limit = float(norm.isf(1e-4)) * math.sqrt(variance) / current + 0.01 * (WIDTH**2 + SIGMA**2) + stretch
    # Samples whose sum by the taps is what is wanted.
    taps = weights[row]
    for share, wide in ((0.995, False), (1.005, True)):
        samples = taps * (share * limit * height / float(taps @ taps))
        fit = PulseFit(auto.Float(0.0), auto.Float(height), auto.UInt32(row))
        found = made(
            [auto.Float(float(one)) for one in samples],
            fit,
            auto.Float(delay),
            auto.Float(current),
            tuple(auto.Float(one) for one in given),  # type: ignore[arg-type]
        )
        assert bool(found[0]) is wide
