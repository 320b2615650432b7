"""An edge-avoiding filter for light that varies slowly over a surface.

À-trous wavelets with the weights ¼, ½, ¼ (after Dammertz, Sewtz, Hanika, Lensch, *High Performance Graphics* 2010); a
neighbour counts only where it has the same material, a like normal and lies in the tangent plane. Weights come from the
geometry alone, so the filter is linear in the light; each half of a picture is compared by its own rays' geometry,
so that the halves stay independent.

Not modelled: a change of the light over one surface within the filter's reach: a standard
deviation of 7 columns, 15 at most.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_types import Float, Mask, UInt32, Vector2f
from scanner_sim.render.background.paths import FirstHit
from scanner_sim.render.background.view import counted

_STRIDES = (1, 2, 4, 8)
"""Wider ones blur more than they smooth: on a Space Station Node what they add is as large as the noise."""
_NORMAL_TOLERANCE = 0.02
"""Departure of the normals' cosine from 1 at which a neighbour's weight falls to 1/e."""
_PLANE_TOLERANCE = 0.05
"""Distance from the tangent plane, as a share of the neighbour's distance, at which it falls to 1/e."""
_WEIGHTS_PER_KERNEL = 64
"""Weights of a convolution that one kernel takes."""


@dataclass
class Features:
    """What neighbours are compared by, Dr.Jit arrays of four numbers for each entry row · columns + column.

    ``kind`` the normal of the first surface and the number of its material (0 for none), ``point`` its point and 0:
    four numbers that lie together are read at once.
    """

    kind: Float
    point: Float

    @classmethod
    def empty(cls, size: int) -> Features:
        """Return room for the features of some entries."""
        return cls(dr.empty(mi.Float, 4 * size), dr.empty(mi.Float, 4 * size))

    def put(self, first: FirstHit, at: UInt32, inside: Mask) -> None:
        """Take surfaces for the entries ``at``, of those lanes that are inside."""
        dr.scatter(self.kind, mi.Vector4f(*first.normal, mi.Float(first.material)), at, inside)
        dr.scatter(self.point, mi.Vector4f(*first.point, 0.0), at, inside)


def smooth(
    layers: list[Float], features: Features, rows: int, columns: int, rows_per_column: float
) -> list[Float]:
    """Filter two layers of a picture, each of shape (rows · columns,), over like neighbours.

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
    light = dr.ravel(mi.Vector2f(*layers))
    dr.eval(light)
    for stride in _STRIDES:
        found = _filter_pass(light, features, rows, columns, (int(stride * rows_per_column), stride))
        light = dr.ravel(found)
        dr.eval(light)
    lane = dr.arange(mi.UInt32, rows * columns)
    found = dr.gather(mi.Vector2f, light, lane)
    return [found.x, found.y]


def _filter_pass(
    light: Float, features: Features, rows: int, columns: int, stride: tuple[int, int]
) -> Vector2f:
    lane = dr.arange(mi.UInt32, rows * columns)
    width, height = counted(columns), counted(rows, mi.Int32)
    row, column, width = mi.Int32(lane // width), mi.Int32(lane % width), mi.Int32(width)
    own_kind, own_point = (dr.gather(mi.Vector4f, part, lane) for part in (features.kind, features.point))
    normal = mi.Vector3f(own_kind.x, own_kind.y, own_kind.z)
    point = mi.Vector3f(own_point.x, own_point.y, own_point.z)
    step_down, step_right = (dr.opaque(mi.Int32, step) for step in stride)
    total = mi.Float(0.25)
    result: Vector2f = 0.25 * dr.gather(mi.Vector2f, light, lane)
    # Where the stride reaches no other row, the three rows of weights stand for one.
    weights = {-1: 0.25, 0: 0.5, 1: 0.25} if stride[0] else {0: 0.5}
    for down, weight_down in weights.items():
        for right, weight_right in {-1: 0.25, 0: 0.5, 1: 0.25}.items():
            if (down, right) == (0, 0):
                continue
            y, x = row + down * step_down, column + right * step_right
            inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
            at = mi.UInt32(dr.select(inside, y * width + x, mi.Int32(lane)))
            kind, met = (dr.gather(mi.Vector4f, part, at) for part in (features.kind, features.point))
            away = mi.Vector3f(met.x, met.y, met.z) - point
            turned = (1.0 - dr.dot(normal, mi.Vector3f(kind.x, kind.y, kind.z))) / _NORMAL_TOLERANCE
            lifted = dr.abs(dr.dot(normal, away)) / (_PLANE_TOLERANCE * dr.norm(away) + 1e-6)
            weight: Float = weight_down * weight_right * dr.exp(-turned - lifted)
            weight = dr.select(inside & (kind.w == own_kind.w), weight, 0.0)
            total += weight
            result += weight * dr.gather(mi.Vector2f, light, at)
    return result / total


def convolve_rows(layers: list[Float], columns: int, weights: NDArray[np.float64]) -> list[Float]:
    """Convolve each row of layers with an odd number of symmetric weights; ends are repeated."""
    reach = len(weights) // 2
    # Each pitch has weights of its own: they are no part of the kernels.
    table = [dr.opaque(mi.Float, float(weight)) for weight in weights]
    if not reach:
        return [table[0] * layer for layer in layers]
    lane = dr.arange(mi.UInt32, dr.width(layers[0]))
    column, last = mi.Int32(lane % counted(columns)), counted(columns - 1, mi.Int32)
    start = mi.Int32(lane) - column
    sums = [mi.Float(0.0) for _ in layers]
    for number, weight in enumerate(table):
        at = mi.UInt32(start + dr.clip(column + (number - reach), 0, last))
        for index, layer in enumerate(layers):
            sums[index] += weight * dr.gather(mi.Float, layer, at)
        # Fine pixels have thousands of weights: one kernel of all would take minutes to compile.
        if number % _WEIGHTS_PER_KERNEL == _WEIGHTS_PER_KERNEL - 1:
            dr.eval(sums)
    dr.eval(sums)
    return sums
