"""What is known of the speckle on a line before it is seen: the covariance that it gives the charges of the spot.

The pixels of a spot of the charge q have the covariance q² C²/M Σ_n A_n (rσ)²ⁿ/n! ∂ⁿK̄_i ∂ⁿK̄_j of
:class:`~scanner_sim.optics.speckle.Packets`, with what the dwell leaves of each mode, A_n. The contrast C is a value of
the calibration: the instrument does not know its target. σ is too small by as much as C is, on surfaces that keep the
laser's polarisation by √2. The spot is taken to be that of a surface which faces the scanner.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.detector.packets import dwell_average, mode_edges, mode_ratios
from scanner_sim.foundation.device_loops import for_each
from scanner_sim.foundation.device_types import Float, Int32, Local, UInt32
from scanner_sim.optics.speckle import Optics, Packets, packets_of
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.pixel_row import row_of


@dataclass(frozen=True)
class ExpectedSpeckle:
    """What the instrument knows of the speckle that its laser makes.

    Attributes
    ----------
    optics
        Lens and sensor.
    contrast
        Contrast C that surfaces are assumed to give.
    travel
        Angles by which the beam moves in a dwell, along the line and across it [rad]: numbers or Dr.Jit arrays of
        shape (m,).
    """

    optics: Optics
    contrast: float
    travel: tuple[Float, Float]

    def about(self, spot: ExpectedSpot, centre: Int32, sine: Float, cosine: Float) -> SpotSpeckle:
        """Return the speckle of spots about pixels (Dr.Jit, shape (m,)) at deflections Θ given as sine and cosine."""
        pixel = dr.maximum(auto.Float(centre), 0.0)
        beam, spread = spot.variances(pixel, sine, cosine)
        distance = spot.range(pixel, sine, cosine)
        away = (distance - dr.opaque(auto.Float, spot.waist_distance)) / dr.opaque(
            auto.Float, spot.rayleigh_length
        )
        radius = dr.opaque(auto.Float, spot.waist_radius) * dr.sqrt(1.0 + dr.square(away))
        along, across = (
            (dr.opaque(auto.Float, way) if isinstance(way, float) else way) * distance for way in self.travel
        )
        seen = spot.seen_at(pixel, cosine)
        image = beam / dr.square(seen.along)
        packets = packets_of(self.optics, image, image, seen)
        energy, others = packets.moving(*dwell_average(along, across, radius))
        whole = dr.opaque(auto.Float, self.contrast**2) * packets.energy
        ratios = mode_ratios(self.optics, packets.ratio)
        return SpotSpeckle(packets, ratios, whole * energy, whole * others, dr.sqrt(beam + spread))


@dataclass
class SpotSpeckle:
    """The speckle of the spots of m shots, Dr.Jit arrays of shape (m,).

    ``ratios`` r of each mode after the first; ``energy`` relative variance of the charge; ``others`` the same scale of
    all other modes; ``sigma`` standard deviation of the whole spot [pixel].
    """

    packets: Packets
    ratios: list[Float]
    energy: Float
    others: Float
    sigma: Float

    @property
    def single(self) -> Float:
        """Relative variance V of the spot's charge that weights take as one of single pixels, V q m_i.

        What pixels have in common, energy, position and width to first order, moves the fit's own parameters whatever
        its weights. The modes beyond are r⁴ and less of the whole; where nothing blurs a packet (r = 1) each falls on
        one pixel.
        """
        return self.others * dr.square(dr.square(self.packets.ratio))

    def shape_variance(self, apart: Float) -> Float:
        """Return the variance of pixels ``apart`` from the spot's middle [pixel] by modes beyond energy and position.

        Relative to the square of the spot's charge.
        """
        edges = self._edges(apart + 0.5), self._edges(apart - 0.5)
        high, low = (modes[2:] for modes in edges)
        return self.others * sum(
            (dr.square(one - other) for one, other in zip(high, low, strict=True)), auto.Float(0.0)
        )

    def propagated_variance(self, slopes: dict[int, Float], charges: dict[int, Float], shift: Float) -> Float:
        """Return the variance that the speckle gives a quantity.

        Parameters
        ----------
        slopes
            Derivative of the quantity by the charge of the pixel at each step from the brightest one, of all from the
            first to the last.
        charges
            The spot's charges there [electron].
        shift
            Position of the spot from the brightest pixel's centre [pixel].
        """
        steps = sorted(slopes)
        scale = math.sqrt(0.5) / self.sigma
        share = dr.erf((steps[-1] + 0.5 - shift) * scale) - dr.erf((steps[0] - 0.5 - shift) * scale)
        whole = sum(charges.values(), auto.Float(0.0)) / dr.maximum(0.5 * share, 0.05)

        def add(number: UInt32, row: Local, moved: list[Float], before: list[Float]) -> tuple[Any, ...]:
            after = self._edges(auto.Float(number) + (steps[0] - 0.5) - shift)
            slope = row.read(number)
            moved = [
                dr.fma(slope, high - low, total)
                for total, high, low in zip(moved, after, before, strict=True)
            ]
            return row, moved, after

        # The turn before the first pixel, of slope 0, finds where that begins.
        row = row_of([auto.Float(0.0), *(slopes[step] for step in steps)])
        nothing = [[auto.Float(0.0) for _ in range(1 + len(self.ratios))] for _ in range(2)]
        moved = for_each(len(steps) + 1, add, row, *nothing)[1]
        others = sum((dr.square(total) for total in moved[1:]), auto.Float(0.0))
        return dr.square(whole) * (self.energy * dr.square(moved[0]) + self.others * others)

    def _edges(self, apart: Float) -> list[Float]:
        return mode_edges(self.ratios, apart / self.packets.sigma)
