"""Random numbers that belong to places on surfaces: their correlation over a displacement, and whose they are."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import mitsuba
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm

from scanner_sim.detector.photodiode.echo_speckle import echo_speckle
from scanner_sim.detector.surface_noise import _address, coarse_numbers, fine_numbers
from scanner_sim.render.device import Device

pytestmark = pytest.mark.usefixtures("device")

Array = NDArray[np.float64]
mi: Any = mitsuba

COUNT = 20000
RADIUS = 2e-3
ALONG = np.array([0.48, -0.1, 0.87]) / np.linalg.norm([0.48, -0.1, 0.87])
ACROSS = np.cross([0.2, 1.0, 0.1], ALONG) / np.linalg.norm(np.cross([0.2, 1.0, 0.1], ALONG))
NORMAL = np.cross(ALONG, ACROSS)
"""A beam aslant to the axes of its object: nothing of what turns the lattice is 0 or 1."""


def beams(
    places: Array,
    objects: Any = None,
    axes: tuple[Array, Array, Array] = (ALONG, ACROSS, NORMAL),
    slope: Array | float = 0.0,
    distance: float = 1.0,
) -> Any:
    """Return beams of 2 mm at places on the two axes across them [radii], on objects that are all different.

    ``slope`` is by how much a surface recedes along the beam for a way along each of these axes, (n, 2).
    """
    away = np.sum(np.broadcast_to(slope, places.shape) * places, axis=1, keepdims=True)
    along, across, normal = axes
    point = RADIUS * (places[:, :1] * across + places[:, 1:] * normal + away * along)
    numbers = np.arange(len(places)) if objects is None else objects
    vectors = {
        name: SimpleNamespace(
            **{
                part: auto.Float(np.ascontiguousarray(values, dtype=np.float32))
                for part, values in zip("xyz", np.broadcast_to(vector, point.shape).T, strict=True)
            }
        )
        for name, vector in (("point", point), ("along", along), ("across", across), ("normal", normal))
    }
    own = auto.UInt32(np.asarray(numbers, dtype=np.uint32))
    return SimpleNamespace(**vectors, object=own, radius=auto.Float(RADIUS), distance=auto.Float(distance))


def numbers(at: Any, modes: int = 5) -> Array:
    """Return energy, centroid and other modes of two planes of beams, shape (2 + 2 modes, n)."""
    found = [*fine_numbers(at, 5), *coarse_numbers(at, modes, 0, 5), *coarse_numbers(at, modes, 1, 5)]
    dr.eval(found)
    return np.array([values.numpy() for values in found], dtype=np.float64)


def any_axes(count: int, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return axes of beams from all directions, with the line turned every way about them."""
    along, hint = rng.normal(size=(2, count, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(hint, along)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return along, across, np.cross(along, across)


PLACES = np.random.default_rng(2).uniform(-20.0, 20.0, (COUNT, 2))


@pytest.mark.parametrize("moved", [(0.5, 0.0), (1.0, 0.0), (0.0, 1.0), (0.6, -0.7), (0.7, 0.6)])
def test_numbers_fade_over_the_surface_as_the_beam_leaves_its_place(moved: tuple[float, float]) -> None:
    """Claim: over a displacement δ across the beam in radii the energy keeps exp(−δ²), the centroid
    (1 − 2δ_x²) exp(−δ²) with δ_x along the line, the other modes exp(−δ²): of surfaces that are inclined by up to 60°
    every way, seen from all sides.

    Tolerance: the mean product of 200 000 pairs has the standard error √((1 + ρ²)/200000), 0.003 at most, of normal
    numbers; a level of 1e-5 for each. 0.002 more for the lattice of the energy, 0.006 for that of the centroid, 0.036
    for the coarse one: of a million pairs over ways of up to 1.5 radii 0.0013, 0.0044 and 0.035 were found. Sights off
    the lattice's direction cancel to first order.
    """
    count, rng = 200_000, np.random.default_rng(4)
    axes, places = any_axes(count, rng), rng.uniform(-20.0, 20.0, (count, 2))
    steepness, way = (
        np.tan(rng.uniform(0.0, math.radians(60.0), count)),
        rng.uniform(0.0, 2.0 * math.pi, count),
    )
    slope = np.stack([steepness * np.cos(way), steepness * np.sin(way)], axis=1)
    first, second = (numbers(beams(at, None, axes, slope), 1) for at in (places, places + np.array(moved)))
    whole = math.exp(-(moved[0] ** 2) - moved[1] ** 2)
    error = math.sqrt(2.0) * float(norm.isf(0.5e-5)) / math.sqrt(count)
    wanted = [whole, (1.0 - 2.0 * moved[0] ** 2) * whole, whole, whole]
    for found, law, slack in zip(
        (first * second).mean(axis=1), wanted, (0.002, 0.006, 0.036, 0.036), strict=True
    ):
        assert found == pytest.approx(law, abs=slack + error)


def test_numbers_are_normal_apart_and_without_a_jump() -> None:
    """Claim: mean 0, variance 1, no two kinds correlated (level 1e-5 each), and a step of a thousandth of the beam
    changes none by more than its slope allows: 0.02 for what the lattice leaves out. So from all sides."""
    axes = any_axes(COUNT, np.random.default_rng(6))
    found = numbers(beams(PLACES, None, axes))
    z = float(norm.isf(0.5e-5 / 144.0))
    np.testing.assert_allclose(found.mean(axis=1), 0.0, atol=z / math.sqrt(COUNT))
    np.testing.assert_allclose(found @ found.T / COUNT, np.eye(len(found)), atol=z * math.sqrt(2.0 / COUNT))
    step = numbers(beams(PLACES + np.array([1e-3, 0.0]), None, axes)) - found
    assert np.abs(step[:2]).max() < 0.08
    assert np.abs(step[2:]).max() < 0.02


def test_a_lattice_lies_across_the_middle_of_its_sights() -> None:
    """Claim: what lies 20 radii behind a place along the beam has its energy's number but for the angle ε from the
    sight to its lattice's direction, uniform within ±1.43° both ways: E exp(−(20 ε)²) is left.

    Tolerance: a level of 1e-5 for 200 000 pairs, and 0.02 for the zones where lattices are mixed and for narrow rings.
    """
    count, rng, ways = 200_000, np.random.default_rng(7), 20.0
    axes, places = any_axes(count, rng), rng.uniform(-20.0, 20.0, (count, 2))
    behind = beams(places, None, axes)
    for part in "xyz":
        setattr(behind.point, part, getattr(behind.point, part) + ways * RADIUS * getattr(behind.along, part))
    first, second = (
        fine_numbers(at, 5)[0].numpy().astype(np.float64) for at in (beams(places, None, axes), behind)
    )
    half = ways * math.pi / 126.0
    expected = (0.5 * math.sqrt(math.pi) * math.erf(half) / half) ** 2
    error = math.sqrt(2.0) * float(norm.isf(0.5e-5)) / math.sqrt(count)
    assert float(np.mean(first * second)) == pytest.approx(expected, abs=0.02 + error)


@pytest.mark.parametrize("plane", [(0, 1), (1, 2), (2, 0)])
def test_a_sight_that_turns_goes_over_into_other_numbers_without_a_jump(plane: tuple[int, int]) -> None:
    """Claim: of sights all around 70 objects no step of 0.2 mrad changes a number by more than one goes over into
    another; sights 4.5° apart have nothing in common, and numbers have the variance 1 all the way.

    Tolerance: one number turns into another by a quarter of a circle on an eighth of 2.86°, at a step hence by 0.2 mrad
    · 8π/2 /2.86° of the length of both, √(2 ln(n/1e-5)) at most for the n times that three numbers of 70 objects do
    so. Products of 70 · 79 independent pairs, and squares: level 1e-5.
    """
    step, objects = 2e-4, 70
    longest = math.sqrt(2.0 * math.log(3.0 * objects * 126.0 / 1e-5))
    turns = np.arange(0.0, 2.0 * math.pi, step)
    along = np.zeros((len(turns), 3))
    along[:, plane[0]], along[:, plane[1]] = np.cos(turns), np.sin(turns)
    normal = np.zeros(3)
    normal[3 - sum(plane)] = 1.0
    across = np.cross(normal, along)
    found = []
    for number in range(objects):
        at = beams(np.zeros((len(turns), 2)), np.full(len(turns), number), (along, across, normal))
        found.append(numbers(at, 1)[:3])
    values = np.array(found)
    assert np.abs(np.diff(values, axis=2)).max() < step * 4.0 * math.pi / (math.pi / 63.0) * longest
    apart = values[:, :, :: round(math.radians(4.5) / step)]
    pairs = apart[:, :, 1:] * apart[:, :, :-1]
    z = float(norm.isf(0.5e-5 / 3.0))
    count = pairs[:, 0].size
    np.testing.assert_allclose(pairs.mean(axis=(0, 2)), 0.0, atol=z / math.sqrt(count))
    np.testing.assert_allclose(np.square(apart).mean(axis=(0, 2)), 1.0, atol=z * math.sqrt(2.0 / count))


def test_each_object_has_numbers_of_its_own_from_each_side() -> None:
    """Claim: 26 objects, one for each bit of their number with and without the last, seen from 300 directions, have
    7800 pairs of numbers."""
    objects = np.unique([[1 << bit, 1 << bit ^ 1] for bit in range(1, 13)])
    golden = math.pi * (3.0 - math.sqrt(5.0)) * np.arange(300)
    height = 1.0 - (2.0 * np.arange(300) + 1.0) / 300
    flat = np.sqrt(1.0 - height**2)
    along = np.stack([flat * np.cos(golden), flat * np.sin(golden), height], axis=1)
    across = np.cross([0.3, 0.2, 0.9], along)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    axes = tuple(np.tile(axis, (len(objects), 1)) for axis in (along, across, np.cross(along, across)))
    at = beams(np.zeros((len(axes[0]), 2)), np.repeat(objects, 300), axes)
    assert len(np.unique(np.stack(numbers(at)[2:4], axis=1), axis=0)) == len(objects) * 300


@pytest.mark.parametrize("shares", [(1.0,), (0.8, 0.03)])
def test_echoes_have_as_many_packets_as_their_share_of_the_light(shares: tuple[float, ...]) -> None:
    """Claim: a beam of 2 mm at 3.1 m before a lens of 4000 wavelengths has x = w D/(2λR) = 1.29 images in λN, and
    M = 1 + √π x + π² x² packets. Of coherence C² = 0.7 a share q of the light has the variance v = 0.7/(M q), 0.7
    at most; the cube root of the energy is normal about 1 − v/9 with √v/3. No two echoes are alike.

    Tolerance: means, variances and correlation of 20 000 shots, each with a level of 1e-5.
    """
    x = 2e-3 * 4000.0 / (2.0 * 3.1)
    packets = 1.0 + math.sqrt(math.pi) * x + (math.pi * x) ** 2
    amount = np.repeat(shares, COUNT).astype(np.float32)
    light: Any = SimpleNamespace(
        reference=auto.Float(np.zeros(COUNT, dtype=np.float32)), amount=auto.Float(amount)
    )
    coherence = auto.Float(np.full(COUNT, 0.7, dtype=np.float32))
    factor = echo_speckle(light, beams(PLACES, distance=3.1), coherence, 4000.0, 5).numpy()
    roots = np.cbrt(factor.astype(np.float64).reshape(len(shares), COUNT))
    error = float(norm.isf(0.5e-5)) / math.sqrt(COUNT)
    for share, root in zip(shares, roots, strict=True):
        variance = min(0.7 / packets * sum(shares) / share, 0.7)
        assert root.mean() == pytest.approx(1.0 - variance / 9.0, abs=error * math.sqrt(variance) / 3.0)
        assert root.var() == pytest.approx(variance / 9.0, rel=math.sqrt(2.0) * error)
    if len(shares) > 1:
        assert abs(np.corrcoef(roots)[0, 1]) < error


def test_each_place_of_a_lattice_has_an_address_of_its_own(device: Device) -> None:
    """Claim: all columns and rows from −2¹⁵ to 2¹⁵ − 1 do: two that differ by one bit of either have two addresses."""
    first = [(37, -812), (-20000, 15000)]
    places = [*first]
    for column, row in first:
        places += [(column ^ (1 << bit), row) for bit in range(15)] + [
            (column, row ^ (1 << bit)) for bit in range(15)
        ]
    places += [(-column - 1, row) for column, row in places]
    column, row = (auto.Int32([place[axis] for place in places]) for axis in (0, 1))
    found = _address(column, row).numpy()
    assert len(set(places)) == len(places)
    assert len(np.unique(found)) == len(places)
