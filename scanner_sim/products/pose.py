"""Poses over time in tables: a line for each moment, object and method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.errors import InputError
from scanner_sim.pose.series import PoseSeries, SeriesMethod
from scanner_sim.pose.status import PoseStatus, legend
from scanner_sim.pose.transforms import quaternion_from_rotation, rotation_from_quaternion
from scanner_sim.products.files.tables import (
    ColumnKind,
    Columns,
    Table,
    check_columns,
    read_about,
    read_parquet,
    texts,
)

Array = NDArray[np.float64]

_POSITION, _QUATERNION = ("x_m", "y_m", "z_m"), ("qw", "qx", "qy", "qz")
COMPONENTS = ("tx", "ty", "tz", "rx", "ry", "rz")
"""The six components of a covariance: translation along, and turns about, the axes of the reference."""
_UNITS = ("m",) * 3 + ("rad",) * 3
_COVARIANCE = tuple(
    (
        f"cov_{COMPONENTS[i]}_{COMPONENTS[j]}_" + ("m2" if j < 3 else "rad2" if i > 2 else "m_rad"),
        (i, j),
    )
    for i in range(6)
    for j in range(i, 6)
)
_PARTS = ("lasting", "common")
"""Before the name of a covariance: its part that neighbouring poses share, and what of it the calibration makes."""
_LATER = tuple(f"common_{name}" for name, _ in _COVARIANCE)
"""Columns that tables of earlier versions lack."""
_KINDS: dict[str, ColumnKind] = {
    "time_s": "finite",
    **dict.fromkeys(
        (prefix + name for prefix in ("", "truth_") for name in (*_POSITION, *_QUATERNION)), "number"
    ),
    **dict.fromkeys(
        (prefix + name for prefix in ("", *(f"{part}_" for part in _PARTS)) for name, _ in _COVARIANCE),
        "number",
    ),
    "chi2": "number",
    **dict.fromkeys(("dof", "targets", "status"), "whole"),
}


@dataclass(frozen=True)
class _AboutPoses:
    """What :func:`about_poses` says that is needed again: object, reference, method and rows of each series."""

    series: tuple[tuple[str, str, SeriesMethod, int], ...]


def pose_columns(series: Sequence[PoseSeries]) -> Table:
    """Return the table of poses: one line for each moment of each series, the series in turn.

    Parameters
    ----------
    series
        All in the scanner's frame, or all of one object seen from another; not empty.

    Returns
    -------
    dict
        ``time_s object method x_m y_m z_m qw qx qy qz``, with ``relative_to`` after the object where they are relative;
        the 21 numbers of the symmetric 6 × 6 covariance of (δt, δω) along the axes of the reference, ``status``
        (:class:`~scanner_sim.pose.status.PoseStatus`), χ², degrees of freedom and number of targets, and the truth as
        ``truth_x_m`` to ``truth_qz``; then ``lasting_cov_``, the part of the covariance that neighbouring poses share,
        and ``common_cov_``, the part of that by the errors of the calibration.
    """
    columns: Table = {
        "time_s": np.concatenate([one.time for one in series]),
        "object": texts([one.name for one in series for _ in one.time]),
    }
    if any(one.relative_to for one in series):
        columns["relative_to"] = texts([one.relative_to for one in series for _ in one.time])
    columns["method"] = texts([one.method for one in series for _ in one.time])
    columns |= _pose_columns("", [one.position for one in series], [one.rotation for one in series])
    covariance = np.concatenate([one.covariance for one in series])
    columns |= {name: covariance[:, i, j] for name, (i, j) in _COVARIANCE}
    columns["status"] = np.concatenate([one.status for one in series]).astype(np.int32)
    columns["chi2"] = np.concatenate([one.chi2 for one in series])
    columns["dof"] = np.concatenate([one.dof for one in series])
    columns["targets"] = np.concatenate([one.targets for one in series])
    columns |= _pose_columns(
        "truth_", [one.truth_position for one in series], [one.truth_rotation for one in series]
    )
    for part in _PARTS:
        values = np.concatenate([getattr(one, part) for one in series])
        columns |= {f"{part}_{name}": values[:, i, j] for name, (i, j) in _COVARIANCE}
    return columns


def about_poses(series: Sequence[PoseSeries], software: str) -> dict[str, object]:
    """Return what the table of poses cannot say by itself, as plain data for its metadata."""
    return {
        "software": software,
        "rotation": "reference_from_object, unit quaternion w x y z",
        "covariance": "of (dt, dw) with position + dt and exp([dw]x) rotation, along the axes of the reference",
        "units": dict(zip(COMPONENTS, _UNITS, strict=True)),
        "status": legend(),
        "series": [[one.name, one.relative_to, one.method, len(one.time)] for one in series],
    }


def read_poses(path: Path) -> tuple[PoseSeries, ...]:
    """Return the poses of a ``pose.parquet`` or ``relative_pose.parquet``; earlier versions have no ``common``.

    Raises
    ------
    InputError
        If the file is missing, broken or not of this version.
    """
    columns, said = read_parquet(path)
    try:
        unknown = np.full(len(columns["time_s"]) if "time_s" in columns else 0, np.nan)
        columns = check_columns({**dict.fromkeys(_LATER, unknown), **columns}, _KINDS)
        series = read_about(said, _AboutPoses).series
        status = columns["status"]
        if min((one[3] for one in series), default=0) < 0 or sum(one[3] for one in series) != len(status):
            raise ValueError("the series and the rows differ in number")
        if ((status < 0) | (status > max(PoseStatus))).any():
            raise ValueError("poses have a status that there is not")
        found, first = [], 0
        for name, relative_to, method, count in series:
            part = {key: values[first : first + count] for key, values in columns.items()}
            found.append(_series(name, relative_to, method, part))
            first += count
        return tuple(found)
    except ValueError as error:
        raise InputError(
            f"{path} is damaged or not a table of this version: {error}.",
            remedy="Run its scenario.yaml again.",
        ) from None


def _pose_columns(prefix: str, positions: Sequence[Array], rotations: Sequence[Array]) -> Table:
    position = np.concatenate(positions)
    quaternion = quaternion_from_rotation(np.concatenate(rotations))
    names = (*_POSITION, *_QUATERNION)
    return dict(zip((prefix + name for name in names), (*position.T, *quaternion.T), strict=True))


def _series(name: str, relative_to: str, method: SeriesMethod, columns: Columns) -> PoseSeries:
    def together(names: tuple[str, ...], prefix: str = "") -> Array:
        return np.stack([columns[prefix + name] for name in names], axis=-1)

    whole = np.empty((1 + len(_PARTS), len(columns["time_s"]), 6, 6))
    for part, prefix in zip(whole, ("", *(f"{name}_" for name in _PARTS)), strict=True):
        for label, (i, j) in _COVARIANCE:
            part[:, i, j] = part[:, j, i] = columns[prefix + label]
    covariance, lasting, common = whole
    return PoseSeries(
        name=name,
        relative_to=relative_to,
        method=method,
        time=columns["time_s"],
        position=together(_POSITION),
        rotation=rotation_from_quaternion(together(_QUATERNION)),
        covariance=covariance,
        chi2=columns["chi2"],
        dof=columns["dof"],
        targets=columns["targets"],
        status=columns["status"].astype(np.int8),
        truth_position=together(_POSITION, "truth_"),
        truth_rotation=rotation_from_quaternion(together(_QUATERNION, "truth_")),
        lasting=lasting,
        common=common,
    )
