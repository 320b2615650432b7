"""Clouds, targets and poses as a bag of ROS 2 (rosbag2 with MCAP), written by rosbags without any ROS.

Frames follow REP 103: ``scanner_optical`` is the program's scanner frame, x to the right, y down, z forward, which is
what that document has for frames with this suffix; ``scanner`` is the same body with x forward, y to the left, z up.
They are tied by ``/tf_static``. REP 105's ``map`` and ``base_link`` are left to whoever mounts the scanner.
"""

from __future__ import annotations

import json
import math
import re
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from scanner_sim.pose.series import PoseSeries, SeriesMethod
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.transforms import quaternion_from_rotation
from scanner_sim.products.formats.cloud import Cloud
from scanner_sim.products.formats.pcd import packed
from scanner_sim.products.true_poses import TruePoses
from scanner_sim.tracking.record import Track, TrackStatus

Array = NDArray[np.float64]

OPTICAL, BODY = "scanner_optical", "scanner"
"""Frames of the scanner, as REP 103 has them."""
UNKNOWN_TURN = math.pi**2 / 3.0
"""Variance [rad²] of an angle of which nothing is known: even from −π to π."""
NAME = "points"
"""Of the bag, and of its file."""
VERSION: Literal[8] = 8
"""Of the bag: what ROS 2 reads from Iron on."""
_YEARS = range(1970, 2038)
"""Of which ROS counts the seconds, in 32 bits from 1970 on."""

_STORE = get_typestore(Stores.ROS2_HUMBLE)
_NO_TIME = QosTime(0, 0)
_LATCHED = Qos(
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    _NO_TIME,
    _NO_TIME,
    QosLiveliness.SYSTEM_DEFAULT,
    _NO_TIME,
    False,
)
_BEST: SeriesMethod = "joint"
"""Method whose poses place an object's frame, where there are several."""
_NUMBERS = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
"""Codes of sensor_msgs/PointField by the type of a column."""
_BODY_FROM_OPTICAL = (-0.5, 0.5, -0.5, 0.5)
"""Quaternion x, y, z, w."""


@dataclass
class _Bag:
    """Messages of a bag that is being made, by topic, with their times [ns]."""

    epoch: datetime | None
    messages: list[tuple[int, str, Any, bool]] = field(default_factory=list)
    names: dict[str, str] = field(default_factory=dict)

    def add(self, time: float, topic: str, message: Any, *, latched: bool = False) -> None:
        self.messages.append((self.nanoseconds(time), topic, message, latched))

    def nanoseconds(self, time: float) -> int:
        """Return a time of the run [s] as ROS counts: since 1970 where it can count the date, else since the start."""
        since = 0 if self.epoch is None else (self.epoch - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds()
        return round(since) * 10**9 + round((since - round(since) + time) * 1e9)

    def name(self, word: str) -> str:
        """Return a name that ROS takes, for each word another one."""
        if word not in self.names:
            plain = re.sub(r"[^A-Za-z0-9_]", "_", word)
            plain = plain if plain[:1].isalpha() else f"n_{plain}"
            while plain in (OPTICAL, BODY, *self.names.values()):
                plain += "_"
            self.names[word] = plain
        return self.names[word]

    def header(self, time: float, frame: str = OPTICAL) -> Any:
        whole, rest = divmod(self.nanoseconds(time), 10**9)
        return _made(
            "std_msgs/msg/Header",
            stamp=_made("builtin_interfaces/msg/Time", sec=whole, nanosec=rest),
            frame_id=frame,
        )


def bag_files(
    cloud: Cloud,
    track: Track | None = None,
    poses: Sequence[PoseSeries] = (),
    truth: TruePoses | None = None,
) -> dict[str, bytes]:
    """Return the files of a bag by their names.

    Parameters
    ----------
    cloud
        Its shots become ``/points``: one message of a scan, one for each visit of a track. It is stamped with the time
        of its first shot, and ``time`` of a point counts from there.
    track
        A run whose measured targets become ``/targets/NAME``.
    poses
        Series whose valid poses become ``/poses/NAME/METHOD`` and, by the method ``joint`` or else the first, ``/tf``.
    truth
        True poses of the objects of a scan: ``/truth/NAME``, as those of the series.
    """
    bag = _Bag(cloud.epoch if cloud.epoch is not None and cloud.epoch.year in _YEARS else None)
    bag.add(0.0, "/about", _made("std_msgs/msg/String", data=_about(cloud)), latched=True)
    static = _transform(bag, 0.0, BODY, OPTICAL, (0.0, 0.0, 0.0), _BODY_FROM_OPTICAL)
    bag.add(0.0, "/tf_static", static, latched=True)
    for part in cloud.parts("visit"):
        _add_cloud(bag, part)
    if truth is not None:
        for name, matrices in truth.scanner_from_object.items():
            for time, matrix in zip(truth.time, matrices, strict=True):
                _add_truth(bag, time, name, matrix[:3, 3], matrix[:3, :3])
    for record in () if track is None else track.records:
        if record.status is TrackStatus.MEASURED:
            covariance = np.diag([0.0] * 3 + [UNKNOWN_TURN] * 3)
            covariance[:3, :3] = record.point_covariance
            pose = _pose(record.point, (0.0, 0.0, 0.0, 1.0))
            topic = f"/targets/{bag.name(record.target)}"
            bag.add(record.time, topic, _with_covariance(bag, record.time, OPTICAL, pose, covariance))
    _add_poses(bag, poses)
    return _written(bag)


def _add_cloud(bag: _Bag, cloud: Cloud) -> None:
    table = packed(cloud)
    start = 0.0
    if cloud.time is not None:
        start = float(cloud.time[0])
        table["time"] -= start
    rows, columns = cloud.shape or (1, len(table))
    fields = [
        _made(
            "sensor_msgs/msg/PointField", name=name, offset=offset, datatype=_NUMBERS[kind.str[1:]], count=1
        )
        for name, (kind, offset, *_) in (table.dtype.fields or {}).items()
    ]
    message = _made(
        "sensor_msgs/msg/PointCloud2",
        header=bag.header(start),
        height=rows,
        width=columns,
        fields=fields,
        is_bigendian=False,
        point_step=table.dtype.itemsize,
        row_step=table.dtype.itemsize * columns,
        data=table.view(np.uint8).ravel(),
        is_dense=bool(cloud.valid.all()),
    )
    bag.add(start, "/points", message)


def _add_poses(bag: _Bag, poses: Iterable[PoseSeries]) -> None:
    seen: set[str] = set()
    for one in sorted(poses, key=lambda one: one.method != _BEST):
        frame = bag.name(one.relative_to) if one.relative_to else OPTICAL
        label = bag.name(f"{one.name}_from_{one.relative_to}" if one.relative_to else one.name)
        first = label not in seen
        seen.add(label)
        quaternion = np.roll(one.quaternion, -1, axis=1)
        for row in np.flatnonzero(one.status == PoseStatus.VALID):
            time, turn = float(one.time[row]), quaternion[row]
            pose = _pose(one.position[row], turn)
            message = _with_covariance(bag, time, frame, pose, one.covariance[row])
            bag.add(time, f"/poses/{label}/{one.method}", message)
            if first and not one.relative_to:
                bag.add(time, "/tf", _transform(bag, time, frame, label, one.position[row], turn))
            if first and not one.relative_to and np.isfinite(one.truth_position[row]).all():
                _add_truth(bag, time, one.name, one.truth_position[row], one.truth_rotation[row])


def _add_truth(bag: _Bag, time: float, name: str, position: Array, rotation: Array) -> None:
    turn = np.roll(quaternion_from_rotation(rotation[None])[0], -1)
    message = _made("geometry_msgs/msg/PoseStamped", header=bag.header(time), pose=_pose(position, turn))
    bag.add(time, f"/truth/{bag.name(name)}", message)


def _with_covariance(bag: _Bag, time: float, frame: str, pose: Any, covariance: Array) -> Any:
    """Return a pose whose covariance is of shifts and turns along the frame's axes, as ROS has it, too."""
    return _made(
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        header=bag.header(time, frame),
        pose=_made("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance.ravel()),
    )


def _pose(position: Iterable[float], turn: Iterable[float]) -> Any:
    return _made("geometry_msgs/msg/Pose", position=_vector("Point", position), orientation=_quaternion(turn))


def _transform(
    bag: _Bag, time: float, parent: str, child: str, position: Iterable[float], turn: Iterable[float]
) -> Any:
    one = _made(
        "geometry_msgs/msg/TransformStamped",
        header=bag.header(time, parent),
        child_frame_id=child,
        transform=_made(
            "geometry_msgs/msg/Transform",
            translation=_vector("Vector3", position),
            rotation=_quaternion(turn),
        ),
    )
    return _made("tf2_msgs/msg/TFMessage", transforms=[one])


def _vector(kind: str, numbers: Iterable[float]) -> Any:
    return _made(f"geometry_msgs/msg/{kind}", **dict(zip("xyz", map(float, numbers), strict=True)))


def _quaternion(numbers: Iterable[float]) -> Any:
    return _made("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", map(float, numbers), strict=True)))


def _made(kind: str, **values: Any) -> Any:
    return _STORE.types[kind](**values)


def _about(cloud: Cloud) -> str:
    """Return what the messages cannot say: legends, units, versions and the scenario, as JSON."""
    units: Mapping[str, str] = {column.name: column.description for column in cloud.columns}
    about = {
        "software": cloud.software,
        "seed": cloud.seed,
        "columns": {**units, "intensity": "charge of the signal [electron]", "time": "since the stamp [s]"},
        "legends": cloud.legends,
        "scenario": cloud.scenario,
    }
    return json.dumps(about)


def _written(bag: _Bag) -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        writer = Writer(Path(folder) / NAME, version=VERSION, storage_plugin=StoragePlugin.MCAP)
        connections: dict[str, Any] = {}
        with writer:
            for time, topic, message, latched in sorted(bag.messages, key=lambda one: one[0]):
                kind = message.__msgtype__
                if topic not in connections:
                    qos = [_LATCHED] if latched else []
                    connections[topic] = writer.add_connection(
                        topic, kind, typestore=_STORE, offered_qos_profiles=qos
                    )
                writer.write(connections[topic], time, _STORE.serialize_cdr(message, kind))
        return {path.name: path.read_bytes() for path in sorted((Path(folder) / NAME).iterdir())}
