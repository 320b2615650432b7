"""A look at a scene as it stands at an instant: where its objects are, and which of them are seen in a direction."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_types import MitsubaScene, Shape
from scanner_sim.render.garbage import garbage_waits
from scanner_sim.render.interpenetration import shape_index, surface_points
from scanner_sim.render.rays import at_time, intersect, met_shape
from scanner_sim.scene.files.loader import LoadedScene

Array = NDArray[np.float64]


class Surveyed(NamedTuple):
    """An object of a scene: its name, materials, triangles, and points on its surface [m], shape (n, 3)."""

    name: str
    materials: tuple[str, ...]
    triangles: int
    points: Array


class Seen(NamedTuple):
    """What rays meet: the object's number in a survey from 0, −1 for nothing; cosine to the surface; distance [m]."""

    number: NDArray[np.int64]
    cosine: Array
    distance: Array


def survey(loaded: LoadedScene, time: float = 0.0) -> tuple[Surveyed, ...]:
    """Return the objects of a scenario, the parts of one together, in the scanner frame at a time [s]."""
    numbers, materials = loaded.object_of.numpy(), loaded.material_of.numpy()
    shapes: dict[str, list[tuple[Shape, Array]]] = {}
    for scene, pose in _posed(loaded, time):
        for shape in scene.shapes():
            owner = loaded.owners[int(numbers[shape_index(shape)]) - 1]
            shapes.setdefault(owner, []).append((shape, pose))
    found = []
    for name in dict.fromkeys(loaded.owners):
        own = [shape for shape, _ in shapes[name]]
        pose = shapes[name][0][1]
        points = surface_points(own) @ pose[:3, :3].T + pose[:3, 3]
        labels = (loaded.material_labels.names, loaded.material_labels.number_of)
        named = [labels[0][labels[1][materials[shape_index(shape)]] - 1] for shape in own]
        triangles = sum(shape.face_count() for shape in own if shape.is_mesh())
        found.append(Surveyed(name, tuple(dict.fromkeys(named)), triangles, points))
    return tuple(found)


def _posed(loaded: LoadedScene, time: float) -> Iterator[tuple[MitsubaScene, Array]]:
    yield loaded.mitsuba, np.eye(4)
    for body in loaded.bodies:
        yield body.mitsuba, body.item.pose_at(time)[0]


@garbage_waits()
def look(loaded: LoadedScene, direction: Array, time: float = 0.0) -> Seen:
    """Return what rays from the scanner's origin meet; ``direction`` of any length, shape (n, 3)."""
    unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    rays = mi.Ray3f(mi.Point3f(0.0), mi.Vector3f(*(for_device(axis) for axis in unit.T)))
    si = intersect(at_time(loaded, time), rays)
    hit = si.is_valid()
    number = dr.gather(mi.UInt32, loaded.object_of, met_shape(si), hit).numpy().astype(np.intp)
    order = {name: at for at, name in enumerate(dict.fromkeys(loaded.owners))}
    owners = np.array([-1, *(order[name] for name in loaded.owners)])
    met = hit.numpy()
    return Seen(
        np.where(met, owners[np.where(met, number, 0)], -1),
        np.where(met, np.abs(dr.dot(si.sh_frame.n, rays.d).numpy()), 0.0).astype(np.float64),
        np.where(met, si.t.numpy(), np.inf).astype(np.float64),
    )
