"""Numbers of laser, lens, pulse and servo by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from prototype import Galvanometers, Laser, Pulse, Receiver
from pydantic import ValidationError

from scanner_sim.optics.galvanometer import MirrorState, follow
from scanner_sim.optics.jump import attainable_amplitude

SERVO = Galvanometers()


def test_a_lens_collects_by_its_area_and_is_no_wider_than_its_focal_length() -> None:
    assert Receiver(aperture=0.03).aperture_area == pytest.approx(math.pi * 0.015**2)
    focal = Receiver().focal_length
    Receiver(aperture=focal)
    with pytest.raises(ValidationError, match="aperture"):
        Receiver(aperture=1.01 * focal)


def test_a_laser_emits_where_it_has_drifted_to() -> None:
    laser = Laser(wavelength=1.5e-6, drift=20e-9, waist_radius=1e-3, waist_distance=2.0, m_squared=1.5)
    assert laser.line == pytest.approx(1.52e-6)
    length = math.pi * 1e-6 / (1.5 * 1.5e-6)
    assert laser.rayleigh_length == pytest.approx(length)
    assert laser.divergence == pytest.approx(1e-3 / length)
    for distance in (0.0, 2.0, 5.0):
        assert laser.radius(distance) == pytest.approx(1e-3 * math.hypot(1.0, (distance - 2.0) / length))
        slope = (laser.radius(distance + 1e-4) - laser.radius(distance - 1e-4)) / 2e-4
        assert laser.widening(distance) == pytest.approx(slope, rel=1e-6, abs=1e-12)


def test_a_pulse_has_its_mean_power() -> None:
    pulse = Pulse(energy=0.2e-6, repetition_rate=20e3)
    assert pulse.mean_power == pytest.approx(4e-3)
    assert pulse.ambiguity_range == pytest.approx(299_792_458.0 / 40e3)


@pytest.mark.parametrize("share", [0.001, 0.05, 0.5, 0.9])
def test_slow_sines_are_bound_by_speed_and_fast_ones_by_acceleration(share: float) -> None:
    """Claim: min(v/Ω, a/Ω²)/|H| with |H| of the second order, from far below to near the natural frequency."""
    ratio = share
    rate = share * SERVO.omega
    gain = 1.0 / math.hypot(1.0 - ratio**2, 2.0 * SERVO.damping * ratio)
    wanted = min(SERVO.slew / rate, SERVO.acceleration / rate**2) / gain
    found = float(attainable_amplitude(SERVO, rate / (2.0 * math.pi)))
    assert found == pytest.approx(wanted, rel=1e-9)


def test_a_mirror_at_its_limit_moves_by_its_mean_speed() -> None:
    """Claim: under the largest acceleration a mirror at rest is at a t²/2 after each update, at most at full speed."""
    step = 12.5e-6
    motion, _ = follow(SERVO, MirrorState(np.zeros(1), np.zeros(1), np.zeros(1)), np.full((1, 40), 1.0), step)
    time = step * np.arange(1, 41)
    slow = time < 0.9 * SERVO.slew / SERVO.acceleration
    assert slow.sum() > 2
    assert motion.limited[0, slow].all()
    np.testing.assert_allclose(motion.rate[0, slow], SERVO.acceleration * time[slow], rtol=1e-9)
    np.testing.assert_allclose(motion.true[0, slow], 0.5 * SERVO.acceleration * time[slow] ** 2, rtol=1e-9)
