"""Measures: what a campaign keeps of a run, each a pure function of its result and of the truth in it.

A result is an image, a table of shots, or a track with its poses. A measure is NaN where there is nothing to measure.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import inverse
from scanner_sim.pose.series import PoseSeries
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.layers import LayeredResult
from scanner_sim.products.pose_study import COMPONENTS
from scanner_sim.tracking.record import Track, TrackStatus
from scanner_sim.tracking.state import TrackMode

Array = NDArray[np.float64]

FALSE_SIGMAS = 5.0
"""Stated standard deviations beyond which a range is not of the surface that the beam met."""
COVERED_SIGMAS = 1.959964
"""Those within which 95 % of normal errors lie."""


@dataclass(frozen=True)
class Outcome:
    """What a run gave: an image or shots, or else a track with the poses of its objects in the scanner's frame.

    ``every_pose`` has those of one object to another besides, in the order of the run's files.
    """

    scan: LayeredResult | None = None
    track: Track | None = None
    poses: tuple[PoseSeries, ...] = ()
    every_pose: tuple[PoseSeries, ...] = ()


@dataclass(frozen=True)
class Measure:
    """A number of a run.

    Attributes
    ----------
    unit, meaning
        Its unit, and what it is.
    of
        Field of an :class:`Outcome` that it is measured of.
    best
        What it ideally is: runs far from that are the worst.
    value
        The function.
    """

    unit: str
    meaning: str
    of: str
    best: float
    value: Callable[[Any], float]


def measured(names: tuple[str, ...], outcome: Outcome) -> dict[str, float]:
    """Return measures of a run by name; NaN where the run has nothing of that kind."""
    found = {}
    for name in names:
        measure = MEASURES[name]
        subject = getattr(outcome, measure.of)
        found[name] = float(measure.value(subject)) if subject else math.nan
    return found


def _errors(scan: LayeredResult) -> tuple[Array, Array]:
    """Return error [m] and stated σ [m] of the valid shots whose truth is known, shapes (n,)."""
    error, sigma = (scan[name].astype(np.float64) for name in ("range_m", "sigma_range_m"))
    error = error - scan["truth.range_m"]
    known = scan.valid & np.isfinite(error) & (sigma > 0.0)
    return error[known], sigma[known]


def _over(statistic: Callable[[Array], Any], values: Array) -> float:
    return float(statistic(values)) if values.size else math.nan


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _sigma_range(scan: LayeredResult) -> float:
    return _over(np.median, scan["sigma_range_m"][scan.valid].astype(np.float64))


def _covered(scan: LayeredResult) -> float:
    error, sigma = _errors(scan)
    return _over(np.mean, (np.abs(error) <= COVERED_SIGMAS * sigma).astype(np.float64))


def _pull(scan: LayeredResult) -> float:
    error, sigma = _errors(scan)
    return _over(_rms, error / sigma)


def _false_returns(scan: LayeredResult) -> float:
    error = np.abs(scan["range_m"].astype(np.float64) - scan["truth.range_m"])
    right = error <= FALSE_SIGMAS * scan["sigma_range_m"]
    return float(np.mean(scan.valid & ~right))


def _losses(track: Track) -> float:
    return float(sum(one.mode is not TrackMode.LOST and one.after is TrackMode.LOST for one in track.records))


def _measured_share(track: Track) -> float:
    taken = np.array([one.status is TrackStatus.MEASURED for one in track.records], dtype=np.float64)
    return _over(np.mean, taken)


def _target_rms(track: Track, axis: int) -> float:
    taken = [one for one in track.records if one.status is TrackStatus.MEASURED]
    return _over(_rms, np.array([one.position[axis] - one.truth[axis] for one in taken], dtype=np.float64))


def _target_pull(track: Track) -> float:
    taken = [one for one in track.records if one.status is TrackStatus.MEASURED]
    return _over(
        _rms, np.array([(one.position[2] - one.truth[2]) / math.sqrt(one.covariance[2, 2]) for one in taken])
    )


def _valid_poses(poses: tuple[PoseSeries, ...]) -> tuple[Array, Array]:
    """Return errors (n, 6) and covariances (n, 6, 6) of all valid poses whose truth is known."""
    error, covariance = [np.zeros((0, 6))], [np.zeros((0, 6, 6))]
    for one in poses:
        good = (one.status == PoseStatus.VALID) & np.isfinite(one.error).all(axis=1)
        error.append(one.error[good])
        covariance.append(one.covariance[good])
    return np.concatenate(error), np.concatenate(covariance)


def _pose_error(poses: tuple[PoseSeries, ...], first: int) -> float:
    error, _ = _valid_poses(poses)
    return _over(_rms, np.sqrt(np.sum(np.square(error[:, first : first + 3]), axis=1)))


def _mahalanobis(poses: tuple[PoseSeries, ...]) -> float:
    error, covariance = _valid_poses(poses)
    if not len(error):
        return math.nan
    return float(np.mean(np.einsum("ni,nij,nj->n", error, inverse(covariance), error)))


def _valid_pose_share(poses: tuple[PoseSeries, ...]) -> float:
    return _over(
        np.mean, np.concatenate([one.status == PoseStatus.VALID for one in poses]).astype(np.float64)
    )


def _last(poses: tuple[PoseSeries, ...], method: str, value: Callable[[PoseSeries], float]) -> float:
    """Return a number of the last pose of the first object by a method; NaN where there is none."""
    found = next((one for one in poses if one.method == method and len(one.time)), None)
    return math.nan if found is None else float(value(found))


def _last_component(poses: tuple[PoseSeries, ...], method: str, column: str, axis: int) -> float:
    return _last(poses, method, lambda one: float(getattr(one, column)[-1, axis]))


def _of_last_pose(method: str) -> Mapping[str, Measure]:
    """Return measures of the last pose by a method: where a track is one try, this is what it gave."""
    where = f"last pose by {method}"
    status = partial(_last, method=method, value=lambda one: float(one.status[-1]))
    found = {f"{method}_status": Measure("1", f"status of the {where}; 0 is valid", "poses", 0.0, status)}
    for axis, component in enumerate(COMPONENTS):
        for ending, column, words in (("", "error", "error"), ("_sigma", "sigma", "stated σ")):
            found[f"{method}_{component}{ending}"] = Measure(
                "m" if axis < 3 else "rad",
                f"{words} of {component} of the {where}",
                "poses",
                0.0,
                partial(_last_component, method=method, column=column, axis=axis),
            )
    return found


METHODS: Final = ("uv", "xyz", "joint", "camera")
"""Methods of poses whose last one is measured."""

MEASURES: Mapping[str, Measure] = {
    "sigma_range": Measure("m", "median of the stated σ of the valid ranges", "scan", 0.0, _sigma_range),
    "bias_range": Measure(
        "m", "mean error of the valid ranges", "scan", 0.0, lambda scan: _over(np.mean, _errors(scan)[0])
    ),
    "rms_range": Measure(
        "m", "rms error of the valid ranges", "scan", 0.0, lambda scan: _over(_rms, _errors(scan)[0])
    ),
    "pull_range": Measure(
        "1", "rms of error over stated σ of the valid ranges; 1 where σ is right", "scan", 1.0, _pull
    ),
    "coverage": Measure(
        "1", "share of valid ranges within 1.96 stated σ; 0.95 where σ is right", "scan", 0.95, _covered
    ),
    "valid_share": Measure(
        "1", "share of shots with a valid range", "scan", 1.0, lambda scan: float(scan.valid.mean())
    ),
    "false_returns": Measure(
        "1", "share of shots with a range beyond 5 stated σ, or of nothing", "scan", 0.0, _false_returns
    ),
    "lost_tracks": Measure("1", "number of times that a target was lost", "track", 0.0, _losses),
    "measured_share": Measure(
        "1", "share of visits in which the target was measured", "track", 1.0, _measured_share
    ),
    "rms_target_theta": Measure(
        "rad", "rms error of the targets' Θ", "track", 0.0, partial(_target_rms, axis=0)
    ),
    "rms_target_phi": Measure(
        "rad", "rms error of the targets' φ", "track", 0.0, partial(_target_rms, axis=1)
    ),
    "rms_target_range": Measure(
        "m", "rms error of the targets' range", "track", 0.0, partial(_target_rms, axis=2)
    ),
    "pull_target_range": Measure(
        "1", "rms of error over stated σ of the targets' range", "track", 1.0, _target_pull
    ),
    "pose_position": Measure(
        "m", "rms distance of the valid poses from the truth", "poses", 0.0, partial(_pose_error, first=0)
    ),
    "pose_attitude": Measure(
        "rad", "rms angle between the valid poses and the truth", "poses", 0.0, partial(_pose_error, first=3)
    ),
    "pose_mahalanobis": Measure(
        "1", "mean squared Mahalanobis distance of the valid poses; 6 is right", "poses", 6.0, _mahalanobis
    ),
    "valid_pose_share": Measure("1", "share of poses that are valid", "poses", 1.0, _valid_pose_share),
    **{name: measure for method in METHODS for name, measure in _of_last_pose(method).items()},
}
"""Measures by name."""
