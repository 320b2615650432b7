"""What an instrument can do, by closed forms alone."""

from __future__ import annotations

import math

import numpy as np

from scanner_sim.analytic.beam import beam_radius
from scanner_sim.config.scanner import Scanner
from scanner_sim.config.scenario import Scenario
from scanner_sim.products.budget import Mode
from scanner_sim.products.instrument_sheet import InstrumentSheet
from scanner_sim.validation.compare.closed_forms import ClosedForms
from scanner_sim.validation.compare.instrument import closed_budget

REFLECTANCE = 0.5
"""Of the target that the errors are of: Lambertian, facing."""
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
        Ranges, evenly spaced in logarithms from the array's near end to its far one or the end of the gate.
    """
    scenario = alone(scanner)
    forms = ClosedForms(scenario)
    gate, sensor = scanner.lidar.digitiser.gate, scanner.position_sensor
    near, far = scanner.nearest_range, scanner.farthest_range
    ranges = np.geomspace(near, min(far, max(gate[1], 2.0 * near)), count)
    found = [closed_budget(scenario, REFLECTANCE, float(R)) for R in ranges]
    sigma = {
        mode: np.array([one[mode]["all"] for one in found])
        for mode in _MODES
        if all(mode in one for one in found)
    }
    spots = [forms.facing(float(R), REFLECTANCE) for R in ranges]
    brightest = np.array([seen.line.max() for seen in spots])
    filled = scanner.exposure / scanner.dwell * brightest / sensor.full_well
    laser = scanner.laser
    beam = laser.waist_radius, laser.waist_distance, laser.wavelength, laser.m_squared
    ends = sensor.offset, sensor.offset + sensor.length
    theta = np.linspace(-scanner.mirrors.max_deflection, scanner.mirrors.max_deflection, _DEFLECTIONS)
    recorded = (ranges >= gate[0]) & (ranges <= gate[1])
    return InstrumentSheet(
        baseline=scanner.receiver.baseline,
        focal_length=scanner.receiver.focal_length,
        aperture=scanner.receiver.aperture,
        axis_separation=scanner.mirrors.axis_separation,
        array=ends,
        array_ends=(_behind_lens(forms, ends[0]), _behind_lens(forms, ends[1])),
        theta=theta,
        nearest=forms.array.range(ends[1], theta),
        farthest=forms.array.range(ends[0], theta) if ends[0] > 0.0 else np.full_like(theta, math.inf),
        near=near,
        far=far,
        gate=gate,
        half_field=scanner.mirrors.max_deflection,
        rate=scanner.rate,
        reflectance=REFLECTANCE,
        range_m=ranges,
        spot_m=2.0 * beam_radius(ranges, *beam),
        pixel_m=np.array([forms.range_per_pixel(float(R)) for R in ranges]),
        image_px=np.array([seen.sigma for seen in spots]),
        lateral_m=forms.angle_sigma * ranges,
        filled=filled,
        sigma_m={
            mode: np.where(filled < 1.0 if mode == "triangulation" else recorded, values, math.nan)
            for mode, values in sigma.items()
            if np.isfinite(values).any()
        },
    )


def _behind_lens(forms: ClosedForms, position: float) -> tuple[float, float]:
    """Return where a position on the array is, (x, z) from the lens's node [m]."""
    x, depth = forms.array.origin + position * forms.array.direction
    return float(x), -float(depth)
