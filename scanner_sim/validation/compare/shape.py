"""Laws of the image of the spot: its position, width and light (eqs 1, 3 and 19, the Gaussian beam)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scanner_sim.validation.compare import test_bench
from scanner_sim.validation.compare.closed_forms import ClosedForms, ClosedSpot
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup
from scanner_sim.validation.compare.law import Law, Measured, Predicted, exact

Array = NDArray[np.float64]

_NARROW = 1.5
"""Standard deviations [pixel] below which a spot's moments go with its phase: by exp(−2π²σ²), 10⁻¹⁹ here."""
_FIELD = 0.8
"""Share of the mirrors' deflection over which the field is tested."""
_PRECISION = 3e-4
"""Rounding of simulated widths and charges relative to themselves: single precision."""
EPSILON = 2.0**-24
"""Largest rounding of a number in single precision, relative to it."""
_ROUNDINGS = 14
"""How often a coordinate is rounded between the mirrors' angles and where its point is seen: in sine, cosine and their
product (3), the beam's direction and its length (3), the surface point (2), its difference from the lens's node, the
lens's axis (2), their product, and two sums."""
_WALL_ROUNDINGS = 2
"""How often its place between the corners of the wall is."""
_TOWARDS = np.array([0.0, 0.0, -1.0])


class FieldPosition(NamedTuple):
    """A position in the field: its name, range of the wall or plate [m], deflections [rad]."""

    name: str
    distance: float
    theta: float
    phi: float


def field_positions(setting: ComparisonSetup, ranges: tuple[float, ...]) -> Iterator[FieldPosition]:
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
            position = FieldPosition(f"{distance:.4g} m, Θ {theta:+.2f}, φ {phi:+.2f}", distance, theta, phi)
            if ClosedForms(setting.scenario).on_array(_on_wall(setting, position)):
                yield position


def _wall_size(setting: ComparisonSetup, distance: float) -> float:
    """Return the side of a wall [m] that is larger than the field."""
    far = _FIELD * setting.scenario.scanner.mirrors.max_deflection
    return 2.5 * distance * math.tan(far + 0.1)


def _on_wall(setting: ComparisonSetup, position: FieldPosition) -> ClosedSpot:
    """Return the judge's spot on a wall square to the z axis."""
    point = np.array([0.0, 0.0, position.distance])
    return ClosedForms(setting.scenario).spot(
        position.theta, position.phi, point, _TOWARDS, setting.flat.reflectance
    )


def wall_ranges(setting: ComparisonSetup) -> tuple[float, ...]:
    """Return the nearest, the middle and the farthest range of the targets [m]."""
    ranges = setting.flat.ranges
    return tuple(dict.fromkeys((ranges[0], setting.middle, ranges[-1])))


def _shape_uncovered(setting: ComparisonSetup) -> str:
    return (
        ""
        if next(field_positions(setting, wall_ranges(setting)), None)
        else "the array sees no spot at these ranges"
    )


def _wall_lines(setting: ComparisonSetup) -> Iterator[tuple[FieldPosition, Array]]:
    """Yield positions of the field and the noise-free charges of their lines on a wall."""
    for distance in wall_ranges(setting):
        own = list(field_positions(setting, (distance,)))
        if not own:
            continue
        wall = test_bench.plate(distance, setting.flat.reflectance, size=_wall_size(setting, distance))
        # Noise-free light hides nothing behind the converter, and a strong laser no pixel behind its full well.
        made = test_bench.on_test_bench(setting, wall, seed=setting.seed(1)[0])
        aim = test_bench.directions(
            [position.theta for position in own],
            [position.phi for position in own],
            made.scanner.mirrors,
            0.0,
        )
        yield from zip(own, test_bench.lines(setting, made, aim), strict=True)


def _centroid(line: Array) -> float:
    return float(np.arange(line.size) @ line / line.sum())


def _width(line: Array) -> float:
    """Return the standard deviation of a line [pixel], the pixels' own width taken off (Sheppard)."""
    away = np.arange(line.size) - _centroid(line)
    return math.sqrt(float(away**2 @ line / line.sum()) - 1.0 / 12.0)


def _of_lines(value: Callable[[Array], float]) -> Callable[[ComparisonSetup], dict[str, Measured]]:
    """Return what measures a number of the noise-free lines."""
    return lambda setting: {position.name: exact(value(line)) for position, line in _wall_lines(setting)}


def lens_extent(setting: ComparisonSetup, position: FieldPosition) -> float:
    """Return (D/R)², by which the extent of the lens, which the closed forms take as small, changes light and shape."""
    return (setting.scenario.scanner.receiver.aperture / position.distance) ** 2


def position_rounding(setting: ComparisonSetup, position: FieldPosition) -> float:
    """Return how far single precision may move a spot on the array [pixel].

    A point v from the lens's node, at the depth L, is seen at the tangent t = −v·n/L. The terms of v·n have the sizes
    L |u_i n_i|, together L |sin 2Θ|, and cancel to L t. Each is rounded k times by up to ε of itself: √(k/3) ε of
    it as standard deviation of independent, even errors (Higham, *Accuracy and stability of numerical algorithms*, 2nd
    ed., 2002, sec 2.8), 4 of which are granted. The array makes a displacement of them with its scale ds/dt, which
    tilts change; the offset is rounded no more often. The point itself is a mean of the wall's corners and is rounded
    by ε of their distance, wherever it lies.
    """
    closed, sensor = ClosedForms(setting.scenario), setting.scenario.scanner.position_sensor
    seen = (_on_wall(setting, position).chief + 0.5) * sensor.pitch + sensor.offset
    tangent = float(closed.array.tangent(seen))
    ahead, behind = (float(closed.array.position_at(tangent + side * 1e-5)) for side in (1.0, -1.0))
    scale = (ahead - behind) / 2e-5
    lever = scale * (abs(math.sin(2.0 * position.theta)) + abs(tangent)) + abs(sensor.offset)
    corner = scale * 0.5 * _wall_size(setting, position.distance) / position.distance
    moved = math.sqrt(_ROUNDINGS / 3.0) * lever + math.sqrt(_WALL_ROUNDINGS / 3.0) * corner
    return 4.0 * EPSILON * moved / sensor.pitch


def _predict_position(setting: ComparisonSetup) -> dict[str, Predicted]:
    closed, cases = ClosedForms(setting.scenario), {}
    for position in field_positions(setting, wall_ranges(setting)):
        seen = _on_wall(setting, position)
        from_infinity = seen.centre - closed.pixel(0.0)
        accuracy = lens_extent(setting, position) / 16.0 * from_infinity
        accuracy += position_rounding(setting, position)
        cases[position.name] = Predicted(
            "p", "mm", 1e3 * from_infinity * closed.pitch, 1e3 * accuracy * closed.pitch
        )
    return cases


def _measure_position(setting: ComparisonSetup) -> dict[str, Measured]:
    sensor = setting.scenario.scanner.position_sensor
    return {
        position.name: exact(1e3 * (sensor.offset + (_centroid(line) + 0.5) * sensor.pitch))
        for position, line in _wall_lines(setting)
    }


def _predict_width(setting: ComparisonSetup) -> dict[str, Predicted]:
    cases = {}
    for position in field_positions(setting, wall_ranges(setting)):
        seen = _on_wall(setting, position)
        # Of a narrow spot the moments on pixels go with its place in the pixel, which Sheppard's correction leaves out.
        width = _width(seen.line) if seen.sigma < _NARROW else seen.sigma
        cases[position.name] = Predicted(
            "σ", "pixel", width, (2.0 * lens_extent(setting, position) + _PRECISION) * width
        )
    return cases


def _predict_charge(setting: ComparisonSetup) -> dict[str, Predicted]:
    cases = {}
    for position in field_positions(setting, wall_ranges(setting)):
        charge = _on_wall(setting, position).charge
        cases[position.name] = Predicted(
            "charge", "electron", charge, (lens_extent(setting, position) + _PRECISION) * charge
        )
    return cases


def unlit(setting: ComparisonSetup) -> str:
    """Return why there is no light of a spot to speak of; empty where there is."""
    closed = ClosedForms(setting.scenario)
    if closed.passed(0.0) < 0.5:
        return "the filter or the detector's response blocks the laser's line"
    if closed.band is not None and not closed.band.cavities:
        nearest = min(setting.flat.ranges)
        if closed.passed(math.atan(closed.d / nearest)) < 0.5:
            return "the band's steep edge lies within the spot, whose light the closed form takes as one incidence"
    return _shape_uncovered(setting)


SPOT_POSITION = Law(
    "spot_position",
    "Place of the spot over the field",
    "eqs 1 and 3, in both mirrors' angles",
    "p = f d cosΘ/(R − d sinΘ) with R the range at which the beam of eq 3 meets a wall, and the centroid's shift on a "
    "slanting wall. Light without noise.",
    "target",
    unlit,
    _measure_position,
    _predict_position,
    exercises="light",
)
SPOT_WIDTH = Law(
    "spot_width",
    "Width of the spot",
    "Gaussian beam (Siegman 1986, ch. 17) through the lens",
    "σ² = (w/2)² (p_s² + p_t²) + point spread², the beam's image and the lens's. Light without noise.",
    "target",
    unlit,
    _of_lines(_width),
    _predict_width,
    exercises="light",
)
LINK_BUDGET = Law(
    "link_budget",
    "Laser light received",
    "eq 19 with all cosines",
    "N = P ρ/π cosι A cosα/|v|² T η t λ/(h c), times the share within the pixels' height. No noise or speckle.",
    "target",
    unlit,
    _of_lines(lambda line: float(line.sum())),
    _predict_charge,
    exercises="light",
)
