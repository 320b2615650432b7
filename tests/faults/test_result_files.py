"""Results that somebody sent are refused with one sentence before a library reads what it should not."""

from __future__ import annotations

import json
import os
import struct
import time
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from scanner_sim.config import load_scenario
from scanner_sim.foundation.errors import Fault, InputError, ScenarioError
from scanner_sim.instrument.closed_loop.tracker import Tracker
from scanner_sim.products.files.exr import read_range_image, write_exr
from scanner_sim.products.files.signal_files import read_signals
from scanner_sim.products.files.tables import check_columns, read_parquet, write_parquet
from scanner_sim.products.image import RangeImage
from scanner_sim.products.pictures.image import about
from scanner_sim.products.pictures.pattern import _ellipse
from scanner_sim.products.waveforms import WaveformSet
from scanner_sim.tracking.record import TrackStatus

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


def image(scenario: str = "schema: 1\n") -> RangeImage:
    layers = {name: np.ones((4, 3), np.float32) for name in ("Y", "range_m")}
    return RangeImage(
        channels={**layers, "status": np.zeros((4, 3), np.float32)},
        theta=np.linspace(-0.1, 0.1, 3),
        phi=np.linspace(-0.1, 0.1, 4),
        scenario_yaml=scenario,
    )


def changed(path: Path, attribute: bytes, value: bytes) -> None:
    """Put other bytes at the begin of an attribute's value."""
    data = bytearray(path.read_bytes())
    at = data.index(attribute + b"\0")
    at = data.index(b"\0", at + len(attribute) + 1) + 5
    data[at : at + len(value)] = value
    path.write_bytes(bytes(data))


@pytest.mark.parametrize(
    ("attribute", "value", "words"),
    [
        (b"dataWindow", struct.pack("<4i", 0, 0, 2**31 - 1, 2**31 - 1), "no raster has"),
        (b"dataWindow", struct.pack("<4i", 0, 0, 9999, 9999), "cannot hold"),
        (b"dataWindow", struct.pack("<4i", 5, 5, 0, 0), "no raster has"),
        (b"compression", b"\x09", "compression"),
        (b"channels", b"Y\0" + struct.pack("<i", 1), "no float32"),
    ],
)
def test_an_image_that_claims_what_it_is_not(
    tmp_path: Path, attribute: bytes, value: bytes, words: str
) -> None:
    write_exr(tmp_path / "range.exr", image())
    changed(tmp_path / "range.exr", attribute, value)
    with pytest.raises(InputError, match=words):
        read_range_image(tmp_path / "range.exr")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes with names")
@pytest.mark.parametrize("read", [read_range_image, partial(read_signals, kind=WaveformSet), read_parquet])
def test_a_pipe_is_no_result(tmp_path: Path, read: object) -> None:
    os.mkfifo(tmp_path / "pipe")
    assert callable(read)
    with pytest.raises(InputError, match=r"no.* ordinary file"):
        read(tmp_path / "pipe")


def test_a_heading_reads_no_yaml() -> None:
    """Ten aliases of ten aliases, nine deep, are a billion values."""
    lines = ["a0: &a0 [x]"] + [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)]
    assert "nrc_2000" not in about(image("\n".join([*lines, "scanner: *a9\n"])))
    assert about(image("schema: 1\nscanner:\n  laser:\n    power: 1 W\n  preset: nrc_2000\n")).startswith(
        "nrc_2000"
    )


def test_a_table_of_more_cells_than_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A column of one number takes next to nothing on the disk."""
    monkeypatch.setattr("scanner_sim.products.files.tables.MOST_CELLS", 1000)
    write_parquet(tmp_path / "t.parquet", {"a": np.zeros(1001)}, {})
    with pytest.raises(InputError, match="too many"):
        read_parquet(tmp_path / "t.parquet")


def test_nested_columns_are_refused(tmp_path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.table({"a": [[1.0], [2.0]]}).replace_schema_metadata({b"scanner_sim": b"{}"})
    pyarrow.parquet.write_table(table, tmp_path / "t.parquet")
    with pytest.raises(InputError, match="no plain numbers"):
        read_parquet(tmp_path / "t.parquet")


def test_columns_are_of_their_kinds() -> None:
    columns = {"a": np.array([1.0, np.nan]), "b": np.array([1, 2]), "c": np.array(["x", None], dtype=object)}
    assert list(check_columns(columns, {"a": "number", "b": "whole"})) == ["a", "b"]
    for kinds, words in (
        ({"a": "finite"}, "column a"),
        ({"b": "number"}, "column b"),
        ({"c": "text"}, "column c"),
        ({"d": "text"}, "d is missing"),
    ):
        with pytest.raises(ValueError, match=words):
            check_columns(columns, kinds)  # type: ignore[arg-type]


def test_waveforms_without_a_column(tmp_path: Path) -> None:
    about = {
        "form": WaveformSet.FORM,
        "scenario": "",
        "objects": [],
        "materials": [],
        "numbers": {},
        "made_by": {},
    }
    write_parquet(tmp_path / "w.parquet", {"row": np.zeros(2, np.int32)}, about)
    with pytest.raises(InputError, match="the column column is missing"):
        read_signals(tmp_path / "w.parquet", WaveformSet)


def test_a_comparison_of_other_types(tmp_path: Path) -> None:
    from scanner_sim.validation.compare.baseline import read_baseline

    for text in ("[" * 100_000, json.dumps({"findings": [], "seed": "many"}), "\xff", "3"):
        (tmp_path / "compare.json").write_text(text)
        with pytest.raises(InputError, match="no comparison"):
            read_baseline(tmp_path / "compare.json")


@pytest.mark.parametrize("variance", [7e300, np.inf, np.nan])
def test_an_ellipse_beyond_half_a_turn_is_not_drawn(variance: float) -> None:
    assert _ellipse(np.diag([variance, 1e-12])) is None
    small = _ellipse(np.diag([4e-12, 1e-12]))
    assert small is not None
    np.testing.assert_allclose(np.abs(small).max(axis=1), [2.0, 1.0])


def test_texts_that_are_packed_do_not_unfold(tmp_path: Path) -> None:
    """Claim: a file of some kilobytes that stands for 20 GB of text is refused without unpacking it."""
    import pyarrow
    import pyarrow.parquet

    text = pyarrow.array(["x" * 100_000])
    packed = pyarrow.DictionaryArray.from_arrays(pyarrow.array(np.zeros(200_000, np.int32)), text)
    table, path = pyarrow.table({"target": packed}), tmp_path / "t.parquet"
    with pyarrow.parquet.ParquetWriter(path, table.schema, compression="zstd", store_schema=False) as writer:
        writer.write_table(table)
        writer.add_key_value_metadata({"scanner_sim": "{}"})
    assert path.stat().st_size < 100_000
    with pytest.raises(InputError, match="a text has 100000 bytes"):
        read_parquet(path)


def test_a_fault_that_quotes_a_book_is_said_at_once() -> None:
    """Claim: the quotation is cut before it is looked at letter by letter."""
    started = time.process_time()
    for error in (InputError("\x1b" * 50_000_000), ScenarioError([Fault("a", "\x1b" * 50_000_000)])):
        assert "\x1b" not in str(error)
        assert len(error.message) < 20_000
    assert time.process_time() - started < 5.0  # letter by letter it takes half a minute


@pytest.mark.slow
def test_a_pattern_that_tells_nothing_states_no_angle_beyond_all_directions() -> None:
    """Claim: patterns of 32 voxels seldom tell a centre; what is stated of one that was refused is NaN or up to π."""
    scenario = load_scenario(CONFIGS / "track_moving.yaml", ["scan.pattern.points=32"])
    records = list(islice(Tracker(scenario, device="cpu"), 40))
    sigmas = np.sqrt(np.array([np.diag(record.covariance)[:2] for record in records]))
    assert (np.isnan(sigmas) | (sigmas <= np.pi)).all()
    assert any(record.status is TrackStatus.REFUSED for record in records)
