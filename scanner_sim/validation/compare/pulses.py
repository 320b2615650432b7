"""Laws of time of flight: no bias, the bound on the delay, and the clock's floor."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic import time_of_flight as judge
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.validation.compare import test_bench
from scanner_sim.validation.compare.closed_forms import ClosedForms
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup
from scanner_sim.validation.compare.law import Law, Measured, Predicted, mean_of, spread_of

Array = NDArray[np.float64]

_PLACES = 4
"""Positions of the echo between two samples."""
TO_SIGMA = 1.0 / 2.3548200450309493
_SNR = 20.0, 100.0, 500.0
"""Ratios of peak to noise: above them the filter's table of delays counts, below them false alarms."""
_EFFICIENCY = 0.02
"""What interpolation between samples loses against the bound, at most."""
_ASIDE = 0.15
"""Deflection to each side over which the plates for the positions stand [rad]."""
_BIAS = 1e-3
"""Error of the interpolation of a delay [sample]."""


def pulses_uncovered(setting: ComparisonSetup) -> str:
    """Return why the closed forms do not cover the scenario's time of flight; empty where they do."""
    if "tof" not in setting.scenario.rangefinders:
        return "the scenario ranges by triangulation alone"
    if setting.scenario.scanner.lidar.pulse.shape != "gaussian":
        return "the pulse is no Gaussian"
    if setting.scenario.scanner.lidar.photodiode.place != "coaxial":
        return "the diode does not look along the laser"
    if not dark_noise(setting)[0]:
        return "amplifier and converter have no noise, by which the echoes are chosen"
    if _rounds_coarsely(setting):
        return (
            "the converter's step is more than twice the noise on it, so that its rounding is no white noise"
        )
    return (
        "" if _echoes(setting) else "no plate within the digitiser's gate gives the echoes that are asked for"
    )


def _rounds_coarsely(setting: ComparisonSetup) -> bool:
    """Return whether rounding goes with the signal: the variance of its error then differs by over e^(−2π²/4), 0.7 %.

    The error of rounding to steps Δ of a signal with normal noise σ is uniform and white but for terms of
    e^(−2π² σ²/Δ²) (Widrow and Kollár, *Quantization noise*, 2008, sec. 5).
    """
    sigma, white = dark_noise(setting)
    step = sigma * math.sqrt(12.0 * white)
    return step > 2.0 * sigma * math.sqrt(1.0 - white)


def pulse_widths(setting: ComparisonSetup) -> tuple[float, float]:
    """Return the standard deviations of pulse and electronics [s]."""
    unit = setting.scenario.scanner.lidar
    return unit.pulse.width * TO_SIGMA, math.sqrt(math.log(2.0)) / (2.0 * math.pi * unit.photodiode.bandwidth)


def echo_peak(setting: ComparisonSetup, R: float, reflectance: float) -> float:
    """Return the peak current of an echo [A]: eq 19 for the pulse, its spread by the electronics, and the avalanche."""
    scanner, closed = setting.scenario.scanner, ClosedForms(setting.scenario)
    pulse, response = pulse_widths(setting)
    unit = scanner.lidar
    energy = unit.pulse.pulse_energy * closed.peak_transmission * closed.passed(0.0, unit.photodiode.response)
    collected = energy * reflectance * scanner.receiver.aperture**2 / (4.0 * R**2)
    height = collected / (math.sqrt(2.0 * math.pi) * math.hypot(pulse, response))
    return height * unit.photodiode.gain * unit.photodiode.responsivity


def dark_noise(setting: ComparisonSetup) -> tuple[float, float]:
    """Return σ of the noise in the dark [A] without shot noise, and the share of its variance that is white."""
    unit = setting.scenario.scanner.lidar
    diode, clock = unit.photodiode, unit.digitiser
    step = diode.saturation * 17.0 / 16.0 / (2.0**clock.bits - 1.0) if diode.noise.quantisation else 0.0
    amplifier = diode.amplifier_noise if diode.noise.amplifier else 0.0
    rounding, coloured = step**2 / 12.0, amplifier**2 * judge.noise_bandwidth(diode.bandwidth)
    variance = rounding + coloured
    return math.sqrt(variance), rounding / variance if variance else 0.0


def _recorded(setting: ComparisonSetup, R: float) -> bool:
    near, far = setting.scenario.scanner.lidar.digitiser.gate
    margin = SPEED_OF_LIGHT * math.hypot(*pulse_widths(setting)) * 2.0
    return near + margin < R < far - margin


def _echoes(setting: ComparisonSetup) -> dict[str, tuple[float, float]]:
    """Return echoes of chosen ratios of peak to noise, by name: their range [m] and the plate's reflectance.

    The plate stands in the middle of the ranges, and is as grey as the echo asks for.
    """
    sigma, _ = dark_noise(setting)
    R = echo_range(setting)
    if not sigma or R is None:
        return {}
    limit = setting.scenario.scanner.lidar.photodiode.saturation
    found = {}
    for ratio in _SNR:
        grey = ratio * sigma / echo_peak(setting, R, 1.0)
        if grey <= 1.0 and ratio * sigma < 0.8 * limit:
            found[f"echo of {ratio:g} times the noise, {R:.4g} m"] = R, grey
    return found


def echo_range(setting: ComparisonSetup) -> float | None:
    """Return the target's range next to the middle that the digitiser records; None where there is none."""
    kept = [R for R in setting.flat.ranges if _recorded(setting, R)]
    return kept[len(kept) // 2] if kept else None


def near(setting: ComparisonSetup, R: float, places: int = _PLACES) -> Iterator[float]:
    """Yield ranges about one at which the echo lies at even positions between two samples."""
    step = 0.5 * SPEED_OF_LIGHT / setting.scenario.scanner.lidar.digitiser.rate
    for position in (np.arange(places) + 0.5) / places - 0.5:
        yield R + float(position) * step


def silent(setting: ComparisonSetup, *on: str, **timing: str | float | bool) -> dict[str, object]:
    """Return the changes of the scenario that leave the named imperfections of the receiver only."""
    scanner = setting.scenario.scanner
    switches = {name: name in on and value for name, value in scanner.lidar.photodiode.noise}
    return {
        "ranging": "tof",
        "scanner": {
            "lidar": {"photodiode": {"noise": switches}, "digitiser": {"drift": 0.0}},
            "mirrors": scanner.mirrors.still(),
            "laser": {"speckle": False},
        },
        "processing": {"range_gate": None, "pulse": timing},
    }


def plate_errors(
    setting: ComparisonSetup,
    ranges: Sequence[float],
    reflectances: Sequence[float],
    seed: int,
    shots: int,
    made: dict[str, Any],
) -> Array:
    """Return errors of the range [mm] on plates at some ranges [m], shape (plates, shots).

    The plates stand side by side, each faces the beam in a direction of its own.
    """
    closed = ClosedForms(setting.scenario)
    aside = min(_ASIDE, setting.scenario.scanner.mirrors.max_deflection)
    theta = np.linspace(-aside, aside, len(ranges))
    plates = [
        test_bench.plate(
            where,
            grey,
            theta=angle,
            separation=closed.D,
            size=0.02 * where + 16.0 * setting.scenario.scanner.laser.radius(where),
            name=f"target_{number}",
        )
        for number, (where, grey, angle) in enumerate(zip(ranges, reflectances, theta.tolist(), strict=True))
    ]
    scenario: Scenario = test_bench.on_test_bench(setting, *plates, seed=seed, **made)
    aim = test_bench.directions(np.repeat(theta, shots), 0.0, scenario.scanner.mirrors, 0.0)
    return 1e3 * test_bench.range_errors(setting, scenario, aim).reshape(len(ranges), shots)


def _alike(setting: ComparisonSetup, R: float, grey: float) -> tuple[list[float], list[float]]:
    """Return ranges [m] at even positions between two samples about one, and the reflectance of the plates there."""
    ranges = list(near(setting, R))
    return ranges, [grey] * len(ranges)


def _scatter(setting: ComparisonSetup, number: int, *on: str) -> dict[str, Measured]:
    cases = {}
    made = silent(setting, *on, timing="matched_filter", echo="strongest")
    for step, (case, (R, grey)) in enumerate(_echoes(setting).items()):
        groups = [
            plate_errors(setting, *_alike(setting, R, grey), seed, setting.shots(4000), made)
            for seed in setting.seed(number, step)
        ]
        cases[case] = spread_of(np.concatenate(groups))
    return cases


def _measure_bias(setting: ComparisonSetup) -> dict[str, Measured]:
    made, cases = silent(setting, "amplifier", "quantisation", timing="matched_filter", echo="strongest"), {}
    for step, (case, (R, grey)) in enumerate(_echoes(setting).items()):
        errors = [
            plate_errors(setting, *_alike(setting, R, grey), seed, setting.shots(2000), made)
            for seed in setting.seed(17, step)
        ]
        cases[case] = mean_of(np.concatenate(errors).ravel())
    return cases


def _predict_bias(setting: ComparisonSetup) -> dict[str, Predicted]:
    step = 0.5e3 * SPEED_OF_LIGHT / setting.scenario.scanner.lidar.digitiser.rate
    return {
        case: Predicted("mean error of R", "mm", 0.0, _BIAS * step, 1e3 * R, "range")
        for case, (R, _) in _echoes(setting).items()
    }


def _bound(setting: ComparisonSetup, R: float, reflectance: float) -> float:
    """Return the bound on σ of the range [mm], root mean square over the positions between two samples."""
    sigma, white = dark_noise(setting)
    step = 1.0 / setting.scenario.scanner.lidar.digitiser.rate
    bounds = [
        judge.coloured_noise_bound(
            *pulse_widths(setting), step, echo_peak(setting, where, reflectance) / sigma, white
        )
        for where in near(setting, R)
    ]
    return 0.5e3 * SPEED_OF_LIGHT * math.sqrt(float(np.mean(np.square(bounds))))


def _predict_bound(setting: ComparisonSetup) -> dict[str, Predicted]:
    cases = {}
    for case, echo in _echoes(setting).items():
        bound = _bound(setting, *echo)
        cases[case] = Predicted("σ of R", "mm", bound, _EFFICIENCY * bound)
    return cases


def _clocked(setting: ComparisonSetup) -> str:
    unit = setting.scenario.scanner.lidar
    if not unit.photodiode.noise.clock or not unit.digitiser.jitter:
        return "the clock has no jitter"
    return pulses_uncovered(setting)


def _predict_floor(setting: ComparisonSetup) -> dict[str, Predicted]:
    cases = {}
    floor = 0.5e3 * SPEED_OF_LIGHT * setting.scenario.scanner.lidar.digitiser.jitter
    for case, echo in _echoes(setting).items():
        bound = _bound(setting, *echo)
        value = math.hypot(floor, bound)
        cases[case] = Predicted("σ of R", "mm", value, _EFFICIENCY * bound**2 / value + 2e-4 * value)
    return cases


TOF_BOUND = Law(
    "tof_bound",
    "The matched filter reaches the bound on the delay",
    "Kay 1993, sec. 3.9, with eq 19 for the echo's light",
    "σ_R = c/2 times the Cramér–Rao bound of a Gaussian pulse of unknown height in the amplifier's coloured noise and "
    "the converter's white one. No shot noise, no clock.",
    "target",
    pulses_uncovered,
    lambda setting: _scatter(setting, 11, "amplifier", "quantisation"),
    _predict_bound,
    exercises="built-in",
    rangefinder="tof",
)
TOF_RANGE = Law(
    "tof_range",
    "No bias of time of flight",
    "R = c t/2",
    "The mean of (estimate − truth) is 0 for the matched filter. Amplifier and converter noise, no clock.",
    "target",
    pulses_uncovered,
    _measure_bias,
    _predict_bias,
    exercises="built-in",
    rangefinder="tof",
)
TOF_SIGMA = Law(
    "tof_sigma",
    "Noise of time of flight",
    "Figure 12: flat within its floor",
    "σ_R² = (c/2 jitter)² + the bound's. As before, with the clock's jitter.",
    "target",
    _clocked,
    lambda setting: _scatter(setting, 12, "amplifier", "quantisation", "clock"),
    _predict_floor,
    exercises="built-in",
    rangefinder="tof",
)
