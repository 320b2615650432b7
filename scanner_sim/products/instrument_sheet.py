"""What an instrument can do, over its ranges: numbers for a table and a drawing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.products.budget import Mode

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LineSheet:
    """The line sensor of an instrument; lengths in metres, arrays over the deflections and ranges of its sheet.

    Attributes
    ----------
    ends
        Where its ends are (x, z) from the lens's node, z behind it negative: the far end first.
    nearest, farthest
        Ranges that its ends see over the deflections, each of shape (k,); infinite where it sees infinity.
    pixel_m
        Change of the range by a pixel, shape (n,).
    image_px
        Standard deviation of the spot on the array [pixel], shape (n,).
    filled
        Charge of the brightest pixel over the full well, shape (n,): from 1 on it is saturated.
    """

    ends: tuple[tuple[float, float], tuple[float, float]]
    nearest: Array
    farthest: Array
    pixel_m: Array
    image_px: Array
    filled: Array


@dataclass(frozen=True, eq=False)
class InstrumentSheet:
    """Geometry of an instrument, and closed forms of its errors on a facing target; lengths in metres.

    Attributes
    ----------
    baseline, focal_length, aperture
        Of the receiver.
    line
        The line sensor; None without one.
    diode_field
        Full angle that the photodiode sees [rad]; None without a time-of-flight unit.
    seen
        Nearest and farthest range on the axis by each way of ranging: what the array sees, infinite where it sees
        infinity, and what the time-of-flight unit records.
    theta
        Deflections from one end of the field to the other [rad], shape (k,).
    rate
        Voxels per second.
    reflectance
        Of the target that the errors are of.
    range_m
        Ranges, shape (n,), within what is seen.
    spot_m, lateral_m
        Diameter of the laser's beam (1/e²), standard deviation across the beam by the angles; each of shape (n,).
    sigma_m
        Standard deviation of the range for each way of ranging that has closed forms and sees the laser, shape (n,);
        NaN where the line is saturated or beyond the gate.
    """

    baseline: float
    focal_length: float
    aperture: float
    line: LineSheet | None
    diode_field: float | None
    seen: Mapping[Mode, tuple[float, float]]
    theta: Array
    rate: float
    reflectance: float
    range_m: Array
    spot_m: Array
    lateral_m: Array
    sigma_m: Mapping[Mode, Array]

    @property
    def depth(self) -> tuple[float, float]:
        """Nearest and farthest range on the axis of the line sensor, or of time of flight without one."""
        return next(iter(self.seen.values()))

    @property
    def half_field(self) -> float:
        """Largest deflection to each side [rad]."""
        return float(self.theta[-1])
