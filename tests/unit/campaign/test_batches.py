"""Batches: each run once, those of one scene together, whoever takes them and whenever."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from scanner_sim.campaign.batches import MOST_RUNS, MOST_TRACKS, Batches, most_together
from scanner_sim.campaign.reading import read_campaign
from scanner_sim.campaign.runs import Campaign
from scanner_sim.config import load_scenario

PLAN = """\
schema: 1
base: small.yaml
vary:
  - keys: {scanner.laser.power: [5 mW, 10 mW, 15 mW]}
  - keys: {processing.threshold: [5, 6, 7, 8], "scene.objects.wall.position[2]": [9 m, 8 m, 9 m, 7 m]}
  - keys: {lighting.sun.direction: [[0, 0.6, 0.8], [0, -0.6, 0.8]]}
repeat: 5
"""
WALL, SUN = "scene.objects.wall.position[2]", "lighting.sun.direction"


@pytest.fixture
def campaign(tmp_path: Path, small_scenario: str) -> Campaign:
    sunlit = small_scenario + "lighting: {sun: {direction: [0, 0.6, 0.8]}}\n"
    (tmp_path / "small.yaml").write_text(sunlit, encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    return read_campaign(tmp_path / "plan.yaml")


def scene(campaign: Campaign, run: int) -> object:
    return campaign.values(run)[WALL]


def light(campaign: Campaign, run: int) -> str:
    return repr((scene(campaign, run), campaign.values(run)[SUN]))


def changes(values: list[object]) -> int:
    """Return how often something has to be made anew, if the last one is kept."""
    return sum(one != other for one, other in zip([None, *values[:-1]], values, strict=True))


def test_one_worker_makes_each_scene_and_each_light_once(campaign: Campaign) -> None:
    batches, order = Batches(campaign, np.arange(120)), list[int]()
    while taken := batches.take("one"):
        order += taken
    assert sorted(order) == list(range(120))
    assert changes([scene(campaign, run) for run in order]) == 3
    assert changes([light(campaign, run) for run in order]) == 6
    alike = [tuple(map(repr, campaign.values(run).values())) for run in order]
    assert changes(list(alike)) == 24, "repetitions stand next to one another"


@pytest.mark.parametrize("seed", range(20))
def test_every_run_is_given_out_once_to_workers_that_come_and_go(campaign: Campaign, seed: int) -> None:
    """Claim: whatever part is left, and whoever takes a batch at whatever moment, each run is taken once."""
    draw = random.Random(seed)
    left = np.array(sorted(draw.sample(range(120), draw.randint(1, 120))))
    batches, taken, workers = Batches(campaign, left), list[int](), ["a", "b"]
    while len(batches):
        if draw.random() < 0.1:
            workers[draw.randrange(2)] = f"new {len(taken)}"
        found = batches.take(draw.choice(workers), 2)
        assert 0 < len(found) <= MOST_RUNS
        taken += found
    assert sorted(taken) == left.tolist()
    assert batches.take("a", 2) == []


@pytest.mark.parametrize("seed", range(5))
def test_a_batch_that_has_begun_takes_nothing_of_another(
    monkeypatch: pytest.MonkeyPatch, campaign: Campaign, seed: int
) -> None:
    """Claim: once each scene is begun, a batch is of runs that follow one another: whoever comes to the end of his own
    ends his batch there, and takes half of another's with the next one."""
    monkeypatch.setattr(
        "scanner_sim.campaign.batches._in_order", lambda *_: (np.arange(60), np.array([0, 30, 60]))
    )
    draw = random.Random(seed)
    batches = Batches(campaign, np.arange(60))
    assert batches.take("a", 2)[0] == 0
    assert batches.take("b", 2)[0] == 30
    while len(batches):
        assert (np.diff(batches.take(draw.choice("ab"), 2)) == 1).all()


def test_two_workers_share_scenes_out_and_no_one_waits(campaign: Campaign) -> None:
    """Claim: workers in turns make fewer scenes than in the order of the plan, and at the end half of what is left."""
    batches = Batches(campaign, np.arange(120))
    own: dict[str, list[int]] = {"a": [], "b": []}
    last = {"a": 0, "b": 0}
    while len(batches):
        for worker, runs in own.items():
            taken = batches.take(worker, 2)
            runs += taken
            last[worker] = len(taken) or last[worker]
    built = sum(changes([scene(campaign, run) for run in runs]) for runs in own.values())
    assert built <= 3 + 2, "each worker may begin a scene, and take over a part of another's"
    assert abs(len(own["a"]) - len(own["b"])) <= MOST_RUNS
    assert max(last.values()) <= 4


def test_a_batch_holds_so_many_runs_or_voxels(repo_root: Path, small_scenario: str, tmp_path: Path) -> None:
    (tmp_path / "small.yaml").write_text(small_scenario, encoding="utf-8")
    small = load_scenario(tmp_path / "small.yaml")
    assert most_together(small) == MOST_RUNS
    assert most_together(small.replace({"scan.rows": 64, "scan.columns": 64})) == 16
    assert most_together(small.replace({"scan.rows": 512, "scan.columns": 512})) == 1
    assert most_together(load_scenario(repo_root / "configs" / "track_still.yaml")) == MOST_TRACKS
