"""Waveforms in files and in pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.status import Status
from scanner_sim.products.grey import range_levels
from scanner_sim.products.pictures.waveform import draw_waveform
from scanner_sim.products.waveforms import WaveformSet, read_waveforms, write_waveforms


def waveforms(largest: float = 5000.0, fraction: float = 0.0) -> WaveformSet:
    random = np.random.default_rng(1)
    line = np.arange(256)
    number = np.rint(
        largest * np.exp(-0.5 * ((line - 90.3) / 1.1) ** 2) + 2.0 * random.standard_normal((3, 256))
    )
    return WaveformSet(
        row=np.array([0, 0, 7], np.int32),
        column=np.array([3, 4, 5], np.int32),
        number=(number + fraction).astype(np.float32),
        start=-8.66e-9,
        rate=1e9,
        step=3.2e-8,
        delay=np.array([81.64e-9, 81.63e-9, np.nan]),
        sigma=np.array([20e-12, 21e-12, np.nan]),
        echoes=np.array([1, 1, 0], np.uint32),
        status=np.array([0, 0, Status.BELOW_THRESHOLD], np.uint32),
    )


@pytest.mark.parametrize(("largest", "fraction"), [(5000.0, 0.0), (1e6, 0.0), (5000.0, 0.25)])
def test_what_is_written_is_read_back(tmp_path: Path, largest: float, fraction: float) -> None:
    written = waveforms(largest, fraction)
    write_waveforms(tmp_path / "w.nc", written)
    read = read_waveforms(tmp_path / "w.nc")
    for name in WaveformSet.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(read, name), getattr(written, name))


def test_the_file_is_compact_standard_and_the_same_each_time(tmp_path: Path) -> None:
    """14 bits take two bytes a sample; xarray finds names and units; equal records give equal bytes."""
    for name in ("a.nc", "b.nc"):
        write_waveforms(tmp_path / name, waveforms())
    assert (tmp_path / "a.nc").read_bytes() == (tmp_path / "b.nc").read_bytes()
    data = xarray.load_dataset(tmp_path / "a.nc", engine="scipy")
    assert data["number"].dtype == np.int16
    assert data["number"].dims == ("voxel", "sample")
    assert data["time"].attrs["units"] == "s"
    assert float(data["time"][1] - data["time"][0]) == pytest.approx(1e-9)


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text.nc").write_text("no NetCDF")
    with pytest.raises(InputError, match="NetCDF"):
        read_waveforms(tmp_path / "text.nc")
    xarray.Dataset({"a": ("x", [1.0])}).to_netcdf(tmp_path / "other.nc", engine="scipy")
    with pytest.raises(InputError, match="no waveforms"):
        read_waveforms(tmp_path / "other.nc")


def test_near_is_bright_and_nothing_is_black() -> None:
    levels = range_levels(np.array([[1.0, 2.0, 3.0, 9.0, np.nan]]), 1.0, 3.0)
    assert levels.tolist() == [[255, 148, 40, 40, 0]]


def test_a_waveform_is_drawn_with_and_without_an_echo(tmp_path: Path) -> None:
    for number in (0, 2):
        draw_waveform(tmp_path / f"{number}.png", waveforms(), number)
        assert (tmp_path / f"{number}.png").stat().st_size > 5000
