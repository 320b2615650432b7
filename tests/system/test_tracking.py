"""A tracking run from a scenario: commands, saved state, bad input, and what lies outside of the field of view."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from scanner_sim import Scenario, Tracker, load_scenario, track
from scanner_sim.cli import app
from scanner_sim.config import scenario_warnings
from scanner_sim.foundation.errors import InputError, ScenarioError
from scanner_sim.tracking.record import PatternRecord, TrackStatus
from scanner_sim.tracking.state import TrackMode

pytestmark = pytest.mark.usefixtures("device")

CONFIGS = sorted((Path(__file__).resolve().parents[2] / "configs").glob("track_*.yaml"))

NODE = {
    "name": "node",
    "array": {"diameter": 0.1, "rows": 1, "columns": 2, "spacing": (0.8, 0.8), "plate": 0.4},
    "position": (0.1, 0.0, 9.0),
    "motion": {"type": "twist", "velocity": (0.01, 0.0, 0.0)},
}


def scenario(*overrides: str, objects: tuple[Any, ...] = (NODE,), **scan: Any) -> Scenario:
    base = {"type": "track", "targets": ["node"], "duration": 0.06}
    return load_scenario(
        {"schema": 1, "seed": 3, "scene": {"objects": list(objects)}, "scan": base | scan}, overrides
    )


def numbers(records: list[PatternRecord]) -> list[bytes]:
    """Everything that a record holds, as bytes."""
    found = []
    for record in records:
        for field in fields(PatternRecord):
            value = getattr(record, field.name)
            if field.name == "samples":
                found += [getattr(value, part.name).tobytes() for part in fields(value)]
            else:
                found.append(value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
    return found


@pytest.mark.slow
@pytest.mark.parametrize("sun", ["none", "{direction: [0, -0.6, -0.8]}"])
def test_a_run_cut_in_two_equals_the_whole(tmp_path: Path, sun: str) -> None:
    """Claim: a run that is saved to a file and continued elsewhere gives the records of the whole run, byte by byte."""
    asked = scenario(f"lighting.sun={sun}", targets=[{"target": "node", "offset": (5e-3, 0.0, 0.0)}])
    whole = list(track(asked).records)
    assert len(whole) == 6
    first = Tracker(asked)
    begun = [next(first) for _ in range(3)]
    first.save(tmp_path / "state.json")
    first.save(tmp_path / "state.json")
    (tmp_path / "mine.json").write_text("mine")
    with pytest.raises(InputError, match="cannot be read"):
        first.save(tmp_path / "mine.json")
    assert (tmp_path / "mine.json").read_text() == "mine"
    second = Tracker.resume(tmp_path / "state.json")
    assert second.scenario == asked
    assert numbers(begun + list(second)) == numbers(whole)
    assert second.finished


@pytest.mark.slow
def test_threads_do_not_change_a_run() -> None:
    """Claim: one thread and two give the same bytes."""
    one, two = (list(track(scenario(), threads=threads).records) for threads in (1, 2))
    assert numbers(one) == numbers(two)


@pytest.mark.slow
def test_targets_are_visited_in_turn_every_ten_milliseconds() -> None:
    """Claim: several targets take Table 2's 10 ms each, one 6.6 ms, and both moving targets are followed at once."""
    made = track(scenario(duration=0.2))
    assert [record.target for record in made.records] == ["node/1", "node/2"] * 10
    times = np.array([record.samples.time[0, 0] for record in made.records])
    np.testing.assert_allclose(np.diff(times), 10e-3, rtol=0.01)
    assert all(record.status is TrackStatus.MEASURED for record in made.records)
    assert {record.after for record in made.records[4:]} == {TrackMode.TRACK}
    single = track(scenario(targets=["node/2"], duration=0.05))
    times = np.array([record.samples.time[0, 0] for record in single.records])
    np.testing.assert_allclose(np.diff(times), 6.6e-3, rtol=1e-3)
    for record in made.records:
        # The place and its point are the same thing, and so are the true ones.
        assert abs(record.truth_point[2] - 9.0) < 1e-9
        assert abs(np.linalg.norm(record.point - record.truth_point)) < 5e-3


def test_commands_change_what_comes_next() -> None:
    """Claim: targets can be dropped, searched for anew, expected elsewhere, and given another amplitude."""
    tracker = Tracker(scenario(duration=1.0))
    for _ in range(4):
        next(tracker)
    tracker.drop("node/1")
    assert {next(tracker).target for _ in range(3)} == {"node/2"}
    start = tracker.state.clock
    next(tracker)
    assert tracker.state.clock - start == pytest.approx(6.6e-3)
    tracker.amplitude("node/2", 9e-3)
    assert next(tracker).amplitude == 9e-3
    tracker.amplitude("node/2", None)
    assert next(tracker).amplitude == pytest.approx(1.22 * 0.05 / 9.0, rel=0.02)
    tracker.search("node/1")
    found = [next(tracker) for _ in range(2)]
    assert {record.target for record in found} == {"node/1", "node/2"}
    assert next(record for record in found if record.target == "node/1").mode is TrackMode.SEARCH
    truth = found[0].truth
    tracker.drop("node/2")
    tracker.point("node/1", truth[0] + 0.2, truth[1], 9.0)
    missed = next(tracker)
    assert missed.status is TrackStatus.NOT_FOUND
    assert np.isnan(missed.position).all()
    np.testing.assert_allclose(missed.centre, [truth[0] + 0.2, truth[1]])
    tracker.drop("node/1")
    assert tracker.finished
    with pytest.raises(StopIteration):
        next(tracker)


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (lambda tracker: tracker.search("node/3"), "there is no target 'node/3'"),
        (lambda tracker: tracker.point("node/1", 0.0, 0.0, -1.0), "is no place"),
        (lambda tracker: tracker.point("node/1", float("nan"), 0.0, 1.0), "is no place"),
        (lambda tracker: tracker.point("node/1", 0.0, 0.0, 1.01e6), "is no place"),
        (lambda tracker: tracker.point("node/1", 0.0, 0.0, 0.99e-6), "is no place"),
        (lambda tracker: tracker.point("node/1", 0.0, -10.1, 1.0), "is no place"),
        (lambda tracker: tracker.amplitude("node/1", 2.0), "is no amplitude"),
    ],
)
def test_impossible_commands_are_refused(command: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        command(Tracker(scenario()))


def test_a_target_outside_of_the_field_waits_and_the_others_go_on() -> None:
    """Claim: a target that the mirrors cannot reach has a status, costs the others no time, and raises a doubt."""
    far = NODE | {"name": "far", "position": (6.0, 0.0, 9.0), "motion": None}
    asked = scenario(objects=(NODE, far), targets=["node/1", "far/2", "node/2"], duration=0.1)
    assert any("'far/2' is expected at" in doubt for doubt in scenario_warnings(asked))
    made = track(asked)
    out = made.of("far/2")
    assert out
    assert all(record.status is TrackStatus.OUT_OF_VIEW for record in out)
    assert all(record.samples.time.shape == (1, 0) and np.isnan(record.position).all() for record in out)
    assert all(record.status is TrackStatus.MEASURED for record in made.of("node/1"))
    assert len(made.of("node/1")) == 5
    assert any("'far/2' was never measured" in warning for warning in made.warnings)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("target", "kind"),
    [
        ({"array": {"diameter": 0.1, "plate": 0.4}}, "black"),
        (
            {"array": {"diameter": 0.1, "plate": 0.4}, "disc": "target_white", "material": "target_black"},
            "white",
        ),
        ({"array": {"diameter": 0.1, "plate": 0.4}, "disc": "retro_sheet"}, "retro"),
        ({"shape": "disc", "diameter": 0.12, "material": {"reflectance": 0.5}}, "raised"),
        ({"shape": "sphere", "diameter": 0.12, "material": {"reflectance": 0.5}}, "raised"),
    ],
    ids=["black", "white", "retro", "disc", "sphere"],
)
def test_every_kind_of_target_is_followed(target: dict[str, Any], kind: str) -> None:
    """Claim: targets told by light or by range are followed by either way of ranging, and the scene tells their kind.

    Set-up: each at 9 m for 0.15 s, 23 patterns; the range of a sphere is that of its middle. Expected: at least 16
    patterns measured, and none of their angles and ranges farther from the truth than 5 of its σ and 20 µrad, 1 mm.
    A retro-reflector saturates the photodiode, so that it is left to the line.
    """
    thing = {"name": "thing", "position": (0.2, 0.1, 9.0)} | target
    asked = scenario(objects=(thing,), targets=["thing"], duration=0.15)
    assert asked.targets[0].appearance.kind == kind
    for ranging in ("triangulation",) if kind == "retro" else ("triangulation", "tof"):
        made = track(asked.model_copy(update={"ranging": ranging}))
        good = [record for record in made.records if record.status is TrackStatus.MEASURED]
        assert len(good) >= 16
        for record in good:
            sigma = np.sqrt(np.diagonal(record.covariance))
            assert (np.abs(record.position - record.truth) < 5.0 * sigma + (20e-6, 20e-6, 1e-3)).all()


def test_where_no_target_is_in_view_time_goes_by() -> None:
    made = track(scenario("scene.objects.node.position=[9 m, 0 m, 9 m]", duration=0.05))
    assert 4 <= len(made.records) <= 12
    assert {record.status for record in made.records} == {TrackStatus.OUT_OF_VIEW}


@pytest.mark.parametrize(
    ("targets", "fault"),
    [
        (["nod"], "scan.targets[0]: there is no object 'nod'. Did you mean 'node'?"),
        (["node/3"], "scan.targets[0]: 'node' has 2 targets. Write node/1 to node/2."),
        (["ball/1"], "scan.targets[0]: 'ball' is one target, no array of them. Write ball."),
        (["node/1", "node"], "scan.targets[1]: 'node/1' is named twice."),
        (["wall"], "scan.targets[0]: 'wall' is no target of which the scene tells the kind."),
        ([{"target": "node", "expected": (0.0, 0.0, 9.0)}], "one expected place stands for 2 targets."),
        (
            [{"target": "ball", "expected": (0.0, 0.0, -1.0)}],
            "scan.targets[0].expected[2]: a range of -1 m is none.",
        ),
        (["node/1", {"target": "node/2", "expected": (-0.033, 0.0, 9.0)}], "'node/2' overlaps 'node/1'"),
        ([], "scan.targets"),
        (["1node"], "is no name"),
    ],
)
def test_impossible_targets_are_faults(targets: list[Any], fault: str) -> None:
    ball = {
        "name": "ball",
        "shape": "sphere",
        "diameter": 0.1,
        "material": "z93_white",
        "position": (0, -2, 8),
    }
    wall = {
        "name": "wall",
        "shape": "rectangle",
        "size": (4, 4),
        "material": "z93_white",
        "position": (0, 0, 12),
    }
    with pytest.raises(ScenarioError) as caught:
        scenario(objects=(NODE, ball, wall), targets=targets)
    assert fault in str(caught.value)


def test_other_impossible_tracking_scans_are_faults() -> None:
    with pytest.raises(ScenarioError, match="keeps no waveforms"):
        scenario("output.waveforms=all", "ranging=tof")
    with pytest.raises(ScenarioError, match="'trak' is not possible here"):
        scenario(type="trak")


def test_patterns_beyond_the_mirrors_are_doubted_with_the_attainable_ones() -> None:
    found = scenario_warnings(scenario("scan.pattern.points=32", "scan.tracker.search_most=100 mrad"))
    assert any(doubt.startswith("scan.tracker.search_most: the mirror of Θ cannot follow") for doubt in found)
    assert any("at most" in doubt and "points" in doubt for doubt in found)
    crowded = scenario_warnings(
        scenario("scan.tracker.track_amplitude=10", "scene.objects.node.array.spacing=[0.4 m, 1 m]")
    )
    assert any("also meets 'node/2'" in doubt for doubt in crowded)
    assert any(
        "not all of 2 targets are visited" in doubt for doubt in scenario_warnings(scenario(duration=0.005))
    )
    assert not scenario_warnings(scenario(duration=1.0))


def test_files_that_are_no_state_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    for content, message in (("{", "cannot be read"), ("{}", "is no state"), ('{"format": 1}', "damaged")):
        path.write_text(content, encoding="utf-8")
        with pytest.raises(InputError, match=message):
            Tracker.resume(path)
    with pytest.raises(InputError, match="cannot be read"):
        Tracker.resume(tmp_path / "nothing.json")


def test_what_needs_a_raster_says_so(tmp_path: Path) -> None:
    """Claim: the budget of a scenario that tracks ends with one sentence and a remedy, and a raster is not tracked."""
    arguments = ["budget", str(CONFIGS[0]), "-o", str(tmp_path / "out")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2, result.output
    assert "needs a raster" in result.stderr
    assert not (tmp_path / "out").exists()
    raster = load_scenario(
        {"schema": 1, "scan": {"rows": 2, "columns": 2, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}}
    )
    with pytest.raises(InputError, match="this follows targets"):
        track(raster)


def test_yaml_and_python_are_two_spellings_of_one_scan(tmp_path: Path) -> None:
    path = tmp_path / "track.yaml"
    path.write_text(
        "schema: 1\nseed: 3\nscene:\n  objects:\n"
        "    - {name: node, array: {diameter: 100 mm, rows: 1, columns: 2, spacing: [0.8 m, 0.8 m], plate: 400 mm},\n"
        "       position: [0.1 m, 0 m, 9 m], motion: {type: twist, velocity: [10 mm/s, 0 m/s, 0 m/s]}}\n"
        "scan: {type: track, targets: [node], duration: 60 ms}\n",
        encoding="utf-8",
    )
    assert load_scenario(path) == scenario()


@pytest.mark.slow
@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_the_shipped_runs_find_their_targets(path: Path, tmp_path: Path) -> None:
    """Every scenario that tracks runs through the command line, and measures all of its targets."""
    made = track(load_scenario(path, ["scan.duration=0.3 s"]))
    assert not made.warnings
    late = [record for record in made.records if record.time > 0.2]
    assert all(record.status is TrackStatus.MEASURED for record in late)
