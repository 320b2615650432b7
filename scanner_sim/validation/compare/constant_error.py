"""Law of an error of the spot's position that is the same at every range, and whose range error hence grows as R²."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scanner_sim.validation.compare import test_bench
from scanner_sim.validation.compare.closed_forms import ClosedForms
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup
from scanner_sim.validation.compare.law import Law, Measured, Predicted, spread_of
from scanner_sim.validation.compare.noise import plate_side, slope_expected, slope_over

Array = NDArray[np.float64]


def _unsynchronised(setting: ComparisonSetup) -> str:
    if not setting.scenario.scanner.mirrors.synchronisation:
        return "projection and reception have no error between them"
    return setting.slopeless() or (
        "" if len(_synchronised(setting)) > 2 else "the array sees too few of the ranges"
    )


def _synchronised(setting: ComparisonSetup) -> tuple[float, ...]:
    closed = ClosedForms(setting.scenario)
    return tuple(
        R for R in setting.flat.ranges if closed.on_array(closed.facing(R, setting.flat.reflectance))
    )


def _measure_synchronisation(setting: ComparisonSetup) -> dict[str, Measured]:
    cases, shots, ranges = {}, setting.shots(8000), _synchronised(setting)
    mirrors = setting.scenario.scanner.mirrors.still(but="synchronisation")
    for step, R in enumerate(ranges):
        groups = []
        for seed in setting.seed(7, step):
            plate = test_bench.plate(R, setting.flat.reflectance, size=plate_side(setting, R))
            made = test_bench.on_test_bench(setting, plate, seed=seed, mirrors=mirrors)
            aim = test_bench.directions(np.zeros(shots), 0.0, mirrors, 0.0)
            groups.append(1e3 * test_bench.range_errors(setting, made, aim))
        cases[f"{R:.4g} m"] = spread_of(np.stack(groups))
    return cases | slope_over(ranges, cases, True)


def _predict_synchronisation(setting: ComparisonSetup) -> dict[str, Predicted]:
    closed, cases, ranges = setting.closed, {}, _synchronised(setting)
    for R in ranges:
        apart = closed.synchronisation_error(R)
        value = 1e3 * closed.range_per_pixel(R) / closed.pitch * apart
        value *= closed.follows(closed.facing(R, setting.flat.reflectance))
        p = float(closed.array.position(R))
        rounding = 1e3 * closed.range_per_pixel(R) * p / closed.pitch * 2.0**-24
        cases[f"{R:.4g} m"] = Predicted("σ of R", "mm", value, 0.002 * value + rounding**2 / value)
    return cases | slope_expected(ranges, cases, True, "2 for p ≪ f")


SYNCHRONISATION = Law(
    "sigma_synchronisation",
    "Range noise of a constant error of p",
    "eq 4; slope R²",
    "σ_R = R²/(f d) Δp with Δp = f (1 + p²/f²) times the angle's error between projection and reception, alone.",
    "target",
    _unsynchronised,
    _measure_synchronisation,
    _predict_synchronisation,
    exercises="peak",
    needs=("position",),
)
