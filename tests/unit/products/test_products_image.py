"""Range image, its table of channels, and its forms as EXR, PLY, xarray and summary."""

from __future__ import annotations

import errno
import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scanner_sim.foundation.channels import CHANNELS, MEASURED_BY
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.status import Status
from scanner_sim.products.files.exr import read_range_image, write_exr
from scanner_sim.products.image import RangeImage
from scanner_sim.products.points import write_ply
from scanner_sim.products.summary import summary, summary_json

MEASURED = [name for name in MEASURED_BY["status"] if name in {channel.name for channel in CHANNELS}]
"""Layers without a prefix, but derivatives, which go by the same table."""


def make_image(rows: int = 5, columns: int = 7, seed: int = 3) -> RangeImage:
    """A small image with every status, and numbers that float32 does not round to short texts."""
    random = np.random.default_rng(seed)
    status = (np.arange(rows * columns) % 11).reshape(rows, columns)
    status[status > max(Status)] = 0
    layers = {channel.name: random.normal(9.0, 1.0, (rows, columns)) for channel in CHANNELS}
    layers["sigma_range_m"] = random.uniform(1e-3, 2e-3, (rows, columns))
    layers["range_m"] = layers["truth.range_m"] + layers["sigma_range_m"] * random.normal(
        size=(rows, columns)
    )
    for name in MEASURED_BY:
        layers[name] = status
    layers["Y"] = np.where(status == Status.BELOW_THRESHOLD, 0.0, 1e6 * layers["Y"])
    layers["truth.object"] = random.integers(0, 3, (rows, columns))
    layers["truth.material"] = random.integers(0, 2, (rows, columns))
    for names in MEASURED_BY.values():
        for name in layers.keys() & set(names):
            layers[name] = np.where(status == 0, layers[name], np.nan)
    return RangeImage(
        channels={name: layer.astype(np.float32) for name, layer in layers.items()},
        theta=np.linspace(-0.2, 0.3, columns),
        phi=np.linspace(-0.1, 0.1, rows),
        objects=("node", "handrail 2"),
        materials=("beta cloth",),
        seed=2**63 - 1,
        scenario_yaml="schema: 1\nscanner:\n  preset: nrc_2000\n# µm\n",
        warnings=("a warning\nof two lines, with Θ",),
        made_by={"scanner-sim": "0.0.9", "mitsuba": "3.9.1"},
    )


def with_layer(image: RangeImage, name: str, layer: np.ndarray) -> RangeImage:
    return replace(image, channels={**image.channels, name: layer})


def assert_same(one: RangeImage, other: RangeImage) -> None:
    assert list(one.channels) == list(other.channels)
    for name in one.channels:
        np.testing.assert_array_equal(one[name], other[name], strict=True)
    np.testing.assert_array_equal(one.theta, other.theta, strict=True)
    np.testing.assert_array_equal(one.phi, other.phi, strict=True)
    for name in ("objects", "materials", "seed", "scenario_yaml", "warnings", "made_by"):
        assert getattr(one, name) == getattr(other, name), name


class TestImage:
    def test_its_text_tells_the_ends_and_the_median_in_their_units(self) -> None:
        """Claim: nearest and farthest valid range in m, and the middle of their σ, from 1 to 2 mm, in mm."""
        image = make_image()
        valid = image["status"] == 0
        near, far = np.sort(image["range_m"][valid])[[0, -1]]
        sigma = np.sort(image["sigma_range_m"][valid])
        middle = 0.5 * (sigma[(len(sigma) - 1) // 2] + sigma[len(sigma) // 2])
        assert f", from {near:.4g} m to {far:.4g} m, median σ {middle / 1e-3:.3g} mm" in repr(image)
        spans = "Θ -11.46° to 17.19°, φ -5.73° to 5.73°"
        assert repr(image).startswith(f"RangeImage of 5 rows × 7 columns, {spans}, seed")

    def test_layers_cannot_be_written_to_and_are_not_copies(self) -> None:
        own = {name: np.array(layer) for name, layer in make_image().channels.items()}
        image = replace(make_image(), channels=own)
        with pytest.raises(ValueError, match="read-only"):
            image["range_m"][0, 0] = 1.0
        assert np.shares_memory(image["range_m"], own["range_m"])

    def test_an_unknown_name_is_answered_with_the_known_ones(self) -> None:
        with pytest.raises(KeyError, match=r"no channel 'range'.*range_m"):
            make_image()["range"]

    def test_only_status_is_compulsory(self) -> None:
        image = make_image()
        assert "range_m" not in replace(image, channels={"status": image["status"]})
        with pytest.raises(ValueError, match="needs the channel status"):
            replace(image, channels={"range_m": image["range_m"]})

    @pytest.mark.parametrize("name", MEASURED)
    def test_a_number_without_a_measurement_is_refused(self, name: str) -> None:
        image = make_image()
        with pytest.raises(ValueError, match="NaN wherever status"):
            with_layer(image, name, np.nan_to_num(image[name]))

    def test_a_measurement_without_a_number_is_refused(self) -> None:
        image = make_image()
        with pytest.raises(ValueError, match="finite"):
            with_layer(image, "range_m", np.full_like(image["range_m"], np.nan))

    @pytest.mark.parametrize(
        ("name", "number"), [("status", max(Status) + 1), ("truth.object", 3), ("status", 0.5)]
    )
    def test_a_number_outside_its_legend_is_refused(self, name: str, number: float) -> None:
        image = make_image()
        with pytest.raises(ValueError, match="whole numbers from 0"):
            with_layer(image, name, np.full_like(image[name], number))

    @pytest.mark.parametrize(
        "layer", [np.zeros((5, 7)), np.zeros((7, 5), np.float32)], ids=["float64", "transposed"]
    )
    def test_type_and_shape_are_checked(self, layer: np.ndarray) -> None:
        with pytest.raises(ValueError, match=r"Y must be float32 of shape \(5, 7\)"):
            with_layer(make_image(), "Y", layer)

    def test_channels_of_other_names_are_refused(self) -> None:
        with pytest.raises(ValueError, match="unknown channels: depth"):
            with_layer(make_image(), "depth", make_image()["Y"])

    @pytest.mark.parametrize("theta", [np.linspace(0.3, -0.2, 7), np.geomspace(0.1, 0.3, 7), np.zeros(7)])
    def test_angles_ascend_evenly(self, theta: np.ndarray) -> None:
        with pytest.raises(ValueError, match="theta must ascend in even steps"):
            replace(make_image(), theta=theta)

    def test_angles_are_even_to_a_millionth_of_a_step(self) -> None:
        image = make_image()
        step = image.theta[1] - image.theta[0]
        for share, refused in ((0.9e-6, False), (1.1e-6, True)):
            theta = image.theta.copy()
            theta[2] += share * step
            if refused:
                with pytest.raises(ValueError, match="even steps"):
                    replace(image, theta=theta)
            else:
                replace(image, theta=theta)

    @pytest.mark.parametrize("name", ["range_m", "P.X", "P.Y", "P.Z", "tof.range_m"])
    def test_a_valid_voxel_has_a_finite_place(self, name: str) -> None:
        image = make_image()
        status = next(layer for layer, names in MEASURED_BY.items() if name in names)
        layer = image[name].copy()
        layer[tuple(np.argwhere(image[status] == 0)[0])] = np.inf
        with pytest.raises(ValueError, match=f"^{name} must be a finite number"):
            with_layer(image, name, layer)

    def test_no_number_stands_where_nothing_was_measured(self) -> None:
        """Claim: place, peak and both of their errors are NaN without a measurement; truth and status are not."""
        image = make_image()
        blank = {name for name in image.channels if np.isnan(image[name][image["status"] != 0]).all()}
        assert {"peak_px", "sigma_peak_px", "sigma_texture_m", "sigma_range_m", "P.X"} <= blank
        assert not blank & {"Y", "snr_detection", "status", "truth.range_m", "truth.object"}

    def test_points_are_those_of_the_valid_voxels_row_by_row(self) -> None:
        image = make_image()
        points = image.points()
        assert points.shape == (np.count_nonzero(image.valid), 3)
        row, column = np.argwhere(image.valid)[3]
        assert points[3].tolist() == [image[f"P.{axis}"][row, column] for axis in "XYZ"]

    def test_what_is_kept_keeps_the_codes_by_which_it_is_read(self) -> None:
        """Claim: layers by time of flight keep their own status, and others do not."""
        image = make_image()
        every = replace(
            image,
            channels={
                **image.channels,
                "tof.range_m": image["range_m"],
                "tof.status": image["status"],
            },
        )
        assert set(every.keeping(["tof.range_m"]).channels) == {"status", "tof.range_m", "tof.status"}
        assert set(every.keeping(["range_m"]).channels) == {"status", "range_m"}

    def test_repr_tells_what_it_is(self) -> None:
        text = repr(make_image())
        assert "5 rows × 7 columns" in text
        assert "% have a range" in text
        assert "warning: a warning" in text

    def test_xarray_has_units_legends_and_the_same_numbers(self, tmp_path: Path) -> None:
        image = make_image()
        data = image.to_xarray()
        np.testing.assert_array_equal(data["range_m"].values, image["range_m"])
        assert {name: data[name].attrs["units"] for name in image.channels} == {
            c.name: c.unit for c in CHANNELS
        }
        assert data["phi"].attrs["units"] == data["theta"].attrs["units"] == "rad"
        flags = data["status"].attrs
        assert dict(zip(flags["flag_meanings"].split(), flags["flag_values"], strict=True)) == {
            status.name: int(status) for status in Status
        }
        assert data["truth.object"].attrs["flag_meanings"] == "nothing node handrail_2"
        assert data.attrs["scenario"] == image.scenario_yaml
        assert data.attrs["seed"] == str(image.seed)
        for status in Status:
            assert f"{status.name}: {status.sentence}" in data["status"].attrs["comment"]
        data.to_netcdf(tmp_path / "image.nc")

    def test_xarray_finds_a_voxel_by_its_angles(self) -> None:
        """Claim: the first row is the uppermost, at the least φ; the last column the rightmost, at the largest Θ."""
        image = make_image()
        layer = image.to_xarray()["truth.range_m"]
        assert layer.dims == ("phi", "theta")
        for name, way in (("phi", "downwards"), ("theta", "to the right")):
            assert way in layer[name].attrs["long_name"]
        for row, phi in ((0, -0.1), (3, 0.05), (4, 0.1)):
            for column, theta in ((0, -0.2), (6, 0.3)):
                found = layer.sel(phi=phi, theta=theta, method="nearest")
                assert float(found) == image["truth.range_m"][row, column]


class TestExr:
    @pytest.mark.parametrize("compression", ["none", "rle", "zips", "zip", "piz"])
    def test_everything_comes_back(self, tmp_path: Path, compression: str) -> None:
        image = make_image()
        write_exr(tmp_path / "range.exr", image, compression)  # type: ignore[arg-type]
        assert_same(read_range_image(tmp_path / "range.exr"), image)

    @pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 9), (9, 1), (40, 3)])
    def test_any_shape_comes_back(self, tmp_path: Path, rows: int, columns: int) -> None:
        image = make_image(rows, columns)
        image = replace(image, theta=image.theta if columns > 1 else np.array([0.1]))
        write_exr(tmp_path / "range.exr", image)
        assert_same(read_range_image(tmp_path / "range.exr"), image)

    def test_an_image_without_names_and_few_channels_comes_back(self, tmp_path: Path) -> None:
        image = replace(
            make_image(), channels={"status": make_image()["status"]}, objects=(), materials=(), warnings=()
        )
        write_exr(tmp_path / "range.exr", image)
        assert_same(read_range_image(tmp_path / "range.exr"), image)

    def test_the_same_image_gives_the_same_bytes_for_any_number_of_threads(self, tmp_path: Path) -> None:
        import OpenEXR

        image, contents = make_image(200, 300), set()
        before = OpenEXR.global_thread_count()
        for threads in (1, 2, 3):
            OpenEXR.set_global_thread_count(threads)
            write_exr(tmp_path / "range.exr", image)
            contents.add((tmp_path / "range.exr").read_bytes())
        OpenEXR.set_global_thread_count(before)
        assert len(contents) == 1

    def test_the_header_explains_every_channel_and_number(self, tmp_path: Path) -> None:
        import OpenEXR

        image = make_image()
        write_exr(tmp_path / "range.exr", image)
        header = OpenEXR.File(str(tmp_path / "range.exr"), header_only=True).header()
        for name, channel in ((channel.name, channel) for channel in CHANNELS):
            assert (header[f"unit.{name}"], header[f"meaning.{name}"]) == (channel.unit, channel.meaning)
        assert header["legend.status"].splitlines()[3].startswith("3 AMBIGUOUS: ")
        assert header["legend.truth.object"].splitlines() == ["0 nothing", "1 node", "2 handrail 2"]
        assert header["scannerSim.scenario"] == image.scenario_yaml
        assert header["scannerSim.seed"] == str(2**63 - 1)
        assert header["lineOrder"] == OpenEXR.INCREASING_Y
        assert header["type"] == OpenEXR.scanlineimage
        assert max(map(len, header)) <= 31  # longer names make a file that old readers refuse

    def test_a_channel_of_a_later_version_is_left_out_with_a_warning(self, tmp_path: Path) -> None:
        import OpenEXR

        image = make_image()
        write_exr(tmp_path / "range.exr", image)
        file = OpenEXR.File(str(tmp_path / "range.exr"), separate_channels=True)
        layers = {name: channel.pixels for name, channel in file.channels().items()}
        OpenEXR.File(file.header(), {**layers, "velocity": layers["Y"]}).write(str(tmp_path / "later.exr"))
        found = read_range_image(tmp_path / "later.exr")
        assert "velocity" in found.warnings[-1]
        assert_same(replace(found, warnings=image.warnings), image)

    @pytest.mark.parametrize("kept", [0, 3, 4, 200, 1500, -40, -1])
    def test_a_cut_file_is_one_sentence_and_no_noise(
        self, tmp_path: Path, kept: int, capfd: pytest.CaptureFixture[str]
    ) -> None:
        write_exr(tmp_path / "whole.exr", make_image())
        (tmp_path / "range.exr").write_bytes((tmp_path / "whole.exr").read_bytes()[:kept])
        with pytest.raises(
            InputError, match=r"range\.exr is (not an|a broken or incomplete) OpenEXR"
        ) as error:
            read_range_image(tmp_path / "range.exr")
        assert error.value.remedy
        assert capfd.readouterr() == ("", "")

    def test_missing_files_folders_and_foreign_files_are_input_errors(self, tmp_path: Path) -> None:
        import OpenEXR

        (tmp_path / "text.exr").write_text("schema: 1\n")
        header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
        OpenEXR.File(header, {"Y": make_image()["Y"].copy()}).write(str(tmp_path / "foreign.exr"))
        for name, words in {
            "none.exr": "cannot be opened: No such file",
            ".": "not an ordinary file",
            "text.exr": "is not an OpenEXR file",
            "foreign.exr": "no range image of this program",
        }.items():
            with pytest.raises(InputError, match=words) as error:
                read_range_image(tmp_path / name)
            assert error.value.remedy

    def test_a_header_at_odds_with_the_image_is_an_input_error(self, tmp_path: Path) -> None:
        import OpenEXR

        write_exr(tmp_path / "range.exr", make_image())
        file = OpenEXR.File(str(tmp_path / "range.exr"), separate_channels=True)
        layers = {name: channel.pixels for name, channel in file.channels().items()}
        for key, wrong in {
            "scannerSim.theta": np.array([0.3, -0.2]),
            "scannerSim.warnings": "not JSON",
            "scannerSim.seed": "many",
            "legend.truth.object": "0 nothing",
        }.items():
            OpenEXR.File({**file.header(), key: wrong}, layers).write(str(tmp_path / "odd.exr"))
            with pytest.raises(InputError, match=r"The header of .*odd\.exr is damaged"):
                read_range_image(tmp_path / "odd.exr")

    @pytest.mark.parametrize(
        "gone",
        [
            "scannerSim.theta", "scannerSim.phi", "scannerSim.warnings", "scannerSim.scenario",
            "legend.truth.object", "legend.truth.material", "status",
        ],
    )  # fmt: skip
    def test_a_file_that_lacks_something_of_ours_is_an_input_error(self, tmp_path: Path, gone: str) -> None:
        """Claim: an attribute or the layer of statuses that another program dropped is told, with a remedy."""
        import OpenEXR

        write_exr(tmp_path / "range.exr", make_image())
        file = OpenEXR.File(str(tmp_path / "range.exr"), separate_channels=True)
        header = {name: value for name, value in file.header().items() if name != gone}
        layers = {name: channel.pixels for name, channel in file.channels().items() if name != gone}
        assert len(header) + len(layers) == len(file.header()) + len(file.channels()) - 1
        OpenEXR.File(header, layers).write(str(tmp_path / "odd.exr"))
        with pytest.raises(InputError, match=rf"The header of .*odd\.exr is damaged.*{gone}") as error:
            read_range_image(tmp_path / "odd.exr")
        assert error.value.remedy

    @pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
    def test_a_full_disk_is_the_systems_own_error(self) -> None:
        for write in (write_exr, write_ply):
            with pytest.raises(OSError, match="No space") as error:
                write(Path("/dev/full"), make_image(100, 100))
            assert error.value.errno == errno.ENOSPC


class TestPoints:
    def test_an_independent_reading_finds_the_same_numbers(self, tmp_path: Path) -> None:
        image = make_image()
        write_ply(tmp_path / "points.ply", image)
        head, _, body = (tmp_path / "points.ply").read_bytes().partition(b"end_header\n")
        lines = head.decode().splitlines()
        assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
        names = [line.split()[2] for line in lines if line.startswith("property")]
        form = "<" + "".join(
            {"float": "f", "int": "i"}[line.split()[1]] for line in lines if "property" in line
        )
        vertices = [dict(zip(names, values, strict=True)) for values in struct.iter_unpack(form, body)]
        assert f"element vertex {len(vertices)}" in lines
        assert len(vertices) == np.count_nonzero(image.valid)
        pairs = {
            "x": "P.X", "y": "P.Y", "z": "P.Z", "intensity": "Y", "sigma_range_m": "sigma_range_m",
            "sigma_texture_m": "sigma_texture_m",
            "truth_object": "truth.object", "truth_material": "truth.material",
            "nx": "truth.normal.X", "ny": "truth.normal.Y", "nz": "truth.normal.Z",
        }  # fmt: skip
        assert set(names) == {*pairs, "row", "column"}
        for vertex in vertices:
            for name, channel in pairs.items():
                assert vertex[name] == image[channel][vertex["row"], vertex["column"]]

    def test_no_return_gives_a_file_without_points(self, tmp_path: Path) -> None:
        nothing = {name: np.full((5, 7), np.nan, np.float32) for name in MEASURED}
        image = replace(make_image(), channels={**nothing, "status": np.ones((5, 7), np.float32)})
        write_ply(tmp_path / "points.ply", image)
        assert b"element vertex 0\n" in (tmp_path / "points.ply").read_bytes()


class TestSummary:
    def test_counts_quantiles_and_truth(self) -> None:
        image = make_image(60, 70)
        found = summary(image)
        assert sum(entry["voxels"] for entry in found["status"]) == image["status"].size
        assert found["status"][2]["voxels"] == np.count_nonzero(image["status"] == Status.SATURATED)
        assert found["valid_share"] == pytest.approx(image.valid.mean())
        ranges = image["range_m"][image.valid].astype(float)
        assert found["range_m"]["median"] == pytest.approx(np.median(ranges))
        error = ranges - image["truth.range_m"][image.valid]
        assert found["truth"]["error_m"]["rms"] == pytest.approx(np.sqrt(np.mean(error**2)))
        pulls = error / image["sigma_range_m"][image.valid]
        assert found["truth"]["error_over_sigma"]["rms"] == pytest.approx(np.sqrt(np.mean(pulls**2)))
        assert found["truth"]["error_over_sigma"]["95%"] == pytest.approx(np.quantile(pulls, 0.95))
        # Beyond to both sides: here ranges that are all too short.
        told = summary(
            replace(image, channels={**image.channels, "range_m": image["range_m"] - np.float32(0.4)})
        )
        moved = (ranges.astype(np.float32) - np.float32(0.4)).astype(float) - image["truth.range_m"][
            image.valid
        ]
        away = np.abs(moved / image["sigma_range_m"][image.valid])
        for sigmas, share in told["truth"]["share_beyond"].items():
            assert share == pytest.approx(np.mean(away > float(sigmas.split()[0]))), sigmas
        assert max(told["truth"]["share_beyond"].values()) > 0.5
        assert found["truth"]["voxels_compared"] == image.valid.sum()
        assert found["truth"]["voxels_without_truth"] == 0
        hits = {entry["name"]: entry["voxels"] for entry in found["truth"]["voxels_by_object"]}
        assert hits["handrail 2"] == np.count_nonzero(image["truth.object"] == 2)

    def test_ranges_beside_the_axis_are_counted(self) -> None:
        """Claim: a range whose beam's axis meets nothing has no truth, and is told apart from those compared."""
        image = make_image()
        row, column = np.argwhere(image.valid)[0]
        truth = image["truth.range_m"].copy()
        truth[row, column] = np.nan
        found = summary(replace(image, channels={**image.channels, "truth.range_m": truth}))["truth"]
        assert found["voxels_without_truth"] == 1
        assert found["voxels_compared"] == image.valid.sum() - 1

    def test_truth_stays_in_its_section(self) -> None:
        """Claim: without the truth layers everything outside of the section ``truth`` is the same."""
        image = make_image()
        blind = replace(
            image, channels={n: a for n, a in image.channels.items() if not n.startswith("truth.")}
        )
        seen, unseen = summary(image), summary(blind)
        assert unseen.pop("truth") == {}
        seen.pop("truth")
        for found in (seen, unseen):
            found.pop("channels")
        assert seen == unseen

    def test_it_is_valid_json_also_when_nothing_returns(self) -> None:
        nothing = {name: np.full((5, 7), np.nan, np.float32) for name in (*MEASURED, "truth.range_m")}
        image = replace(make_image(), channels={**nothing, "status": np.ones((5, 7), np.float32)})
        found = json.loads(summary_json(image))
        assert found["range_m"]["median"] is None
        assert found["truth"]["error_m"]["rms"] is None
        assert found["warnings"] == list(image.warnings)


@given(
    first=st.floats(-0.5, 0.4), width=st.floats(1e-6, 0.5), count=st.integers(2, 2000)
)  # fmt: skip
def test_angles_survive_their_two_ends(first: float, width: float, count: int) -> None:
    """Claim: the two ends in a header give back the angles of a raster bit by bit.

    Set-up: any raster, whose angles are ``linspace`` of its ends. Expected: ``linspace`` of the first and the last
    angle is the same array. Tolerance: none, or running the scenario again would not give the same bytes.
    """
    theta = np.linspace(first, first + width, count)
    np.testing.assert_array_equal(np.linspace(theta[0], theta[-1], count), theta, strict=True)
