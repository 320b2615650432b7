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
from scanner_sim.detector.surface_noise import LatticePositions, _address, coarse_numbers, fine_numbers
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


def beams(places: Array, objects: Any = None, turned: int = 0, distance: float = 1.0) -> Any:
    """Return beams of 2 mm at places on the two axes across the beam [radii], on objects that are all different."""
    axes = [np.roll(axis, turned) for axis in (ALONG, ACROSS, NORMAL)]
    point = RADIUS * (places[:, :1] * axes[1] + places[:, 1:] * axes[2])
    numbers = np.arange(len(places)) if objects is None else objects
    vectors = {
        name: SimpleNamespace(
            **dict(zip("xyz", (auto.Float(np.float32(part)) for part in parts), strict=True))
        )
        for name, parts in zip(("point", "along", "across", "normal"), (point.T, *axes), strict=True)
    }
    own = auto.UInt32(np.asarray(numbers, dtype=np.uint32))
    return SimpleNamespace(**vectors, object=own, radius=auto.Float(RADIUS), distance=auto.Float(distance))


def lattice(places: Array, objects: Any = None, turned: int = 0) -> LatticePositions:
    """Return where such beams are on the lattices of their objects."""
    return LatticePositions.of(beams(places, objects, turned))


def numbers(places: Array) -> Array:
    """Return energy, centroid and five other modes of two planes at places, shape (12, n)."""
    at = lattice(places)
    found = [*fine_numbers(at, 5), *coarse_numbers(at, 5, 0, 5), *coarse_numbers(at, 5, 1, 5)]
    dr.eval(found)
    return np.array([values.numpy() for values in found], dtype=np.float64)


PLACES = np.random.default_rng(2).uniform(-20.0, 20.0, (COUNT, 2))


@pytest.mark.parametrize("moved", [(1.0, 0.0), (0.0, 1.0), (0.6, -0.7), (0.7, 0.6)])
def test_numbers_fade_over_the_surface_as_the_beam_leaves_its_place(moved: tuple[float, float]) -> None:
    """Claim: over a displacement δ in radii the energy keeps exp(−δ²), the centroid (1 − 2δ_x²) exp(−δ²) with δ_x along
    the line; all other numbers have exp(−δ²) to 0.03 with δ on the plane of their lattice, the object's x and y.

    Tolerance: the mean product of 20 000 pairs has the standard error √((1 + ρ²)/20000), 0.01 at most, of normal
    numbers; a level of 1e-5 for each. 0.005 more for the lattice of the energy, and 0.05 for that of the centroid: at
    30° to the object's axis weights beyond four rows, which are left out, count (0.046 at most, by 400 000 pairs over
    displacements of up to 1.2 radii).
    """
    first, second = numbers(PLACES), numbers(PLACES + np.array(moved))
    whole = math.exp(-(moved[0] ** 2) - moved[1] ** 2)
    error = float(norm.isf(0.5e-5)) / math.sqrt(COUNT)
    on_plane = (moved[0] * ACROSS + moved[1] * NORMAL)[:2]
    wanted = [whole, (1.0 - 2.0 * moved[0] ** 2) * whole, *[math.exp(-on_plane @ on_plane)] * 10]
    for row, (one, other) in enumerate(zip(first, second, strict=True)):
        slack = (0.005, 0.05)[row] if row < 2 else 0.03
        assert float(np.mean(one * other)) == pytest.approx(wanted[row], abs=slack + math.sqrt(2.0) * error)


def test_along_an_axis_of_the_object_the_lattice_reaches_far_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: where an axis of the object lies along the beam, to a degree, energy and centroid keep exp(−δ²) and
    (1 − 2δ_x²) exp(−δ²) to 0.015, with the line turned by 45° about the beam or not.

    Tolerance: as above, with 200 000 pairs.
    """
    places = np.random.default_rng(4).uniform(-20.0, 20.0, (200_000, 2))
    along = np.array([0.02, 0.01, 1.0]) / np.linalg.norm([0.02, 0.01, 1.0])
    error = math.sqrt(2.0) * float(norm.isf(0.5e-5)) / math.sqrt(len(places))

    def fine(at: Array) -> Array:
        found = fine_numbers(lattice(at), 5)
        dr.eval(found)
        return np.array([values.numpy() for values in found], dtype=np.float64)

    for hint in ([0.0, 1.0, 0.0], [1.0, 1.0, 0.0]):
        across = np.cross(hint, along) / np.linalg.norm(np.cross(hint, along))
        for name, axis in (("ALONG", along), ("ACROSS", across), ("NORMAL", np.cross(along, across))):
            monkeypatch.setitem(globals(), name, axis)
        first = fine(places)
        for moved in ((0.5, 0.0), (0.7, 0.0), (0.7, 0.6), (0.0, 0.8)):
            whole = math.exp(-(moved[0] ** 2) - moved[1] ** 2)
            found = (first * fine(places + np.array(moved))).mean(axis=1)
            wanted = [whole, (1.0 - 2.0 * moved[0] ** 2) * whole]
            np.testing.assert_allclose(found, wanted, atol=0.015 + error)


def test_numbers_are_normal_apart_and_without_a_jump() -> None:
    """Claim: mean 0, variance 1, no two kinds correlated (level 1e-5 each), and a step of a thousandth of the beam
    changes none by more than its slope allows: 0.02 for what the lattice leaves out."""
    found = numbers(PLACES)
    z = float(norm.isf(0.5e-5 / 144.0))
    np.testing.assert_allclose(found.mean(axis=1), 0.0, atol=z / math.sqrt(COUNT))
    np.testing.assert_allclose(found @ found.T / COUNT, np.eye(len(found)), atol=z * math.sqrt(2.0 / COUNT))
    step = numbers(PLACES + np.array([1e-3, 0.0])) - found
    assert np.abs(step[:2]).max() < 0.08
    assert np.abs(step[2:]).max() < 0.02


def test_each_object_has_numbers_of_its_own_from_each_side() -> None:
    """Claim: ten objects that are seen along three axes have thirty sets of numbers."""
    ten = np.zeros((10, 2))
    salts = [lattice(ten, np.arange(10), turned).salt.numpy() for turned in range(3)]
    assert len(np.unique(np.concatenate(salts))) == 30


def test_a_step_on_the_lattice_is_one_along_and_across_the_line(device: Device) -> None:
    """Claim: the matrix undoes the two axes of the beam on the plane that faces it, whatever their slant; places and
    steps are counted in radii of the beam."""
    along = np.array([0.2, -0.3, 0.9])
    across, normal = np.array([0.9, 0.1, -0.2]), np.array([0.3, 0.8, 0.25])
    vectors = [mi.Vector3f(vector.tolist()) for vector in (np.array([0.5, -0.4, 7.0]), along, across, normal)]
    positions: Any = SimpleNamespace(
        **dict(zip(("point", "along", "across", "normal"), vectors, strict=True)),
        object=auto.UInt32(1),
        radius=auto.Float(0.25),
    )
    found = LatticePositions.of(positions)
    matrix = np.array([float(entry.numpy()[0]) for entry in found.turn]).reshape(2, 2)
    axes = np.stack([across[:2], normal[:2]], axis=1)
    np.testing.assert_allclose(matrix @ axes, np.eye(2), atol=1e-6)
    assert (float(found.column.numpy()[0]), float(found.row.numpy()[0])) == pytest.approx((2.0, -1.6))


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
