"""Reading a line of two exposures: what is subtracted, and what a full pixel still tells."""

from __future__ import annotations

import drjit.auto.ad as auto
import numpy as np
import pytest

from scanner_sim.detector.line.exposure import Signal
from scanner_sim.signals.line.calibration import SensorCalibration
from scanner_sim.signals.line.digital_line import Around, Baseline, Line

BIAS, GAIN, DARK, FULL, OFF = 10.0, 2.0, 60.0, 1500.0, 4.0
KNOWN = SensorCalibration(BIAS, GAIN, DARK, OFF, 400.0, 1.0, 0.1, FULL)
LIT = np.array([410.0, 900.0, 500.0, 60.0])
UNLIT = np.array([60.0, 90.0, 900.0, 20.0])
"""One shot: pixel 0 is plain, 1 is full when lit, 2 is full without the laser too, 3 is dark."""

pytestmark = pytest.mark.usefixtures("device")


def line() -> Line:
    signal = Signal(auto.Float(), 1, 4, 0.2)
    places = signal.address(auto.UInt32([0, 1, 2, 3]), auto.UInt32(0)).numpy()
    table = np.zeros(int(places.max()) + 3, np.float32)
    table[places], table[places + 2] = LIT, UNLIT
    return Line(Signal(auto.Float(table), 1, 4, 0.2), KNOWN)


def test_the_background_times_k_is_subtracted_and_a_full_one_leaves_nothing() -> None:
    """Claim: c = (n − b) g − k (n_off − b) g, the dark level being in both; a pixel full of light tells nothing."""
    lit, unlit = (LIT - BIAS) * GAIN, (UNLIT - BIAS) * GAIN * OFF
    expected = np.where((UNLIT - BIAS) * GAIN >= FULL, 0.0, lit - unlit)
    assert expected.tolist() == [400.0, 1140.0, 0.0, 20.0]
    found = line()
    assert [float(found.charge(pixel).numpy()[0]) for pixel in range(4)] == expected.tolist()
    assert [found.full(pixel).numpy().tolist() for pixel in range(4)] == [
        [False],
        [True],
        [True],
        [False],
    ]
    for first in (0, 2):
        one, other, fullest = found.pair(first)
        assert [float(one.numpy()[0]), float(other.numpy()[0])] == expected[first : first + 2].tolist()
        most = max(LIT[first : first + 2].max(), UNLIT[first : first + 2].max())
        assert float(fullest.numpy()[0]) == (most - BIAS) * GAIN - DARK


def test_what_was_subtracted_scatters() -> None:
    """Claim: a charge c above a subtracted a has the floor, c + (1 + k) a, and (prnu c)² as its variance."""
    found = line()
    for pixel, charge in ((0, 400.0), (1, 1140.0), (3, 20.0)):
        ambient = (UNLIT[pixel] - BIAS) * GAIN * OFF - DARK
        expected = 400.0 + charge + 5.0 * ambient + (0.1 * charge) ** 2
        told = float(found.variance(pixel, auto.Float(charge)).numpy()[0])
        assert told == pytest.approx(expected, rel=1e-5)
        beneath, full = found.beneath(pixel, auto.Float(1e6), auto.Float(charge), True)
        assert float(beneath.numpy()[0]) == pytest.approx(expected, rel=1e-5)
        assert full.numpy().tolist() == [pixel == 1]


def test_a_line_of_one_exposure_is_full_where_its_whole_charge_is() -> None:
    """Claim: c = (n − b) g less the dark charge; a pixel is full from the number on that holds dark and light together,
    however it is asked; without light its variance is the floor's, what stands beside it and (prnu c)²."""
    numbers = np.array([760.0, 759.0, 730.0, 40.0])
    signal = Signal(auto.Float(), 1, 4, 0.0)
    places = signal.address(auto.UInt32([0, 1, 2, 3]), auto.UInt32(0)).numpy()
    table = np.zeros(int(places.max()) + 3, np.float32)
    table[places] = numbers
    found = Line(Signal(auto.Float(table), 1, 4, 0.0), KNOWN)
    charges = (numbers - BIAS) * GAIN - DARK
    for pixel, charge in enumerate(charges):
        assert float(found.charge(pixel).numpy()[0]) == charge
        assert found.full(pixel).numpy().tolist() == [pixel == 0]
        beneath, full = found.beneath(pixel, auto.Float(charge), auto.Float(50.0), True)
        assert full.numpy().tolist() == [pixel == 0]
        expected = 400.0 + 50.0 + (0.1 * 50.0) ** 2
        assert float(beneath.numpy()[0]) == pytest.approx(expected, rel=1e-5)
        assert float(found.variance(pixel, auto.Float(50.0)).numpy()[0]) == pytest.approx(expected, rel=1e-5)
    for first in (0, 2):
        one, other, fullest = (float(part.numpy()[0]) for part in found.pair(first))
        assert [one, other] == charges[first : first + 2].tolist()
        assert fullest == max(one, other)


def test_charges_about_a_peak_are_those_above_a_straight_line() -> None:
    """Claim: at a step k from pixel i stands the charge of pixel i + k less level + k slope, beyond the ends that of
    the last pixel, with the variance of the whole charge; a pixel is inside from 0 to the last."""
    found, zero = line(), auto.Float(0.0)
    beneath = Baseline(auto.Float(37.0), auto.Float(-11.0), zero, zero, zero, auto.Float(5.0))
    around = Around(found, auto.Int32(1), beneath)
    assert float(around.floor_sigma.numpy()[0]) == 20.0
    for step, pixel in ((-2, 0), (-1, 0), (0, 1), (1, 2), (2, 3), (3, 3)):
        raw = found.charge(pixel)
        charge, variance = around(auto.Int32(step))
        assert float(charge.numpy()[0]) == float(raw.numpy()[0]) - 37.0 + 11.0 * step
        assert variance.numpy().tolist() == found.variance(pixel, raw).numpy().tolist()
        assert around.full(auto.Int32(step)).numpy().tolist() == found.full(pixel).numpy().tolist()
        assert around.inside(auto.Int32(step)).numpy().tolist() == [-1 <= step <= 2]
