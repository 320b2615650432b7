"""Random numbers that belong to positions on surfaces, for the speckle under a beam.

White noise stands on a lattice over each surface, in the frame of the object and in units of the beam's radius there.
Its sums under exp(−2δ²/w²) are the energy's number, those under δ exp(−2δ²/w²), with δ along the line, the centroid's:
the first is a Gaussian beam's weight and the second its derivative, and their correlations over a displacement are
hence exp(−δ²/w²) and (1 − 2δ²/w²) exp(−δ²/w²). The lattice lies in the plane of the object's two axes that are most
across the beam. All other numbers have the energy's correlation, on a lattice of pitch π w/(2√2) whose numbers are
combined with cos(πt/2), sin(πt/2): within 0.03 of exp(−δ²/w²).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import drjit as dr
import drjit.auto.ad as auto

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
    sums = [auto.Float(0.0) for _ in range(4)]
    a, b, c, d = lattice.turn
    for down in range(4):
        for block in range(2):
            address = _address(auto.Int32(group) + block, auto.Int32(top) + down)
            drawn = generator(seed, Stream.SPECKLE, address, lattice.salt << 8).next_float32x4_normal()
            for step in range(4):
                right = (4.0 * (group + block) + step - column) * FINE
                under = (top + down - row) * FINE
                along, across = a * right + b * under, c * right + d * under
                weight = dr.exp(-2.0 * (dr.square(along) + dr.square(across)))
                moved = along * weight
                sums[0] = dr.fma(weight, drawn[step], sums[0])
                sums[1] = dr.fma(moved, drawn[step], sums[1])
                sums[2] += dr.square(weight)
                sums[3] += dr.square(moved)
    return sums[0] * dr.rsqrt(sums[2]), sums[1] * dr.rsqrt(sums[3])


def coarse_numbers(lattice: LatticePositions, count: int, plane: int, seed: Seed) -> list[Float]:
    """Return independent normal numbers of the other modes, continuous over the surface."""
    nodes = []
    for coordinate in (lattice.column, lattice.row):
        at = coordinate * (1.0 / COARSE)
        node = dr.floor(at)
        sine, cosine = dr.sincos(0.5 * math.pi * (at - node))
        nodes.append(((auto.Int32(node), cosine), (auto.Int32(node) + 1, sine)))
    found: list[Float] = []
    for block in range(0, count, 4):
        total = auto.Array4f(0.0)
        for column, across in nodes[0]:
            for row, down in nodes[1]:
                sample = (lattice.salt << 8) | auto.UInt32(16 * plane + block // 4)
                drawn = generator(seed, Stream.SPECKLE, _address(column, row), sample).next_float32x4_normal()
                total += across * down * auto.Array4f(drawn)
        found += [total[component] for component in range(4)]
    return found[:count]
