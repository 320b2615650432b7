"""Tables that commands print at their end: each number is that of its row and column, in the unit of its heading."""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.campaign import store
from scanner_sim.campaign.reading import read_campaign
from scanner_sim.cli import plan, tables, tracking
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products import track_summary
from scanner_sim.tracking.state import TrackMode

campaign: Any = importlib.import_module("scanner_sim.cli.campaign")
"""The module: the package gives its name to the verb."""


@pytest.mark.parametrize(
    ("keep", "kept", "megabytes"),
    [("all", 25, "about 0.072 MB, 25"), ("none", 0, "about 0.01 MB, 0"), ([3, 4], 2, "about 0.015 MB, 2")],
)
def test_a_plan_says_what_it_takes(
    keep: Any, kept: int, megabytes: str, told: Callable[[Any], list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: of 25 runs of 3 s, and 0.02 s beside each, 38 s pass with three workers, of whom two cores serve two; the
    disk holds 400 bytes a row and the layers of each shot of a kept run; twenty rows are shown, and five are more."""
    found = told(campaign)
    monkeypatch.setattr(campaign, "run_seconds", lambda _: 3.0)
    monkeypatch.setattr(campaign, "layer_bytes", {("u",): 31}.__getitem__)
    groups = [SimpleNamespace(keys=("a.b",), length=5), SimpleNamespace(keys=("c", "d", "e"), length=5)]

    class Runs:
        base = SimpleNamespace(
            scan=SimpleNamespace(layout="image"), rangefinders=("u",), open_scan=SimpleNamespace(shots=80)
        )
        plan = SimpleNamespace(
            keep=SimpleNamespace(runs=keep), vary=groups, repeat=2, measure=("m", "n"), names=("a.b", "x")
        )

        def __len__(self) -> int:
            return 25

        def changes(self, run: int) -> dict[str, Any]:
            return {"seed": 100 + run, "a.b": f"{run} m", "c": 1.5 * run}

    monkeypatch.setattr(store, "axis_names", lambda plan: plan.names)
    runs: Any = Runs()
    campaign._print_plan(runs, Path("f/g"), 3)
    about, _, rows, more = found
    assert about == {
        "runs": "25", "axes": "a.b × 5; 3 keys × 5; repeat × 2", "measures": "m, n",
        "a run takes": "about 3 s on two processor cores", "all take": "about 38 s with 3 workers on two cores",
        "disk": f"{megabytes} whole results among it", "folder": "f/g",
    }  # fmt: skip
    assert rows[0] == ("run", "seed", "a.b", "c")
    assert [row[:2] for row in rows[1:]] == [(str(run), str(100 + run)) for run in range(20)]
    assert rows[3] == ("2", "102", "2 m", "3.0")
    assert more == "… and 5 more"
    runs.base.scan.layout = "visits"
    assert campaign._result_bytes(runs) == 2e6
    found.clear()
    campaign._print_plan(runs, Path("f/g"), 1)
    assert found[0]["all take"] == "about 76 s with 1 workers on two cores"


def test_a_plan_that_varies_the_seed_shows_it_once(
    tmp_path: Path, small_scenario: str, told: Callable[[Any], list[Any]]
) -> None:
    (tmp_path / "small.yaml").write_text(small_scenario, encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(
        "schema: 1\nbase: small.yaml\nvary: [{keys: {seed: [3, 4]}}]\n", encoding="utf-8"
    )
    found = told(campaign)
    campaign._print_plan(read_campaign(tmp_path / "plan.yaml"), Path("f"), 1)
    assert found[2] == [("run", "seed"), ("0", "3"), ("1", "4")]


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(119.4, "119 s"), (121.0, "2 min"), (7140.0, "119 min"), (7201.0, "2.0 h"), (9000.0, "2.5 h")],
)
def test_times_are_told_in_seconds_minutes_and_hours(seconds: float, words: str) -> None:
    assert campaign._duration(seconds) == words


def test_a_run_is_told_with_the_units_of_its_measures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: what a run varied, and its measures with their units, its fault instead, or that it is not done yet."""
    monkeypatch.setattr(store, "units_of", lambda *_: {"u": "m", "v": "1"})
    rows = {
        "run": np.array([4, 6]), "fault": np.array(["", "it fell."]), "seconds": np.array([1.2345, 2.0]),
        "u": np.array([0.25, math.nan]), "v": np.array([3.0, math.nan]),
    }  # fmt: skip
    held: Any = SimpleNamespace(
        rows=lambda: [rows], measures=("u", "v"), folder="f",
        campaign=SimpleNamespace(changes=lambda run: {"k": f"{run} mm"}),
    )  # fmt: skip
    again = "scanner-sim campaign rerun f --run"
    assert campaign._about_run(held, 4) == {
        "run": "4", "k": "4 mm", "u": "0.25 m", "v": "3", "took": "1.23 s", "again": f"{again} 4",
    }  # fmt: skip
    assert campaign._about_run(held, 6) == {
        "run": "6", "k": "6 mm", "fault": "it fell.", "took": "2 s", "again": f"{again} 6",
    }  # fmt: skip
    assert campaign._about_run(held, 5) == {"run": "5", "k": "5 mm", "outcome": "not done yet"}


@pytest.mark.parametrize(
    ("one", "other", "same"), [(1.0, 1.0, True), (math.nan, math.nan, True), (1.0, 2.0, False)]
)
def test_measures_again_are_the_same_bits_or_both_nothing(one: float, other: float, same: bool) -> None:
    assert campaign._same(one, other) is same
    assert not campaign._same(2.0, math.nan)
    assert not campaign._same(math.nan, 2.0)


def test_targets_are_told_by_the_visits_that_follow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: measured of all visits, followed ones counted; median σ, rms error in µrad and mm, and rms of error over σ
    of the followed ones alone; a target without any has empty cells."""

    def visit(mode: TrackMode, error: float, sigma: float) -> Any:
        return SimpleNamespace(mode=mode, after=mode, error=error, sigma=sigma)

    # The state is what the last visit left.
    followed = [visit(TrackMode.TRACK, error, sigma) for error, sigma in ((3.0, 1.0), (4.0, 2.0), (0.0, 8.0))]
    visits = {"u": [visit(TrackMode.SEARCH, 90.0, 90.0), *followed], "v": []}

    def errors_of(records: list[Any]) -> tuple[np.ndarray, np.ndarray]:
        scale = np.array([1e-6, 2e-6, 5e-3])
        return tuple(
            np.array([[getattr(one, name)] for one in records]).reshape(-1, 1) * scale
            for name in ("error", "sigma")
        )  # type: ignore[return-value]

    monkeypatch.setattr(track_summary, "errors_of", errors_of)
    track: Any = SimpleNamespace(
        targets=[SimpleNamespace(name=name) for name in visits], of=visits.__getitem__
    )
    head, first, second = tracking._target_rows(track)
    assert head[:4] == ["target", "state", "measured", "followed"]
    assert head[4:] == ["σΘ µrad", "rms", "rms/σ", "σφ µrad", "rms", "rms/σ", "σR mm", "rms", "rms/σ"]
    rms, pull = math.sqrt(25.0 / 3.0), math.sqrt((9.0 + 4.0) / 3.0)
    expected = [f"{value:.3g}" for scale in (1, 2, 5) for value in (2.0 * scale, rms * scale, pull)]
    assert first == ["u", "track", "4/4", "3", *expected]
    assert second == ["v", "", "0/0", "0", *9 * [""]]


def test_poses_are_told_by_their_valid_ones() -> None:
    """Claim: valid ones of all; rms errors of those whose truth is known, in mm and mrad; empty cells where none is."""
    error = np.arange(24.0).reshape(4, 6) * 1e-3
    error[3, 2] = math.nan
    status = np.array([PoseStatus.VALID, PoseStatus.AMBIGUOUS, PoseStatus.VALID, PoseStatus.VALID])
    one: Any = SimpleNamespace(label="u", method="joint", time=np.zeros(4), status=status, error=error)
    none: Any = SimpleNamespace(
        label="v", method="xyz", time=np.zeros(1), status=np.array([PoseStatus.AMBIGUOUS]), error=error[:1]
    )
    head, first, second = tracking._pose_rows([one, none])
    rms = [f"{math.sqrt((a**2 + (12.0 + a) ** 2) / 2.0):.3g}" for a in range(6)]
    assert first == ["u", "joint", "3/4", *rms]
    assert second == ["v", "xyz", "0/1", *6 * [""]]
    assert len(head) == len(first) == len(second)


def test_scanner_and_camera_are_told_by_differences_over_sigma(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: rms of the difference over its σ, axis by axis; empty cells where they have no time in common."""
    difference, sigma = np.array([[3.0, 1.0], [8.0, 1.0]]), np.array([[1.0, 2.0], [2.0, 4.0]])
    scanner = SimpleNamespace(label="u", method="joint")
    pairs = [
        SimpleNamespace(
            scanner=scanner, time=np.zeros(2), difference=np.tile(difference, (1, 3)), sigma=np.tile(sigma, (1, 3))
        ),
        SimpleNamespace(scanner=scanner, time=np.zeros(0), difference=np.zeros((0, 6)), sigma=np.ones((0, 6))),
    ]  # fmt: skip
    monkeypatch.setattr(tracking, "beside_camera", lambda _: pairs)
    head, first, second = tracking._beside_rows([])
    assert first == ["u", "joint", "2", *3 * [f"{math.sqrt(12.5):.3g}", f"{math.sqrt(0.15625):.3g}"]]
    assert second == ["u", "joint", "0", *6 * [""]]
    assert len(head) == len(first) == len(second)


def test_times_of_runs_are_told_by_what_they_simulate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: shots by their rate, more slowly in proportion to paths and bounces beyond the first, and the background's
    paths, in proportion to its bounces, of which four are usual; of a track its patterns, and the camera's pixels."""
    monkeypatch.setattr(plan, "background_paths", lambda _: 8_800_000)
    monkeypatch.setattr(plan, "patterns", lambda _: 600)
    monkeypatch.setattr(plan, "_frames", lambda _: 12)
    scenario: Any = SimpleNamespace(
        scan=SimpleNamespace(layout="image"), open_scan=SimpleNamespace(shots=600_000),
        transport=SimpleNamespace(bounces=1, bounce_paths=15, background_bounces=6),
        camera=SimpleNamespace(interior=SimpleNamespace(rows=100, columns=500)),
    )  # fmt: skip
    assert plan.run_seconds(scenario) == pytest.approx(3.0 + 2.0 * 1.5)
    scenario.transport.bounces = 4
    assert plan.run_seconds(scenario) == pytest.approx(3.0 * 0.2 * 15 * 3 + 3.0)
    scenario.transport.bounce_paths = 1
    assert plan.run_seconds(scenario) == pytest.approx(3.0 + 3.0)
    scenario.scan.layout = "visits"
    assert plan.run_seconds(scenario) == pytest.approx(600 / 150 + 12 * 100 * 500 / 300_000)


def test_hours_of_background_are_warned_of(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a sentence from half an hour on, that says the hours, the directions and the rows; none before."""
    monkeypatch.setattr(plan, "background_bins", lambda _: 12_345)
    monkeypatch.setattr(plan, "background_rows", lambda _: (678, 9))
    scenario: Any = SimpleNamespace(transport=SimpleNamespace(background_bounces=4))
    for hours, warned in ((0.499, False), (0.501, True), (3.14, True)):
        monkeypatch.setattr(plan, "background_paths", lambda _, hours=hours: 4.4e6 * 3600.0 * hours)
        found = plan.slow(scenario)
        assert bool(found) is warned
        if found:
            assert (
                f"12,345 directions, a pixel wide and in each of 678 rows, and takes about {hours:.2g} h"
                in found[0]
            )


def test_tables_stand_in_columns_in_a_pipe_and_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Claim: words of the columns that are named begin below one another, all others end so; nothing is lost."""
    rows = [["law", "worst", "error"], ["a", "right", "0.5 mm"], ["longer", "up", "12.25 mm"]]
    for terminal in (False, True):
        monkeypatch.setattr("sys.stdout.isatty", lambda terminal=terminal: terminal)
        tables.print_rows(rows, left=(0, 2))
        told = re.sub(r"\x1b\[[0-9;]*m", "", capsys.readouterr().out)
        lines = [line for line in told.splitlines() if "━" not in line and "─" not in line]
        assert len(lines) == 3
        places = [[line.find(word) for word in row] for line, row in zip(lines, rows, strict=True)]
        first, second, third = zip(*places, strict=True)
        assert len(set(first)) == len(set(third)) == 1
        assert len({place + len(row[1]) for place, row in zip(second, rows, strict=True)}) == 1
        tables.print_table({"folder": "there", "at": "12:30"})
        lines = re.sub(r"\x1b\[[0-9;]*m", "", capsys.readouterr().out).splitlines()
        assert [line.split() for line in lines] == [["folder", "there"], ["at", "12:30"]]
        assert lines[0].find("there") == lines[1].find("12:30")


def test_numbered_files_are_named_by_the_first_and_the_last() -> None:
    """Claim: names that differ in a number of three digits or more are one group, each where it began."""
    names = ["a.png", "f_000.png", "b2.csv", "f_001.png", "b3.csv", "f_017.png", "g_005.png"]
    assert tables.named_files(names) == "a.png, f_000.png … f_017.png, b2.csv, b3.csv, g_005.png"
