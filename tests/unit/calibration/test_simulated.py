"""Simulated sightings: which visits count, and what of their errors a mean takes away."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_track import make_track

from scanner_sim.calibration import simulated
from scanner_sim.calibration.setup import read_setup
from scanner_sim.calibration.simulated import _BEFORE, _duration, _mean, _pose, _scenario, _table
from scanner_sim.config.scanner import Scanner
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.streams import Stream, host_generator
from scanner_sim.tracking.record import TrackStatus, is_place
from scanner_sim.tracking.scan import TrackScan
from scanner_sim.tracking.state import TrackMode

PLAN = """\
schema: 1
base: base.yaml
seed: 4
parameters: {base: 0.1 mm}
boards:
  - {name: near, array: {rows: 2, columns: 2, spacing: [0.2 m, 0.2 m], diameter: 50 mm, plate: 0.1 m},
     position: [0.1 m, 0.2 m, 2 m]}
stations: [{name: s1}, {name: s2, position: [0.2 m, 0 m, -0.3 m], rotation: {axis: [0, 1, 0], angle: 10 deg}}]
"""
BASE = "schema: 1\nscan: {type: raster, rows: 4, columns: 4, horizontal: [-5 deg, 5 deg], vertical: [-5 deg, 5 deg]}\n"


def test_a_sighting_is_the_mean_of_the_visits_that_followed() -> None:
    """Claim: visits that search do not count; white parts fall with the number of visits, lasting ones do not.

    The mirrors wobble anew from visit to visit, 80 ms apart, if that takes them 10 ms, and not if it takes an hour.
    What unlike pixels and wobble do is told apart, as standard deviations.
    """
    track = make_track(seconds=1.2)
    target = track.targets[0].name
    for lasts, share in ((0.01, 1.0), (3600.0, 0.0)):
        wobble = replace_errors(wobble=9e-12, wobble_time=lasts, wobble_angle=0.05)
        records = [
            replace(one, mode=TrackMode.TRACK, errors=replace(one.errors, **wobble))
            for one in track.of(target)
            if one.status is TrackStatus.MEASURED
        ]
        assert len(records) > 3
        astray = replace(records[0], mode=TrackMode.ACQUIRE, position=records[0].position + 1.0)
        found = _mean(replace(track, records=(astray, *records)), target)
        assert found is not None
        position, covariance, unlike = found
        np.testing.assert_allclose(position, np.mean([one.position for one in records], axis=0), rtol=1e-12)
        wanted = np.mean([one.errors.white for one in records], axis=0) / len(records)
        wanted = wanted + np.mean([one.errors.surface + one.errors.shared for one in records], axis=0)
        wanted -= np.diag([9e-12, 9e-12, 0.0]) * share * (1.0 - 1.0 / len(records))
        np.testing.assert_allclose(covariance, wanted, rtol=1e-3, atol=1e-15)
        left = 3e-6 * (1.0 - share * (1.0 - 1.0 / len(records))) ** 0.5
        when = np.mean([one.time for one in records])
        np.testing.assert_allclose(unlike, (2e-4, 80.0, 1.2, left, when), rtol=1e-3)


def replace_errors(**changes: float) -> dict[str, np.ndarray]:
    """Errors of made-up visits whose images stay on their pixels."""
    numbers = {"pixels": 4e-8, "image": 80.0, "image_width": 1.2} | changes
    return {name: np.array(value) for name, value in numbers.items()}


def test_a_table_has_the_sightings_of_each_station_and_names_what_is_lost() -> None:
    """Claim: of two stations with targets in view the followed ones stand in the table, station after station, each
    with its own mean, covariance and parts; a target that was never followed is named, and not in the table."""
    track = make_track(seconds=1.2)
    records = [
        replace(
            one,
            mode=TrackMode.TRACK,
            errors=replace(one.errors, **replace_errors(wobble=0.0, wobble_time=1.0)),
        )
        for one in track.records
        if one.status is TrackStatus.MEASURED
    ]
    names = [target.name for target in track.targets]
    followed = replace(track, records=tuple(records))
    partly = replace(track, records=tuple(one for one in records if one.target != names[2]))
    stations = [SimpleNamespace(name="s1"), SimpleNamespace(name="s2")]
    setup: Any = SimpleNamespace(plan=SimpleNamespace(stations=stations))
    seen = [{names[0]: "a/1"}, {names[1]: "a/2", names[2]: "b/1"}]
    table, warnings = _table(setup, seen, [followed, partly])
    assert (table.station, table.target) == (("s1", "s2"), ("a/1", "a/2"))
    assert warnings == ("station s2 could not follow b/1: hidden, too near or too far",)
    for row, (one, name) in enumerate(((followed, names[0]), (partly, names[1]))):
        found = _mean(one, name)
        assert found is not None
        np.testing.assert_array_equal(table.position[row], found[0])
        np.testing.assert_array_equal(table.covariance[row], found[1])
        parts = [getattr(table, part)[row] for part in ("pixels", "image", "image_width", "wobble", "time")]
        np.testing.assert_array_equal(parts, found[2])


def test_a_station_looks_as_long_as_its_visits_take() -> None:
    """Claim: for the visits that are wanted and those before, one period for each target of each; and a board two
    metres before a station that is turned by a right angle about y stands where the inverse of its pose has it."""
    base: Any = SimpleNamespace(scanner=Scanner())
    plan: Any = SimpleNamespace(visits=7)
    setup: Any = SimpleNamespace(base=base, plan=plan)
    scan = TrackScan(type="track", targets=("any",))
    period = scan.visiting.period(scan.pattern.points, base.scanner.dwell, 5, base.scanner.galvanometers)
    assert _duration(setup, 5) == pytest.approx(5.0 * period * (7 + _BEFORE))
    turn = np.eye(4)
    turn[:3, :3] = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
    turn[:3, 3] = [1.0, 2.0, 3.0]
    there = np.eye(4)
    there[:3, 3] = turn[:3, 3] + 2.0 * turn[:3, 2]
    plan.stations = [SimpleNamespace(field_from_here=lambda: turn)]
    board: Any = SimpleNamespace(field_from_here=lambda: there)
    pose = _pose(setup, 0, board)
    np.testing.assert_allclose(pose[:3, 3], [0.0, 0.0, 2.0], atol=1e-12)
    np.testing.assert_allclose(pose[:3, :3], turn[:3, :3].T, atol=1e-12)


def test_each_station_has_a_scene_and_noise_of_its_own(tmp_path: Path) -> None:
    """Claim: seeds are those of the station's number after survey and bars, as the plan's seed has them; what a station
    does not see is expected beyond the mirrors, each target elsewhere, and the thousandth of them where a run may look
    for one; a scan lasts as long as what is seen takes; and boards stand where they are from the station."""
    (tmp_path / "base.yaml").write_text(BASE, encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    setup = read_setup(tmp_path / "plan.yaml")
    every = [f"near/{number}" for number in (1, 2, 3, 4)]
    for number in (0, 1):
        made = _scenario(setup, number, every, {"near/2": "", "near/3": ""})
        drawn = host_generator(4, Stream.SURVEY, 2 + number).integers(2**62)
        assert made.seed == int(drawn)
        told = [(one.target, one.expected) for one in made.following.targets]
        assert told == [
            ("near/1", (2.0, 0.0, 1e3)), ("near/2", None), ("near/3", None), ("near/4", (2.015, 0.0, 1e3)),
        ]  # fmt: skip
        assert is_place(np.array([2.0 + 999 * 0.005, 0.0, 1e3]))
        assert made.scanner.mirrors.max_deflection < 2.0
        assert made.following.duration == pytest.approx(_duration(setup, 2), rel=1e-12)
        (board,) = made.scene.objects
        station = setup.plan.stations[number].field_from_here()
        there = np.linalg.inv(station) @ [0.1, 0.2, 2.0, 1.0]
        assert made.ranging == setup.rangefinder
        np.testing.assert_allclose(board.pose_at(np.array([0.0]))[0, :3, 3], there[:3], atol=1e-9)


def test_stations_are_dark_and_have_no_camera(tmp_path: Path) -> None:
    """Claim: of a scenario that is lit and has poses by its camera a self-calibration takes the instrument alone."""
    lit = "lighting: {sun: {direction: [0.3, -0.5, -0.8]}}\npose: {methods: [camera, joint]}\n"
    array = "array: {rows: 2, columns: 2, diameter: 50 mm, plate: 0.1 m}"
    scene = f"scene: {{objects: [{{name: dots, {array}, position: [0 m, 0 m, 5 m]}}]}}\n"
    track = "scan: {type: track, targets: [dots], duration: 1 s}\n"
    (tmp_path / "base.yaml").write_text(f"schema: 1\n{lit}{scene}{track}", encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    setup = read_setup(tmp_path / "plan.yaml")
    assert setup.base.photographed
    made = _scenario(setup, 0, ["near/1"], {"near/1": ""})
    assert made.lighting.sky().dark
    assert not made.photographed


def test_progress_is_told_in_milliseconds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of seconds that are measured the caller hears milliseconds, of those that are wanted as well."""
    (tmp_path / "base.yaml").write_text(BASE, encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")

    def measured(
        scenarios: list[Scenario], *, progress: Callable[[float, float], None], **_: Any
    ) -> list[Any]:
        progress(0.7314, 2.6)
        return [SimpleNamespace(of=lambda name: []) for _ in scenarios]

    monkeypatch.setattr(simulated, "track_many", measured)
    told: list[tuple[int, int]] = []
    table, warnings = simulated.simulated_sightings(
        read_setup(tmp_path / "plan.yaml"), progress=lambda *parts: told.append(parts)
    )
    assert told == [(731, 2600)]
    assert table.station == ()
    assert len(warnings) == 2
