"""How Sun and Earth light a target, and whether their light blinds the scanner: a few thousand rays per moment.

Points are spread over what the scanner sees of a target; shadow rays tell how much of it the Sun reaches. The light
that comes back to the lens, from these points and from a coarse grid over the field of view, is followed as for the
background (:mod:`scanner_sim.render.background.paths`). A glint smaller than the grid's step can slip through.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_streams import generator
from scanner_sim.foundation.device_types import Ray3f, UInt32, Vector3f, Vector4f
from scanner_sim.foundation.streams import Stream
from scanner_sim.render.background import sky
from scanner_sim.render.background.paths import trace_paths
from scanner_sim.render.garbage import garbage_waits
from scanner_sim.render.rays import is_occluded
from scanner_sim.render.transport import OpticalLayout, device_frame
from scanner_sim.scene.files.loader import LoadedScene

_STREAM_ADDRESS = 0xFFFFFFF0
"""Addresses of the random points, none of which a path has."""
_OVERSAMPLING = 8
"""Points drawn for one that is kept: most of a body is hidden by itself."""
_DISC_POINTS = 256
"""Points of the Sun's disc to which lines of sight are traced."""


@dataclass(frozen=True)
class SurfaceSamples:
    """Points on the side of a target that the scanner sees, Dr.Jit: ``point`` and unit ``normal``, shape (n,)."""

    point: Vector3f
    normal: Vector3f

    @property
    def count(self) -> int:
        """Number of points."""
        return int(dr.width(self.point))


@dataclass(frozen=True)
class Sight:
    """Lines of sight through the lens: ``angle`` in the plane at ``phi`` [rad], float64, shape (n,)."""

    angle: NDArray[np.float64]
    phi: NDArray[np.float64]


def visible_samples(loaded: LoadedScene, number: int, count: int, seed: int) -> SurfaceSamples:
    """Return points spread evenly over what the scanner sees of an object.

    Parameters
    ----------
    loaded
        The scene, its moving objects at one instant.
    number
        The object's, from 1.
    count
        Largest number of points; fewer are returned if hardly any of its surface is seen, and none if none is.
    seed
        Seed of the points.
    """
    object_of = loaded.object_of.numpy()
    shapes = [shape for shape in loaded.shapes if object_of[_index(shape)] == number]
    poses = dict(zip((body.item.name for body in loaded.bodies), loaded.poses, strict=True))
    pose = poses.get(loaded.owners[number - 1])
    areas = np.array([float(np.ravel(shape.surface_area())[0]) for shape in shapes])
    ends = np.rint(_OVERSAMPLING * count * np.concatenate([[0.0], np.cumsum(areas) / areas.sum()])).astype(
        int
    )
    points, normals = [], []
    for part, (shape, start, end) in enumerate(zip(shapes, ends, ends[1:], strict=False)):
        if end == start:
            continue
        lane = dr.arange(mi.UInt32, int(end - start))
        drawn = generator(
            seed, Stream.BACKGROUND, mi.UInt32(_STREAM_ADDRESS), lane + 65536 * part
        ).next_float32x4()
        found = shape.sample_position(0.0, mi.Point2f(drawn[0], drawn[1]))
        # A flat shape has one normal for all of its points.
        position, facing = found.p, found.n + dr.zeros(mi.Normal3f, dr.width(lane))
        if pose is not None:
            position, facing = pose.rotation @ position + pose.position, pose.rotation @ facing
        points.append(position.numpy().T)
        normals.append(facing.numpy().T)
    if not points:
        return SurfaceSamples(mi.Point3f(), mi.Normal3f())
    point: Vector3f = mi.Point3f(np.concatenate(points).T)
    normal: Vector3f = mi.Normal3f(np.concatenate(normals).T)
    # The side that faces the scanner, at the origin; a little off the surface, so as not to shade itself.
    normal = dr.select(dr.dot(normal, point) > 0.0, -normal, normal)
    distance = dr.norm(point)
    point = point + normal * (1e-5 * distance)
    ray: Ray3f = mi.Ray3f(point, -point / distance)
    ray.maxt = distance
    hidden = is_occluded(loaded, ray) | (point.z <= 0.0)
    kept = np.flatnonzero(~np.asarray(hidden.numpy(), dtype=bool))
    kept = kept[:: max(1, math.ceil(len(kept) / count))]
    return SurfaceSamples(mi.Point3f(point.numpy()[:, kept]), mi.Normal3f(normal.numpy()[:, kept]))


def sunlit_share(loaded: LoadedScene, light: sky.SkyLight, samples: SurfaceSamples, seed: int) -> float:
    """Return the share of a target's points that the Sun reaches, each by one point of its disc."""
    draws = generator(
        seed, Stream.BACKGROUND, mi.UInt32(_STREAM_ADDRESS + 1), dr.arange(mi.UInt32, samples.count)
    ).next_float32x4()
    towards, _ = sky.sample_sun(light, mi.Point2f(draws[0], draws[1]))
    useful = (dr.dot(towards, samples.normal) > 0.0) & (sky.sun_radiance(light, towards) > 0.0)
    hidden = is_occluded(loaded, mi.Ray3f(samples.point, towards), active=useful)
    return float(np.mean((useful & ~hidden).numpy()))


def earth_irradiance(
    loaded: LoadedScene, light: sky.SkyLight, albedo: float, samples: SurfaceSamples, seed: int
) -> float:
    """Return the mean irradiance of a target's points by the Earth, in units of the Sun's irradiance."""
    rays = 4
    lane = dr.arange(mi.UInt32, samples.count * rays)
    draws = generator(seed, Stream.BACKGROUND, mi.UInt32(_STREAM_ADDRESS + 2), lane).next_float32x4()
    towards, density = sky.sample_earth(light, mi.Point2f(draws[0], draws[1]))
    point, normal = dr.repeat(samples.point, rays), dr.repeat(samples.normal, rays)
    cosine = dr.dot(towards, normal)
    useful = (cosine > 0.0) & (density > 0.0)
    hidden = is_occluded(loaded, mi.Ray3f(point, towards), active=useful)
    received = sky.earth_radiance(light, towards) * cosine / dr.maximum(density, 1e-20)
    return albedo * float(np.mean(dr.select(useful & ~hidden, received, 0.0).numpy()))


@garbage_waits()
def trace_sunlight(
    loaded: LoadedScene,
    layout: OpticalLayout,
    light: sky.SkyLight,
    sight: Sight,
    bounces: int,
    seed: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Follow light of Sun and Earth back along lines of sight.

    Returns
    -------
    tuple
        Radiance from surfaces per unit of the Sun's irradiance [1/sr], each of shape (n,): in band and out of band
        in all, and the sharp part of both, which is what the first surface makes of the Sun. Sun and
        Earth that are looked at themselves count as 0.
    """
    lane = dr.arange(mi.UInt32, len(sight.angle))
    frame = device_frame(
        layout, mi.Float(sight.angle.astype(np.float32)), mi.Float(sight.phi.astype(np.float32))
    )

    def random(number: UInt32) -> Vector4f:
        return generator(
            seed, Stream.BACKGROUND, mi.UInt32(_STREAM_ADDRESS + 3), lane * 64 + number
        ).next_float32x4()

    seen, first = trace_paths(
        loaded, light, bounces, mi.Point3f(frame.lens), mi.Vector3f(frame.along), random
    )
    surface = first.material > 0
    layers = (seen.direct + seen.indirect, seen.direct_out + seen.indirect_out, seen.direct, seen.direct_out)
    in_band, out, sharp, sharp_out = (
        dr.select(surface, layer, 0.0).numpy().astype(np.float64) for layer in layers
    )
    return in_band, out, sharp, sharp_out


def sun_at(
    loaded: LoadedScene, layout: OpticalLayout, light: sky.SkyLight, seed: int
) -> tuple[Sight, NDArray[np.bool_]]:
    """Return lines of sight through the lens to points of the Sun's disc, and which of them are free.

    One is free where neither the Earth nor an object is in front of the Sun, and it stands before the scanner.
    """
    lane = dr.arange(mi.UInt32, _DISC_POINTS)
    draws = generator(seed, Stream.BACKGROUND, mi.UInt32(_STREAM_ADDRESS + 4), lane).next_float32x4()
    towards, density = sky.sample_sun(light, mi.Point2f(draws[0], draws[1]))
    x, y, z = towards.numpy().astype(np.float64)
    sight = Sight(np.arcsin(np.clip(x, -1.0, 1.0)), np.arctan2(y, z))
    frame = device_frame(
        layout, mi.Float(sight.angle.astype(np.float32)), mi.Float(sight.phi.astype(np.float32))
    )
    useful = (density > 0.0) & (sky.sun_radiance(light, towards) > 0.0) & (towards.z > 0.0)
    hidden = is_occluded(loaded, mi.Ray3f(mi.Point3f(frame.lens), towards), active=useful)
    return sight, np.asarray((useful & ~hidden).numpy(), dtype=bool)


def half_height(layout: OpticalLayout) -> float:
    """Return half the angle that a pixel's height sees [rad]."""
    return math.atan(0.5 * layout.height / layout.receiver.focal_length)


def _index(shape: mi.Mesh) -> int:
    number: UInt32 = dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))
    return int(number[0])
