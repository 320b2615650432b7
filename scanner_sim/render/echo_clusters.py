"""Many returns of a pulse gathered into a few Gaussian echoes along the path, with exact power, mean and variance."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from scanner_sim.render.clusters import lit_extent

_LEAST_EXTENT = 1e-6
"""Extent of a shot's paths [m] below which they are one."""


def gather_echoes(
    share: Any, path: Any, spread: Any, places: Any, count: int, clusters: int
) -> tuple[Any, Any, Any]:
    """Gather the returns of each shot into echoes.

    Parameters
    ----------
    share, path, spread
        Share of the pulse's power, path [m] and its standard deviation [m] of every return; entry i · count + j is
        return j of shot i.
    places
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
    first_return = places * count

    def one(number: Any) -> tuple[Any, Any, Any]:
        at = first_return + number
        power, way, sigma = (dr.gather(mi.Float, values, at) for values in (share, path, spread))
        return power, way, sigma

    low, extent = lit_extent(one, dr.width(places), count)
    width = dr.maximum(extent / clusters, _LEAST_EXTENT)
    sums = tuple(dr.alloc_local(mi.Float, clusters, mi.Float(0.0)) for _ in range(3))

    def add(number: Any, *sums: Any) -> tuple[Any, ...]:
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
