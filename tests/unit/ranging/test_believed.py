"""The observation equation of a calibration, its derivatives, and the judge's closed forms for each parameter."""

from __future__ import annotations

import numpy as np
import pytest

from scanner_sim.analytic.instrument_errors import EFFECTS, Sighted
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.ranging.believed import BelievedPoints, Design, RangedBy, VoxelReadings, believed_points
from scanner_sim.ranging.calibration import ideal_readings
from scanner_sim.ranging.coordinates import coordinates
from scanner_sim.ranging.departures import undistorted_position
from scanner_sim.ranging.time_of_flight import range_from_delay
from scanner_sim.ranging.triangulation import position_from_range, range_from_position

DESIGN = Design(image_distance=0.1, baseline=0.2, axis_separation=0.05)
PERIOD = 0.03
SIZES = dict.fromkeys(NAMES, 1e-4) | {
    "radial_1": 1e-2, "radial_2": 1e-1, "tangential": 1e-3, "array_tilt": 1e-2, "axis_skew": 1e-3,
    "theta_cubic": 1e-3, "phi_cubic": 1e-3,
}  # fmt: skip
"""Larger than of any instrument that is worth calibrating, so that no derivative is taken at zero only."""
WAYS: dict[RangedBy, tuple[float, float]] = {
    "triangulation": (1e-3, 1e-2),
    "coaxial": (4.0, 40.0),
    "offset": (4.0, 40.0),
}


def readings_by(by: RangedBy) -> VoxelReadings:
    column, row = np.meshgrid(np.linspace(-0.4, 0.4, 7), np.linspace(-0.35, 0.45, 5))
    return VoxelReadings(column, row, np.linspace(*WAYS[by], 35).reshape(5, 7), by)


def parameters(**values: float) -> np.ndarray:
    found = np.zeros(len(NAMES))
    for name, value in values.items():
        found[INDEX[name]] = value
    return found


def difference(above: np.ndarray, below: np.ndarray, step: float) -> np.ndarray:
    return (above - below) / (2.0 * step)


TILTED = Design(image_distance=0.102, baseline=0.2, axis_separation=0.05, array_tilt=0.46)
"""Scheimpflug's array."""


@pytest.mark.parametrize("design", [DESIGN, TILTED], ids=["upright", "tilted"])
@pytest.mark.parametrize("by", WAYS)
@pytest.mark.parametrize("name", NAMES)
def test_derivatives_by_parameters_are_differences_of_points(by: RangedBy, name: str, design: Design) -> None:
    """Claim: by_parameters and range_by_parameters are central differences of the point, to rounding over the step."""
    readings, step = readings_by(by), 3e-7
    here = believed_points(readings, design, parameters(**SIZES), PERIOD)
    either: list[BelievedPoints] = []
    for sign in (1.0, -1.0):
        moved = parameters(**SIZES)
        moved[INDEX[name]] += sign * step
        either.append(believed_points(readings, design, moved, PERIOD))
    points = difference(either[0].point, either[1].point, step)
    ranges = difference(either[0].range, either[1].range, step)
    # Rounding of a point over 2·step, and the third derivative times step²/6, of which the periods' is the largest.
    tolerance = 1e-15 * np.abs(here.point).max() / step * 4.0 + step**2 * 1e3 * np.abs(here.point).max()
    np.testing.assert_allclose(here.by_parameters[..., INDEX[name]], points, rtol=1e-6, atol=tolerance)
    np.testing.assert_allclose(here.range_by_parameters[..., INDEX[name]], ranges, rtol=1e-6, atol=tolerance)


@pytest.mark.parametrize("by", WAYS)
def test_derivatives_by_readings_are_differences_of_points(by: RangedBy) -> None:
    readings, step = readings_by(by), 1e-7
    here = believed_points(readings, DESIGN, parameters(**SIZES), PERIOD)
    for column, name in enumerate(("theta", "phi", "measured")):
        both = []
        for sign in (1.0, -1.0):
            moved = vars(readings) | {name: getattr(readings, name) + sign * step}
            both.append(believed_points(VoxelReadings(**moved), DESIGN, parameters(**SIZES), PERIOD).point)
        found = difference(both[0], both[1], step)
        np.testing.assert_allclose(
            here.by_readings[..., column], found, rtol=1e-6, atol=1e-6 * np.abs(found).max()
        )


def test_without_departures_the_equations_of_the_paper_are_left() -> None:
    """Eqs 1, 2 and 3, to rounding."""
    lines = readings_by("triangulation")
    found = believed_points(lines, DESIGN, parameters())
    r = range_from_position(lines.measured, lines.theta, DESIGN.image_distance, DESIGN.baseline)
    np.testing.assert_allclose(found.range, r, rtol=1e-14)
    wanted = np.stack(coordinates(r, lines.theta, lines.phi, DESIGN.axis_separation), axis=-1)
    np.testing.assert_allclose(found.point, wanted, atol=1e-13)
    for by, base in (("coaxial", 0.0), ("offset", DESIGN.baseline)):
        pulses = readings_by(by)
        delay = pulses.measured / 299792458.0
        found = believed_points(pulses, DESIGN, parameters())
        np.testing.assert_allclose(found.range, range_from_delay(delay, pulses.theta, base), rtol=1e-14)


def test_parameters_broadcast_against_readings() -> None:
    """Many instruments times many voxels are one call, and each is what it is alone."""
    readings = readings_by("triangulation")
    many = np.stack([parameters(**{name: SIZES[name]}) for name in NAMES])
    together = believed_points(readings, DESIGN, many[:, None, None, :], PERIOD)
    assert together.by_parameters.shape == (len(NAMES), 5, 7, 3, len(NAMES))
    for number in (0, INDEX["axis_skew"], INDEX["radial_1"]):
        alone = believed_points(readings, DESIGN, many[number], PERIOD)
        np.testing.assert_array_equal(together.point[number], alone.point)
        np.testing.assert_array_equal(together.by_parameters[number], alone.by_parameters)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("way", EFFECTS)
def test_the_judge_knows_each_effect(way: str, name: str) -> None:
    """Claim: the derivative by each parameter at the design is minus the judge's closed form, which knows no chain."""
    theta, phi = (
        angles.ravel() for angles in np.meshgrid(np.linspace(-0.4, 0.4, 5), np.linspace(-0.4, 0.4, 5))
    )
    r = np.linspace(2.0, 12.0, theta.size)
    by: RangedBy = "triangulation" if way == "triangulation" else "coaxial"
    measured = position_from_range(r, theta, DESIGN.image_distance, DESIGN.baseline) if by == way else 2.0 * r
    found = believed_points(VoxelReadings(theta, phi, measured, by), DESIGN, parameters(), PERIOD)
    seen = Sighted(r, theta, phi, DESIGN.image_distance, DESIGN.baseline, DESIGN.axis_separation, PERIOD)
    effect = EFFECTS[way].get(name, lambda _: np.zeros((theta.size, 3)))(seen)
    np.testing.assert_allclose(found.by_parameters[..., INDEX[name]], -effect, rtol=1e-9, atol=1e-10)


def test_distortion_is_undone_exactly() -> None:
    """A position distorted by the forward form of Brown's law comes back to the last digits, on a tilted array too."""
    scale, slope, x = 0.1, 0.4, np.linspace(0.0, 0.13, 50)
    forward = x * (1.0 + 0.3 * x**2 - 2.0 * x**4) + 3.0 * 0.01 * x**2
    landed = scale * forward / (1.0 - slope * forward)
    found = undistorted_position(landed, scale, slope, 0.3, -2.0, 0.01)
    np.testing.assert_allclose(found, scale * x / (1.0 - slope * x), atol=1e-16)


def test_what_is_zero_changes_no_bit() -> None:
    position = np.linspace(1e-4, 0.0128, 999)
    np.testing.assert_array_equal(undistorted_position(position, 0.1, 0.5), position)


@pytest.mark.parametrize("by", WAYS)
def test_ideal_readings_are_those_that_mean_the_place(by: RangedBy) -> None:
    """Claim: what a tilted instrument would read of ranges and deflections is believed to be just these; and light
    through the node meets the array, turned about the image of infinity, at the position read, by a linear solution."""
    theta, phi, r = np.array([-0.3, 0.1, 0.42]), np.array([0.2, -0.35, 0.05]), np.array([1.7, 3.3, 8.1])
    found = ideal_readings(TILTED, by, r, theta, phi)
    here = believed_points(found, TILTED, parameters())
    np.testing.assert_allclose(here.range, r, rtol=1e-12)
    np.testing.assert_allclose(here.point, np.stack(coordinates(r, theta, phi, 0.05), axis=-1), rtol=1e-12)
    if by == "triangulation":
        turn = np.array([np.cos(0.46), np.sin(0.46)])
        for place, angle, reach in zip(found.measured, theta, r, strict=True):
            # Along the lens's axis and across it, from the node: the target is d cosΘ aside at R − d sinΘ.
            sight = np.array([0.2 * np.cos(angle), reach - 0.2 * np.sin(angle)])
            along, read = np.linalg.solve(np.column_stack([sight, -turn]), [0.0, 0.102])
            assert along > 0.0
            assert place == pytest.approx(read, rel=1e-12)
