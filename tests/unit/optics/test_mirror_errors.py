"""Errors of the mirrors shot by shot: whose wobble goes where, what encoders see, travel and drift."""

from __future__ import annotations

from typing import Any

import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Mirrors, TemperatureCourse

from scanner_sim.render.shots import Lattice, true_shots, wobble
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


@pytest.mark.parametrize("mirror", [0, 1])
def test_a_wobble_goes_smoothly_between_independent_numbers(mirror: int) -> None:
    """Claim: within a cell of angle and time the wobble is Σ of four numbers, those at its corners, each by cos s or
    sin s of both ways, s = ½π p²(3 − 2p); the next cell begins where this one ends; the numbers scatter by what is
    told, independent. Bounds: level 1e-4 together, 4.3 standard errors of 3600 numbers."""
    mirrors = QUIET.model_copy(update={"wobble": 30e-6})

    def at(angle: Any, angle_part: Any, moment: Any, moment_part: Any) -> Any:
        ways = (np.asarray(each, dtype=np.float64) for each in (angle, angle_part, moment, moment_part))
        a, b, c, d = (each.ravel() for each in np.broadcast_arrays(*ways))
        cells = (auto.UInt32(each.astype(np.uint32)) for each in (a, c))
        parts = (auto.Float(each.astype(np.float32)) for each in (b, d))
        one, other = cells
        first, second = parts
        return wobble(Lattice(one, first, other, second), mirrors, 7, mirror).numpy().astype(np.float64)

    across, later = np.array([0.0, 0.21, 0.5, 0.83, 1.0]), np.array([0.0, 0.35, 0.64, 1.0])
    found = at(5, across[:, None], 9, later).reshape(5, 4)
    corners = at([[5, 5], [6, 6]], 0.0, [[9, 10], [9, 10]], 0.0).reshape(2, 2)
    weights = [
        np.stack([np.cos(s), np.sin(s)], axis=1)
        for s in (0.5 * np.pi * part**2 * (3.0 - 2.0 * part) for part in (across, later))
    ]
    np.testing.assert_allclose(found, weights[0] @ corners @ weights[1].T, atol=1e-6 * 30e-6 + 2e-11)
    cell = np.arange(60)
    numbers = at(cell[:, None], 0.0, cell, 0.0).reshape(60, 60) / 30e-6
    assert numbers.std() == pytest.approx(1.0, abs=4.3 / np.sqrt(2.0 * 3600))
    for one, other in ((numbers[1:], numbers[:-1]), (numbers[:, 1:], numbers[:, :-1]), (numbers, numbers.T)):
        pairs = one.size / (2 if one.size == 3600 else 1)
        away = (one * other)[~np.eye(60, dtype=bool)] if one.size == 3600 else one * other
        assert abs(away.mean()) < 4.3 / np.sqrt(pairs)
