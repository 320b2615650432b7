"""Laws in the rows of a pose study: how errors grow, and what a method gains over points alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from scanner_sim.products.pose_study import Exponent, Gain, PoseRow

Array = NDArray[np.float64]

PRINTED = {"uv": 1.0, "xyz": 1.5}
"""Exponents of range that the paper reads from Figure 15, of no named component."""
COMPARED = (5.0, 10.0, 20.0)
"""Ranges of the gains [m]."""
_NORMAL_95 = 1.959964


def exponents_of(
    rows: Sequence[PoseRow], base: str, base_size: float, reference: float
) -> tuple[Exponent, ...]:
    """Return the exponents of range, of size and of the number of targets.

    Parameters
    ----------
    rows
        With their closed forms.
    base, base_size
        Layout that is compared at several sizes, and its main size [m].
    reference
        Range at which sizes and numbers are compared [m].

    Returns
    -------
    tuple of Exponent
        Range: for each array, method and component, over all ranges. Size: squares at the reference range. Number:
        circles of one size there.
    """
    near = [row for row in rows if abs(row.range_m - reference) < 1e-6 * reference]
    found: list[Exponent] = []
    for own in _groups(rows, lambda row: (row.array, row.size_m, *row.mode, row.component)):
        printed = PRINTED.get(own[0].method, math.nan)
        if own[0].ranging == "tof":
            printed = math.nan
        found += _fitted("range", own, [row.range_m for row in own], printed)
    squares = [row for row in near if row.array == base]
    for own in _groups(squares, lambda row: (*row.mode, row.component)):
        found += _fitted("size", own, [row.size_m for row in own], math.nan)
    circles = [row for row in near if row.array.startswith("circle") and row.size_m == base_size]
    for own in _groups(circles, lambda row: (*row.mode, row.component)):
        found += _fitted("targets", own, [float(row.targets) for row in own], math.nan)
    return tuple(found)


def power_law(x: Array, y: Array, relative: Array) -> tuple[float, float]:
    """Return the exponent of y ∝ x^k and its standard error.

    Parameters
    ----------
    x, y
        Positive numbers, shape (n,), n ≥ 3.
    relative
        Relative standard errors of y, shape (n,).

    Returns
    -------
    tuple of float
        Of the line through (log x, log y) by weighted least squares; the standard error is widened by √(χ²/(n − 2))
        where that is above 1: then y is no power of x, and the exponent a mean slope.
    """
    weight = 1.0 / relative**2
    across, up = np.log(x), np.log(y)
    middle = np.average(across, weights=weight)
    moment = float(np.sum(weight * (across - middle) ** 2))
    slope = float(np.sum(weight * (across - middle) * up) / moment)
    rest = up - np.average(up, weights=weight) - slope * (across - middle)
    misfit = float(np.sum(weight * rest**2)) / (len(x) - 2)
    return slope, math.sqrt(max(misfit, 1.0) / moment)


def gains_of(rows: Sequence[PoseRow], base: str, base_size: float) -> tuple[Gain, ...]:
    """Return what angles alone and both together gain over points, for the base array at 5, 10 and 20 m."""
    own = {
        (round(row.range_m, 6), *row.mode, row.component): row
        for row in rows
        if row.array == base and row.size_m == base_size
    }
    found = []
    for (distance, method, ranging, component), points in own.items():
        if method != "xyz" or distance not in COMPARED or not points.simulated > 0.0:
            continue
        for better, source in (("uv", "none"), ("joint", ranging)):
            row = own[(distance, better, source, component)]
            gain = points.simulated / row.simulated
            error = gain * math.hypot(_relative(points), _relative(row))
            closed = points.analytic / row.analytic, points.voxel / row.voxel
            found.append(Gain(distance, ranging, better, component, gain, error, *closed))
    return tuple(found)


def _groups(rows: Sequence[PoseRow], key: object) -> Iterator[list[PoseRow]]:
    """Yield the rows alike in a key, in the order of their first."""
    sorted_out: dict[object, list[PoseRow]] = {}
    for row in rows:
        sorted_out.setdefault(key(row), []).append(row)  # type: ignore[operator]
    yield from sorted_out.values()


def _relative(row: PoseRow) -> float:
    return (math.log(row.high) - math.log(row.low)) / (2.0 * _NORMAL_95)


def _fitted(of: str, own: Sequence[PoseRow], steps: Sequence[float], printed: float) -> Iterator[Exponent]:
    """Yield the exponent over rows that have an error, where they are three or more."""
    known = [
        (step, row) for step, row in zip(steps, own, strict=True) if row.simulated > 0.0 and row.low > 0.0
    ]
    if len({step for step, _ in known}) < 3:
        return
    x = np.array([step for step, _ in known])
    rows = [row for _, row in known]
    relative = np.array([_relative(row) for row in rows])
    slope, error = power_law(x, np.array([row.simulated for row in rows]), relative)
    closed = [
        power_law(x, np.array([getattr(row, name) for row in rows]), relative)[0]
        for name in ("analytic", "constant")
    ]
    first = rows[0]
    yield Exponent(
        of=of,
        array="circle" if of == "targets" else first.array,
        size_m=math.nan if of == "size" else first.size_m,
        range_m=math.nan if of == "range" else first.range_m,
        method=first.method,
        ranging=first.ranging,
        component=first.component,
        simulated=slope,
        standard_error=error,
        analytic=closed[0],
        constant=closed[1],
        printed=printed,
    )
