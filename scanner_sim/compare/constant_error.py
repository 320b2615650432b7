"""Laws of errors of the spot's place that are the same at every range, and whose range error hence grows as R²."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic import geometry
from scanner_sim.analytic import speckle as grain
from scanner_sim.analytic.beam import beam_radius
from scanner_sim.analytic.estimators import ESTIMATORS
from scanner_sim.compare import stand
from scanner_sim.compare.closed import FIT, Closed
from scanner_sim.compare.law import Law, Measured, Predicted, spread_of
from scanner_sim.compare.noise import SPREAD, plate_side, slope_expected, slope_over, spots
from scanner_sim.compare.setting import Setting
from scanner_sim.signals.processing import PeakMethod

Array = NDArray[np.float64]

_FIELD = 0.05
"""Approximation of the simulated field of speckle: what it takes in tests of its own against the pupil's covariance."""
AUTHORS: PeakMethod = "blais_rioux_4"
"""Estimator of the published limits of speckle."""


def _unsynchronised(setting: Setting) -> str:
    if not setting.scenario.scanner.mirrors.synchronisation:
        return "projection and reception have no error between them"
    return setting.slopeless() or (
        "" if len(_synchronised(setting)) > 2 else "the array sees too few of the ranges"
    )


def _synchronised(setting: Setting) -> tuple[float, ...]:
    closed = Closed(setting.scenario)
    return tuple(
        R for R in setting.flat.ranges if closed.on_array(closed.facing(R, setting.flat.reflectance))
    )


def _measure_synchronisation(setting: Setting) -> dict[str, Measured]:
    told, shots, ranges = {}, setting.shots(8000), _synchronised(setting)
    mirrors = setting.scenario.scanner.mirrors.still(but="synchronisation")
    for step, R in enumerate(ranges):
        groups = []
        for seed in setting.seed(7, step):
            plate = stand.plate(R, setting.flat.reflectance, size=plate_side(setting, R))
            made = stand.on_stand(setting, plate, seed=seed, mirrors=mirrors)
            aim = stand.directions(np.zeros(shots), 0.0, mirrors, 0.0)
            groups.append(1e3 * stand.range_errors(setting, made, aim))
        told[f"{R:.4g} m"] = spread_of(np.stack(groups))
    return told | slope_over(ranges, told, True)


def _predict_synchronisation(setting: Setting) -> dict[str, Predicted]:
    closed, told, ranges = Closed(setting.scenario), {}, _synchronised(setting)
    for R in ranges:
        apart = closed.synchronisation_error(R)
        value = 1e3 * float(geometry.range_error(R, 0.0, closed.f, closed.d, apart))
        value *= closed.follows(closed.facing(R, setting.flat.reflectance))
        p = float(geometry.image_position(R, 0.0, closed.f, closed.d))
        rounding = 1e3 * closed.range_per_pixel(R) * p / closed.pitch * 2.0**-24
        told[f"{R:.4g} m"] = Predicted("σ of R", "mm", value, 0.002 * value + rounding**2 / value)
    return told | slope_expected(ranges, told, True, "2 for p ≪ f")


SYNCHRONISATION = Law(
    "sigma_synchronisation",
    "Range noise of a constant error of p",
    "eq 4; slope R²",
    "σ_R = R²/(f d) Δp with Δp = f (1 + p²/f²) times the angle's error between projection and reception, alone.",
    "target",
    _unsynchronised,
    _measure_synchronisation,
    _predict_synchronisation,
)


def _speckle_peak(setting: Setting) -> PeakMethod:
    chosen = setting.scenario.processing.peak
    return AUTHORS if chosen in (FIT, "centre_of_mass") else chosen


def _coherent(setting: Setting) -> str:
    if not setting.scenario.scanner.laser.speckle:
        return "the scenario's laser makes no speckle"
    if not _synchronised(setting):
        return "the array sees no spot at these ranges"
    wide = max(Closed(setting.scenario).facing(R, 1.0).sigma for R in setting.flat.ranges)
    if wide > 2.0:
        return "the spot is wider than the line over which the closed form integrates the grain"
    return ""


def _measure_speckle(setting: Setting) -> dict[str, Measured]:
    told, ranges, shots = {}, _synchronised(setting), setting.shots(4900)
    for step, R in enumerate(ranges):
        groups = []
        for place, (where, _) in enumerate(spots(setting, R)):
            for seed in setting.seed(8, step, place):
                plate = stand.plate(where, setting.flat.reflectance, size=plate_side(setting, where))
                theta, phi = stand.square(_separate(setting, where), shots)
                errors = []
                # Directions differ, and with them the place in the pixel: what the estimator errs there is no noise.
                for speckle in (True, False):
                    made = stand.on_stand(
                        setting, plate, seed=seed, speckle=speckle, peak=_speckle_peak(setting)
                    )
                    aim = stand.directions(theta, phi, made.scanner.mirrors, 0.0)
                    errors.append(stand.range_errors(setting, made, aim))
                groups.append(1e3 * (errors[0] - errors[1]))
        told[f"{R:.4g} m"] = spread_of(np.stack(groups))
    return told | slope_over(ranges, told, True)


def _separate(setting: Setting, R: float) -> float:
    """Return to which side directions reach so that no two shots share a pattern: four beam radii apart."""
    side = math.isqrt(setting.shots(4900))
    return min(SPREAD, 2.0 * (side - 1) * setting.scenario.scanner.laser.radius(R) / R)


def _predict_speckle(setting: Setting) -> dict[str, Predicted]:
    closed, told, ranges = Closed(setting.scenario), {}, _synchronised(setting)
    laser, receiver = setting.scenario.scanner.laser, setting.scenario.scanner.receiver
    number, few = receiver.focal_length / receiver.aperture, 13
    estimator = ESTIMATORS[_speckle_peak(setting)]

    def padded(line: Any) -> float:
        return estimator([0.0] * 6 + list(line) + [0.0] * 6) - 6.0

    for R in ranges:
        squares = []
        for where, seen in spots(setting, R):
            middle = (few // 2 + seen.phase) * closed.pitch
            width = seen.sigma * closed.pitch
            covariance = grain.pixel_covariance(
                laser.wavelength, number, closed.pitch, middle, (width, _across(setting, R)), few
            )
            shares = grain.pixel_shares(closed.pitch, middle, width, few)
            sigma = math.sqrt(0.5) * grain.position_sigma(padded, shares, covariance)
            squares.append((closed.range_per_pixel(where) * sigma) ** 2)
        value = 1e3 * math.sqrt(float(np.mean(squares)))
        told[f"{R:.4g} m"] = Predicted("σ of R", "mm", value, _FIELD * value)
    return told | slope_expected(ranges, told, True, "2 for a spot of one width")


def _across(setting: Setting, R: float) -> float:
    """Return the width [m] across the line of the unclipped spot that has the speckle of the one that pixels clip.

    Grain much finer than the spot errs by ∫I²/(∫I)² over the pixels' height h, which for the clipped Gaussian of σ is
    that of one of σ erf²(h/(2√2 σ))/erf(h/(2σ)).
    """
    scanner = setting.scenario.scanner
    laser = scanner.laser
    radius = beam_radius(R, laser.waist_radius, laser.waist_distance, laser.wavelength, laser.m_squared)
    sigma = math.hypot(0.5 * float(radius) * scanner.receiver.focal_length / R, scanner.receiver.point_spread)
    half = 0.5 * scanner.position_sensor.height / sigma
    return sigma * math.erf(half / math.sqrt(2.0)) ** 2 / math.erf(half)


SPECKLE = Law(
    "speckle_limit",
    "Range noise of speckle",
    "eq 4 with Dorsch et al. 1994, Baribeau and Rioux 1991; slope R²",
    "σ_p from the grain's covariance |2 J₁(v)/v|² over pixels and spot by integration, one frozen pattern, C = 1/√2 on "
    "a depolarising surface. Speckle alone; blais_rioux_4 in place of the fit, whose weights are another noise's.",
    "target",
    _coherent,
    _measure_speckle,
    _predict_speckle,
)
