"""Laws of the range's noise on facing targets: photons, read-out, and the Cramér–Rao bound."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic.estimators import ESTIMATORS
from scanner_sim.config.scenario import Scenario
from scanner_sim.signals.processing import PeakMethod
from scanner_sim.validation.compare import test_bench
from scanner_sim.validation.compare.closed_forms import FIT, LINE, ClosedForms, ClosedSpot
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup
from scanner_sim.validation.compare.law import Law, Measured, Predicted, slope_of, slope_predicted, spread_of

Array = NDArray[np.float64]
Variance = Callable[[ComparisonSetup, ClosedSpot], Array]

PLACES = 4
"""Positions of the spot in its pixel over which σ is averaged, none of them half-way between two pixels."""
SLOPE = "slope over all ranges"
_FIRST_ORDER = 0.05
"""Largest σ of a position over the spot's width for which errors are of the first order."""
_SECOND = 8.0
"""Second order over first order of σ, in units of (σ/width)²."""
_OWN_FORMS = 0.01
"""Closed forms of the user's own estimators may leave out as much."""
SPREAD = 0.05
"""Deflection to each side over which shots do not share speckle [rad]."""


def phases(count: int = PLACES) -> Array:
    """Return evenly spaced positions in a pixel, −1/2 to 1/2."""
    return (np.arange(count) + 0.5) / count - 0.5


def spots(
    setting: ComparisonSetup, distance: float, count: int = PLACES
) -> Iterator[tuple[float, ClosedSpot]]:
    """Yield ranges [m] about one at which the spot lies at even positions in its pixel, and the judge's spots."""
    yield from _spots(setting.scenario, distance, setting.flat.reflectance, count)


@lru_cache(maxsize=64)
def _spots(
    scenario: Scenario, distance: float, reflectance: float, count: int
) -> tuple[tuple[float, ClosedSpot], ...]:
    """Return what ``spots`` yields: each law asks several times, and all laws for the same."""
    closed = ClosedForms(scenario)
    positions = [closed.position(distance, float(phase)) for phase in phases(count)]
    return tuple((where, closed.facing(where, reflectance)) for where in positions)


def _dark(setting: ComparisonSetup) -> float:
    scanner = setting.scenario.scanner
    return scanner.position_sensor.dark_current / scanner.rate


def _shot_variance(setting: ComparisonSetup, seen: ClosedSpot) -> Array:  # noqa: ARG001 (one signature for all variances)
    return seen.line


def _read_variance(setting: ComparisonSetup, seen: ClosedSpot) -> Array:  # noqa: ARG001 (as above)
    return np.full(LINE, setting.scenario.scanner.position_sensor.read_noise**2)


def _both_variances(setting: ComparisonSetup, seen: ClosedSpot) -> Array:
    return _shot_variance(setting, seen) + _read_variance(setting, seen) + _dark(setting)


def _sigma(setting: ComparisonSetup, distance: float, variance: Variance, peak: str) -> Predicted:
    """Return the predicted σ of the range [mm] about a distance, root mean square over the positions in a pixel."""
    closed, squares, slack = setting.closed, [], []
    for where, seen in spots(setting, distance):
        sigma = closed.sigma_pixel(seen, peak, variance(setting, seen))
        squares.append((closed.range_per_pixel(where) * sigma) ** 2)
        slack.append(
            _SECOND * (sigma / seen.sigma) ** 2 + (0.0 if peak in (*ESTIMATORS, FIT) else _OWN_FORMS)
        )
    value = 1e3 * math.sqrt(float(np.mean(squares)))
    return Predicted("σ of R", "mm", value, max(slack) * value)


def _usable(setting: ComparisonSetup, variance: Variance, peak: str) -> tuple[float, ...]:
    """Return the ranges at which the spot is on the array and errors are of the first order."""
    closed, kept = setting.closed, []
    for distance in setting.flat.ranges:
        seen = closed.facing(distance, setting.flat.reflectance)
        if closed.on_array(seen) and closed.passed(math.atan(closed.d / distance)) > 0.5:
            worst = max(
                closed.sigma_pixel(some, peak, variance(setting, some)) / some.sigma
                for _, some in spots(setting, distance)
            )
            kept += [distance] if worst < _FIRST_ORDER else []
    return tuple(kept)


def _first_order(setting: ComparisonSetup, *, variance: Variance, peak: str | None, slope: bool) -> str:
    chosen = peak or setting.scenario.processing.peak
    if chosen == "centre_of_mass" and any(
        ClosedForms(setting.scenario).facing(R, 1.0).sigma > 1.2 for R in setting.flat.ranges
    ):
        return "the window of the centre of mass jumps with the brightest pixel, which is of no order in the noise"
    missing = len(setting.flat.ranges) - len(_usable(setting, variance, chosen))
    if missing == len(setting.flat.ranges):
        return "the spot is too weak at all ranges for errors of the first order, or not on the array"
    if slope and not setting.slopeless() and len(setting.flat.ranges) - missing < 3:
        return "errors are of the first order at fewer than three of the ranges"
    return ""


def _has_noise(setting: ComparisonSetup, *, noise: str, **rest: Any) -> str:
    if not getattr(setting.scenario.scanner.position_sensor.noise, noise):
        return f"the scenario's sensor has no {noise} noise"
    return _first_order(setting, **rest)


def _measure_sigma(
    setting: ComparisonSetup,
    *,
    number: int,
    noise: tuple[str, ...],
    variance: Variance,
    peak: PeakMethod | None,
    slope: bool,
) -> dict[str, Measured]:
    """Measure σ of the range on facing plates at the ranges that can be used, and its exponent."""
    chosen, cases = peak or setting.scenario.processing.peak, {}
    ranges = _usable(setting, variance, chosen)
    shots = setting.shots(4000)
    for step, distance in enumerate(ranges):
        groups = []
        for index, (where, _) in enumerate(spots(setting, distance)):
            for seed in setting.seed(number, step, index):
                plate = test_bench.plate(where, setting.flat.reflectance, size=plate_side(setting, where))
                made = test_bench.on_test_bench(setting, plate, seed=seed, noise=noise, peak=peak)
                aim = test_bench.directions(np.zeros(shots), 0.0, made.scanner.mirrors, 0.0)
                groups.append(1e3 * test_bench.range_errors(setting, made, aim))
        cases[f"{distance:.4g} m"] = spread_of(np.stack(groups))
    return cases | slope_over(ranges, cases, slope)


def _predict_sigma(
    setting: ComparisonSetup, *, variance: Variance, peak: str | None, slope: bool, pure: str
) -> dict[str, Predicted]:
    chosen = peak or setting.scenario.processing.peak
    ranges = _usable(setting, variance, chosen)
    cases = {f"{R:.4g} m": _sigma(setting, R, variance, chosen) for R in ranges}
    return cases | slope_expected(ranges, cases, slope, pure)


def slope_over(ranges: tuple[float, ...], cases: dict[str, Measured], slope: bool) -> dict[str, Measured]:
    """Return the exponent of measured standard deviations against range, if there is a slope."""
    return {SLOPE: slope_of(np.array(ranges), list(cases.values()))} if slope and len(ranges) > 2 else {}


def slope_expected(
    ranges: tuple[float, ...], cases: dict[str, Predicted], slope: bool, pure: str
) -> dict[str, Predicted]:
    """Return the predicted exponent; ``pure`` says what it would be of the law alone."""
    if not slope or len(ranges) < 3:
        return {}
    return {SLOPE: slope_predicted(np.array(ranges), list(cases.values()), f"exponent ({pure})")}


def plate_side(setting: ComparisonSetup, distance: float) -> float:
    """Return the side [m] of a plate that holds the beam and all directions in which it is met."""
    return 2.4 * SPREAD * distance + 16.0 * setting.scenario.scanner.laser.radius(distance)


def _alone(
    name: str, title: str, source: str, statement: str, number: int, variance: Variance, pure: str
) -> Law:
    """Return the law of one term of the sensor's noise."""
    rest: dict[str, Any] = {"variance": variance, "peak": None, "slope": True}
    return Law(
        name=f"sigma_{name}",
        title=title,
        source=source,
        statement=statement,
        scene="target",
        applies=partial(_has_noise, noise=name, **rest),
        measure=partial(_measure_sigma, number=number, noise=(name,), **rest),
        predict=partial(_predict_sigma, pure=pure, **rest),
        exercises="peak",
        needs=("sigma",),
    )


SHOT = _alone(
    "shot",
    "Range noise of photons",
    "eq 4 with Poisson noise; slope R³",
    "σ_R = R²/(f d) (∑ g_i² N_i)^½ with the estimator's gradient g, of the maximum-likelihood fit that of all it fits. "
    "Poisson noise alone. The exponent is 3 but for the change of the spot's width with range.",
    4,
    _shot_variance,
    "3 for a spot of one width",
)
READ = _alone(
    "read",
    "Range noise of read-out",
    "eq 4 with white noise; slope R⁴",
    "σ_R = R²/(f d) (∑ g_i² σ_r²)^½ as for photons. Read noise alone. The exponent is 4 but for the spot's width.",
    5,
    _read_variance,
    "4 for a spot of one width",
)

_BOUND: dict[str, Any] = {"variance": _both_variances, "peak": FIT, "slope": False}
BOUND = Law(
    "cramer_rao",
    "The fit reaches the Cramér–Rao bound",
    "Winick, J. Opt. Soc. Am. A 3 (1986), with charge and width unknown (Kay 1993, sec 3.7)",
    "Of the information ∑ ∂m_i/∂θ ∂m_i/∂θᵀ/(m_i + dark + σ_r²) on charge, position and width, and of what is known of "
    "the width, follows σ_p of the maximum-likelihood fit, whatever the scenario's estimator. Shot, read, dark noise.",
    "target",
    partial(_first_order, **_BOUND),
    partial(_measure_sigma, number=6, noise=("shot", "read", "dark"), **_BOUND),
    partial(_predict_sigma, pure="", **_BOUND),
    exercises="built-in",
)
