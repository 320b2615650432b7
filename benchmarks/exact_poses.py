"""Does a pose from exact measurements ever say VALID and lie elsewhere?

Run as ``python benchmarks/exact_poses.py [--cases N] [--seed S] [--method uv] [--noise 0]``. Each kind of layout gets
N attitudes, planes from behind and edge-on included, at 3 to 20 m. A pose is wrong where it lies farther from the truth
than its covariance covers (99 % of χ² with six degrees of freedom); of measurements with their noise, 1, those are 1 %.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import get_args

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy import stats
from scipy.spatial.transform import Rotation

from scanner_sim import estimate_pose
from scanner_sim.analytic import geometry
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.transforms import vector_from_rotation
from scanner_sim.pose.weights import Method

Array = NDArray[np.float64]

SIGMA, SIGMA_RANGE, SEPARATION = 56.6e-6, 5e-3, 0.05
BATCH = 5000
LIMIT = float(stats.chi2(6).ppf(0.99))


def some(random: np.random.Generator, count: int, targets: int) -> Array:
    return random.uniform(-0.5, 0.5, (count, targets, 3))


def plane(random: np.random.Generator, count: int, targets: int, thickness: float = 0.0) -> Array:
    points = some(random, count, targets)
    points[..., 2] *= thickness
    return points


def line(random: np.random.Generator, count: int, off: float) -> Array:
    """Three on a line, or within ``off`` of one, and a fourth in their plane or anywhere."""
    points = plane(random, count, 4, 0.0 if off == 0.0 else 1.0)
    size = off and off * 10.0 ** random.uniform(-4.0, 0.0, (count, 1, 1))
    points[:, :3, 1:] = size * random.standard_normal((count, 3, 2))
    return points


def strip(random: np.random.Generator, count: int) -> Array:
    """Four corners of a strip 1 m long and 1 to 50 mm wide, bent a little."""
    width = 10.0 ** random.uniform(-3.0, -1.3, (count, 1))
    points = np.zeros((count, 4, 3))
    points[..., 0] = [-0.5, -0.5, 0.5, 0.5]
    points[..., 1] = width * [-0.5, 0.5, 0.5, -0.5]
    points[..., 2] = width * random.standard_normal((count, 4))
    return points


def narrow(random: np.random.Generator, count: int) -> Array:
    """Four in a plane, all of them within 0.5 to 50 mm of a line."""
    points = plane(random, count, 4)
    points[..., 1] *= 10.0 ** random.uniform(-3.0, -1.0, (count, 1))
    return points


def fixed(points: list[list[float]]) -> Callable[[np.random.Generator, int], Array]:
    return lambda random, count: np.tile(np.array(points), (count, 1, 1))


LAYOUTS: dict[str, Callable[[np.random.Generator, int], Array]] = {
    "random quadrangle": lambda random, count: plane(random, count, 4),
    "square": fixed([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]]),
    "T": fixed([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "three on a line": lambda random, count: line(random, count, 0.0),
    "three nearly on a line": lambda random, count: line(random, count, 0.03),
    "strip": strip,
    "tetrahedron": lambda random, count: some(random, count, 4),
    "flat tetrahedron": lambda random, count: plane(random, count, 4, 0.01),
    "five": lambda random, count: some(random, count, 5),
    "three": lambda random, count: some(random, count, 3),
    "four nearly on a line": narrow,
}


def counted(points: Array, random: np.random.Generator, method: Method, noise: float) -> tuple[int, int]:
    """Return how many poses of layouts, shape (count, n, 3), are valid, and how many of them are wrong.

    ``noise`` is that of the measurements in the standard deviations that the estimator is told.
    """
    count = len(points)
    rotation = Rotation.random(count, rng=random).as_matrix()
    z = random.uniform(3.0, 20.0, count)
    position = np.column_stack([*(random.uniform(-0.35, 0.35, (2, count)) * z), z])
    placed = np.einsum("kij,knj->kni", rotation, points) + position[:, None]
    r, theta, phi = (
        exact + noise * sigma * random.standard_normal(exact.shape)
        for exact, sigma in zip(
            geometry.shot_from_point(placed, SEPARATION), (SIGMA_RANGE, SIGMA, SIGMA), strict=True
        )
    )
    pose = estimate_pose(
        points,
        theta,
        phi,
        r,
        sigma_theta=SIGMA,
        sigma_phi=SIGMA,
        sigma_range=SIGMA_RANGE,
        axis_separation=SEPARATION,
        method=method,
    )
    valid = pose.status == PoseStatus.VALID
    turn = vector_from_rotation(pose.rotation[valid] @ np.swapaxes(rotation[valid], 1, 2))
    apart = np.concatenate([pose.position[valid] - position[valid], turn], axis=1)
    distance = np.einsum("ki,kij,kj->k", apart, np.linalg.inv(pose.covariance[valid]), apart)
    return int(valid.sum()), int((distance > LIMIT).sum())


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--cases", type=int, default=100_000, help="attitudes of each kind of layout")
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--method", choices=get_args(Method), default="uv")
    arguments.add_argument(
        "--noise", type=float, default=0.0, help="of the measurements, in standard deviations"
    )
    given = arguments.parse_args()
    title = f"Poses by {given.method}, noise of {given.noise:g} σ"
    table = Table("layout", "cases", "valid", "wrong and valid", title=title)
    whole = np.zeros(3, dtype=np.int64)
    for number, (name, make) in enumerate(LAYOUTS.items()):
        found = np.zeros(3, dtype=np.int64)
        for start in range(0, given.cases, BATCH):
            random = np.random.default_rng([given.seed, number, start])
            count = min(BATCH, given.cases - start)
            found += count, *counted(make(random, count), random, given.method, given.noise)
        table.add_row(name, *(f"{value:,}" for value in found))
        whole += found
    table.add_row("all", *(f"{value:,}" for value in whole), style="bold")
    Console().print(table)


if __name__ == "__main__":
    main()
