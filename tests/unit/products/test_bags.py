"""Scans and tracks as bags of ROS 2: what the reader of others finds in a bag is what was measured."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_clouds import COLUMNS, ISS, ROWS, cloud_time, make_image, scenario, wanted
from made_track import make_track, placed
from numpy.typing import NDArray

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.closed_loop.poses import poses_of
from scanner_sim.pose.series import PoseSeries
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.formats.cloud import cloud_of_scan, cloud_of_track
from scanner_sim.products.formats.convert import convert
from scanner_sim.products.image import RangeImage
from scanner_sim.ranging.axes import Axes
from scanner_sim.ranging.coordinates import coordinates
from scanner_sim.tracking.record import Track

laspy = pytest.importorskip("laspy", reason="the extra las is not installed")
rosbags = pytest.importorskip("rosbags.highlevel", reason="the extra ros is not installed")


@pytest.fixture(scope="module")
def image() -> RangeImage:
    return make_image()


@pytest.fixture(scope="module")
def written(image: RangeImage, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The image as a bag."""
    folder = tmp_path_factory.mktemp("bag")
    convert(image, folder, ["rosbag2"])
    return folder


def messages(folder: Path) -> dict[str, list[Any]]:
    """Every message of a bag by its topic, decoded by the definitions that the bag itself carries."""
    found: dict[str, list[Any]] = {}
    with rosbags.AnyReader([folder]) as reader:
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((time, message))
    return found


def fields_of(message: Any) -> NDArray[Any]:
    """Unpack a PointCloud2 as sensor_msgs/PointField describes it."""
    codes = {2: "u1", 4: "<u2", 6: "<u4", 7: "<f4", 8: "<f8"}
    form = {
        "names": [one.name for one in message.fields],
        "formats": [codes[one.datatype] for one in message.fields],
        "offsets": [one.offset for one in message.fields],
        "itemsize": message.point_step,
    }
    return np.frombuffer(message.data.tobytes(), dtype=np.dtype(form))  # type: ignore[call-overload, no-any-return]


def matrix_of(pose: Any) -> NDArray[np.float64]:
    """Turn of a quaternion, written apart: R v = v + 2 w q × v + 2 q × (q × v)."""
    q = np.array([pose.x, pose.y, pose.z])
    cross = np.cross(q, np.eye(3))
    return np.eye(3) + 2.0 * pose.w * cross.T + 2.0 * np.cross(q, cross).T


class TestRosbag:
    def test_a_scan(self, image: RangeImage, written: Path) -> None:
        """The cloud to the bit, row by row; true poses at both ends of the scan."""
        found = messages(written)
        assert found.keys() == {"/about", "/tf_static", "/points", "/truth/node_1"}
        _, cloud = found["/points"][0]
        assert (cloud.height, cloud.width, cloud.header.frame_id) == (ROWS, COLUMNS, "scanner_optical")
        assert not cloud.is_dense
        points = fields_of(cloud)
        for axis in "XYZ":
            np.testing.assert_array_equal(points[axis.lower()], image[f"P.{axis}"].ravel())
        for name, values in wanted(image).items():
            np.testing.assert_array_equal(points[name], values.astype(points[name].dtype))
        stamp = cloud.header.stamp.sec + 1e-9 * cloud.header.stamp.nanosec
        np.testing.assert_allclose(stamp + points["time"], cloud_time(image), atol=1e-9)
        assert [(time, one.pose.position.z) for time, one in found["/truth/node_1"]] == [
            (0, 7.0),
            (2_700_000, 7.0),
        ]
        about = json.loads(found["/about"][0][1].data)
        assert about["legends"]["object"]["1"] == "node"
        assert about["seed"] == image.seed
        assert set(points.dtype.names) - set("xyz") <= about["columns"].keys()
        assert "[m]" in about["columns"]["sigma_range"]
        assert "since the stamp [s]" in about["columns"]["time"]

    def test_frames_are_those_of_rep_103(self, written: Path) -> None:
        """What lies ahead of the optical frame (z) lies ahead of the body (x); right (x) is −y, and down (y) is −z."""
        (_, message), *_ = messages(written)["/tf_static"]
        (one,) = message.transforms
        assert (one.header.frame_id, one.child_frame_id) == ("scanner", "scanner_optical")
        body_from_optical = matrix_of(one.transform.rotation)
        np.testing.assert_allclose(body_from_optical, [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-12)

    def test_a_date_counts_from_1970(self, tmp_path: Path) -> None:
        """In the bag's own times and in the stamps that messages bear, to the nanosecond."""
        convert(make_image(lighting={"tle": ISS}), tmp_path / "bag", "rosbag2")
        found = messages(tmp_path / "bag")
        (time, static), *_ = found["/tf_static"]
        assert time == int(datetime(2008, 9, 20, 12, 25, 40, tzinfo=UTC).timestamp()) * 10**9
        (started, cloud), *_ = found["/points"]
        for moment, header in ((time, static.transforms[0].header), (started, cloud.header)):
            assert header.stamp.sec * 10**9 + header.stamp.nanosec == moment
            assert header.stamp.nanosec < 10**9

    @pytest.mark.parametrize("year", [1957, 1969, 2038, 2099])
    def test_a_date_that_ros_cannot_count_leaves_the_times_of_the_run(
        self, year: int, image: RangeImage
    ) -> None:
        """Claim: before 1970 and from 2038 on, where 32 bits of seconds end, the bag is that of a scan without date."""
        from scanner_sim.products.formats.rosbag import bag_files

        cloud = cloud_of_scan(image)
        assert bag_files(replace(cloud, epoch=datetime(year, 3, 1, tzinfo=UTC))) == bag_files(cloud)

    @pytest.mark.parametrize("year", [1970, 2037])
    def test_a_date_at_either_end_of_what_ros_can_count_is_counted(
        self, year: int, image: RangeImage
    ) -> None:
        from scanner_sim.products.formats.rosbag import bag_files

        cloud = cloud_of_scan(image)
        assert bag_files(replace(cloud, epoch=datetime(year, 12, 31, tzinfo=UTC))) != bag_files(cloud)

    def test_rows_are_as_long_as_their_points(self, written: Path) -> None:
        (_, cloud), *_ = messages(written)["/points"]
        assert cloud.width != cloud.height
        assert cloud.row_step == cloud.width * cloud.point_step
        assert len(cloud.data) == cloud.height * cloud.row_step


@pytest.fixture(scope="module")
def track() -> tuple[Track, tuple[PoseSeries, ...]]:
    """A made-up run, and its poses: the first of each series is doubtful."""
    made = make_track()
    poses = [
        replace(one, status=np.where(np.arange(len(one.status)) == 0, PoseStatus.AMBIGUOUS, one.status))
        for one in poses_of(made)
    ]
    return made, tuple(poses)


@pytest.fixture(scope="module")
def bag(track: tuple[Track, tuple[PoseSeries, ...]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bag")
    convert(track[0], folder, ["rosbag2", "las"], poses=track[1])
    return folder


class TestTrack:
    def test_every_voxel_of_every_pattern_is_a_point(
        self, track: tuple[Track, tuple[PoseSeries, ...]], bag: Path
    ) -> None:
        """Eq 3 of the paper from the measured angles and ranges; float32 holds them to a micrometre."""
        found = laspy.read(bag / "points.las")
        clouds = [fields_of(message) for _, message in messages(bag)["/points"]]
        records = [one for one in track[0].records if one.samples.time.shape[1]]
        assert [int(cloud["visit"][0]) for cloud in clouds] == [one.number for one in records]
        separation = scenario().scanner.mirrors.axis_separation
        true = np.concatenate(
            [
                np.stack(
                    coordinates(one.samples.range, one.samples.theta, one.samples.phi, separation), axis=-1
                )[one.samples.status == Status.VALID]
                for one in records
            ]
        )
        np.testing.assert_allclose(np.stack([found.x, found.y, found.z], axis=1), true, rtol=0, atol=2e-6)
        assert set(found["target"]) <= set(range(1, len(track[0].targets) + 1))

    def test_points_go_by_the_axes_that_the_instrument_believes(self) -> None:
        """Claim: about an axis that is 2 mm farther, 1 mm beside the beam and 2 mrad askew, to half a micrometre, in a
        cloud; by the designed ones they would lie up to a millimetre and more aside."""
        made = replace(make_track(0.1), axes=Axes(0.052, 1e-3, 2e-3))
        every = [
            np.concatenate([getattr(one.samples, name)[0] for one in made.records])
            for name in ("range", "theta", "phi", "status")
        ]
        r, theta, phi = (values[every[3] == Status.VALID] for values in every[:3])
        cloud = cloud_of_track(made)
        np.testing.assert_allclose(cloud.points[cloud.valid], placed(made.axes, r, theta, phi), atol=1e-6)
        aside = cloud.points[cloud.valid] - placed(Axes(0.05), r, theta, phi)
        assert np.abs(aside).max() > 1e-4

    def test_every_number_of_a_point_is_that_of_its_voxel(
        self, track: tuple[Track, tuple[PoseSeries, ...]]
    ) -> None:
        """Claim: each of a point's numbers is the sample of that name, of one voxel after the other; its visit and its
        target are those of the pattern, targets counted from 1."""
        made, _ = track
        cloud = cloud_of_track(made)
        found = {column.name: column.values for column in cloud.columns}
        row, names = 0, [one.name for one in made.targets]
        for record in made.records:
            for voxel in range(record.samples.time.shape[1]):
                for name in ("status", "range", "sigma_range", "signal"):
                    assert found[name][row] == getattr(record.samples, name)[0, voxel]
                assert (found["visit"][row], found["target"][row]) == (
                    record.number,
                    1 + names.index(record.target),
                )
                own = cloud.time[row], cloud.theta[row], cloud.signal[row]  # type: ignore[index]
                assert own == tuple(
                    getattr(record.samples, name)[0, voxel] for name in ("time", "theta", "signal")
                )
                assert cloud.valid[row] == (record.samples.status[0, voxel] == Status.VALID)
                row += 1
        assert row == len(cloud.points) == len(cloud.valid)
        assert {column.name: column.unit for column in cloud.columns} == {
            "status": "1",
            "range": "m",
            "sigma_range": "m",
            "signal": "electron",
            "visit": "1",
            "target": "1",
        }
        assert cloud.legends["target"] == {str(number): name for number, name in enumerate(names, start=1)}

    def test_targets_and_poses_with_their_covariances(
        self, track: tuple[Track, tuple[PoseSeries, ...]], bag: Path
    ) -> None:
        """ROS orders a covariance as x, y, z and turns about the fixed axes: as ours."""
        found, (made, poses) = messages(bag), track
        records = [one for one in made.of("node/1") if one.status == 0]
        assert len(found["/targets/node_1"]) == len(records)
        _, first = found["/targets/node_1"][0]
        covariance = first.pose.covariance.reshape(6, 6)
        np.testing.assert_array_equal(covariance[:3, :3], records[0].point_covariance)
        np.testing.assert_allclose(np.diag(covariance)[3:], math.pi**2 / 3.0)
        # A place alone, turned by nothing.
        place, turn = first.pose.pose.position, first.pose.pose.orientation
        np.testing.assert_array_equal([place.x, place.y, place.z], records[0].point)
        assert (turn.x, turn.y, turn.z, turn.w) == (0.0, 0.0, 0.0, 1.0)
        one = next(
            one for one in poses if one.name == "node" and one.method == "joint" and not one.relative_to
        )
        rows = np.flatnonzero(one.status == 0)
        assert 0 < len(rows) < len(one.status)
        stated = found["/poses/node/joint"]
        assert len(stated) == len(rows)
        for row, (time, message) in zip(rows, stated, strict=True):
            assert time == pytest.approx(one.time[row] * 1e9, abs=1.0)
            np.testing.assert_array_equal(message.pose.covariance.reshape(6, 6), one.covariance[row])
            np.testing.assert_allclose(
                matrix_of(message.pose.pose.orientation), one.rotation[row], atol=1e-12
            )
        moved = [message.transforms[0] for _, message in found["/tf"]]
        placed = next(one for one in moved if one.child_frame_id == "node")
        assert placed.header.frame_id == "scanner_optical"
        assert placed.transform.translation.x == one.position[rows[0], 0]

    def test_one_method_s_poses_turn_the_tree_and_the_truth_stands_once(
        self, track: tuple[Track, tuple[PoseSeries, ...]], tmp_path: Path
    ) -> None:
        """Claim: the joint pose of each object in the scanner's frame is its transform, and its truth stands beside
        that; poses by other methods, and of one object in another's frame, stand under their own topics alone.

        Set-up: poses by a camera, a second later, come first.
        """
        made, poses = track
        own = [one for one in poses if one.method == "joint" and not one.relative_to]
        others = [
            replace(one, method="camera", time=one.time + 1.0, position=one.position + 1.0) for one in own
        ]
        convert(made, tmp_path / "bag", "rosbag2", poses=(*others, *poses))
        found = messages(tmp_path / "bag")
        expected = {
            bag_time: one.name
            for one in own
            for bag_time in np.rint(one.time[one.status == 0] * 1e9).astype(int).tolist()
        }
        moved = [(time, message.transforms[0]) for time, message in found["/tf"]]
        assert len(moved) == sum(int(np.count_nonzero(one.status == 0)) for one in own)
        assert {one.child_frame_id for _, one in moved} == {one.name for one in own}
        assert {one.header.frame_id for _, one in moved} == {"scanner_optical"}
        assert {time for time, _ in moved} == set(expected)
        for one in own:
            rows = np.flatnonzero(one.status == 0)
            assert (
                len(found[f"/poses/{one.name}/camera"]) == len(found[f"/poses/{one.name}/joint"]) == len(rows)
            )
            true = [message.pose.position.x for _, message in found[f"/truth/{one.name}"]]
            np.testing.assert_array_equal(true, one.truth_position[rows, 0])
            turns = [matrix_of(message.pose.orientation) for _, message in found[f"/truth/{one.name}"]]
            np.testing.assert_allclose(turns, one.truth_rotation[rows], atol=1e-12)
        for one in poses:
            if one.relative_to:
                topic = f"/poses/{one.name}_from_{one.relative_to}/{one.method}"
                assert {message.header.frame_id for _, message in found[topic]} == {one.relative_to}
        assert any(one.relative_to for one in poses)

    def test_without_voxels_a_bag_still_has_its_targets(
        self, track: tuple[Track, tuple[PoseSeries, ...]], tmp_path: Path
    ) -> None:
        def bare(samples: Any) -> Any:
            return replace(
                samples, **{name: getattr(samples, name)[:, :0] for name in samples.__dataclass_fields__}
            )

        records = tuple(replace(one, samples=bare(one.samples)) for one in track[0].records)
        made = replace(track[0], records=records)
        assert not len(cloud_of_track(made).points)
        convert(made, tmp_path / "bag", "rosbag2")
        assert "/points" not in messages(tmp_path / "bag")
        with pytest.raises(InputError, match="no point") as fault:
            convert(made, tmp_path / "x.laz")
        assert "output.patterns" in fault.value.remedy

    def test_a_track_whose_voxels_were_kept_is_not_told_to_keep_them(
        self, track: tuple[Track, tuple[PoseSeries, ...]], tmp_path: Path
    ) -> None:
        """Claim: where no voxel has a range, or there was no visit, the summary is named, and no key that is set."""

        def dark(samples: Any) -> Any:
            return replace(samples, status=np.full_like(samples.status, Status.BELOW_THRESHOLD))

        records = tuple(replace(one, samples=dark(one.samples)) for one in track[0].records)
        for made in (replace(track[0], records=records), replace(track[0], records=())):
            with pytest.raises(InputError, match="no point") as fault:
                convert(made, tmp_path / "x.laz")
            assert fault.value.remedy == "Its summary.json counts what stood in the way."
