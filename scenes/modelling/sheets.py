"""Thermal blankets: the shapes of sheets that are tied down, quilted and creased."""

from __future__ import annotations

import numpy as np

from modelling.solids import Array, Surface


def flat(width: float, height: float) -> Surface:
    """Rectangle in the plane z = 0 about the origin, facing −z."""

    def surface(u: Array, v: Array) -> tuple[Array, Array]:
        points = np.stack([(u - 0.5) * width, (v - 0.5) * height, np.zeros_like(u)], axis=-1)
        return points, np.broadcast_to([0.0, 0.0, -1.0], points.shape)

    return surface


def cone(
    start: float, end: float, inner: tuple[float, float], outer: tuple[float, float], margin: float = 0.0
) -> Surface:
    """Sector of a cone about z between two angles (radians) and two (radius, z) circles.

    ``margin`` is kept free at both straight edges, metres, so that a seam has the same width throughout.
    A cylinder is the cone whose radii are equal.
    """
    (r0, z0), (r1, z1) = inner, outer
    slope = np.hypot(r1 - r0, z1 - z0)
    radial, forward = (z1 - z0) / slope, -(r1 - r0) / slope

    def surface(u: Array, v: Array) -> tuple[Array, Array]:
        radius = r0 + (r1 - r0) * v
        spare = margin / radius
        angle = start + spare + (end - start - 2.0 * spare) * u
        cos, sin = np.cos(angle), np.sin(angle)
        points = np.stack([radius * cos, radius * sin, z0 + (z1 - z0) * v], axis=-1)
        normals = np.stack([radial * cos, radial * sin, np.full_like(cos, forward)], axis=-1)
        return points, normals

    return surface


def blanket(columns: int, rows: int, quilts: tuple[int, int], loft: float, crease: float, seed: int) -> Array:
    """Height (rows, columns) of a quilted, creased blanket above its support, metres.

    Pillows between tie-downs, ``quilts`` of them across and down, ``loft`` high; sharp-crested creases of
    height ``crease`` in random directions on top. The edge lies down.
    """
    rng = np.random.default_rng(seed)
    v, u = np.meshgrid(np.linspace(0.0, 1.0, rows), np.linspace(0.0, 1.0, columns), indexing="ij")
    across, down = quilts
    warp_u = u + 0.03 * np.sin(2.0 * np.pi * (1.3 * v + rng.random()))
    warp_v = v + 0.03 * np.sin(2.0 * np.pi * (1.1 * u + rng.random()))
    pillow = np.sqrt(np.abs(np.sin(np.pi * across * u) * np.sin(np.pi * down * v)))
    creases = np.zeros_like(u)
    for octave in range(6):
        direction = 2.0 * np.pi * rng.random()
        pitch = (1.5 + 0.9 * octave) * max(quilts)
        phase = pitch * (np.cos(direction) * warp_u + np.sin(direction) * warp_v) + 2.0 * np.pi * rng.random()
        envelope = 0.5 + 0.5 * np.sin(2.0 * np.pi * (u * rng.random() + v * rng.random() + rng.random()))
        creases += envelope * (1.0 - np.abs(np.sin(phase))) ** 2 / (1.0 + 0.35 * octave)
    edge = np.minimum(np.minimum(u, 1.0 - u) * columns, np.minimum(v, 1.0 - v) * rows) / 2.5
    return np.minimum(edge, 1.0) * (loft * pillow + crease * creases) + 0.004


def panel(columns: int, rows: int, thickness: float, bevel: float) -> Array:
    """Height (rows, columns) of a flat panel with its outermost vertices lowered by ``bevel``, metres."""
    height = np.full((rows, columns), thickness)
    height[[0, -1], :] -= bevel
    height[1:-1, [0, -1]] -= bevel
    return height
