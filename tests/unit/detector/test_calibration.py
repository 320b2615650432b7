"""What is known of the line sensor: charges, floor and variances with and without a subtracted exposure."""

from __future__ import annotations

import math

import numpy as np
import pytest
from prototype import PositionSensor

from scanner_sim.detector.line.noise import NoiseSwitches
from scanner_sim.signals.line.calibration import SensorCalibration

DWELL = 50e-6
SENSOR = PositionSensor(
    adc_bits=12, bias=100, full_well=1e6, read_noise=300.0, dark_current=4e9, prnu=0.02, gain=200.0
)


def numbers(laser_off: float = 0.0, **switches: bool) -> SensorCalibration:
    noise = NoiseSwitches(**{name: switches.get(name, True) for name in NoiseSwitches.model_fields})
    return SensorCalibration.of(SENSOR.model_copy(update={"noise": noise}), DWELL, laser_off)


def test_the_floor_is_read_steps_and_dark() -> None:
    """Claim: σ_read² + g²/12 + the dark charge, 4e9 · 50 µs = 200 000 electrons, each with its own switch."""
    assert numbers().floor == pytest.approx(300.0**2 + 200.0**2 / 12.0 + 2e5)
    assert numbers().floor_sigma == pytest.approx(math.sqrt(numbers().floor))
    assert numbers(read=False).floor == pytest.approx(200.0**2 / 12.0 + 2e5)
    assert numbers(quantisation=False).floor == pytest.approx(300.0**2 + 2e5)
    assert numbers(dark=False).floor == pytest.approx(300.0**2 + 200.0**2 / 12.0)
    # Without shot noise the dark charge is there, and does not scatter.
    silent = numbers(shot=False)
    assert silent.floor == pytest.approx(300.0**2 + 200.0**2 / 12.0)
    assert silent.dark == pytest.approx(2e5)


def test_a_subtracted_exposure_adds_its_own_floor() -> None:
    """Claim: with the laser off for 20 % of a dwell k = 4: k² times the amplifier's and steps, k times the dark."""
    found = numbers(0.2)
    assert found.off_scale == pytest.approx(4.0)
    assert found.dark == pytest.approx(0.8 * 2e5)
    amplifier = 300.0**2 + 200.0**2 / 12.0
    # The dark exposure holds 0.2 · 2e5, which counts k² times: k times that of the lit one.
    assert found.floor == pytest.approx(amplifier * 17.0 + 0.8 * 2e5 * 5.0)
    assert found.floor == pytest.approx(amplifier * 17.0 + 0.8 * 2e5 + 16.0 * 0.2 * 2e5)


def test_numbers_become_charges() -> None:
    found = numbers(0.2)
    assert found.charge(1100.0) == pytest.approx(1000.0 * 200.0 - 0.8 * 2e5)
    assert found.ambient(300.0) == pytest.approx(4.0 * 200.0 * 200.0 - 0.8 * 2e5)


def test_light_adds_shot_noise_and_response() -> None:
    """Claim: floor + N + (prnu N)², none of it below zero; what is subtracted counts (1 + k) times."""
    found = numbers(0.2)
    charge = np.array([-5e3, 0.0, 1e5])
    wanted = found.floor + np.array([0.0, 0.0, 1e5 + (0.02 * 1e5) ** 2])
    np.testing.assert_allclose(found.variance(charge), wanted)
    np.testing.assert_allclose(found.variance_above(3e4, charge), wanted + 5.0 * 3e4)
    np.testing.assert_allclose(found.variance_above(-3e4, charge), wanted)
    np.testing.assert_allclose(numbers(shot=False).variance(1e5), numbers(shot=False).floor + 2e3**2)
    np.testing.assert_allclose(numbers(prnu=False).variance(1e5), numbers().floor + 1e5)


def test_a_pixel_is_full_where_well_or_converter_is() -> None:
    """Claim: the lesser of the well and of the converter above its bias, less five σ of the read noise."""
    assert numbers().full == pytest.approx((4095 - 100) * 200.0 - 5.0 * 300.0)
    small = SensorCalibration.of(SENSOR.model_copy(update={"full_well": 5e5}), DWELL)
    assert small.full == pytest.approx(5e5 - 1500.0)
    assert math.isinf(numbers(saturation=False).full)
