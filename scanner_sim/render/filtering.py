"""An edge-avoiding filter for light that varies slowly over a surface.

À-trous wavelets with B3-spline weights (Dammertz, Sewtz, Hanika, Lensch, *High Performance Graphics* 2010); a
neighbour counts only where it has the same material, a like normal and lies in the tangent plane. Weights come from the
geometry alone, so the filter is linear in the light and the two halves of a picture stay independent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

_SPLINE = (1.0 / 16.0, 1.0 / 4.0, 3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0)
_STRIDES = (1, 2, 4, 8, 16)
_LIKE_NORMAL = 0.02
"""Departure of the normals' cosine from 1 at which a neighbour's weight falls to 1/e."""
_IN_PLANE = 0.05
"""Distance from the tangent plane, as a share of the neighbour's distance, at which it falls to 1/e."""


@dataclass
class Features:
    """What neighbours are compared by, Dr.Jit arrays: entry row · columns + column.

    ``material`` number of the first surface (0 for none), its ``normal`` and ``point``, three arrays each.
    """

    material: Any
    normal: list[Any]
    point: list[Any]

    def put(self, first: Any, samples: int, at: Any) -> None:
        """Take the first of every ``samples`` neighbouring rays' surfaces, for the entries ``at``."""
        lane = dr.arange(mi.UInt32, dr.width(at)) * samples
        dr.scatter(self.material, dr.gather(mi.UInt32, first.material, lane), at)
        for target, source in ((self.normal, first.normal), (self.point, first.point)):
            for axis in range(3):
                dr.scatter(target[axis], dr.gather(mi.Float, source[axis], lane), at)


def smooth(
    layers: list[Any], features: Features, rows: int, columns: int, rows_per_column: float
) -> list[Any]:
    """Filter layers of a picture, each of shape (rows · columns,), over like neighbours.

    Parameters
    ----------
    layers
        Light; all are filtered with the same weights.
    features
        Geometry of every entry.
    rows, columns
        Size of the picture.
    rows_per_column
        Angle of a column over that of a row: where rows lie far apart, the filter reaches over fewer of them.
    """
    for stride in _STRIDES:
        layers = _pass(layers, features, rows, columns, (int(stride * rows_per_column), stride))
        dr.eval(layers)
    return layers


def _pass(
    layers: list[Any], features: Features, rows: int, columns: int, stride: tuple[int, int]
) -> list[Any]:
    lane = dr.arange(mi.UInt32, rows * columns)
    row, column = mi.Int32(lane // columns), mi.Int32(lane % columns)
    material = features.material
    normal, point = mi.Vector3f(*features.normal), mi.Vector3f(*features.point)
    step_down, step_right = (dr.opaque(mi.Int32, step) for step in stride)
    total = mi.Float(0.0)
    sums: list[Any] = [mi.Float(0.0) for _ in layers]
    splines = (_SPLINE if stride[0] else (0.0, 0.0, 1.0, 0.0, 0.0)), _SPLINE
    for down, weight_down in enumerate(splines[0], -2):
        if weight_down == 0.0:
            continue
        for right, weight_right in enumerate(splines[1], -2):
            y, x = row + down * step_down, column + right * step_right
            inside = (y >= 0) & (y < rows) & (x >= 0) & (x < columns)
            at = mi.UInt32(dr.select(inside, y * columns + x, mi.Int32(lane)))
            other = mi.Vector3f(*(dr.gather(mi.Float, part, at) for part in features.normal))
            away = mi.Vector3f(*(dr.gather(mi.Float, part, at) for part in features.point)) - point
            alike = inside & (dr.gather(mi.UInt32, material, at) == material)
            turned = (1.0 - dr.dot(normal, other)) / _LIKE_NORMAL
            lifted = dr.abs(dr.dot(normal, away)) / (_IN_PLANE * dr.norm(away) + 1e-6)
            weight: Any = weight_down * weight_right * dr.exp(-turned - lifted)
            weight = dr.select(alike, weight, 0.0) if (down, right) != (0, 0) else weight_down * weight_right
            total += weight
            for number, layer in enumerate(layers):
                sums[number] += weight * dr.gather(mi.Float, layer, at)
    return [value / total for value in sums]


def blurred(layers: list[Any], columns: int, spread: float) -> list[Any]:
    """Blur each row of layers with a Gaussian of standard deviation ``spread`` [columns]; ends are repeated."""
    if spread <= 0.0:
        return layers
    reach = math.ceil(3.5 * spread)
    weights = [math.exp(-0.5 * (step / spread) ** 2) for step in range(-reach, reach + 1)]
    lane = dr.arange(mi.UInt32, dr.width(layers[0]))
    column = mi.Int32(lane % columns)
    start = mi.Int32(lane) - column
    sums = [mi.Float(0.0) for _ in layers]
    for step, weight in enumerate(weights, -reach):
        at = mi.UInt32(start + dr.clip(column + step, 0, columns - 1))
        for number, layer in enumerate(layers):
            sums[number] += (weight / sum(weights)) * dr.gather(mi.Float, layer, at)
    dr.eval(sums)
    return sums
