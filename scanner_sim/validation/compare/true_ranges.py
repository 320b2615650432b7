"""Law of the true ranges: where the beam of eq 3 meets a plane. The errors that other laws judge count from there."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic import geometry
from scanner_sim.validation.compare import test_bench
from scanner_sim.validation.compare.closed_forms import ClosedForms
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup
from scanner_sim.validation.compare.law import Law, Measured, Predicted, exact
from scanner_sim.validation.compare.shape import EPSILON, wall_ranges

Array = NDArray[np.float64]

_TILT = 0.5
"""Tilt of the planes that do not face the scanner [rad]."""
_SHOTS = 1024
"""Beams over the field."""
_STEEPEST = 0.2
"""Cosine of the incidence below which beams are left out."""
_ROUNDINGS = 12
"""How often a term of the range is rounded: in sine, cosine and their product (3), the beam's direction and its length
(3), its product with the normal and their sum (3), the distance from the plane (2), and the quotient (1)."""


class _Plane(NamedTuple):
    """A plane: its name, distance along z [m], tilt [rad] and the axis of that; beams that meet it, each (n,).

    ``theta``, ``phi`` [rad] and ``range`` [m] of the beams, and ``lever`` Σ|N_i u_i|/|N·u|.
    """

    name: str
    distance: float
    tilt: float
    axis: str
    theta: Array
    phi: Array
    range: Array
    lever: Array


def _planes(setting: ComparisonSetup) -> Iterator[_Plane]:
    """Yield planes across the z axis at the nearest, middle and farthest range, facing and tilted about both axes."""
    separation = ClosedForms(setting.scenario).D
    most = setting.scenario.scanner.mirrors.max_deflection
    theta, phi = test_bench.square(most, setting.shots(_SHOTS))
    along = geometry.scanner_axes(theta, phi)[0]
    for distance in wall_ranges(setting):
        for name, tilt, axis in (
            ("facing", 0.0, "y"),
            ("tilted aside", _TILT, "y"),
            ("tilted up", -_TILT, "x"),
        ):
            sine, cosine = math.sin(tilt), math.cos(tilt)
            normal = np.array([sine, 0.0, cosine] if axis == "y" else [0.0, -sine, cosine])
            towards = along @ normal
            met = towards > _STEEPEST
            r = geometry.range_to_plane(
                theta[met], phi[met], separation, np.array([0.0, 0.0, distance]), normal
            )
            lever = np.abs(along[met] * normal).sum(axis=1) / towards[met]
            case = f"{name}, {distance:.4g} m"
            yield _Plane(case, distance, tilt, axis, theta[met], phi[met], r, lever)


def _rounding(plane: _Plane) -> Array:
    """Return how far single precision may move true ranges [m], shape (n,).

    R = N·(P − O)/N·u. The terms of N·u, together Σ|N_i u_i|, and its quotient are each rounded k times by up to ε of
    themselves: √(k/3) ε as standard deviation of independent, even errors (Higham, *Accuracy and stability of numerical
    algorithms*, 2nd ed., 2002, sec 2.8), 4 of which are granted.
    """
    return np.asarray(4.0 * EPSILON * math.sqrt(_ROUNDINGS / 3.0) * (1.0 + plane.lever) * plane.range)


def _measure(setting: ComparisonSetup) -> dict[str, Measured]:
    cases, separation = {}, ClosedForms(setting.scenario).D
    for plane in _planes(setting):
        points = geometry.point_from_shot(plane.range, plane.theta, plane.phi, separation)
        reach = float(np.linalg.norm(points - [0.0, 0.0, plane.distance], axis=1).max())
        size = 2.1 * reach + 16.0 * setting.scenario.scanner.laser.radius(float(plane.range.max()))
        target = test_bench.plate(
            plane.distance, setting.flat.reflectance, size=size, tilt=plane.tilt, axis=plane.axis
        )
        made = test_bench.on_test_bench(
            setting, target, seed=setting.seed(37)[0], ranging=setting.scenario.rangefinders[0]
        )
        aim = test_bench.directions(plane.theta, plane.phi, made.scanner.mirrors, 0.0)
        away = test_bench.measure(setting, made, aim)["truth.range_m"] - plane.range
        # A beam that misses the plane has no true range, and is as far away as can be.
        cases[plane.name] = exact(1e3 * float(np.nan_to_num(np.abs(away), nan=np.inf).max()))
    return cases


def _predict(setting: ComparisonSetup) -> dict[str, Predicted]:
    return {
        plane.name: Predicted(
            "largest |R − R of the plane|",
            "mm",
            0.0,
            1e3 * float(_rounding(plane).max()),
            1e3 * plane.distance,
            "distance",
        )
        for plane in _planes(setting)
    }


TRUE_RANGES = Law(
    "true_ranges",
    "True ranges over the field",
    "eq 3, and the equation of a plane",
    "R = N·(P − O)/N·u for beams over the whole field, O and u those of eq 3, on planes that face the scanner or are "
    "tilted by half a radian about either axis. The truth itself, without any error, to what single precision rounds.",
    "target",
    lambda _: "",
    _measure,
    _predict,
    exercises="light",
    rangefinder=None,
)
