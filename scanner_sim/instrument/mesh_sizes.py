"""Whether a mesh has the size that its place calls for: most that has not was drawn in another unit."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.arithmetic import applied
from scanner_sim.instrument.view_scene import field_of_view
from scanner_sim.scene.files.file_meshes import MeshExtent
from scanner_sim.scene.files.loader import LoadedScene
from scanner_sim.scene.objects import Mesh

UNITS = {"1 mm": 1e-3, "1 cm": 1e-2, "1 inch": 0.0254, "1 foot": 0.3048, "1 m": 1.0}
"""Units in which meshes are drawn [m]."""
TOO_LARGE = 4.0
"""Diagonal of a mesh over the field of view at its distance, and over that distance, beyond which it is doubted."""
TOO_SMALL = 1e-3
"""Diagonal over the field of view below which it is."""
SURER = 10.0
"""By how much larger it must be to be doubted where a scenario says the unit."""
FITTING = (0.02, 2.0)
"""Diagonals over the field of view that another unit must bring."""


def mesh_warnings(scenario: Scenario, loaded: LoadedScene) -> tuple[str, ...]:
    """Return what is to be said of the meshes of a scene: what was mended, left out or assumed, and doubtful sizes."""
    return (*(f"scene: {note}" for note in loaded.notes), *_size_warnings(scenario, loaded))


def _size_warnings(scenario: Scenario, loaded: LoadedScene) -> Iterator[str]:
    """Yield a sentence for each mesh that is far too large or too small for its place, with the unit that fits.

    A mesh is compared with the field of view's width at its distance, and with that distance: that of its origin, or of
    its middle where it is nearer. It is doubted only where another of :data:`UNITS` would make it fit.
    """
    field = field_of_view(scenario)
    widest = max(ends[1] - ends[0] for ends in (field.horizontal, field.vertical))
    for item in scenario.scene.objects:
        extent = loaded.extents.get(item.name)
        if extent is None or not isinstance(item, Mesh):
            continue
        size, distance = extent.unit * extent.diagonal, _distance(item, extent)
        width = max(distance * widest, 1e-9)
        factor = SURER if item.length_unit is not None else 1.0
        large = size > factor * TOO_LARGE * max(width, distance)
        small = size < TOO_SMALL * width
        better = _fitting_unit(extent.diagonal, width) if large or small else None
        if better is not None and not math.isclose(UNITS[better], extent.unit, rel_tol=1e-6):
            yield (
                f"scene: '{item.name}' is {size:.3g} m across, {'far more' if large else 'far less'} than the "
                f"{width:.3g} m that the scan sees at its {distance:.3g} m; with length_unit: {better} it "
                f"would be {extent.diagonal * UNITS[better]:.3g} m"
            )


def _distance(item: Mesh, extent: MeshExtent) -> float:
    (pose,) = item.pose_at(0.0)
    origin = float(np.linalg.norm(pose[:3, 3]))
    middle = float(np.linalg.norm(applied(pose[:3, :3], extent.unit * extent.middle) + pose[:3, 3]))
    return min(origin, middle) if origin > 0.0 else middle


def _fitting_unit(size: float, width: float) -> str | None:
    """Return the unit that brings a size in units of the file nearest to half of the field of view, if any fits."""
    best = min(UNITS, key=lambda name: abs(math.log(2.0 * size * UNITS[name] / width)))
    return best if FITTING[0] <= size * UNITS[best] / width <= FITTING[1] else None
