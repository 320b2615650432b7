"""How fast poses are estimated, and what combining angles and ranges gains.

Run as ``python benchmarks/pose.py [--poses N]``. Speeds are the best of five runs on the machine at hand, on all of its
cores; a square of four targets with noise, at 3–15 m and any tilt to 0.6 rad. The gains are ratios of reported standard
deviations for a square of 1 m that faces the scanner: points (XYZ, equal weights, eq 11) over both (joint).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from rich.console import Console
from rich.table import Table

from scanner_sim import estimate_pose
from scanner_sim.pose.transforms import rotation_from_vector
from scanner_sim.ranging.coordinates import angles_and_range

SIGMA, SEPARATION = 56.6e-6, 0.05
SQUARE = 0.5 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--poses", type=int, default=80_000, help="poses of the batch")
    count = arguments.parse_args().poses
    Console().print(speeds(count))
    Console().print(gains())


def best(work: Callable[[], object], runs: int = 5) -> float:
    """Return the shortest time [s] of some runs."""
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def speeds(count: int) -> Table:
    rng = np.random.default_rng(1)
    z = rng.uniform(3.0, 15.0, count)
    position = np.column_stack([*(rng.uniform(-0.2, 0.2, (2, count)) * z), z])
    rotation = rotation_from_vector(rng.uniform(-0.6, 0.6, (count, 3)))
    x, y, z = np.moveaxis(SQUARE @ np.swapaxes(rotation, 1, 2) + position[:, None], -1, 0)
    r, theta, phi = angles_and_range(x, y, z, SEPARATION)
    theta, phi = (exact + SIGMA * rng.standard_normal(exact.shape) for exact in (theta, phi))
    r = r + 5e-3 * rng.standard_normal(r.shape)
    table = Table("method", "poses per second", "one pose [ms]", "wanted", title="Speed, four targets")
    for method, wanted in (("uv", "≥ 80 000"), ("xyz", ""), ("joint", "")):

        def estimate(chosen: object, method: str = method) -> object:
            return estimate_pose(
                SQUARE,
                theta[chosen],
                phi[chosen],
                r[chosen],
                sigma_theta=SIGMA,
                sigma_phi=SIGMA,
                sigma_range=5e-3,
                axis_separation=SEPARATION,
                method=method,
            )

        batch = best(lambda estimate=estimate: estimate(slice(None)))
        single = best(lambda estimate=estimate: [estimate(k) for k in range(100)]) / 100
        table.add_row(method, f"{count / batch:,.0f}", f"{1e3 * single:.2f}", wanted)
    return table


def gains() -> Table:
    table = Table(
        "range [m]", "ranges", "lateral", "depth", "tilt", "roll", title="XYZ error over joint error"
    )
    for R in (5.0, 10.0, 20.0):
        for name, sigma_range in (("triangulation", R**2 * 1e-4), ("time of flight", 15e-3)):
            x, y, z = (SQUARE + np.array([0.0, 0.0, R])).T
            r, theta, phi = angles_and_range(x, y, z, SEPARATION)
            xyz, joint = (
                estimate_pose(
                    SQUARE,
                    theta,
                    phi,
                    r,
                    sigma_theta=SIGMA,
                    sigma_phi=SIGMA,
                    sigma_range=sigma_range,
                    axis_separation=SEPARATION,
                    method=method,
                    point_weights="equal" if method == "xyz" else "covariance",
                ).sigma
                for method in ("xyz", "joint")
            )
            ratio = (xyz / joint)[[0, 2, 3, 5]]
            table.add_row(
                f"{R:g}", f"{name}, σ {1e3 * sigma_range:g} mm", *(f"{value:.2f}" for value in ratio)
            )
    return table


if __name__ == "__main__":
    main()
