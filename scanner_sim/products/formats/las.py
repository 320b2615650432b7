"""Points as LAS 1.4, compressed (LAZ) or not, written by laspy: American Society for Photogrammetry, LAS 1.4 R15."""

from __future__ import annotations

import io
import json
import uuid
from datetime import date
from pathlib import Path

import laspy
import numpy as np
from laspy.vlrs import VLR
from laspy.vlrs.known import WktCoordinateSystemVlr
from numpy.typing import NDArray

from scanner_sim.products.formats.cloud import FRAME, Cloud
from scanner_sim.products.formats.gps_time import adjusted_time
from scanner_sim.products.formats.scale import scale_of

POINT_FORMAT = 6
"""Of LAS 1.4: 15 returns, a scan angle of 16 bits, the time of each point."""
_INTENSITY = 65_535.0
_ANGLE_STEP = 0.006
"""Unit of the scan angle [degrees]."""
_LONGEST = 65_000
"""Bytes of a text record; it can hold 65 535."""
_DATE = slice(90, 94)
"""Bytes of the header that hold the day of creation and its year."""
_LOCAL = (
    'LOCAL_CS["scanner frame, no coordinate reference system",LOCAL_DATUM["scanner",32767],UNIT["metre",1],'
    'AXIS["x, to the right",OTHER],AXIS["y, down",OTHER],AXIS["z, forward",OTHER]]'
)


def write_las(path: Path, cloud: Cloud, *, compressed: bool) -> None:
    """Write the measured points of a cloud; an existing file is overwritten.

    What has no range is left out. The scale of the coordinates is the largest power of ten that is a tenth of the least
    σ, or less; where such steps do not span the cloud, the smallest that do.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    points = cloud.points[cloud.valid].astype(np.float64)
    scale, offset, _ = scale_of(cloud)
    header = laspy.LasHeader(point_format=POINT_FORMAT, version="1.4")
    if cloud.epoch is not None:
        header.creation_date = date(cloud.epoch.year, cloud.epoch.month, cloud.epoch.day)
        header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    header.generating_software = cloud.software.partition(",")[0][:32]
    header.system_identifier = "SIMULATION"
    header.uuid = uuid.UUID(cloud.digest[:32])
    header.global_encoding.wkt = True
    header.scales, header.offsets = np.full(3, scale), offset
    header.add_extra_dims(
        [
            laspy.ExtraBytesParams(column.name, column.values.dtype, column.description)
            for column in cloud.columns
        ]
    )
    header.vlrs.append(WktCoordinateSystemVlr(_LOCAL))
    header.vlrs.append(VLR("LASF_Spec", 3, "Text Area Description", (_text(cloud) + "\0").encode()))
    record = laspy.ScaleAwarePointRecord.zeros(len(points), header=header)
    las = laspy.LasData(header=header, points=record)
    las.x, las.y, las.z = points.T
    las.intensity = intensity_of(cloud)
    las.return_number, las.number_of_returns = (values[cloud.valid] for values in cloud.returns)
    las.scan_angle = np.rint(np.degrees(cloud.theta[cloud.valid]) / _ANGLE_STEP).astype(np.int16)
    if cloud.time is not None:
        las.gps_time = cloud.time[cloud.valid] + (0.0 if cloud.epoch is None else adjusted_time(cloud.epoch))
    for column in cloud.columns:
        las[column.name] = column.values[cloud.valid]
    las.header.update(las.points)
    # Through memory: on a full disk the error is then the operating system's, with its code.
    stream = io.BytesIO()
    las.write(stream, do_compress=compressed, laz_backend=laspy.LazBackend.Lazrs if compressed else None)
    if cloud.epoch is None:
        # Day and year 0: the library puts today's, and the same result shall have the same bytes tomorrow.
        stream.getbuffer()[_DATE] = bytes(4)
    path.write_bytes(stream.getbuffer())


def intensity_of(cloud: Cloud) -> NDArray[np.uint16]:
    """Return the signal of the measured points, the largest as 65 535 and none as 0."""
    signal = np.nan_to_num(cloud.signal[cloud.valid], nan=0.0, posinf=0.0, neginf=0.0)
    largest = float(signal.max(initial=0.0))
    return np.rint(_INTENSITY * np.clip(signal / (largest or 1.0), 0.0, 1.0)).astype(np.uint16)


def _text(cloud: Cloud) -> str:
    """Return what the file cannot say by its columns, in ASCII."""
    largest = float(np.nan_to_num(cloud.signal[cloud.valid]).max(initial=0.0))
    time = "adjusted standard GPS time" if cloud.epoch else "seconds since the start of the scan, no date"
    lines = [
        "Simulated laser scanner. No coordinate reference system.",
        FRAME,
        f"intensity: charge of the signal, {largest:.9g} electrons as 65535; without scaling in 'signal'",
        f"gps_time: {time if cloud.time is not None else 'not known'}",
        "scan_angle: deflection Theta of the beam, positive to the right",
        "shots without a range are left out",
        cloud.software,
        f"seed {cloud.seed}",
    ]
    legends = json.dumps(cloud.legends)
    left = _LONGEST - len("\n".join(lines).encode("ascii", "backslashreplace"))
    lines.append(legends if len(legends) < left else "names behind numbers: too many for this record")
    return "\n".join(lines).encode("ascii", "backslashreplace").decode()
