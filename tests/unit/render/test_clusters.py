"""Clusters keep power, mean and variance, and give all of it to the pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
import pytest
from scipy.special import ndtr

from scanner_sim.render.beam.kept_light import speckled
from scanner_sim.render.beam.light import Light, cluster
from scanner_sim.render.beam.line_projection import LineProjection
from scanner_sim.render.beam.path_projection import PathProjection
from scanner_sim.render.beam.projection import Spots
from scanner_sim.render.device import Device

SHOTS, COUNT = 5, 200


def gathered(spots: Spots, clusters: int, *, path: bool = False, shots: int = SHOTS) -> Light:
    """Return the light of shots in clusters, on pixels or along the path."""
    import mitsuba as mi

    index = dr.arange(mi.UInt32, shots)
    count = dr.width(spots.power) // shots
    kept = (PathProjection if path else LineProjection).resolution
    return Light(index, index, *cluster(spots, index, count, clusters, kept))


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


@pytest.mark.parametrize("path", [False, True])
@pytest.mark.parametrize("clusters", [1, 4, 16])
def test_moments_are_kept(spots: Spots, clusters: int, path: bool) -> None:
    """Claim: of 200 spots power, mean and variance are those of their clusters but for rounding.

    A sum of 200 numbers of 24 bits errs by up to 200 · 2⁻²⁴ of itself, and by a fourteenth of that as a rule; the
    variance is what is left of a square that may be four times as large.
    """
    rounding = COUNT * 2.0**-24
    found = gathered(spots, clusters, path=path)
    expected = moments(
        *(part.numpy().reshape(SHOTS, -1).T for part in (spots.power, spots.position, spots.sigma))
    )
    actual = moments(found.amount.numpy(), found.position.numpy(), found.sigma.numpy())
    assert found.count == clusters
    np.testing.assert_allclose(actual, expected, rtol=rounding)
    power = spots.power.numpy().astype(np.float64).reshape(SHOTS, -1)
    mean = (power * spots.coherence.numpy().reshape(SHOTS, -1)).sum(axis=1) / power.sum(axis=1)
    amount, values = (
        part.numpy().astype(np.float64).reshape(-1, SHOTS) for part in (found.amount, found.coherence)
    )
    np.testing.assert_allclose((amount * values).sum(axis=0) / amount.sum(axis=0), mean, rtol=rounding)


@pytest.mark.parametrize("clusters", [4, 16])
def test_a_cluster_is_no_wider_than_its_part_of_the_light(spots: Spots, clusters: int) -> None:
    """Claim: variances are those of spots, of 0.8 to 1.2, and of places within an equal part of what the lit spots of a
    shot cover, no more than a quarter of its square. The first and the last part hold the outermost; chance may leave
    one between them dark."""
    found = gathered(spots, clusters)
    power, position = (part.numpy().reshape(SHOTS, -1) for part in (spots.power, spots.position))
    extent = np.array([np.ptp(own[lit > 0.0]) for own, lit in zip(position, power, strict=True)])
    sigma, amount = (part.numpy().reshape(-1, SHOTS) for part in (found.sigma, found.amount))
    widest = np.sqrt(1.2**2 + 0.25 * (extent / clusters) ** 2)
    assert (np.where(amount > 0.0, sigma, 0.0) <= widest * (1.0 + 1e-4)).all()
    assert (amount[[0, -1]] > 0.0).all()
    assert np.mean(amount > 0.0) > 0.9


def test_dark_spots_far_away_widen_no_cluster(device: Device) -> None:
    """Claim: spots of no power have no say in what clusters cover: four lit ones in four clusters stay apart, wherever
    dark ones lie to either side."""
    import mitsuba as mi

    power, place = [0.0, 1.0, 2.0, 3.0, 4.0, 0.0], [-400.0, 20.0, 23.0, 26.0, 29.0, 900.0]
    six = Spots(*(mi.Float(part) for part in (power, place, [1.0] * 6, [1.0] * 6)))
    found = gathered(six, 4, shots=1)
    np.testing.assert_array_equal(found.amount.numpy(), power[1:5])
    np.testing.assert_allclose(found.position.numpy(), place[1:5], atol=1e-4)
    np.testing.assert_allclose(found.sigma.numpy(), 1.0, atol=1e-4)


def test_pixels_share_all_the_light(spots: Spots) -> None:
    import mitsuba as mi

    found = gathered(spots, 16)
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


@pytest.mark.parametrize("sigma", [0.03, 0.1, 0.4, 2.0])
def test_a_pixel_and_the_next_hold_what_lies_between_their_sides(device: Device, sigma: float) -> None:
    """Claim: of a Gaussian wherever it stands, Φ of both sides of a pixel, however much narrower than it; the line's
    pixels are the first ones of such pairs."""
    import mitsuba as mi

    places = np.float32(np.random.default_rng(int(100 * sigma)).uniform(8.0, 12.0, 40))
    every, pixels = dr.arange(mi.UInt32, len(places)), 20
    one = mi.Float(np.ones(len(places), np.float32))
    light = Light(every, every, one, mi.Float(places), sigma * one, one)
    sides = np.arange(pixels + 2) - 0.5
    wanted = np.diff(ndtr((sides - places[:, None]) / sigma), axis=1)
    pixel = np.tile(np.arange(pixels, dtype=np.uint32), len(places))
    shot = np.repeat(np.arange(len(places), dtype=np.uint32), pixels)
    found, beside = (
        power.numpy().reshape(len(places), pixels) for power in light.pair(mi.UInt32(pixel), mi.UInt32(shot))
    )
    np.testing.assert_allclose(found, wanted[:, :-1], atol=2e-6)
    np.testing.assert_allclose(beside, wanted[:, 1:], atol=2e-6)
    np.testing.assert_array_equal(light.line(3, pixels), found[3])


def test_part_and_join(spots: Spots) -> None:
    import mitsuba as mi

    found = gathered(spots, 4)
    part = found.part(mi.UInt32([4, 1]))
    assert part.shots == 2
    kept = found.amount.numpy().reshape(4, SHOTS)[:, [4, 1]]
    np.testing.assert_array_equal(part.amount.numpy().reshape(4, 2), kept)
    assert part.reference is None
    assert found.part(mi.UInt32([3])).coherence.numpy() == pytest.approx(found.coherence.numpy()[3::SHOTS])
    twice = found.join(found)
    assert twice.count == 8
    pixel, place = dr.arange(mi.UInt32, 80), dr.zeros(mi.UInt32, 80)
    np.testing.assert_allclose(
        twice.power(pixel, place).numpy(), 2.0 * found.power(pixel, place).numpy(), rtol=1e-6
    )


def test_parts_of_a_pulse_keep_their_reference(spots: Spots) -> None:
    """Claim: paths without coherence of their own are parted and joined with what they are counted from."""
    import mitsuba as mi

    spots.coherence = None
    found = gathered(spots, 4, path=True)
    assert found.coherence is None
    found.reference = mi.Float([5, 6, 7, 8, 9])
    part = found.part(mi.UInt32([4, 1]))
    both = part.join(part)
    assert both.reference.numpy().tolist() == [9.0, 6.0]
    assert (both.count, both.shots, both.coherence) == (8, 2, None)
    kept = found.position.numpy().reshape(4, SHOTS)[:, [4, 1]]
    np.testing.assert_array_equal(both.position.numpy().reshape(2, 4, 2)[1], kept)


def test_dark_shots_stay_dark(device: Device) -> None:
    import mitsuba as mi

    one = dr.ones(mi.Float, 6)
    dark = Spots(dr.zeros(mi.Float, 6), mi.Float([1, 2, 3, 4, 5, 6]), one, one)
    found = gathered(dark, 4, shots=2)
    line = found.power(dr.arange(mi.UInt32, 10), dr.zeros(mi.UInt32, 10)).numpy()
    assert (line == 0.0).all()
    assert np.isfinite(found.position.numpy()).all()


@pytest.mark.parametrize("path", [False, True])
def test_light_of_some_shots_and_of_the_others_is_that_of_all(spots: Spots, path: bool) -> None:
    import mitsuba as mi

    whole = gathered(spots, 16, path=path)
    whole.reference = mi.Float(np.arange(SHOTS, dtype=np.float32)) if path else None
    parts = [whole.part(mi.UInt32(some)) for some in ([1], [3, 0], [2, 4])]
    joined = Light.of_all(parts)
    order = joined.index.numpy()
    assert order.tolist() == [1, 3, 0, 2, 4]
    for name in ("amount", "position", "sigma", "coherence", "shot", "reference"):
        expected, found = getattr(whole, name), getattr(joined, name)
        if expected is None:
            assert found is None
        else:
            kept = expected.numpy().reshape(-1, SHOTS)[:, order].ravel()
            np.testing.assert_array_equal(found.numpy(), kept, err_msg=name)


@dataclass
class Kept:
    """Light of clusters, those of all shots one after the other."""

    amount: Any
    count: int
    shots: int


@pytest.mark.parametrize("late", [0, 1, 2])
def test_light_of_several_surfaces_has_no_speckle(device: Device, late: int) -> None:
    """Claim: of three clusters of five shots all but the last ones are multiplied by the factors that their own light
    has, and only their light is asked about."""
    import mitsuba as mi

    amount: Any = np.arange(15.0) + 2.0
    asked: list[list[float]] = []

    def factors(light: Any) -> Any:
        asked.append(light.amount.numpy().tolist())
        return mi.Float(np.float32(0.5 + 0.25 * np.arange(len(asked[0]))))

    found = speckled(Kept(mi.Float(np.float32(amount)), 3, 5), late, factors)  # type: ignore[arg-type]
    first = 5 * (3 - late)
    wanted = amount.copy()
    wanted[:first] *= 0.5 + 0.25 * np.arange(first)
    np.testing.assert_allclose(found.amount.numpy(), wanted, rtol=1e-6)
    assert asked == [amount[:first].tolist()]
