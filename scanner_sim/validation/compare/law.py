"""What a law is: a closed form, what is measured to test it, and when it says nothing."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import kurtosis

from scanner_sim.config.scanner import RangefinderName
from scanner_sim.products.comparison import Exercises, Form
from scanner_sim.validation.compare.closed_forms import FormName
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Measured:
    """A number found by simulation.

    Attributes
    ----------
    form
        Without noise, a mean or a standard deviation.
    value
        The number.
    error
        Its standard error; 0 without noise.
    freedom
        Degrees of freedom of the error, or of a standard deviation; infinity where the error is known.
    """

    form: Form
    value: float
    error: float = 0.0
    freedom: float = math.inf


@dataclass(frozen=True)
class Predicted:
    """What a closed form says of one number.

    Attributes
    ----------
    quantity, unit
        What it is; empty for a pure number.
    value
        The number.
    accuracy
        How far the closed form may be off by the orders that it leaves out, in the number's unit. Not a tolerance of
        statistics: that is the judge's.
    scale, relative_to
        By what a deviation is divided to be relative, in the number's unit, and its name.
    """

    quantity: str
    unit: str
    value: float
    accuracy: float = 0.0
    scale: float = math.nan
    relative_to: str = "prediction"

    @property
    def divisor(self) -> float:
        """What a deviation is divided by to be relative."""
        return abs(self.value) if math.isnan(self.scale) else self.scale


@dataclass(frozen=True)
class Law:
    """A law of the instrument, as a tool and not as a test.

    Attributes
    ----------
    name
        By which it is asked for.
    title, source, statement
        What it is about; equation or literature; the closed form in words, with what was switched off to test it.
    scene
        Where it is tested: ``target`` for flat targets that the test bench places, ``scene`` for the scenario's own
        scene unless a flat target is asked for, ``signals`` for noise put onto signals.
    applies
        Returns why the closed form does not cover a setting; empty where it does.
    measure
        Returns what the simulator finds, by case; nothing where the scene does not hold what the law speaks of.
    predict
        Returns what the closed form says of the same cases, from numbers of the scenario alone.
    nothing
        Why the law does not apply where nothing was measured.
    exercises
        What of the processing its measurement goes through.
    rangefinder
        Whose detector it is measured with; None for none: without it the law does not apply.
    needs
        Closed forms of the scenario's estimator of the peak that the prediction takes, as
        :class:`~scanner_sim.validation.compare.closed_forms.EstimatorForms` has them.
    of_built
        Whether it speaks of an instrument that is built or believed otherwise than designed; others do not apply to it.
    """

    name: str
    title: str
    source: str
    statement: str
    scene: Literal["target", "scene", "signals"]
    applies: Callable[[ComparisonSetup], str]
    measure: Callable[[ComparisonSetup], Mapping[str, Measured]]
    predict: Callable[[ComparisonSetup], Mapping[str, Predicted]]
    nothing: str = "the scene holds nothing of what it speaks of"
    exercises: Exercises = field(kw_only=True)
    rangefinder: RangefinderName | None = field(default="triangulation", kw_only=True)
    needs: tuple[FormName, ...] = field(default=(), kw_only=True)
    of_built: bool = field(default=False, kw_only=True)


def exact(value: float) -> Measured:
    """Return a number that has no noise in it."""
    return Measured("exact", float(value))


def mean_of(values: Array) -> Measured:
    """Return the mean of independent values, with the standard error of their scatter (Student's t)."""
    values = values[np.isfinite(values)]
    return Measured(
        "mean", float(values.mean()), float(values.std(ddof=1) / math.sqrt(len(values))), len(values) - 1
    )


def spread_of(groups: Array, *, about_mean: bool = True) -> Measured:
    """Return the standard deviation of groups of independent errors, root mean square over the groups.

    Parameters
    ----------
    groups
        Errors, shape (groups, n); NaN where there is none.
    about_mean
        About the mean of each group, or about zero.

    Notes
    -----
    The degrees of freedom are Satterthwaite's for the sum of the groups' variances, (Σv)²/Σ(v²/ν), with ν = 2 n/(k − 1)
    from the kurtosis k of all the errors over their groups' deviation: 3 for normal errors, for which ν = n; more where
    the errors have long tails (Cramér, *Mathematical methods of statistics*, 1946, sec. 27.4).
    """
    counts = np.isfinite(groups).sum(axis=1) - (1 if about_mean else 0)
    centred = groups - np.nanmean(groups, axis=1, keepdims=True) if about_mean else groups
    variances = np.nansum(centred**2, axis=1) / counts
    scaled = centred / np.sqrt(variances)[:, None]
    tails = float(kurtosis(scaled[np.isfinite(scaled)], fisher=False))
    each = counts * 2.0 / max(tails - 1.0, 1.0)
    freedom = float(variances.sum() ** 2 / np.sum(variances**2 / each))
    value = float(np.sqrt(variances.mean()))
    return Measured("spread", value, value / math.sqrt(2.0 * freedom), freedom)


def slope_of(x: Array, values: list[Measured]) -> Measured:
    """Return the exponent of standard deviations against x: the slope of a straight line through the logarithms.

    ln s has the variance 1/(2ν), from which the slope's error follows.
    """
    away = np.log(x) - np.log(x).mean()
    logs = np.log([value.value for value in values])
    errors = np.array([1.0 / (2.0 * value.freedom) for value in values])
    square = float(away @ away)
    return Measured("mean", float(away @ logs) / square, math.sqrt(float(away**2 @ errors)) / square)


def slope_predicted(x: Array, values: list[Predicted], quantity: str) -> Predicted:
    """Return the exponent of predicted values against x, and how far their accuracies may bend it."""
    away = np.log(x) - np.log(x).mean()
    logs = np.log([value.value for value in values])
    relative = np.array([value.accuracy / value.value for value in values])
    square = float(away @ away)
    bent = float(np.abs(away) @ relative) / square
    return Predicted(quantity, "", float(away @ logs) / square, bent, 1.0, "one")
