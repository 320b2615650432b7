"""The brute-force judge of the light transport: one shot by millions of random rays, for laser and background.

Every ray draws its position and direction in the beam (the phase-space density of a Gaussian beam: independent
normal position at the waist and normal direction), a point of the receiving aperture, its position in the point
spread, and a moment in the dwell; it is counted in the pixel where it lands. No beamlets, no tangent planes, no closed
forms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_streams import generator
from scanner_sim.foundation.device_types import Float, UInt32, Vector3f, Vector4f
from scanner_sim.foundation.streams import Stream
from scanner_sim.render.background.paths import trace_paths
from scanner_sim.render.background.sky import SkyLight
from scanner_sim.render.garbage import garbage_waits
from scanner_sim.render.rays import intersect, is_occluded
from scanner_sim.render.transport import OpticalLayout, device_frame
from scanner_sim.scene.files.loader import LoadedScene

_RAYS_TOGETHER = 1 << 21


@dataclass(frozen=True)
class ReferenceLine:
    """Light on the line: mean and standard error of each pixel's power [W], shape (pixels,)."""

    power: NDArray[np.float64]
    standard_error: NDArray[np.float64]


@garbage_waits()
def reference_line(
    loaded: LoadedScene,
    layout: OpticalLayout,
    pixels: int,
    theta: float,
    phi: float,
    *,
    travel: tuple[float, float] = (0.0, 0.0),
    synchronisation: float = 0.0,
    rays: int = 1 << 20,
    seed: int = 0,
    shot: int = 0,
) -> ReferenceLine:
    """Return the light of one shot at deflections (Θ, φ) [rad] by brute force.

    Parameters
    ----------
    loaded, layout
        Scene and optics.
    pixels
        Number of pixels of the line.
    theta, phi
        True deflections in the middle of the dwell [rad].
    travel
        By how much they change during the dwell [rad].
    synchronisation
        Angle by which the receiver looks further along Θ than the laser [rad].
    rays
        Number of random rays.
    seed, shot
        Address of the random numbers.
    """
    total, squares = np.zeros(pixels), np.zeros(pixels)
    for start in range(0, rays, _RAYS_TOGETHER):
        number = dr.arange(mi.UInt32, start, min(start + _RAYS_TOGETHER, rays))
        moment = generator(seed, Stream.REFERENCE, mi.UInt32(shot + (1 << 30)), number).next_float32x4()[0]
        aim = theta + (moment - 0.5) * travel[0], phi + (moment - 0.5) * travel[1]
        pixel, power = _land(loaded, layout, aim, synchronisation, number, seed, shot)
        inside = (pixel >= 0) & (pixel < pixels) & (power > 0.0)
        where, amount = pixel[inside].astype(np.int64), power[inside].astype(np.float64)
        total += np.bincount(where, amount, pixels)
        squares += np.bincount(where, amount**2, pixels)
    mean = total / rays
    return ReferenceLine(mean, np.sqrt(np.maximum(squares / rays - mean**2, 0.0) / rays))


@garbage_waits()
def reference_background(
    loaded: LoadedScene,
    layout: OpticalLayout,
    light: SkyLight,
    pixels: int,
    theta: float,
    phi: float,
    *,
    bounces: int,
    samples: int,
    seed: int = 0,
    shot: int = 0,
) -> ReferenceLine:
    """Return the background of one voxel by brute force: random rays from each pixel's own field of view.

    No panorama, no filter, no interpolation: every ray starts in its pixel, is displaced by the point spread and
    leaves through the lens node; the falloff is that of the ray's own angle.

    Parameters
    ----------
    loaded, layout, light
        Scene, optics, Sun and Earth.
    pixels
        Number of pixels of the line.
    theta, phi
        True deflections [rad].
    bounces, samples
        Surfaces on a path; rays of each pixel.
    seed, shot
        Address of the random numbers.

    Returns
    -------
    ReferenceLine
        In band, for a Sun of 1 W/m².
    """
    receiver = layout.receiver
    number = dr.arange(mi.UInt32, pixels * samples)
    pixel = mi.Float(number // samples)

    def random(draw: UInt32) -> Vector4f:
        return generator(
            seed, Stream.REFERENCE, mi.UInt32(shot + (1 << 31)), number * 64 + draw
        ).next_float32x4()

    draws = random(mi.UInt32(62))
    blur = generator(
        seed, Stream.REFERENCE, mi.UInt32(shot + (1 << 31)), number * 64 + 63
    ).next_float32x4_normal()
    p = layout.offset + (pixel + draws[0]) * layout.pitch + blur[0] * layout.point_spread
    q = (draws[1] - 0.5) * layout.height + blur[1] * layout.point_spread
    along, across, normal, _, lens = device_frame(layout, mi.Float(theta), mi.Float(phi))
    direction = dr.normalize(along * receiver.focal_length - across * p + normal * q)
    origin = mi.Point3f(lens) + dr.zeros(mi.Point3f, dr.width(number))
    found, _ = trace_paths(loaded, light, bounces, origin, direction, random)
    gain = receiver.aperture_area * receiver.transmission * layout.filter_transmission
    gain *= layout.pitch * layout.height / receiver.focal_length**2
    falloff = dr.square(dr.square(dr.dot(direction, along)))
    power = ((found.direct + found.indirect) * falloff).numpy().astype(np.float64).reshape(
        pixels, samples
    ) * gain
    return ReferenceLine(power.mean(axis=1), power.std(axis=1, ddof=1) / math.sqrt(samples))


def _land(
    loaded: LoadedScene,
    layout: OpticalLayout,
    aim: tuple[Float, Float],
    synchronisation: float,
    number: mi.UInt32,
    seed: int,
    shot: int,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return where each ray lands [pixel number] and the power that it stands for [W]."""
    laser, receiver = layout.laser, layout.receiver
    random = generator(seed, Stream.REFERENCE, mi.UInt32(shot), number)
    beam, blur, stop = random.next_float32x4_normal(), random.next_float32x4_normal(), random.next_float32x4()
    along, across, normal, origin, lens = device_frame(layout, mi.Float(aim[0]), mi.Float(aim[1]))

    sigma = 0.5 * laser.waist_radius
    slope_a, slope_b = beam[2] * sigma / laser.rayleigh_length, beam[3] * sigma / laser.rayleigh_length
    a = beam[0] * sigma - slope_a * laser.waist_distance
    b = beam[1] * sigma - slope_b * laser.waist_distance
    direction = dr.normalize(along + across * slope_a + normal * slope_b)
    ray = mi.Ray3f(mi.Point3f(origin + across * a + normal * b), direction)
    si = intersect(loaded, ray)

    radius, angle = 0.5 * receiver.aperture * dr.sqrt(stop[0]), 2.0 * math.pi * stop[1]
    sin, cos = dr.sincos(angle)
    eye = mi.Point3f(lens + across * (radius * cos) + normal * (radius * sin))
    sight: Vector3f = eye - si.p
    towards = dr.normalize(sight)
    reflected = si.bsdf().eval(mi.BSDFContext(), si, si.to_local(towards), si.is_valid())[0]
    facing = -dr.dot(towards, along)
    seen = si.is_valid() & (facing > 0.0) & ~is_occluded(loaded, si.spawn_ray_to(eye))
    gain = receiver.aperture_area * receiver.transmission * layout.filter_transmission
    power = laser.power * reflected * facing / dr.squared_norm(sight) * gain

    # The receiver's own axes, turned past the laser's.
    sine, cosine = math.sin(synchronisation), math.cos(synchronisation)
    along, across = along * cosine + across * sine, across * cosine - along * sine
    offset = mi.Vector3f(si.p - lens)
    scale = receiver.focal_length / dr.dot(offset, along)
    p = -scale * dr.dot(offset, across) + layout.point_spread * blur[0]
    q = scale * dr.dot(offset, normal) + layout.point_spread * blur[1]
    seen &= dr.abs(q) < 0.5 * layout.height
    pixel = dr.floor((p - layout.offset) / layout.pitch)
    return dr.select(seen, pixel, -1.0).numpy(), dr.select(seen, power, 0.0).numpy()
