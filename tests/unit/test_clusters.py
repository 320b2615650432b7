"""Clusters keep power, mean and variance, and give all of it to the pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
import pytest

from scanner_sim.render.device import Device

SHOTS, COUNT = 5, 200


@dataclass
class Spots:
    power: Any
    position: Any
    sigma: Any
    coherence: Any


@pytest.fixture
def spots(device: Device) -> Spots:
    """Spots of five shots between pixels 20 and 60; a third of them dark."""
    import mitsuba as mi

    random = np.random.default_rng(5)
    power = random.uniform(0.0, 1.0, (COUNT, SHOTS)) * (random.uniform(size=(COUNT, SHOTS)) > 0.33)
    position = random.uniform(20.0, 60.0, (COUNT, SHOTS))
    sigma = random.uniform(0.8, 1.2, (COUNT, SHOTS))
    parts = (power, position, sigma, random.uniform(0.5, 1.0, (COUNT, SHOTS)))
    return Spots(*(mi.Float(part.astype(np.float32).T.ravel()) for part in parts))


def moments(power: np.ndarray, position: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return power, mean and variance of each shot, shape (3, SHOTS)."""
    power, position, sigma = (part.astype(np.float64).reshape(-1, SHOTS) for part in (power, position, sigma))
    total = power.sum(axis=0)
    mean = (power * position).sum(axis=0) / total
    return np.array([total, mean, (power * (sigma**2 + (position - mean) ** 2)).sum(axis=0) / total])


@pytest.mark.parametrize("clusters", [1, 4, 16])
def test_moments_are_kept(spots: Spots, clusters: int) -> None:
    import mitsuba as mi

    from scanner_sim.render.beam.clusters import cluster

    found = cluster(spots, dr.arange(mi.UInt32, SHOTS), COUNT, clusters)
    expected = moments(
        *(part.numpy().reshape(SHOTS, -1).T for part in (spots.power, spots.position, spots.sigma))
    )
    actual = moments(found.amount.numpy(), found.position.numpy(), found.sigma.numpy())
    assert found.count == clusters
    np.testing.assert_allclose(actual, expected, rtol=2e-6)
    power = spots.power.numpy().astype(np.float64).reshape(SHOTS, -1)
    mean = (power * spots.coherence.numpy().reshape(SHOTS, -1)).sum(axis=1) / power.sum(axis=1)
    amount, values = (
        part.numpy().astype(np.float64).reshape(-1, SHOTS) for part in (found.amount, found.coherence)
    )
    np.testing.assert_allclose((amount * values).sum(axis=0) / amount.sum(axis=0), mean, rtol=2e-6)


def test_pixels_share_all_the_light(spots: Spots) -> None:
    import mitsuba as mi

    from scanner_sim.render.beam.clusters import cluster

    found = cluster(spots, dr.arange(mi.UInt32, SHOTS), COUNT, 16)
    for place in range(SHOTS):
        pixel = dr.arange(mi.UInt32, 80)
        line = found.power(pixel, dr.full(mi.UInt32, place, 80)).numpy().astype(np.float64)
        total, mean, variance = moments(found.amount.numpy(), found.position.numpy(), found.sigma.numpy())[
            :, place
        ]
        assert line.sum() == pytest.approx(total, rel=1e-5)
        centre = (line * np.arange(80)).sum() / line.sum()
        assert centre == pytest.approx(mean, abs=2e-4)
        # A pixel's width adds its own variance of 1/12.
        assert (line * (np.arange(80) - centre) ** 2).sum() / line.sum() == pytest.approx(
            variance + 1.0 / 12.0, rel=1e-4
        )


def test_part_and_join(spots: Spots) -> None:
    import mitsuba as mi

    from scanner_sim.render.beam.clusters import cluster

    found = cluster(spots, dr.arange(mi.UInt32, SHOTS), COUNT, 4)
    part = found.part(mi.UInt32([4, 1]))
    assert part.shots == 2
    kept = found.amount.numpy().reshape(4, SHOTS)[:, [4, 1]]
    np.testing.assert_array_equal(part.amount.numpy().reshape(4, 2), kept)
    twice = found.join(found)
    assert twice.count == 8
    pixel, place = dr.arange(mi.UInt32, 80), dr.zeros(mi.UInt32, 80)
    np.testing.assert_allclose(
        twice.power(pixel, place).numpy(), 2.0 * found.power(pixel, place).numpy(), rtol=1e-6
    )


def test_dark_shots_stay_dark(device: Device) -> None:
    import mitsuba as mi

    from scanner_sim.render.beam.clusters import cluster

    one = dr.ones(mi.Float, 6)
    dark = Spots(dr.zeros(mi.Float, 6), mi.Float([1, 2, 3, 4, 5, 6]), one, one)
    found = cluster(dark, dr.arange(mi.UInt32, 2), 3, 4)
    line = found.power(dr.arange(mi.UInt32, 10), dr.zeros(mi.UInt32, 10)).numpy()
    assert (line == 0.0).all()
    assert np.isfinite(found.position.numpy()).all()
