"""Beamlets have the moments of the beam that they stand for."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy import stats

from scanner_sim.render.beam.beamlets import (
    Beamlets,
    aperture_lattice,
    aperture_spiral,
    edge_beamlets,
    edge_width,
    probe_beamlets,
)

TURNS = np.arange(0.0, 2.0 * np.pi, 0.1)


def moment(beamlets: Beamlets, first: int, second: int) -> float:
    """Return E[aᵐ bⁿ] of the sum of beamlets of one width: nodes plus an independent normal spread."""
    total = 0.0
    for i in range(first + 1):
        for j in range(second + 1):
            spread = normal_moment(first - i) * normal_moment(second - j)
            spread *= (
                beamlets.variances[0] ** (0.5 * (first - i + second - j))
                * math.comb(first, i)
                * math.comb(second, j)
            )
            a, b = beamlets.nodes.T
            total += spread * float((beamlets.weights * a**i * b**j).sum())
    return total


def normal_moment(order: int) -> float:
    """Return E[xⁿ] of a standard normal number."""
    return 0.0 if order % 2 else float(math.prod(range(order - 1, 0, -2)))


@pytest.mark.parametrize("both_ends", [False, True])
def test_the_probe_has_all_moments_of_places_and_times_to_the_third_order(both_ends: bool) -> None:
    """The chief beamlet is the whole beam at its middle; the others have no width."""
    probe = probe_beamlets(both_ends=both_ends)
    assert (probe.weights > 0.0).all()
    assert probe.nodes[0].tolist() == [0.0, 0.0]
    assert probe.variances.tolist() == [1.0, *[0.0] * (12 if both_ends else 6)]
    assert np.abs(probe.times).max() <= 0.5
    (a, b), times = probe.nodes.T, probe.times
    for m, n, o in itertools.product(range(4), repeat=3):
        if m + n + o <= 3:
            moment_in_time = {0: 1.0, 2: 1.0 / 12.0}.get(o, 0.0)
            expected = normal_moment(m) * normal_moment(n) * moment_in_time
            assert probe.weights @ (a**m * b**n * times**o) == pytest.approx(expected, abs=1e-12), (m, n, o)


def test_probes_at_both_ends_of_the_way_lie_around_it_wherever_it_goes() -> None:
    """Claim: for a way of any direction and length an edge that no probe crosses leaves 1.9 % of the light beyond it at
    most, Φ(−2.4 cos 30°): by a plain mean of the normal distribution along the way. Six probes would leave 4.3 %."""
    probe, worst = probe_beamlets(both_ends=True), 0.0
    moments = (np.arange(64) + 0.5) / 64.0 - 0.5
    for length, way, normal in itertools.product((0.0, 1.0, 2.0, 4.0), np.arange(0.0, np.pi, 0.1), TURNS):
        along = length * math.cos(way - normal)
        places = probe.nodes @ [math.cos(normal), math.sin(normal)] + probe.times * along
        worst = max(worst, float(stats.norm.cdf(along * moments - places.max()).mean()))
    assert worst < stats.norm.cdf(-2.4 * math.cos(math.pi / 6.0))


@pytest.mark.parametrize("count", [19, 64, 256])
def test_edge_beamlets_have_exact_mean_and_covariance(count: int) -> None:
    beamlets = edge_beamlets(count)
    assert beamlets.weights.tolist() == [1.0 / count] * count
    for (m, n), expected in {(1, 0): 0, (0, 1): 0, (2, 0): 1, (1, 1): 0, (0, 2): 1}.items():
        assert moment(beamlets, m, n) == pytest.approx(expected, abs=1e-12), (m, n)


def test_edge_beamlets_follow_a_straight_edge_within_two_per_cent() -> None:
    """Claim: the light on one side of any straight edge is right to 2 % of the beam, and unbiased.

    Set-up: edges at 90 directions and 81 distances. Expected: the normal distribution. Tolerance: 0.02 for the
    worst, 1e-3 for the mean; at edges 2 % of the contrast.
    """
    beamlets = edge_beamlets(256)
    distance = np.linspace(-2.0, 2.0, 81)
    error = []
    for angle in np.linspace(0.0, np.pi, 90):
        along = beamlets.nodes @ [np.cos(angle), np.sin(angle)]
        share = (beamlets.weights[:, None] * (along[:, None] < distance)).sum(axis=0)
        error.append(share - stats.norm.cdf(distance))
    assert np.abs(error).max() < 0.02
    assert abs(np.mean(error)) < 1e-3


@pytest.mark.parametrize("count", [7, 64, 256])
def test_aperture_points_fill_the_disc_evenly(count: int) -> None:
    for points in (
        (probe_beamlets() if count == 7 else edge_beamlets(count)).aperture,
        aperture_lattice(count),
    ):
        assert points.shape == (count, 2)
        assert (np.hypot(*points.T) <= (1.02 if count > 7 else 1.2)).all()
        assert np.abs(points.mean(axis=0)).max() < 1.5 / count


@pytest.mark.parametrize("count", [19, 64, 256, 1024])
def test_times_of_many_beamlets_fill_the_dwell(count: int) -> None:
    beamlets = edge_beamlets(count)
    (a, b), times, weights = beamlets.nodes.T, beamlets.times, beamlets.weights
    assert weights @ times**2 == pytest.approx(1.0 / 12.0, rel=1e-12)
    for none in (times, times * a, times * b):
        assert weights @ none == pytest.approx(0.0, abs=1e-12)
    assert stats.kstest(times, stats.uniform(-0.5, 1.0).cdf).statistic < 1.5 / np.sqrt(count) / 2.0


@pytest.mark.parametrize("sweep", [1.0, 3.0, 10.0, 30.0])
def test_the_outermost_beamlets_reach_the_ends_of_the_sweep(sweep: float) -> None:
    """Light beyond the outermost of the probe, which no edge can be seen in, stays below 1 % along Θ."""
    beamlets = probe_beamlets()
    reach = float((beamlets.nodes[:, 0] + sweep * beamlets.times).max())
    moments = (np.arange(10_000) + 0.5) / 10_000 - 0.5
    assert float(stats.norm.sf(reach - sweep * moments).mean()) < 0.01


def test_a_lone_beamlet_shines_in_the_middle() -> None:
    assert edge_beamlets(3).times.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(("count", "wanted"), [(256, 0.125), (64, 0.25), (9, 0.5)])
def test_beamlets_at_an_edge_are_as_wide_as_they_lie_apart(count: int, wanted: float) -> None:
    """Claim: the width of one of n is 2/√n of the beam's, so that they overlap evenly, and at most half of it."""
    assert edge_width(count) == wanted
    assert edge_beamlets(count).variances == pytest.approx(wanted**2)


def test_nobody_changes_beamlets_for_the_next_run() -> None:
    beamlets = edge_beamlets(64)
    assert edge_beamlets(64) is beamlets
    with pytest.raises(ValueError, match="read-only"):
        beamlets.nodes[0] = 0.0


@pytest.mark.parametrize("both_ends", [False, True])
def test_where_probes_are_seen_from_shares_nothing_with_them(both_ends: bool) -> None:
    """Claim: the chief beamlet is seen from the middle of the aperture, the others from 0.7 of its radius on all sides;
    points of it have the mean 0 and no covariance with places and moments, so that a lobe moves no spot by them. Nor
    have those along the base with squares of places there, nor, with both ends, any with products of places."""
    beamlets = probe_beamlets(both_ends=both_ends)
    points, weights = beamlets.aperture, beamlets.weights
    assert points[0].tolist() == [0.0, 0.0]
    np.testing.assert_allclose(np.hypot(*points[1:].T), 0.7, atol=1e-12)
    squared = beamlets.nodes[:, 0] ** 2
    for others in (np.ones(len(weights)), *beamlets.nodes.T, beamlets.times):
        np.testing.assert_allclose((weights * others) @ points, 0.0, atol=1e-12)
    assert (weights * squared) @ points[:, 0] == pytest.approx(0.0, abs=1e-12)
    if both_ends:
        products = np.einsum("n,ni,nj,nk->ijk", weights, beamlets.nodes, beamlets.nodes, points)
        np.testing.assert_allclose(products, 0.0, atol=1e-12)
    covariance = np.cov(points[1:].T, bias=True)
    np.testing.assert_allclose(covariance, 0.5 * 0.7**2 * np.eye(2), atol=1e-12)


@pytest.mark.parametrize("count", [19, 64, 256])
def test_points_of_the_aperture_have_the_moments_of_the_disc(count: int) -> None:
    """Claim: mean 0 and covariance ¼ of both axes, exactly; radii as even as a disc's, so that no ring is left out: the
    squared ones are off an even spacing by less than what the shear to that covariance and one point move."""
    for points in (edge_beamlets(count).aperture, aperture_lattice(count), aperture_spiral(count)):
        np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-12)
        np.testing.assert_allclose(points.T @ points / count, 0.25 * np.eye(2), atol=1e-12)
        squared = np.sort((points**2).sum(axis=1))
        assert stats.kstest(squared, stats.uniform(0.0, 1.0).cdf).statistic < 2.5 / math.sqrt(count)
        turn = np.arctan2(points[:, 1], points[:, 0]) / (2.0 * np.pi) % 1.0
        assert stats.kstest(turn, stats.uniform(0.0, 1.0).cdf).statistic < 1.5 / math.sqrt(count)


def test_neighbours_in_the_beam_look_through_points_all_over_the_aperture() -> None:
    """Claim: products of places across the beam and in the aperture have a mean of 0, as of two that are independent:
    of 256 pairs within 4.5 of the standard error 1/√256 times both scatters."""
    beamlets = edge_beamlets(256)
    share = beamlets.nodes.T @ beamlets.aperture / 256 / (beamlets.nodes.std() * 0.5)
    assert np.abs(share).max() < 4.5 / 16.0


def test_points_of_the_aperture_turn_by_golden_sections() -> None:
    """Claim: from ring to ring Vogel's spiral turns by the golden section of a turn, 222.49°, and the lattice from
    point to point by 360°/ϱ² of the plastic number ϱ³ = ϱ + 1: 205.14°; the median is not moved by the shear."""
    plastic = float(np.real(np.roots([1.0, 0.0, -1.0, -1.0])[0]))
    spiral, lattice = aperture_spiral(512), aperture_lattice(512)
    ordered = spiral[np.argsort(np.hypot(*spiral.T))]
    for points, wanted in ((ordered, 180.0 * (math.sqrt(5.0) - 1.0)), (lattice, 360.0 / plastic**2)):
        turns = np.degrees(np.diff(np.arctan2(points[:, 1], points[:, 0]))) % 360.0
        assert float(np.median(turns)) == pytest.approx(wanted, abs=0.2)
