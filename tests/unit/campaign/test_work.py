"""Runs that are made together: a row for each, and a fault for those alone that have one."""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.campaign import work as work_module
from scanner_sim.campaign.reading import read_campaign
from scanner_sim.campaign.runs import Campaign
from scanner_sim.campaign.store import Row
from scanner_sim.campaign.work import Settings, task_of, work
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError, RunError
from scanner_sim.products.settings import Output

PLAN = """\
schema: 1
base: small.yaml
vary:
  - keys: {scanner.rate: [1 kHz, 5 kHz]}
  - keys: {ranging: [triangulation, tof], scanner.lidar.pulse.repetition_rate: [2 kHz, 2 kHz]}
repeat: 3
measure: [valid_share]
"""


@pytest.fixture
def campaign(tmp_path: Path, small_scenario: str) -> Campaign:
    """Twelve runs, of which the last three are impossible."""
    (tmp_path / "small.yaml").write_text(small_scenario, encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    return read_campaign(tmp_path / "plan.yaml")


def shown(scenario: Scenario) -> SimpleNamespace:
    """Return what stands for an image: its share of valid voxels tells its seed."""
    return SimpleNamespace(valid=np.array([scenario.seed % 1000 / 1000.0]))


def rows_of(campaign: Campaign, *runs: int) -> dict[int, Row]:
    task = task_of(campaign, pickle.dumps(campaign.base), runs, Settings(Path("out"), None, "cpu", None))
    return {row.run: replace(row, seconds=0.0) for row in work(task)}


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize("culprit", [1, 4])
def test_a_run_that_fails_takes_none_of_its_batch_with_it(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch, culprit: int
) -> None:
    """Claim: where a batch fails at one of its runs, that one has the fault, and the others have their numbers."""
    bad, sizes = campaign.seed(culprit), []

    def many(scenarios: Iterable[Scenario], **_: object) -> Iterator[SimpleNamespace]:
        together = list(scenarios)
        sizes.append(len(together))
        if together[0].seed == campaign.seed(2) and len(together) > 1:
            raise MemoryError
        for scenario in together:
            if scenario.seed == bad:
                raise RunError("the laser melts.")
            yield shown(scenario)

    monkeypatch.setattr(work_module, "simulate_many", many)
    found = rows_of(campaign, *range(6))
    assert sizes[0] == 6
    assert sorted(found) == list(range(6))
    assert {run: row.fault for run, row in found.items() if row.fault} == {culprit: "the laser melts."}
    whole = [row for run, row in found.items() if run != culprit]
    assert [row.measures["valid_share"] for row in whole] == [row.seed % 1000 / 1000.0 for row in whole]
    assert [found[run].seed for run in range(6)] == [campaign.seed(run) for run in range(6)]


@pytest.mark.usefixtures("device")
def test_a_scenario_that_cannot_be_is_not_made_with_the_others(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Scenario] = []

    def many(scenarios: Iterable[Scenario], **_: object) -> Iterator[SimpleNamespace]:
        for scenario in scenarios:
            made.append(scenario)
            yield shown(scenario)

    monkeypatch.setattr(work_module, "simulate_many", many)
    found = rows_of(campaign, *range(12))
    assert [run for run, row in found.items() if "pulses a second" in row.fault] == [9, 10, 11]
    assert made == [campaign.scenario(run) for run in range(9)], "as each is by itself"


@pytest.mark.slow
@pytest.mark.usefixtures("device")
@pytest.mark.parametrize("base", ["small", "spiral", "track"])
def test_rows_are_the_same_in_any_batch(
    tmp_path: Path, small_scenario: str, repo_root: Path, base: str
) -> None:
    """Claim: each row is, to the last bit, that of the run alone, whatever goes with it; images, shots, and tracks."""
    (tmp_path / "small.yaml").write_text(small_scenario, encoding="utf-8")
    start, measure = "base: small.yaml", "[sigma_range, rms_range]"
    vary = "keys: {scanner.laser.power: [5 mW, 15 mW]}"
    if base == "spiral":
        start += "\nset: {scan: {type: spiral, radius: 1 deg, turns: 2, points: 40}}"
    if base == "track":
        start = f"base: {repo_root}/configs/track_still.yaml\nset: {{scan.duration: 30 ms}}"
        measure = "[measured_share, rms_target_range]"
    text = f"schema: 1\n{start}\nvary: [{{{vary}}}]\nrepeat: 3\nmeasure: {measure}\n"
    (tmp_path / "plan.yaml").write_text(text, encoding="utf-8")
    campaign = read_campaign(tmp_path / "plan.yaml")
    together = rows_of(campaign, *range(6))
    assert not any(row.fault for row in together.values())
    assert together == rows_of(campaign, 4, 0, 3) | rows_of(campaign, 5, 2, 1)
    alone = [rows_of(campaign, run) for run in (0, 4)]
    assert all(together[run] == row for one in alone for run, row in one.items())


def test_measures_have_the_poses_before_the_scanner_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of a track the poses of single objects, not those of one to another, which files have besides; of all else
    the result as it is."""
    poses = [SimpleNamespace(relative_to=other) for other in ("", "base", "")]
    asked: list[object] = []
    monkeypatch.setattr(
        work_module, "every_pose", lambda *given, **more: asked.append((given, more)) or poses
    )
    track = object.__new__(work_module.Track)
    found = work_module.outcome_of(track, "cpu", "keep")  # type: ignore[arg-type]
    assert found.track is track
    assert found.poses == (poses[0], poses[2])
    assert found.every_pose == tuple(poses)
    assert asked == [((track,), {"device": "cpu", "keep": "keep"})]
    scan = SimpleNamespace()
    found = work_module.outcome_of(scan)  # type: ignore[arg-type]
    assert (found.scan, found.track, found.poses) == (scan, None, ())


def test_a_kept_track_has_the_poses_of_one_object_to_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the files of a kept run hold all of its poses, as those of ``run`` do; no pictures are drawn."""
    written: list[Any] = []
    monkeypatch.setattr(
        work_module, "write_track", lambda *given, **more: written.append((given, more)) or ()
    )
    track, before, between = object(), object(), object()
    outcome: Any = SimpleNamespace(track=track, poses=(before,), every_pose=(before, between))
    scenario: Any = SimpleNamespace(output=Output())
    assert work_module.write_outcome(outcome, scenario, Path("kept")) == ()
    (((made, folder, output), more),) = written
    assert (made, folder, output.pictures) == (track, Path("kept"), False)
    assert more == {"poses": (before, between), "frames": None, "overwrite": True}


@pytest.mark.parametrize(("runs", "kept"), [("all", (3, 7)), ("none", ()), ((7, 9), (7,))])
def test_a_job_knows_its_seed_and_where_it_is_kept(runs: object, kept: tuple[int, ...]) -> None:
    """Claim: by its number in six digits where it is to be kept; a seed that varies is the run's, and one that
    is no number is told as -1."""
    seeds = {3: {"other": 4}, 7: {"seed": 11}, 8: {"seed": "eleven"}}
    told = SimpleNamespace(
        values=seeds.__getitem__,
        seed=lambda run: 100 + run,
        plan=SimpleNamespace(keep=SimpleNamespace(runs=runs)),
    )
    jobs = [work_module._job(told, run, Path("kept")) for run in seeds]  # type: ignore[arg-type]
    assert [(job.run, job.seed, job.values) for job in jobs] == [
        (3, 103, {"other": 4}), (7, 11, {"seed": 11}), (8, -1, {"seed": "eleven"}),
    ]  # fmt: skip
    wanted = {3: Path("kept/000003"), 7: Path("kept/000007")}
    assert [job.kept for job in jobs[:2]] == [wanted[run] if run in kept else None for run in (3, 7)]


def test_alike_runs_next_to_one_another_are_made_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: in their order, each once: images in one call, shots one by one, tracks side by side as far as they are
    alike; with the device and threads that were asked for."""
    asked: list[tuple[str, list[str], object]] = []

    def many(kind: str) -> object:
        def made(scenarios: Iterable[SimpleNamespace], **how: object) -> list[str]:
            names = [one.name for one in scenarios]
            asked.append((kind, names, how))
            return [f"{kind} of {name}" for name in names]

        return made

    def check(scenarios: list[SimpleNamespace]) -> None:
        if len({one.sort for one in scenarios}) > 1:
            raise InputError("unlike", remedy="none")

    monkeypatch.setattr(work_module, "simulate_many", many("image"))
    monkeypatch.setattr(work_module, "track_many", many("track"))
    monkeypatch.setattr(work_module, "simulate_shots", lambda one, **how: many("shots")([one], **how)[0])  # type: ignore[operator]
    monkeypatch.setattr(work_module, "check_alike", check)
    layouts = {"i": "image", "s": "shots", "v": "visits"}
    names = ["i1", "i2", "v1a", "v2a", "v3b", "v4b", "v5b", "v6a", "s1", "s2", "i3"]
    scenarios = [
        SimpleNamespace(name=name, sort=name[-1], scan=SimpleNamespace(layout=layouts[name[0]]))
        for name in names
    ]
    found = list(work_module.simulated(scenarios, "cpu", 3))  # type: ignore[arg-type]
    kinds = {"i": "image", "s": "shots", "v": "track"}
    assert found == [f"{kinds[name[0]]} of {name}" for name in names]
    assert [(kind, own) for kind, own, _ in asked] == [
        ("image", ["i1", "i2"]), ("track", ["v1a", "v2a"]), ("track", ["v3b", "v4b", "v5b"]), ("track", ["v6a"]),
        ("shots", ["s1"]), ("shots", ["s2"]), ("image", ["i3"]),
    ]  # fmt: skip
    assert all(how == {"device": "cpu", "threads": 3} for *_, how in asked)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (RunError("it broke.", remedy="Mend it."), str(RunError("it broke.", remedy="Mend it."))),
        (MemoryError(), "the memory is exhausted."),
        (ZeroDivisionError("by 0"), "unexpected ZeroDivisionError: by 0"),
    ],
)
def test_a_fault_of_a_run_is_a_sentence(error: Exception, words: str) -> None:
    assert work_module._fault(error) == words
