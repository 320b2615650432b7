"""All laws, in the order in which they are judged."""

from __future__ import annotations

from typing import Final

from scanner_sim.validation.compare import (
    constant_error,
    coverage,
    departures,
    light,
    noise,
    pulses,
    shape,
    speckle,
    targets,
    true_ranges,
    uneven,
)
from scanner_sim.validation.compare import point_errors as field
from scanner_sim.validation.compare import time_walk as walk
from scanner_sim.validation.compare.law import Law

LAWS: Final[tuple[Law, ...]] = (
    true_ranges.TRUE_RANGES,
    shape.SPOT_POSITION,
    shape.SPOT_WIDTH,
    shape.LINK_BUDGET,
    light.SUNLIGHT,
    light.SNR,
    light.SATURATION,
    field.POINTS,
    constant_error.SYNCHRONISATION,
    speckle.CONTRAST,
    speckle.LIMIT,
    noise.SHOT,
    noise.READ,
    noise.BOUND,
    departures.DEPARTURES,
    field.COVARIANCE,
    coverage.COVERAGE,
    uneven.UNEVEN,
    pulses.TOF_RANGE,
    pulses.TOF_BOUND,
    pulses.TOF_SIGMA,
    coverage.TOF_COVERAGE,
    walk.TOF_WALK,
    targets.CENTROID,
    targets.POSE,
)
"""What a comparison judges."""
