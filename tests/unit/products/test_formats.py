"""Points for other programs: what each format's own reader finds in a file is what was measured, to its precision."""

from __future__ import annotations

import json
import math
import re
import runpy
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from made_clouds import COLUMNS, ISS, RATE, ROWS, cloud_time, make_image, times, wanted
from made_track import make_track
from numpy.typing import NDArray

from scanner_sim.foundation.channels import MEASURED_BY
from scanner_sim.foundation.errors import InputError
from scanner_sim.products.files.contents import FORMAT_FILES
from scanner_sim.products.files.run_folder import write_run
from scanner_sim.products.formats import known
from scanner_sim.products.formats.cloud import cloud_of_scan, cloud_of_track
from scanner_sim.products.formats.convert import convert
from scanner_sim.products.formats.gps_time import gps_time
from scanner_sim.products.formats.scale import scale_of
from scanner_sim.products.formats.writers import check_formats
from scanner_sim.products.image import RangeImage
from scanner_sim.products.settings import Output
from scanner_sim.products.shots import ShotTable

laspy = pytest.importorskip("laspy", reason="the extra las is not installed")
pye57 = pytest.importorskip("pye57", reason="the extra e57 is not installed")


@pytest.fixture(scope="module")
def image() -> RangeImage:
    return make_image()


@pytest.fixture(scope="module")
def written(image: RangeImage, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The image in every format."""
    folder = tmp_path_factory.mktemp("formats")
    told: list[tuple[int, int]] = []
    paths = convert(image, folder, list(FORMAT_FILES), progress=lambda *numbers: told.append(numbers))
    assert told == [(number + 1, len(paths)) for number in range(len(paths))]
    assert {path.name for path in paths} == {name for names in FORMAT_FILES.values() for name in names}
    return folder


def test_times_are_those_of_the_scan(image: RangeImage) -> None:
    found = cloud_of_scan(image).time
    assert found is not None
    np.testing.assert_allclose(found, times(), rtol=1e-12)


@pytest.mark.parametrize("by", ["", "tof"])
def test_the_signal_is_that_of_the_rangefinder(by: str, image: RangeImage) -> None:
    """Claim: charges are those of the line or of the echo, and zeros of single precision where they were left out."""
    name = "tof.Y" if by else "Y"
    charges = {"Y": 3.0, "tof.Y": 5.0}
    layers = {
        key: np.full_like(layer, charges.get(key, 0.0)) if key in charges else layer
        for key, layer in image.channels.items()
    } | {key: np.full(image.shape, value, dtype=np.float32) for key, value in charges.items()}
    for kept, charge in ((layers, charges[name]), ({k: v for k, v in layers.items() if k != name}, 0.0)):
        cloud = cloud_of_scan(replace(image, channels=kept), by)
        (column,) = (one for one in cloud.columns if one.name == "signal")
        assert column.values.dtype == np.float32
        assert (column.values == charge).all()
        assert (cloud.signal == charge).all()
        assert column.unit == "electron"


def test_a_result_is_read_without_libyaml(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: where PyYAML is built without its library in C, its own safe loader reads the scenario."""
    monkeypatch.setattr(yaml, "__with_libyaml__", False)
    assert runpy.run_path(known.__file__)["_Loader"] is yaml.SafeLoader


class TestLas:
    @pytest.mark.parametrize("word", ["laz", "las"])
    def test_round_trip(self, image: RangeImage, written: Path, word: str) -> None:
        """Coordinates to half a step, all else to the bit; what has no range is left out."""
        found, valid = laspy.read(written / f"points.{word}"), image.valid.ravel()
        assert len(found.points) == np.count_nonzero(valid)
        for axis, name in enumerate("xyz"):
            true = image[f"P.{name.upper()}"].ravel()[valid].astype(np.float64)
            np.testing.assert_allclose(found[name], true, rtol=0, atol=0.5001 * found.header.scales[axis])
        for name, values in wanted(image).items():
            np.testing.assert_array_equal(found[name], values[valid].astype(found[name].dtype))
        np.testing.assert_array_equal(found.gps_time, cloud_time(image)[valid])
        theta = np.tile(np.degrees(image.theta), ROWS)[valid]
        np.testing.assert_allclose(found.scan_angle * 0.006, theta, atol=0.0031)

    def test_the_header_says_what_the_points_are(self, written: Path) -> None:
        """LAS 1.4, R15: formats 6 to 10 have WKT; without a date times are no GPS times."""
        header = laspy.read(written / "points.las").header
        assert (str(header.version), header.point_format.id) == ("1.4", 6)
        assert header.global_encoding.wkt
        assert header.global_encoding.gps_time_type == laspy.header.GpsTimeType.WEEK_TIME
        # Table 3 of the format: day and year of creation, which nobody may take from the clock.
        assert (written / "points.las").read_bytes()[90:94] == bytes(4)
        coordinate_system = next(one for one in header.vlrs if one.record_id == 2112)
        assert coordinate_system.string.startswith("LOCAL_CS[")
        text = next(one for one in header.vlrs if one.record_id == 3).record_data.decode()
        assert "electrons as 65535" in text
        assert "y down" in text
        assert '"2": "handrail 2"' in text

    def test_every_column_says_its_unit(self, written: Path) -> None:
        """Claim: lengths are in metres, covariances in their square, angles in radians and charges in electrons; what
        counts or points has no unit."""
        found = laspy.read(written / "points.las").point_format.extra_dimensions
        about = {one.name: one.description for one in found}
        assert about["sigma_x"] == "std deviation of x [m]"
        lengths = {"range", "sigma_range", "sigma_x", "sigma_y", "sigma_z"}
        units = dict.fromkeys(lengths, "m") | {f"cov_{pair}": "m2" for pair in ("xy", "xz", "yz")}
        units |= {"incidence": "rad", "signal": "electron"}
        assert units.keys() <= about.keys()
        for name, text in about.items():
            meaning, _, unit = text.rstrip("]").partition(" [")
            assert meaning
            assert unit == units.get(name, ""), name

    def test_the_step_is_a_tenth_of_the_least_sigma_or_less(self, image: RangeImage) -> None:
        cloud = cloud_of_scan(image)
        scale, _, least = scale_of(cloud)
        assert least == np.nanmin([image[f"sigma_{axis}_m"] for axis in "xyz"])
        assert least / 100.0 < scale <= least / 10.0
        assert math.log10(scale) == pytest.approx(round(math.log10(scale)))

    def test_more_names_than_a_record_holds_are_left_out(self, image: RangeImage, tmp_path: Path) -> None:
        many = replace(
            image, objects=(*image.objects, *(f"object number {number}" for number in range(9000)))
        )
        convert(many, tmp_path / "x.laz")
        found = laspy.read(tmp_path / "x.laz")
        text = next(one for one in found.header.vlrs if one.record_id == 3).record_data.decode()
        assert "too many for this record" in text
        assert len(found.points) == np.count_nonzero(image.valid)

    @pytest.mark.parametrize("far", [1.0, 1e3, 1.5e4, 1.6e4, 1e5, 1e6])
    def test_far_points_get_the_finest_step_that_reaches_them(self, image: RangeImage, far: float) -> None:
        """32 bits with a sign: 2³¹ − 1 steps to either side of the offset, and none below a tenth of σ."""
        cloud = cloud_of_scan(image)
        cloud = replace(cloud, points=cloud.points * np.array([far, 1, 1], np.float32))
        scale, offset, least = scale_of(cloud)
        reach = np.abs(cloud.points[cloud.valid].astype(np.float64) - offset).max()
        possible = [10.0**power for power in range(-5, 3) if reach / 10.0**power <= 2**31 - 1]
        assert 1e-5 <= least / 10.0 < 1e-4
        assert scale == pytest.approx(possible[0])

    def test_steps_coarser_than_sigma_are_refused(self, image: RangeImage, tmp_path: Path) -> None:
        lost = {
            name: layer * np.float32(1e5) if name.startswith("P.") else layer
            for name, layer in image.channels.items()
        }
        lost |= {f"sigma_{axis}_m": image[f"sigma_{axis}_m"] * np.float32(1e-2) for axis in "xyz"}
        with pytest.raises(InputError, match="32 bits") as fault:
            convert(replace(image, channels=lost), tmp_path / "far.las")
        assert "e57" in fault.value.remedy
        convert(replace(image, channels=lost), tmp_path / "far.e57")

    def test_points_of_a_rangefinder_that_did_not_measure_are_refused(self, tmp_path: Path) -> None:
        """Claim: by triangulation where time of flight was alone, and by either of a track, which keeps one range of
        each voxel; neither becomes a file with other points."""
        for result, by, said in (
            (make_image("tof"), "triangulation", "no range by triangulation"),
            (make_track(), "triangulation", "none apart by triangulation"),
            (make_track(), "tof", "none apart by tof"),
        ):
            with pytest.raises(InputError, match=said):
                convert(result, tmp_path / "x.pcd", by=by)
        assert not list(tmp_path.iterdir())
        convert(make_image("tof"), tmp_path / "x.pcd", by="tof")
        convert(make_image("both"), tmp_path / "y.pcd", by="triangulation")

    @pytest.mark.parametrize(("echo", "which"), [("first", 1), ("last", None), ("strongest", 1)])
    def test_returns_are_counted_where_the_instrument_knows_them(
        self, tmp_path: Path, echo: str, which: int | None
    ) -> None:
        image = make_image(echo=echo)
        convert(image, tmp_path / "x.las", by="tof")
        found, count = laspy.read(tmp_path / "x.las"), image["tof.echoes"].ravel()[image.valid.ravel()]
        known = count if echo != "strongest" else np.ones_like(count)
        np.testing.assert_array_equal(found.number_of_returns, known)
        np.testing.assert_array_equal(found.return_number, count if which is None else which)
        np.testing.assert_allclose(found.z, image["tof.P.Z"].ravel()[image.valid.ravel()], atol=1e-4)

    def test_a_date_makes_gps_time(self, tmp_path: Path) -> None:
        """20 September 2008: GPS was 14 s ahead of UTC (IERS Bulletin C 30)."""
        image = make_image(lighting={"tle": ISS})
        convert(image, tmp_path / "x.las")
        found = laspy.read(tmp_path / "x.las")
        assert found.header.global_encoding.gps_time_type == laspy.header.GpsTimeType.STANDARD
        since = (datetime(2008, 9, 20, 12, 25, 40) - datetime(1980, 1, 6)).total_seconds()
        np.testing.assert_allclose(found.gps_time[0] + 1e9, since + 14.0 + 0.5 / RATE, atol=1e-6)
        assert str(found.header.creation_date) == "2008-09-20"
        assert gps_time(datetime(1980, 1, 6, tzinfo=UTC)) == 0.0
        # A leap second ended June 2015 and December 2016, none June 2016 (IERS Bulletins C 49 to 52).
        for day, seconds in (
            (datetime(2015, 7, 1), 2.0),
            (datetime(2016, 7, 1), 1.0),
            (datetime(2017, 1, 1), 2.0),
        ):
            start = day.replace(tzinfo=UTC)
            assert gps_time(start) - gps_time(start - timedelta(seconds=1)) == seconds


class TestE57:
    def test_round_trip(self, image: RangeImage, written: Path) -> None:
        """To the bit, by its reader's fields and by those of the extension."""
        valid = image.valid.ravel()
        with pye57.E57(str(written / "points.e57")) as file:
            found = file.read_scan(0, intensity=True, row_column=True)
            for axis in "XYZ":
                np.testing.assert_array_equal(
                    found[f"cartesian{axis}"], image[f"P.{axis}"].ravel()[valid].astype(np.float64)
                )
            np.testing.assert_array_equal(found["intensity"], image["Y"].ravel()[valid])
            np.testing.assert_array_equal(found["rowIndex"], wanted(image)["row"][valid])
            np.testing.assert_array_equal(found["columnIndex"], wanted(image)["column"][valid])
            own = read_own(file)
            stamps = read_fields(file, ["timeStamp"])["timeStamp"]
        np.testing.assert_allclose(stamps, times(), rtol=0.0, atol=1e-12)
        for name, values in wanted(image).items():
            if name in own:
                np.testing.assert_array_equal(own[name], np.nan_to_num(values.astype(np.float64)))
        assert own.keys() == wanted(image).keys() - {"row", "column"}

    def test_the_scan_is_structured_and_stands_in_the_scanner(self, image: RangeImage, written: Path) -> None:
        with pye57.E57(str(written / "points.e57")) as file:
            header = file.get_header(0)
            assert (header.rowMaximum, header.columnMaximum) == (ROWS - 1, COLUMNS - 1)
            np.testing.assert_array_equal(header.rotation, [1.0, 0.0, 0.0, 0.0])
            np.testing.assert_array_equal(header.translation, np.zeros(3))
            limits, ends = header["intensityLimits"], header["indexBounds"]
            assert limits["intensityMinimum"].value() == image["Y"].min()
            assert limits["intensityMaximum"].value() == image["Y"].max()
            for name, last in (("row", ROWS - 1), ("column", COLUMNS - 1), ("return", 0)):
                assert (ends[f"{name}Minimum"].value(), ends[f"{name}Maximum"].value()) == (0, last)
            for axis in "xyz":
                found = [header["cartesianBounds"][f"{axis}{end}"].value() for end in ("Minimum", "Maximum")]
                own = image[f"P.{axis.upper()}"][image.valid]
                assert found == [own.min(), own.max()]
            state = read_fields(file, ["cartesianInvalidState"])["cartesianInvalidState"]
            np.testing.assert_array_equal(state, np.where(image.valid.ravel(), 0, 2))
            assert not header.node.isDefined("acquisitionStart"), "no date, no moment"
            assert json.loads(header["sim:legends"].value())["object"] == {"1": "node", "2": "handrail 2"}

    def test_a_date_tells_when_the_scan_began_and_ended(self, tmp_path: Path) -> None:
        """Claim: as GPS time, 14 s ahead of UTC in 2008; the end is that of the last voxel's dwell."""
        image = make_image(lighting={"tle": ISS})
        convert(image, tmp_path / "x.e57")
        since = (datetime(2008, 9, 20, 12, 25, 40) - datetime(1980, 1, 6)).total_seconds() + 14.0
        with pye57.E57(str(tmp_path / "x.e57")) as file:
            header = file.get_header(0)
            moments = [header[f"acquisition{end}"]["dateTimeValue"].value() for end in ("Start", "End")]
        np.testing.assert_allclose(np.subtract(moments, since), [0.0, times().max()], atol=1e-6)
        assert times().max() > 1e-3

    @pytest.mark.parametrize("lighting", [{}, {"tle": ISS}])
    def test_no_shot_at_all_makes_a_scan_without_points(
        self, lighting: dict[str, Any], tmp_path: Path
    ) -> None:
        """Claim: as of a track that ends before its first pattern does, with a date and without."""
        from scanner_sim.products.formats.e57 import write_e57

        track = replace(make_track(), records=(), scenario_yaml=make_image(lighting=lighting).scenario_yaml)
        write_e57(tmp_path / "x.e57", cloud_of_track(track))
        with pye57.E57(str(tmp_path / "x.e57")) as file:
            assert (file.scan_count, file.get_header(0).point_count) == (1, 0)


def read_own(file: Any) -> dict[str, NDArray[np.float64]]:
    """Read the fields of the extension, which pye57's own readers pass over."""
    names = [name for name in file.get_header(0).point_fields if name.startswith("sim:")]
    return {name.removeprefix("sim:"): values for name, values in read_fields(file, names).items()}


def read_fields(file: Any, names: list[str]) -> dict[str, NDArray[np.float64]]:
    """Read fields by the library itself."""
    header, lib = file.get_header(0), pye57.libe57
    arrays = {name: np.empty(header.point_count) for name in names}
    buffers = lib.VectorSourceDestBuffer()
    for name, values in arrays.items():
        buffers.append(lib.SourceDestBuffer(file.image_file, name, values, len(values), True, True))
    header.points.reader(buffers).read()
    return arrays


class TestPcd:
    @pytest.mark.parametrize("word", ["pcd", "pcd_ascii"])
    def test_round_trip(self, image: RangeImage, written: Path, word: str) -> None:
        """Organised, to the bit, with NaN where nothing was measured. Read by the format's own description."""
        header, found = read_pcd(written / FORMAT_FILES[word][0])
        assert (header["WIDTH"], header["HEIGHT"]) == (str(COLUMNS), str(ROWS))
        assert header["VIEWPOINT"] == "0 0 0 1 0 0 0"
        for axis in "XYZ":
            np.testing.assert_array_equal(found[axis.lower()], image[f"P.{axis}"].ravel())
        np.testing.assert_array_equal(found["intensity"], image["Y"].ravel())
        for name, values in wanted(image).items():
            np.testing.assert_array_equal(found[name], values.astype(found[name].dtype))
        np.testing.assert_array_equal(found["time"], cloud_time(image))


def read_pcd(path: Path) -> tuple[dict[str, str], NDArray[Any]]:
    head, _, body = path.read_bytes().partition(b"\nDATA ")
    header = dict(line.split(" ", 1) for line in head.decode().splitlines() if not line.startswith("#"))
    kinds = {("F", "4"): "<f4", ("F", "8"): "<f8", ("U", "1"): "u1", ("U", "2"): "<u2", ("U", "4"): "<u4"}
    form = [
        (name, kinds[kind, size])
        for name, kind, size in zip(
            header["FIELDS"].split(), header["TYPE"].split(), header["SIZE"].split(), strict=True
        )
    ]
    way, _, body = body.partition(b"\n")
    if way == b"binary":
        return header, np.frombuffer(body, dtype=form)
    return header, np.array([tuple(line.split()) for line in body.decode().splitlines()], dtype=form)


class TestAnyFormat:
    def test_the_same_result_gives_the_same_bytes(
        self, image: RangeImage, written: Path, tmp_path: Path
    ) -> None:
        for path in convert(image, tmp_path, list(FORMAT_FILES)):
            assert path.read_bytes() == (written / path.name).read_bytes(), path.name

    def test_shots_keep_their_order_and_numbers(self, image: RangeImage, tmp_path: Path) -> None:
        time = np.linspace(0.0, 1.0, ROWS * COLUMNS) ** 2
        layers = {name: layer.ravel() for name, layer in image.channels.items()}
        kept = {name: getattr(image, name) for name in ("objects", "materials", "scenario_yaml")}
        theta, phi = np.tile(image.theta, ROWS), np.repeat(image.phi, COLUMNS)
        shots = ShotTable(channels=layers, time=time, theta=theta, phi=phi, **kept)
        convert(shots, tmp_path, ["pcd", "las"])
        cloud = cloud_of_scan(shots)
        np.testing.assert_array_equal(cloud.theta, theta)
        assert cloud.shape is None
        header, found = read_pcd(tmp_path / "points.pcd")
        assert (header["WIDTH"], header["HEIGHT"]) == (str(len(time)), "1")
        np.testing.assert_array_equal(found["shot"], np.arange(len(time)))
        np.testing.assert_array_equal(found["time"], time)
        np.testing.assert_array_equal(laspy.read(tmp_path / "points.las").gps_time, time[image.valid.ravel()])

    @pytest.mark.parametrize("word", FORMAT_FILES)
    def test_a_run_without_a_range_still_writes_its_files(
        self, image: RangeImage, tmp_path: Path, word: str
    ) -> None:
        """As points.ply does; the verb refuses it, since it would write nothing else."""
        bare = {name: np.full_like(layer, np.nan) for name, layer in image.channels.items()}
        bare |= {name: np.ones_like(image[name]) for name in ("status", "tof.status")}
        bare |= {
            name: np.zeros_like(image[name]) for name in ("Y", "truth.object", "truth.material", "tof.echoes")
        }
        empty = replace(image, channels=bare)
        write_run(empty, tmp_path / "run", Output(pictures=False, formats=(word,)))
        assert all((tmp_path / "run" / name).stat().st_size for name in FORMAT_FILES[word])
        with pytest.raises(InputError, match="has no point"):
            convert(tmp_path / "run", tmp_path / "out", word)
        assert not (tmp_path / "out").exists()

    def test_ranges_that_another_rangefinder_has_are_told(self, tmp_path: Path) -> None:
        """Claim: where none is by the one that was asked for, or by triangulation where nobody asked, the message names
        it, and those that have some."""
        image = make_image("both")

        def without(*statuses: str) -> RangeImage:
            lost = {
                name: np.full_like(image[name], np.nan)
                for status in statuses
                for name in MEASURED_BY[status]
                if name in image
            }
            lost |= {status: np.ones_like(image[status]) for status in statuses}
            return replace(image, channels={**image.channels, **lost})

        for by, named, status, other in (
            ("", "triangulation", "status", "tof"),
            ("triangulation", "triangulation", "status", "tof"),
            ("tof", "tof", "tof.status", "triangulation"),
        ):
            with pytest.raises(InputError, match=f"no point by {named}") as fault:
                convert(without(status), tmp_path / "x.pcd", by=by)
            assert fault.value.remedy == f"Other ranges there are: --by {other}."
        with pytest.raises(InputError, match="no point: no shot has a range"):
            convert(without("status", "tof.status"), tmp_path / "x.pcd")
        assert not list(tmp_path.iterdir())

    @pytest.mark.parametrize(
        ("word", "near"), [("lax", "laz"), ("LAS", "las"), ("rosbag", "rosbag2"), ("xyz\x1b[31m", "")]
    )
    def test_an_unknown_format_is_answered_with_the_nearest(self, word: str, near: str) -> None:
        with pytest.raises(InputError, match="is no format") as fault:
            check_formats([word])
        assert "\x1b" not in fault.value.message
        assert re.search(rf"'{near}'", fault.value.remedy) if near else "Possible" in fault.value.remedy

    def test_a_missing_library_is_told_with_what_installs_it(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
        extras: Mapping[str, str] = {"laz": "las", "las": "las", "e57": "e57", "rosbag2": "ros"}
        needed = {"las": "laspy and lazrs, which are", "e57": "pye57, which is", "ros": "rosbags, which is"}
        for word, extra in extras.items():
            with pytest.raises(InputError, match=f"{word} needs {needed[extra]} not installed") as fault:
                check_formats([word])
            assert fault.value.remedy == f"pip install 'scanner-sim[{extra}]'"
        check_formats(["pcd", "pcd_ascii"])

    def test_a_result_without_its_points_is_refused(self, image: RangeImage, tmp_path: Path) -> None:
        with pytest.raises(InputError, match=r"no layer 'fused\.P\.X'") as fault:
            convert(image, tmp_path / "x.laz", by="fused")
        assert "ranging: both" in fault.value.remedy
        with pytest.raises(InputError, match=r"no layer 'P\.X'"):
            convert(image.keeping(["range_m"]), tmp_path / "x.laz")

    def test_without_a_scenario_there_is_no_time(self, image: RangeImage, tmp_path: Path) -> None:
        convert(replace(image, scenario_yaml="nothing: [of"), tmp_path, ["laz", "e57", "pcd", "rosbag2"])
        assert not laspy.read(tmp_path / "points.laz").gps_time.any()
        assert "time" not in read_pcd(tmp_path / "points.pcd")[0]["FIELDS"].split()


@pytest.mark.parametrize(("least", "scale"), [(1e-3, 1e-4), (9.9e-4, 1e-5), (2e-2, 1e-3), (1e-12, 1e-9)])
def test_coordinates_have_a_tenth_of_the_least_sigma_or_less(least: float, scale: float) -> None:
    """Claim: the largest power of ten that is no more than a tenth of it, itself where it is one, and a nanometre at
    least."""
    cloud: Any = SimpleNamespace(
        points=np.array([[0.0, 0.0, 1.0], [0.2, 0.1, 1.5]]),
        sigma=np.array([least, 1.0]),
        valid=np.ones(2, dtype=bool),
    )
    found, _, told = scale_of(cloud)
    assert (found, told) == (scale, least)


@pytest.mark.parametrize(
    ("low", "high", "sigma", "scale", "offset"),
    [
        # 1.5e6 m to either side of the middle: 1.5e9 steps of a millimetre, fewer than 2^31.
        ((1.5e6, -7.0, 20.2), (4.5e6, 4.0, 31.1), (0.014, 0.5), 1e-3, (3e6, -2.0, 26.0)),
        # 2.2e6 m are too many of them. Zero, infinite and unknown sigmas state nothing.
        ((-7.0, 1.5e6, 20.2), (4.0, 5.9e6, 31.1), (0.0, 0.014), 1e-2, (-2.0, 3.7e6, 26.0)),
        ((0.1, 0.2, 0.3), (0.7, 0.1, 7.2), (math.nan, math.inf), 1e-6, (0.0, 0.0, 4.0)),
        ((-0.9, 0.2, 0.3), (0.1, 0.1, 7.2), (8000.0, 900.0), 1.0, (0.0, 0.0, 4.0)),
    ],
    ids=["far, but narrow", "wide", "unstated", "coarse"],
)
def test_steps_are_counted_from_the_middle_of_what_was_measured(
    low: Any, high: Any, sigma: Any, scale: float, offset: Any
) -> None:
    """Claim: the offset is the middle in whole metres, and how far the cloud lies from the scanner takes no step away;
    a point without a range has no part in it, and neither has its sigma."""
    lost = [9e9, -9e9, 9e9]
    cloud: Any = SimpleNamespace(
        points=np.array([high, lost, low]),
        sigma=np.array([sigma[0], 1e-12, sigma[1]]),
        valid=np.array([True, False, True]),
    )
    found, about, least = scale_of(cloud)
    stated = [one for one in sigma if 0.0 < one < math.inf]
    assert found == scale
    np.testing.assert_array_equal(about, np.array(offset))
    assert not np.signbit(about[about == 0.0]).any()
    np.testing.assert_equal(least, min(stated, default=math.nan))
