"""The light at each epoch of an approach: what Sun and Earth make of the array that is followed there."""

from __future__ import annotations

import math
from collections.abc import Callable

from scanner_sim.campaign.approach.reading import PlannedApproach, Point
from scanner_sim.config.scenario import Scenario
from scanner_sim.products.approach import EpochRow
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scan.raster import RasterScan
from scanner_sim.validation.studies.conditions import Condition
from scanner_sim.validation.studies.sweep import NothingSeenError, sweep_orbit

UNSEEN = -1
"""Number of no condition: the scanner does not see the array."""


def epoch_rows(
    planned: PlannedApproach, *, device: DeviceChoice = "auto", progress: Callable[[int, int], None]
) -> tuple[EpochRow, ...]:
    """Return the epochs of an approach with their conditions of Table 1, light by light.

    Parameters
    ----------
    planned
        The approach.
    device
        Where to compute.
    progress
        Called with the epochs done and the epochs in all.

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the light cannot be followed so far, or the device cannot be used.
    """
    rows = []
    epochs = len(planned.points) // max(len(planned.approach.orbits), 1)
    for number, point in enumerate(planned.points):
        scenario = planned.campaign.scenario(planned.run(number, planned.rangings[0]))
        condition, *light = _light_on(scenario, point, device)
        name = "not seen" if condition == UNSEEN else Condition(condition).words
        about = point.orbit, number % epochs, point.epoch.time, point.epoch.distance, point.array
        rows.append(EpochRow(*about, condition, name, *light))
        progress(number + 1, len(planned.points))
    return tuple(rows)


def _light_on(scenario: Scenario, point: Point, device: DeviceChoice) -> tuple[int, float, float, float]:
    """Return the condition of the array at a point, its share in sunlight, the Sun's, and the background [electron]."""
    still = scenario.model_copy(update={"scan": _around(scenario), "ranging": "triangulation"})
    try:
        timeline = sweep_orbit(still, 1, device=device)
        track = next(track for track in timeline.tracks if track.name == point.array)
    except (NothingSeenError, StopIteration):
        return UNSEEN, math.nan, math.nan, math.nan
    lit, visible, background = track.lit[0], timeline.sun_visible[0], track.background[0]
    return int(track.condition[0]), float(lit), float(visible), float(background)


def _around(scenario: Scenario) -> RasterScan:
    """Return a raster over what the patterns on the targets pass: the field of view of Table 1's conditions."""
    pattern, tracker = scenario.following.pattern, scenario.following.tracker
    ends = []
    for target in scenario.targets:
        theta, phi, distance = target.expected.tolist()
        half = tracker.track_amplitude * 0.5 * target.appearance.diameter / distance
        ends.append((theta - half, theta + half, phi - half * pattern.aspect, phi + half * pattern.aspect))
    left, right, top, bottom = zip(*ends, strict=True)
    return RasterScan(rows=2, columns=2, horizontal=(min(left), max(right)), vertical=(min(top), max(bottom)))
