"""Dockings from 30 m to 1.5 m that are closed by what the scanner sees.

    python docking.py --seeds 3 -o output/docking

A chaser approaches along the velocity vector of a low orbit. Relative motion follows Clohessy and Wiltshire (J.
Aerospace Sciences 27, 1960) with thrust that is not kept exactly; what the chaser knows of it comes from the scanner
alone: it begins to search at 25 m, loses the targets for 2 s behind a cover, finds them again where its filter expects
them, and goes from large to small targets at 9 m. Every 0.4 s thrusters are commanded and each target is visited once.
Only the first rounds follow at once: the rates that two visits tell do not put a pattern onto its target 0.4 s later.
The seeds take the three lights in turn. For each a line: where it ended, and the normalised squared errors of
position, attitude and their rates (NEES, 12 degrees of freedom) and of visits (NIS, 3), means over the run; then NEES
every half a metre, the mean over all seeds, and how many of these are within their bounds of 95 %. The first seed's run
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
from scipy.stats import chi2

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
COMMANDS = 0.4
"""Time from one command to the next [s]."""
JOLT, TUMBLE = 6e-5, 1e-10
"""How well thrusters keep a command along an axis [m/s], and spectral density of unknown turns [rad²/s³]."""
TURNS = 3e-3
"""Standard deviation of the target's rates of turn when the run begins [rad/s]."""
LIGHT = {"noon": 20.0, "low Sun": 100.0, "eclipse": 180.0}
"""Places on the orbit where the approach begins, counted from orbital noon [deg]."""
HIDDEN = 12.0, 2.0
"""Range [m] at which a cover hides the targets, and for how long [s]."""
JUDGED = (*np.arange(24.5, 1.9, -0.5).tolist(), 1.6)
"""Ranges [m] at which the filter is judged."""
RING = 0.25
"""How far the target's docking ring, to which ranges count, stands before its large discs [m]."""


def scenario(seed: int, light: str) -> Any:
    """Return the scanner before a target with large and small discs, and a cover beside them."""
    still = {"type": "twist"}
    far = {"diameter": 0.24, "rows": 2, "columns": 2, "spacing": (0.8, 0.8), "plate": 0.7}
    near = {"diameter": 0.06, "rows": 2, "columns": 2, "spacing": (0.2, 0.2), "plate": 0.15}
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
            "lighting": {"orbit": {"anomaly": np.deg2rad(LIGHT[light]), "beta": 0.35}},
            "scan": {"type": "track", "targets": ["far", "near"], "duration": 200.0},
            # What the sensor sees with the laser off is taken off: sunlit edges bend the light beneath the spots.
            "scanner": {"latency": {"processing": 2e-3, "transfer": 1e-3}, "laser_off": 0.5},
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
    def range(self) -> float:
        """How far away its docking ring is [m]."""
        return float(self.position[2]) - RING

    @property
    def pose(self) -> Array:
        """``scanner_from_object``, shape (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.turn.as_matrix(), self.position
        return matrix

    def at(self, time: float) -> Target:
        """Return it a little later [s], before anything has acted."""
        step = time - self.time
        turned = Rotation.from_rotvec(step * self.turn_rate) * self.turn
        return Target(self.position + step * self.velocity, self.velocity, turned, self.turn_rate, time)

    def after(self, time: float, thrust: Array, rng: np.random.Generator) -> Target:
        """Return it at a time [s]: it went evenly, and then changes speed by what has acted meanwhile."""
        step, later = time - self.time, self.at(time)
        known = step * (gravity(later.position, later.velocity) - thrust)
        later.velocity = later.velocity + known + JOLT * rng.standard_normal(3)
        later.turn_rate = later.turn_rate + np.sqrt(TUMBLE * step) * rng.standard_normal(3)
        return later


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
    closing = -np.clip(SLOWEST + BRAKING * (pose.position[2] - RING - END), SLOWEST, FASTEST)
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

    def add(self, pose: FilteredPose, true: Target, counted: bool) -> None:
        """Keep a visit: what the filter said at its time, and what was so."""
        self.time.append(true.time)
        self.truth.append(true.position)
        self.estimate.append(pose.position)
        self.sigma.append(pose.sigma[:3])
        known = pose.status is not FilterStatus.STARTING
        self.nees.append(squared_error(pose, true) if known else np.nan)
        self.nis.append(pose.surprise if known and counted else np.nan)

    def nees_at(self, ranges: tuple[float, ...]) -> Array:
        """Return NEES at the first visits nearer than some ranges, NaN where there is none."""
        reach, nees = np.array(self.truth)[:, 2] - RING, np.array(self.nees)
        near = [np.flatnonzero(reach < one)[:1] for one in ranges]
        return np.array([nees[first[0]] if len(first) else np.nan for first in near])


def squared_error(pose: FilteredPose, true: Target) -> float:
    """Return the squared error of the twelve numbers over their covariance."""
    error = np.concatenate(
        [
            pose.position - true.position,
            (Rotation.from_matrix(pose.rotation) * true.turn.inv()).as_rotvec(),
            pose.velocity - true.velocity,
            pose.turn_rate - true.turn_rate,
        ]
    )
    return float(error @ np.linalg.solve(pose.covariance, error))


class Approach:
    """One approach: chaser, target and what is kept of both."""

    def __init__(self, seed: int, light: str) -> None:
        self.rng = np.random.default_rng([seed, 23])
        self.tracker = Tracker(scenario(seed, light))
        self.log, self.records = Log(), list[PatternRecord]()
        names = {
            name: [one.name for one in self.tracker.targets if one.object == name] for name in ("far", "near")
        }
        self.small, self.followed = names["near"], names["far"]
        points = {target.name: target.centre for target in self.tracker.targets}
        points |= {name: points[name] + (0.0, 0.0, -0.05) for name in self.small}
        self.poses = PoseFilter(
            {"far": points},
            axis_separation=self.tracker.scenario.scanner.mirrors.axis_separation,
            acceleration=0.0,
            turn_acceleration=TUMBLE,
            fastest=1.0,
            fastest_turn=TURNS,
            patience=2.0 * COMMANDS,
        )
        self.thrust, self.hidden, self.found = np.zeros(3), -1.0, np.inf
        self._begin(points)

    def _begin(self, points: dict[str, Array]) -> None:
        """Let the target come to where the search begins, and point at where the radio has it."""
        rng = self.rng
        start = np.array([*(0.3 * rng.standard_normal(2)), BEGIN + RING])
        speed = np.array([0.0, 0.0, -FASTEST]) + 0.02 * rng.standard_normal(3)
        turn = Rotation.from_rotvec(0.1 * rng.standard_normal(3))
        first = Target(start, speed, turn, TURNS * rng.standard_normal(3))
        self.target = first.after((BEGIN - SEARCH) / FASTEST, np.zeros(3), rng)
        self.tracker.wait(self.target.time)
        for name in self.small:
            self.tracker.drop(name)
        for name in self.followed:
            # Known by radio are the closing speed, and the targets within 50 mm.
            there = (
                self.target.turn.apply(points[name]) + self.target.position + 0.05 * rng.standard_normal(3)
            )
            distance = float(np.linalg.norm(there))
            self.tracker.point(
                name,
                float(np.arctan2(there[0], there[2])),
                float(np.arctan2(there[1], there[2])),
                distance,
                rates=(0.0, 0.0, -FASTEST),
                covariance=np.diag([0.05 / distance, 0.05 / distance, 0.05, 2e-3, 2e-3, 0.05]) ** 2,
            )

    def fly(self) -> None:
        """Go on to the end."""
        while self.target.range > END and not self.tracker.finished:
            began = self.tracker.time
            self._command()
            for _ in self.followed:
                self._visit()
            if self.poses.state is not None:
                self.found = min(self.found, began)
            if began >= self.found + COMMANDS:
                self.tracker.wait(max(self.tracker.time, began + COMMANDS))

    def _command(self) -> None:
        """Let what has acted act, tell the scanner of it, and command what acts next."""
        tracker, poses, time = self.tracker, self.poses, self.tracker.time
        step = time - self.target.time
        self.target = self.target.after(time, self.thrust, self.rng)
        known = poses.predict(time)
        if known.status is not FilterStatus.STARTING:
            change = step * (gravity(known.position, known.velocity) - self.thrust)
            poses.push(change, time=time, sigma=JOLT)
            known = poses.predict(time)
        self.thrust = thrust_for(known)
        tracker.move(
            "far", self.target.pose, velocity=self.target.velocity, turn_rate=self.target.turn_rate, time=time
        )
        if self.hidden < 0.0 and self.target.range < HIDDEN[0]:
            self.hidden = time
            tracker.move("cover", shifted(0.0), time=time)
        if 0.0 < self.hidden < time - HIDDEN[1] + 1e-6:
            self.hidden = np.inf
            tracker.move("cover", shifted(30.0), time=time)
        near = known.status is FilterStatus.FOLLOWING and known.position[2] - RING < HANDOVER
        if self.followed is not self.small and near:
            for name in self.followed:
                tracker.drop(name)
            self.followed = self.small
            for name in self.small:
                self._point(name)

    def _visit(self) -> None:
        """Visit the next target, and search where the filter has it once the tracker has lost it."""
        record = next(self.tracker)
        pose = self.poses.update(record)
        counted = record.status == 0 and record.after.value == "track"
        self.log.add(pose, self.target.at(pose.time), counted)
        self.records.append(record)
        if record.after.value in ("search", "lost") and self.poses.state is not None:
            self._point(record.target)

    def _point(self, name: str) -> None:
        """Search for a target where the filter takes it, as widely as that is uncertain."""
        assert self.poses.state is not None
        seen = self.poses.sight(name, max(self.tracker.time, self.poses.state.time))
        self.tracker.point(name, *seen.position, rates=seen.rates, covariance=seen.covariance)


def shifted(x: float) -> Array:
    """Return the pose of the cover, moved aside by x [m]."""
    pose = np.eye(4)
    pose[:3, 3] = x, 0.0, 5.0
    return pose


def judged(seed: int, light: str, folder: str | None = None) -> dict[str, Any]:
    """Fly an approach and return how honest its filter was."""
    approach = Approach(seed, light)
    approach.fly()
    log, tracker = approach.log, approach.tracker
    if folder is not None:
        made = tracker.track(approach.records)
        write_track(made, folder, overwrite=True)
        visible = np.array([tracker.scenario.lighting.sky(time).sun_visible for time in log.time])
        shown = Docking(
            np.array(log.time), np.array(log.truth), np.array(log.estimate), np.array(log.sigma), visible
        )
        draw_docking(made, shown, Path(folder, "approach.png"))
    return {
        "seed": seed,
        "light": light,
        "visits": len(log.time),
        "lost": sum(record.status != 0 for record in approach.records),
        "seconds": log.time[-1],
        "end_m": approach.target.range,
        "error_mm": 1e3 * float(np.linalg.norm(log.estimate[-1] - log.truth[-1])),
        "nees": float(np.nanmean(log.nees)),
        "nis": float(np.nanmean(log.nis)),
        "nees_at": log.nees_at(JUDGED).tolist(),
    }


def main() -> None:
    """Fly as many approaches as are asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=1, help="approaches")
    parser.add_argument("--first", type=int, default=1, help="seed of the first")
    parser.add_argument("--light", choices=tuple(LIGHT), help="one light for all")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("-o", "--output", help="folder for the first run and its picture")
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.seeds)
    lights = list(LIGHT)
    with ProcessPoolExecutor(asked.processes, mp_context=get_context("spawn")) as pool:
        made = [
            pool.submit(
                judged,
                seed,
                asked.light or lights[(seed - 1) % 3],
                asked.output if seed == seeds[0] else None,
            )
            for seed in seeds
        ]
        found = []
        for one in made:
            found.append(one.result())
            told = {name: value for name, value in found[-1].items() if name != "nees_at"}
            print(" ".join(f"{name}={said(value)}" for name, value in told.items()), flush=True)
    report(found)


def said(value: object) -> str:
    """Return a value as it is printed."""
    return f"{value:.4g}" if isinstance(value, float) else str(value).replace(" ", "_")


def report(found: list[dict[str, Any]]) -> None:
    """Print the mean NEES of all runs by range, and how many keep the bounds that 95 % of such means keep."""
    within, means = 0, list[float]()
    for reach, values in zip(JUDGED, np.array([run["nees_at"] for run in found]).T, strict=True):
        known = values[np.isfinite(values)]
        if not len(known):
            continue
        low, high = chi2.ppf([0.025, 0.975], 12 * len(known)) / len(known)
        means.append(float(known.mean()))
        inside = low < means[-1] < high
        within += inside
        said_of = "" if inside else "  outside"
        print(
            f"{reach:5.1f} m: NEES {means[-1]:6.2f} of {len(known)} runs, 95 % of {low:.2f} to {high:.2f}{said_of}"
        )
    print(f"within at {within} of {len(means)} ranges; their mean is {np.mean(means):.2f}, and 12 is right")


if __name__ == "__main__":
    main()
