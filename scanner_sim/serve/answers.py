"""What the served door says: records, poses and rasters as plain maps, each number with its σ or covariance.

Covariances and matrices are lists of rows; what was not measured is NaN. Layers and voxels are arrays as of
:func:`~scanner_sim.serve.wire.array`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from scanner_sim.foundation.errors import ScannerSimError
from scanner_sim.pose.pose_filter import FilteredPose, Sighting
from scanner_sim.products.image import RangeImage
from scanner_sim.serve.messages import PROTOCOL
from scanner_sim.serve.wire import array
from scanner_sim.tracking.record import PatternRecord, TrackTarget

Plain = dict[str, Any]


def done(number: int | None, content: Plain) -> Plain:
    """Return the answer to what was done."""
    return {"protocol": PROTOCOL, "id": number, "ok": True, **content}


def refused(number: int | None, kind: str, message: str, remedy: str = "") -> Plain:
    """Return the answer to what was not: ``kind`` is ``input``, ``busy`` or ``run``."""
    error = {"kind": kind, "message": message, "remedy": remedy}
    return {"protocol": PROTOCOL, "id": number, "ok": False, "error": error}


def refused_by(number: int | None, error: ScannerSimError) -> Plain:
    """Return the answer that an exception of the program makes."""
    kind = "input" if error.exit_status == 2 else "run"
    return refused(number, kind, error.message, error.remedy)


def target_map(target: TrackTarget) -> Plain:
    """Return what a controller may know of a target."""
    return {
        "name": target.name,
        "object": target.object,
        "kind": target.appearance.kind.value,
        "diameter": target.appearance.diameter,
        "expected": target.expected.tolist(),
        "centre": target.centre.tolist(),
    }


def record_map(record: PatternRecord, *, truth: bool, voxels: bool) -> Plain:
    """Return a visit: what was measured with its covariance, its white and lasting parts, and when."""
    told: Plain = {
        "number": record.number,
        "target": record.target,
        "time": record.time,
        "available": record.available,
        "mode": record.mode.value,
        "after": record.after.value,
        "refusal": record.refusal.value,
        "status": int(record.status),
        "amplitude": float(record.amplitude),
        "position": record.position.tolist(),
        "covariance": record.covariance.tolist(),
        "white": record.errors.white.tolist(),
        "lasting": record.errors.lasting.tolist(),
        "range": float(record.position[2]),
        "sigma_range": math.sqrt(float(record.covariance[2, 2])),
        "point": record.point.tolist(),
        "point_covariance": record.point_covariance.tolist(),
    }
    if truth:
        told |= {"truth": record.truth.tolist(), "truth_point": record.truth_point.tolist()}
    if voxels:
        samples = record.samples
        told["voxels"] = {one.name: array(getattr(samples, one.name)[0]) for one in fields(samples)}
    return told


def pose_map(pose: FilteredPose) -> Plain:
    """Return a filtered pose with its rates and the covariance of (δt, δω, δv, δ rate)."""
    known = pose.status != "starting"
    return {
        "object": pose.object,
        "time": pose.time,
        "status": pose.status.value,
        "position": pose.position.tolist(),
        "quaternion": pose.quaternion.tolist() if known else [math.nan] * 4,
        "velocity": pose.velocity.tolist(),
        "turn_rate": pose.turn_rate.tolist(),
        "covariance": pose.covariance.tolist(),
        "surprise": float(pose.surprise),
    }


def sight_map(seen: Sighting) -> Plain:
    """Return where a target is to be seen, its rates, and the covariance of both."""
    return {name: values.tolist() for name, values in seen._asdict().items()}


def raster_map(image: RangeImage, layers: Sequence[str]) -> Plain:
    """Return a raster: its angles, and each layer row by row."""
    held = {name: array(image[name]) for name in dict.fromkeys(("status", *layers))}
    return {"theta": array(image.theta), "phi": array(image.phi), "layers": held}
