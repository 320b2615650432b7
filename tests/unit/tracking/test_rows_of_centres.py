"""Centres of several patterns together: each row is its own; which were found, and what of a rim counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.tracking.centroid import (
    Centroid,
    better_of,
    centroid_of,
    circle_fit,
    edge_points,
    hit_centroid,
)
from scanner_sim.tracking.disc_fit import disc_fit
from scanner_sim.tracking.response import Response
from scanner_sim.tracking.samples import PatternSamples

Array = NDArray[np.float64]


def spokes(radii: Array) -> tuple[PatternSamples, Response]:
    """Return patterns that cross the rims of black discs at even angles and radii, shape (patterns, spokes)."""
    rows, count = radii.shape
    turn = np.repeat(2.0 * np.pi * np.arange(count) / count, 2)
    inside = np.tile([1.0, -1.0, -1.0, 1.0], count // 2)
    reach = np.repeat(radii, 2, axis=1) + 2e-5 * inside
    theta, phi = 0.03 + reach * np.cos(turn), -0.02 + reach * np.sin(turn)
    one, level = np.ones((rows, 2 * count)), np.ones(rows)
    value = one * (0.6 + 0.4 * inside)
    samples = PatternSamples(
        50e-6 * np.arange(2.0 * count) * one,
        theta,
        phi,
        value,
        0.01 * one,
        8.0 * one,
        0.01 * one,
        np.zeros(one.shape, np.uint8),
    )
    yes = one > 0.0
    levels = {"threshold": 0.6 * level, "target": 0.2 * level, "ground": level, "fraction": 0.5 * level}
    return samples, Response(value, 0.01 * one, yes, value < 0.6, clear=level > 0.0, clipped=~yes, **levels)


def test_a_circle_does_not_depend_on_those_beside_it() -> None:
    """Claim: each pattern's circle is that of the pattern alone, byte for byte, whatever settles later beside it."""
    count = 16
    radii = 5e-3 * np.ones((3, count)) + 1e-5 * np.cos(np.arange(count) ** 2)
    radii[1, 3] *= 1.7
    radii[2, 5:8] *= [0.5, 1.4, 0.7]
    together = circle_fit(*spokes(radii))
    assert together.found.all()
    for row in range(3):
        alone = circle_fit(*spokes(radii[row : row + 1]))
        for name in ("centre", "covariance", "radius", "sigma_radius", "misfit"):
            np.testing.assert_array_equal(getattr(together, name)[row], getattr(alone, name)[0])


def test_an_edge_lies_between_two_voxels_that_count() -> None:
    """Claim: a crossing is where one of two neighbours hits and both count; either one that does not takes it away."""
    samples, response = spokes(5e-3 * np.ones((1, 6)))
    whole = edge_points(samples, response)[1][0]
    np.testing.assert_array_equal(whole, np.arange(11) % 2 == 0)
    for hidden in range(12):
        used = response.used & (np.arange(12) != hidden)
        left = edge_points(samples, replace(response, used=used))[1][0]
        beside = np.isin(np.arange(11), [hidden - 1, hidden])
        np.testing.assert_array_equal(left, whole & ~beside)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_centre_that_may_lie_anywhere_along_an_axis_was_not_found(axis: int) -> None:
    """Claim: beyond π along Θ or φ nothing was seen; the row is NaN then, its gains 0, and others stay."""
    covariance = np.stack([np.diag([1e-8, 2e-8])] * 3)
    covariance[1, axis, axis] = 0.99 * np.pi**2
    covariance[2, axis, axis] = 1.01 * np.pi**2
    centre, column = np.arange(6.0).reshape(3, 2), np.array([3.0, 4.0, 5.0])
    gains = np.arange(24.0).reshape(3, 2, 4) + 1.0
    yes = np.ones(3, dtype=bool)
    found = centroid_of(centre, covariance, column, 0.1 * column, 2.0 * column, yes, gains)
    np.testing.assert_array_equal(found.found, [True, True, False])
    for name, whole in (
        ("centre", centre),
        ("covariance", covariance),
        ("radius", column),
        ("sigma_radius", 0.1 * column),
        ("misfit", 2.0 * column),
    ):
        part = getattr(found, name)
        np.testing.assert_array_equal(part[:2], whole[:2])
        assert np.isnan(part[2]).all()
    assert found.gains is not None
    np.testing.assert_array_equal(found.gains, gains * found.found[:, None, None])


def test_the_better_of_two_is_the_first_where_there_is_one() -> None:
    """Claim: row by row all of the first, or all of the second, whose centre no value moves: its gains are 0."""
    first, second = (
        Centroid(
            centre=shift + np.arange(4.0).reshape(2, 2),
            covariance=shift + np.arange(8.0).reshape(2, 2, 2),
            radius=shift + np.array([2.0, 3.0]),
            sigma_radius=shift + np.array([4.0, 5.0]),
            misfit=shift + np.array([6.0, 7.0]),
            found=found,
            gains=gains,
        )
        for shift, found, gains in (
            (0.0, np.array([True, False]), np.arange(12.0).reshape(2, 2, 3)),
            (100.0, np.array([False, True]), None),
        )
    )
    best = better_of(first, second)
    for name in ("centre", "covariance", "radius", "sigma_radius", "misfit"):
        np.testing.assert_array_equal(getattr(best, name)[0], getattr(first, name)[0])
        np.testing.assert_array_equal(getattr(best, name)[1], getattr(second, name)[1])
    assert best.found.all()
    assert first.gains is not None
    assert best.gains is not None
    np.testing.assert_array_equal(best.gains, [first.gains[0], np.zeros((2, 3))])


def test_the_radius_of_hits_is_known_to_a_tenth() -> None:
    """Claim: that of hits is good to a tenth of itself, as their cover of the disc is."""
    found = hit_centroid(*spokes(np.array([[5e-3, 4e-3, 6e-3, 5.5e-3]])))
    assert found.sigma_radius[0] == pytest.approx(0.1 * found.radius[0])


def test_each_pattern_and_each_voxel_has_its_own_error_of_angles() -> None:
    """Claim: errors by pattern widen each as its own does alone; those by voxel, G diag(a D′ σ)² Gᵀ, add up: with half
    of the voxels exact and the other half, the two parts make that of all."""
    samples, response = spokes(np.full((2, 16), 5e-3))
    start = circle_fit(samples, response)
    error = np.array([2e-5, 7e-5])

    def wider(pointing: object) -> Array:
        fits = [disc_fit(samples, response, start, spot=4e-4, pointing=one) for one in (pointing, 0.0)]
        return np.asarray(fits[0].covariance - fits[1].covariance)

    both = wider(error)
    for row in range(2):
        np.testing.assert_allclose(both[row], wider(float(error[row]))[row], rtol=1e-9)
    assert np.trace(both[1]) > 5.0 * np.trace(both[0]) > 0.0
    some = np.arange(32) % 4 < 2
    parts = [wider(np.where(chosen, error[:, None], 0.0)) for chosen in (some, ~some)]
    np.testing.assert_allclose(parts[0] + parts[1], both, rtol=1e-6, atol=1e-9 * np.abs(both).max())
