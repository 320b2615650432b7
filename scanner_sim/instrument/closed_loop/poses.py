"""From a track to the poses of the objects that carry its targets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config import scenario_from_text
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.arithmetic import product
from scanner_sim.pose.interpolation import interpolate, rounds_of
from scanner_sim.pose.series import PoseSeries, pose_series, relative_series
from scanner_sim.pose.settings import PoseSettings
from scanner_sim.scene.objects import Disc, TargetArray
from scanner_sim.tracking.errors import ErrorParts
from scanner_sim.tracking.record import PatternRecord, Track, TrackStatus, TrackTarget
from scanner_sim.tracking.state import TrackMode

Array = NDArray[np.float64]

FEWEST = 3
"""Targets of an object from which it has a pose."""
_TURN = np.linspace(0.0, 2.0 * np.pi, 181)


def poses_of(track: Track, settings: PoseSettings | None = None) -> tuple[PoseSeries, ...]:
    """Return the scanner's poses of all objects that have at least three targets, one for each round of visits.

    Parameters
    ----------
    track
        A run.
    settings
        Methods, of which ``camera`` is not the scanner's; by default those of the run's scenario.

    Returns
    -------
    tuple of PoseSeries
        For each object and method; then, for each pair of objects and method, the second seen from the first, M_a⁻¹
        M_b. All are at the mean time of each round, to which the observations are carried
        (:func:`scanner_sim.pose.interpolation.interpolate`). What counts is what was measured of a target that the
        tracker follows: the first observations while it acquires the target, and all refused ones, do not. A last round
        that was cut short is left out. The covariances know what targets, neighbouring visits and objects have in
        common (:class:`~scanner_sim.tracking.errors.ErrorParts`).

    Raises
    ------
    InputError
        If the run's scenario cannot be read, for instance because the file of a motion is gone.
    """
    scenario = scenario_from_text(track.scenario_yaml, name="scenario of the run", stored=True)
    chosen = scenario.pose if settings is None else settings
    carriers = carriers_of(track.targets)
    if not (chosen.by_scanner and carriers):
        return ()
    followed = [target for targets in carriers.values() for target in targets]
    visits = _Visits(track, followed)
    if not len(visits.at):
        return ()
    robust = None if chosen.robust == "none" else chosen.robust
    found: list[PoseSeries] = []
    column = {target.name: number for number, target in enumerate(followed)}
    columns = {name: [column[target.name] for target in targets] for name, targets in carriers.items()}
    for name, targets in carriers.items():
        found += [
            pose_series(
                name,
                np.array([target.centre for target in targets], dtype=np.float64),
                visits.at,
                visits.observations.of(columns[name]),
                axis_separation=scenario.scanner.mirrors.axis_separation,
                method=method,
                robust=robust,
                truth=true_poses(scenario, name, visits.at),
            )
            for method in chosen.by_scanner
        ]
    relative = [
        relative_series(a, b, visits.observations.of([*columns[a.name], *columns[b.name]]))
        for a, b in combinations(found, 2)
        if a.name != b.name and a.method == b.method
    ]
    return (*found, *relative)


def carriers_of(targets: Sequence[TrackTarget]) -> dict[str, tuple[TrackTarget, ...]]:
    """Return the objects that have at least three of the targets, each with its own."""
    every: dict[str, tuple[TrackTarget, ...]] = {}
    for target in targets:
        every[target.object] = (*every.get(target.object, ()), target)
    return {name: own for name, own in every.items() if len(own) >= FEWEST}


def true_poses(scenario: Scenario, name: str, time: Array) -> Array:
    """Return where an object of a scenario is at times [s], ``scanner_from_object``, shape (n, 4, 4)."""
    (item,) = (item for item in scenario.scene.objects if item.name == name)
    return item.pose_at(time)


def outlines_of(track: Track) -> Callable[[Sequence[PatternRecord]], Array]:
    """Return what gives the true outlines of visits' targets, each at the time of its visit, as two half axes [m].

    An outline is ``truth_point`` + cos(a) u + sin(a) v for all angles a, of half axes (u, v), shape (n, 2, 3), along
    the axes of the scanner. Discs, alone or in an array, lie in their plane; of all else it is a circle of the target's
    diameter about its place, across the line to it.

    Raises
    ------
    InputError
        If the run's scenario cannot be read.
    """
    scenario = scenario_from_text(track.scenario_yaml, name="scenario of the run", stored=True)
    items = {item.name: item for item in scenario.scene.objects}
    targets = {target.name: target for target in track.targets}

    def outlines(records: Sequence[PatternRecord]) -> Array:
        seen = [targets[record.target] for record in records]
        across = _across(
            np.array([record.truth_point for record in records], dtype=np.float64).reshape(-1, 3)
        )
        for name in {target.object for target in seen}:
            if isinstance(items[name], Disc | TargetArray):
                own = [number for number, target in enumerate(seen) if target.object == name]
                poses = items[name].pose_at(np.array([records[number].time for number in own]))
                across[own] = np.swapaxes(poses[:, :3, :2], 1, 2)
        radii = np.array([0.5 * target.appearance.diameter for target in seen])
        return radii[:, None, None] * across

    return outlines


def _across(points: Array) -> Array:
    """Return two directions at right angles to the line to each point, the first level, shape (n, 2, 3)."""
    x, y, z = points.T
    level = np.stack([z, np.zeros_like(y), -x], axis=-1) / np.hypot(x, z)[:, None]
    upward = np.cross(points / np.linalg.norm(points, axis=-1, keepdims=True), level)
    return np.stack([level, upward], axis=1)


def rims_of(track: Track) -> Callable[[PatternRecord], Array]:
    """Return what gives the outline of :func:`outlines_of` as the scanner sees it, (Θ, φ) [rad], shape (n, 2).

    They are deflections about the axes that the instrument believes, as those of the voxels.

    Raises
    ------
    InputError
        If the run's scenario cannot be read.
    """
    outlines = outlines_of(track)
    round_ = np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1)

    def rim(record: PatternRecord) -> Array:
        (across,) = outlines([record])
        x, y, z = (record.truth_point + product(round_, across)).T
        _, theta, phi = track.axes.sight_of(x, y, z)
        return np.stack([theta, phi], axis=1)

    return rim


class _Visits:
    """The visits to some targets in rounds, carried to the common times ``at``."""

    def __init__(self, track: Track, targets: Sequence[TrackTarget]) -> None:
        column = {target.name: number for number, target in enumerate(targets)}
        records = [record for record in track.records if record.target in column]
        row = rounds_of([record.target for record in records])
        count = np.bincount(row)
        rounds = len(count)
        if rounds > 1 and count[-1] < count[-2]:
            rounds -= 1
        shape = (rounds, len(column))
        time, position, visited = np.full(shape, np.nan), np.full((*shape, 3), np.nan), np.full(shape, np.nan)
        unknown = ErrorParts.all_white(np.full((3, 3), np.nan))
        errors = [unknown] * (rounds * len(column))
        for record, number in zip(records, row.tolist(), strict=True):
            if number >= rounds:
                break
            where = number, column[record.target]
            visited[where] = record.time
            if record.status is TrackStatus.MEASURED and record.after is TrackMode.TRACK:
                time[where], position[where] = record.time, record.position
                errors[number * len(column) + where[1]] = record.errors
        self.at = np.nanmean(visited, axis=1) if rounds else np.zeros(0)
        if rounds:
            parts = ErrorParts.stack(errors).reshape(shape)
            self.observations = interpolate(time, position, parts, self.at)
