"""Light on the line sensor: the lens maps each beamlet's Gaussian to the pixels, whose height cuts it.

The continuous beam shines while the mirrors move, so that its spot travels during the dwell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_types import Float, Mask, Vector3f
from scanner_sim.optics.deflection import Frame
from scanner_sim.render.beam.light import Truth
from scanner_sim.render.beam.projection import Hits, Laid, Resolution
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout, frame_at

_UNEVEN_KINK = 0.06
"""Departure of two opposite beamlets' mean strength from the chief one's, relative to the strongest, that calls for
more. On the Node places then err by 0.08 of their σ (rms) where there are no more; twice as much allows 0.2."""


@dataclass(frozen=True)
class LineProjection:
    """The line sensor behind its lens: positions and standard deviations in pixels, power in watts."""

    layout: OpticalLayout
    resolution: ClassVar[Resolution] = Resolution(
        uneven_departure=0.05,
        edge_departure=0.5,
        gaussian_travel=2.0,
        least_variance=1e-4,
        moments_about=0.0,
        keeps_coherence=True,
    )

    def power(self, shots: Shots) -> Float:
        """Return the power of the laser [W]."""
        if shots.seeds is None or shots.seeds.powers is None:
            mean = dr.opaque(mi.Float, self.layout.laser.power)
        else:
            mean = shots.seeds.spread(shots.seeds.powers)
        departures = shots.departures
        return mean if departures is None or departures.power is None else mean * departures.power

    def fired(self, shots: Shots) -> Shots:
        """Return the shots as they are: the laser shines while the mirrors move."""
        return shots

    def seen_from(self, frame: Frame) -> Frame:
        """Return the deflected optics as they are, with the lens at the triangulation base."""
        return frame

    def sees(self, frame: Frame, point: Vector3f) -> Mask:  # noqa: ARG002 (the line's ends are far off)
        """Return True: what falls beside the line is in no pixel."""
        return mi.Bool(True)

    def lay(self, hits: Hits) -> Laid:
        """Return where beamlets' light lies: the tangent plane and the lens map Gaussians to Gaussians."""
        layout, frame, shots, distance = self.layout, hits.frame, hits.lane.own, hits.si.t
        p, q, depth = image(layout, frame, hits.si.p)
        f = dr.opaque(mi.Float, layout.receiver.focal_length)
        spread = layout.beam_sigma(layout.twist(distance))

        def slopes(slide: Vector3f) -> tuple[Float, Float]:
            moved = slide * spread
            deeper = dr.dot(moved, frame.along)
            return (
                (-f * dr.dot(moved, frame.across) - p * deeper) / depth,
                (f * dr.dot(moved, frame.normal) - q * deeper) / depth,
            )

        # On an upright array in the focal plane; what a tilted one makes of it follows with `at`.
        (pa, qa), (pb, qb) = (slopes(slide) for slide in hits.slides())
        # The same for the sweep. The first mirror turns the beam about the laser, and the lens's axis turns with it;
        # the second carries beam and lens round its axis together, and only the slide along the beam is seen.
        reach = distance * frame.across.x - dr.opaque(mi.Float, layout.axis_separation)
        pt = shots.travel_theta * (pa * distance / spread + f + dr.square(p) / f) + shots.travel_phi * (
            pb * reach / spread
        )
        residual = hits.lane.variance
        # A surface point that is lit for a while moves on the line, as the receiver turns meanwhile.
        variance = hits.lane.time_variance
        turn_p = shots.travel_theta * (f + dr.square(p) / f)
        turn_q = -shots.travel_phi * reach * f / depth
        at = on_array(layout, p, q, depth, shots)
        (pa, qa), (pb, qb), (turn_p, turn_q) = (
            at.slopes(*both) for both in ((pa, qa), (pb, qb), (turn_p, turn_q))
        )
        pt *= at.along
        moved_p = moved_q = mi.Float(0.0)
        if hits.late is not None:
            moved_p, moved_q = turn_p * hits.late, turn_q * hits.late
            variance = variance - dr.square(hits.late)
        var_p = residual * (dr.square(pa) + dr.square(pb)) + variance * dr.square(turn_p) + at.blur_p
        var_q = residual * (dr.square(qa) + dr.square(qb)) + variance * dr.square(turn_q) + at.blur_q
        covariance = residual * (pa * qa + pb * qb) + variance * turn_p * turn_q
        place = synchronisation_shift(layout, p, shots.synchronisation)
        p = array_position(layout, place, q, shots) + at.shift + moved_p
        height, pitch = dr.opaque(mi.Float, layout.height), dr.opaque(mi.Float, layout.pitch)
        inside, cut, var_p = cut_by_height(p, at.q + moved_q, var_p, var_q, covariance, height)
        slopes_in_pixels = (slope / pitch for slope in (pa, pb, pt))
        return Laid(
            to_pixels(layout, cut),
            dr.sqrt(var_p) / pitch,
            dr.select(at.behind, inside, 0.0),
            (cut - p) / pitch,
            *slopes_in_pixels,
        )

    def lay_point(
        self,
        frame: Frame,
        shots: Shots,
        point: Vector3f,
        way: Float,  # noqa: ARG002 (the line does not tell when light comes)
    ) -> tuple[Float, Float, Float]:
        """Return position and standard deviation [pixel] and share of the light of points, by the point spread."""
        layout = self.layout
        p, q, depth = image(layout, frame, point)
        at = on_array(layout, p, q, depth, shots)
        place = synchronisation_shift(layout, p, shots.synchronisation)
        p = array_position(layout, place, q, shots) + at.shift
        height = dr.opaque(mi.Float, layout.height)
        inside, p, variance = cut_by_height(p, at.q, at.blur_p, at.blur_q, mi.Float(0.0), height)
        sigma = dr.sqrt(variance) / dr.opaque(mi.Float, layout.pitch)
        return to_pixels(layout, p), sigma, dr.select((depth > 0.0) & at.behind, inside, 0.0)

    def is_unequal(self, strength: list[Float]) -> Mask:
        """Return whether the strength bends so much across the beam that the probe's mean is not the light's."""
        chief, *ring = strength
        strongest, kink = chief, mi.Float(0.0)
        half = len(ring) // 2
        for one, opposite in zip(ring[:half], ring[half:], strict=True):
            strongest = dr.maximum(strongest, dr.maximum(one, opposite))
            kink = dr.maximum(kink, dr.abs(0.5 * (one + opposite) - chief))
        return kink > _UNEVEN_KINK * strongest


def chief_image(layout: OpticalLayout, shots: Shots, truth: Truth) -> NDArray[np.float64]:
    """Return where on the line the light of the points falls that the chief rays of n shots meet [pixel], shape (n,).

    Of points alone, in the middle of the dwell: neither the beam's width nor its sweep counts. NaN where nothing is
    met.
    """
    frame, distance = frame_at(layout, shots, mi.Float(0.0)), truth.distance
    point = mi.Point3f(frame.laser + frame.along * distance)
    pixel, _, _ = LineProjection(layout).lay_point(frame, shots, point, distance)
    return np.asarray(pixel.numpy(), dtype=np.float64)


def image(layout: OpticalLayout, frame: Frame, point: Vector3f) -> tuple[Float, Float, Float]:
    """Return where the lens images points in its focal plane: p along the line, q across it (eq 1); and depth [m]."""
    offset = mi.Vector3f(point - frame.lens)
    depth = dr.dot(offset, frame.along)
    scale = dr.opaque(mi.Float, layout.receiver.focal_length) / depth
    return -scale * dr.dot(offset, frame.across), scale * dr.dot(offset, frame.normal), depth


@dataclass
class OnArray:
    """The array where rays meet it, Dr.Jit arrays of one shape (:mod:`scanner_sim.optics.line_image`).

    ``q`` across the line [m]; ``along`` and ``across`` by how much more the image moves than in the focal plane, and
    ``shear`` by how much across it while it moves by one along it there; ``blur_p`` and ``blur_q`` variances of the
    image of a point [m²], ``shift`` of its centroid along the line [m]; ``behind`` whether the rays meet the array.
    """

    q: Float
    along: Float
    across: Float
    shear: Float
    blur_p: Float
    blur_q: Float
    shift: Float
    behind: Mask

    def slopes(self, p: Float, q: Float) -> tuple[Float, Float]:
        """Return how an image moves along the array and across it that moves so in the focal plane."""
        return p * self.along, q * self.across + p * self.shear


def on_array(layout: OpticalLayout, p: Float, q: Float, depth: Float, shots: Shots) -> OnArray:
    """Return the array where the rays to images in the focal plane (p, q) [m] of points at depths [m] meet it."""
    receiver = layout.receiver
    line = receiver.line_image
    f, slope, ratio, secant = (
        dr.opaque(mi.Float, value)
        for value in (line.focal_length, line.slope, line.depth / line.focal_length, line.secant)
    )
    bent, spread_by_field = None, None
    if layout.lens is not None:
        p, q, bent = layout.lens.image(p, q, f)
        spread_by_field = layout.lens.variance(p)
    if shots.departures is not None and shots.departures.focus is not None:
        ratio = ratio * (1.0 + shots.departures.focus)
    left = 1.0 - slope * p / f
    stretch = 1.0 / left
    across = ratio * stretch
    skewed = secant * stretch
    aberration, spread = (
        dr.opaque(mi.Float, value) for value in (receiver.aberration**2, layout.point_spread**2)
    )
    blur = line.blur_at(stretch, depth)
    defocus = dr.square(blur)
    found = OnArray(
        q=q * across,
        along=across * skewed,
        across=across,
        shear=q * slope / f * across * stretch,
        blur_p=spread + ((aberration + defocus) * dr.square(skewed) - aberration),
        blur_q=spread + defocus,
        shift=line.lopsided(blur, dr.opaque(mi.Float, line.pupil), skewed, stretch),
        behind=left > 0.0,
    )
    if bent is not None and spread_by_field is not None:
        found.along, found.shear = found.along * bent, found.shear * bent
        found.blur_p += spread_by_field * dr.square(skewed)
        found.blur_q += spread_by_field
    return found


def array_position(layout: OpticalLayout, p: Float, q: Float, shots: Shots) -> Float:
    """Return positions on the array [m] of images at (p, q) [m] in the focal plane, as the lens distorts them."""
    line = layout.receiver.line_image
    f, slope, scale = (
        dr.opaque(mi.Float, value)
        for value in (line.focal_length, line.slope, line.scale / line.focal_length)
    )
    if layout.lens is not None:
        p, _, _ = layout.lens.image(p, q, f)
    if shots.departures is not None and shots.departures.focus is not None:
        scale = scale * (1.0 + shots.departures.focus)
    return p * scale / (1.0 - slope * p / f)


def synchronisation_shift(layout: OpticalLayout, p: Float, synchronisation: Float) -> Float:
    """Return where in the focal plane light lands [m] whose receiver looks past the laser by an angle [rad].

    p = f tanα becomes f tan(α + e), to first order p + e (f + p²/f); the position across the line changes by e p/f of
    itself, which is left out.
    """
    f = dr.opaque(mi.Float, layout.receiver.focal_length)
    return p + synchronisation * (f + dr.square(p) / f)


def to_pixels(layout: OpticalLayout, p: Float) -> Float:
    """Return positions p [m] in pixels."""
    return (p - dr.opaque(mi.Float, layout.offset)) / dr.opaque(mi.Float, layout.pitch) - 0.5


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
