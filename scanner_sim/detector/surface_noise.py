"""Random numbers that belong to positions on surfaces, for the speckle under a beam.

White noise stands on a lattice over each surface, in the frame of the object and in units of the beam's radius there.
Its sums under exp(−2δ²/w²) are the energy's number, those under δ exp(−2δ²/w²), with δ along the line, the centroid's:
the first is a Gaussian beam's weight and the second its derivative, and their correlations over a displacement are
hence exp(−δ²/w²) and (1 − 2δ²/w²) exp(−δ²/w²). The lattice lies in the plane of the object's two axes that are most
across the beam; four rows reach less far where none of its axes lies along the beam: the centroid's correlation departs
by 0.01 where one does, by up to 0.05 at 30° and 0.15 at 45°. All other numbers have the energy's correlation, on a
lattice of pitch π w/(2√2) whose numbers are combined with cos(πt/2), sin(πt/2): within 0.03 of exp(−δ²/w²).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.foundation.device_loops import for_each
from scanner_sim.foundation.device_streams import generator
from scanner_sim.foundation.device_types import Float, Int32, UInt32, Vector3f
from scanner_sim.foundation.streams import Seed, Stream

FINE = 0.75
"""Pitch of the lattice of the energy and the centroid, in 1/e² radii of the beam."""
COARSE = math.pi / (2.0 * math.sqrt(2.0))
"""Pitch of the lattice of all other modes."""


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
class LatticePositions:
    """Positions on the lattice of an object, Dr.Jit arrays of shape (m,).

    ``column`` and ``row`` in radii of the beam; ``turn`` what makes of a step on the lattice one along the line and one
    across it, also in radii, as the entries 00, 01, 10 and 11 of a matrix; ``salt`` distinguishes objects.
    """

    column: Float
    row: Float
    turn: tuple[Float, Float, Float, Float]
    salt: UInt32

    @classmethod
    def of(cls, positions: SurfacePoints) -> LatticePositions:
        """Return the positions of beams on the two axes of their objects that are most across them."""
        along = [dr.abs(part) for part in (positions.along.x, positions.along.y, positions.along.z)]
        first = (along[0] > along[1]) & (along[0] > along[2])
        second = ~first & (along[1] > along[2])

        def on_plane(vector: Vector3f) -> tuple[Float, Float]:
            column = dr.select(first, vector.y, dr.select(second, vector.z, vector.x))
            row = dr.select(first, vector.z, dr.select(second, vector.x, vector.y))
            return column, row

        column, row = on_plane(positions.point)
        (a, c), (b, d) = on_plane(positions.across), on_plane(positions.normal)
        over = dr.rcp(a * d - b * c)
        salt = auto.UInt32(positions.object) * 3 + dr.select(first, auto.UInt32(0), dr.select(second, 1, 2))
        scale = dr.rcp(positions.radius)
        return cls(column * scale, row * scale, (d * over, -b * over, -c * over, a * over), salt)


def _address(column: Int32, row: Int32) -> UInt32:
    return auto.UInt32(column & 0xFFFF) | (auto.UInt32(row & 0xFFFF) << 16)


def fine_numbers(lattice: LatticePositions, seed: Seed) -> tuple[Float, Float]:
    """Return normal numbers of the energy and of the centroid: sums of the lattice's under the beam."""
    column, row = lattice.column * (1.0 / FINE), lattice.row * (1.0 / FINE)
    # Four columns come from one call, and two calls reach at least two columns to either side.
    group, top = dr.floor(0.25 * column - 0.5), dr.floor(row) - 1.0
    a, b, c, d = lattice.turn

    def add(number: UInt32, *sums: Float) -> tuple[Any, ...]:
        """Add four columns of a row."""
        block, down = auto.Int32(number & 1), auto.Int32(number >> 1)
        address = _address(auto.Int32(group) + block, auto.Int32(top) + down)
        drawn = generator(seed, Stream.SPECKLE, address, lattice.salt << 8).next_float32x4_normal()
        energy, slope, energies, slopes = sums
        for step in range(4):
            right = (4.0 * (group + auto.Float(block)) + step - column) * FINE
            under = (top + auto.Float(down) - row) * FINE
            along, across = a * right + b * under, c * right + d * under
            weight = dr.exp(-2.0 * (dr.square(along) + dr.square(across)))
            moved = along * weight
            energy, slope = dr.fma(weight, drawn[step], energy), dr.fma(moved, drawn[step], slope)
            energies, slopes = energies + dr.square(weight), slopes + dr.square(moved)
        return energy, slope, energies, slopes

    zero = dr.zeros(auto.Float, dr.width(column))
    energy, slope, energies, slopes = for_each(8, add, zero, zero, zero, zero)
    return energy * dr.rsqrt(energies), slope * dr.rsqrt(slopes)


def coarse_numbers(lattice: LatticePositions, count: int, plane: int, seed: Seed) -> list[Float]:
    """Return independent normal numbers of the other modes, continuous over the surface."""
    nodes = []
    for coordinate in (lattice.column, lattice.row):
        at = coordinate * (1.0 / COARSE)
        node = dr.floor(at)
        nodes.append((auto.Int32(node), *dr.sincos(0.5 * math.pi * (at - node))))
    (column, *across), (row, *down) = nodes
    samples = [(lattice.salt << 8) | auto.UInt32(16 * plane + block) for block in range(-(-count // 4))]

    def add(number: UInt32, totals: list[Any]) -> tuple[Any, ...]:
        """Add one of the four nodes about each position."""
        right, lower = number >> 1, number & 1
        address = _address(column + auto.Int32(right), row + auto.Int32(lower))
        weight = dr.select(right == 1, *across) * dr.select(lower == 1, *down)
        drawn = [
            generator(seed, Stream.SPECKLE, address, sample).next_float32x4_normal() for sample in samples
        ]
        return ([total + weight * auto.Array4f(normal) for total, normal in zip(totals, drawn, strict=True)],)

    (totals,) = for_each(4, add, [dr.zeros(auto.Array4f, dr.width(column)) for _ in samples])
    return [total[component] for total in totals for component in range(4)][:count]
