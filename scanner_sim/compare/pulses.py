"""Laws of time of flight: the bound on the delay, the clock's floor, and the walk of a fixed level."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic import time_of_flight as judge
from scanner_sim.analytic.edge import sampled_crossing
from scanner_sim.compare import stand
from scanner_sim.compare.closed import Closed
from scanner_sim.compare.law import Law, Measured, Predicted, mean_of, spread_of
from scanner_sim.compare.setting import Setting
from scanner_sim.constants import SPEED_OF_LIGHT
from scanner_sim.scenario import Scenario

Array = NDArray[np.float64]

_PLACES = 4
"""Places of the echo between two samples."""
_TO_SIGMA = 1.0 / 2.3548200450309493
_SNR = 20.0, 100.0, 500.0
"""Ratios of peak to noise: above them the filter's table of delays counts, below them false alarms."""
_EFFICIENCY = 0.02
"""What interpolation between samples loses against the bound, at most."""
_ASIDE = 0.15
"""Deflection to each side over which the plates for the places stand [rad]."""
_BIAS = 1e-3
"""Error of the interpolation of a delay [sample]."""
_RATIOS = (2.0, 4.0, 8.0, 16.0)
"""Peaks over the level, of which the first is the reference."""
_WALK = 0.5
"""What is left of the law of the walk [mm]: four places between two samples stand for all."""


def _timed(setting: Setting) -> str:
    if setting.scenario.ranging == "triangulation":
        return "the scenario ranges by triangulation alone"
    if setting.scenario.scanner.lidar.pulse.shape != "gaussian":
        return "the pulse is no Gaussian"
    if setting.scenario.scanner.lidar.photodiode.place != "coaxial":
        return "the diode does not look along the laser"
    return (
        "" if _echoes(setting) else "no plate within the digitiser's gate gives the echoes that are asked for"
    )


def _widths(setting: Setting) -> tuple[float, float]:
    """Return the standard deviations of pulse and electronics [s]."""
    unit = setting.scenario.scanner.lidar
    return unit.pulse.width * _TO_SIGMA, math.sqrt(math.log(2.0)) / (
        2.0 * math.pi * unit.photodiode.bandwidth
    )


def _peak(setting: Setting, R: float, reflectance: float) -> float:
    """Return the peak current of an echo [A]: eq 19 for the pulse, its spread by the electronics, and the avalanche."""
    scanner, closed = setting.scenario.scanner, Closed(setting.scenario)
    pulse, response = _widths(setting)
    unit = scanner.lidar
    energy = unit.pulse.pulse_energy * closed.peak_transmission * closed.passed(0.0)
    collected = energy * reflectance * scanner.receiver.aperture**2 / (4.0 * R**2)
    height = collected / (math.sqrt(2.0 * math.pi) * math.hypot(pulse, response))
    return height * unit.photodiode.gain * unit.photodiode.responsivity


def _noise(setting: Setting) -> tuple[float, float]:
    """Return σ of the noise in the dark [A] without shot noise, and the share of its variance that is white."""
    unit = setting.scenario.scanner.lidar
    diode, clock = unit.photodiode, unit.digitiser
    step = diode.saturation * 17.0 / 16.0 / (2.0**clock.bits - 1.0) if diode.noise.quantisation else 0.0
    amplifier = diode.amplifier_noise if diode.noise.amplifier else 0.0
    rounding, coloured = step**2 / 12.0, amplifier**2 * judge.noise_bandwidth(diode.bandwidth)
    variance = rounding + coloured
    return math.sqrt(variance), rounding / variance if variance else 0.0


def _recorded(setting: Setting, R: float) -> bool:
    near, far = setting.scenario.scanner.lidar.digitiser.gate
    margin = SPEED_OF_LIGHT * math.hypot(*_widths(setting)) * 2.0
    return near + margin < R < far - margin


def _echoes(setting: Setting) -> dict[str, tuple[float, float]]:
    """Return echoes of chosen ratios of peak to noise, by name: their range [m] and the plate's reflectance.

    The plate stands in the middle of the ranges, and is as grey as the echo asks for.
    """
    sigma, _ = _noise(setting)
    R = _range(setting)
    if not sigma or R is None:
        return {}
    limit = setting.scenario.scanner.lidar.photodiode.saturation
    found = {}
    for ratio in _SNR:
        grey = ratio * sigma / _peak(setting, R, 1.0)
        if grey <= 1.0 and ratio * sigma < 0.8 * limit:
            found[f"echo of {ratio:g} times the noise, {R:.4g} m"] = R, grey
    return found


def _range(setting: Setting) -> float | None:
    """Return the target's range next to the middle that the digitiser records; None where there is none."""
    kept = [R for R in setting.flat.ranges if _recorded(setting, R)]
    return kept[len(kept) // 2] if kept else None


def _near(setting: Setting, R: float) -> Iterator[float]:
    """Yield ranges about one at which the echo lies at even places between two samples."""
    step = 0.5 * SPEED_OF_LIGHT / setting.scenario.scanner.lidar.digitiser.rate
    for place in (np.arange(_PLACES) + 0.5) / _PLACES - 0.5:
        yield R + float(place) * step


def _silent(setting: Setting, *on: str, **timing: Any) -> dict[str, Any]:
    """Return the changes of the scenario that leave the named imperfections of the receiver only."""
    scenario = setting.scenario
    unit, still = scenario.scanner.lidar, scenario.scanner.mirrors.still()
    switches = {name: name in on and value for name, value in unit.photodiode.noise}
    diode = unit.photodiode.model_copy(update={"noise": unit.photodiode.noise.model_copy(update=switches)})
    clock = unit.digitiser.model_copy(update={"drift": 0.0})
    lidar = unit.model_copy(update={"photodiode": diode, "digitiser": clock})
    laser = scenario.scanner.laser.model_copy(update={"speckle": False})
    pulse = scenario.processing.pulse.model_copy(update=timing)
    return {
        "ranging": "tof",
        "scanner": scenario.scanner.model_copy(update={"lidar": lidar, "mirrors": still, "laser": laser}),
        "processing": scenario.processing.model_copy(update={"range_gate": None, "pulse": pulse}),
    }


def _errors(
    setting: Setting, R: float, reflectance: float, seed: int, shots: int, made: dict[str, Any]
) -> Array:
    """Return errors of the range [mm] on plates at even places between two samples, shape (places, shots).

    The plates stand side by side, each faces the beam in a direction of its own.
    """
    closed, ranges = Closed(setting.scenario), list(_near(setting, R))
    aside = min(_ASIDE, setting.scenario.scanner.mirrors.max_deflection)
    theta = np.linspace(-aside, aside, len(ranges))
    plates = [
        stand.plate(
            where,
            reflectance,
            theta=angle,
            separation=closed.D,
            size=0.02 * where + 16.0 * setting.scenario.scanner.laser.radius(where),
            name=f"target_{number}",
        )
        for number, (where, angle) in enumerate(zip(ranges, theta.tolist(), strict=True))
    ]
    scenario: Scenario = stand.on_stand(setting, *plates, seed=seed, **made)
    aim = stand.directions(np.repeat(theta, shots), 0.0, scenario.scanner.mirrors, 0.0)
    return 1e3 * stand.range_errors(setting, scenario, aim).reshape(len(ranges), shots)


def _scatter(setting: Setting, number: int, *on: str) -> dict[str, Measured]:
    told = {}
    made = _silent(setting, *on, timing="matched_filter", echo="strongest")
    for step, (case, (R, grey)) in enumerate(_echoes(setting).items()):
        groups = [
            _errors(setting, R, grey, seed, setting.shots(4000), made) for seed in setting.seed(number, step)
        ]
        told[case] = spread_of(np.concatenate(groups))
    return told


def _measure_bias(setting: Setting) -> dict[str, Measured]:
    made, told = _silent(setting, "amplifier", "quantisation", timing="matched_filter", echo="strongest"), {}
    for step, (case, (R, grey)) in enumerate(_echoes(setting).items()):
        errors = [
            _errors(setting, R, grey, seed, setting.shots(2000), made) for seed in setting.seed(17, step)
        ]
        told[case] = mean_of(np.concatenate(errors).ravel())
    return told


def _predict_bias(setting: Setting) -> dict[str, Predicted]:
    step = 0.5e3 * SPEED_OF_LIGHT / setting.scenario.scanner.lidar.digitiser.rate
    return {
        case: Predicted("mean error of R", "mm", 0.0, _BIAS * step, 1e3 * R, "range")
        for case, (R, _) in _echoes(setting).items()
    }


def _bound(setting: Setting, R: float, reflectance: float) -> float:
    """Return the bound on σ of the range [mm], root mean square over the places between two samples."""
    sigma, white = _noise(setting)
    step = 1.0 / setting.scenario.scanner.lidar.digitiser.rate
    bounds = [
        judge.coloured_noise_bound(*_widths(setting), step, _peak(setting, where, reflectance) / sigma, white)
        for where in _near(setting, R)
    ]
    return 0.5e3 * SPEED_OF_LIGHT * math.sqrt(float(np.mean(np.square(bounds))))


def _predict_bound(setting: Setting) -> dict[str, Predicted]:
    told = {}
    for case, echo in _echoes(setting).items():
        bound = _bound(setting, *echo)
        told[case] = Predicted("σ of R", "mm", bound, _EFFICIENCY * bound)
    return told


def _clocked(setting: Setting) -> str:
    unit = setting.scenario.scanner.lidar
    if not unit.photodiode.noise.clock or not unit.digitiser.jitter:
        return "the clock has no jitter"
    return _timed(setting)


def _predict_floor(setting: Setting) -> dict[str, Predicted]:
    told = {}
    floor = 0.5e3 * SPEED_OF_LIGHT * setting.scenario.scanner.lidar.digitiser.jitter
    for case, echo in _echoes(setting).items():
        bound = _bound(setting, *echo)
        value = math.hypot(floor, bound)
        told[case] = Predicted("σ of R", "mm", value, _EFFICIENCY * bound**2 / value + 2e-4 * value)
    return told


def _walks(setting: Setting) -> str:
    reason = _timed(setting)
    if reason:
        return reason
    if _walk_level(setting) < 10.0 * _noise(setting)[0]:
        return "the level would lie within the noise at this range"
    return ""


def _walk_range(setting: Setting) -> float:
    R = _range(setting)
    assert R is not None
    return R


def _walk_level(setting: Setting) -> float:
    """Return the level [A] that the strongest echo exceeds by the largest ratio, below the amplifier's saturation."""
    strongest = min(
        _peak(setting, _walk_range(setting), 1.0), 0.5 * setting.scenario.scanner.lidar.photodiode.saturation
    )
    return strongest / _RATIOS[-1]


def _walk_reflectance(setting: Setting, ratio: float) -> float:
    """Return the reflectance of a plate whose echo has a ratio of peak to level."""
    return ratio * _walk_level(setting) / _peak(setting, _walk_range(setting), 1.0)


def _measure_walk(setting: Setting) -> dict[str, Measured]:
    made = _silent(
        setting, "amplifier", timing="leading_edge", level=_walk_level(setting), walk_correction=False
    )
    means = {}
    for number, ratio in enumerate(_RATIOS):
        R, grey, shots = _walk_range(setting), _walk_reflectance(setting, ratio), setting.shots(2000)
        errors = [_errors(setting, R, grey, seed, shots, made) for seed in setting.seed(13, number)]
        # Each place has a systematic error of its own: the mean over the places is what the law is about.
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


def _predict_walk(setting: Setting) -> dict[str, Predicted]:
    width = math.hypot(*_widths(setting))
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


TOF_BOUND = Law(
    "tof_bound",
    "The matched filter reaches the bound on the delay",
    "Kay 1993, sec. 3.9, with eq 19 for the echo's light",
    "σ_R = c/2 times the Cramér–Rao bound of a Gaussian pulse of unknown height in the amplifier's coloured noise and "
    "the converter's white one. No shot noise, no clock.",
    "target",
    _timed,
    lambda setting: _scatter(setting, 11, "amplifier", "quantisation"),
    _predict_bound,
)
TOF_RANGE = Law(
    "tof_range",
    "No bias of time of flight",
    "R = c t/2",
    "The mean of (estimate − truth) is 0 for the matched filter. Amplifier and converter noise, no clock.",
    "target",
    _timed,
    _measure_bias,
    _predict_bias,
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
)
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
)
