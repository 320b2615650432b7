"""What is warned of in motions: too fast for a dwell or a row, none at all, and placed twice."""

from __future__ import annotations

from typing import Any

import pytest

from scanner_sim import Scenario, load_scenario
from scanner_sim.config.warnings import scenario_warnings

FAR, COLUMNS = 9.0, 50
SUN = {"sun": {"direction": [0.0, 0.5, -1.0]}}


def moving(speed: float, **changes: Any) -> Scenario:
    """Return a scan of a thing that begins 9 m away and moves sideways [m/s]."""
    motion = {"type": "twist", "velocity": [speed, 0.0, 0.0]}
    thing = {
        "name": "thing",
        "shape": "sphere",
        "diameter": 0.5,
        "position": [0.0, 0.0, FAR],
        "material": "z93_white",
    }
    scan = {
        "type": "raster",
        "rows": 2,
        "columns": COLUMNS,
        "horizontal": [-0.1, 0.1],
        "vertical": [-0.1, 0.1],
    }
    given = {"schema": 1, "scene": {"objects": [thing | {"motion": motion}]}, "scan": scan}
    return load_scenario(given | changes)


def said(scenario: Scenario, words: str) -> list[str]:
    return [sentence for sentence in scenario_warnings(scenario) if words in sentence]


@pytest.mark.parametrize(("share", "warned"), [(1.002, True), (0.998, False)])
def test_a_blur_of_three_tenths_of_the_beam_is_told(share: float, warned: bool) -> None:
    """Claim: a motion of 0.3 beam radii in a dwell is the limit; told are the way [mm] and the share of the radius."""
    base = moving(0.0).scanner
    limit = 0.3 * base.laser.radius(FAR) / base.dwell
    found = said(moving(share * limit), "this blur is left out")
    assert bool(found) is warned
    if warned:
        assert (
            f"up to {1e3 * share * limit * base.dwell:.2g} mm during a dwell, {0.3 * share:.2g} of"
            in found[0]
        )


def test_a_pulse_is_too_short_for_a_blur() -> None:
    """Claim: where pulses alone tell the range, what moves in a dwell is not blurred, and none is told."""
    base = moving(0.0).scanner
    speed = 3.0 * base.laser.radius(FAR) / base.dwell
    for ranging, told in (("triangulation", 1), ("both", 1), ("tof", 0)):
        assert len(said(moving(speed, ranging=ranging), "this blur is left out")) == told


@pytest.mark.parametrize("preset", ["nrc_2000", "pulsed_scanner"])
@pytest.mark.parametrize(("share", "warned"), [(1.01, True), (0.99, False)])
def test_shadows_that_lag_visibly_are_told(share: float, warned: bool, preset: str) -> None:
    """Claim: half of what a thing moves by in a row of 50 voxels may be three pixels of the line as wide as they are at
    9 m, or half of the photodiode's field where there is no line; only where there is sunlight, and rows."""
    instrument = {"scanner": {"preset": preset}}
    base = moving(0.0, **instrument).scanner
    if "triangulation" in base.rangefinders:
        angle = 3.0 * base.position_sensor.pitch / base.receiver.focal_length
    else:
        angle = 0.5 * base.lidar.photodiode.field_of_view
    limit = 2.0 * angle * FAR / (COLUMNS * base.dwell)
    words = "the background is that of the row's middle"
    found = said(moving(share * limit, lighting=SUN, **instrument), words)
    assert bool(found) is warned
    if warned:
        assert f"up to {1e3 * share * limit * base.dwell * COLUMNS:.2g} mm during a row" in found[0]
    assert not said(moving(share * limit, **instrument), words)
    spiral = {"type": "spiral", "radius": 0.05, "turns": 5.0, "points": 80}
    assert not said(moving(share * limit, lighting=SUN, scan=spiral, **instrument), words)


def test_a_thing_that_rests_while_it_is_scanned_is_told() -> None:
    assert said(moving(0.0), "'thing' does not move in the")
    assert not said(moving(0.1), "does not move")


TWIST = {"type": "twist", "velocity": [0.0, 0.01, 0.0]}
ORBIT = {"type": "clohessy_wiltshire", "position": [-FAR, 0.0, 0.0], "velocity": [0.05, 0.0, 0.0]}
POINTS = [{"time": time, "position": [0.0, 0.01 * time, FAR]} for time in (0.0, 60.0)]
PATH = {"type": "waypoints", "points": POINTS}
MOVES = {"type": "moves", "moves": [{"time": 0.0005, "position": [0.0, 0.0, FAR]}]}


@pytest.mark.parametrize(
    ("motion", "by_place", "by_turn"),
    [
        (TWIST, "", ""),
        (ORBIT, "position is", ""),
        (PATH, "position and rotation are", "position and rotation are"),
        (MOVES, "position and rotation are", "position and rotation are"),
        (MOVES | {"before": TWIST}, "", ""),
        (MOVES | {"before": ORBIT}, "position is", ""),
    ],
)
def test_what_a_motion_does_not_ask_for_is_told(motion: dict[str, Any], by_place: str, by_turn: str) -> None:
    """Claim: a twist begins at a thing's own pose, an orbit takes its rotation alone, all else nothing; and so where
    that is a motion until the first move."""
    thing = {
        "name": "thing",
        "shape": "box",
        "size": [0.5, 0.4, 0.3],
        "material": "z93_white",
        "motion": motion,
    }
    turned, placed = {"rotation": {"axis": "y", "angle": 0.3}}, {"position": [0.0, 0.0, FAR]}
    for given, unused in ((placed, by_place), (turned, by_turn)):
        scenario = moving(0.0, scene={"objects": [thing | given]})
        start = scenario.scene.objects[0].pose_at(0.0)
        still = moving(0.0, scene={"objects": [thing]}).scene.objects[0].pose_at(0.0)
        found = said(scenario, "is placed by its")
        assert [words.endswith(f": its {unused} not used") for words in found] == [True] * bool(unused)
        assert (start == still).all() == bool(unused)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("kind", ["velocity", "turn_rate"])
def test_a_thing_that_goes_or_turns_about_any_axis_moves(kind: str, axis: int) -> None:
    """Claim: a way along one axis is a motion, and so is a turn about one axis while the origin stays where it is."""
    thing = {"name": "thing", "shape": "box", "size": [0.5, 0.4, 0.3], "position": [0.0, 0.0, FAR]}
    for rate, rests in ((0.0, True), (0.01, False)):
        motion = {"type": "twist", kind: [rate if axis == number else 0.0 for number in range(3)]}
        item = thing | {"material": "z93_white", "motion": motion}
        assert bool(said(moving(0.0, scene={"objects": [item]}), "does not move in the")) is rests


def test_a_thing_that_only_turns_between_waypoints_moves() -> None:
    """Claim: waypoints of one position are a motion where the thing is turned from one to the other, and rest else."""
    for degrees, rests in ((0.0, True), (5.0, False)):
        points = [
            {"time": 0.0, "position": [0.0, 0.0, FAR]},
            {
                "time": 60.0,
                "position": [0.0, 0.0, FAR],
                "rotation": [{"axis": "z", "angle": f"{degrees} deg"}],
            },
        ]
        thing = {"name": "thing", "shape": "box", "size": [0.5, 0.4, 0.3], "material": "z93_white"}
        item = thing | {"motion": {"type": "waypoints", "points": points}}
        assert bool(said(moving(0.0, scene={"objects": [item]}), "does not move in the")) is rests


@pytest.mark.parametrize(
    ("place", "told"), [((0.0, 0.0, 1.0), True), ((0.0, 0.0, 2.0), False), ((1.2, 1.2, 0.5), False)]
)
def test_things_nearer_than_the_array_sees_are_told(place: tuple[float, float, float], told: bool) -> None:
    """Claim: by the distance of their origin, 1.5625 m here, before the scanner."""
    thing = {"name": "thing", "shape": "sphere", "diameter": 0.1, "position": place, "material": "z93_white"}
    told_of = moving(0.0, scene={"objects": [thing]})
    assert bool(said(told_of, "nearer than the 1.56 m")) is told
    behind = moving(0.0, scene={"objects": [thing | {"position": (0.0, 0.0, -1.0)}]})
    assert not said(behind, "nearer than the 1.56 m")
