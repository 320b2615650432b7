"""The beams by which departures of an instrument are judged: all of a raster whose light the detector sees."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from scanner_sim.analytic import geometry
from scanner_sim.config import load_scenario
from scanner_sim.validation.compare import departures
from scanner_sim.validation.compare.closed_forms import ClosedForms
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup, FlatTarget


def setting(ranges: tuple[float, ...], **scanner: Any) -> ComparisonSetup:
    scan = {"type": "raster", "rows": 4, "columns": 4, "horizontal": (-0.3, 0.3), "vertical": (-0.3, 0.3)}
    scenario = load_scenario({"schema": 1, "ranging": "both", "scan": scan, "scanner": scanner})
    return ComparisonSetup(scenario, FlatTarget(0.4, ranges))


@pytest.mark.parametrize(
    ("ranges", "built"),
    [
        ((1.47, 3.0, 5.0), {"theta_zero": 1e-3, "tof_zero": 1e-2}),
        ((33.5, 34.0), {"tof_zero": 1e-2}),
        ((1.47,), {"base": 1e-3}),
        ((0.6,), {"tof_zero": 1e-2}),
        ((1.502,), {"tof_zero": 1e-2}),
        ((33.955,), {"tof_zero": 1e-2}),
    ],
)
def test_every_beam_that_is_seen_is_judged(ranges: tuple[float, ...], built: dict[str, float]) -> None:
    """Claim: of nine by nine deflections, from half of the mirrors' limit on one side to 0.7 of it on the other, those
    whose spot on a wall straight ahead lies on the array are taken, or those within the gate, 0.5 to 35 m, less a metre
    at each end; by each way that a departure moves; at the nearest wall and the middle one. R is where the beam meets
    z = distance, and nothing is told of a wall that no beam sees."""
    given = setting(ranges, as_built=built)
    closed, mirrors = ClosedForms(given.scenario), given.scenario.scanner.mirrors
    grid = (mirrors.max_deflection * (-0.5 + 1.2 * np.arange(9) / 8.0)).tolist()
    normal = np.array([0.0, 0.0, -1.0])
    moved = {
        "triangulation": built.keys() & {"theta_zero", "base"},
        "tof": built.keys() & {"theta_zero", "tof_zero"},
    }
    expected: dict[tuple[str, float], set[tuple[float, ...]]] = {}
    for way, wall in ((way, wall) for way in moved if moved[way] for wall in {ranges[0], given.middle}):
        point, separation = np.array([0.0, 0.0, wall]), mirrors.axis_separation
        for theta, phi in ((theta, phi) for theta in grid for phi in grid):
            r = ((wall - separation) / math.cos(phi) + separation) / math.cos(theta)
            on_array = closed.on_array(closed.spot(theta, phi, point, normal, 0.4))
            if on_array if way == "triangulation" else 1.5 < r < 34.0:
                beam = tuple(round(value, 9) for value in (theta, phi, r))
                expected.setdefault((way, wall), set()).add(beam)
    found = {
        (way, wall): {tuple(round(float(value), 9) for value in beam) for beam in zip(*beams, strict=True)}
        for way, wall, *beams in departures._rasters(given)
    }
    assert found == expected
    if ranges[0] == 1.47:
        assert all(0 < len(beams) < 81 for (_, wall), beams in expected.items() if wall == 1.47)
    assert bool(departures._uncovered(given)) is (not expected)


def test_a_departure_is_what_an_instrument_errs_beyond_its_design(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: errors of the instrument as built less those as designed, their mean over all beams, axis by axis, in mm;
    each at the wall and beams of its case, by its way of ranging."""
    theta, phi = np.arange(4.0), 10.0 + np.arange(4.0)
    walls = [("triangulation", 2.0, theta, phi, None), ("tof", 7.0, phi, theta, None)]
    monkeypatch.setattr(departures, "_rasters", lambda _: iter(walls))
    told: Any = object()

    def errors(setting: Any, way: str, wall: float, one: Any, other: Any, *, as_built: bool) -> np.ndarray:
        assert setting is told
        axes = np.array([1.0, 3.0, 5.0]) * (1.0 if way == "tof" else 2.0)
        own = 1e-3 * (wall * one + 0.1 * other)[:, None] * axes
        return own if as_built else 0.25 * own + 1e-3

    monkeypatch.setattr(departures, "_errors", errors)
    found = {case: one.value for case, one in departures._measure(told).items()}
    near, far = 0.75 * (2.0 * 1.5 + 0.1 * 11.5), 0.75 * (7.0 * 11.5 + 0.1 * 1.5)
    assert found == pytest.approx(
        {
            f"{axis} by triangulation, wall at 2 m": 2.0 * k * near - 1.0
            for axis, k in zip("xyz", (1, 3, 5), strict=True)
        }
        | {
            f"{axis} by time of flight, wall at 7 m": k * far - 1.0
            for axis, k in zip("xyz", (1, 3, 5), strict=True)
        },
        rel=1e-12,
    )


def test_predictions_are_sure_to_what_fits_and_rounding_leave() -> None:
    """Claim: a zero of time of flight moves each point along its own beam by as much, on average by the mean direction
    of all beams, surely to 2 thousandths of a sample and 2⁻²² of the farthest range; of an angle that is hardly off
    triangulation is sure to 2 thousandths of a pixel where that is worth most, (R − d sin Θ)²/(f d cos Θ) pitches. The
    deviation is compared with the wall's distance, all in mm."""
    given = setting((5.0,), as_built={"tof_zero": 8e-3, "theta_zero": 1e-9})
    scanner, found = given.scenario.scanner, departures._predict(given)
    beams = {(way, wall): of for way, wall, *of in departures._rasters(given)}
    assert len(found) == 3 * len(beams) == 6
    receiver, sensor, separation = scanner.receiver, scanner.position_sensor, scanner.mirrors.axis_separation
    for (way, wall), (theta, phi, r) in beams.items():
        own = [found[departures._case(way, wall, axis)] for axis in "xyz"]
        assert [(one.quantity, one.unit) for one in own] == [
            (f"mean error of {axis}", "mm") for axis in "xyz"
        ]
        assert [one.divisor for one in own] == pytest.approx([1e3 * wall] * 3)
        rounding = 2.0**-22 * r.max()
        if way == "tof":
            step = 299_792_458.0 / 2.0 / scanner.lidar.digitiser.rate
            there, here = (
                geometry.point_from_shot(r + k * 1e-6, theta, phi, separation) for k in (1.0, -1.0)
            )
            wanted = 8.0 * ((there - here) / 2e-6).mean(axis=0)
            assert [one.value for one in own] == pytest.approx(wanted, rel=1e-6, abs=1e-4)
        else:
            d, f = receiver.baseline, receiver.focal_length
            step = float(((r - d * np.sin(theta)) ** 2 / (f * d * np.cos(theta))).max()) * sensor.pitch
        assert [one.accuracy for one in own] == pytest.approx([1e3 * (2e-3 * step + rounding)] * 3, rel=1e-3)


@pytest.mark.parametrize(
    ("built", "believed", "covered"), [(0, 0, False), (1, 0, True), (0, 1, True), (1, 1, True)]
)
def test_one_parameter_is_enough_to_be_judged(
    monkeypatch: pytest.MonkeyPatch, built: int, believed: int, covered: bool
) -> None:
    """Claim: what is built, or believed, otherwise than designed in one parameter is judged; nothing of it is not."""

    def instrument(many: int) -> Any:
        values = np.zeros(len(departures.NAMES))
        values[[departures.INDEX["base"], departures.INDEX["theta_zero"]][:many]] = 1e-3
        return departures._Instrument(values, 1.0)

    monkeypatch.setattr(departures, "_instruments", lambda _: (instrument(built), instrument(believed)))
    monkeypatch.setattr(departures, "_rasters", lambda _: iter([True]))
    reason = departures._uncovered(setting((3.0, 5.0)))
    assert reason == ("" if covered else "the instrument is built and believed as designed")


@pytest.mark.parametrize(
    ("ranging", "built", "words"),
    [
        ("both", {}, "built and believed as designed"),
        ("both", {"power_noise": 0.01}, "none of the parameters"),
        ("both", {"tangential_across": 1e-3}, "none of the parameters"),
        ("triangulation", {"tof_zero": 1e-2}, "moves points by triangulation"),
        ("tof", {"base": 1e-3}, "moves points by time of flight"),
        ("triangulation", {"base": 1e-3}, ""),
        ("tof", {"tof_zero": 1e-2, "power_noise": 0.01}, ""),
    ],
)
def test_why_no_departure_is_judged_is_told(ranging: str, built: dict[str, float], words: str) -> None:
    """Claim: departures that are no parameters, and those that the scenario's way of ranging does not see, are told as
    such; neither is the array blamed for them nor is the instrument called as designed."""
    given = setting((3.0, 5.0), as_built=built)
    reason = departures._uncovered(replace(given, scenario=given.scenario.changed(ranging=ranging)))
    assert bool(reason) is bool(words)
    assert words in reason
