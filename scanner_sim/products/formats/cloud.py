"""Points with what was measured of each, as every format takes them: made of a scan or of the patterns of a track."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.errors import InputError, printable
from scanner_sim.foundation.status import legend
from scanner_sim.products.formats.known import Known, known_of
from scanner_sim.products.image import RangeImage
from scanner_sim.products.layers import LayeredResult, numbered
from scanner_sim.products.provenance import software
from scanner_sim.products.shots import ShotTable
from scanner_sim.tracking.record import Track

Array = NDArray[np.float64]

RANGEFINDERS = {"": "", "triangulation": "", "tof": "tof.", "fused": "fused."}
"""Words for whose points are taken, and the prefix of their layers; empty for those that every result has."""

FRAME = "scanner frame: x to the right, y down, z forward, away from the scanner; metres"
"""In which frame all points are."""


@dataclass(frozen=True, eq=False)
class Column:
    """A number of each point beside its coordinates.

    Attributes
    ----------
    name
        Letters, digits and underscores, no more than 32.
    unit, meaning
        Its unit, ``1`` for none, and what it is; both together fit into the 32 bytes of a LAS file.
    values
        Shape (n,).
    """

    name: str
    unit: str
    meaning: str
    values: NDArray[Any]

    @property
    def description(self) -> str:
        """Meaning and unit in at most 32 characters of ASCII."""
        return self.meaning if self.unit == "1" else f"{self.meaning} [{self.unit}]"


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points of n shots in the scanner frame.

    Attributes
    ----------
    points
        x, y, z [m], shape (n, 3), float32, as PCL and ROS have them; NaN where nothing was measured.
    valid
        Where something was, shape (n,).
    signal
        Charge of the detected peak or echo [electron], shape (n,).
    sigma
        The least of what the instrument states of x, y and z [m], shape (n,); NaN where unknown.
    theta
        Deflection Θ of each shot [rad], shape (n,).
    time
        Middle of each dwell since the start [s], shape (n,); None where the scenario is not known.
    returns
        Number of the echo and how many there were, both shape (n,).
    columns
        All else; the first is ``status``.
    shape
        Rows and columns of a raster, whose shots go row by row; None without rows.
    epoch
        When the scan starts, in UTC; None where the scenario has no date.
    legends
        Names behind the numbers of columns, by column and number.
    software, seed, scenario
        What made it.
    """

    points: NDArray[np.float32]
    valid: NDArray[np.bool_]
    signal: Array
    sigma: Array
    theta: Array
    time: Array | None
    returns: tuple[NDArray[np.uint8], NDArray[np.uint8]]
    columns: tuple[Column, ...]
    shape: tuple[int, int] | None
    epoch: datetime | None
    legends: Mapping[str, Mapping[str, str]]
    software: str
    seed: int
    scenario: str

    @property
    def digest(self) -> str:
        """SHA-256 of the points and the scenario in hexadecimal digits: equal for equal results."""
        return hashlib.sha256(self.points.tobytes() + self.scenario.encode()).hexdigest()

    def parts(self, name: str) -> Iterator[Cloud]:
        """Yield the shots of each value of a column of its own, in the order in which these come; all without it."""
        found = next((column.values for column in self.columns if column.name == name), None)
        if found is None:
            yield self
            return
        ends = [0, *(np.flatnonzero(np.diff(found.astype(np.int64))) + 1).tolist(), len(found)]
        for first, end in pairwise(ends):
            if first < end:
                yield self._part(slice(first, end))

    def _part(self, which: slice) -> Cloud:
        return replace(
            self,
            points=self.points[which],
            valid=self.valid[which],
            signal=self.signal[which],
            sigma=self.sigma[which],
            theta=self.theta[which],
            time=None if self.time is None else self.time[which],
            returns=(self.returns[0][which], self.returns[1][which]),
            columns=tuple(replace(column, values=column.values[which]) for column in self.columns),
        )


_LAYERS = (
    ("range", "range_m", "m", "range along the beam"),
    ("sigma_range", "sigma_range_m", "m", "std deviation of range"),
    ("sigma_x", "sigma_x_m", "m", "std deviation of x"),
    ("sigma_y", "sigma_y_m", "m", "std deviation of y"),
    ("sigma_z", "sigma_z_m", "m", "std deviation of z"),
    ("cov_xy", "cov_xy_m2", "m2", "covariance of x and y"),
    ("cov_xz", "cov_xz_m2", "m2", "covariance of x and z"),
    ("cov_yz", "cov_yz_m2", "m2", "covariance of y and z"),
)
"""Columns of the layers that every rangefinder has: name, layer, unit and a short meaning."""
_SURFACE = (
    ("normal_x", "truth.normal.X", "1", "truth: normal of the surface"),
    ("normal_y", "truth.normal.Y", "1", "truth: normal of the surface"),
    ("normal_z", "truth.normal.Z", "1", "truth: normal of the surface"),
    ("incidence", "truth.incidence_rad", "rad", "truth: incidence"),
)
"""The same of truth that a scenario may ask for."""
_TRUTH = (
    ("object", "truth.object", "truth: object, 0 for none"),
    ("material", "truth.material", "truth: material, 0 for none"),
)
_RETURNS = 15
"""Returns of a pulse that a LAS file can count."""


def cloud_of_scan(result: LayeredResult, by: str = "") -> Cloud:
    """Return the points of an image or of a table of shots.

    Parameters
    ----------
    result
        The image or the table.
    by
        Whose points: a word of :data:`RANGEFINDERS`.

    Raises
    ------
    InputError
        If the result holds no points by it.
    """
    prefix, known = RANGEFINDERS[by], known_of(result.scenario_yaml)
    if by == "triangulation" and known is not None and known.ranging == "tof":
        raise InputError("this result has no range by triangulation.", remedy="Leave --by out.")
    names = [f"{prefix}P.{axis}" for axis in "XYZ"]
    if missing := [name for name in (*names, f"{prefix}status") if name not in result]:
        raise InputError(
            f"this result has no layer {missing[0]!r}.",
            remedy="Name another rangefinder with --by, or run its scenario with ranging: both."
            if by
            else "Run its scenario again: layers were left out.",
        )
    layer = {name: result[name].ravel() for name in result.channels}
    theta, time, where = _where(result, known)
    status = layer[f"{prefix}status"].astype(np.uint8)
    columns = [Column("status", "1", "0 where a range was measured", status)]
    columns += [
        Column(name, unit, meaning, layer[prefix + source])
        for name, source, unit, meaning in _LAYERS
        if prefix + source in layer
    ]
    columns += [
        Column(name, unit, meaning, layer[source])
        for name, source, unit, meaning in _SURFACE
        if source in layer
    ]
    signal = layer.get("tof.Y" if by == "tof" else "Y", np.zeros(len(status), dtype=np.float32))
    columns.append(Column("signal", "electron", "charge of the signal", signal))
    if "tof.echoes" in layer:
        columns.append(Column("echoes", "1", "echoes in the waveform", layer["tof.echoes"].astype(np.uint8)))
    columns += [
        Column(name, "1", meaning, layer[source].astype(np.uint16))
        for name, source, meaning in _TRUTH
        if source in layer
    ]
    sigmas = [layer[f"{prefix}sigma_{axis}_m"] for axis in "xyz" if f"{prefix}sigma_{axis}_m" in layer]
    return Cloud(
        points=np.stack([layer[name] for name in names], axis=1),
        valid=status == 0,
        signal=signal.astype(np.float64),
        sigma=np.min(sigmas, axis=0).astype(np.float64) if sigmas else np.full(len(status), np.nan),
        theta=theta,
        time=time,
        returns=_returns(layer, known, by),
        columns=(*columns, *where),
        shape=result.shape if isinstance(result, RangeImage) else None,
        epoch=None if known is None else known.epoch,
        legends={
            "status": legend(),
            **{
                name: {str(number): printable(word) for number, word in numbered(names).items()}
                for name, names in (("object", result.objects), ("material", result.materials))
            },
        },
        software=software(result.made_by),
        seed=result.seed,
        scenario=result.scenario_yaml,
    )


def _where(result: LayeredResult, known: Known | None) -> tuple[Array, Array | None, list[Column]]:
    """Return Θ and the time of each shot, and the columns that number it."""
    if isinstance(result, ShotTable):
        number = np.arange(len(result), dtype=np.uint32)
        return result.theta, result.time, [Column("shot", "1", "number of the shot", number)]
    assert isinstance(result, RangeImage)
    row, column = np.divmod(np.arange(result["status"].size), result.shape[1])
    time = None if known is None else (np.arange(len(row), dtype=np.float64) + 0.5) / known.scanner.rate
    return (
        result.theta[column],
        time,
        [
            Column("row", "1", "row of the raster, from the top", row.astype(np.uint16)),
            Column("column", "1", "column, from the left", column.astype(np.uint16)),
        ],
    )


def _returns(
    layer: Mapping[str, NDArray[np.float32]], known: Known | None, by: str
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return which echo was timed, and of how many; one of one where that is not known.

    By time of flight the instrument may time the first or the last. Of the strongest nobody knows which it was.
    """
    one = np.ones(len(layer["status"]), dtype=np.uint8)
    timed = by == "tof" or (known is not None and known.ranging == "tof")
    if not timed or known is None or "tof.echoes" not in layer:
        return one, one
    count = np.clip(layer["tof.echoes"], 1, _RETURNS).astype(np.uint8)
    which = {"first": one, "last": count}.get(known.processing.pulse.echo)
    return (one, one) if which is None else (which, count)


def cloud_of_track(track: Track) -> Cloud:
    """Return the voxels of all patterns of a tracking run; ``visit`` and ``target`` tell whose each is.

    Raises
    ------
    InputError
        If its scenario cannot be read.
    """
    known = known_of(track.scenario_yaml)
    if known is None:
        raise InputError("the scenario of this track cannot be read.", remedy="Run its scenario.yaml again.")
    records = [record for record in track.records if record.samples.time.shape[1]]

    def joined(name: str) -> Array:
        return np.concatenate([np.zeros(0), *(getattr(record.samples, name)[0] for record in records)])

    counts = [record.samples.time.shape[1] for record in records]
    order = {target.name: number for number, target in enumerate(track.targets, start=1)}
    theta, reach, status = joined("theta"), joined("range"), joined("status").astype(np.uint8)
    one = np.ones(len(status), dtype=np.uint8)
    return Cloud(
        points=np.stack(track.axes.point(reach, theta, joined("phi")), axis=1).astype(np.float32),
        valid=status == 0,
        signal=joined("signal"),
        sigma=np.full(len(status), np.nan),  # along the beam alone it is known
        theta=theta,
        time=joined("time"),
        returns=(one, one),
        columns=(
            Column("status", "1", "0 where a range was measured", status),
            Column("range", "m", "range along the beam", reach),
            Column("sigma_range", "m", "std deviation of range", joined("sigma_range")),
            Column("signal", "electron", "charge of the signal", joined("signal")),
            Column(
                "visit",
                "1",
                "number of the visit",
                np.repeat(np.array([record.number for record in records], dtype=np.uint32), counts),
            ),
            Column(
                "target",
                "1",
                "number of the target, from 1",
                np.repeat(np.array([order[record.target] for record in records], dtype=np.uint16), counts),
            ),
        ),
        shape=None,
        epoch=known.epoch,
        legends={
            "status": legend(),
            "target": {str(number): printable(name) for name, number in order.items()},
        },
        software=track.made_by,
        seed=track.seed,
        scenario=track.scenario_yaml,
    )
