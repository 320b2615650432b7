"""Law of the walk: how a pulse that crosses a fixed level early seems nearer the stronger it is."""

from __future__ import annotations

import math

import numpy as np

from scanner_sim.analytic.edge import sampled_crossing
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup
from scanner_sim.validation.compare.law import Law, Measured, Predicted, mean_of
from scanner_sim.validation.compare.pulses import (
    dark_noise,
    echo_peak,
    echo_range,
    plate_errors,
    pulse_widths,
    pulses_uncovered,
    silent,
)

_RATIOS = (2.0, 4.0, 8.0, 16.0)
"""Peaks over the level, of which the first is the reference."""
_WALK = 0.5
"""What is left of the law of the walk [mm]: four positions between two samples stand for all."""


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


def _walk_level(setting: ComparisonSetup) -> float:
    """Return the level [A] that the strongest echo exceeds by the largest ratio, below the amplifier's saturation."""
    strongest = min(
        echo_peak(setting, _walk_range(setting), 1.0),
        0.5 * setting.scenario.scanner.lidar.photodiode.saturation,
    )
    return strongest / _RATIOS[-1]


def _walk_reflectance(setting: ComparisonSetup, ratio: float) -> float:
    """Return the reflectance of a plate whose echo has a ratio of peak to level."""
    return ratio * _walk_level(setting) / echo_peak(setting, _walk_range(setting), 1.0)


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
        R, grey, shots = _walk_range(setting), _walk_reflectance(setting, ratio), setting.shots(2000)
        errors = [plate_errors(setting, R, grey, seed, shots, made) for seed in setting.seed(13, number)]
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
    step = 1.0 / setting.scenario.scanner.lidar.digitiser.rate
    crossings = {ratio: sampled_crossing(width, step, ratio) for ratio in _RATIOS}
    return {
        f"peak {ratio:g} times the level": Predicted(
            "nearer by",
            "mm",
            0.5e3 * SPEED_OF_LIGHT * (crossings[ratio] - crossings[_RATIOS[0]]),
            _WALK,
        )
        for ratio in _RATIOS[1:]
    }


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
)
