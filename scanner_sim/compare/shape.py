"""Laws of the image of the spot and of the point that it gives: eqs 1, 3, 5 and 19, the Gaussian beam."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic import geometry
from scanner_sim.analytic.estimators import ESTIMATORS
from scanner_sim.compare import stand
from scanner_sim.compare.closed import FIT, LINE, Closed, Spot
from scanner_sim.compare.law import Law, Measured, Predicted, exact, mean_of, spread_of
from scanner_sim.compare.setting import Setting
from scanner_sim.optics.deflection import ERRORS
from scanner_sim.scenario import Scenario

Array = NDArray[np.float64]

_FIELD = 0.8
"""Share of the mirrors' deflection over which the field is tested."""
_PRECISION = 3e-4
"""Rounding of simulated places [pixel], and of widths and charges relative to themselves: single precision."""
_TABLE = 1e-3
"""What a computed correction leaves of an estimator's systematic error [pixel]."""
_ROUNDING = 6e-8
"""Of coordinates in single precision, over the range."""
_TOWARDS = np.array([0.0, 0.0, -1.0])
_STEADY = 5.0
"""Times of the wobble between two shots: nothing is left of it then."""


class Place(NamedTuple):
    """A place in the field: its name, range of the wall or plate [m], deflections [rad]."""

    name: str
    distance: float
    theta: float
    phi: float


def places(setting: Setting, ranges: tuple[float, ...]) -> Iterator[Place]:
    """Yield the axis and four corners of the field at some ranges, where the array sees the spot.

    The corners are not mirror images of one another, so that no sign or exchange of axes goes unseen.
    """
    far = _FIELD * setting.scenario.scanner.mirrors.max_deflection
    for distance in ranges:
        for theta, phi in (
            (0.0, 0.0),
            (-far, 0.7 * far),
            (-0.6 * far, -far),
            (0.8 * far, 0.9 * far),
            (far, -far),
        ):
            place = Place(f"{distance:.4g} m, Θ {theta:+.2f}, φ {phi:+.2f}", distance, theta, phi)
            if Closed(setting.scenario).on_array(_on_wall(setting, place)):
                yield place


def _on_wall(setting: Setting, place: Place) -> Spot:
    """Return the judge's spot on a wall square to the z axis."""
    point = np.array([0.0, 0.0, place.distance])
    return Closed(setting.scenario).spot(place.theta, place.phi, point, _TOWARDS, setting.flat.reflectance)


def _wall_ranges(setting: Setting) -> tuple[float, ...]:
    ranges = setting.flat.ranges
    return tuple(dict.fromkeys((ranges[0], setting.middle, ranges[-1])))


def _seen(setting: Setting) -> str:
    return (
        "" if next(places(setting, _wall_ranges(setting)), None) else "the array sees no spot at these ranges"
    )


def _wall_lines(setting: Setting) -> Iterator[tuple[Place, Array]]:
    """Yield places of the field and the noise-free charges of their lines on a wall."""
    for distance in _wall_ranges(setting):
        own = list(places(setting, (distance,)))
        if not own:
            continue
        size = 2.5 * distance * math.tan(max(max(abs(place.theta), abs(place.phi)) for place in own) + 0.1)
        wall = stand.plate(distance, setting.flat.reflectance, size=size)
        # Noise-free light hides nothing behind the converter, and a strong laser no pixel behind its full well.
        made = stand.on_stand(setting, wall, seed=setting.seed(1)[0])
        aim = stand.directions(
            [place.theta for place in own], [place.phi for place in own], made.scanner.mirrors, 0.0
        )
        yield from zip(own, stand.lines(setting, made, aim), strict=True)


def _centroid(line: Array) -> float:
    return float(np.arange(line.size) @ line / line.sum())


def _width(line: Array) -> float:
    """Return the standard deviation of a line [pixel], the pixels' own width taken off (Sheppard)."""
    away = np.arange(line.size) - _centroid(line)
    return math.sqrt(float(away**2 @ line / line.sum()) - 1.0 / 12.0)


def _of_lines(value: Callable[[Array], float]) -> Callable[[Setting], dict[str, Measured]]:
    """Return what measures a number of the noise-free lines."""
    return lambda setting: {place.name: exact(value(line)) for place, line in _wall_lines(setting)}


def _lens(setting: Setting, place: Place) -> float:
    """Return (D/R)², by which the extent of the lens, which the closed forms take as small, changes light and shape."""
    return (setting.scenario.scanner.receiver.aperture / place.distance) ** 2


def _predict_position(setting: Setting) -> dict[str, Predicted]:
    closed, told = Closed(setting.scenario), {}
    for place in places(setting, _wall_ranges(setting)):
        seen = _on_wall(setting, place)
        from_infinity = seen.centre - closed.pixel(0.0)
        accuracy = _lens(setting, place) / 16.0 * from_infinity + _PRECISION
        told[place.name] = Predicted(
            "p", "mm", 1e3 * from_infinity * closed.pitch, 1e3 * accuracy * closed.pitch
        )
    return told


def _measure_position(setting: Setting) -> dict[str, Measured]:
    sensor = setting.scenario.scanner.position_sensor
    return {
        place.name: exact(1e3 * (sensor.offset + (_centroid(line) + 0.5) * sensor.pitch))
        for place, line in _wall_lines(setting)
    }


def _predict_width(setting: Setting) -> dict[str, Predicted]:
    told = {}
    for place in places(setting, _wall_ranges(setting)):
        width = _on_wall(setting, place).sigma
        told[place.name] = Predicted("σ", "pixel", width, (2.0 * _lens(setting, place) + _PRECISION) * width)
    return told


def _predict_charge(setting: Setting) -> dict[str, Predicted]:
    told = {}
    for place in places(setting, _wall_ranges(setting)):
        charge = _on_wall(setting, place).charge
        told[place.name] = Predicted(
            "charge", "electron", charge, (_lens(setting, place) + _PRECISION) * charge
        )
    return told


def _lit(setting: Setting) -> str:
    closed = Closed(setting.scenario)
    if closed.passed(0.0) < 0.5:
        return "the filter or the detector's response blocks the laser's line"
    if closed.band is not None and not closed.band.cavities:
        nearest = min(setting.flat.ranges)
        if closed.passed(math.atan(closed.d / nearest)) < 0.5:
            return "the band's steep edge lies within the spot, whose light the closed form takes as one incidence"
    return _seen(setting)


def plate_scenario(setting: Setting, place: Place, **more: object) -> Scenario:
    """Return the instrument before a plate that faces the beam at a place; ``more`` is for the stand."""
    closed = Closed(setting.scenario)
    size = 0.02 * place.distance + 16.0 * setting.scenario.scanner.laser.radius(place.distance)
    target = stand.plate(
        place.distance,
        setting.flat.reflectance,
        theta=place.theta,
        phi=place.phi,
        separation=closed.D,
        size=size,
    )
    return stand.on_stand(setting, target, **more)  # type: ignore[arg-type]


def facing_places(setting: Setting, ranges: tuple[float, ...]) -> Iterator[tuple[Place, Spot]]:
    """Yield places of the field whose plates face the beam, and the judge's spot there."""
    closed = Closed(setting.scenario)
    for place in places(setting, ranges):
        seen = closed.facing(place.distance, setting.flat.reflectance, place.theta, place.phi)
        if closed.on_array(seen):
            yield place, seen


def _errors_at(setting: Setting, made: Scenario, place: Place, shots: int) -> Array:
    """Return errors of x, y, z and R [m] in one direction, shape (n, 4)."""
    mirrors = made.scanner.mirrors
    aim = stand.directions(np.full(shots, place.theta), place.phi, mirrors, 1.0 / made.scanner.rate)
    aim.time[:] *= 0.5 * _STEADY
    layers = stand.measure(setting, made, aim)
    truth = geometry.point_from_shot(
        layers["truth.range_m"],
        layers["truth.theta_rad"],
        layers["truth.phi_rad"],
        Closed(setting.scenario).D,
    )
    point = np.stack([layers["P.X"], layers["P.Y"], layers["P.Z"]], axis=-1)
    return np.column_stack([point - truth, layers["range_m"] - layers["truth.range_m"]])


_COORDINATES = ("x", "y", "z", "R")


def _biased(setting: Setting) -> str:
    chosen = setting.scenario.processing
    if chosen.bias_correction not in ("none", "computed"):
        return "the correction of the estimator was measured, not computed: it has no closed form"
    return _lit(setting)


def _point_places(setting: Setting) -> Iterator[tuple[Place, Spot, tuple[str, ...]]]:
    """Yield places, spots and coordinates: ranges on the axis, and all coordinates over the field in the middle."""
    for distance in setting.flat.ranges:
        for place, seen in facing_places(setting, (distance,)):
            if distance == setting.middle or place.theta == place.phi == 0.0:
                yield place, seen, _COORDINATES if distance == setting.middle else ("R",)


def _measure_points(setting: Setting) -> dict[str, Measured]:
    noise, told = ("shot", "read", "dark", "quantisation"), {}
    for number, (place, _, names) in enumerate(_point_places(setting)):
        errors = np.concatenate(
            [
                _errors_at(
                    setting,
                    plate_scenario(setting, place, seed=seed, noise=noise, mirrors=stand.erring(setting)),
                    place,
                    setting.shots(4000),
                )
                for seed in setting.seed(2, number)
            ]
        )
        for name in names:
            told[f"{name} at {place.name}"] = mean_of(1e3 * errors[:, _COORDINATES.index(name)])
    return told


def _predict_points(setting: Setting) -> dict[str, Predicted]:
    closed, chosen, told = Closed(setting.scenario), setting.scenario.processing, {}
    for place, seen, names in _point_places(setting):
        systematic = 0.0
        if chosen.peak != FIT and chosen.bias_correction == "none":
            systematic = ESTIMATORS[chosen.peak](seen.line.tolist()) - LINE // 2 - seen.phase
        per_pixel = closed.range_per_pixel(place.distance, place.theta)
        bias = -per_pixel * (systematic + seen.centre - seen.chief)
        p = seen.centre - closed.pixel(0.0)
        accuracy = per_pixel * (_lens(setting, place) / 16.0 * p + _PRECISION)
        if chosen.bias_correction == "computed":
            accuracy += per_pixel * _TABLE
        along = dict(
            zip(_COORDINATES, (*geometry.scanner_axes(place.theta, place.phi)[0].tolist(), 1.0), strict=True)
        )
        for name in names:
            told[f"{name} at {place.name}"] = Predicted(
                f"mean error of {name}",
                "mm",
                1e3 * bias * along[name],
                1e3 * accuracy * abs(along[name]) + 1e3 * _ROUNDING * place.distance,
                1e3 * place.distance,
                "range",
            )
    return told


def _shaken(setting: Setting) -> str:
    mirrors = setting.scenario.scanner.mirrors
    if not any(getattr(mirrors, key) for name, keys in ERRORS.items() if name != "drift" for key in keys):
        return "the mirrors have no errors"
    if mirrors.readout_step > math.hypot(mirrors.jitter, mirrors.readout_noise):
        return "the encoders' step is larger than the noise on it, so that its error is no random one"
    return _biased(setting)


def _measure_covariance(setting: Setting) -> dict[str, Measured]:
    told = {}
    for number, (place, _) in enumerate(facing_places(setting, (setting.middle,))):
        errors = np.stack(
            [
                _errors_at(
                    setting,
                    plate_scenario(setting, place, seed=seed, mirrors=stand.erring(setting)),
                    place,
                    setting.shots(16000),
                )
                for seed in setting.seed(3, number)
            ]
        )
        for axis, name in enumerate(_COORDINATES):
            told[f"{name} at {place.name}"] = spread_of(1e3 * errors[..., axis])
    return told


def _predict_covariance(setting: Setting) -> dict[str, Predicted]:
    closed, mirrors, told = Closed(setting.scenario), setting.scenario.scanner.mirrors, {}
    angle = math.sqrt(
        (1.0 - mirrors.jitter_seen) * mirrors.jitter**2
        + mirrors.wobble**2
        + mirrors.readout_noise**2
        + mirrors.readout_step**2 / 12.0
    )
    for place, seen in facing_places(setting, (setting.middle,)):
        p = float(geometry.image_position(place.distance, place.theta, closed.f, closed.d))
        apart = closed.f * (1.0 + (p / closed.f) ** 2) * mirrors.synchronisation * closed.follows(seen)
        errors = geometry.propagated_errors(
            place.distance, place.theta, place.phi, closed.f, closed.d, closed.D, apart, angle, angle
        )
        # Rounding of a peak to single precision: 2⁻²⁴ of its pixel, uniform.
        rounding = closed.range_per_pixel(place.distance, place.theta) * 256.0 * 2.0**-24
        for name, error in zip(_COORDINATES, errors.tolist(), strict=True):
            told[f"{name} at {place.name}"] = Predicted(
                f"σ of {name}", "mm", 1e3 * error, 1e3 * (0.002 * error + rounding**2 / error)
            )
    return told


SPOT_POSITION = Law(
    "spot_position",
    "Place of the spot over the field",
    "eqs 1 and 3, in both mirrors' angles",
    "p = f d cosΘ/(R − d sinΘ) with R the range at which the beam of eq 3 meets a wall, and the centroid's shift on a "
    "slanting wall. Light without noise.",
    "target",
    _lit,
    _measure_position,
    _predict_position,
)
SPOT_WIDTH = Law(
    "spot_width",
    "Width of the spot",
    "Gaussian beam (Siegman 1986, ch. 17) through the lens",
    "σ² = (w/2)² (p_s² + p_t²) + point spread², the beam's image and the lens's. Light without noise.",
    "target",
    _lit,
    _of_lines(_width),
    _predict_width,
)
LINK_BUDGET = Law(
    "link_budget",
    "Laser light received",
    "eq 19 with all cosines",
    "N = P ρ/π cosι A cosα/|v|² T η t λ/(h c), times the share within the pixels' height. No noise or speckle.",
    "target",
    _lit,
    _of_lines(lambda line: float(line.sum())),
    _predict_charge,
)
POINTS = Law(
    "points",
    "No bias of range and point",
    "eqs 1 and 3, inverted",
    "The mean of (estimate − truth) is the estimator's systematic error and the centroid's shift, along the beam. "
    "Shot, read, dark and quantisation noise and the mirrors' errors; no speckle, even response.",
    "target",
    _biased,
    _measure_points,
    _predict_points,
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
)
