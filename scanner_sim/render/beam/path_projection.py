"""A pulse's light on the photodiode: metres of path from the laser to the surface and from there to the lens node.

To the node, not to the point of the aperture that a surface is seen from: by Fermat's principle all ways through the
lens to one image point are optically as long (Born and Wolf, *Principles of optics*, 7th ed., 1999, sec. 3.3.2). The
surface's tangent plane turns the beamlet's width into a spread of its path, so that slopes stretch the pulse; beamlets
at different depths split it. A pulse lasts no part of the dwell: it is fired in its middle.

Not modelled: the index of refraction of air (there is none in orbit), the spread of delays within the lens, and the
lens's point spread at the edge of the photodiode's field, which cuts sharply.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import ClassVar

import drjit as dr
import mitsuba as mi

from scanner_sim.foundation.device_types import Float, Mask, Vector3f
from scanner_sim.optics.deflection import Frame
from scanner_sim.render.beam.projection import Hits, Laid, Resolution
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout

_NONZERO = 1e-6
_REFERENCES_PER_METRE = 64.0
"""References of paths are multiples of a 64th of a metre: differences from them are exact in single precision."""
_UNEVEN_STRENGTH = 0.1
"""Relative spread of the returned strength that calls for more beamlets."""


@dataclass(frozen=True)
class PathProjection:
    """The photodiode behind its lens: positions are paths there and back [m], power a share of the pulse's.

    Attributes
    ----------
    layout
        The optics.
    offset
        Whether its lens is the one at the triangulation base; else it looks along the laser.
    field_of_view
        Full angle of its round field [rad]. On the laser's axis the field is centred on the beam; beside it the field
        reaches from infinity inwards, and what is nearer than base/tan(angle) is not seen.
    """

    layout: OpticalLayout
    offset: bool
    field_of_view: float
    resolution: ClassVar[Resolution] = Resolution(
        uneven_departure=5e-3,
        edge_departure=20e-3,
        gaussian_travel=math.inf,
        least_variance=0.0,
        moments_about=0.5,
        keeps_coherence=False,
    )

    def power(self, shots: Shots) -> Float:
        """Return 1, or what the noise of the pulses' energy makes of it."""
        departures = shots.departures
        return (
            dr.opaque(mi.Float, 1.0) if departures is None or departures.pulse is None else departures.pulse
        )

    def fired(self, shots: Shots) -> Shots:
        """Return the shots at rest in the middle of their dwell."""
        return dataclasses.replace(shots, travel_theta=None, travel_phi=None)

    def seen_from(self, frame: Frame) -> Frame:
        """Return the deflected optics with the photodiode's lens."""
        return frame if self.offset else frame._replace(lens=frame.laser)

    def sees(self, frame: Frame, point: Vector3f) -> Mask:
        """Return whether points lie in the photodiode's field; ``frame`` is that of :meth:`seen_from`."""
        offset = mi.Vector3f(point - frame.lens)
        depth = dr.dot(offset, frame.along)
        half = dr.opaque(mi.Float, math.tan(0.5 * self.field_of_view))
        aside = -dr.dot(offset, frame.across) - (half * depth if self.offset else 0.0)
        above = dr.dot(offset, frame.normal)
        return (depth > 0.0) & (dr.square(aside) + dr.square(above) <= dr.square(half * depth))

    def lay(self, hits: Hits) -> Laid:
        """Return the beamlets' paths from their shot's reference, and the spread that the tangent plane gives them."""
        layout, si, lane = self.layout, hits.si, hits.lane
        hit = si.is_valid()
        back = mi.Vector3f(si.p - hits.frame.lens)
        length = dr.norm(back)
        whole = dr.select(hit, si.t + length, 0.0)
        dr.eval(si, hits.strength, hits.seen, length, whole)
        # The nearest of what comes back: all paths of the shot are then small numbers of one sign.
        nearest = dr.block_reduce(dr.ReduceOp.Min, dr.select(hit, whole, dr.inf), lane.count)
        reference = dr.select(
            dr.isfinite(nearest), dr.floor(nearest * _REFERENCES_PER_METRE) / _REFERENCES_PER_METRE, 0.0
        )
        half = 0.5 * dr.gather(mi.Float, reference, lane.shot)
        path = (si.t - half) + (length - half)
        both = hits.beam.direction + back / dr.maximum(length, _NONZERO)
        scale = layout.beam_sigma(layout.twist(si.t))
        slope_a, slope_b = (dr.dot(slide, both) * scale for slide in hits.slides())
        spread = dr.sqrt(lane.variance * (dr.square(slope_a) + dr.square(slope_b)))
        none = mi.Float(0.0)
        return Laid(path, spread, mi.Float(1.0), none, slope_a, slope_b, none, reference)

    def lay_point(
        self,
        frame: Frame,
        shots: Shots,  # noqa: ARG002 (the line needs them)
        point: Vector3f,
        way: Float,
    ) -> tuple[Float, Float, Float]:
        """Return the whole paths of light to points and on to the lens, sharp, and that all of it is kept."""
        return way + dr.norm(mi.Vector3f(point - frame.lens)), mi.Float(0.0), mi.Float(1.0)

    def is_unequal(self, strength: list[Float]) -> Mask:
        """Return whether the strength is spread widely."""
        weakest = strongest = strength[0]
        for other in strength[1:]:
            weakest, strongest = dr.minimum(weakest, other), dr.maximum(strongest, other)
        return strongest - weakest > _UNEVEN_STRENGTH * strongest
