"""The beams by which departures of an instrument are judged: all of a raster whose light the detector sees."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

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
