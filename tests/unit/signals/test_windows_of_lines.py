"""Which pixels of a dark line are exposed: enough for all that is read of a peak, by hand."""

from __future__ import annotations

import math

import drjit.auto.ad as auto
import numpy as np
import pytest
from prototype import Laser, PositionSensor, Receiver

from scanner_sim.detector.line.exposure import unlit_numbers
from scanner_sim.render.device import Device
from scanner_sim.signals.line.calibration import SensorCalibration
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.window import NoisePeak
from scanner_sim.signals.processing import Processing

DWELL, SENSOR = 50e-6, PositionSensor(pixels=1024)
CALIBRATION = SensorCalibration.of(SENSOR, DWELL)
SPOT = ExpectedSpot.of(Laser(), Receiver(), 1.0, SENSOR, DWELL)
NOISE = NoisePeak.of(unlit_numbers(SENSOR, DWELL), CALIBRATION)


def test_noise_makes_no_peak_higher_than_its_range(device: Device) -> None:
    """Claim: B = c_most − c_least and V = B/σ_floor, each a thousandth more, and the level a twentieth."""
    least, most = unlit_numbers(SENSOR, DWELL)
    assert NOISE.contrast == pytest.approx(1.001 * (most - least) * SENSOR.electrons_per_number)
    read, step = SENSOR.read_noise, SENSOR.electrons_per_number
    floor = math.sqrt(read**2 + step**2 / 12.0 + DWELL * SENSOR.dark_current)
    assert NOISE.level == pytest.approx(1.001 * NOISE.contrast / floor + 0.05)


def test_lines_are_exposed_as_far_as_a_peak_is_read(device: Device) -> None:
    """Claim: a peak at the last lit pixel or the next is read to 24 pixels of the widest spot and 7 of its baseline,
    and one that noise makes near the array's beginning from 5 pixels farther; three more make no difference.

    Set-up: five lines, lit strongly, faintly, not at all, across the array's end and before its beginning.
    """
    ends = np.array([[650.0, 658.5], [700.0, 709.0], [9.0, 2.0], [900.0, 1100.0], [-60.0, -30.5]])
    charge = NOISE.contrast * np.array([11.0, 9.0, 0.0, 11.0, 11.0])
    light = *(auto.Float(end.astype(np.float32)) for end in ends.T), auto.Float(charge.astype(np.float32))
    likely, every = NOISE.windows(light, SPOT, Processing(), CALIBRATION, auto.Float([0.2] * 5))
    first, last = (end.numpy().astype(int) for end in (likely.first, likely.last))
    assert not every.first.numpy().any()
    whole = every.last.numpy().astype(int)
    # The faintest surface has 0.15 of its charge as contrast, whose light grows with the square of the position.
    faintest = (
        0.15 * Processing().validation.min_reflectance * float(SPOT.white_by_pixel) / math.cos(0.2) ** 2
    )
    unlit = math.ceil(math.sqrt(NOISE.contrast / faintest) - SPOT.offset / SPOT.pitch)
    for number, pixel in enumerate((660, 710, unlit)):
        assert pixel + 24 + 7 <= whole[number] <= pixel + 39
    assert unlit + 5 + 24 + 7 <= whole[2]
    assert whole[3] == 1023
    # At first strong light alone, with the sides of its peak, three pixels that end 16 away, beyond 2.6 σ of the
    # widest spot; of fainter light all to where noise makes no peak; of what is not on the array a pixel or none.
    sides = 2 * math.ceil(2.6 * SPOT.largest_sigma / 2.0) + 2
    np.testing.assert_array_equal(first, [650 - sides - 2, 0, 0, 900 - sides - 2, 0])
    np.testing.assert_array_equal(last, [660 + sides, 710 + sides, unlit + sides, 1023, 0])
