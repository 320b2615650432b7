"""Runs side by side are what they are alone, to the last byte."""

from __future__ import annotations

from typing import Any

import pytest
from same_bytes import content

from scanner_sim import InputError, Scenario, load_scenario, track, track_many
from scanner_sim.instrument.closed_loop import frozen_instrument
from scanner_sim.render.device import Device
from scanner_sim.tracking.record import Track, TrackStatus
from scanner_sim.tracking.state import TrackMode

STILL = {"type": "twist"}
SUN = {"sun": {"direction": [-0.35, -0.45, -0.8]}}


def scenario(seed: int, motion: dict[str, Any] = STILL, duration: float = 0.15, **more: Any) -> Scenario:
    """Return a run after two targets of an object that moves, with beamlets enough for the law alone."""
    array = {"diameter": 0.1, "plate": 0.3, "columns": 2, "spacing": [0.4, 0.4]}
    node = {"name": "node", "array": array, "position": [0.1, 0.0, 6.0], "motion": motion} | more.pop(
        "node", {}
    )
    scan = {"type": "track", "targets": ["node"], "duration": duration} | more.pop("scan", {})
    whole = {"schema": 1, "seed": seed, "scene": {"objects": [node]}, "scan": scan}
    return load_scenario(whole | {"transport": {"pattern_beamlets": 19, "background_samples": 2}} | more)


def assert_alike(scenarios: list[Scenario]) -> tuple[Track, ...]:
    together = track_many(scenarios)
    for run, known in zip(together, scenarios, strict=True):
        assert content(run) == content(track(known))
    return together


def test_runs_side_by_side_are_those_alone(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: in one company of runs that end early, lose their targets, begin in the wrong place, leave the field of
    view and turn, each is the very run that it is alone: it can fail by any sum whose order depends on the company.

    Six runs in launches of four: of three patterns the last is launched twice.
    """
    monkeypatch.setattr(frozen_instrument, "_MOST_SHOTS", 4 * 128)
    away = {"type": "twist", "velocity": [0.0, 4.0, 0.0]}
    turning = {"type": "twist", "velocity": [0.02, 0.0, 0.0], "turn_rate": [0.0, 0.5, 0.3]}
    wrong = [
        {"target": "node/1", "expected": [-0.022, 0.003, 6.0]},
        {"target": "node/2", "expected": [0.7, 0.0, 6.0]},
    ]
    runs = assert_alike(
        [
            scenario(1),
            scenario(2, duration=0.06),
            scenario(2**62 + 3, away),
            scenario(4, turning, node={"rotation": {"axis": "y", "angle": 0.3}}),
            scenario(5, scan={"targets": wrong}),
            scenario(1),
        ]
    )
    assert len(runs[1].records) < len(runs[0].records)
    assert {record.mode for record in runs[0].records} >= {TrackMode.SEARCH, TrackMode.TRACK}
    assert any(record.after is TrackMode.LOST for record in runs[2].records)
    statuses = {record.status for record in runs[4].records}
    assert statuses >= {TrackStatus.OUT_OF_VIEW, TrackStatus.MEASURED}
    assert content(runs[0]) == content(runs[5])
    assert content(runs[0].records) != content(runs[3].records)


@pytest.mark.slow
@pytest.mark.parametrize("change", [{"lighting": SUN}, {"ranging": "tof"}, {"ranging": "both"}])
def test_any_light_and_ranging_goes_side_by_side(device: Device, change: dict[str, Any]) -> None:
    """Claim: the same under the Sun, whose background has the run's own seed, and by time of flight.

    The third run searches where nothing is: by larger patterns, whose windows of the background no other run has.
    """
    moving = {"type": "twist", "velocity": [0.3, 0.0, 0.0]}
    wide = {"search_growth": 2.5, "search_most": 0.1}
    nowhere = [{"target": f"node/{n}", "expected": [-0.2, 0.1 * n, 6.0]} for n in (1, 2)]
    assert_alike(
        [
            scenario(1, duration=0.08, **change),
            scenario(2, moving, duration=0.08, **change),
            scenario(3, duration=0.08, scan={"targets": nowhere, "tracker": wide}, **change),
        ]
    )


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"scanner": {"laser": {"power": 0.02}}}, "scanner.laser.power"),
        ({"node": {"motion": None}}, "scene.objects[0]"),
        ({"scan": {"pattern": {"points": 64}}}, "scan.pattern.points"),
        ({"lighting": SUN}, "lighting"),
    ],
)
def test_what_must_be_alike_is_named(change: dict[str, Any], key: str) -> None:
    with pytest.raises(InputError, match="scenario 3 differs from the first in") as raised:
        track_many([scenario(1), scenario(2), scenario(3, **change)])
    assert key in str(raised.value)


def test_no_scenarios_are_no_run() -> None:
    with pytest.raises(InputError, match="no scenarios"):
        track_many([])


def test_an_instrument_built_as_designed_follows_as_the_design_does(device: Device) -> None:
    """Claim: departures of zero, given or drawn, change no byte of a track; a departure does."""
    none = {
        "base": 0.0,
        "theta_zero": 0.0,
        "phi_scale": 0.0,
        "array_tilt": 0.0,
        "radial_1": 0.0,
        "power_noise": 0.0,
    }
    designed = content(track(scenario(3)).records)
    for built, alike in ((none, True), ({"base": 1e-4}, False)):
        found = track(scenario(3, scanner={"as_built": {"seed": 5, **built}}))
        assert (content(found.records) == designed) is alike
