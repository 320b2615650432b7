"""Eq 5: errors of (x, y, z) from the errors of p, Θ and φ."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scanner_sim.analytic import geometry
from scanner_sim.ranging import coordinates, ranges, triangulation

F, D, SEPARATION = 0.1, 0.2, 0.05
ANGLES = st.floats(-0.5, 0.5)
RANGES = st.floats(1.6, 50.0)


def _measured(p: np.ndarray, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Return (x, y, z, R) through the simulator's own ranging, shape (..., 4)."""
    R = triangulation.range_from_position(p, theta, F, D)
    return np.stack([*coordinates.coordinates(R, theta, phi, SEPARATION), R], axis=-1)


@given(R=RANGES, theta=ANGLES, phi=ANGLES)
def test_full_jacobian(R: float, theta: float, phi: float) -> None:
    """Claim: the judge's Jacobian is the derivative of the simulator's ranging chain (eqs 1 and 3).

    Set-up: central differences, steps 1e-5 of p and 1e-5 rad. Expected: all twelve entries. Tolerance: 1e-7
    of the largest entry of the column; truncation and rounding of the differences are below 1e-9 of it.
    """
    p = float(geometry.image_position(R, theta, F, D))
    steps = np.diag([1e-5 * p, 1e-5, 1e-5])
    shot = np.array([p, theta, phi])
    numerical = np.stack(
        [(_measured(*(shot + step)) - _measured(*(shot - step))) / (2.0 * step.sum()) for step in steps],
        axis=-1,
    )
    exact = geometry.shot_jacobian(R, theta, phi, F, D, SEPARATION)
    assert (np.abs(numerical - exact) < 1e-7 * np.abs(exact).max(axis=0)).all()


@pytest.mark.parametrize("phi", [0.0, -0.4])
@pytest.mark.parametrize("theta", [0.0, 0.45, -0.45])
def test_monte_carlo_follows_the_full_jacobian(theta: float, phi: float) -> None:
    """Claim: independent errors of p, Θ, φ scatter (x, y, z, R) as the full Jacobian says.

    Set-up: R 8 m; Δp 0.5 µm, ΔΘ = Δφ = 75 µrad (the paper's 50–100 µrad); 40 000 shots. Expected: the judge's
    four standard deviations. Tolerance: 4.6 standard errors of each, 1.6 %: of the 24 values of this test,
    one exceeds it once in 10⁴ seeds (24 × 4.2e-6). A law wrong by 3.5 % in any value is found with a
    probability above 0.9999.
    """
    n, R, dp, angle = 40_000, 8.0, 0.5e-6, 75e-6
    rng = np.random.default_rng(5)
    p = geometry.image_position(R, theta, F, D) + rng.normal(0.0, dp, n)
    got = _measured(p, theta + rng.normal(0.0, angle, n), phi + rng.normal(0.0, angle, n)).std(axis=0)
    expected = geometry.propagated_errors(R, theta, phi, F, D, SEPARATION, dp, angle, angle)
    np.testing.assert_allclose(got, expected, rtol=4.6 / np.sqrt(2 * n))


def test_printed_form_holds_for_ranges_measured_apart_from_the_angle() -> None:
    """Claim: the printed eq 5 is right when R does not depend on Θ, as in time of flight, and D_g = 0.

    Set-up: R 8 m, Θ 0.3, φ −0.2 rad; ranges scattered by R² Δp/(f d) = 1.6 mm (Δp 0.5 µm), angles by
    75 µrad; 40 000 shots through ``coordinates``. Expected: the printed standard deviations. Tolerance:
    4.2 standard errors, 1.5 % (three values, once in 10⁴ seeds).
    """
    n, R, theta, phi, dp, angle = 40_000, 8.0, 0.3, -0.2, 0.5e-6, 75e-6
    rng = np.random.default_rng(6)
    ranges = R + rng.normal(0.0, R**2 * dp / (F * D), n)
    thetas, phis = theta + rng.normal(0.0, angle, n), phi + rng.normal(0.0, angle, n)
    points = coordinates.coordinates(ranges, thetas, phis, 0.0)
    expected = geometry.propagated_errors_printed(R, theta, phi, F, D, dp, angle, angle)
    np.testing.assert_allclose(np.std(points, axis=1), expected, rtol=4.2 / np.sqrt(2 * n))


def test_where_the_printed_form_fails() -> None:
    """Claim: in triangulation the printed eq 5 misses that R follows Θ at fixed p.

    Set-up: R 10 m, Θ 0.5 rad, φ 0, only the angle in error (100 µrad). At fixed p the simulator's point moves
    along u by ∂R/∂Θ = −(R − d sinΘ) tanΘ + d cosΘ = −9.90411 × 0.54630 + 0.17552 = −5.2351 m and along n
    by R; x by hand: −5.2351 × sin 0.5 + 10 × cos 0.5 = 6.2660 m per radian, where eq 5 has R cosΘ = 8.7758.
    Tolerance: half of the last digit.
    """
    exact = geometry.propagated_errors(10.0, 0.5, 0.0, F, D, SEPARATION, 0.0, 1e-4, 0.0)
    printed = geometry.propagated_errors_printed(10.0, 0.5, 0.0, F, D, 0.0, 1e-4, 0.0)
    assert exact[0] / 1e-4 == pytest.approx(6.2660, abs=5e-5)
    assert printed[0] / 1e-4 == pytest.approx(8.7758, abs=5e-5)
    assert exact[3] / 1e-4 == pytest.approx(5.2351, abs=5e-5)


def _stated(R: np.ndarray, theta: np.ndarray, phi: np.ndarray, **changes: float) -> ranges.Ranges:
    """Return what the instrument states, for Δp 0.5 µm, ΔΘ 8 µrad, Δφ 5 µrad and an angle between its two halves."""
    numbers = {"synchronisation": 0.0, **changes}
    pitch = 50e-6
    bench = ranges.Geometry(F, D, SEPARATION, pitch, 0.0, numbers["synchronisation"])
    angles = ranges.Deflections(theta, phi, np.full(R.shape, 8e-6), np.full(R.shape, 5e-6))
    peak = geometry.image_position(R, theta, F, D) / pitch - 0.5
    return ranges.ranges_from_peaks(
        peak, np.full(R.shape, 0.01), np.zeros(R.shape, np.uint32), angles, bench, None
    )


def test_stated_covariance_is_the_jacobians() -> None:
    """Claim: σ of the range and the whole covariance of the point are those of the full Jacobian.

    Set-up: 60 shots over the field, D_g 50 mm, Δp 0.5 µm, ΔΘ 8 µrad, Δφ 5 µrad. Expected: the judge's
    J diag(σ²) Jᵀ, formed with matrices, and its fourth diagonal entry. Tolerance: 1e-11 of the largest entry, rounding.
    """
    random = np.random.default_rng(8)
    R, (theta, phi) = np.geomspace(1.6, 40.0, 60), random.uniform(-0.5, 0.5, (2, 60))
    stated = _stated(R, theta, phi)
    expected = geometry.propagated_covariance(R, theta, phi, F, D, SEPARATION, 0.5e-6, 8e-6, 5e-6)
    found = stated.covariance
    rows = ((found.xx, found.xy, found.xz), (found.xy, found.yy, found.yz), (found.xz, found.yz, found.zz))
    largest = np.abs(expected).max(axis=(1, 2))
    for i in range(3):
        for j in range(3):
            assert (np.abs(rows[i][j] - expected[:, i, j]) < 1e-11 * largest).all()
    np.testing.assert_allclose(stated.sigma**2, expected[:, 3, 3], rtol=1e-11)


def test_synchronisation_moves_the_range() -> None:
    """Claim: an angle of 10 µrad between projection and reception is 5 mm at 10 m, R² e/d, in the stated σ.

    Set-up: R 10 m on the axis, a peak known to 0.5 µm: with and without. Expected: by hand 10²·1e-5/0.2 = 5 mm, p²/f²
    adding 4e-4. Tolerance: 5e-4.
    """
    one = np.array([10.0]), np.zeros(1), np.zeros(1)
    with_it, without = _stated(*one, synchronisation=1e-5).sigma, _stated(*one).sigma
    assert float(np.sqrt(with_it**2 - without**2)[0]) == pytest.approx(5e-3, rel=5e-4)
