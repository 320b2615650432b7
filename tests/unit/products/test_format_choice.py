"""Which writer a format has, of whose points, and into which files."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.products.files.contents import POSES, RELATIVE_POSES, TRACK
from scanner_sim.products.formats import convert, las, writers
from scanner_sim.products.formats.cloud import Cloud, Column
from scanner_sim.products.formats.las import intensity_of
from scanner_sim.products.formats.writers import Source, format_writers, write_format


@pytest.mark.parametrize(
    ("word", "expected"),
    [
        ("laz", ("las", "p", "cloud", True)), ("las", ("las", "p", "cloud", False)), ("e57", ("e57", "p", "cloud")),
        ("pcd", ("pcd", "p", "cloud", False)), ("pcd_ascii", ("pcd", "p", "cloud", True)),
    ],
)  # fmt: skip
def test_each_format_has_its_writer(
    monkeypatch: pytest.MonkeyPatch, word: str, expected: tuple[Any, ...]
) -> None:
    """Claim: laz is las compressed, and pcd_ascii is pcd in plain numbers."""
    asked: list[Any] = []
    for name in ("las", "e57", "pcd"):
        monkeypatch.setattr(
            f"scanner_sim.products.formats.{name}.write_{name}",
            lambda *given, name=name, **options: asked.append((name, *given, *options.values())),
        )
    monkeypatch.setattr(
        writers, "cloud_of_scan", lambda result, by: "cloud" if (result, by) == ("result", "tof") else None
    )
    source = Source("result", (), "tof")  # type: ignore[arg-type]
    write_format(source, word, "x", "p")  # type: ignore[arg-type]
    assert asked == [expected]


def test_a_bag_is_written_file_by_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Claim: points are made once for all files; each has its own bytes."""
    made: list[Any] = []
    monkeypatch.setattr(writers, "cloud_of_scan", lambda *given: made.append(given) or "cloud")
    monkeypatch.setattr("scanner_sim.products.formats.rosbag.bag_files", lambda cloud, truth: {
        "a": f"{cloud} {truth} a".encode(), "b": b"other"})  # fmt: skip
    result: Any = type("Result", (), {"poses": "true"})()
    monkeypatch.setattr(writers, "check_formats", lambda words: None)
    monkeypatch.setattr(writers, "FORMAT_FILES", {"rosbag2": ("a", "b")})
    for name, write in format_writers(result, ["rosbag2", "rosbag2"], by="tof").items():
        write(tmp_path / name)
    assert (tmp_path / "a").read_bytes() == b"cloud true a"
    assert (tmp_path / "b").read_bytes() == b"other"
    assert made == [(result, "tof")]


def test_files_are_named_by_formats_or_tell_theirs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: formats go into a folder under their usual names; a file's ending tells its format, in small or capital
    letters, and keeps the name that was given."""
    asked: list[Any] = []
    monkeypatch.setattr(convert, "check_formats", asked.append)
    usual = {word: convert.FORMAT_FILES[word] for word in ("las", "e57", "rosbag2")}
    folder, files = convert._targets(Path("f"), ["las", "rosbag2"])
    assert folder == Path("f")
    assert files == {name: (word, name) for word in ("las", "rosbag2") for name in usual[word]}
    assert convert._targets(Path("f/own.E57"), []) == (Path("f"), {"own.E57": ("e57", usual["e57"][0])})
    assert [words for words in asked if words] == [["las", "rosbag2"], ["e57"]]


@pytest.mark.parametrize(
    ("signal", "expected"),
    [
        ([200.0, 50.0, 150.0], [65535, 16384, 49151]), ([-3.0, 4.0, math.nan], [0, 65535, 0]),
        ([math.inf, 2.0, 1.0], [0, 65535, 32768]), ([-math.inf, 2.0, 0.5], [0, 65535, 16384]),
        ([-5.0, -1.0, math.nan], [0, 0, 0]), ([0.0, 0.0, 0.0], [0, 0, 0]),
    ],
)  # fmt: skip
def test_intensities_go_from_none_to_the_largest_signal(signal: list[float], expected: list[int]) -> None:
    """Claim: in parts of 65 535 of the largest finite signal of the valid points; what is none or below nothing is
    0."""
    cloud: Any = SimpleNamespace(signal=np.array([*signal, 9e9]), valid=np.array([True] * 3 + [False]))
    assert intensity_of(cloud).tolist() == expected


@pytest.mark.parametrize("dated", [True, False])
def test_what_no_column_can_say_stands_in_a_text(dated: bool) -> None:
    """Claim: the largest signal that is finite, what times are, and names behind numbers; nothing beyond ASCII."""
    cloud: Any = SimpleNamespace(
        signal=np.array([7.5, math.nan, 99.0]), valid=np.array([True, True, False]), epoch="day" if dated else None,
        time=np.zeros(3), software="scanner-sim 9, é", seed=17, legends={"objects": {"1": "wall"}},
    )  # fmt: skip
    lines = las._text(cloud).split("\n")
    assert any(one.startswith("intensity: charge of the signal, 7.5 electrons as 65535") for one in lines)
    time = "adjusted standard GPS time" if dated else "seconds since the start of the scan, no date"
    assert f"gps_time: {time}" in lines
    assert lines[-3:] == ["scanner-sim 9, \\xe9", "seed 17", '{"objects": {"1": "wall"}}']
    cloud.time = None
    assert "gps_time: not known" in las._text(cloud).split("\n")
    cloud.legends = {"objects": "x" * 65_000}
    assert las._text(cloud).endswith("too many for this record")


@pytest.mark.parametrize("there", [(), ("poses.parquet",), ("relative_poses.parquet",), ("both",)])
def test_a_track_is_read_with_the_poses_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: tuple[str, ...]
) -> None:
    """Claim: those before the scanner, then those of one object seen from another, of which there may be none."""
    names = [POSES[1], RELATIVE_POSES[1]]
    chosen = {"both": names, "poses.parquet": names[:1], "relative_poses.parquet": names[1:]}
    wanted = [name for word in there for name in chosen[word]]
    for name in (TRACK.result, *wanted):
        (tmp_path / name).touch()
    monkeypatch.setattr(convert, "read_track", lambda folder: f"track of {folder.name}")
    monkeypatch.setattr(convert, "read_poses", lambda path: (f"{path.name} 1", f"{path.name} 2"))
    found = convert.result_in(tmp_path)
    assert found == (f"track of {tmp_path.name}", tuple(f"{name} {n}" for name in wanted for n in (1, 2)))


def test_a_cloud_is_cut_where_a_column_changes() -> None:
    """Claim: a part for each run of one value, in their order, with what belongs to its points and no other's; without
    the column the cloud is whole. All parts together are what was cut."""
    count = 6
    visit = np.array([7, 7, 3, 3, 3, 7], dtype=np.uint32)
    rng = np.random.default_rng(2)
    returns = (np.arange(count, dtype=np.uint8) + 1, np.arange(count, dtype=np.uint8) + 20)
    whole = Cloud(
        points=rng.normal(size=(count, 3)).astype(np.float32), valid=np.array([1, 0, 1, 1, 0, 1], dtype=bool),
        signal=rng.normal(size=count), sigma=rng.normal(size=count), theta=rng.normal(size=count),
        time=rng.normal(size=count), returns=returns,
        columns=(Column("visit", "1", "of", visit), Column("x", "m", "of", rng.normal(size=count))),
        shape=None, epoch=None, legends={}, software="s", seed=4, scenario="",
    )  # fmt: skip
    parts = list(whole.parts("visit"))
    for part, where in zip(parts, (slice(0, 2), slice(2, 5), slice(5, 6)), strict=True):
        for name in ("points", "valid", "signal", "sigma", "theta", "time"):
            np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[where])
        for found, given in zip(part.returns, whole.returns, strict=True):
            np.testing.assert_array_equal(found, given[where])
        for column, given_column in zip(part.columns, whole.columns, strict=True):
            assert column.name == given_column.name
            np.testing.assert_array_equal(column.values, given_column.values[where])
        assert (part.seed, part.software) == (4, "s")
    assert list(whole.parts("target")) == [whole]
    (untimed,) = replace(whole, time=None, columns=()).parts("visit")
    assert untimed.time is None
