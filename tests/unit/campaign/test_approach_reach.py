"""Epochs of an approach at which nothing can be measured: which are asked after, and where reach ends."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from html_cells import cells

from scanner_sim.campaign.approach import page, reading
from scanner_sim.campaign.approach.path import epochs_of, span_of
from scanner_sim.campaign.approach.plan import Approach, Epochs
from scanner_sim.campaign.approach.reading import _out_of_reach, _unmeasurable
from scanner_sim.foundation.errors import Fault, ScenarioError
from scanner_sim.foundation.html_text import png_address
from scanner_sim.products.approach import ApproachStudy, EpochRow
from scanner_sim.scene.ephemeris import EphemerisMotion
from scanner_sim.scene.motion import ConstantTwist, Waypoint, Waypoints
from scanner_sim.scene.relative_orbit import Glideslope, RelativeOrbit


@pytest.mark.parametrize("orbits", [0, 1, 2, 3])
@pytest.mark.parametrize("bad", [None, 0, 2, 3])
@pytest.mark.parametrize(
    ("place", "key"),
    [
        ("scene.x", "trajectory"),
        ("scene.objects[0].position", "trajectory"),
        ("scene.objects[1].position", "base"),
    ],
)
def test_each_epoch_is_tried_once_and_the_first_under_every_light(
    orbits: int, bad: int | None, place: str, key: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: of three epochs each is tried by both ways of ranging under the first light, and the first under the
    others; an epoch has one fault, of the scenario or of its reach, and then the other way is not tried. It is the
    trajectory's fault, unless it is of an object that moves by itself."""
    objects = [SimpleNamespace(name=name) for name in ("craft", "drone")]
    base = SimpleNamespace(scene=SimpleNamespace(objects=objects))
    count = 3 * max(orbits, 1)
    points = [SimpleNamespace(epoch=SimpleNamespace(time=100.0 + number)) for number in range(count)]
    tried: list[tuple[int, str]] = []

    def scenario(run: tuple[int, str]) -> tuple[int, str]:
        tried.append(run)
        if run == (bad, "tof"):
            raise ScenarioError([Fault(place, "it is odd.", "Mend it."), Fault("y", "z.", "")])
        return run

    def reach(run: tuple[int, str], point: Any, ranging: str) -> Fault | None:
        assert point is points[run[0]]
        assert ranging == run[1]
        return Fault("trajectory", "too far.", "Stay.") if run == (2, "triangulation") else None

    monkeypatch.setattr(reading, "_out_of_reach", reach)
    planned: Any = SimpleNamespace(
        points=points,
        approach=SimpleNamespace(orbits=[None] * orbits, object="craft"),
        rangings=("tof", "triangulation"),
        run=lambda number, ranging: (number, ranging),
        campaign=SimpleNamespace(scenario=scenario, base=base),
    )
    found = list(_unmeasurable(planned))
    numbers = [0, 1, 2, *range(3, count, 3)]
    expected = [(n, way) for n in numbers for way in ("tof", "triangulation") if way == "tof" or n != bad]
    assert tried == expected
    odd = Fault(key, f"at {100 + (bad or 0)} s, {place}: it is odd.", "Mend it.")
    far = Fault("trajectory", "too far.", "Stay.")
    assert found == [odd if n == bad else far for n in numbers if n in (2, bad)]


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ((0.1, 0.05, 3.0), ""),
        ((0.1, 0.2, 12.0), ""),
        ((0.1, 0.2, 2.99), "is at a range of 2.99 m; tof measures from 3 m to 12 m"),
        ((0.1, 0.2, 12.1), "is at a range of 12.1 m"),
        # Half a pattern of 3 × 0.4 m at 4 m: 0.15 rad in Θ, and 0.3 rad in φ by the aspect of 2.
        ((0.35, 0.2, 4.0), ""),
        ((-0.35, -0.2, 4.0), ""),
        ((0.351, 0.2, 4.0), "Θ = 20.11 deg, φ = 11.46 deg, and with its pattern 28.68 deg"),
        ((-0.351, 0.2, 4.0), "leaves the field of view"),
        ((0.1, 0.201, 4.0), "leaves the field of view"),
        ((0.1, -0.201, 4.0), "leaves the field of view"),
    ],
)
def test_reach_ends_with_the_range_and_with_the_pattern(
    place: tuple[float, float, float], words: str
) -> None:
    """Claim: a target is in reach up to the ends of the ranging's ranges and where its whole pattern is below the
    mirrors' limit, a little more than 0.5 rad; the fault says which target, when, and both numbers."""

    def target(name: str, at: tuple[float, float, float]) -> Any:
        return SimpleNamespace(name=name, expected=np.array(at), appearance=SimpleNamespace(diameter=0.4))

    scenario: Any = SimpleNamespace(
        scanner=SimpleNamespace(
            seen_by={"tof": (3.0, 12.0)}.__getitem__, mirrors=SimpleNamespace(max_deflection=0.5005)
        ),
        following=SimpleNamespace(
            pattern=SimpleNamespace(aspect=2.0), tracker=SimpleNamespace(track_amplitude=3.0)
        ),
        targets=[target("u", (0.0, 0.0, 5.0)), target("v", place)],
    )  # fmt: skip
    point: Any = SimpleNamespace(epoch=SimpleNamespace(time=70.0))
    fault = _out_of_reach(scenario, point, "tof")
    if not words:
        assert fault is None
        return
    assert fault is not None
    assert fault.location == "trajectory"
    assert fault.problem.startswith("at 70 s 'v' ")
    assert words in fault.problem
    assert fault.remedy


@pytest.mark.parametrize(
    ("motion", "span"),
    [
        (
            Waypoints.model_construct(points=tuple(SimpleNamespace(time=time) for time in (3.0, 5.0, 11.0))),
            (3.0, 11.0),
        ),
        (RelativeOrbit.model_construct(glideslope=None), (0.0, None)),
        (ConstantTwist.model_construct(), (0.0, None)),
    ],
)
def test_a_path_goes_from_its_first_point_to_its_last_or_on(
    motion: Any, span: tuple[float, float | None]
) -> None:
    assert span_of(motion) == span


def test_a_path_of_flight_dynamics_goes_as_far_as_all_its_files(tmp_path: Path) -> None:
    """Claim: its last epoch is by default the last that orbit and attitude both hold, counted from the start that is
    asked for, and no epoch lies beyond, where the object would only rest.

    Set-up: an orbit over 100 s and an attitude over 70 s, from 10 s on.
    """
    head = (
        "CREATION_DATE = 2026-01-01T00:00:00\nORIGINATOR = TEST\nMETA_START\nOBJECT_NAME = A\nOBJECT_ID = A\n"
    )
    head += "TIME_SYSTEM = UTC\nSTART_TIME = x\nSTOP_TIME = x\n"
    orbit, attitude = tmp_path / "relative.oem", tmp_path / "body.aem"
    orbit.write_text(
        f"CCSDS_OEM_VERS = 2.0\n{head}CENTER_NAME = CHASER\nREF_FRAME = LVLH\nINTERPOLATION = LINEAR\nMETA_STOP\n"
        "2026-03-20T12:00:00 0 0 0.015 0 0 -0.0001\n2026-03-20T12:01:40 0 0 0.005 0 0 -0.0001\n"
    )
    attitude.write_text(
        f"CCSDS_AEM_VERS = 1.0\n{head}REF_FRAME_A = LVLH\nREF_FRAME_B = SC_BODY_1\nATTITUDE_DIR = A2B\n"
        "ATTITUDE_TYPE = QUATERNION\nQUATERNION_TYPE = LAST\nMETA_STOP\nDATA_START\n"
        "2026-03-20T12:00:10 0 0 0 1\n2026-03-20T12:01:20 0 0 0 1\nDATA_STOP\n"
    )
    motion = EphemerisMotion(type="ccsds", orbit=orbit, attitude=attitude, start="2026-03-20T12:00:20")
    assert span_of(motion) == pytest.approx((-10.0, 60.0))
    for end, last, words in ((None, 60.0, ""), (45.0, 45.0, ""), (61.0, None, "61 s is not on the path")):
        asked: Any = SimpleNamespace(epochs=Epochs(count=3, end=end), trajectory=motion)
        epochs, faults = epochs_of(asked, np.eye(4))
        assert [one.time for one in epochs][-1:] == ([] if last is None else [pytest.approx(last)])
        assert [np.linalg.norm(one.velocity) for one in epochs] == [pytest.approx(0.1)] * len(epochs)
        assert [one.location for one in faults] == (["epochs.end"] if words else [])
        assert not words or words in faults[0].problem


@pytest.mark.parametrize("seconds", [300.0, 0.004])
def test_an_object_arrives_with_the_rates_of_its_path(seconds: float) -> None:
    """Claim: all along an even path, at its last epoch too, it moves by way and angle over time, also where the whole
    path is shorter than the step over which rates are taken. At a waypoint it goes on with the rates of the next piece;
    a glideslope has stopped.
    """
    there = Waypoint(time=0.0, position=(0.0, 0.0, 9.0))
    turn = {"axis": "z", "angle": math.radians(8.0)}
    here = Waypoint(time=seconds, position=(2e-4, 0.0, 8.99), rotation=turn)
    motion: Any = Waypoints(type="waypoints", interpolation="linear", points=(there, here))
    asked: Any = SimpleNamespace(epochs=Epochs(count=3), trajectory=motion)
    epochs, _ = epochs_of(asked, np.eye(4))
    for one in epochs:
        assert one.velocity * seconds == pytest.approx([2e-4, 0.0, -1e-2], abs=1e-9)
        assert one.turn_rate * seconds == pytest.approx([0.0, 0.0, math.radians(8.0)], abs=1e-9)
    rest = Waypoint(time=seconds + 10.0, position=(2e-4, 0.5, 8.99), rotation=turn)
    asked.trajectory = motion.model_copy(update={"points": (there, here, rest)})
    asked.epochs = Epochs(count=2, end=seconds)
    (_, at_waypoint), _ = epochs_of(asked, np.eye(4))
    assert at_waypoint.velocity == pytest.approx([0.0, 0.05, 0.0], abs=1e-9)
    slope = Glideslope(to=(-2.0, 0.5, 1.0), start_speed=0.05, end_speed=0.01, pulses=12)
    asked.trajectory = RelativeOrbit(type="clohessy_wiltshire", position=(-30.0, 0.0, 8.0), glideslope=slope)
    asked.epochs = Epochs(count=2)
    (first, arrived), _ = epochs_of(asked, np.eye(4))
    assert np.linalg.norm(first.velocity) > 0.04
    assert arrived.velocity == pytest.approx(np.zeros(3), abs=1e-9)


@pytest.mark.parametrize(
    ("start", "end", "words"),
    [
        (20.0, 20.1, ""),
        (20.0, None, ""),
        (20.0, 20.0, "20 s is not after the start, 20 s"),
        (20.0, 19.9, "19.9 s is not"),
    ],
)
def test_epochs_end_after_they_start(start: float, end: float | None, words: str) -> None:
    asked: Any = SimpleNamespace(count=3, spacing=None, start=start, end=end)
    found = list(Epochs.cross_checks(asked))
    assert [one.location for one in found] == (["end"] if words else [])
    assert not words or words in found[0].problem


@pytest.mark.parametrize(
    ("below", "faulty"), [((3.0, 3.01, None), []), ((3.0, 3.0), [1]), ((3.0, 5.0, 4.9), [2])]
)
def test_arrays_of_an_approach_go_from_near_to_far(
    below: tuple[float | None, ...], faulty: list[int]
) -> None:
    """Claim: each up to a range of its own, beyond that of the one before; the first whose end is beyond a range is
    followed there, at its own end the next."""
    asked: Any = SimpleNamespace(
        methods=("joint",), arrays=[SimpleNamespace(below=one, array=str(one)) for one in below]
    )
    assert [one.location for one in Approach.cross_checks(asked)] == [
        f"arrays.{number}.below" for number in faulty
    ]
    after = next((str(one) for one in below if one is None or one > 3.0), None)
    assert [Approach.array_at(asked, distance) for distance in (2.9, 3.0)] == ["3.0", after]


def test_lights_are_counted_by_the_last_number() -> None:
    """Claim: numbered from 0, whatever the order of the epochs."""
    for orbits in ([0, 0], [1, 0, 3, 2, 3, 0]):
        epochs = tuple(SimpleNamespace(orbit=orbit) for orbit in orbits)
        study: Any = SimpleNamespace(epochs=epochs)
        count = ApproachStudy.orbits.fget(study)  # type: ignore[attr-defined]
        assert count == len(set(orbits))


def test_the_page_of_an_approach_shows_its_tables_and_pictures_in_their_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: the heading above its rows; the first epochs, as many as are listed; the picture of the lights before
    those of each; lights are counted from 1."""
    monkeypatch.setattr(page, "MOST_EPOCHS", 2)
    epochs = tuple(
        EpochRow(number, number, 10.5 + number, 7.0 - number, f"array {number}", 1, "normal", 0.25, 0.5, 12.0)
        for number in range(3)
    )
    study: Any = SimpleNamespace(
        name="docking", made_by={"program": "9"}, faults=["odd"], labels=[], orbits=2, epochs=epochs
    )
    text = page.approach_page(
        study, [["method", "a"], ["uv", "1 %"], ["xyz", "2 %"]], b"light", [b"one", b"two"]
    )
    rows = cells(text.replace("\n", ""))
    assert rows[:3] == [["method", "a"], ["uv", "1 %"], ["xyz", "2 %"]]
    assert [row[:4] for row in rows[4:]] == [
        ["1", "10.5", "7.000", "array 0"],
        ["2", "11.5", "6.000", "array 1"],
    ]
    assert [row[4:] for row in rows[4:]] == [["normal", "0.25", "0.50", "12"]] * 2
    places = [text.index(png_address(picture)) for picture in (b"light", b"one", b"two")]
    assert places == sorted(places)
    assert text.index("light 1") < places[1] < text.index("light 2") < places[2]
