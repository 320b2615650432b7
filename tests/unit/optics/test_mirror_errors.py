"""Errors of the mirrors shot by shot: whose wobble goes where, what encoders see, travel and drift."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Mirrors, TemperatureCourse

from scanner_sim.render.shots import true_shots
from scanner_sim.scan.protocol import Aim

pytestmark = pytest.mark.usefixtures("device")

COUNT = 4000
QUIET = Mirrors(jitter=0.0, wobble=0.0, synchronisation=0.0)


def aim(theta: NDArray[np.float64] | float, phi: NDArray[np.float64] | float, time: float = 1.0) -> Aim:
    """Return shots at some deflections, all at one time, whose travels are 1 and −2 mrad."""
    zero = np.zeros(COUNT)
    return Aim(
        np.arange(COUNT, dtype=np.uint32), zero + theta, zero + phi, zero + time, zero + 1e-3, zero - 2e-3
    )


@pytest.mark.parametrize("mirror", [0, 1])
def test_a_mirror_wobbles_across_its_own_motion(mirror: int) -> None:
    """Claim: the first mirror's wobble is a function of Θ along φ, the second's of φ along Θ, where Θ is near φ too."""
    mirrors = QUIET.model_copy(update={"wobble": 30e-6})
    swept = 0.1 + np.linspace(-0.05, 0.05, COUNT)
    given = aim(swept, 0.1) if mirror == 0 else aim(0.1, swept)
    _, found = true_shots(given, mirrors, 3)
    along, across = (found.phi, found.theta) if mirror == 0 else (found.theta, found.phi)
    assert np.ptp(along) > 10e-6
    assert np.ptp(across) == 0.0
    assert across[0] != 0.0
    assert np.abs(np.diff(along)).max() < 1e-6


def test_encoders_see_their_share_of_the_jitter() -> None:
    """Claim: of the jitter's variance the encoders read ``jitter_seen``, and nothing of the rest.

    Tolerance: four standard errors of the variance of 4000 numbers, 2.2 % each.
    """
    mirrors = QUIET.model_copy(update={"jitter": 40e-6, "jitter_seen": 0.3})
    _, found = true_shots(aim(0.0, 0.2), mirrors, 4)
    for whole, seen in ((found.theta, found.seen_theta), (found.phi, found.seen_phi)):
        assert whole.var() == pytest.approx(40e-6**2, rel=0.09)
        assert seen.var() == pytest.approx(0.3 * 40e-6**2, rel=0.09)
        assert (whole - seen).var() == pytest.approx(0.7 * 40e-6**2, rel=0.09)
        assert abs(np.corrcoef(whole - seen, seen)[0, 1]) < 4.0 / np.sqrt(COUNT)
    assert abs(np.corrcoef(found.theta, found.phi)[0, 1]) < 4.0 / np.sqrt(COUNT)
    assert abs(np.corrcoef(found.seen_theta, found.seen_phi)[0, 1]) < 4.0 / np.sqrt(COUNT)


def test_shots_travel_while_the_laser_shines_and_drift_with_the_temperature() -> None:
    """Claim: travels are those of the share with light; drift is ΔT (zero + scale · angle)."""
    course = TemperatureCourse(rate=0.5)
    mirrors = QUIET.model_copy(update={"temperature": course, "drift_zero": 15e-6, "drift_scale": 40e-6})
    shots, found = true_shots(aim(0.1, -0.2, time=2.0), mirrors, 5, duty_cycle=0.25)
    np.testing.assert_allclose(shots.travel_theta.numpy(), 0.25e-3, rtol=1e-6)
    np.testing.assert_allclose(shots.travel_phi.numpy(), -0.5e-3, rtol=1e-6)
    np.testing.assert_allclose(found.theta, 1.0 * (15e-6 + 40e-6 * 0.1), rtol=1e-12)
    np.testing.assert_allclose(found.phi, 1.0 * (15e-6 - 40e-6 * 0.2), rtol=1e-12)
    np.testing.assert_allclose(shots.theta.numpy(), 0.1 + found.theta, rtol=1e-6)
    np.testing.assert_array_equal(found.seen_theta, 0.0)
