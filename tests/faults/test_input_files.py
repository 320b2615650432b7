"""Files that a user hands in: each ends with one fault, and nothing waits or grows without end."""

from __future__ import annotations

import copy
import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from scanner_sim.cli import app
from scanner_sim.config import load_scenario, resolved_yaml
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import (
    LONGEST_LINE,
    LONGEST_MESSAGE,
    Fault,
    InputError,
    ScannerSimError,
    ScenarioError,
    printable,
)
from scanner_sim.instrument import memory
from scanner_sim.instrument.closed_loop.saved_state import first_state, load_state, save_state
from scanner_sim.instrument.closed_loop.track import track
from scanner_sim.instrument.simulate import simulate
from scanner_sim.instrument.simulate_signals import simulate_waveforms
from scanner_sim.products.files.contents import RUN
from scanner_sim.products.files.folder import check_target
from scanner_sim.products.track import read_track
from scanner_sim.validation.compare.comparison_setup import FlatTarget

TRACK: dict[str, Any] = {
    "schema": 1,
    "scene": {
        "objects": [
            {
                "name": "board",
                "array": {"diameter": 0.1, "rows": 1, "columns": 2, "spacing": [0.5, 0.5], "plate": 0.3},
                "position": [0, 0, 6],
            }
        ]
    },
    "scan": {"type": "track", "targets": ["board"]},
}
RASTER = (
    "schema: 1\n"
    "scan: {type: raster, rows: 4, columns: 4, horizontal: [-1 deg, 1 deg], vertical: [-1 deg, 1 deg]}\n"
)


def changed(**parts: Any) -> dict[str, Any]:
    data = copy.deepcopy(TRACK)
    for path, value in parts.items():
        inside: Any = data
        *way, last = path.split("__")
        for step in way:
            inside = inside[int(step)] if step.isdigit() else inside.setdefault(step, {})
        inside[last] = value
    return data


@pytest.fixture
def saved(tmp_path: Path) -> dict[str, Any]:
    scenario = load_scenario(TRACK)
    path = tmp_path / "state.json"
    state = first_state(scenario.targets, scenario.following.tracker)
    save_state(path, state, resolved_yaml(scenario), "test")
    found, _ = load_state(path)
    assert found.clock == state.clock
    np.testing.assert_array_equal(found.tracks[1].motion.covariance, state.tracks[1].motion.covariance)
    content: dict[str, Any] = json.loads(path.read_text())
    return content


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ("turn", 99, "state.turn: 99 is not below the number of tracks, 2"),
        ("visits", -1, "state.visits"),
        ("visits", 1.5, "state.visits"),
        ("skipped", True, "state.skipped"),
        ("clock", math.nan, "state.clock"),
        ("clock", "soon", "state.clock"),
        ("amplitudes.0", 1e9, "state.amplitudes[0]"),
        ("amplitudes", [None], "state.amplitudes: it has 1 entries, and there are 2 tracks"),
        ("followed.1", 1, "state.followed[1]"),
        ("tracks.0.mean", [0.0, 0.0], "state.tracks[0].mean"),
        ("tracks.0.mean.2", -1.1e17, "state.tracks[0].mean[2]"),
        ("tracks.1.covariance.0.0", -1e-6, "state.tracks[1].covariance"),
        ("tracks.1.covariance.0.1", 1.0, "state.tracks[1].covariance"),
        ("tracks.0.mode", "asleep", "state.tracks[0].mode"),
        ("tracks.0.seen", 10**30, "state.tracks[0].seen"),
        ("tracks", {}, "state.tracks"),
        ("mirrors.angle", [[0.0], [0.0]], "state.mirrors.angle"),
        ("mirrors.time", 5.0, "later than the clock"),
        ("mirrors.extra", 1, "state.mirrors.extra"),
    ],
)
def test_a_state_that_cannot_be_is_refused_at_its_place(
    saved: dict[str, Any], tmp_path: Path, place: str, value: Any, words: str
) -> None:
    inside: Any = saved["state"]
    *way, last = (int(step) if step.isdigit() else step for step in place.split("."))
    for step in way:
        inside = inside[step]
    inside[last] = value
    (tmp_path / "damaged.json").write_text(json.dumps(saved))
    with pytest.raises(InputError) as found:
        load_state(tmp_path / "damaged.json")
    assert words in found.value.message


def test_a_covariance_with_a_negative_direction_is_none(saved: dict[str, Any], tmp_path: Path) -> None:
    matrix = np.eye(6)
    matrix[0, 1] = matrix[1, 0] = 1.5  # all variances are positive, one eigenvalue is 1 - 1.5
    saved["state"]["tracks"][0]["covariance"] = matrix.tolist()
    (tmp_path / "damaged.json").write_text(json.dumps(saved))
    with pytest.raises(InputError, match="no covariance"):
        load_state(tmp_path / "damaged.json")


@pytest.mark.parametrize("content", [b"[" * 100_000, b"\xff\xfe", b"", b"null", b"[]", b'{"format": 2}'])
def test_what_is_no_state_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "state.json").write_bytes(content)
    with pytest.raises(InputError):
        load_state(tmp_path / "state.json")


def test_a_state_of_another_version_is_not_called_damaged(saved: dict[str, Any], tmp_path: Path) -> None:
    """Claim: it is said that this program does not read it, and what to do is not to save it again."""
    (tmp_path / "newer.json").write_text(json.dumps(saved | {"format": saved["format"] + 1}))
    with pytest.raises(InputError, match="no state of a tracker that this program reads") as found:
        load_state(tmp_path / "newer.json")
    assert found.value.remedy == "Name a file that a tracker of this version saved."


@pytest.fixture
def endless(tmp_path: Path) -> Path:
    os.mkfifo(tmp_path / "pipe")
    return tmp_path / "pipe"


def test_pipes_and_devices_are_not_waited_for(endless: Path) -> None:
    for path in (endless, Path("/dev/zero")):
        for read in (load_scenario, load_state):
            with pytest.raises(InputError):
                read(path)


@pytest.mark.parametrize(
    "path", ["a" * 300, "a" * 300 + "/b.yaml", "a\0b", "~nobody-here/b.yaml", "\udc80"], ids=ascii
)
def test_names_that_no_system_takes(path: str, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        load_scenario(path)
    with pytest.raises(InputError):
        load_scenario({**TRACK, "processing": {"bias_correction": f"{path}.csv"}})
    with pytest.raises(InputError):
        load_scenario({**TRACK, "scanner": {"lidar": {"pulse": {"shape": f"{path}.csv"}}}})


@pytest.mark.slow
@pytest.mark.parametrize("text", ["50 % at 1e300 m", "50 % at 1e-300 m", "0 m", ", ".join(["3 m"] * 50_000)])
def test_targets_of_comparisons_that_no_bench_holds(text: str) -> None:
    with pytest.raises(InputError, match="--target"):
        FlatTarget.parse(text)


def test_calibration_needs_a_name_of_a_file(small: Path) -> None:
    result = CliRunner().invoke(app, ["calibrate", str(small), "-o", ""])
    assert result.exit_code == 2
    assert "no name of a table" in result.stderr


@pytest.mark.parametrize("name", ["a" * 5000, "a\0b"], ids=["long", "zero"])
def test_names_of_results_that_no_system_takes(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        read_track(tmp_path / name)
    with pytest.raises(InputError):
        check_target(tmp_path / name, False, RUN)
    if name.isprintable():
        result = CliRunner().invoke(app, ["show", str(tmp_path / name)])
        assert result.exit_code == 2


@pytest.mark.parametrize(
    "line",
    [
        "x: " + "[" * 2000 + "]" * 2000,
        "x: " + "{a: " * 2000 + "}" * 2000,
        "x:\n" + "".join(" " * depth + "- \n" for depth in range(1, 400)),
        "seed: 0x" + "f" * 5000,
        "seed: 0o" + "7" * 9000,
        "seed: " + "9" * 5000,
        "scanner: {rate: 0x" + "f" * 900 + "}",
        "scanner: {lidar: {pulse: {shape: 5}}}",
        "processing: {pulse: {level: 1e300}}",
        "processing: {pulse: {level: 1e300 A}}",
        "seed: !!python/object/apply:os.system [id]",
        "seed: !!binary aGVsbG8=",
        "seed: 2001-01-01",
        "<<: {seed: 1}",
        "a: &a [*a]",
    ],
)
def test_lines_that_nobody_means(line: str, tmp_path: Path) -> None:
    (tmp_path / "scenario.yaml").write_text(RASTER + line + "\n")
    with pytest.raises(ScenarioError) as found:
        load_scenario(tmp_path / "scenario.yaml")
    assert len(str(found.value)) <= LONGEST_MESSAGE


def test_a_mapping_without_end_is_refused() -> None:
    endless: dict[str, Any] = {}
    endless["scene"] = endless
    for data in (endless, {**TRACK, "seed": 10**5000}):
        with pytest.raises(ScenarioError):
            load_scenario(data)


def _fault(data: dict[str, Any]) -> str:
    with pytest.raises(ScenarioError) as found:
        load_scenario(data)
    return str(found.value)


@pytest.mark.parametrize(
    ("data", "key"),
    [
        (changed(scene__objects__0__array__rows=1000, scene__objects__0__array__columns=1000), "array.rows"),
        (changed(scan__duration=1e6), "scan.duration"),
        (changed(scanner={"rate": 1e9}, scan__visiting={"turnaround": 1.0}), "scan.visiting.updates"),
        (changed(scanner={"rate": 1e9, "galvanometers": {"readout_delay": 1e-3}}), "readout_delay"),
        (changed(scan__targets=[{"target": "board/1", "offset": [0, 0, -7]}]), "scan.targets[0]"),
    ],
)
def test_what_no_memory_holds_is_refused_at_its_key(data: dict[str, Any], key: str) -> None:
    assert key in _fault(data)


def test_arrays_together_are_bounded_too() -> None:
    data = copy.deepcopy(TRACK)
    (board,) = data["scene"]["objects"]
    board["array"] |= {"rows": 90, "columns": 100, "spacing": [0.5, 0.5]}
    data["scene"]["objects"].append({**copy.deepcopy(board), "name": "other"})
    data["scan"]["targets"] = ["board/1"]
    assert "scene.objects" in _fault(data)
    data["scan"]["targets"] = ["board"]
    data["scene"]["objects"].pop()
    assert "can be followed" in _fault(data)


# As if no memory were free: how much is free on the machine of the test does not matter.
@pytest.mark.parametrize(
    ("work", "key"),
    [
        (lambda raster, _: simulate(raster), "scan.rows"),
        (lambda raster, _: simulate(raster, batch=10**12), "batch"),
        (lambda raster, _: simulate_waveforms(raster), "digitiser"),
        (lambda _, following: track(following), "scan.duration"),
    ],
)
def test_python_users_too_are_told_what_no_memory_holds(
    work: Callable[[Scenario, Scenario], object], key: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    raster = load_scenario({**yaml.safe_load(RASTER), "ranging": "both"})
    following = load_scenario(TRACK)
    monkeypatch.setattr(memory, "_free_memory", lambda: 0.0)
    if key == "scan.rows":
        monkeypatch.setattr(memory, "SHOT_BYTES", 0.0)
    with pytest.raises(InputError) as found:
        work(raster, following)
    assert "are free" in found.value.message
    assert key in found.value.remedy


@pytest.mark.parametrize("work", [simulate, simulate_waveforms])
def test_a_raster_is_asked_for_before_its_memory(work: Callable[[Scenario], object]) -> None:
    with pytest.raises(InputError, match=r"scan.type|triangulation"):
        work(load_scenario(TRACK))


@pytest.mark.parametrize(
    "make", [InputError, lambda text: ScenarioError([Fault("a", text, text)], source=text)]
)
def test_messages_hold_no_escape_sequences_and_end(make: Callable[[str], ScannerSimError]) -> None:
    error = make(
        "red \x1b[31m, back \r, \x9b2J, turned \u202e, hidden \u200b, half \ud800, " + "long " * 9000
    )
    for text in (str(error), error.message):
        assert not any(letter in text for letter in "\x1b\r\x9b\u202e\u200b\ud800")
        assert "\\x1b[31m" in text
        assert len(text) <= LONGEST_MESSAGE
        assert max(map(len, text.split("\n"))) <= 3 * LONGEST_LINE


def test_a_fault_is_one_line_and_a_list_of_faults_ends() -> None:
    faults = [Fault("a\nb", f"problem {number}") for number in range(5000)]
    error = ScenarioError(faults, source="file\nname.yaml")
    assert len(error.faults) == 5000
    assert "4950 more" in str(error)
    assert str(error).count("\n") == 51


def test_plain_texts_stay_as_they_are() -> None:
    text = "line 5, scanner.laser.power: '15' has no unit (µm, °, Θ, 日本).\n  second"
    assert printable(text, lines=True) == text
