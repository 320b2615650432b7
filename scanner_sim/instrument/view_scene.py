"""What stands before the scanner of a scenario when its scan begins, without a simulation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.scenario import Scenario
from scanner_sim.products.scene_view import Field, SceneView, ViewedObject
from scanner_sim.render.device import activate
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.render.survey import look, survey
from scanner_sim.scene.files.loader import load_scene
from scanner_sim.scene.objects import KINDS

_WIDER = 1.25
"""The picture's field of view over the scan's."""
_LEAST = 0.01
"""Least width of the picture [rad]: a scan may be a line."""
_LONG_SIDE = 640
"""Dots of the picture's longer side."""


def field_of_view(scenario: Scenario) -> Field:
    """Return what a scan covers, or for the closed loop what the mirrors reach, and the ranges of the instrument."""
    scanner = scenario.scanner
    if scenario.scan.layout == "visits":
        limit = scanner.mirrors.max_deflection
        horizontal = vertical = (-limit, limit)
    else:
        horizontal, vertical = scenario.open_scan.horizontal, scenario.open_scan.vertical
    nearest, farthest = zip(*map(scanner.seen_by, scenario.rangefinders), strict=True)
    return Field(_ordered(horizontal), _ordered(vertical), min(nearest), max(farthest))


@guest()
def view_scene(scenario: Scenario, *, device: DeviceChoice = "auto") -> SceneView:
    """Return what stands before the scanner of a scenario at the beginning of its scan.

    Parameters
    ----------
    scenario
        The scene, the scan and the instrument.
    device
        Where to compute.

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the device cannot be used.
    """
    activate(device)
    loaded, field = load_scene(scenario.scene), field_of_view(scenario)
    window = _wider(field.horizontal), _wider(field.vertical)
    rows, columns = _dots(window)
    theta, phi = np.meshgrid(_middles(window[0], columns), _middles(window[1], rows))
    seen = look(loaded, np.stack([np.tan(theta), np.tan(phi), np.ones_like(theta)], axis=-1).reshape(-1, 3))
    inside = (theta >= field.horizontal[0]) & (theta <= field.horizontal[1])
    inside &= (phi >= field.vertical[0]) & (phi <= field.vertical[1])
    if not inside.any():  # a scan as fine as a line
        inside[:] = True
    items = {item.name: item for item in scenario.scene.objects}
    objects = []
    for index, one in enumerate(survey(loaded)):
        item = items.get(one.name)
        kind = "file" if item is None else next(key for key in KINDS if getattr(item, key, None) is not None)
        objects.append(
            ViewedObject(
                one.name,
                getattr(item, "shape", kind) if kind == "shape" else kind,
                one.materials,
                one.triangles,
                one.points,
                float((seen.number.reshape(rows, columns)[inside] == index).mean()),
                item is not None and item.moves,
            )
        )
    shape = rows, columns
    return SceneView(
        tuple(objects),
        field,
        window,
        1 + seen.number.reshape(shape),
        seen.cosine.reshape(shape),
        seen.distance.reshape(shape),
    )


def _ordered(ends: tuple[float, float]) -> tuple[float, float]:
    return min(ends), max(ends)


def _wider(ends: tuple[float, float]) -> tuple[float, float]:
    middle, half = 0.5 * (ends[0] + ends[1]), 0.5 * max(_WIDER * (ends[1] - ends[0]), _LEAST)
    return max(middle - half, -1.5), min(middle + half, 1.5)


def _dots(window: tuple[tuple[float, float], tuple[float, float]]) -> tuple[int, int]:
    """Return rows and columns of a picture whose dots are square."""
    wide, high = (ends[1] - ends[0] for ends in window)
    scale = _LONG_SIDE / max(wide, high)
    return max(round(scale * high), 32), max(round(scale * wide), 32)


def _middles(ends: tuple[float, float], count: int) -> NDArray[np.float64]:
    return ends[0] + (np.arange(count) + 0.5) * (ends[1] - ends[0]) / count
