"""Table 2: the times of tracking, from patterns and mirrors."""

from __future__ import annotations

import pytest
from prototype import Galvanometers

from scanner_sim.config.scanner import Scanner
from scanner_sim.optics.jump import jump_time
from scanner_sim.scan.schedule import Visiting, raster_time, visits

DWELL = Scanner().dwell


@pytest.mark.parametrize(("size", "printed"), [(128, 0.8), (256, 3.3), (512, 13.1)])
def test_raster(size: int, printed: float) -> None:
    """Claim: a raster takes voxels/rate. Expected: the printed seconds. Tolerance: half of the last digit."""
    assert raster_time(size * size, DWELL) == pytest.approx(printed, abs=0.05)


def test_single_target() -> None:
    """Claim: a single target is measured every 6.6 ms.

    Set-up: 128 points at 20 kHz, and the default 0.2 ms in which the mirrors turn round. Expected: 6.6 ms. Tolerance:
    rounding: 0.2 ms is derived from the print.
    """
    assert Visiting().period(128, DWELL, 1, Galvanometers()) == pytest.approx(6.6e-3, rel=1e-12)


@pytest.mark.parametrize("targets", [2, 4, 10])
def test_several_targets(targets: int) -> None:
    """Claim: several targets take 10 ms each.

    Set-up: the default mirrors jump by half the field, 0.5 rad, and settle to 100 µrad. The paper prints neither jump
    nor mirrors: the limits are assumptions, and the time follows from them. Expected: a jump of 3.4 ms, 10 ms a
    target. Tolerance: 0.1 ms, below half of the printed digit; with a jump of 0.3 or 0.7 rad it fails.
    """
    servo = Galvanometers()
    period = Visiting().period(128, DWELL, targets, servo)
    assert float(jump_time(servo, 0.5)) == pytest.approx(3.4e-3, abs=0.1e-3)
    assert period == pytest.approx(10e-3, abs=0.1e-3)
    plan = visits(targets, 3 * targets, period, 128 * DWELL)
    assert plan.start[2 * targets] - plan.start[targets] == pytest.approx(targets * 10e-3, rel=0.01)
    for jump in (0.3, 0.7):
        assert abs(Visiting(stated_jump=jump).period(128, DWELL, targets, servo) - 10e-3) > 0.1e-3
