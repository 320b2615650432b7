"""The pose study: which error the pose of an array has, by its layout, size, range and method (Figure 15).

Errors of single targets come from simulated pixels (:mod:`scanner_sim.validation.studies.target_errors`). An array that
faces the scanner on its axis is then sighted many times: each of its targets gets the angles and the range it truly
has, with the errors and the stated σ of one simulated observation at that range. All targets of a pose take theirs from
one position of the spot in its pixel, since at one range they share it. From each set of observations the pose is
estimated and compared.

Not modelled: correlations between the targets of a visit beyond that, the motion of the object between them, errors of
the survey, and Sun and Earth. Nothing is fitted to the paper's figures.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from scanner_sim.config.scanner import RangefinderName
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.streams import Stream, host_generator
from scanner_sim.pose.estimate import estimate_pose
from scanner_sim.pose.result import PoseEstimate
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.target_layouts import Layout, circle, line_and_one, pyramid, square
from scanner_sim.pose.transforms import vector_from_rotation
from scanner_sim.products.pose_study import COMPONENTS, Method, PoseRow, Source, TargetRow
from scanner_sim.ranging.coordinates import angles_and_range
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scene.objects import TargetArray
from scanner_sim.scene.targets import target_positions
from scanner_sim.validation.studies.target_errors import TargetErrors, measure_targets
from scanner_sim.validation.studies.target_grid import StudyTarget, nearest_distance

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

BASE = square(1.0)
"""The array of Figure 15."""
MODES: tuple[tuple[Method, Source], ...] = (
    ("uv", "none"),
    ("xyz", "triangulation"),
    ("joint", "triangulation"),
    ("xyz", "tof"),
    ("joint", "tof"),
)
"""Methods, and the rangefinders by which they take ranges: studied are those that the instrument has."""
REFERENCE = 10.0
"""Range [m] at which arrays are compared, and whose single-target errors the constant law takes."""


@dataclass(frozen=True)
class StudyPlan:
    """What a study does.

    Attributes
    ----------
    distances
        Of the arrays [m].
    arrays
        What is compared, the base first.
    poses
        Of each array, range and method.
    positions, patterns
        Positions of the spot in its pixel, and patterns over each of 36 targets at each.
    """

    distances: tuple[float, ...]
    arrays: tuple[Layout, ...]
    poses: int
    positions: int
    patterns: int

    @property
    def steps(self) -> int:
        """How many times progress is reported."""
        return len(self.distances) * (1 + len(self.arrays))


def plan_study(scenario: Scenario, target: StudyTarget, *, quick: bool = False) -> StudyPlan:
    """Return the plan for a scenario: its own arrays beside squares, circles, a line and a pyramid.

    Parameters
    ----------
    scenario
        Its target arrays of at least three targets are added.
    target
        What is tracked; it bounds the nearest range.
    quick
        Fewer ranges, arrays, patterns and poses.

    Raises
    ------
    InputError
        If targets of this size can be tracked at fewer than three of the ranges.
    """
    spread = (5.0, 10.0, 20.0) if quick else tuple(REFERENCE * 2.0 ** (k / 2.0) for k in range(-6, 5))
    nearest, farthest = nearest_distance(scenario, target), 0.9 * scenario.scanner.farthest_range
    distances = tuple(distance for distance in spread if nearest <= distance <= farthest)
    if len(distances) < 3:
        raise InputError(
            f"targets of {target.diameter:g} m can be tracked from {nearest:.3g} m to {farthest:.3g} m, which holds "
            "fewer than three of the ranges.",
            remedy="Choose smaller targets, or change pattern, mirrors or position_sensor.",
        )
    others = [square(0.5), square(2.0), line_and_one(1.0), pyramid(1.0)]
    if not quick:
        others += [square(1.0, 3), circle(1.0, 4), circle(1.0, 6), circle(1.0, 8), circle(1.0, 12)]
    own = tuple(_own_arrays(scenario))
    return StudyPlan(distances, (BASE, *others, *own), *((400, 2, 2) if quick else (2000, 4, 4)))


def _own_arrays(scenario: Scenario) -> Iterator[Layout]:
    """Yield the scene's own arrays that have a pose."""
    for item in scenario.scene.objects:
        if isinstance(item, TargetArray) and min(item.array.rows, item.array.columns) > 1:
            pattern = item.array
            points = target_positions(pattern.rows, pattern.columns, *pattern.spacing)
            yield Layout(f"{item.name} (own)", float(np.ptp(points, axis=0).max()), points)


@guest()
def measure_study(
    scenario: Scenario,
    plan: StudyPlan,
    target: StudyTarget,
    *,
    device: DeviceChoice = "auto",
    progress: Progress | None = None,
) -> tuple[tuple[TargetErrors, ...], tuple[PoseRow, ...]]:
    """Return the errors of single targets and of poses; closed forms are left open.

    Parameters
    ----------
    scenario
        Instrument and processing.
    plan, target
        What is done, and with which targets.
    device
        Where to compute.
    progress
        Called with the steps done and the steps in all.
    """
    pools: list[TargetErrors] = []
    rows: list[PoseRow] = []
    done = 0
    for distance in plan.distances:
        pools.append(
            measure_targets(
                scenario, target, distance, positions=plan.positions, patterns=plan.patterns, device=device
            )
        )
        done += 1
        for array in plan.arrays:
            rows += _array_rows(scenario, plan, array, pools[-1])
            done += 1
            if progress is not None:
                progress(done, plan.steps)
    return tuple(pools), tuple(rows)


def target_rows(pools: Iterable[TargetErrors]) -> tuple[TargetRow, ...]:
    """Return the errors of single targets as a table."""
    rows = []
    for pool in pools:
        names = ("theta", "phi", *(f"range_{ranging}" for ranging in pool.rangings))
        for column, name in enumerate(names):
            unit = "m" if name.startswith("range") else "rad"
            rows.append(
                TargetRow(
                    range_m=pool.distance,
                    quantity=name,
                    unit=unit,
                    scatter=float(pool.scatter[column]),
                    stated=float(pool.stated[column]),
                    common=float(pool.common[column]),
                    voxel=float(pool.voxel[column]),
                    found=float(pool.found[column]),
                    observations=pool.error[..., 0].size,
                )
            )
    return tuple(rows)


def _array_rows(scenario: Scenario, plan: StudyPlan, array: Layout, pool: TargetErrors) -> Iterator[PoseRow]:
    """Yield the errors of an array's poses at one range."""
    drawn = {ranging: _observed(scenario, plan, array, pool, ranging) for ranging in pool.rangings}
    for method, source in MODES:
        if source not in ("none", *pool.rangings):
            continue
        ranging: RangefinderName = "tof" if source == "tof" else "triangulation"
        measured = drawn[ranging]
        errors, stated, ambiguous, count = np.full((1, 6), np.nan), np.full((1, 6), np.nan), math.nan, 0
        if measured is not None:
            pose = _estimated(array, *measured, method, scenario.scanner.mirrors.axis_separation)
            known = np.isfinite(pose.covariance).all(axis=(-2, -1))
            ambiguous, count = float((pose.status == PoseStatus.AMBIGUOUS).mean()), int(known.sum())
            if count:
                moved = pose.position - np.array([0.0, 0.0, pool.distance])
                errors = np.concatenate([moved, vector_from_rotation(pose.rotation)], axis=1)[known]
                stated = pose.sigma[known]
        freedom = 1.0 / (1.0 / len(errors) + 1.0 / pool.error[..., 0].size)
        for component, name in enumerate(COMPONENTS):
            size = float(np.sqrt(np.mean(errors[:, component] ** 2)))
            low, high = (size * math.sqrt(freedom / float(chi2.ppf(p, freedom))) for p in (0.975, 0.025))
            yield PoseRow(
                array.name,
                len(array.points),
                array.size,
                pool.distance,
                method,
                source,
                name,
                "m" if component < 3 else "rad",
                size,
                low,
                high,
                float(np.sqrt(np.mean(stated[:, component] ** 2))),
                float(np.mean(errors[:, component])),
                math.nan,
                math.nan,
                math.nan,
                ambiguous,
                count,
            )


def _observed(
    scenario: Scenario, plan: StudyPlan, array: Layout, pool: TargetErrors, ranging: RangefinderName
) -> tuple[Array, Array] | None:
    """Return measured (Θ, φ, R) and their stated σ, each (poses, targets, 3); None where targets are rarely found."""
    errors, sigmas = pool.of(ranging)
    known = np.isfinite(errors).all(axis=-1)
    if known.sum(axis=1).min() < 4:
        return None
    # One draw serves all arrays: what differs between them is not the luck of the draw.
    random = host_generator(scenario.seed, Stream.POSES, round(1e6 * pool.distance))
    position = random.integers(len(errors), size=plan.poses)
    share = random.random((plan.poses, max(len(item.points) for item in plan.arrays)))
    count = known.sum(axis=1)
    rank = (share[:, : len(array.points)] * count[position, None]).astype(np.int64)
    order = np.argsort(~known, axis=1, kind="stable")
    chosen = order[position[:, None], rank]
    x, y, z = (array.points + np.array([0.0, 0.0, pool.distance])).T
    r, theta, phi = angles_and_range(x, y, z, scenario.scanner.mirrors.axis_separation)
    truth = np.stack([theta, phi, r], axis=1)
    return truth + errors[position[:, None], chosen], sigmas[position[:, None], chosen]


def _estimated(
    array: Layout, measured: Array, sigma: Array, method: Method, axis_separation: float
) -> PoseEstimate:
    return estimate_pose(
        array.points,
        measured[..., 0],
        measured[..., 1],
        None if method == "uv" else measured[..., 2],
        sigma_theta=sigma[..., 0],
        sigma_phi=sigma[..., 1],
        sigma_range=None if method == "uv" else sigma[..., 2],
        axis_separation=axis_separation,
        method=method,
        point_weights="equal" if method == "xyz" else "covariance",
    )
