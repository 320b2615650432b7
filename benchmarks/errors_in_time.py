"""How honest covariances of poses and of the reference filter are, with all of the instrument's noise.

    python benchmarks/errors_in_time.py --runs 12

prints χ²/6 of poses of nine moving objects a run, and χ²/12 of the filter's pose and rates of one moving square after
200 visits, fed with the parts of errors and with the same covariances as white noise; ± is the standard error of a mean
over objects or runs.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim import FilterModel, load_scenario, poses_of, track
from scanner_sim.config.scenario import Scenario
from scanner_sim.instrument.closed_loop.poses import true_poses
from scanner_sim.pose.transforms import vector_from_rotation
from scanner_sim.tracking.errors import ErrorParts
from scanner_sim.tracking.record import PatternRecord

SQUARE = {"diameter": 0.1, "rows": 2, "columns": 2, "spacing": (0.8, 0.8), "plate": 0.3}


def scene(rng: np.random.Generator, seed: int, side: int, visits: int) -> Scenario:
    """A field of squares at 7 to 10 m, each tilted, moving and turning in its own way."""
    objects: list[dict[str, Any]] = []
    for number in range(side**2):
        z = rng.uniform(7.0, 10.0)
        place = 0.2 * z * (np.array([number % side, number // side]) - 0.5 * (side - 1))
        objects.append(
            {
                "name": f"node{number}",
                "array": SQUARE,
                "position": (*place, z),
                "rotation": [{"axis": axis, "angle": rng.uniform(-0.26, 0.26)} for axis in "yx"],
                "motion": {
                    "type": "twist",
                    "velocity": tuple(rng.uniform(-10e-3, 10e-3, 3)),
                    "turn_rate": tuple(rng.uniform(-12e-3, 12e-3, 3)),
                },
            }
        )
    scan = {"type": "track", "targets": [one["name"] for one in objects], "duration": visits * 10.03e-3}
    return load_scenario({"schema": 1, "seed": seed, "scene": {"objects": objects}, "scan": scan})


def poses(scenario: Scenario) -> dict[str, list[float]]:
    """χ²/6 of every object's poses, mean over its rounds, by method."""
    found: dict[str, list[float]] = {}
    for one in poses_of(track(scenario)):
        valid = one.status == 0
        away = np.linalg.solve(one.covariance[valid], one.error[valid][..., None])[..., 0]
        label = ("relative " if one.relative_to else "") + one.method
        found.setdefault(label, []).append(float((one.error[valid] * away).sum(axis=1).mean() / 6.0))
    return found


def filtered(scenario: Scenario) -> tuple[float, float]:
    """χ²/12 of the filter after the last visit, with the parts of errors and with white noise."""
    made, found = track(scenario), []
    separation = scenario.scanner.mirrors.axis_separation
    known = FilterModel.of(made.targets, separation, acceleration=1e-12, turn_acceleration=1e-12)
    for records in (list(made.records), [white(record) for record in made.records]):
        state = known.begin(records[:12])
        for record in records[12:]:
            state = known.updated(state, record)
        first, then = true_poses(scenario, "node0", np.array([state.time, state.time + 1e-3]))
        rates = [then[:3, 3] - first[:3, 3], vector_from_rotation(then[:3, :3] @ first[:3, :3].T)]
        turn = vector_from_rotation(state.rotation[0] @ first[:3, :3].T)
        truth: NDArray[np.float64] = np.concatenate(rates) / 1e-3
        twist = np.concatenate([state.velocity[0], state.turn_rate[0]]) - truth
        away = np.concatenate([state.position[0] - first[:3, 3], turn, twist])
        found.append(float(away @ np.linalg.solve(state.covariance_of(0), away)) / 12.0)
    return found[0], found[1]


def white(record: PatternRecord) -> PatternRecord:
    """The same visit, its error said to be new."""
    return replace(record, errors=ErrorParts.all_white(record.covariance))


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=4)
    runs = parser.parse_args().runs
    table: dict[str, list[float]] = {}
    for seed in range(runs):
        for label, values in poses(scene(np.random.default_rng(seed), seed, 3, 216)).items():
            table.setdefault(label, []).extend(values)
    for seed in range(runs):
        both = filtered(scene(np.random.default_rng(100 + seed), seed, 1, 200))
        for label, value in zip(("filter, parts", "filter, white"), both, strict=True):
            table.setdefault(label, []).append(value)
    for label, values in table.items():
        error = np.std(values) / np.sqrt(len(values))
        print(f"{label:16s} {len(values):4d}  {np.mean(values):6.2f} ± {error:.2f}")


if __name__ == "__main__":
    main()
