"""The range gate leads the search: what stands outside of it is no rival of the spot inside."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from scanner_sim.config.scanner import Scanner
from scanner_sim.detector.line.exposure import electrons_per_watt, expose, pairwise
from scanner_sim.foundation.status import Status
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.peaks import find_peaks
from scanner_sim.signals.processing import Processing

SCANNER = Scanner()
SENSOR, DWELL = SCANNER.position_sensor, SCANNER.dwell
NEAR, FAR = 120.0, 40.0
"""Pixels of a sunlit glint at 3.3 m and of the laser's spot at 9.9 m."""

pytestmark = pytest.mark.usefixtures("device")


def measured(
    glint: float, gate: tuple[float, float] | None, *, at: float = NEAR, theta: float = 0.0
) -> tuple[Status, float]:
    """Return status and position of a line with the spot (1e6 electron) and a glint of its shape."""
    import drjit as dr
    import drjit.auto.ad as auto

    pixel = np.arange(SENSOR.pixels)
    charge = sum(height * np.exp(-0.5 * (pixel - place) ** 2) for height, place in ((4e5, FAR), (glint, at)))
    power = charge / electrons_per_watt(SENSOR, SCANNER.laser.wavelength, DWELL)
    table = auto.Float(np.asarray(power, dtype=np.float32))

    def on_pixel(pixel: Any, _: Any) -> Any:
        return dr.gather(auto.Float, table, pixel)

    signal = expose(pairwise(on_pixel), dr.arange(auto.UInt32, 1), SENSOR, SCANNER.laser.wavelength, DWELL, 1)
    spot = ExpectedSpot.of(SCANNER.laser, SCANNER.receiver, 1.0, SENSOR, DWELL)
    peaks = find_peaks(signal, SENSOR, Processing(range_gate=gate), DWELL, spot, theta)
    return Status(int(peaks.status[0])), float(peaks.position[0])


@pytest.mark.parametrize("glint", [0.0, 3e5, 2e6])
def test_a_glint_outside_of_the_gate_does_not_disturb(glint: float) -> None:
    status, position = measured(glint, (7.0, 16.0))
    assert status is Status.VALID
    assert position == pytest.approx(FAR, abs=0.05)


def test_without_a_gate_the_same_glint_makes_it_ambiguous() -> None:
    assert measured(3e5, None)[0] is Status.AMBIGUOUS


def test_a_peak_outside_is_still_found_where_nothing_is_inside() -> None:
    """The gate only leads the search: a lone peak outside of it is found, and refused by its range later."""
    status, position = measured(0.0, (2.0, 4.0))
    assert status is Status.VALID
    assert position == pytest.approx(FAR, abs=0.05)


@pytest.mark.parametrize("theta", [-0.3, 0.0, 0.3])
@pytest.mark.parametrize("nearest", [0.0, 0.05])
def test_a_gate_that_begins_before_the_nearest_range_leads_in_all_directions(
    nearest: float, theta: float
) -> None:
    """Claim: a gate from 0 m, or from nearer than d sinΘ, where no position looks, holds all that is nearer than its
    end, to the right as to the left: a glint at 26 m disturbs no spot at 10 m."""
    assert measured(3e5, None, at=15.0, theta=theta)[0] is Status.AMBIGUOUS
    status, position = measured(3e5, (nearest, 16.0), at=15.0, theta=theta)
    assert status is Status.VALID
    assert position == pytest.approx(FAR, abs=0.05)
