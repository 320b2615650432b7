"""Fusion of the two ranging modes, and ranges from delays."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from scanner_sim.analytic import time_of_flight as judge
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.status import Status
from scanner_sim.ranging.coordinates import coordinates
from scanner_sim.ranging.fusion import crossing_distance, fuse, fuse_points, share_of_pulses
from scanner_sim.ranging.ranges import Deflections, Geometry, ranges_from_peaks, ranges_with_points
from scanner_sim.ranging.time_of_flight import (
    delay_from_range,
    echo_range_sigma,
    range_from_delay,
    ranges_from_delays,
)
from scanner_sim.ranging.triangulation import position_from_range, range_from_position

N = 200_000


def pair(s1: float, s2: float, seed: int = 1, apart: float = 0.0) -> tuple[tuple, tuple]:
    random = np.random.default_rng(seed)
    status = np.zeros(N, np.uint32)
    r1, r2 = (10.0 + s * random.standard_normal(N) for s in (s1, s2))
    return (r1, np.full(N, s1), status), (r2 + apart, np.full(N, s2), status)


@pytest.mark.parametrize(("s1", "s2"), [(1e-3, 1e-3), (1e-3, 1e-2), (2e-2, 1e-2)])
def test_the_fused_sigma_is_right_and_never_worse_than_the_better(s1: float, s2: float) -> None:
    """Claim: the fused range scatters by 1/√(1/σ₁² + 1/σ₂²), its own σ, and never by more than the better one.

    Set-up: 200 000 voxels with independent normal errors. Expected: that. Tolerance: 1 %; the standard error of a
    scatter is 0.16 %.
    """
    fused = fuse(*pair(s1, s2))
    expected = 1.0 / np.hypot(1.0 / s1, 1.0 / s2)
    both = fused.sigma < 0.999 * min(s1, s2)
    assert both.mean() > 0.999
    assert np.std(fused.range[both]) == pytest.approx(expected, rel=0.01)
    assert fused.sigma[both] == pytest.approx(expected, rel=1e-12)
    assert fused.sigma.max() <= min(s1, s2) * 1.02
    assert fused.weight[both] == pytest.approx(s1**2 / (s1**2 + s2**2))


def test_consistent_ranges_are_refused_by_chance_only() -> None:
    """Claim: of right pairs one in 10⁴ is refused.

    Set-up: 200 000 pairs. Expected: 20. Tolerance: 4 to 45, which a Poisson number of mean 20 leaves in fewer than one
    of 10⁴ seeds.
    """
    refused = (fuse(*pair(1e-3, 5e-3)).time_of_flight == Status.INCONSISTENT).sum()
    assert 4 <= refused <= 45


@pytest.mark.parametrize("correlation", [0.9, -0.8])
def test_ranges_that_share_errors_are_refused_by_chance_only_and_weigh_as_they_must(
    correlation: float,
) -> None:
    """Claim: with the covariance known, one right pair in 10⁴ is refused, and the fused range scatters as it states, by
    no more than any other share of both would.

    Set-up: 200 000 pairs with σ of 1 and 1.5 mm. Tolerance: 4 to 45 refused of 20 expected, as above; 1 % of the
    scatter.
    """
    random = np.random.default_rng(8)
    own, other = random.standard_normal((2, N))
    s1, s2 = 1e-3, 1.5e-3
    r1 = 10.0 + s1 * own
    r2 = 10.0 + s2 * (correlation * own + np.sqrt(1.0 - correlation**2) * other)
    status, covariance = np.zeros(N, np.uint32), correlation * s1 * s2
    fused = fuse((r1, np.full(N, s1), status), (r2, np.full(N, s2), status), np.full(N, covariance))
    refused = (fused.triangulation == Status.INCONSISTENT) | (fused.time_of_flight == Status.INCONSISTENT)
    assert 4 <= refused.sum() <= 45
    kept = ~refused
    assert np.std(fused.range[kept]) == pytest.approx(fused.sigma[kept][0], rel=0.01)
    shares = np.linspace(0.0, 1.0, 1001)
    of_all = np.sqrt(
        ((1.0 - shares) * s1) ** 2 + (shares * s2) ** 2 + 2.0 * shares * (1.0 - shares) * covariance
    )
    assert fused.sigma[kept][0] == pytest.approx(of_all.min(), rel=1e-4)
    assert fused.weight[kept][0] == pytest.approx(shares[np.argmin(of_all)], abs=1e-3)


def test_what_disagrees_loses_its_less_precise_half() -> None:
    fused = fuse(*pair(1e-3, 1e-2, apart=0.2))
    assert (fused.time_of_flight == Status.INCONSISTENT).all()
    assert (fused.triangulation == Status.VALID).all()
    np.testing.assert_array_equal(fused.range, pair(1e-3, 1e-2)[0][0])
    assert (fused.sigma == 1e-3).all()


def test_one_valid_range_stands_alone_and_none_gives_the_reason() -> None:
    nan, low, out = np.nan, Status.BELOW_THRESHOLD, Status.OUT_OF_GATE
    first = (np.array([nan, 5.0, nan]), np.array([nan, 0.1, nan]), np.array([low, 0, low], np.uint32))
    second = (np.array([6.0, nan, nan]), np.array([0.2, nan, nan]), np.array([0, out, out], np.uint32))
    fused = fuse(first, second)
    np.testing.assert_array_equal(fused.range, [6.0, 5.0, nan])
    np.testing.assert_array_equal(fused.sigma, [0.2, 0.1, nan])
    np.testing.assert_array_equal(fused.weight, [1.0, 0.0, nan])
    assert fused.status.tolist() == [0, 0, low]


@pytest.mark.parametrize("place", ["coaxial", "offset"])
def test_the_fused_point_has_the_covariance_of_what_it_is_made_of(place: Any) -> None:
    """Claim: the fused point's covariance is that of independent errors of peak, echo and both readings, carried on;
    by a photodiode beside the laser the error of Θ is in both ranges.

    Set-up: 40 shots over the field at 2 to 12 m, each σ of its own size, σ_Θ three times σ_φ, and beside the laser a
    coarse reading and fine to coarse echoes; the first ten shots have no echo and the last ten no triangulation; the
    fused range is the stated share of either. Expected: J S Jᵀ with J by central differences of the point, and the
    range's σ likewise. Tolerance: 1e-5 of the largest entry, that of the differences.
    """
    random = np.random.default_rng(3)
    n = 40
    aside = 0.2 if place == "offset" else 0.0
    geometry = Geometry(0.1, 0.2, 0.05, 50e-6, 0.0, 0.0, pulse_by=place)
    wide = 0.4 if place == "coaxial" else 0.1
    theta, phi = random.uniform(-wide, wide, (2, n))
    r = random.uniform(2.0, 12.0, n)
    p, delay = position_from_range(r, theta, 0.1, 0.2), delay_from_range(r, theta, aside)
    own = [2e-6, 20e-12, 30e-6, 10e-6] if place == "coaxial" else [0.2e-6, 0.3e-12, 300e-6, 10e-6]
    sigma = np.tile(np.array(own)[:, None], n)
    sigma[1] *= random.permutation(np.geomspace(1.0, 1.0 if place == "coaxial" else 100.0, n))
    status = np.zeros(n, np.uint32)
    faint = np.where(np.arange(n) >= 10, status, np.uint32(Status.BELOW_THRESHOLD))
    dark = faint[::-1]
    deflections = Deflections(theta, phi, sigma[2], sigma[3])
    triangulated = ranges_from_peaks(
        (p - geometry.offset) / geometry.pitch - 0.5,
        sigma[0] / geometry.pitch,
        dark,
        deflections,
        geometry,
        None,
    )
    echo = ranges_from_delays(delay, sigma[1], faint, theta, 0.0, (0.1, 100.0), aside)
    ahead, behind = (range_from_delay(delay, theta + step, aside) for step in (1e-5, -1e-5))
    by_theta = (ahead - behind) / 2e-5
    whole = np.hypot(echo.sigma, by_theta * sigma[2])
    alike = ranges_with_points(echo.range, whole, echo.status, echo.sigma, by_theta, deflections, geometry)
    fused, _, _ = fuse_points(triangulated, alike, deflections, geometry)
    ahead, behind = (range_from_position(p, theta + step, 0.1, 0.2) for step in (1e-5, -1e-5))
    covariance = (ahead - behind) / 2e-5 * by_theta * sigma[2] ** 2
    share = fuse(
        (triangulated.range, triangulated.sigma, dark), (echo.range, whole, faint), covariance
    ).weight
    assert share[10:30].min() < 0.3
    assert share[10:30].max() > 0.7

    def made(given: np.ndarray) -> np.ndarray:
        both = (1.0 - share) * range_from_position(given[0], given[2], 0.1, 0.2)
        both = both + share * range_from_delay(given[1], given[2], aside)
        return np.stack([*coordinates(both, given[2], given[3], 0.05), both])

    base = np.stack([p, delay, theta, phi])
    columns = []
    for index in range(4):
        step = np.zeros_like(base)
        step[index] = 0.1 * sigma[index]
        columns.append((made(base + step) - made(base - step)) / 0.2)
    J = np.stack(columns, axis=1)
    expected = np.einsum("ikn,jkn->nij", J, J)
    names = ("xx", "yy", "zz", "xy", "xz", "yz")
    scale = expected[:, :3, :3].max()
    for name, (i, j) in zip(names, ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)), strict=True):
        np.testing.assert_allclose(
            getattr(fused.covariance, name), expected[:, i, j], atol=1e-5 * scale, err_msg=name
        )
    assert fused.sigma == pytest.approx(np.sqrt(expected[:, 3, 3]), rel=1e-5)


def test_the_crossing_distance_is_where_both_are_equal() -> None:
    """√(σ_TOF f d/Δp): 10 mm, 0.1 m, 0.2 m, 10 µm give 4.47 m, where R² Δp/(f d) is 10 mm."""
    r = float(crossing_distance(10e-3, 0.1, 0.2, 10e-6))
    assert r == pytest.approx(judge.crossing_range(10e-3, 0.1, 0.2, 10e-6), rel=1e-12)
    assert r**2 * 10e-6 / (0.1 * 0.2) == pytest.approx(10e-3)


@pytest.mark.parametrize("baseline", [0.0, 0.2])
def test_range_and_delay_are_inverse_with_the_right_slope(baseline: float) -> None:
    """Claim: τ(R) and R(τ) invert one another, and σ_R is the slope times √(σ_τ² + jitter²), floor included.

    Set-up: ranges of 0.5 to 200 m at ±0.5 rad. Expected: the same ranges; the numerical slope. Tolerance: 1e-12, and
    1e-4 for the difference quotient.
    """
    r = np.geomspace(0.5, 200.0, 50)
    theta = np.linspace(-0.5, 0.5, 50)
    delay = delay_from_range(r, theta, baseline)
    np.testing.assert_allclose(range_from_delay(delay, theta, baseline), r, rtol=1e-12)
    step = 1e-13
    slope = (
        range_from_delay(delay + step, theta, baseline) - range_from_delay(delay - step, theta, baseline)
    ) / (2 * step)
    got = echo_range_sigma(delay, theta, 3e-12, 4e-12, baseline)
    np.testing.assert_allclose(got, slope * 5e-12, rtol=1e-4)
    if baseline == 0.0:
        np.testing.assert_allclose(got, 0.5 * SPEED_OF_LIGHT * 5e-12, rtol=1e-12)


def test_ranges_outside_of_the_gate_are_refused() -> None:
    delay = 2.0 * np.array([1.0, 5.0, 20.0]) / SPEED_OF_LIGHT
    status = np.array([0, 0, Status.SATURATED], np.uint32)
    found = ranges_from_delays(delay, np.full(3, 1e-12), status, np.zeros(3), 1e-12, (2.0, 10.0))
    assert found.status.tolist() == [Status.OUT_OF_GATE, 0, Status.SATURATED]
    assert np.isnan(found.range).tolist() == [True, False, True]


def test_the_share_of_pulses_is_that_of_inverse_variances() -> None:
    """Claim: of two ranges with σ of 3 and 4 the pulses' has 9/25 of the weight, all or nothing where one is alone, one
    half where both are exact, and where there is none it has none."""
    one, other = np.array([3.0, 3.0, 3.0, 0.0, 3.0]), np.array([4.0, 4.0, 4.0, 0.0, 4.0])
    first, second = np.array([1, 1, 0, 1, 0], dtype=bool), np.array([1, 0, 1, 1, 0], dtype=bool)
    np.testing.assert_allclose(
        share_of_pulses(one, other, first, second), [9.0 / 25.0, 0.0, 1.0, 0.5, np.nan]
    )
