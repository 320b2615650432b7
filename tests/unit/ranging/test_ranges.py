"""From peaks and delays to ranges, points and layers: σ by the judge's slopes, gates at both ends, names of layers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scanner_sim.analytic import geometry as judge
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.status import Status
from scanner_sim.ranging.covariance import shaken_covariance
from scanner_sim.ranging.neighbours import is_isolated
from scanner_sim.ranging.ranges import (
    Deflections,
    Geometry,
    Ranges,
    layers_of,
    ranges_from_peaks,
    with_status,
)
from scanner_sim.ranging.time_of_flight import ranges_from_delays

Array = NDArray[np.float64]

F, BASE, D, PITCH, OFFSET, SYNCHRONISATION = 0.1, 0.2, 0.05, 50e-6, 1e-3, 3e-6
SIGMA_THETA, SIGMA_PHI, SIGMA_PEAK = 4e-5, 9e-5, 0.03
THETA, PHI = np.array([-0.3, -0.1, 0.0, 0.2, 0.4]), np.array([0.1, -0.4, 0.2, 0.3, -0.2])
PEAK = np.array([150.3, 60.2, 33.0, 90.7, 40.4])


def measured(gate: tuple[float, float] | None = None) -> Ranges:
    """Return the ranges of five shots."""
    deflections = Deflections(THETA, PHI, np.full(5, SIGMA_THETA), np.full(5, SIGMA_PHI))
    bench = Geometry(F, BASE, D, PITCH, OFFSET, SYNCHRONISATION)
    valid = np.zeros(5, dtype=np.uint32)
    return ranges_from_peaks(PEAK, np.full(5, SIGMA_PEAK), valid, deflections, bench, gate)


def wanted() -> tuple[Array, Array]:
    """Return the judge's ranges and covariances of (x, y, z, R), p being the middle of the peak's pixel."""
    p = OFFSET + (PEAK + 0.5) * PITCH
    r = judge.triangulated_range(p, THETA, F, BASE)
    # The angle between projection and reception moves the image by f (1 + p²/f²) of it.
    sigma_p = np.hypot(SIGMA_PEAK * PITCH, F * (1.0 + (p / F) ** 2) * SYNCHRONISATION)
    return r, judge.propagated_covariance(r, THETA, PHI, F, BASE, D, sigma_p, SIGMA_THETA, SIGMA_PHI)


def test_ranges_and_points_have_the_judges_covariance() -> None:
    """Claim: R, its σ, the point and all six entries of its covariance are the judge's, with three unequal σ."""
    r, covariance = wanted()
    layers = layers_of(measured(), "tof.")
    np.testing.assert_allclose(layers["tof.range_m"], r, rtol=1e-12)
    np.testing.assert_allclose(layers["tof.sigma_range_m"], np.sqrt(covariance[:, 3, 3]), rtol=1e-10)
    points = judge.point_from_shot(r, THETA, PHI, D)
    for axis, name in enumerate("xyz"):
        np.testing.assert_allclose(layers[f"tof.P.{name.upper()}"], points[:, axis], rtol=1e-12)
        sigma = np.sqrt(covariance[:, axis, axis])
        np.testing.assert_allclose(layers[f"tof.sigma_{name}_m"], sigma, rtol=1e-10)
    for i, j, name in ((0, 1, "xy"), (0, 2, "xz"), (1, 2, "yz")):
        np.testing.assert_allclose(layers[f"tof.cov_{name}_m2"], covariance[:, i, j], rtol=1e-9, atol=1e-18)


def test_a_scanner_that_moves_as_a_whole_moves_points_by_a_turn_and_a_shift() -> None:
    """Claim: the covariance of points is Σ of each axis's turn and shift, one after the other by a rotation."""
    point, turn, shift, step = np.array([[0.4, -0.7, 3.0], [-1.0, 0.2, 5.0]]), 2e-4, 3e-4, 1e-6
    found = shaken_covariance(*point.T, turn, shift)
    for number, place in enumerate(point):
        wanted = shift**2 * np.eye(3)
        for axis in np.eye(3):
            moved = (Rotation.from_rotvec(-step * axis).apply(place) - place) / step
            wanted += turn**2 * np.outer(moved, moved)
        told = [getattr(found, name)[number] for name in ("xx", "yy", "zz", "xy", "xz", "yz")]
        pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
        np.testing.assert_allclose(told, [wanted[pair] for pair in pairs], rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("end", [0, 1])
def test_a_gate_holds_both_of_its_ends(end: int) -> None:
    """Claim: a range on the gate's end is accepted, one beyond it by 10⁻⁶ is not, and has no number left."""
    r, _ = wanted()
    for beyond in (0.0, 1e-6):
        gate = [0.5 * r.min(), 2.0 * r.max()]
        gate[end] = float(r[1]) * (1.0 + (beyond if end == 0 else -beyond))
        found = measured((gate[0], gate[1]))
        outside = (
            (r < gate[0]) | (r > gate[1])
            if beyond
            else (r < gate[0] * (1 - 1e-12)) | (r > gate[1] * (1 + 1e-12))
        )
        outside[1] = bool(beyond)
        if not beyond:
            # On the end itself, to the last bit.
            gate[end] = float(measured().range[1])
            found = measured((gate[0], gate[1]))
        np.testing.assert_array_equal(found.status == Status.OUT_OF_GATE, outside)
        np.testing.assert_array_equal(np.isnan(found.range), outside)
        np.testing.assert_array_equal(np.isnan(found.sigma), outside)
        np.testing.assert_array_equal(np.isnan(found.covariance.xx), outside)


@pytest.mark.parametrize("gate", [(3.0, 5.0), (3.0, 50.0), (1.0, 5.0)])
def test_a_gate_holds_echoes_too(gate: tuple[float, float]) -> None:
    """Claim: echoes nearer than the gate or beyond it are refused; τ = (R + √(R² − 2 R b sinΘ + b²))/c."""
    r, theta, base = np.array([2.0, 4.0, 6.0]), np.array([0.1, -0.2, 0.3]), 0.2
    back = np.sqrt(r**2 - 2.0 * r * base * np.sin(theta) + base**2)
    delay = (r + back) / SPEED_OF_LIGHT
    sigma, jitter = np.full(3, 20e-12), 30e-12
    found = ranges_from_delays(delay, sigma, np.zeros(3, dtype=np.uint32), theta, jitter, gate, base)
    inside = (r >= gate[0]) & (r <= gate[1])
    np.testing.assert_array_equal(found.status == Status.VALID, inside)
    np.testing.assert_allclose(found.range[inside], r[inside], rtol=1e-12)
    assert np.isnan(found.range[~inside]).all()
    # ∂(R + back)/∂R = 1 + (R − b sinΘ)/back.
    slope = SPEED_OF_LIGHT / (1.0 + (r - base * np.sin(theta)) / back)
    np.testing.assert_allclose(found.sigma[inside], (slope * math.hypot(20e-12, 30e-12))[inside], rtol=1e-9)


@pytest.mark.parametrize("way", ["peaks", "delays"])
def test_a_gate_leaves_a_refused_shot_its_own_reason(way: str) -> None:
    """Claim: nearer than the gate, within it, beyond it or without any number, what was refused before says why; of
    what was not, what lies nearer or beyond is out of the gate."""
    gate, reasons = (3.0, 5.0), [Status.SATURATED, Status.AMBIGUOUS, Status.BAD_SHAPE, Status.BELOW_THRESHOLD]
    r = np.array([2.0, 4.0, 6.0, np.nan, 2.0, 4.0, 6.0])
    status = np.array([*reasons, 0, 0, 0], dtype=np.uint32)
    none = np.zeros(7)
    if way == "peaks":
        bench = Geometry(F, BASE, D, PITCH, OFFSET, SYNCHRONISATION)
        deflections = Deflections(none, none, none, none)
        found = ranges_from_peaks(
            (F * BASE / r - OFFSET) / PITCH - 0.5, none, status, deflections, bench, gate
        )
    else:
        found = ranges_from_delays(2.0 * r / SPEED_OF_LIGHT, none, status, none, 0.0, gate)
    assert found.status.tolist() == [*reasons, Status.OUT_OF_GATE, Status.VALID, Status.OUT_OF_GATE]
    np.testing.assert_allclose(found.range, [*[np.nan] * 5, 4.0, np.nan])


def test_refused_ranges_leave_nothing() -> None:
    status = np.array([0, 3, 0, 5, 0], dtype=np.uint32)
    found = layers_of(with_status(measured(), status))
    for name, layer in found.items():
        if name != "status":
            np.testing.assert_array_equal(np.isnan(layer), status != 0)
    np.testing.assert_array_equal(found["status"], status)


@pytest.mark.parametrize(("share", "alone"), [(0.999, False), (1.001, True)])
def test_a_range_is_isolated_beyond_slope_and_noise(share: float, alone: bool) -> None:
    """Claim: neighbours agree within tan(steepest) times their distance and so many σ of the difference of both."""
    rows, columns, sigmas, steepest = 3, 3, 4.0, math.radians(60.0)
    angles = 1e-3 * np.arange(3)
    own, others = 0.004, 0.003
    sigma = np.full((rows, columns), others)
    sigma[1, 1] = own
    ranges = np.full((rows, columns), 5.0)
    # The farthest neighbours are those at the corners.
    limit = math.tan(steepest) * math.hypot(1e-3, 1e-3) * 5.0 + sigmas * math.hypot(own, others)
    ranges[1, 1] = 5.0 + share * limit
    status = np.zeros((rows, columns), dtype=np.uint32)
    found = is_isolated(ranges, sigma, status, angles, angles, sigmas, steepest)
    wanted_there = np.zeros((rows, columns), dtype=bool)
    wanted_there[1, 1] = alone
    np.testing.assert_array_equal(found, wanted_there)
