"""Lines and waveforms in files and in pictures."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
from numpy.typing import NDArray

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.status import Status
from scanner_sim.products.files import signal_files
from scanner_sim.products.files.signal_files import read_columns, read_signals, write_signals
from scanner_sim.products.grey import range_levels
from scanner_sim.products.lines import LineSet
from scanner_sim.products.pictures.waveform import draw_waveform
from scanner_sim.products.signal_set import (
    CLUSTERS,
    SignalAbout,
    SignalSet,
    checked_columns,
    number_kind,
)
from scanner_sim.products.waveforms import WaveformSet

NUMBERS = {
    LineSet: {
        **{
            "pitch_m": 50e-6,
            "offset_m": 1e-3,
            "bias": 64.0,
            "electrons_per_number": 700.0,
            "dark_electron": 1000.0,
        },
        **{"off_scale": 0.0, "electrons_per_watt": 3e14, "stray_light": 0.0},
    },
    WaveformSet: {"start_s": -8e-9, "rate_hz": 1e9, "step_a": 3e-8},
}


def made(kind: type[SignalSet], rows: int = 5, samples: int = 16, **other: NDArray[Any]) -> Any:
    """Return a set whose columns are all different, without those that not every set has."""
    random = np.random.default_rng(1)
    clusters = random.integers(1, 4, rows).astype(np.int32)
    columns: dict[str, NDArray[Any]] = {}
    for column in kind.COLUMNS:
        if not column.wanted:
            continue
        shape: Any = {"one": rows, "vector": (rows, 3), "samples": (rows, samples)}.get(
            column.form, int(clusters.sum())
        )
        sort = "u2" if column.kind == "number" else column.kind
        columns[column.name] = (100.0 * random.random(shape)).astype(sort)
    columns |= {CLUSTERS: clusters, "status": np.zeros(rows, np.int32)}
    columns |= {"row": np.arange(rows, dtype=np.int32)} | other
    about = SignalAbout(kind.FORM, "schema: 1\n", ("wall",), ("grey",), NUMBERS[kind], {"numpy": "2"})
    return kind(columns, about)


def equal(one: SignalSet, other: SignalSet) -> bool:
    same = [one[name].dtype == other[name].dtype and np.array_equal(one[name], other[name]) for name in one]
    return list(one) == list(other) and one.about == other.about and all(same)


@pytest.mark.parametrize("kind", [LineSet, WaveformSet])
def test_what_is_written_is_read_back(kind: type[SignalSet], tmp_path: Path) -> None:
    """Claim: every column comes back to the last bit, and the same set gives the same bytes, in one part or in two."""
    whole = made(kind, 5000)
    write_signals(tmp_path / "a", [whole])
    write_signals(tmp_path / "b", [made(kind, 5000)])
    assert equal(read_signals(tmp_path / "a", kind), whole)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    parts = list(read_columns(tmp_path / "a", kind, ["row", "clusters"], 4096))
    assert [len(part["row"]) for part in parts] == [4096, 904]
    np.testing.assert_array_equal(np.concatenate([part["row"] for part in parts]), whole.row)


def test_other_programs_find_units_and_shapes(tmp_path: Path) -> None:
    """Claim: Arrow's own reader tells unit and meaning of each column, and that a line is a list of fixed length."""
    lines = made(LineSet, number_off=np.ones((5, 16), np.uint16))
    write_signals(tmp_path / "lines.parquet", [lines])
    table = pyarrow.parquet.read_table(tmp_path / "lines.parquet")
    assert table.schema.field("laser_w").metadata[b"unit"] == b"W"
    assert table.schema.field("number").type == pyarrow.list_(pyarrow.uint16(), 16)
    np.testing.assert_array_equal(np.stack(table["number"].to_numpy()), lines.number)
    data = lines.to_xarray()
    assert data["laser_w"].dims == ("voxel", "pixel")
    assert float(data["position"][1]) == pytest.approx(1e-3 + 1.5 * 50e-6)
    assert data["position"].attrs["units"] == "m"
    assert data["cluster_w"].sizes["cluster"] == data["clusters"].sum()


@pytest.mark.parametrize("kind", [LineSet, WaveformSet])
def test_columns_in_xarray_say_what_the_file_says(kind: type[SignalSet], tmp_path: Path) -> None:
    """Claim: units and meanings are those of the file; codes have their values and as many names (CF conventions, sec.
    3.5), of the type of the column; what counts clusters names the dimension that it counts (sec. 9.3.3)."""
    one = made(kind)
    write_signals(tmp_path / "a", [one])
    told, data = pyarrow.parquet.read_schema(tmp_path / "a"), one.to_xarray()
    for name in one:
        said = told.field(name).metadata
        assert data[name].attrs["units"].encode() == said[b"unit"], name
        assert data[name].attrs["long_name"].encode() == said[b"meaning"], name
    objects, materials = list(one.about.objects), list(one.about.materials)
    named = {"status": [code.name for code in sorted(Status)]}
    named |= {"truth.object": ["nothing", *objects], "truth.material": ["nothing", *materials]}
    assert {name for name in one if {"flag_values", "flag_meanings"} & {*data[name].attrs}} == {*named}
    for name, words in named.items():
        values = data[name].attrs["flag_values"]
        assert values.dtype == data[name].dtype
        said = dict(zip(values.tolist(), data[name].attrs["flag_meanings"].split(), strict=True))
        assert said == {number: word.replace(" ", "_") for number, word in enumerate(words) if word}
    counted = [name for name in one if "sample_dimension" in data[name].attrs]
    assert counted == [CLUSTERS]
    assert data[CLUSTERS].attrs["sample_dimension"] == "cluster"


def test_charges_are_those_of_the_digital_numbers() -> None:
    """Claim: (number − bias) gain − dark, less (number − bias) gain k − dark of the exposure without the laser."""
    one = made(LineSet)
    np.testing.assert_allclose(one.charge, (one.number.astype(float) - 64.0) * 700.0 - 1000.0)
    np.testing.assert_allclose(one.expected, one["laser_w"].astype(float) * 3e14)
    lit = made(LineSet, background_w=np.full((5, 16), 2.0, np.float32))
    np.testing.assert_allclose(lit.expected, (lit["laser_w"].astype(float) + 2.0) * 3e14)
    off = np.full((5, 16), 100, np.uint16)
    two = made(LineSet, number_off=off, background_w=lit["background_w"])
    two = LineSet(dict(two), replace(two.about, numbers={**NUMBERS[LineSet], "off_scale": 1.5}))
    left = (two.number.astype(float) - 64.0) * 700.0 - 1000.0 - ((100.0 - 64.0) * 700.0 * 1.5 - 1000.0)
    np.testing.assert_allclose(two.charge, left)
    np.testing.assert_allclose(two.expected, two["laser_w"].astype(float) * 3e14)


@pytest.mark.parametrize("off", [False, True])
def test_stray_light_lies_evenly_over_a_line(off: bool) -> None:
    """Claim: a fifth of the laser's light in the field of each voxel, and of the background, is shared out to the 16
    pixels; of the background nothing is left where an exposure without the laser is subtracted."""
    around = np.arange(80.0, dtype=np.float32).reshape(5, 16)
    more = {"number_off": np.full((5, 16), 100, np.uint16)} if off else {}
    one = made(LineSet, background_w=around, **more)
    one = LineSet(dict(one), replace(one.about, numbers=NUMBERS[LineSet] | {"stray_light": 0.2}))
    beneath = 0.0 * around if off else around
    for row, field in enumerate(one["laser_field_w"].astype(float)):
        whole = field + beneath[row].sum()
        wanted = 0.8 * (one["laser_w"][row].astype(float) + beneath[row]) + 0.2 * whole / 16.0
        np.testing.assert_allclose(one.expected[row], wanted * 3e14, rtol=1e-12)


@pytest.mark.parametrize(
    ("whole", "least", "largest", "kind"),
    [
        (True, 0, 65535, "u2"),
        (True, 0, 65536, "i4"),
        (True, -1, 999, "i2"),
        (False, 0, 9, "f4"),
        (True, 0, 2**40, "f4"),
    ],
)
def test_digital_numbers_take_the_room_that_they_need(
    whole: bool, least: int, largest: int, kind: str
) -> None:
    assert number_kind(whole, least, largest) == kind


def test_samples_have_times() -> None:
    """Claim: sample k is taken k/rate after the first, which comes at ``start_s``."""
    time = made(WaveformSet).time
    assert len(time) == 16
    np.testing.assert_allclose(time[[0, 3]], [-8e-9, -5e-9])


SPOILT: dict[str, Callable[[dict[str, NDArray[Any]]], dict[str, NDArray[Any]]]] = {
    "missing": lambda columns: {name: columns[name] for name in columns if name != "laser_w"},
    "float64": lambda columns: columns | {"laser_w": columns["laser_w"].astype(float)},
    "(5, 15)": lambda columns: columns | {"laser_w": columns["laser_w"][:, :15]},
    "codes": lambda columns: columns | {"status": np.full(5, -1, np.int32)},
    "cluster_w": lambda columns: columns | {"cluster_w": columns["cluster_w"][1:]},
}


@pytest.mark.parametrize("word", SPOILT)
def test_columns_that_contradict_one_another_are_refused(word: str) -> None:
    lines = made(LineSet)
    with pytest.raises(ValueError, match=word.replace("(", r"\(").replace(")", r"\)")):
        LineSet(SPOILT[word](dict(lines)), lines.about)


@pytest.mark.parametrize("kind", [LineSet, WaveformSet])
@pytest.mark.parametrize("row", [0, 3])
def test_one_code_that_there_is_not_is_refused(kind: type[SignalSet], row: int) -> None:
    """Claim: of five voxels one whose status is no code is enough, whichever it is."""
    columns = dict(made(kind).columns)
    columns["status"] = columns["status"].copy()
    assert checked_columns(kind.COLUMNS, columns).keys() == columns.keys()
    columns["status"][row] = max(Status) + 1
    with pytest.raises(ValueError, match="status has codes that there are not"):
        checked_columns(kind.COLUMNS, columns)


def test_other_files_are_refused(tmp_path: Path) -> None:
    """Claim: no Parquet, another program's, the other kind, another version and a part of a file: a message each."""
    path = tmp_path / "lines.parquet"
    path.write_text("no table")
    with pytest.raises(InputError, match="damaged"):
        read_signals(path, LineSet)
    pyarrow.parquet.write_table(pyarrow.table({"row": [1]}), path)
    with pytest.raises(InputError, match="not written by this program"):
        read_signals(path, LineSet)
    write_signals(path, [made(WaveformSet)])
    with pytest.raises(InputError, match="holds no lines"):
        read_signals(path, LineSet)
    lines = made(LineSet)
    write_signals(path, [LineSet(dict(lines), replace(lines.about, form="scanner-sim lines, 9"))])
    with pytest.raises(InputError, match="version 9"):
        read_signals(path, LineSet)
    write_signals(path, [lines])
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(InputError, match="damaged"):
        read_signals(path, LineSet)
    with pytest.raises(InputError, match="cannot be opened"):
        read_signals(tmp_path / "none", LineSet)


def test_near_is_bright_and_nothing_is_black() -> None:
    levels = range_levels(np.array([[1.0, 2.0, 3.0, 9.0, np.nan]]), 1.0, 3.0)
    assert levels.tolist() == [[255, 148, 40, 40, 0]]


@pytest.mark.parametrize("delay", [81.6e-9, np.nan])
def test_a_waveform_is_drawn_with_and_without_an_echo(delay: float, tmp_path: Path) -> None:
    status = np.full(5, 0 if np.isfinite(delay) else Status.BELOW_THRESHOLD, np.int32)
    draw_waveform(tmp_path / "w.png", made(WaveformSet, 5, 256, delay_s=np.full(5, delay), status=status), 0)
    assert (tmp_path / "w.png").stat().st_size > 5000


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (LineSet, "scanner-sim lines, 2: 5 voxels of 16 pixels, 40 % valid"),
        (WaveformSet, "scanner-sim waveforms, 2: 5 voxels of 16 samples, 40 % valid"),
    ],
)
def test_a_set_tells_what_it_holds_and_goes_to_other_processes(kind: type[SignalSet], words: str) -> None:
    """Claim: voxels, their samples and the share that is valid; pickled, or joined to another, each column is as it
    was; of clusters each voxel has its own, one voxel after the other."""
    status = np.array([0, 1, 0, 2, 1], np.int32)
    one = made(kind, status=status)
    assert repr(one) == words
    np.testing.assert_array_equal(one.valid, status == Status.VALID)
    assert equal(pickle.loads(pickle.dumps(one)), one)
    twice = kind.joined([one, one])
    assert list(twice) == list(one)
    for name in one:
        np.testing.assert_array_equal(twice[name], np.concatenate([one[name]] * 2))
    np.testing.assert_array_equal(one.first_cluster, [0, *np.cumsum(one[CLUSTERS])])
    assert (one.row is one["row"], one.column is one["column"]) == (True, True)
    with pytest.raises(KeyError, match="no column 'range'"):
        one["range"]
    none = made(kind, rows=0)
    assert "0 voxels of 16" in repr(none)
    assert ", 0 % valid" in repr(none)


def test_waveforms_have_times_in_xarray() -> None:
    found = made(WaveformSet)
    data = found.to_xarray()
    np.testing.assert_allclose(data["time"], -8e-9 + 1e-9 * np.arange(16))
    assert data["number"].dims == ("voxel", "sample")
    assert data["time"].attrs["units"] == "s"
    np.testing.assert_array_equal(found.echoes, found["echoes"])


@pytest.mark.parametrize(("count", "taken"), [(-1, False), (0, True), (3, True), (10**7, False)])
def test_a_number_of_clusters_is_none_or_some(count: int, taken: bool) -> None:
    column = next(one for one in LineSet.COLUMNS if one.name == CLUSTERS)
    given = pyarrow.array([2, count], pyarrow.int32())
    if taken:
        assert signal_files._numbers(column, given).tolist() == [2, count]
        return
    with pytest.raises(ValueError, match="more clusters than any of ours"):
        signal_files._numbers(column, given)


@pytest.mark.parametrize("more", [0, 1])
def test_a_file_whose_voxels_are_too_large_is_not_read(more: int) -> None:
    """Claim: as many numbers for each voxel as the largest of ours may stand in a column, and not one more."""

    class ReadError(Exception):
        """Raised where the columns would be read."""

    def read(*_: Any, **__: Any) -> None:
        raise ReadError

    sizes = [3, 3 * signal_files._MOST_SAMPLES + more]
    packed = SimpleNamespace(num_rows=3, num_columns=2, column=lambda n: SimpleNamespace(num_values=sizes[n]))
    file: Any = SimpleNamespace(
        schema_arrow=pyarrow.schema([]),
        metadata=SimpleNamespace(row_group=lambda _: packed),
        read_row_groups=read,
    )
    with (
        pytest.raises(ValueError, match="more numbers than any of ours") if more else pytest.raises(ReadError)
    ):
        signal_files._part(file, [0], [])
