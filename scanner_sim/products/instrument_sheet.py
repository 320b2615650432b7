"""What an instrument can do, over its ranges: numbers for a table and a drawing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.products.budget import Mode

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class InstrumentSheet:
    """Geometry of an instrument, and closed forms of its errors on a facing target; lengths in metres.

    Attributes
    ----------
    baseline, focal_length, aperture, axis_separation
        Of the triangulation and the mirrors.
    array
        Positions p of the ends of the line sensor.
    array_ends
        Where these are (x, z) from the lens's node, z behind it negative.
    theta, nearest, farthest
        Deflections [rad], and the ranges that the array's ends see there, each of shape (k,); infinite where the array
        sees infinity.
    near, far
        Ranges that the array sees on the axis; ``far`` is infinite where it sees infinity.
    gate
        Ranges that the time-of-flight unit records.
    half_field
        Largest deflection to each side [rad].
    rate
        Voxels per second.
    reflectance
        Of the target that the errors are of.
    range_m
        Ranges, shape (n,), within what the array sees and at most the end of the gate.
    spot_m, pixel_m, lateral_m
        Diameter of the laser's beam (1/e²), change of the range by a pixel, standard deviation across the beam by
        the angles; each of shape (n,).
    image_px
        Standard deviation of the spot on the array [pixel], shape (n,).
    filled
        Charge of the brightest pixel over the full well, shape (n,): from 1 on it is saturated.
    sigma_m
        Standard deviation of the range for each way of ranging that has closed forms and sees the laser, shape (n,);
        NaN where the line is saturated or beyond the gate.
    """

    baseline: float
    focal_length: float
    aperture: float
    axis_separation: float
    array: tuple[float, float]
    array_ends: tuple[tuple[float, float], tuple[float, float]]
    theta: Array
    nearest: Array
    farthest: Array
    near: float
    far: float
    gate: tuple[float, float]
    half_field: float
    rate: float
    reflectance: float
    range_m: Array
    spot_m: Array
    pixel_m: Array
    lateral_m: Array
    image_px: Array
    filled: Array
    sigma_m: Mapping[Mode, Array]
