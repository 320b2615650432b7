"""Law of the walk: how a pulse that crosses a fixed level early seems nearer the stronger it is."""

from __future__ import annotations

import math

import numpy as np

from scanner_sim.analytic.edge import sampled_crossings
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup
from scanner_sim.validation.compare.law import Law, Measured, Predicted, mean_of
from scanner_sim.validation.compare.pulses import (
    dark_noise,
    echo_peak,
    echo_range,
    near,
    plate_errors,
    pulse_widths,
    pulses_uncovered,
    silent,
)

_RATIOS = (2.0, 4.0, 8.0, 16.0)
"""Peaks over the level, of which the first is the reference."""
_PLACES = 8
"""Positions of the echo between two samples; with four their mean would be off by up to 1.3 mm for 1 GHz."""
_WALK = 0.05
"""Rounding of ranges in single precision, and noise on a straight line between two samples [mm]."""


def _walks(setting: ComparisonSetup) -> str:
    reason = pulses_uncovered(setting)
    if reason:
        return reason
    if _walk_level(setting) < 10.0 * dark_noise(setting)[0]:
        return "the level would lie within the noise at this range"
    return ""


def _walk_range(setting: ComparisonSetup) -> float:
    R = echo_range(setting)
    assert R is not None
    return R


def _walk_ranges(setting: ComparisonSetup) -> list[float]:
    """Return the ranges of the plates [m]."""
    return list(near(setting, _walk_range(setting), _PLACES))


def _walk_level(setting: ComparisonSetup) -> float:
    """Return the level [A] that the strongest echo exceeds by the largest ratio, below the amplifier's saturation."""
    strongest = min(
        echo_peak(setting, _walk_ranges(setting)[-1], 1.0),
        0.5 * setting.scenario.scanner.lidar.photodiode.saturation,
    )
    return strongest / _RATIOS[-1]


def _walk_reflectances(setting: ComparisonSetup, ratio: float) -> list[float]:
    """Return the reflectances of plates at their ranges whose echoes have one ratio of peak to level."""
    level = ratio * _walk_level(setting)
    return [level / echo_peak(setting, where, 1.0) for where in _walk_ranges(setting)]


def _measure_walk(setting: ComparisonSetup) -> dict[str, Measured]:
    made = silent(
        setting,
        "amplifier",
        timing="leading_edge",
        level=_walk_level(setting),
        walk_correction=False,
        # A pulse that is longer than stated walks more: it shall be measured, not refused.
        overlap=False,
    )
    means = {}
    for number, ratio in enumerate(_RATIOS):
        plates = _walk_ranges(setting), _walk_reflectances(setting, ratio)
        errors = [
            plate_errors(setting, *plates, seed, setting.shots(1000), made)
            for seed in setting.seed(13, number)
        ]
        # Each position has a systematic error of its own: the mean over the positions is what the law is about.
        found = [mean_of(values) for values in np.concatenate(errors)]
        error = math.sqrt(sum(part.error**2 for part in found)) / len(found)
        means[ratio] = Measured(
            "mean", float(np.mean([part.value for part in found])), error, found[0].freedom
        )
    first = means[_RATIOS[0]]
    return {
        f"peak {ratio:g} times the level": Measured(
            "mean",
            first.value - means[ratio].value,
            math.hypot(first.error, means[ratio].error),
            first.freedom,
        )
        for ratio in _RATIOS[1:]
    }


def _predict_walk(setting: ComparisonSetup) -> dict[str, Predicted]:
    width = math.hypot(*pulse_widths(setting))
    step, cases = 1.0 / setting.scenario.scanner.lidar.digitiser.rate, {}
    first = sampled_crossings(width, step, _RATIOS[0])
    for ratio in _RATIOS[1:]:
        nearer = 0.5e3 * SPEED_OF_LIGHT * (sampled_crossings(width, step, ratio) - first)
        # The plates stand at even positions between two samples, of which the judge does not know the first.
        of_plates = nearer.reshape(_PLACES, -1).mean(axis=0)
        left = float(np.abs(of_plates - nearer.mean()).max())
        quantity, value = "nearer by", float(nearer.mean())
        cases[f"peak {ratio:g} times the level"] = Predicted(quantity, "mm", value, left + _WALK)
    return cases


TOF_WALK = Law(
    "tof_walk",
    "Walk of a fixed level",
    "Gaussian pulse: √(2 ln ratio) standard deviations before its peak",
    "A pulse of 4, 8 or 16 times the level seems nearer than one of twice the level by c/2 σ (√(2 ln ratio) − "
    "√(2 ln 2)), with the width of the pulse behind the electronics, and a little more where samples are coarse. "
    "Leading edge without correction, amplifier noise alone.",
    "target",
    _walks,
    _measure_walk,
    _predict_walk,
    exercises="built-in",
    rangefinder="tof",
)
