"""A tracking run as the data of a page: its visits with their patterns, and its poses, over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.status import Status
from scanner_sim.pose.series import PoseSeries
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.view.packing import packed
from scanner_sim.products.view.scan import PALETTE, colour_maps
from scanner_sim.products.view.surroundings import Surroundings
from scanner_sim.ranging.axes import Axes
from scanner_sim.tracking.record import PatternRecord, Track, TrackStatus
from scanner_sim.tracking.state import TrackMode

Array = NDArray[np.float64]

_POINT, _COARSE = 18, 11
_MODES = tuple(TrackMode)


def track_data(
    track: Track,
    poses: Sequence[PoseSeries],
    surroundings: Surroundings,
    *,
    outlines: Array,
    title: str,
    patterns: bool = True,
    notes: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the data of the page of a tracking run.

    Parameters
    ----------
    track
        The run.
    poses
        Its poses; those of one object seen from another are left out.
    surroundings
        What is drawn about it.
    outlines
        Half axes of each visit's true outline about its ``truth_point`` [m], shape (visits, 2, 3).
    title
        Its name.
    patterns
        Whether the voxels of the patterns are shown, as far as the run has kept them.
    notes
        Sentences on what was left out.
    """
    number = {target.name: index for index, target in enumerate(track.targets)}
    records = track.records
    status = np.array([int(one.status) for one in records], dtype=np.uint8)
    point = _stacked(records, "point")
    truth_point = _stacked(records, "truth_point")
    far = np.linalg.norm(truth_point, axis=1)
    duration = float(records[-1].time) if records else 0.0
    return {
        "kind": "track",
        "title": title,
        "about": f"{len(records):,} visits to {len(track.targets)} targets in {duration:.4g} s, seed {track.seed}",
        "notes": [*notes, *track.warnings],
        "targets": [{"name": one.name, "object": one.object} for one in track.targets],
        "palette": list(PALETTE),
        "modes": [mode.value for mode in _MODES],
        "statuses": [
            {"name": code.name.lower().replace("_", " "), "sentence": code.sentence} for code in TrackStatus
        ],
        "duration": duration,
        "visits": {
            "time": packed(np.array([one.time for one in records])),
            "target": packed(np.array([number[one.target] for one in records], dtype=np.int32)),
            "mode": packed(np.array([_MODES.index(one.mode) for one in records], dtype=np.uint8)),
            "after": packed(np.array([_MODES.index(one.after) for one in records], dtype=np.uint8)),
            "status": packed(status),
            "point": packed(point, _POINT),
            "truth_point": packed(truth_point, _POINT),
            "outline": packed(outlines, _COARSE),
            # Here, not on the page: two ranges in single precision differ by a quarter of a micrometre.
            "error": packed((_stacked(records, "position") - _stacked(records, "truth"))[:, 2]),
            "sigma": packed(_sigmas(records), _COARSE),
        },
        "patterns": _patterns(records, track.axes) if patterns else None,
        "poses": [_pose(one) for one in poses if not one.relative_to],
        "maps": colour_maps(),
        "surroundings": surroundings.drawn(1.1 * float(np.nanmax(far, initial=1.0))),
        "scenario": track.scenario_yaml,
        "made_by": {"software": track.made_by},
    }


def _stacked(records: Sequence[PatternRecord], name: str) -> Array:
    return np.array([getattr(one, name) for one in records], dtype=np.float64).reshape(-1, 3)


def _sigmas(records: Sequence[PatternRecord]) -> Array:
    """Return σ of each measured range [m], shape (n,)."""
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.array([one.covariance[2, 2] for one in records], dtype=np.float64))


def _patterns(records: Sequence[PatternRecord], axes: Axes) -> dict[str, Any] | None:
    """Return the voxels of all visits with a range one after the other: where each visit's begin, points, signals."""
    parts, counts = [], [0]
    for one in records:
        samples = one.samples
        valid = np.equal(samples.status[0], Status.VALID) & np.isfinite(samples.range[0])
        angles = (samples.range[0][valid], samples.theta[0][valid], samples.phi[0][valid])
        parts.append(np.stack([*axes.point(*angles), samples.signal[0][valid]], axis=-1))
        counts.append(counts[-1] + int(valid.sum()))
    if not counts[-1]:
        return None
    voxels = np.concatenate(parts)
    return {
        "first": packed(np.array(counts, dtype=np.int32)),
        "point": packed(voxels[:, :3], _POINT),
        "signal": packed(voxels[:, 3], _COARSE),
    }


def _pose(series: PoseSeries) -> dict[str, Any]:
    """Return the poses of an object: where its origin and its axes are, what is true, and how far it is off.

    ``error`` and ``sigma`` are of place [m] and attitude [rad], each of all three axes together, shape (n, 2).
    """
    good = np.equal(series.status, PoseStatus.VALID)
    turned, moved = series.covariance[:, 3:, 3:], series.covariance[:, :3, :3]
    with np.errstate(invalid="ignore"):
        sigma = np.sqrt(np.stack([np.trace(one, axis1=1, axis2=2) for one in (moved, turned)], axis=-1))
    # Not left to the page: places are rounded there by micrometres.
    error = np.linalg.norm(series.error.reshape(-1, 2, 3), axis=-1)
    return {
        "object": series.name,
        "method": series.method,
        "time": packed(series.time),
        "good": packed(good.astype(np.uint8)),
        "position": packed(series.position, _POINT),
        "rotation": packed(series.rotation),
        "truth_position": packed(series.truth_position, _POINT),
        "truth_rotation": packed(series.truth_rotation),
        "error": packed(error),
        "sigma": packed(sigma, _COARSE),
    }
