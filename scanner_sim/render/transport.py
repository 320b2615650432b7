"""The laser's light, from its beam over the scene into the pixels' plane.

Each shot's beam is a sum of Gaussian beamlets (:mod:`scanner_sim.render.beam.beamlets`). A beamlet follows a straight
line of the beam's ruled hyperboloid, so that the radius w(z) is exact at every distance; where it meets a
surface, the surface's tangent plane and the lens map its Gaussian onto the sensor; the pixels' height cuts it.
What arrives is a list of *spots*: power, position and width on the line, without random numbers.

Radiometry: power into the lens from a beamlet of power P on a surface with BSDF f_r is
P f_r cosθ_o · A cosθ_l / r² · T (Pedrotti, *Introduction to optics*, 3rd ed., ch. 5; eq 19 for a Lambertian
surface on the axis), averaged over points of the aperture, each with its own line of sight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import drjit as dr
import mitsuba as mi
import numpy as np

from scanner_sim.foundation.device_types import Float, Mask, SurfaceInteraction3f, UInt32, Vector3f
from scanner_sim.optics.deflection import Frame, deflected_frame
from scanner_sim.optics.laser import Laser
from scanner_sim.optics.receiver import Receiver
from scanner_sim.render.beam.beamlets import Beamlets
from scanner_sim.render.rays import intersect, is_occluded, pose_scene
from scanner_sim.render.shots import Shots
from scanner_sim.scene.files.loader import LoadedScene

_LEAST_COSINE = 0.02
"""Least cosine of incidence for the beamlet's footprint; nearer to grazing it stays at this size."""
_NONZERO = 1e-30


@dataclass(frozen=True)
class OpticalLayout:
    """The numbers of the optical bench that the light meets, SI."""

    laser: Laser
    receiver: Receiver
    axis_separation: float
    filter_transmission: float
    pitch: float
    height: float
    offset: float
    diffusion: float

    @property
    def point_spread(self) -> float:
        """Standard deviation of the image of a point on the line [m], per axis."""
        return math.hypot(self.receiver.aberration, self.diffusion)


@dataclass
class Spots:
    """Spots on the line, all Dr.Jit arrays of one length.

    ``position`` and ``sigma`` of the Gaussian along the line [pixel], ``power`` that reaches the line's
    height [W] (0 where nothing arrives), ``strength`` the power before the height cuts it, per power of the
    beamlet; ``slope_a``, ``slope_b`` the derivatives of the position along the beam's two axes, per standard
    deviation of the beam [pixel], ``slope_time`` that along the dwell, per dwell [pixel]; ``distance`` along
    the beamlet [m], ``seen`` 1 where the lens sees it; ``shape`` registry index of the surface, 0 for none;
    ``coherence`` squared contrast of its speckle.
    """

    position: Float
    sigma: Float
    power: Float
    strength: Float
    slope_a: Float
    slope_b: Float
    slope_time: Float
    distance: Float
    seen: UInt32
    shape: UInt32
    coherence: Float


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
    width: float

    @classmethod
    def of(cls, beamlets: Beamlets) -> BeamletTables:
        """Return the tables of beamlets."""
        columns = (*beamlets.nodes.T, *beamlets.aperture.T, beamlets.weights, beamlets.times)
        a, b, c, d, e, f = (mi.Float(values.astype(np.float32)) for values in columns)
        return cls(a, b, c, d, e, f, beamlets.width)

    @property
    def count(self) -> int:
        """Number of beamlets."""
        return int(dr.width(self.weights))

    def draw(self, beamlet: UInt32, shot: UInt32) -> tuple[list[Float], list[Float], Float, Float]:  # noqa: ARG002 (alike in all)
        """Return nodes, points of the aperture, weights and moments of beamlets, by their numbers."""
        across, normal, first, second, weight, time = (
            dr.gather(mi.Float, values, beamlet)
            for values in (
                self.across,
                self.normal,
                self.stop_across,
                self.stop_normal,
                self.weights,
                self.times,
            )
        )
        return [across, normal], [first, second], weight, time


@dataclass
class Lanes:
    """A lane for each of k beamlets of each of n shots: lane i · k + j is beamlet j of shot i.

    Dr.Jit arrays of shape (n · k,): ``shot`` and ``beamlet`` i and j; ``own`` the shot itself; ``node``, ``stop``,
    ``weight`` and ``time`` of the beamlet.
    """

    shot: UInt32
    beamlet: UInt32
    own: Shots
    node: list[Float]
    stop: list[Float]
    weight: Float
    time: Float


class Split(Protocol):
    """How the beams of shots are split into ``count`` beamlets of a width each."""

    @property
    def count(self) -> int:
        """Number of beamlets of each shot."""

    @property
    def width(self) -> float:
        """Standard deviation of each, in those of the beam."""

    def draw(self, beamlet: UInt32, shot: UInt32) -> tuple[list[Float], list[Float], Float, Float]:
        """Return nodes, points of the aperture, weights and moments of beamlets of shots, by their numbers."""


def lanes(beamlets: Beamlets | Split, shots: Shots) -> Lanes:
    """Return the lanes of all beamlets of all shots: neighbours trace alike."""
    split: Split = BeamletTables.of(beamlets) if isinstance(beamlets, Beamlets) else beamlets
    count = split.count
    lane = dr.arange(mi.UInt32, dr.width(shots.theta) * count)
    shot = lane // count
    beamlet = lane - shot * count
    node, stop, weight, time = split.draw(beamlet, shot)
    return Lanes(shot, beamlet, shots.take(shot), node, stop, weight, time)


def trace_spots(
    loaded: LoadedScene, layout: OpticalLayout, beamlets: Beamlets | Split, shots: Shots
) -> Spots:
    """Return the direct spots of all beamlets of all shots.

    Parameters
    ----------
    loaded
        The scene.
    layout
        The optics.
    beamlets
        How the beam is split into k beamlets, each with its moment in the dwell.
    shots
        The n shots.

    Returns
    -------
    Spots
        Arrays of n · k entries; entry i · k + j is beamlet j of shot i: neighbours trace alike.
    """
    lane = lanes(beamlets, shots)
    frame = frame_at(layout, lane.own, lane.time)
    loaded = pose_scene(loaded, lane.own.poses)
    return _spots(loaded, layout, lane.own, frame, lane.node, lane.stop, lane.weight, beamlets.width)


def frame_at(layout: OpticalLayout, shots: Shots, time: Float) -> Frame:
    """Return the deflected optics of shots at moments of their dwell, in units of it about its middle."""
    return device_frame(layout, shots.theta + time * shots.travel_theta, shots.phi + time * shots.travel_phi)


def device_frame(layout: OpticalLayout, theta: Float, phi: Float) -> Frame:
    """Return the deflected optics with Dr.Jit vectors."""
    sin_theta, cos_theta = dr.sincos(theta)
    sin_phi, cos_phi = dr.sincos(phi)
    separation = dr.opaque(mi.Float, layout.axis_separation)
    baseline = dr.opaque(mi.Float, layout.receiver.baseline)
    parts = deflected_frame(sin_theta, cos_theta, sin_phi, cos_phi, separation, baseline)
    return Frame(*(mi.Vector3f(*part) for part in parts))


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
    receiver = layout.receiver
    radius = 0.5 * dr.opaque(mi.Float, receiver.aperture)
    eye = mi.Point3f(frame.lens + frame.across * (stop[0] * radius) + frame.normal * (stop[1] * radius))
    sight: Vector3f = eye - si.p
    squared = dr.maximum(dr.squared_norm(sight), _NONZERO)
    towards = sight * dr.rsqrt(squared)
    reflected = si.bsdf().eval(mi.BSDFContext(), si, si.to_local(towards), active)[0]
    facing = -dr.dot(towards, frame.along)
    wanted = active & (facing > 0.0) & (reflected > 0.0)
    seen = wanted & ~is_occluded(loaded, si.spawn_ray_to(eye), coherent=coherent, active=wanted)
    gain = dr.opaque(mi.Float, receiver.aperture_area * receiver.transmission * layout.filter_transmission)
    return dr.select(seen, reflected * facing / squared * gain, 0.0), seen


def image(layout: OpticalLayout, frame: Frame, point: Vector3f) -> tuple[Float, Float, Float]:
    """Return where the lens images points: p along the line, q across it (eq 1, exactly), and their depth [m]."""
    offset = mi.Vector3f(point - frame.lens)
    depth = dr.dot(offset, frame.along)
    scale = dr.opaque(mi.Float, layout.receiver.focal_length) / depth
    return -scale * dr.dot(offset, frame.across), scale * dr.dot(offset, frame.normal), depth


def synchronisation_shift(layout: OpticalLayout, p: Float, synchronisation: Float) -> Float:
    """Return where on the line light lands [m] whose receiver looks past the laser by an angle [rad].

    p = f tanα becomes f tan(α + e), to first order p + e (f + p²/f); the position across the line changes by e p/f of
    itself, which is left out.
    """
    f = dr.opaque(mi.Float, layout.receiver.focal_length)
    return p + synchronisation * (f + dr.square(p) / f)


def to_pixels(layout: OpticalLayout, p: Float) -> Float:
    """Return positions p [m] in pixels."""
    return (p - dr.opaque(mi.Float, layout.offset)) / dr.opaque(mi.Float, layout.pitch) - 0.5


def _spots(
    loaded: LoadedScene,
    layout: OpticalLayout,
    shots: Shots,
    frame: Frame,
    node: list[Float],
    stop: list[Float],
    weight: Float,
    width: float,
) -> Spots:
    """Trace one beamlet per lane and image it."""
    laser, receiver = layout.laser, layout.receiver
    beam = launch(layout, frame, node)
    si = meet(loaded, beam.origin, beam.direction)
    hit = si.is_valid()
    strength, seen = connect(loaded, layout, frame, si, stop, hit)
    p, q, depth = image(layout, frame, si.p)

    # Derivatives of the image along the two axes of the beam, on the surface's tangent plane.
    cosine: Any = dr.dot(si.n, beam.direction)
    cosine = dr.select(dr.abs(cosine) < _LEAST_COSINE, dr.copysign(mi.Float(_LEAST_COSINE), cosine), cosine)
    along_beam = (si.t - dr.opaque(mi.Float, laser.waist_distance)) / dr.opaque(
        mi.Float, laser.rayleigh_length
    )
    spread = dr.opaque(mi.Float, 0.5 * laser.waist_radius) * dr.sqrt(1.0 + dr.square(along_beam))
    f = dr.opaque(mi.Float, receiver.focal_length)

    def slopes(axis: Vector3f) -> tuple[Float, Float]:
        moved = (axis - beam.direction * (dr.dot(si.n, axis) / cosine)) * spread
        deeper = dr.dot(moved, frame.along)
        return (
            (-f * dr.dot(moved, frame.across) - p * deeper) / depth,
            (f * dr.dot(moved, frame.normal) - q * deeper) / depth,
        )

    (pa, qa), (pb, qb) = slopes(frame.across), slopes(frame.normal)
    # The same for the sweep. The first mirror turns the beam about the laser, and the lens's axis turns with it; the
    # second carries beam and lens round its axis together, and only the slide along the beam is seen.
    reach = si.t * frame.across.x - dr.opaque(mi.Float, layout.axis_separation)
    pt = shots.travel_theta * (pa * si.t / spread + f + dr.square(p) / f) + shots.travel_phi * (
        pb * reach / spread
    )
    residual = dr.opaque(mi.Float, width**2)
    blur = dr.opaque(mi.Float, layout.point_spread**2)
    var_p = residual * (dr.square(pa) + dr.square(pb)) + blur
    var_q = residual * (dr.square(qa) + dr.square(qb)) + blur
    covariance = residual * (pa * qa + pb * qb)
    height = dr.opaque(mi.Float, layout.height)
    p = synchronisation_shift(layout, p, shots.synchronisation)
    inside, p, var_p = cut_by_height(p, q, var_p, var_q, covariance, height)
    shape: UInt32 = dr.select(hit, dr.reinterpret_array(mi.UInt32, si.shape), 0)

    pitch = dr.opaque(mi.Float, layout.pitch)
    return Spots(
        position=dr.select(hit, to_pixels(layout, p), 0.0),
        sigma=dr.select(hit, dr.sqrt(var_p) / pitch, 1.0),
        power=weight * dr.opaque(mi.Float, laser.power) * strength * inside,
        strength=strength,
        slope_a=pa / pitch,
        slope_b=pb / pitch,
        slope_time=pt / pitch,
        distance=dr.select(hit, si.t, dr.nan),
        seen=dr.select(seen, mi.UInt32(1), 0),
        shape=shape,
        coherence=dr.gather(mi.Float, loaded.coherence, dr.gather(mi.UInt32, loaded.material_of, shape)),
    )


def cut_by_height(
    p: Float, q: Float, var_p: Float, var_q: Float, covariance: Float, height: Float
) -> tuple[Float, Float, Float]:
    """Return the share of a two-dimensional Gaussian within |q| < height/2, and mean and variance of p there.

    Moments of the truncated normal distribution (Johnson, Kotz, Balakrishnan, *Continuous univariate
    distributions* 1, 1994, ch. 13), carried over to p by the regression of p on q.
    """
    sigma_q = dr.sqrt(var_q)
    low, high = (-0.5 * height - q) / sigma_q, (0.5 * height - q) / sigma_q
    share = 0.5 * (dr.erf(high * math.sqrt(0.5)) - dr.erf(low * math.sqrt(0.5)))
    density = [dr.exp(-0.5 * dr.square(end)) / math.sqrt(2.0 * math.pi) for end in (low, high)]
    safe = dr.maximum(share, 1e-6)
    shift = (density[0] - density[1]) / safe
    narrowing = (low * density[0] - high * density[1]) / safe - dr.square(shift)
    share = dr.select(share > 1e-6, share, 0.0)
    regression = covariance / var_q
    return (
        share,
        p + dr.select(share > 0.0, regression * sigma_q * shift, 0.0),
        dr.maximum(var_p + dr.select(share > 0.0, regression * covariance * narrowing, 0.0), 0.1 * var_p),
    )
