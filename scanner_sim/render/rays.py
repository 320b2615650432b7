"""Rays through a scene whose objects move, each ray at its own instant.

A ray is transformed into the frame of each moving object by the pose of that object at the ray's instant, and meets it
there; the nearest of all surfaces counts, and comes back into the scanner's frame:
p = R p' + x, n = R n', t = t' (rigid motions keep lengths). Light takes 0.1 µs there and back, in which nothing moves.
Where nothing moves the rays are the renderer's own.

Errors: poses are computed in float64 and used in float32, whose rounding moves surfaces at 10 m by 1 µm.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_types import Mask, Ray3f, SurfaceInteraction3f, UInt32, Vector3f
from scanner_sim.scene.files.loader import LoadedScene, Pose

_START_OFFSET = 2.0**-19
"""How far beside a surface a ray starts that leaves it, over its point's largest coordinate and 1 m: 16 roundings."""


def at_time(loaded: LoadedScene, time: float | NDArray[np.float64] | None) -> LoadedScene:
    """Return the scene at an instant [s], for all rays alike, or at one for each row; None leaves it as it is."""
    return pose_scene(loaded, None if time is None else loaded.poses_at(time))


def pose_scene(loaded: LoadedScene, poses: tuple[Pose, ...] | None) -> LoadedScene:
    """Return the scene with its moving objects at poses, one for each ray or one for all; None changes nothing."""
    return loaded if poses is None or not loaded.bodies else dataclasses.replace(loaded, poses=poses)


def take_poses(poses: tuple[Pose, ...], index: UInt32) -> tuple[Pose, ...]:
    """Return poses by their indices."""
    return tuple(pose.take(index) for pose in poses)


def for_rows(loaded: LoadedScene, row: UInt32) -> LoadedScene:
    """Return a scene with one pose for each row as one for the rays of some rows; a pose for all stays."""
    if all(dr.width(pose.position) == 1 for pose in loaded.poses):
        return loaded
    return pose_scene(loaded, take_poses(loaded.poses, row))


def intersect(
    loaded: LoadedScene, ray: Ray3f, flags: int | None = None, *, coherent: bool = False, active: Mask = True
) -> SurfaceInteraction3f:
    """Return what rays meet first, a ``mi.SurfaceInteraction3f`` in the scanner's frame.

    Parameters
    ----------
    loaded
        The scene, with poses for the rays.
    ray
        ``mi.Ray3f``, unit directions.
    flags
        What is wanted of the surface, ``mi.RayFlags``; all by default. Derivatives of a moving surface's point by
        its parameters stay in the frame of the object.
    coherent
        Whether neighbouring rays run alike.
    active
        Which rays there are.
    """
    flags = mi.RayFlags.All if flags is None else flags
    nearest = loaded.mitsuba.ray_intersect(ray, flags, coherent=coherent, active=active)
    for body, pose in zip(loaded.bodies, loaded.poses, strict=True):
        _end_kernel(nearest)
        si = body.mitsuba.ray_intersect(_to_object_frame(ray, pose), flags, coherent=coherent, active=active)
        _end_kernel(si)
        nearer = si.t < nearest.t
        si.p = mi.Point3f(pose.rotation @ mi.Vector3f(si.p) + pose.position)
        si.n = mi.Normal3f(pose.rotation @ mi.Vector3f(si.n))
        frame = si.sh_frame
        si.sh_frame = mi.Frame3f(
            pose.rotation @ frame.s, pose.rotation @ frame.t, pose.rotation @ mi.Vector3f(frame.n)
        )
        nearest = dr.select(nearer, si, nearest)
    return nearest


def met_shape(si: SurfaceInteraction3f) -> UInt32:
    """Return the registry indices of the shapes that rays met, 0 for none."""
    found: UInt32 = dr.select(si.is_valid(), dr.reinterpret_array(mi.UInt32, si.shape), 0)
    return found


def is_occluded(loaded: LoadedScene, ray: Ray3f, *, coherent: bool = False, active: Mask = True) -> Mask:
    """Return whether rays meet anything, up to their ``maxt``; the parameters are those of :func:`intersect`."""
    hidden = loaded.mitsuba.ray_test(ray, coherent=coherent, active=active)
    for body, pose in zip(loaded.bodies, loaded.poses, strict=True):
        _end_kernel(hidden)
        hidden |= body.mitsuba.ray_test(
            _to_object_frame(ray, pose), coherent=coherent, active=active & ~hidden
        )
        _end_kernel(hidden)
    return hidden


def leaving_rays(si: SurfaceInteraction3f, direction: Vector3f) -> Ray3f:
    """Return rays that leave surfaces, ``mi.Ray3f``; ``direction`` of unit length.

    They start beside the surface by a few roundings of its point, 20 µm at 10 m, so that they do not meet it again. The
    renderer's own start 1 mm away there, which takes 25 to 40 % of the light from one side of a crease of 170° to
    the other.
    """
    largest = dr.maximum(dr.maximum(dr.abs(si.p.x), dr.abs(si.p.y)), dr.abs(si.p.z))
    away = _START_OFFSET * (1.0 + largest)
    side = dr.select(dr.dot(si.n, direction) < 0.0, -away, away)
    return mi.Ray3f(dr.fma(si.n, side, si.p), direction)


def _to_object_frame(ray: Ray3f, pose: Pose) -> Ray3f:
    """Return rays in the frame of an object."""
    back = pose.rotation.T
    moved = mi.Ray3f(ray)
    moved.o = mi.Point3f(back @ (mi.Vector3f(ray.o) - pose.position))
    moved.d = back @ ray.d
    return moved


def _end_kernel(found: Any) -> None:
    """End the kernel on a GPU: one kernel of OptiX traces one scene only."""
    if dr.backend_v(mi.Float) == dr.JitBackend.CUDA:
        dr.eval(found)


def one_kernel(loaded: LoadedScene) -> bool:
    """Return whether loops over rays can be one kernel: on a GPU only where nothing moves."""
    return not loaded.bodies or dr.backend_v(mi.Float) != dr.JitBackend.CUDA
