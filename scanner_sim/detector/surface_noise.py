"""Random numbers that belong to positions on surfaces, for the speckle under a beam.

White noise stands on a lattice over each surface, in the frame of the object and in units of the beam's radius there.
Its sums under exp(−2δ²/w²) are the energy's number, those under δ exp(−2δ²/w²), with δ along the line, the centroid's:
the first is a Gaussian beam's weight and the second its derivative, and their correlations over a displacement are
hence exp(−δ²/w²) and (1 − 2δ²/w²) exp(−δ²/w²), kept to 0.002 and 0.005. All other numbers have the energy's, on a
lattice of pitch π w/(2√2) whose numbers are combined with cos(πt/2), sin(πt/2): within 0.035 of exp(−δ²/w²).

Displacements are those across the beam, as two beams see the same speckle of a surface as far as they overlap, whatever
its slope. The lattice hence lies across the sight: each of some 5000 directions from which an object can be seen, 2.9°
apart, has one of its own, and within an eighth of that from the next direction two are mixed, which is continuous and
keeps the variance. A sight that is ε off its direction shifts a displacement along the slope of a surface that is
inclined by i by ε tan i of itself, 0.025 at 60° (root of the mean square; 0.09 at most).

Not modelled: that the speckle of a real surface is another one after a turn of D/2R, with a lens D at the distance R.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.foundation.device_loops import for_each
from scanner_sim.foundation.device_streams import generator
from scanner_sim.foundation.device_types import Float, Int32, UInt32, Vector3f
from scanner_sim.foundation.streams import Seed, Stream

FINE = 0.7
"""Pitch of the lattice of the energy and the centroid, in 1/e² radii of the beam."""
COARSE = math.pi / (2.0 * math.sqrt(2.0))
"""Pitch of the lattice of all other modes."""
VIEW = math.pi / 63.0
"""Angle between directions of sight that have lattices of their own [rad]."""
_BLEND = 0.125
"""Share of that angle over which one lattice goes over into the next."""
_RING_BITS, _CELL_BITS, _SAMPLE_BITS = 6, 7, 6
"""Bits that number rings of directions, those of a ring, and samples at a place: the other 13 number objects."""


class SurfacePoints(Protocol):
    """Where m beams meet their surfaces: see :class:`~scanner_sim.render.beam.surface_positions.SurfacePositions`."""

    point: Vector3f
    along: Vector3f
    across: Vector3f
    normal: Vector3f
    object: UInt32
    radius: Float
    distance: Float


@dataclass
class LatticePlace:
    """Where beams are on one of the lattices of their objects, Dr.Jit arrays of shape (m,).

    ``column`` and ``row`` in radii of the beam; ``cosine`` and ``sine`` of the angle from the columns' axis to the
    line; ``salt`` distinguishes objects and directions of sight.
    """

    column: Float
    row: Float
    cosine: Float
    sine: Float
    salt: UInt32


def _mixed(at: Float, add: Callable[..., tuple[Any, ...]], *state: Any) -> tuple[Any, ...]:
    """Return a state after ``add`` took the whole numbers about ``at``, with their weights: one, between two both."""
    past = at + 0.5 * _BLEND
    upper = dr.floor(past)
    sine, cosine = dr.sincos(0.5 * math.pi * dr.clip(1.0 - (past - upper) * (1.0 / _BLEND), 0.0, 1.0))

    def turn(number: UInt32, *state: Any) -> tuple[Any, ...]:
        first = number == 0
        return number + 1, *add(upper - auto.Float(number), dr.select(first, cosine, sine), *state)

    turns = dr.select(sine > 0.0, auto.UInt32(2), 1)
    start: Any = (dr.zeros(auto.UInt32, dr.width(at)), *state)
    ended: Any = dr.while_loop(start, lambda number, *state: number < turns, turn)
    return tuple(ended[1:])


def _over_lattices(
    positions: SurfacePoints, count: int, numbers: Callable[[LatticePlace], list[Float]]
) -> list[Float]:
    """Return ``count`` numbers that lattices give at their places, mixed of all in which a beam has a part."""
    along, scale = positions.along, dr.rcp(positions.radius)
    polar = dr.atan2(dr.sqrt(dr.square(along.x) + dr.square(along.y)), along.z)
    azimuth = dr.atan2(along.y, along.x) * (0.5 / math.pi)

    def add_ring(ring: Float, share: Float, *totals: Float) -> tuple[Any, ...]:
        """Add the directions at one angle to the third axis of the object."""
        down, up = dr.sincos(VIEW * ring)
        cells = dr.maximum(dr.round(down * (2.0 * math.pi / VIEW)), 1.0)

        def add_cell(turn: Float, weight: Float, *totals: Float) -> tuple[Any, ...]:
            cell = turn - cells * dr.floor(turn / cells)
            sine, cosine = dr.sincos(2.0 * math.pi * (cell + 0.5) / cells)

            def on_plane(vector: Vector3f) -> tuple[Float, Float]:
                outward = cosine * vector.x + sine * vector.y
                return up * outward - down * vector.z, cosine * vector.y - sine * vector.x

            (column, row), (right, lower) = on_plane(positions.point), on_plane(positions.across)
            over = dr.rsqrt(dr.square(right) + dr.square(lower))
            salt = auto.UInt32(positions.object) << _RING_BITS | auto.UInt32(ring)
            salt = (salt << _CELL_BITS | auto.UInt32(cell)) << _SAMPLE_BITS
            place = LatticePlace(column * scale, row * scale, right * over, lower * over, salt)
            found = numbers(place)
            whole = share * weight
            return tuple(dr.fma(whole, one, total) for one, total in zip(found, totals, strict=True))

        return _mixed(dr.select(cells > 1.0, azimuth * cells, 0.5), add_cell, *totals)

    zero = dr.zeros(auto.Float, dr.width(polar))
    return list(_mixed(polar * (1.0 / VIEW) + 0.5, add_ring, *[zero] * count))


def _address(column: Int32, row: Int32) -> UInt32:
    return auto.UInt32(column & 0xFFFF) | (auto.UInt32(row & 0xFFFF) << 16)


def fine_numbers(positions: SurfacePoints, seed: Seed) -> list[Float]:
    """Return normal numbers of the energy and of the centroid: sums of the lattice's under the beam."""

    def sums(place: LatticePlace) -> list[Float]:
        column, row = place.column * (1.0 / FINE), place.row * (1.0 / FINE)
        # One call gives two by two places, and three by three calls reach at least two and a half to every side.
        left, top = (dr.floor(0.5 * at - 0.75) for at in (column, row))

        def add(number: UInt32, *totals: Float) -> tuple[Any, ...]:
            """Add two by two places: their numbers and their squares, weighed by the beam and by their distance."""
            down = number // 3
            right, lower = left + auto.Float(number - 3 * down), top + auto.Float(down)
            address = _address(auto.Int32(right), auto.Int32(lower))
            drawn = generator(seed, Stream.SPECKLE, address, place.salt).next_float32x4_normal()
            energy, slope, energies, slopes = totals
            columns, rows = (
                [((2.0 * block + step) - at) * FINE for step in (0.0, 1.0)]
                for block, at in ((right, column), (lower, row))
            )
            across, along = ([dr.exp(-2.0 * dr.square(way)) for way in ways] for ways in (columns, rows))
            for step in range(4):
                first, second = step % 2, step // 2
                weight = across[first] * along[second]
                moved = (place.cosine * columns[first] + place.sine * rows[second]) * weight
                energy, slope = dr.fma(weight, drawn[step], energy), dr.fma(moved, drawn[step], slope)
                energies, slopes = dr.fma(weight, weight, energies), dr.fma(moved, moved, slopes)
            return energy, slope, energies, slopes

        zero = dr.zeros(auto.Float, dr.width(column))
        energy, slope, energies, slopes = for_each(9, add, zero, zero, zero, zero)
        return [energy * dr.rsqrt(energies), slope * dr.rsqrt(slopes)]

    return _over_lattices(positions, 2, sums)


def coarse_numbers(positions: SurfacePoints, count: int, plane: int, seed: Seed) -> list[Float]:
    """Return independent normal numbers of the other modes, continuous over the surface."""

    def sums(place: LatticePlace) -> list[Float]:
        nodes = []
        for coordinate in (place.column, place.row):
            at = coordinate * (1.0 / COARSE)
            node = dr.floor(at)
            nodes.append((auto.Int32(node), *dr.sincos(0.5 * math.pi * (at - node))))
        (column, *across), (row, *down) = nodes
        samples = [place.salt | auto.UInt32(16 * plane + block) for block in range(-(-count // 4))]

        def add(number: UInt32, totals: list[Any]) -> tuple[Any, ...]:
            """Add one of the four nodes about each position."""
            right, lower = number >> 1, number & 1
            address = _address(column + auto.Int32(right), row + auto.Int32(lower))
            weight = dr.select(right == 1, *across) * dr.select(lower == 1, *down)
            drawn = [
                generator(seed, Stream.SPECKLE, address, sample).next_float32x4_normal() for sample in samples
            ]
            return (
                [total + weight * auto.Array4f(normal) for total, normal in zip(totals, drawn, strict=True)],
            )

        (totals,) = for_each(4, add, [dr.zeros(auto.Array4f, dr.width(place.column)) for _ in samples])
        return [total[component] for total in totals for component in range(4)][:count]

    return _over_lattices(positions, count, sums)
