"""Laws of the point over the field of view: no bias, and the covariance of eq 5 with the full Jacobian."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic import geometry
from scanner_sim.config.scenario import Scenario
from scanner_sim.optics.deflection import ERRORS
from scanner_sim.validation.compare import test_bench
from scanner_sim.validation.compare.closed_forms import FIT, LINE, ClosedForms, ClosedSpot
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup
from scanner_sim.validation.compare.law import Law, Measured, Predicted, mean_of, spread_of
from scanner_sim.validation.compare.shape import (
    FieldPosition,
    field_positions,
    lens_extent,
    position_rounding,
    unlit,
)

Array = NDArray[np.float64]

_TABLE = 1e-3
"""What a computed correction leaves of an estimator's systematic error [pixel]."""
_ROUNDING = 6e-8
"""Of coordinates in single precision, over the range."""
_STEADY = 5.0
"""Times of the wobble between two shots: nothing is left of it then."""


def plate_scenario(setting: ComparisonSetup, position: FieldPosition, **more: object) -> Scenario:
    """Return the instrument before a plate that faces the beam at a position; ``more`` is for the test bench."""
    closed = ClosedForms(setting.scenario)
    size = 0.02 * position.distance + 16.0 * setting.scenario.scanner.laser.radius(position.distance)
    target = test_bench.plate(
        position.distance,
        setting.flat.reflectance,
        theta=position.theta,
        phi=position.phi,
        separation=closed.D,
        size=size,
    )
    return test_bench.on_test_bench(setting, target, **more)  # type: ignore[arg-type]


def facing_positions(
    setting: ComparisonSetup, ranges: tuple[float, ...]
) -> Iterator[tuple[FieldPosition, ClosedSpot]]:
    """Yield positions of the field whose plates face the beam, and the judge's spot there."""
    closed = ClosedForms(setting.scenario)
    for position in field_positions(setting, ranges):
        seen = closed.facing(position.distance, setting.flat.reflectance, position.theta, position.phi)
        if closed.on_array(seen):
            yield position, seen


def _errors_at(setting: ComparisonSetup, made: Scenario, position: FieldPosition, shots: int) -> Array:
    """Return errors of x, y, z and R [m] in one direction, shape (n, 4)."""
    mirrors = made.scanner.mirrors
    aim = test_bench.directions(
        np.full(shots, position.theta), position.phi, mirrors, 1.0 / made.scanner.rate
    )
    aim.time[:] *= 0.5 * _STEADY
    layers = test_bench.measure(setting, made, aim)
    truth = geometry.point_from_shot(
        layers["truth.range_m"],
        layers["truth.theta_rad"],
        layers["truth.phi_rad"],
        ClosedForms(setting.scenario).D,
    )
    point = np.stack([layers["P.X"], layers["P.Y"], layers["P.Z"]], axis=-1)
    return np.column_stack([point - truth, layers["range_m"] - layers["truth.range_m"]])


_COORDINATES = ("x", "y", "z", "R")


def _bias_uncovered(setting: ComparisonSetup) -> str:
    chosen = setting.scenario.processing
    if chosen.bias_correction not in ("none", "computed"):
        return "the correction of the estimator was measured, not computed: it has no closed form"
    return unlit(setting)


def _point_positions(setting: ComparisonSetup) -> Iterator[tuple[FieldPosition, ClosedSpot, tuple[str, ...]]]:
    """Yield positions, spots and coordinates: ranges on the axis, and all coordinates over the field in the middle."""
    for distance in setting.flat.ranges:
        for position, seen in facing_positions(setting, (distance,)):
            if distance == setting.middle or position.theta == position.phi == 0.0:
                yield position, seen, _COORDINATES if distance == setting.middle else ("R",)


def _measure_points(setting: ComparisonSetup) -> dict[str, Measured]:
    noise, cases = ("shot", "read", "dark", "quantisation"), {}
    for number, (position, _, names) in enumerate(_point_positions(setting)):
        errors = np.concatenate(
            [
                _errors_at(
                    setting,
                    plate_scenario(
                        setting,
                        position,
                        seed=seed,
                        noise=noise,
                        mirrors=test_bench.mirrors_with_errors(setting),
                    ),
                    position,
                    setting.shots(4000),
                )
                for seed in setting.seed(2, number)
            ]
        )
        for name in names:
            cases[f"{name} at {position.name}"] = mean_of(1e3 * errors[:, _COORDINATES.index(name)])
    return cases


def _predict_points(setting: ComparisonSetup) -> dict[str, Predicted]:
    closed, chosen, cases = setting.closed, setting.scenario.processing, {}
    for position, seen, names in _point_positions(setting):
        systematic = 0.0
        if chosen.peak != FIT and chosen.bias_correction == "none":
            systematic = closed.estimated(chosen.peak, seen.line) - LINE // 2 - seen.phase
        per_pixel = closed.range_per_pixel(position.distance, position.theta)
        bias = -per_pixel * (systematic + seen.centre - seen.chief)
        p = seen.centre - closed.pixel(0.0)
        accuracy = per_pixel * (
            lens_extent(setting, position) / 16.0 * p + position_rounding(setting, position)
        )
        if chosen.bias_correction == "computed":
            accuracy += per_pixel * _TABLE
        along = dict(
            zip(
                _COORDINATES,
                (*geometry.scanner_axes(position.theta, position.phi)[0].tolist(), 1.0),
                strict=True,
            )
        )
        for name in names:
            cases[f"{name} at {position.name}"] = Predicted(
                f"mean error of {name}",
                "mm",
                1e3 * bias * along[name],
                1e3 * accuracy * abs(along[name]) + 1e3 * _ROUNDING * position.distance,
                1e3 * position.distance,
                "range",
            )
    return cases


def _shaken(setting: ComparisonSetup) -> str:
    mirrors = setting.scenario.scanner.mirrors
    if not any(getattr(mirrors, key) for name, keys in ERRORS.items() if name != "drift" for key in keys):
        return "the mirrors have no errors"
    if mirrors.readout_step > math.hypot(mirrors.jitter, mirrors.readout_noise):
        return "the encoders' step is larger than the noise on it, so that its error is no random one"
    return _bias_uncovered(setting)


def _measure_covariance(setting: ComparisonSetup) -> dict[str, Measured]:
    cases = {}
    for number, (position, _) in enumerate(facing_positions(setting, (setting.middle,))):
        errors = np.stack(
            [
                _errors_at(
                    setting,
                    plate_scenario(
                        setting, position, seed=seed, mirrors=test_bench.mirrors_with_errors(setting)
                    ),
                    position,
                    setting.shots(16000),
                )
                for seed in setting.seed(3, number)
            ]
        )
        for axis, name in enumerate(_COORDINATES):
            cases[f"{name} at {position.name}"] = spread_of(1e3 * errors[..., axis])
    return cases


def _predict_covariance(setting: ComparisonSetup) -> dict[str, Predicted]:
    closed, cases = setting.closed, {}
    angle = closed.angle_sigma
    for position, seen in facing_positions(setting, (setting.middle,)):
        apart = closed.synchronisation_error(position.distance, position.theta) * closed.follows(seen)
        # An error on the array is that in the focal plane which turns the line of sight by as much.
        apart *= closed.f / float(closed.array.scale(position.distance, position.theta)[0])
        errors = geometry.propagated_errors(
            position.distance, position.theta, position.phi, closed.f, closed.d, closed.D, apart, angle, angle
        )
        # Rounding of a peak to single precision: 2⁻²⁴ of its pixel, uniform.
        rounding = closed.range_per_pixel(position.distance, position.theta) * 256.0 * 2.0**-24
        for name, error in zip(_COORDINATES, errors.tolist(), strict=True):
            cases[f"{name} at {position.name}"] = Predicted(
                f"σ of {name}", "mm", 1e3 * error, 1e3 * (0.002 * error + rounding**2 / error)
            )
    return cases


POINTS = Law(
    "points",
    "No bias of range and point",
    "eqs 1 and 3, inverted",
    "The mean of (estimate − truth) is the estimator's systematic error and the centroid's shift, along the beam. "
    "Shot, read, dark and quantisation noise and the mirrors' errors; no speckle, even response.",
    "target",
    _bias_uncovered,
    _measure_points,
    _predict_points,
    exercises="peak",
    needs=("position",),
)
COVARIANCE = Law(
    "covariance",
    "Errors of the point over the field",
    "eq 5 with the full Jacobian of eqs 1 and 3",
    "σ² = Σ (∂(x, y, z, R)/∂(p, Θ, φ) σ)². The mirrors' errors alone; p errs by f (1 + p²/f²) times the error of "
    "synchronisation.",
    "target",
    _shaken,
    _measure_covariance,
    _predict_covariance,
    exercises="peak",
    needs=("position",),
)
