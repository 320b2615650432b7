"""What an instrument can do, by closed forms alone."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic.beam import beam_radius
from scanner_sim.config.scanner import RangefinderName, Scanner
from scanner_sim.config.scenario import Scenario
from scanner_sim.products.budget import Mode
from scanner_sim.products.instrument_sheet import InstrumentSheet, LineSheet
from scanner_sim.validation.compare.closed_forms import ClosedForms
from scanner_sim.validation.compare.instrument import closed_budget
from scanner_sim.validation.studies.budget import NEAREST

Array = NDArray[np.float64]

REFLECTANCE = 0.5
"""Of the target that the errors are of: Lambertian, facing."""
_DEEPEST = 20.0
"""Farthest range over the nearest one for an array that sees infinity, without a gate."""
_DEFLECTIONS = 181
_MODES: tuple[Mode, ...] = ("triangulation", "tof", "fused")


def alone(scanner: Scanner) -> Scenario:
    """Return the scenario of an instrument alone: in the dark, its beam at rest, all else the defaults."""
    still = {"rows": 1, "columns": 1, "horizontal": (0.0, 0.0), "vertical": (0.0, 0.0), "motion": "stepped"}
    return Scenario.model_validate({"schema": 1, "scanner": scanner, "scan": still})


def instrument_sheet(scanner: Scanner, count: int = 60) -> InstrumentSheet:
    """Return what an instrument can do by itself, as :func:`alone` has it.

    Parameters
    ----------
    scanner
        The instrument.
    count
        Ranges, evenly spaced in logarithms over what it sees; an array that sees infinity is followed to the end of the
        gate, or without time of flight to 20 times its nearest range.
    """
    scenario = alone(scanner)
    seen = {name: scanner.seen_by(name) for name in scanner.rangefinders}
    ranges, half = _ranges(seen, count), scanner.mirrors.max_deflection
    theta = np.linspace(-half, half, _DEFLECTIONS)
    line = _line(scenario, ranges, theta) if "triangulation" in seen else None
    found = [closed_budget(scenario, REFLECTANCE, float(R)) for R in ranges]
    limits = _limits(ranges, line, seen.get("tof"))
    sigma = {
        mode: np.where(limits[mode], np.array([one[mode]["all"] for one in found]), math.nan)
        for mode in _MODES
        if all(mode in one for one in found)
    }
    laser, lidar = scanner.laser, scanner.lidar_choice
    beam = laser.waist_radius, laser.waist_distance, laser.wavelength, laser.m_squared
    return InstrumentSheet(
        baseline=scanner.receiver.baseline,
        focal_length=scanner.receiver.focal_length,
        aperture=scanner.receiver.aperture,
        line=line,
        diode_field=None if lidar == "none" else lidar.photodiode.field_of_view,
        seen={mode: seen[mode] for mode in seen},
        theta=theta,
        rate=scanner.rate,
        reflectance=REFLECTANCE,
        range_m=ranges,
        spot_m=2.0 * beam_radius(ranges, *beam),
        lateral_m=ClosedForms(scenario).angle_sigma * ranges,
        sigma_m={mode: values for mode, values in sigma.items() if np.isfinite(values).any()},
    )


def _ranges(seen: Mapping[RangefinderName, tuple[float, float]], count: int) -> Array:
    """Return ranges over what an instrument sees [m]."""
    near, far = next(iter(seen.values()))
    end = seen["tof"][1] if "tof" in seen else _DEEPEST * near
    return np.geomspace(near or NEAREST, min(far, max(end, 2.0 * near)), count)


def _line(scenario: Scenario, ranges: Array, theta: Array) -> LineSheet:
    """Return the sheet of the line sensor, over ranges [m] and deflections [rad]."""
    scanner, forms = scenario.scanner, ClosedForms(scenario)
    sensor = scanner.position_sensor
    ends = sensor.offset, sensor.offset + sensor.length
    spots = [forms.facing(float(R), REFLECTANCE) for R in ranges]
    brightest = np.array([seen.line.max() for seen in spots])
    return LineSheet(
        ends=(_behind_lens(forms, ends[0]), _behind_lens(forms, ends[1])),
        nearest=forms.array.range(ends[1], theta),
        farthest=forms.array.range(ends[0], theta) if ends[0] > 0.0 else np.full_like(theta, math.inf),
        pixel_m=np.array([forms.range_per_pixel(float(R)) for R in ranges]),
        image_px=np.array([seen.sigma for seen in spots]),
        filled=scanner.exposure / scanner.dwell * brightest / sensor.full_well,
    )


def _behind_lens(forms: ClosedForms, position: float) -> tuple[float, float]:
    """Return where a position on the array is, (x, z) from the lens's node [m]."""
    x, depth = forms.array.origin + position * forms.array.direction
    return float(x), -float(depth)


def _limits(
    ranges: Array, line: LineSheet | None, gate: tuple[float, float] | None
) -> dict[Mode, NDArray[np.bool_]]:
    """Return at which ranges each way of ranging measures: where no pixel is full, in the gate, and in both."""
    low, high = (0.0, math.inf) if gate is None else gate
    recorded = (ranges >= low) & (ranges <= high)
    seen = recorded if line is None else line.filled < 1.0
    return {"triangulation": seen, "tof": recorded, "fused": seen & recorded}
