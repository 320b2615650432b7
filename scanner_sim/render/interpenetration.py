"""Objects of a scene that stand in one another, which solid bodies do not.

Points on the surface of each object, evenly by area, and the corners of its meshes are looked up in every other object
whose box they lie in: a point is inside where rays in four directions meet the other's surface an odd number of times
each. Its depth is the shortest way out that a fan of rays finds, the last of them along the normals of what they met: a
few per cent too much where faces meet.
Objects that touch do not count: less than a few roundings of a coordinate is contact.

What is not found: objects without an inside that cross (two plates), and parts smaller than the distance of the points.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_types import Float, Mask, MitsubaScene, Shape, UInt32, Vector3f
from scanner_sim.render.rays import leaving_rays
from scanner_sim.scene.files.loader import LoadedScene

Array = NDArray[np.float64]

_POINTS = 4096
"""Points on each object by area, and at most as many corners of its meshes."""
_PLASTIC = (0.7548776662, 0.5698402910)
"""Steps of a sequence that covers a square evenly: the plastic number's powers."""
_FAN = 60
"""Directions in which the way out is looked for."""
_REFINED = 2
"""Rays along the normal of the nearest surface that was met."""
_MOST_SURFACES = 512
"""Surfaces that a ray passes; a point from which one meets more is left out."""
MOST_PAIRS = 1000
"""Pairs of objects that are looked at."""
_CONTACT = 2.0**-17
"""Depth of mere contact, over the largest coordinate and 1 m: four times what a ray starts beside a surface."""


@dataclass(frozen=True)
class Interpenetration:
    """Two objects, by name, how deep one stands in the other [m], and when [s]."""

    objects: tuple[str, str]
    depth: float
    time: float


@dataclass(frozen=True, eq=False)
class _Solid:
    """An object in the frame of its scene: its number, the scene, which body that is, and its shapes."""

    number: int
    scene: MitsubaScene
    body: int | None
    shapes: tuple[Shape, ...]

    @cached_property
    def box(self) -> Array:
        """Its least and largest coordinates, shape (2, 3)."""
        boxes = np.array([[shape.bbox().min, shape.bbox().max] for shape in self.shapes], dtype=np.float64)
        return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])

    @cached_property
    def points(self) -> Array:
        """Points on its surface, shape (n, 3)."""
        return surface_points(self.shapes)


def interpenetrations(loaded: LoadedScene, times: Sequence[float]) -> tuple[Interpenetration, ...]:
    """Return which objects stand in one another, each pair at the one of some times [s] at which it does so most.

    What rests is looked at once, and of many pairs whose boxes meet the first :data:`MOST_PAIRS`.
    """
    solids, found = list(_solids(loaded)), dict[tuple[int, int], Interpenetration]()
    owners = [loaded.owners[solid.number - 1] for solid in solids]

    def concerns(one: int, other: int) -> bool:
        moves = solids[one].body is not None or solids[other].body is not None
        return owners[one] != owners[other] and (moves or time == times[0])

    for time in times:
        bodies = [body.item.pose_at(time)[0] for body in loaded.bodies]
        poses = [np.eye(4) if solid.body is None else bodies[solid.body] for solid in solids]
        for one, other in [pair for pair in _near(solids, poses) if concerns(*pair)][:MOST_PAIRS]:
            depth = max(
                _depth(loaded, solids[a], solids[b], np.linalg.solve(poses[b], poses[a]), poses[b])
                for a, b in ((one, other), (other, one))
            )
            if depth > 0.0 and ((one, other) not in found or depth > found[one, other].depth):
                names = loaded.objects[solids[one].number - 1], loaded.objects[solids[other].number - 1]
                found[one, other] = Interpenetration(names, depth, time)
    return tuple(found.values())


def _solids(loaded: LoadedScene) -> Iterator[_Solid]:
    """Yield the objects of a scene."""
    numbers = loaded.object_of.numpy()
    for body, scene in enumerate((loaded.mitsuba, *(body.mitsuba for body in loaded.bodies)), start=-1):
        shapes: dict[int, list[Shape]] = {}
        for shape in scene.shapes():
            shapes.setdefault(int(numbers[shape_index(shape)]), []).append(shape)
        for number, own in shapes.items():
            yield _Solid(number, scene, None if body < 0 else body, tuple(own))


def shape_index(shape: Shape) -> int:
    """Return the index of a shape in the renderer's registry."""
    index: UInt32 = dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))
    return int(index[0])


def surface_points(shapes: Sequence[Shape]) -> Array:
    """Return points on shapes, shape (n, 3): evenly by area, and corners of meshes."""
    area = np.array([float(np.asarray(shape.surface_area()).sum()) for shape in shapes])
    share = np.cumsum(area) / area.sum()
    number = np.arange(_POINTS)
    which = np.minimum(np.searchsorted(share, (number + 0.5) / _POINTS), len(shapes) - 1)
    index = mi.UInt32(for_device(np.array([shape_index(shape) for shape in shapes])[which], np.uint32))
    spread = [mi.Float(for_device(number * step % 1.0)) for step in _PLASTIC]
    owner: Shape = dr.reinterpret_array(mi.ShapePtr, index)
    sampled = owner.sample_position(mi.Float(0.0), mi.Point2f(*spread))
    meshes = [shape.vertex_positions_buffer().numpy() for shape in shapes if shape.is_mesh()]
    corners = np.concatenate([np.empty(0), *meshes]).reshape(-1, 3)
    return np.concatenate([sampled.p.numpy().T, corners[:: len(corners) // _POINTS + 1]]).astype(np.float64)


def _near(solids: Sequence[_Solid], poses: Sequence[Array]) -> list[tuple[int, int]]:
    """Return which pairs of objects have boxes that meet."""
    corners = np.array(
        [
            np.stack(np.meshgrid(*solid.box.T), axis=-1).reshape(8, 3) @ pose[:3, :3].T + pose[:3, 3]
            for solid, pose in zip(solids, poses, strict=True)
        ]
    ).reshape(-1, 8, 3)
    low, high = corners.min(axis=1), corners.max(axis=1)
    found = []
    for one in range(len(solids)):
        meets = ((low[one] <= high[one + 1 :]) & (low[one + 1 :] <= high[one])).all(axis=1)
        found += [(one, one + 1 + other) for other in np.flatnonzero(meets).tolist()]
    return found


def _depth(loaded: LoadedScene, solid: _Solid, other: _Solid, to_other: Array, pose: Array) -> float:
    """Return how deep points of a solid stand in another [m], 0 where none does.

    ``to_other`` takes points of its frame to that of the other, ``pose`` those to the scanner's.
    """
    points = solid.points @ to_other[:3, :3].T + to_other[:3, 3]
    points = points[((points >= other.box[0]) & (points <= other.box[1])).all(axis=1)]
    if not len(points):
        return 0.0
    way = _Way(loaded, other)
    askew, even = _fan()
    points = points[np.all([way.out(points, direction)[0] for direction in askew], axis=0)]
    if not len(points):
        return 0.0
    fan = [way.out(points, direction) for direction in even]
    depths, normals = np.array([depth for _, depth, _ in fan]), [normal for _, _, normal in fan]
    depth, nearest = depths.min(axis=0), depths.argmin(axis=0)
    for _ in range(_REFINED):
        normal = np.array(normals)[nearest, np.arange(len(points))]
        _, again, found = way.out(points, normal)
        nearest = np.where(again < depth, 0, 1)
        normals, depth = [found, normal], np.minimum(depth, again)
    contact = _CONTACT * (1.0 + np.abs(points @ pose[:3, :3].T + pose[:3, 3]).max(axis=1))
    return float(np.where(depth > contact, depth, 0.0).max())


def _fan() -> tuple[Array, Array]:
    """Return four directions that no half-space holds, shape (4, 3), and a spiral over the sphere (Vogel's), (60, 3).

    Of a point on a surface one of the four leads away from it, whatever roundings make of the others.
    """
    four = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)
    number = np.arange(_FAN)
    height, turn = 1.0 - (2.0 * number + 1.0) / _FAN, number * np.pi * (3.0 - np.sqrt(5.0))
    spiral = np.stack([*(np.sqrt(1.0 - height**2) * (np.cos(turn), np.sin(turn))), height], axis=1)
    return Rotation.from_rotvec([0.3, 0.5, 0.7]).apply(four), spiral


class _Way:
    """The way out of a solid."""

    def __init__(self, loaded: LoadedScene, solid: _Solid) -> None:
        self._object_of, self._solid = loaded.object_of, solid

    def out(self, points: Array, directions: Array) -> tuple[NDArray[np.bool_], Array, Array]:
        """Return of n rays whether they leave the solid oftener than they enter it, and where they do so first.

        Returns
        -------
        tuple
            Whether they meet its surface an odd number of times, shape (n,); the distance of the first such meeting
            [m], ∞ for none; the normal there on the far side, shape (n, 3).
        """
        start, towards = (
            mi.Vector3f(*(mi.Float(for_device(part)) for part in np.broadcast_to(ways, points.shape).T))
            for ways in (points, directions)
        )
        number = dr.opaque(mi.UInt32, self._solid.number)

        def step(
            active: Mask, left: UInt32, met: UInt32, at: Vector3f, way: Float, first: Float, normal: Vector3f
        ) -> tuple[Any, ...]:
            ray = mi.Ray3f(at, towards)
            si = self._solid.scene.ray_intersect(ray, mi.RayFlags.Minimal, coherent=False, active=active)
            hit = active & si.is_valid()
            shape: UInt32 = dr.reinterpret_array(mi.UInt32, si.shape)
            own = hit & (dr.gather(mi.UInt32, self._object_of, shape, hit) == number)
            way = way + dr.select(hit, si.t, 0.0)
            earliest = own & ~dr.isfinite(first)
            outward = mi.Vector3f(dr.select(dr.dot(si.n, towards) < 0.0, -si.n, si.n))
            beyond = leaving_rays(si, towards).o
            return (
                hit & (left > 1),
                left - 1,
                met + dr.select(own, mi.UInt32(1), 0),
                dr.select(hit, beyond, at),
                way,
                dr.select(earliest, way, first),
                dr.select(earliest, outward, normal),
            )

        count = len(points)
        state = (
            dr.full(mi.Bool, True, count),
            dr.full(mi.UInt32, _MOST_SURFACES, count),
            dr.zeros(mi.UInt32, count),
            mi.Point3f(start),
            dr.zeros(mi.Float, count),
            dr.full(mi.Float, dr.inf, count),
            dr.zeros(mi.Vector3f, count),
        )
        ended: Any = dr.while_loop(state, lambda active, *_: active, step)
        _, left, met, _, _, first, normal = ended
        odd = (met.numpy() % 2 == 1) & (left.numpy() > 0)
        return odd, first.numpy().astype(np.float64), normal.numpy().T.astype(np.float64)
