"""What the photodiode sees of a pulse: many returns gathered into a few Gaussian echoes along the path.

Power, mean and variance of the returns are kept exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from scanner_sim.foundation.device_types import Float, Mask, UInt32, Vector3f
from scanner_sim.optics.deflection import Frame
from scanner_sim.render.beam.clusters import lit_extent

_LEAST_EXTENT = 1e-6
"""Extent of a shot's paths [m] below which they are one."""


@dataclass(frozen=True)
class PhotodiodeView:
    """How the photodiode looks at the scene.

    Attributes
    ----------
    offset
        Whether its lens is the one at the triangulation base; else it looks along the laser.
    field_of_view
        Full angle of its round field [rad]. On the laser's axis the field is centred on the beam; beside it the field
        reaches from infinity inwards, and what is nearer than base/tan(angle) is not seen.
    """

    offset: bool
    field_of_view: float

    def frame(self, frame: Frame) -> Frame:
        """Return the deflected optics with the photodiode's lens instead of the position sensor's."""
        return frame if self.offset else frame._replace(lens=frame.laser)

    def sees(self, frame: Frame, point: Vector3f) -> Mask:
        """Return whether points lie in the field; ``frame`` is that of :meth:`frame`."""
        offset = mi.Vector3f(point - frame.lens)
        depth = dr.dot(offset, frame.along)
        half = dr.opaque(mi.Float, math.tan(0.5 * self.field_of_view))
        aside = -dr.dot(offset, frame.across) - (half * depth if self.offset else 0.0)
        above = dr.dot(offset, frame.normal)
        return (depth > 0.0) & (dr.square(aside) + dr.square(above) <= dr.square(half * depth))


@dataclass
class Echoes:
    """Echoes of m shots, c Gaussians each, Dr.Jit arrays: entry k · m + j is echo k of shot j.

    ``index`` and ``shot``: index in the batch and number of each shot, shape (m,). ``share`` of the pulse's power that
    reaches the photodiode; ``path`` there and back [m], from the shot's ``reference`` (m,); its standard deviation
    ``spread`` [m].
    """

    index: UInt32
    shot: UInt32
    share: Float
    path: Float
    spread: Float
    reference: Float

    def join(self, other: Echoes) -> Echoes:
        """Return the echoes of both, which must be of the same shots and references."""
        return Echoes(
            self.index,
            self.shot,
            dr.concat((self.share, other.share)),
            dr.concat((self.path, other.path)),
            dr.concat((self.spread, other.spread)),
            self.reference,
        )

    def part(self, indices: UInt32) -> Echoes:
        """Return the echoes of some shots only, by their indices."""
        m, some = dr.width(self.index), dr.width(indices)
        lane = dr.arange(mi.UInt32, dr.width(self.share) // m * some)
        at = (lane // some) * m + dr.gather(mi.UInt32, indices, lane % some)
        part = Echoes(
            dr.gather(mi.UInt32, self.index, indices),
            dr.gather(mi.UInt32, self.shot, indices),
            dr.gather(mi.Float, self.share, at),
            dr.gather(mi.Float, self.path, at),
            dr.gather(mi.Float, self.spread, at),
            dr.gather(mi.Float, self.reference, indices),
        )
        dr.eval(part)
        return part


def gather_echoes(
    share: Float, path: Float, spread: Float, indices: UInt32, count: int, clusters: int
) -> tuple[Float, Float, Float]:
    """Gather the returns of each shot into echoes.

    Parameters
    ----------
    share, path, spread
        Share of the pulse's power, path [m] and its standard deviation [m] of every return; entry i · count + j is
        return j of shot i.
    indices
        The m shots that are wanted, shape (m,).
    count
        Returns of each shot.
    clusters
        Number c of echoes; each covers an equal part of the extent of the shot's lit paths.

    Returns
    -------
    tuple
        Share, path [m] and spread [m] of the echoes, shape (c · m,): entry k · m + j is echo k of shot j. Power, mean
        and variance of the returns in each are kept exactly.
    """
    first_return = indices * count

    def one(number: UInt32) -> tuple[Float, Float, Float]:
        at = first_return + number
        power, way, sigma = (dr.gather(mi.Float, values, at) for values in (share, path, spread))
        return power, way, sigma

    low, extent = lit_extent(one, dr.width(indices), count)
    width = dr.maximum(extent / clusters, _LEAST_EXTENT)
    sums = tuple(dr.alloc_local(mi.Float, clusters, mi.Float(0.0)) for _ in range(3))

    def add(number: UInt32, *sums: Any) -> tuple[Any, ...]:
        power, way, sigma = one(number)
        slot = mi.UInt32(dr.clip((way - low) / width, 0.0, clusters - 1.0))
        # Moments about the middle of the cluster: about a far origin the variance would drown in rounding.
        apart = way - (low + (mi.Float(slot) + 0.5) * width)
        values = (power, power * apart, power * (dr.square(apart) + dr.square(sigma)))
        for total, value in zip(sums, values, strict=True):
            total.write(total.read(slot) + dr.select(power > 0.0, value, 0.0), slot)
        return number + 1, *sums

    state: Any = (mi.UInt32(0), *sums)
    found: Any = dr.while_loop(state, lambda number, *sums: number < count, add)[1:]
    shares, paths, spreads = [], [], []
    for slot in range(clusters):
        total, first, second = (values.read(mi.UInt32(slot)) for values in found)
        lit = total > 0.0
        mean = dr.select(lit, first / total, 0.0)
        shares.append(total)
        paths.append(dr.select(lit, low + (slot + 0.5) * width + mean, 0.0))
        spreads.append(dr.select(lit, dr.sqrt(dr.maximum(second / total - dr.square(mean), 0.0)), 0.0))
    dr.eval(shares, paths, spreads)
    return dr.concat(shares), dr.concat(paths), dr.concat(spreads)
