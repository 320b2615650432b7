"""From beamlets to what each of them brings back, laid on a coordinate: the line's pixels, or metres of path.

Light of every kind leaves the laser, meets a surface and is seen by a lens in the same way. Where it is laid then, and
what calls for finer beamlets there, a projection says: :mod:`scanner_sim.render.beam.line_projection` for the line
sensor, :mod:`scanner_sim.render.beam.path_projection` for the photodiode.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import drjit as dr
import mitsuba as mi

from scanner_sim.foundation.device_types import Float, Mask, SurfaceInteraction3f, UInt32, Vector3f
from scanner_sim.optics.deflection import Frame
from scanner_sim.render.beam.beamlets import Beamlets
from scanner_sim.render.rays import met_shape, pose_scene
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import (
    Lanes,
    Launch,
    OpticalLayout,
    Split,
    connect,
    frame_at,
    lanes,
    launch,
    meet,
    returns_to,
    stop_at,
)
from scanner_sim.scene.files.loader import LoadedScene

_LEAST_COSINE = 0.02
"""Least cosine of incidence for the beamlet's footprint; nearer to grazing it stays at this size."""


@dataclass
class Spots:
    """Gaussian spots of light on the coordinate of a projection, Dr.Jit arrays of one length.

    ``power`` that arrives, 0 where none does, [W] or as a share of a pulse's; ``position`` and standard deviation
    ``sigma`` [pixel] or [m]; ``coherence`` squared contrast of the speckle, None where the surface that the chief ray
    meets tells it.
    """

    power: Float
    position: Float
    sigma: Float
    coherence: Float | None = None


@dataclass
class Laid:
    """Beamlets' light on the coordinate.

    ``position``, and ``sigma``, of the share ``kept`` of it that lies there, and ``shift`` of that position against the
    whole; ``slope_a`` and ``slope_b`` the derivatives of the position along the beam's two axes, per standard deviation
    of the beam, ``slope_time`` that along the dwell, per dwell. ``reference`` is what the positions of a shot are
    counted from, shape (n,), None for 0.
    """

    position: Float
    sigma: Float
    kept: Float
    shift: Float
    slope_a: Float
    slope_b: Float
    slope_time: Float
    reference: Float | None = None


@dataclass
class BeamletReturns:
    """What beamlets bring back from the first surface, Dr.Jit arrays: entry i · k + j is beamlet j of shot i.

    ``spots``; ``strength`` the power that the lens takes in, per power of the beamlet; ``laid`` where it lies;
    ``distance`` along the beamlet [m], NaN for nothing; ``seen`` 1 where the lens sees it; ``shape`` registry index of
    the surface, 0 for none.
    """

    spots: Spots
    strength: Float
    laid: Laid
    distance: Float
    seen: UInt32
    shape: UInt32


@dataclass
class Hits:
    """Where beamlets meet their first surfaces, one lane each.

    ``frame`` the deflected optics; ``beam`` the rays; ``si`` the surfaces; ``strength`` and ``seen`` are those of
    :class:`BeamletReturns`, the second as a mask; ``late`` by how much the mean moment of what comes back is after
    the one at which they were fired [dwell], None for 0.
    """

    lane: Lanes
    frame: Frame
    beam: Launch
    si: SurfaceInteraction3f
    strength: Float
    seen: Mask
    late: Float | None

    def slides(self) -> list[Vector3f]:
        """Return how far the surface point moves where the beam moves along its two axes, on the tangent plane."""
        normal, direction = self.si.n, self.beam.direction
        cosine: Any = dr.dot(normal, direction)
        cosine = dr.select(
            dr.abs(cosine) < _LEAST_COSINE, dr.copysign(mi.Float(_LEAST_COSINE), cosine), cosine
        )
        return [
            axis - direction * (dr.dot(normal, axis) / cosine)
            for axis in (self.frame.across, self.frame.normal)
        ]


@dataclass(frozen=True)
class Resolution:
    """What calls for more beamlets on a coordinate, and how clusters are kept there, in its unit.

    Attributes
    ----------
    uneven_departure
        Departure of a beamlet's position from the tangent plane's that calls for more beamlets.
    edge_departure
        The same departure that can only be an edge of depth.
    gaussian_travel
        Way of a spot during the dwell beyond which its light is no longer nearly Gaussian.
    least_variance
        Floor of a cluster's variance: rounding cannot make it negative.
    moments_about
        Point about which a cluster's moments are summed, from 0 at its low end to 1 at its high one.
    keeps_coherence
        Whether clusters keep the coherence of their light; else that of the chief ray's surface stands for it.
    """

    uneven_departure: float
    edge_departure: float
    gaussian_travel: float
    least_variance: float
    moments_about: float
    keeps_coherence: bool


class Projection(Protocol):
    """Onto what coordinate light is laid, and what calls for finer beamlets there."""

    @property
    def layout(self) -> OpticalLayout:
        """The optics."""

    def power(self, shots: Shots) -> Float:
        """Return the power of the beams of shots, in the unit of :class:`Spots`: one number, or one for each."""

    @property
    def resolution(self) -> Resolution:
        """How finely light is followed."""

    def fired(self, shots: Shots) -> Shots:
        """Return the shots with the way that the beam travels while this light shines."""

    def seen_from(self, frame: Frame) -> Frame:
        """Return the deflected optics with the lens that sees the light."""

    def sees(self, frame: Frame, point: Vector3f) -> Mask:
        """Return whether points lie in the field of view."""

    def lay(self, hits: Hits) -> Laid:
        """Return where beamlets' light lies."""

    def lay_point(
        self, frame: Frame, shots: Shots, point: Vector3f, way: Float
    ) -> tuple[Float, Float, Float]:
        """Return position, standard deviation and share of the light of points at the end of a way [m] to them."""

    def is_unequal(self, strength: list[Float]) -> Mask:
        """Return whether one surface returns light so unequally that more beamlets are needed.

        ``strength`` is that of the chief beamlet and of those about it, opposite ones half their number apart.
        """


def trace_returns(
    loaded: LoadedScene, projection: Projection, beamlets: Beamlets | Split, shots: Shots
) -> BeamletReturns:
    """Return what all beamlets of all shots bring back.

    Parameters
    ----------
    loaded, projection
        The scene, and where light is laid.
    beamlets
        How the beam is split into k beamlets, each with its moment in the dwell.
    shots
        The n shots, as :meth:`Projection.fired` returns them.

    Returns
    -------
    BeamletReturns
        Arrays of n · k entries: neighbours trace alike.
    """
    return follow(loaded, projection, lanes(beamlets, shots))


def follow(loaded: LoadedScene, projection: Projection, lane: Lanes) -> BeamletReturns:
    """Return what beamlets bring back, one for each lane: see :func:`trace_returns`."""
    loaded = pose_scene(loaded, lane.own.poses)
    frame, beam, si, strength, seen = met_by(
        loaded, projection, lane.own, lane.node, lane.stop, lane.time, coherent=True
    )
    hit = si.is_valid()
    late = None
    shape = met_shape(si)
    if lane.drift is not None and loaded.has_narrow:
        narrow = seen & dr.gather(mi.Bool, loaded.narrow, dr.gather(mi.UInt32, loaded.material_of, shape))
        moments = partial(_over_moments, projection, lane, lane.drift, si, narrow)
        at_once = strength, dr.zeros(mi.Float, dr.width(lane.shot))
        strength, late = dr.if_stmt((), narrow, moments, lambda: at_once)
    laid = projection.lay(Hits(lane, frame, beam, si, strength, seen, late))
    spots = Spots(
        lane.weight * projection.power(lane.own) * strength * laid.kept,
        dr.select(hit, laid.position, 0.0),
        dr.select(hit, laid.sigma, 0.0),
    )
    if projection.resolution.keeps_coherence:
        material = dr.gather(mi.UInt32, loaded.material_of, shape)
        spots.coherence = dr.gather(mi.Float, loaded.coherence, material)
    return BeamletReturns(
        spots,
        strength,
        laid,
        dr.select(hit, si.t, dr.nan),
        dr.select(seen, mi.UInt32(1), 0),
        shape,
    )


def _over_moments(
    projection: Projection, lane: Lanes, drift: list[Float], si: SurfaceInteraction3f, seen: Mask
) -> tuple[Float, Float]:
    """Return the mean strength of beamlets over the moments for which they stand, and the mean moment of their light.

    While a beam passes a point, the way to the lens turns against that of the light: a narrow lobe returns more at one
    end of its moments than at the other. Two of them, a standard deviation before and after the mean, have the mean of
    a cubic (Gauss). What is seen at the mean counts as seen.
    """
    layout, apart = projection.layout, dr.sqrt(lane.time_variance)

    def at(side: Float) -> Float:
        frame = projection.seen_from(frame_at(layout, lane.own, lane.time + side))
        node = [place + side * rate for place, rate in zip(lane.node, drift, strict=True)]
        met = mi.SurfaceInteraction3f(si)
        met.wi = si.to_local(-launch(layout, frame, node).direction)
        return returns_to(layout, frame, met, stop_at(layout, frame, lane.stop), seen)

    before, after = at(-apart), at(apart)
    both = before + after
    return 0.5 * both, dr.select(both > 0.0, apart * (after - before) / both, 0.0)


def met_by(
    loaded: LoadedScene,
    projection: Projection,
    own: Shots,
    node: list[Float],
    stop: list[Float],
    time: Float,
    coherent: bool,
) -> tuple[Frame, Launch, SurfaceInteraction3f, Float, Mask]:
    """Return the deflected optics, the rays, what these meet, the power of it that the lens takes in, and if it does.

    Parameters
    ----------
    loaded, projection
        The scene with the poses of the rays, and who sees the light.
    own
        The shot of each ray.
    node, stop, time
        Of each ray as in :class:`~scanner_sim.render.transport.Drawn`.
    coherent
        Whether rays are traced side by side, where roundings depend on their neighbours in memory, or each for itself.
    """
    layout = projection.layout
    frame = projection.seen_from(frame_at(layout, own, time))
    beam = launch(layout, frame, node)
    si = meet(loaded, beam.origin, beam.direction, coherent=coherent)
    visible = si.is_valid() & projection.sees(frame, si.p)
    strength, seen = connect(loaded, layout, frame, si, stop, visible, coherent)
    return frame, beam, si, strength, seen
