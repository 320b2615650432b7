"""Which writer a format has, of whose points, and into which files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from scanner_sim.products.formats import convert, writers
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
