"""Points as E57 (ASTM E2807), written by libE57Format through pye57: structured where there are rows."""

from __future__ import annotations

import errno
import json
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pye57 import libe57

from scanner_sim.products.formats.cloud import FRAME, Cloud, Column
from scanner_sim.products.formats.gps_time import gps_time

EXTENSION = ("sim", "urn:scanner-sim:e57:1")
"""Prefix and name of what E57 itself has no elements for."""
INVALID = 2
"""Of ``cartesianInvalidState``: the point is no point; 0 is one."""
_STANDARD = {"row": "rowIndex", "column": "columnIndex"}
"""Columns for which E57 has names."""


def write_e57(path: Path, cloud: Cloud) -> None:
    """Write all shots of a cloud as one scan; an existing file is overwritten.

    What has no range is marked by ``cartesianInvalidState`` 2 and lies at the origin; its numbers other than its status
    are 0. The pose is that of the scanner in its own frame: neither moved nor turned.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    try:
        file = libe57.ImageFile(str(path), "w")
        try:
            _fill(file, cloud)
        except BaseException:
            file.cancel()
            raise
        file.close()
    except libe57.E57Exception as error:
        raise OSError(errno.EIO, f"the library of E57 says {error}") from None


def _fill(file: Any, cloud: Cloud) -> None:
    file.extensionsAdd("", libe57.E57_V1_0_URI)
    file.extensionsAdd(*EXTENSION)
    root, scans = file.root(), libe57.VectorNode(file, True)
    number = uuid.UUID(cloud.digest[:32])
    for name, node in (
        ("formatName", libe57.StringNode(file, "ASTM E57 3D Imaging Data File")),
        ("guid", libe57.StringNode(file, f"{{{uuid.uuid5(number, 'file')}}}")),
        ("versionMajor", libe57.IntegerNode(file, libe57.E57_FORMAT_MAJOR)),
        ("versionMinor", libe57.IntegerNode(file, libe57.E57_FORMAT_MINOR)),
        ("e57LibraryVersion", libe57.StringNode(file, libe57.E57_LIBRARY_ID)),
        ("coordinateMetadata", libe57.StringNode(file, "")),
        ("data3D", scans),
        ("images2D", libe57.VectorNode(file, True)),
    ):
        root.set(name, node)
    scan = libe57.StructureNode(file)
    scans.append(scan)
    scan.set("guid", libe57.StringNode(file, f"{{{number}}}"))
    scan.set("name", libe57.StringNode(file, f"scan, seed {cloud.seed}"))
    scan.set("description", libe57.StringNode(file, _text(cloud)))
    scan.set("sensorModel", libe57.StringNode(file, cloud.software))
    scan.set(f"{EXTENSION[0]}:legends", libe57.StringNode(file, json.dumps(cloud.legends)))
    scan.set("pose", _pose(file))
    for name, limits in _limits(cloud).items():
        scan.set(name, _structure(file, limits))
    if cloud.epoch is not None and cloud.time is not None and len(cloud.time):
        for name, after in (("acquisitionStart", 0.0), ("acquisitionEnd", float(cloud.time.max()))):
            moment = _structure(file, {"dateTimeValue": gps_time(cloud.epoch) + after})
            moment.set("isAtomicClockReferenced", libe57.IntegerNode(file, 0))
            scan.set(name, moment)
    _write_points(file, scan, list(_fields(cloud)))


def _pose(file: Any) -> Any:
    pose = libe57.StructureNode(file)
    pose.set("rotation", _structure(file, {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}))
    pose.set("translation", _structure(file, {"x": 0.0, "y": 0.0, "z": 0.0}))
    return pose


def _structure(file: Any, numbers: dict[str, float | int]) -> Any:
    node = libe57.StructureNode(file)
    for name, value in numbers.items():
        kind = libe57.IntegerNode if isinstance(value, int) else libe57.FloatNode
        node.set(name, kind(file, value))
    return node


def _limits(cloud: Cloud) -> dict[str, dict[str, float | int]]:
    """Return bounds of the points, of their intensities and, with rows, of their indices."""
    found: dict[str, dict[str, float | int]] = {}
    if cloud.valid.any():
        points = cloud.points[cloud.valid].astype(np.float64)
        found["cartesianBounds"] = {
            f"{axis}{end}": float(value)
            for end, values in (("Minimum", points.min(axis=0)), ("Maximum", points.max(axis=0)))
            for axis, value in zip("xyz", values, strict=True)
        }
    if len(cloud.signal):
        signal = _finite(cloud.signal)
        found["intensityLimits"] = {
            "intensityMinimum": float(signal.min()),
            "intensityMaximum": float(signal.max()),
        }
    if cloud.shape is not None:
        ends = {"row": cloud.shape[0] - 1, "column": cloud.shape[1] - 1, "return": 0}
        found["indexBounds"] = {
            key: value
            for name, end in ends.items()
            for key, value in ((f"{name}Minimum", 0), (f"{name}Maximum", end))
        }
    return found


def _fields(cloud: Cloud) -> Iterator[Column]:
    """Yield the elements of a point, without NaN."""
    for axis, name in enumerate("XYZ"):
        yield Column(f"cartesian{name}", "m", "", _finite(cloud.points[:, axis]))
    state = np.where(cloud.valid, 0, INVALID).astype(np.uint8)
    yield Column("cartesianInvalidState", "1", "", state)
    yield Column("intensity", "electron", "", _finite(cloud.signal).astype(np.float32))
    if cloud.time is not None:
        yield Column("timeStamp", "s", "", cloud.time)
    for column in cloud.columns:
        name = _STANDARD.get(column.name, f"{EXTENSION[0]}:{column.name}")
        yield Column(name, column.unit, column.meaning, _finite(column.values))


def _write_points(file: Any, scan: Any, fields: list[Column]) -> None:
    prototype, buffers = libe57.StructureNode(file), libe57.VectorSourceDestBuffer()
    arrays = []
    for field in fields:
        values, node = np.ascontiguousarray(field.values), None
        if values.dtype.kind == "f":
            precision = libe57.E57_SINGLE if values.itemsize == 4 else libe57.E57_DOUBLE
            largest = float(np.finfo(values.dtype).max)
            node = libe57.FloatNode(file, 0.0, precision, -largest, largest)
        else:
            least, largest = int(values.min(initial=0)), int(values.max(initial=0))
            # The library takes no numbers of 32 bits without a sign.
            values = values.astype(np.int64) if values.itemsize > 2 else values
            node = libe57.IntegerNode(file, 0, least, max(largest, 1))
        prototype.set(field.name, node)
        arrays.append(values)  # the buffers do not own them
        buffers.append(libe57.SourceDestBuffer(file, field.name, values, len(values), True, False))
    points = libe57.CompressedVectorNode(file, prototype, libe57.VectorNode(file, True))
    scan.set("points", points)
    writer = points.writer(buffers)
    writer.write(len(arrays[0]))
    writer.close()


def _finite(values: NDArray[Any]) -> NDArray[Any]:
    return np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0) if values.dtype.kind == "f" else values


def _text(cloud: Cloud) -> str:
    lines = [
        "Simulated laser scanner.",
        FRAME,
        "intensity: charge of the signal in electrons",
        "points without a range: cartesianInvalidState 2, why in sim:status",
        *(
            f"{EXTENSION[0]}:{column.name}: {column.description}"
            for column in cloud.columns
            if column.name not in _STANDARD
        ),
    ]
    return "\n".join(lines)
