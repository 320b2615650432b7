"""The laser's light, from its beam over the scene into a lens.

Each shot's beam is a sum of Gaussian beamlets (:mod:`scanner_sim.render.beam.beamlets`). A beamlet follows a straight
line of the beam's ruled hyperboloid, so that the radius w(z) is exact at every distance. What its Gaussian becomes
behind the lens stands in :mod:`scanner_sim.render.beam.projection`; there are no random numbers.

Radiometry: power into the lens from a beamlet of power P on a surface with BSDF f_r is
P f_r cosθ_o · A cosθ_l / r² · T (Pedrotti, *Introduction to optics*, 3rd ed., ch. 5; eq 19 for a Lambertian
surface on the axis), averaged over points of the aperture, each with its own line of sight.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import drjit as dr
import mitsuba as mi

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_types import Float, Mask, SurfaceInteraction3f, UInt32, Vector3f
from scanner_sim.optics.deflection import Frame, deflected_frame, turned_axis_frame
from scanner_sim.optics.laser import Laser
from scanner_sim.optics.lens_errors import LensErrors
from scanner_sim.optics.line_image import ArrayPlace
from scanner_sim.optics.receiver import Receiver
from scanner_sim.render.beam.beamlets import Beamlets
from scanner_sim.render.rays import intersect, is_occluded
from scanner_sim.render.shot_departures import ShotDepartures
from scanner_sim.render.shots import Shots
from scanner_sim.scene.files.loader import LoadedScene

_NONZERO = 1e-30


@dataclass(frozen=True)
class OpticalLayout:
    """The numbers of the optical bench that the light meets, SI.

    ``axes`` are offset [m] and skew [rad] of the second axis, and ``lens`` what lens and array do to an image; None
    where they are as designed.
    """

    laser: Laser
    receiver: Receiver
    axis_separation: float
    filter_transmission: float
    pitch: float
    height: float
    offset: float
    diffusion: float
    axes: tuple[float, float] | None = None
    lens: LensErrors | None = None

    @property
    def point_spread(self) -> float:
        """Standard deviation of the image of a point on an upright line in focus [m], per axis."""
        return math.hypot(self.receiver.aberration, self.diffusion)

    def seen_at(self, theta: Float) -> Callable[[Float], ArrayPlace]:
        """Return how the line sees beams, deflected by Θ [rad], at positions [pixel]; lengths in pixels."""
        shift = dr.opaque(mi.Float, self.receiver.baseline) * dr.cos(theta)

        def seen(pixel: Float) -> ArrayPlace:
            offset, pitch = dr.opaque(mi.Float, self.offset), dr.opaque(mi.Float, self.pitch)
            return self.receiver.line_image.at(offset + (pixel + 0.5) * pitch, shift, self.pitch)

        return seen

    def twist(self, distance: Float) -> Float:
        """Return (z − z₀)/z_R at distances z [m] along the beam: its ruled lines turn about its axis by atan of it."""
        waist = dr.opaque(mi.Float, self.laser.waist_distance)
        return (distance - waist) / dr.opaque(mi.Float, self.laser.rayleigh_length)

    def beam_sigma(self, twist: Float) -> Float:
        """Return the standard deviation of the beam's irradiance, w/2 [m], where it has a :meth:`twist`."""
        return dr.opaque(mi.Float, 0.5 * self.laser.waist_radius) * dr.sqrt(1.0 + dr.square(twist))


@dataclass
class Drawn:
    """Beamlets, Dr.Jit arrays of one shape.

    ``node`` across the beam and ``stop`` in the aperture, two numbers each; ``weight``; ``time`` in the dwell;
    ``variance`` of the beamlet, in those of the beam, and ``time_variance`` of the moments for which it stands; in
    these ``node`` goes by ``drift`` a dwell, two numbers, None where each has one moment.
    """

    node: list[Float]
    stop: list[Float]
    weight: Float
    time: Float
    variance: Float
    time_variance: Float
    drift: list[Float] | None


@dataclass
class BeamletTables:
    """Beamlets on the device, Dr.Jit arrays of shape (k,): for those that trace the same ones again and again.

    ``across`` and ``normal`` are the nodes, ``stop_across`` and ``stop_normal`` the points of the aperture; the rest is
    as in :class:`~scanner_sim.render.beam.beamlets.Beamlets`.
    """

    across: Float
    normal: Float
    stop_across: Float
    stop_normal: Float
    weights: Float
    times: Float
    variances: Float

    @classmethod
    def of(cls, beamlets: Beamlets) -> BeamletTables:
        """Return the tables of beamlets."""
        columns = (
            *beamlets.nodes.T,
            *beamlets.aperture.T,
            beamlets.weights,
            beamlets.times,
            beamlets.variances,
        )
        return cls(*(mi.Float(for_device(values)) for values in columns))

    @property
    def count(self) -> int:
        """Number of beamlets."""
        return int(dr.width(self.weights))

    def draw(self, beamlet: UInt32, shot: UInt32) -> Drawn:  # noqa: ARG002 (alike in all)
        """Return beamlets, by their numbers; each has one moment."""
        across, normal, first, second, weight, time, variance = (
            dr.gather(mi.Float, values, beamlet)
            for values in (
                self.across,
                self.normal,
                self.stop_across,
                self.stop_normal,
                self.weights,
                self.times,
                self.variances,
            )
        )
        return Drawn([across, normal], [first, second], weight, time, variance, mi.Float(0.0), None)


@dataclass
class Lanes(Drawn):
    """A lane for each of k beamlets of each of n shots: lane i · k + j is beamlet j of shot i.

    ``count`` is k; Dr.Jit arrays of shape (n · k,): ``shot`` and ``beamlet`` i and j; ``own`` the shot itself.
    """

    count: int
    shot: UInt32
    beamlet: UInt32
    own: Shots


class Split(Protocol):
    """How the beams of shots are split into ``count`` beamlets each."""

    @property
    def count(self) -> int:
        """Number of beamlets of each shot."""

    def draw(self, beamlet: UInt32, shot: UInt32) -> Drawn:
        """Return beamlets of shots, by their numbers."""


def lanes(beamlets: Beamlets | Split, shots: Shots) -> Lanes:
    """Return the lanes of all beamlets of all shots: neighbours trace alike."""
    split: Split = BeamletTables.of(beamlets) if isinstance(beamlets, Beamlets) else beamlets
    count = split.count
    lane = dr.arange(mi.UInt32, dr.width(shots.theta) * count)
    shot = lane // count
    beamlet = lane - shot * count
    drawn = split.draw(beamlet, shot)
    return Lanes(**vars(drawn), count=count, shot=shot, beamlet=beamlet, own=shots.take(shot))


def frame_at(layout: OpticalLayout, shots: Shots, time: Float) -> Frame:
    """Return the deflected optics of shots at moments of their dwell, in units of it about its middle."""
    return device_frame(
        layout,
        shots.theta + time * shots.travel_theta,
        shots.phi + time * shots.travel_phi,
        shots.departures,
    )


def device_frame(
    layout: OpticalLayout, theta: Float, phi: Float, departures: ShotDepartures | None = None
) -> Frame:
    """Return the deflected optics with Dr.Jit vectors, with what of them differs from shot to shot."""
    sin_theta, cos_theta = dr.sincos(theta)
    sin_phi, cos_phi = dr.sincos(phi)
    separation = dr.opaque(mi.Float, layout.axis_separation)
    baseline = dr.opaque(mi.Float, layout.receiver.baseline)
    if departures is not None and departures.base is not None:
        baseline = baseline + departures.base
    turns = sin_theta, cos_theta, sin_phi, cos_phi
    if layout.axes is None:
        parts = deflected_frame(*turns, separation, baseline)
    else:
        axis = (dr.opaque(mi.Float, value) for value in layout.axes)
        parts = turned_axis_frame(*turns, separation, baseline, *axis)
    frame = Frame(*(mi.Vector3f(*part) for part in parts))
    return frame if departures is None else departures.moved(frame)


@dataclass
class Launch:
    """Rays as they leave the laser."""

    origin: Vector3f
    direction: Vector3f


def launch(layout: OpticalLayout, frame: Frame, node: list[Float]) -> Launch:
    """Return the straight lines of the beam's ruled hyperboloid through nodes (in standard deviations).

    A line that passes the waist at (a, b) with the slope (−b, a)/z_R stays at the same number of standard
    deviations of the beam at every distance.
    """
    laser = layout.laser
    waist = dr.opaque(mi.Float, 0.5 * laser.waist_radius)
    rayleigh = dr.opaque(mi.Float, laser.rayleigh_length)
    to_waist = dr.opaque(mi.Float, laser.waist_distance)
    a, b = node[0] * waist, node[1] * waist
    slope_a, slope_b = -b / rayleigh, a / rayleigh
    start_a, start_b = a - slope_a * to_waist, b - slope_b * to_waist
    return Launch(
        mi.Point3f(frame.laser + frame.across * start_a + frame.normal * start_b),
        dr.normalize(frame.along + frame.across * slope_a + frame.normal * slope_b),
    )


def meet(
    loaded: LoadedScene, origin: Vector3f, direction: Vector3f, active: Mask = True, coherent: bool = True
) -> SurfaceInteraction3f:
    """Return the surfaces that rays meet, with what a BSDF needs; ``loaded`` has the poses of these rays."""
    flags = mi.RayFlags.UV | mi.RayFlags.ShadingFrame
    return intersect(loaded, mi.Ray3f(origin, direction), flags, coherent=coherent, active=active)


def connect(
    loaded: LoadedScene,
    layout: OpticalLayout,
    frame: Frame,
    si: SurfaceInteraction3f,
    stop: list[Float],
    active: Mask,
    coherent: bool = True,
) -> tuple[Float, Mask]:
    """Connect surface points to points of the receiving aperture.

    Returns
    -------
    tuple
        Share of the power that arrives at the point and passes the lens and the filter, 0 where the lens does
        not see the point; and whether it does.
    """
    eye = stop_at(layout, frame, stop)
    returned = returns_to(layout, frame, si, eye, active)
    wanted = returned > 0.0
    seen = wanted & ~is_occluded(loaded, si.spawn_ray_to(eye), coherent=coherent, active=wanted)
    return dr.select(seen, returned, 0.0), seen


def stop_at(layout: OpticalLayout, frame: Frame, stop: list[Float]) -> Vector3f:
    """Return points of the receiving aperture, of those of its unit disc."""
    radius = 0.5 * dr.opaque(mi.Float, layout.receiver.aperture)
    return mi.Point3f(frame.lens + frame.across * (stop[0] * radius) + frame.normal * (stop[1] * radius))


def returns_to(
    layout: OpticalLayout, frame: Frame, si: SurfaceInteraction3f, eye: Vector3f, active: Mask
) -> Float:
    """Return the share of the power at surface points that passes lens and filter if nothing is between."""
    receiver = layout.receiver
    sight: Vector3f = eye - si.p
    squared = dr.maximum(dr.squared_norm(sight), _NONZERO)
    towards = sight * dr.rsqrt(squared)
    reflected = si.bsdf().eval(mi.BSDFContext(), si, si.to_local(towards), active)[0]
    facing = -dr.dot(towards, frame.along)
    gain = dr.opaque(mi.Float, receiver.aperture_area * receiver.transmission * layout.filter_transmission)
    wanted = active & (facing > 0.0) & (reflected > 0.0)
    return dr.select(wanted, reflected * facing / squared * gain, 0.0)
