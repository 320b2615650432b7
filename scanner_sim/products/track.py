"""A tracking run in files: one line for each visit to a target, and every voxel of its pattern."""

from __future__ import annotations

import dataclasses
import itertools
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.status import Status
from scanner_sim.products.error_columns import (
    DITHER,
    ERRORS,
    SURFACE_OF_RANGE,
    common_columns,
    error_columns,
    errors_from,
)
from scanner_sim.products.files.contents import TABLE, VOXELS
from scanner_sim.products.files.tables import (
    MOST,
    ColumnKind,
    Columns,
    Table,
    check_columns,
    read_about,
    read_parquet,
    read_result,
    texts,
)
from scanner_sim.products.formats.known import known_of
from scanner_sim.ranging.axes import Axes
from scanner_sim.tracking.errors import ErrorParts
from scanner_sim.tracking.measurement import TargetAppearance
from scanner_sim.tracking.record import PatternRecord, Track, TrackStatus, TrackTarget
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.state import Refusal, TrackMode

Array = NDArray[np.float64]

MOST_AWAY = 1e9
"""Distance within which a target of a table lies [m], and its angles [rad]."""


_ANGULAR, _SPATIAL = ("theta_rad", "phi_rad", "range_m"), ("x_m", "y_m", "z_m")
_CORNERS = ((0, 1), (0, 2), (1, 2))
_ANGULAR_CROSS = ("cov_theta_phi_rad2", "cov_theta_range_rad_m", "cov_phi_range_rad_m")
_SPATIAL_CROSS = ("cov_xy_m2", "cov_xz_m2", "cov_yz_m2")
_VOXEL = {
    "time": "time_s",
    "theta": "theta_rad",
    "phi": "phi_rad",
    "signal": "signal",
    "sigma_signal": "sigma_signal",
    "range": "range_m",
    "sigma_range": "sigma_range_m",
    "status": "status",
}


_SIGMAS = tuple(f"sigma_{name}" for name in (*_ANGULAR, *_SPATIAL))
_TABLE_KINDS: dict[str, ColumnKind] = {
    **dict.fromkeys(("time_s", "amplitude_rad", "centre_theta_rad", "centre_phi_rad"), "finite"),
    **dict.fromkeys(
        (prefix + name for prefix in ("", "truth_") for name in (*_ANGULAR, *_SPATIAL)), "number"
    ),
    # Of what was refused a fit may state any uncertainty.
    **dict.fromkeys((*_SIGMAS, *_ANGULAR_CROSS, *_SPATIAL_CROSS, *ERRORS, "available_s"), "any"),
    **dict.fromkeys(("target", "state", "next_state", "refusal"), "text"),
    **dict.fromkeys(("visit", "status"), "whole"),
}
_VOXEL_KINDS: dict[str, ColumnKind] = {
    "visit": "whole",
    **dict.fromkeys(_VOXEL.values(), "number"),
    "status": "whole",
}


_LATER: dict[str, float] = {
    "available_s": math.nan,
    "surface_approach_m": 1e9,
    "surface_range_fades": 1.0,
    **dict.fromkeys((*SURFACE_OF_RANGE, *DITHER), 0.0),
}
"""Columns that tables of earlier versions lack, and what they then hold: unknown, no range of which it goes, as soon as
angles, none."""


@dataclass(frozen=True)
class _AboutTarget:
    """What :func:`about_track` says of a target."""

    name: str
    object: str
    kind: str
    diameter_m: float
    depth_m: float
    expected_rad_rad_m: tuple[float, float, float]
    centre_on_object_m: tuple[float, float, float]
    surface: str = "flat"


@dataclass(frozen=True)
class _AboutAxes:
    """What :func:`about_track` says of the axes of the mirrors."""

    separation_m: float
    offset_m: float
    skew_rad: float


@dataclass(frozen=True)
class _AboutTrack:
    """What :func:`about_track` says of a run."""

    software: str
    seed: int
    scenario: str
    warnings: tuple[str, ...]
    targets: tuple[_AboutTarget, ...]
    axes: _AboutAxes | None = None


def track_columns(track: Track) -> Table:
    """Return the table of a run: a line for each visit, units in the names of the columns.

    Parameters
    ----------
    track
        The run.

    Returns
    -------
    dict
        ``time_s target state``, what was measured with its ``sigma_``, ``status``
        (:class:`~scanner_sim.tracking.record.TrackStatus`) and ``truth_``; then the visit's number, the state after it,
        why the measurement was refused, the pattern's amplitude and commanded centre, the covariances, and the parts of
        the error of (Θ, φ, R): ``sigma_white_``, ``sigma_surface_``, ``sigma_dither_`` of white, and what
        :class:`~scanner_sim.tracking.errors.ErrorParts` says of the others; ``available_s``, when the measurement is
        there. Measured numbers are NaN where nothing was found; a refused position stays, beside its status.
    """
    records = track.records

    def stacked(name: str, shape: tuple[int, ...]) -> Array:
        return np.array([getattr(record, name) for record in records], dtype=np.float64).reshape(-1, *shape)

    position, point = stacked("position", (3,)), stacked("point", (3,))
    angular, spatial = stacked("covariance", (3, 3)), stacked("point_covariance", (3, 3))
    truth, truth_point, centre = stacked("truth", (3,)), stacked("truth_point", (3,)), stacked("centre", (2,))
    columns: Table = {
        "time_s": stacked("time", ()),
        "target": texts([record.target for record in records]),
        "state": texts([record.mode.value for record in records]),
    }
    for names, values in ((_ANGULAR, position), (_SPATIAL, point)):
        columns |= dict(zip(names, values.T, strict=True))
    for names, matrices in ((_ANGULAR, angular), (_SPATIAL, spatial)):
        sigmas = np.sqrt(np.diagonal(matrices, axis1=1, axis2=2))
        columns |= {f"sigma_{name}": values for name, values in zip(names, sigmas.T, strict=True)}
    columns["status"] = np.array([int(record.status) for record in records], dtype=np.int32)
    for names, values in ((_ANGULAR, truth), (_SPATIAL, truth_point)):
        columns |= {f"truth_{name}": column for name, column in zip(names, values.T, strict=True)}
    columns |= {
        "visit": np.array([record.number for record in records], dtype=np.int64),
        "next_state": texts([record.after.value for record in records]),
        "refusal": texts([record.refusal.value for record in records]),
        "amplitude_rad": stacked("amplitude", ()),
        "centre_theta_rad": centre[:, 0],
        "centre_phi_rad": centre[:, 1],
    }
    for names, matrices in ((_ANGULAR_CROSS, angular), (_SPATIAL_CROSS, spatial)):
        columns |= {name: matrices[:, i, j] for name, (i, j) in zip(names, _CORNERS, strict=True)}
    none = ErrorParts.all_white(np.zeros((0, 3, 3)))
    parts = error_columns(ErrorParts.stack([one.errors for one in records]) if records else none)
    return columns | parts | {"available_s": stacked("available", ())}


def voxel_columns(track: Track) -> Table:
    """Return every voxel of every pattern as a table: the number of its visit, and the fields of its samples."""
    counts = [record.samples.time.shape[1] for record in track.records]
    numbers = np.array([record.number for record in track.records], dtype=np.int64)
    columns: Table = {"visit": np.repeat(numbers, counts)}
    for field, name in _VOXEL.items():
        kind = np.uint8 if field == "status" else np.float64
        parts = [getattr(record.samples, field)[0] for record in track.records]
        columns[name] = np.concatenate([np.zeros(0), *parts]).astype(kind)
    return columns


def about_track(track: Track) -> dict[str, object]:
    """Return what the tables of a run cannot say by themselves, as plain data for their metadata."""
    return {
        "software": track.made_by,
        "seed": track.seed,
        "scenario": track.scenario_yaml,
        "axes": {
            "separation_m": track.axes.separation,
            "offset_m": track.axes.offset,
            "skew_rad": track.axes.skew,
        },
        "warnings": list(track.warnings),
        "status": {str(int(code)): f"{code.name}: {code.sentence}" for code in TrackStatus},
        "targets": [
            {
                "name": target.name,
                "object": target.object,
                "kind": target.appearance.kind.value,
                "diameter_m": target.appearance.diameter,
                "depth_m": target.appearance.depth,
                "surface": target.appearance.surface,
                "expected_rad_rad_m": np.asarray(target.expected).tolist(),
                "centre_on_object_m": np.asarray(target.centre).tolist(),
            }
            for target in track.targets
        ],
    }


def read_track(folder: str | Path) -> Track:
    """Return the run that a folder holds.

    Parameters
    ----------
    folder
        Where :func:`scanner_sim.products.files.track_folder.write_track` wrote it.

    Returns
    -------
    Track
        As it was written. Patterns have no voxels where ``output.patterns`` was off; runs of earlier versions do not
        say when measurements were available, and are taken to believe in the designed axes of the mirrors.

    Raises
    ------
    InputError
        If there is no run, or its files are broken.
    """
    folder = Path(folder)
    columns, said = read_result(folder, TABLE, "a tracking run")
    voxels = read_parquet(folder / VOXELS)[0] if (folder / VOXELS).exists() else None
    try:
        about = read_about(said, _AboutTrack)
        targets = tuple(_target(one) for one in about.targets)
        rows = len(columns["time_s"]) if "time_s" in columns else 0
        missing = {name: np.full(rows, value) for name, value in _LATER.items() if name not in columns}
        kinds = _TABLE_KINDS | dict.fromkeys(itertools.chain(*common_columns(columns)), "any")
        columns = check_columns({**columns, **missing}, kinds)
        voxels = None if voxels is None else check_columns(voxels, _VOXEL_KINDS)
        _check_order(columns, voxels, {target.name for target in targets})
        return Track(
            records=tuple(_records(columns, voxels)),
            targets=targets,
            seed=about.seed,
            scenario_yaml=about.scenario,
            made_by=about.software,
            axes=_axes(about),
            warnings=about.warnings,
        )
    except ValueError as error:
        raise InputError(
            f"The tables in {folder} are damaged or not of this version: {error}.",
            remedy="Run its scenario.yaml again.",
        ) from None


def _check_order(columns: Columns, voxels: Columns | None, known: set[str]) -> None:
    """Refuse visits to targets that there are not, and numbers of visits that do not ascend."""
    if strangers := set(columns["target"]) - known:
        raise ValueError(f"there is no target {min(strangers)!r}")
    if (np.diff(columns["visit"]) <= 0).any() or (columns["visit"][:1] < 0).any():
        raise ValueError("visits are not numbered in order")
    measured = columns["status"] == TrackStatus.MEASURED
    if not all((columns[name][measured] < MOST).all() for name in (*_SIGMAS, *_ANGULAR, *_SPATIAL, *ERRORS)):
        raise ValueError(
            "a target was measured, but its position or its uncertainty is no number of any sense"
        )
    if voxels is not None:
        if (np.diff(voxels["visit"]) < 0).any():
            raise ValueError("voxels are not in the order of their visits")
        if ((voxels["status"] < 0) | (voxels["status"] > max(Status))).any():
            raise ValueError("voxels have a status that there is not")


def _axes(about: _AboutTrack) -> Axes:
    if about.axes is not None:
        return Axes(*_vector(dataclasses.astuple(about.axes), "the mirrors turn about nothing").tolist())
    if (known := known_of(about.scenario)) is None:
        raise ValueError("the axes of the mirrors are not told, and its scenario cannot be read")
    return Axes(known.scanner.mirrors.axis_separation)


def _target(said: _AboutTarget) -> TrackTarget:
    return TrackTarget(
        name=said.name,
        object=said.object,
        appearance=TargetAppearance.model_validate(
            {
                "kind": said.kind,
                "diameter": said.diameter_m,
                "depth": said.depth_m,
                "surface": said.surface,
            }
        ),
        expected=_vector(said.expected_rad_rad_m, "a target lies nowhere"),
        centre=_vector(said.centre_on_object_m, "a target lies nowhere"),
    )


def _vector(numbers: tuple[float, float, float], fault: str) -> Array:
    vector = np.array(numbers, dtype=np.float64)
    if not (np.abs(vector) < MOST_AWAY).all():
        raise ValueError(fault)
    return vector


def _records(columns: Columns, voxels: Columns | None) -> list[PatternRecord]:
    def together(names: tuple[str, ...], prefix: str = "") -> Array:
        return np.stack([columns[prefix + name] for name in names], axis=-1)

    def matrices(names: tuple[str, ...], cross: tuple[str, ...]) -> Array:
        with np.errstate(over="ignore", invalid="ignore"):
            result = together(names, "sigma_")[:, :, None] ** 2 * np.eye(3)
        for name, (i, j) in zip(cross, _CORNERS, strict=True):
            result[:, i, j] = result[:, j, i] = columns[name]
        # The unit matrix turns unknown variances into unknown rows but leaves zeros beside them.
        result[np.isnan(columns[cross[0]])] = np.nan
        return result

    position, point, centre = (
        together(_ANGULAR),
        together(_SPATIAL),
        together(("centre_theta_rad", "centre_phi_rad")),
    )
    truth, truth_point = together(_ANGULAR, "truth_"), together(_SPATIAL, "truth_")
    angular, spatial = matrices(_ANGULAR, _ANGULAR_CROSS), matrices(_SPATIAL, _SPATIAL_CROSS)
    samples, errors = _samples(columns["visit"], voxels), errors_from(columns, angular)
    measured = columns["status"] == TrackStatus.MEASURED
    if not (np.diagonal(errors.white, axis1=1, axis2=2)[measured] > 0.0).all():
        raise ValueError("a part of an uncertainty is larger than the whole")
    return [
        PatternRecord(
            number=int(columns["visit"][row]),
            target=str(columns["target"][row]),
            time=float(columns["time_s"][row]),
            mode=TrackMode(columns["state"][row]),
            after=TrackMode(columns["next_state"][row]),
            refusal=Refusal(columns["refusal"][row]),
            status=TrackStatus(int(columns["status"][row])),
            amplitude=float(columns["amplitude_rad"][row]),
            centre=centre[row],
            position=position[row],
            covariance=angular[row],
            errors=errors.at(row),
            point=point[row],
            point_covariance=spatial[row],
            truth=truth[row],
            truth_point=truth_point[row],
            samples=samples[row],
            available=float(columns["available_s"][row]),
        )
        for row in range(len(position))
    ]


def _samples(visits: NDArray[np.int64], voxels: Columns | None) -> list[PatternSamples]:
    """Return the voxels of each visit; they stand in the order of the visits."""
    if voxels is None:
        ends = np.zeros((2, len(visits)), dtype=np.int64)
        voxels = {name: np.zeros(0) for name in _VOXEL.values()}
    else:
        ends = np.stack([np.searchsorted(voxels["visit"], visits, side) for side in ("left", "right")])
    return [
        PatternSamples(**{field: voxels[name][None, first:last] for field, name in _VOXEL.items()})
        for first, last in ends.T.tolist()
    ]
