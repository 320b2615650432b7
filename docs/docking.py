"""A docking from 30 m to 1.5 m that is closed by what the scanner sees.

    python docking.py --seeds 5 --processes 2 -o output/docking

A chaser approaches along the velocity vector of a low orbit. Relative motion follows Clohessy and Wiltshire (J.
Aerospace Sciences 27, 1960) with thrust and unknown kicks; what the chaser knows of it comes from the scanner alone: it
begins to search at 25 m, loses the targets for 2 s behind a cover, finds them again where its filter expects them, and
goes from large to small targets at 9 m. For each seed one line: the mean normalised squared errors of position,
attitude and their rates (NEES, 12 degrees of freedom) and of visits (NIS, 3), and where it ended. The first seed's run
is written with its picture.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scanner_sim import PoseFilter, Tracker, load_scenario
from scanner_sim.pose.pose_filter import FilteredPose, FilterStatus
from scanner_sim.products.files.track_folder import write_track
from scanner_sim.products.pictures.docking import Docking, draw_docking
from scanner_sim.tracking.record import PatternRecord

Array = NDArray[np.float64]

ORBIT_RATE = 1.131e-3
"""Mean motion of an orbit 400 km high [rad/s]."""
BEGIN, SEARCH, HANDOVER, END = 30.0, 25.0, 9.0, 1.5
"""Ranges [m] at which the run begins, the search begins, small targets replace large ones, and the approach is over."""
FASTEST, SLOWEST, BRAKING = 0.6, 0.1, 0.12
"""Closing speed [m/s] far away and at the end, and by how much it falls for each metre [1/s]."""
STRONGEST = 0.1
"""Largest acceleration by thrust along an axis [m/s²]."""
KICKS, TUMBLE = 1e-8, 1e-10
"""Spectral densities of what nobody knows of the accelerations [m²/s³, rad²/s³]."""
LIGHT = {"noon": "20 deg", "low Sun": "100 deg", "eclipse": "180 deg"}
"""Places on the orbit where the approach begins, counted from orbital noon."""
HIDDEN = 12.0, 2.0
"""Range [m] at which a cover hides the targets, and for how long [s]."""


def scenario(seed: int, light: str) -> Any:
    """Return the scanner before a target with large and small discs, and a cover beside them."""
    still = {"type": "twist"}
    far = {"diameter": 0.24, "rows": 2, "columns": 2, "spacing": (0.8, 0.8), "plate": 0.7}
    near = {"diameter": 0.06, "rows": 2, "columns": 2, "spacing": (0.2, 0.2), "plate": 0.12}
    objects = [
        {"name": "far", "array": far, "position": (0.0, 0.0, BEGIN), "motion": still},
        {"name": "near", "array": near, "position": (0.0, 0.0, -0.05), "parent": "far"},
        {
            "name": "cover",
            "shape": "rectangle",
            "size": (2.0, 2.0),
            "material": {"reflectance": 0.3},
            "position": (30.0, 0.0, 5.0),
            "motion": still,
        },
    ]
    return load_scenario(
        {
            "schema": 1,
            "seed": seed,
            "scene": {"objects": objects},
            "lighting": {"orbit": {"anomaly": np.deg2rad(float(LIGHT[light].split()[0])), "beta": 0.35}},
            "scan": {"type": "track", "targets": ["far", "near"], "duration": 200.0},
            "scanner": {"latency": {"processing": 2e-3, "transfer": 1e-3}},
        }
    )


@dataclass
class Target:
    """The truth: where the target is before the scanner, and how it moves."""

    position: Array
    velocity: Array
    turn: Rotation
    turn_rate: Array
    time: float = 0.0

    @property
    def pose(self) -> Array:
        """``scanner_from_object``, shape (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.turn.as_matrix(), self.position
        return matrix

    def go_on(self, time: float, thrust: Array, rng: np.random.Generator) -> None:
        """Go on to a time [s]: evenly, and then change speed by what has acted meanwhile."""
        step = time - self.time
        self.position = self.position + step * self.velocity
        self.turn = Rotation.from_rotvec(step * self.turn_rate) * self.turn
        known = step * (gravity(self.position, self.velocity) - thrust)
        self.velocity = self.velocity + known + np.sqrt(KICKS * step) * rng.standard_normal(3)
        self.turn_rate = self.turn_rate + np.sqrt(TUMBLE * step) * rng.standard_normal(3)
        self.time = time


def gravity(position: Array, velocity: Array) -> Array:
    """Return the relative acceleration [m/s²] along starboard, nadir and ram, the axes of the scanner."""
    across, down, _ = position
    _, sinking, ahead = velocity
    n = ORBIT_RATE
    return np.array([-(n**2) * across, 3.0 * n**2 * down - 2.0 * n * ahead, 2.0 * n * sinking])


def thrust_for(pose: FilteredPose) -> Array:
    """Return the chaser's acceleration [m/s²]: a ramp of closing speed, and the axis held."""
    if pose.status is FilterStatus.STARTING:
        return np.zeros(3)
    closing = -np.clip(SLOWEST + BRAKING * (pose.position[2] - END), SLOWEST, FASTEST)
    wanted = -0.05 * pose.position - 0.45 * pose.velocity
    wanted[2] = (closing - pose.velocity[2]) / 1.5
    return np.clip(-wanted, -STRONGEST, STRONGEST)


@dataclass
class Log:
    """What is kept of an approach, a row for each visit."""

    time: list[float] = field(default_factory=list)
    truth: list[Array] = field(default_factory=list)
    estimate: list[Array] = field(default_factory=list)
    sigma: list[Array] = field(default_factory=list)
    nees: list[float] = field(default_factory=list)
    nis: list[float] = field(default_factory=list)

    def add(self, pose: FilteredPose, target: Target, record: PatternRecord, counted: bool) -> None:
        """Keep a visit."""
        step = record.time - target.time
        true = target.position + step * target.velocity
        turned = Rotation.from_rotvec(step * target.turn_rate) * target.turn
        self.time.append(record.time)
        self.truth.append(true)
        self.estimate.append(pose.position)
        self.sigma.append(pose.sigma[:3])
        if pose.status is FilterStatus.STARTING:
            self.nees.append(np.nan)
            self.nis.append(np.nan)
            return
        error = np.concatenate(
            [
                pose.position - true,
                (Rotation.from_matrix(pose.rotation) * turned.inv()).as_rotvec(),
                pose.velocity - target.velocity,
                pose.turn_rate - target.turn_rate,
            ]
        )
        self.nees.append(float(error @ np.linalg.solve(pose.covariance, error)))
        self.nis.append(pose.surprise if counted else np.nan)


def approach(seed: int, light: str) -> tuple[Tracker, list[PatternRecord], Log]:
    """Fly one approach."""
    rng = np.random.default_rng([seed, 23])
    tracker, log, records = Tracker(scenario(seed, light)), Log(), []
    large, small = (
        [target.name for target in tracker.targets if target.object == name] for name in ("far", "near")
    )
    points = {target.name: target.centre for target in tracker.targets}
    points |= {name: points[name] + (0.0, 0.0, -0.05) for name in small}
    poses = PoseFilter(
        {"far": points},
        axis_separation=tracker.scenario.scanner.mirrors.axis_separation,
        acceleration=KICKS,
        turn_acceleration=TUMBLE,
        fastest=1.0,
    )
    # What is known beforehand, by radio: the closing speed, and the targets within 50 mm.
    start = np.array([*(0.3 * rng.standard_normal(2)), BEGIN])
    speed = np.array([0.0, 0.0, -FASTEST]) + 0.02 * rng.standard_normal(3)
    target = Target(
        start, speed, Rotation.from_rotvec(0.1 * rng.standard_normal(3)), 3e-3 * rng.standard_normal(3)
    )
    target.go_on((BEGIN - SEARCH) / FASTEST, np.zeros(3), rng)
    tracker.wait(target.time)
    for name in small:
        tracker.drop(name)
    for name in large:
        there = target.turn.apply(points[name]) + target.position + 0.05 * rng.standard_normal(3)
        distance = float(np.linalg.norm(there))
        tracker.point(
            name,
            float(np.arctan2(there[0], there[2])),
            float(np.arctan2(there[1], there[2])),
            distance,
            rates=(0.0, 0.0, -FASTEST),
            covariance=np.diag([0.05 / distance, 0.05 / distance, 0.05, 2e-3, 2e-3, 0.05]) ** 2,
        )
    thrust, hidden, followed = np.zeros(3), -1.0, large
    while target.position[2] > END and not tracker.finished:
        time, before = tracker.time, target.time
        target.go_on(time, thrust, rng)
        known = poses.predict(time)
        if known.status is not FilterStatus.STARTING:
            poses.push((time - before) * (gravity(known.position, known.velocity) - thrust), time=time)
        thrust = thrust_for(known)
        tracker.move("far", target.pose, velocity=target.velocity, turn_rate=target.turn_rate, time=time)
        if hidden < 0.0 and target.position[2] < HIDDEN[0]:
            hidden = time
            tracker.move("cover", shifted(0.0), time=time)
        if 0.0 < hidden < time - HIDDEN[1]:
            hidden = np.inf
            tracker.move("cover", shifted(30.0), time=time)
        if followed is large and known.status is FilterStatus.FOLLOWING and known.position[2] < HANDOVER:
            followed = small
            for name in large:
                tracker.drop(name)
            for name in small:
                seen = poses.sight(name, time)
                tracker.point(name, *seen.position, rates=seen.rates, covariance=seen.covariance)
        record = next(tracker)
        counted = record.status == 0 and record.after.value == "track"
        log.add(poses.update(record), target, record, counted and poses.state is not None)
        if record.after.value in ("search", "lost") and poses.state is not None:
            # The tracker lost it: it is searched for where the filter takes it, as widely as that is uncertain.
            seen = poses.sight(record.target, max(tracker.time, poses.state.time))
            tracker.point(record.target, *seen.position, rates=seen.rates, covariance=seen.covariance)
        records.append(record)
    return tracker, records, log


def shifted(x: float) -> Array:
    """Return the pose of the cover, moved aside by x [m]."""
    pose = np.eye(4)
    pose[:3, 3] = x, 0.0, 5.0
    return pose


def judged(seed: int, light: str, folder: str | None = None) -> dict[str, float]:
    """Fly an approach and return how honest its filter was; one a second counts, as errors last."""
    tracker, records, log = approach(seed, light)
    nees, nis = np.array(log.nees), np.array(log.nis)
    if folder is not None:
        made = tracker.track(records)
        write_track(made, folder, overwrite=True)
        lighting = tracker.scenario.lighting
        visible = np.array([lighting.sky(time).sun_visible for time in log.time])
        shown = Docking(
            np.array(log.time), np.array(log.truth), np.array(log.estimate), np.array(log.sigma), visible
        )
        draw_docking(made, shown, Path(folder, "approach.png"))
    lost = sum(record.status != 0 for record in records)
    return {
        "seed": seed,
        "visits": len(records),
        "lost": lost,
        "end": float(log.truth[-1][2]),
        "error_mm": 1e3 * float(np.linalg.norm(log.estimate[-1] - log.truth[-1])),
        "nees": float(np.nanmean(nees)),
        "nis": float(np.nanmean(nis)),
    }


def main() -> None:
    """Fly as many approaches as are asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=1, help="approaches, with seeds from 1 on")
    parser.add_argument("--light", choices=tuple(LIGHT), default="noon", help="where on the orbit it begins")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("-o", "--output", help="folder for the first run and its picture")
    asked = parser.parse_args()
    first = 1
    with ProcessPoolExecutor(asked.processes, mp_context=get_context("spawn")) as pool:
        made = [
            pool.submit(judged, seed, asked.light, asked.output if seed == first else None)
            for seed in range(first, first + asked.seeds)
        ]
        found = []
        for one in made:
            found.append(one.result())
            print(" ".join(f"{name}={value:.6g}" for name, value in found[-1].items()), flush=True)
    for name in ("nees", "nis"):
        print(f"mean {name}: {np.mean([run[name] for run in found]):.4g}")


if __name__ == "__main__":
    main()
