"""A tracking run in numbers: how often each target was measured, and how far from the truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from scanner_sim.pose.beside import beside_camera
from scanner_sim.pose.series import PoseSeries
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.json_text import json_text
from scanner_sim.products.pose import COMPONENTS
from scanner_sim.products.provenance import versions
from scanner_sim.tracking.record import PatternRecord, Track, TrackStatus
from scanner_sim.tracking.state import TrackMode

Array = NDArray[np.float64]

_AXES = (("theta", "rad"), ("phi", "rad"), ("range", "m"))
_NAMES = tuple(f"{name}_{'m' if axis < 3 else 'rad'}" for axis, name in enumerate(COMPONENTS))


def track_summary(track: Track, poses: Sequence[PoseSeries] = ()) -> dict[str, object]:
    """Return the summary of a run as plain numbers, texts, lists and dictionaries.

    Errors are those of the measured visits; None where there is none. Sections ``truth`` hold what a real instrument
    could not know.
    """
    records = track.records
    return {
        "visits": len(records),
        "duration_s": float(max((record.time for record in records), default=0.0)),
        "seed": track.seed,
        "voxels": int(sum(record.samples.time.shape[1] for record in records)),
        "status": [
            {
                "code": int(code),
                "name": code.name,
                "meaning": code.sentence,
                "visits": sum(record.status is code for record in records),
            }
            for code in TrackStatus
        ],
        "targets": {target.name: _target(track.of(target.name)) for target in track.targets},
        "poses": [_poses(one) for one in poses],
        **_by_camera(poses),
        "versions": dict(versions()),
        "warnings": list(track.warnings),
    }


def track_json(track: Track, poses: Sequence[PoseSeries] = ()) -> str:
    """Return :func:`track_summary` as the text of ``summary.json``."""
    return json_text(track_summary(track, poses))


def errors_of(records: Sequence[PatternRecord]) -> tuple[Array, Array]:
    """Return measured less true (Θ, φ, R) [rad, rad, m] of the measured visits, and σ of each, shapes (n, 3)."""
    measured = [record for record in records if record.status is TrackStatus.MEASURED]
    error = np.array([record.position - record.truth for record in measured]).reshape(-1, 3)
    variance = np.array([np.diagonal(record.covariance) for record in measured]).reshape(-1, 3)
    return error, np.sqrt(variance)


def _target(records: Sequence[PatternRecord]) -> dict[str, object]:
    error, sigma = errors_of(records)
    modes = [record.after for record in records]
    lost = sum(record.mode is not TrackMode.LOST and record.after is TrackMode.LOST for record in records)
    first = next((record.time for record in records if record.after is TrackMode.TRACK), None)
    return {
        "visits": len(records),
        "measured_share": len(error) / len(records) if records else None,
        "followed_from_s": first,
        "losses": lost,
        "state": modes[-1].value if modes else None,
        **{f"sigma_{name}_{unit}": _middle(sigma[:, axis]) for axis, (name, unit) in enumerate(_AXES)},
        "truth": _compare_errors(error, sigma, [f"{name}_{unit}" for name, unit in _AXES]),
    }


def _poses(series: PoseSeries) -> dict[str, object]:
    codes = [PoseStatus(code) for code in series.status.tolist()]
    good = series.status == PoseStatus.VALID
    return {
        "object": series.name,
        "relative_to": series.relative_to or "scanner",
        "method": series.method,
        "poses": len(codes),
        "status": {code.name: codes.count(code) for code in PoseStatus if code in codes},
        "sigma": dict(zip(_NAMES, map(_middle, series.sigma[good].T), strict=True)),
        "truth": _compare_errors(series.error[good], series.sigma[good], _NAMES),
    }


def _by_camera(poses: Sequence[PoseSeries]) -> dict[str, object]:
    """Return what the scanner's poses are off the camera's, where a run has both."""
    pairs = [
        {
            "object": one.scanner.name,
            "relative_to": one.scanner.relative_to or "scanner",
            "method": one.scanner.method,
            "compared": len(one.time),
            "sigma": dict(zip(_NAMES, map(_middle, one.sigma.T), strict=True)),
            "mean_difference": _by(_NAMES, one.difference, np.mean),
            "rms_difference": _by(_NAMES, one.difference, _rms),
            "rms_difference_over_sigma": _by(_NAMES, one.difference / one.sigma, _rms),
        }
        for one in beside_camera(poses)
    ]
    return {"scanner_less_camera": pairs} if pairs else {}


def _compare_errors(error: Array, sigma: Array, names: Sequence[str]) -> dict[str, object]:
    """Return rms errors, means and rms of error over σ by component."""
    known = np.isfinite(error).all(axis=1)
    error, sigma = error[known], sigma[known]
    return {
        "compared": len(error),
        "mean_error": _by(names, error, np.mean),
        "rms_error": _by(names, error, _rms),
        "rms_error_over_sigma": _by(names, error / np.where(sigma > 0.0, sigma, np.nan), _rms),
    }


def _by(names: Sequence[str], values: Array, statistic: Callable[[Array], float]) -> dict[str, float | None]:
    columns = values.T if len(values) else [None] * len(names)
    return {
        name: None if column is None or not np.isfinite(column).all() else float(statistic(column))
        for name, column in zip(names, columns, strict=True)
    }


def _middle(values: Array) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else None


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
