"""Calibration fields for tests: boards, stations and what a drawn instrument reads of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scanner_sim.calibration.network import Field, Sightings, Targets
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.ranging.believed import Design, VoxelReadings

Array = NDArray[np.float64]

DESIGN = Design(0.1, 0.2, 0.05)
TOLERANCE = {
    "base": 1e-4,
    "theta_zero": 2e-4,
    "theta_scale": 1e-3,
    "phi_zero": 2e-4,
    "phi_scale": 1e-3,
    "array_offset": 2e-5,
    "array_scale": 1e-4,
}
SIGMA = (5e-6, 5e-6, 5e-7)
SURVEY = 2e-5
BOARDS = (
    (np.array([0.0, 0.0, 3.0]), Rotation.from_rotvec([0.1, 0.2, 0.0])),
    (np.array([1.2, 0.0, 5.0]), Rotation.from_rotvec([0.2, -0.4, 0.3])),
    (np.array([-1.5, 0.4, 7.0]), Rotation.from_rotvec([-0.3, 0.3, 1.0])),
)


def read(points: Array, value: Mapping[str, float]) -> Array:
    """Return (ϑ, φ, p) that an instrument with true parameters reads of points in its own frame, shape (n, 3).

    Eq 3 turned round gives R, Θ, φ; each encoder reads what its zero and scale leave; eq 1 with the true base gives the
    spot's place, and the array reads it by its own zero and scale.
    """
    x, y, z = points.T
    reach = np.hypot(y, z - DESIGN.axis_separation) + DESIGN.axis_separation
    r, theta = np.hypot(x, reach), np.arctan2(x, reach)
    phi = np.arctan2(y, z - DESIGN.axis_separation)
    base = DESIGN.baseline + value["base"]
    place = DESIGN.image_distance * base * np.cos(theta) / (r - base * np.sin(theta))
    return np.stack(
        [
            (theta - value["theta_zero"]) / (1.0 + value["theta_scale"]),
            (phi - value["phi_zero"]) / (1.0 + value["phi_scale"]),
            (place - value["array_offset"]) / (1.0 + value["array_scale"]),
        ],
        axis=1,
    )


def grid(depth: float = 0.0, count: int = 4, step: float = 0.35) -> Array:
    """Return the targets of a board that faces along −z, every third one nearer by ``depth``, shape (count², 3)."""
    ends = step * (np.arange(count) - 0.5 * (count - 1))
    x, y = np.meshgrid(ends, ends)
    return np.stack([x.ravel(), y.ravel(), -depth * (np.arange(x.size) % 3 == 0)], axis=1)


def made_field(
    generator: np.random.Generator,
    *,
    stations: int = 4,
    boards: int = 2,
    noise: float = 1.0,
    tolerance: Mapping[str, float] = TOLERANCE,
    survey: float = SURVEY,
    depth: float = 0.0,
) -> tuple[Field, Array]:
    """Return a field whose instrument is drawn from its tolerances, and the true parameters (23,)."""
    value = dict.fromkeys(TOLERANCE, 0.0) | {
        name: noise * spread * generator.normal() for name, spread in tolerance.items()
    }
    local = grid(depth)
    board = np.repeat(np.arange(boards), len(local))
    places = np.tile(local, (boards, 1))
    stands = places + noise * survey * generator.normal(size=places.shape)
    world = np.concatenate([BOARDS[i][1].apply(stands[board == i]) + BOARDS[i][0] for i in range(boards)])
    station, target, readings = [], [], []
    for number in range(stations):
        turn = Rotation.from_rotvec(generator.uniform([-0.1, -0.1, -3.0], [0.1, 0.1, 3.0]))
        points = turn.inv().apply(world - generator.uniform(-0.4, 0.4, 3))
        seen = (np.abs(points[:, :2]).max(axis=1) < 0.45 * points[:, 2]) & (points[:, 2] > 1.7)
        readings.append(read(points[seen], value))
        target.append(np.flatnonzero(seen))
        station.append(np.full(seen.sum(), number))
    numbers = np.concatenate(readings)
    sigma = np.tile(SIGMA, (len(numbers), 1))
    numbers = numbers + noise * sigma * generator.normal(size=numbers.shape)
    names = tuple(f"{'abc'[i]}/{k}" for i in range(boards) for k in range(len(local)))
    field = Field(
        DESIGN,
        dict(tolerance),
        0.03,
        Targets(names, board, places, survey, tuple("abc"[:boards])),
        Sightings(
            np.concatenate(station),
            np.concatenate(target),
            VoxelReadings(*numbers.T),
            np.eye(3) * sigma[:, None],
            np.zeros((len(numbers), 3, 0)),
        ),
        tuple(f"s{number}" for number in range(stations)),
    )
    truth = np.zeros(len(NAMES))
    for name, number in value.items():
        truth[INDEX[name]] = number
    return field, truth
