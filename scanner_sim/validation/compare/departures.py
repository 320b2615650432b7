"""Law of the instrument as built: what its departures that nobody knows of make of a raster's points in the mean."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic import geometry
from scanner_sim.analytic.instrument_errors import EFFECTS, Sighted
from scanner_sim.config.built import instrument_as_built
from scanner_sim.config.calibration import believed_instrument
from scanner_sim.config.scanner import RangefinderName
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.parameters import INDEX, NAMES, PARAMETERS
from scanner_sim.products.settings import Output
from scanner_sim.validation.compare import test_bench
from scanner_sim.validation.compare.closed_forms import FIT, ClosedForms
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup
from scanner_sim.validation.compare.law import Law, Measured, Predicted, exact
from scanner_sim.validation.compare.pulses import silent

Array = NDArray[np.float64]

_SIDE = 9
"""Beams of the raster along each angle."""
_NEAR, _FAR = -0.5, 0.7
"""Its ends, over the mirrors' deflection: to one side further than to the other, so that no odd error cancels."""
_UNSTEADY = (
    "vibration",
    "base_expansion",
    "focal_expansion",
    "power_noise",
    "pulse_noise",
    "stray_light",
    "field_blur",
    "tangential_across",
)
"""Departures that are no parameters."""
_PIXEL, _SAMPLE = 2e-3, 2e-3
"""What two systematic errors of the fit [pixel] and of the matched filter [sample], on other places of their pixel or
sample, leave."""
_ROUNDING = 2.0**-22
"""Of points in single precision, of both instruments, over their range."""


@dataclass(frozen=True)
class _Instrument:
    """Deviations from the design, in the order of the parameters, and the period of the encoders' errors [rad]."""

    values: Array
    period: float


def _instruments(setting: ComparisonSetup) -> tuple[_Instrument, _Instrument]:
    """Return the instrument as built, and as believed."""
    built, believed = instrument_as_built(setting.scenario), believed_instrument(setting.scenario)
    none = _Instrument(np.zeros(len(NAMES)), math.tau)
    return (
        none if built is None else _Instrument(built.parameters, built.own.encoder_period or math.tau),
        none if believed is None else _Instrument(believed.values, believed.encoder_period),
    )


def _uncovered(setting: ComparisonSetup) -> str:
    built, believed = _instruments(setting)
    if not built.values.any() and not believed.values.any():
        own = setting.scenario.scanner.as_built
        if own is not None and any(getattr(own, name) for name in _UNSTEADY):
            return "what departs is none of the parameters, which alone have closed forms"
        return "the instrument is built and believed as designed"
    if not _moved_ways(setting):
        return f"no parameter that departs moves points by {' or '.join(map(_word, setting.scenario.rangefinders))}"
    if not _ways(setting):
        return "the closed forms are those of an ideal array and of a diode that looks along the laser"
    return "" if next(_rasters(setting), None) else "the detectors see no wall at these ranges"


def _ways(setting: ComparisonSetup) -> tuple[RangefinderName, ...]:
    """Return the ways of ranging of which there are closed forms, and whose points any departure moves."""
    scanner = setting.scenario.scanner
    known = {
        "triangulation": scanner.receiver.array_tilt == "ideal",
        "tof": scanner.lidar_choice != "none" and scanner.lidar.photodiode.place == "coaxial",
    }
    return tuple(way for way in _moved_ways(setting) if known[way])


def _moved_ways(setting: ComparisonSetup) -> tuple[RangefinderName, ...]:
    """Return the scenario's ways of ranging whose points any departure moves."""
    moved = {
        way: any(one.values[INDEX[name]] for one in _instruments(setting) for name in EFFECTS[way])
        for way in EFFECTS
    }
    return tuple(way for way in setting.scenario.rangefinders if moved[way])


def _word(way: str) -> str:
    return "triangulation" if way == "triangulation" else "time of flight"


def _rasters(setting: ComparisonSetup) -> Iterator[tuple[RangefinderName, float, Array, Array, Array]]:
    """Yield way of ranging and distance of the wall [m], and Θ, φ [rad] and R [m] of the beams, each (n,)."""
    closed = ClosedForms(setting.scenario)
    most = setting.scenario.scanner.mirrors.max_deflection
    theta, phi = (grid.ravel() for grid in np.meshgrid(*2 * [np.linspace(_NEAR * most, _FAR * most, _SIDE)]))
    normal = np.array([0.0, 0.0, -1.0])
    for way in _ways(setting):
        for distance in dict.fromkeys((setting.flat.ranges[0], setting.middle)):
            point = np.array([0.0, 0.0, distance])
            r = geometry.range_to_plane(theta, phi, closed.D, point, normal)
            if way == "triangulation":
                kept = [
                    closed.on_array(closed.spot(one, other, point, normal, setting.flat.reflectance))
                    for one, other in zip(theta.tolist(), phi.tolist(), strict=True)
                ]
            else:
                near, far = setting.scenario.scanner.lidar.digitiser.gate
                kept = list((r > near + 1.0) & (r < far - 1.0))
            if any(kept):
                yield way, distance, theta[kept], phi[kept], r[kept]


def _case(way: str, distance: float, axis: str) -> str:
    return f"{axis} by {_word(way)}, wall at {distance:.4g} m"


def _measure(setting: ComparisonSetup) -> dict[str, Measured]:
    cases = {}
    for way, distance, theta, phi, _ in _rasters(setting):
        away = [_errors(setting, way, distance, theta, phi, as_built=built) for built in (True, False)]
        for axis, error in zip("xyz", (away[0] - away[1]).mean(axis=0).tolist(), strict=True):
            cases[_case(way, distance, axis)] = exact(1e3 * error)
    return cases


def _errors(
    setting: ComparisonSetup,
    way: RangefinderName,
    distance: float,
    theta: Array,
    phi: Array,
    *,
    as_built: bool,
) -> Array:
    """Return measured less true points [m], (n, 3), without noise, of the instrument as built or as designed."""
    scenario = _steady(setting.scenario) if as_built else _designed(setting.scenario)
    side = 2.5 * distance * math.tan(setting.scenario.scanner.mirrors.max_deflection)
    wall = test_bench.plate(distance, setting.flat.reflectance, size=side)
    settled = ComparisonSetup(scenario, setting.flat, device=setting.device)
    seed, output = scenario.seed, Output(truth=("point",))
    if way == "tof":
        found: dict[str, Any] = silent(settled, timing="matched_filter", echo="strongest")
        found["output"] = output
        made = test_bench.on_test_bench(settled, wall, seed=seed, **found)
    else:
        made = test_bench.on_test_bench(settled, wall, seed=seed, peak=FIT, output=output)
    layers = test_bench.measure(settled, made, test_bench.directions(theta, phi, made.scanner.mirrors, 0.0))
    point, true = (np.stack([layers[f"{of}.{axis}"] for axis in "XYZ"], axis=1) for of in ("P", "truth.P"))
    return np.asarray(point - true)


def _steady(scenario: Scenario) -> Scenario:
    """Return the scenario with its instrument, whose departures stay what they are, and nothing that changes."""
    own = scenario.scanner.as_built
    if own is None:
        return scenario
    seed = scenario.transport.seed_of_light(scenario.seed) if own.seed is None else own.seed
    still = own.model_copy(update=dict.fromkeys(_UNSTEADY) | {"seed": seed})
    return scenario.model_copy(update={"scanner": scenario.scanner.model_copy(update={"as_built": still})})


def _designed(scenario: Scenario) -> Scenario:
    """Return the scenario with the instrument as it was designed, which believes so."""
    plain = scenario.scanner.model_copy(update={"as_built": None})
    believing = scenario.processing.model_copy(update={"calibration": None})
    return scenario.model_copy(update={"scanner": plain, "processing": believing})


def _predict(setting: ComparisonSetup) -> dict[str, Predicted]:
    closed, cases = ClosedForms(setting.scenario), {}
    for way, distance, theta, phi, r in _rasters(setting):
        moved = _moved(setting, way, r, theta, phi)
        # What the first order leaves out: how much the effects change from the true point to the measured one, and
        # from the lengths as designed to those as built.
        point = geometry.point_from_shot(r, theta, phi, closed.D) + moved
        there, theta_there, phi_there = geometry.shot_from_point(point, closed.D)
        built, _ = _instruments(setting)
        again = _moved(setting, way, there, theta_there, phi_there, built.values)
        mean, second = moved.mean(axis=0).tolist(), np.abs(again - moved).mean(axis=0)
        if way == "triangulation":
            own = _PIXEL * max(
                closed.range_per_pixel(one, angle)
                for one, angle in zip(r.tolist(), theta.tolist(), strict=True)
            )
        else:
            own = 0.5 * _SAMPLE * SPEED_OF_LIGHT / setting.scenario.scanner.lidar.digitiser.rate
        for number, axis in enumerate("xyz"):
            accuracy = float(second[number]) + own + _ROUNDING * float(r.max())
            cases[_case(way, distance, axis)] = Predicted(
                f"mean error of {axis}", "mm", 1e3 * mean[number], 1e3 * accuracy, 1e3 * distance, "range"
            )
    return cases


def _moved(
    setting: ComparisonSetup, way: str, r: Array, theta: Array, phi: Array, lengths: Array | None = None
) -> Array:
    """Return measured less true points [m], (n, 3), to first order, with lengths by which the optics are longer."""
    closed, total = ClosedForms(setting.scenario), np.zeros((len(r), 3))
    longer = np.zeros(len(NAMES)) if lengths is None else lengths
    for sign, one in zip((1.0, -1.0), _instruments(setting), strict=True):
        seen = Sighted(
            r,
            theta,
            phi,
            closed.f + longer[INDEX["focal_length"]],
            closed.d + longer[INDEX["base"]],
            closed.D + longer[INDEX["axis_separation"]],
            one.period,
        )
        for parameter, value in zip(PARAMETERS, one.values.tolist(), strict=True):
            if value and parameter.name in EFFECTS[way]:
                total += sign * value * EFFECTS[way][parameter.name](seen)
    return total


DEPARTURES = Law(
    "departures",
    "Mean error of a raster by departures that are not known",
    "Beraldin et al. 1997; Lichti 2007; Brown 1971",
    "The mean error of a raster's points on a wall is the sum of each parameter's effect times what the instrument is "
    "built by and does not believe; without noise, less what the instrument as designed errs.",
    "target",
    _uncovered,
    _measure,
    _predict,
    exercises="built-in",
    rangefinder=None,
    of_built=True,
)
