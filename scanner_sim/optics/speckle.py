"""Speckle: how strong it is behind a lens, and how it is spread over the image of the laser's spot.

A rough surface in coherent light sends waves of random phases. What the lens collects is made of independent
*packets*: a packet comes from one point of the surface and passes one point of the pupil, as well as diffraction lets
both be known, and its energy is random. In the phase space of image (s) and pupil (ξ) the beam's geometric image
e(s) and the pupil of area A give the density W = e/A; two weighted sums of the light have the covariance

    C² (λf)² ∬ W² g g' ds dξ

(circular Gaussian fields: Goodman, *Speckle phenomena in optics*, 2007, sec 3.1 and ch. 4; the Wigner function of such
a field, Bastiaans, *J. Opt. Soc. Am. A* 3, 1986). The total has the contrast C/√M, M = A/((λf)² ∫e²) =
π² σ_x σ_y/(λN)² for a beam whose image has the standard deviations σ_x, σ_y. A phase in the pupil cannot change it
(Parseval), nor can what the detector blurs.

A packet lands at p = s + a(ξ), a the aberration of its ray, and is spread by the detector's diffusion. Along the line
the packets lie as the *square* of W has it: s with the variance σ_x²/2, a with σ_a² since the pupil is evenly lit.
Charges of pixels with the response K (diffusion and width) are hence covariant as

    C²/M E[K_i(p) K_j(p)],   p Gaussian about the spot's middle with the variance σ_x²/2 + σ_a².

Where packets are not small against the pupil or the image, those at the ends count in part (:func:`packets`,
:func:`slope_packets`), and each has a size of its own, (λN/π) √(1 + σ_a²/σ_x²), as the degree of coherence of such a
beam stays on its way (Goodman, sec 5.7; Starikov, Wolf, *J. Opt. Soc. Am.* 72, 1982); (λN)² is added to σ_x² there, so
that the size stays finite for images below a packet. All of this is judged by
:mod:`scanner_sim.analytic.wave_optics`.

The pattern belongs to the surface. A beam of 1/e² radius w that moves by δ keeps exp(−δ²/w²) of the energy's
fluctuation and, along the line, (1 − 2δ²/w²) exp(−δ²/w²) of the centroid's: the centroid is Σ (x − x₀) e, and where the
beam moves by w a grain goes from one side to the other. What a dwell averages follows
(:func:`~scanner_sim.detector.packets.dwell_average`).

Not modelled: laser lines so broad that they lose coherence over the depth of the surface, speckle that is not fully
developed on polished surfaces, a surface that turns under the beam, and fine errors of the wavefront whose slope
changes within a packet: they act as diffusion does.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from scanner_sim.foundation.device_numbers import beside, over
from scanner_sim.foundation.device_types import FloatLike
from scanner_sim.optics.line_image import ArrayPlace

_LEFT_OUT = 0.01
"""Share of the variance of a point of the image that the modes may leave out."""
_FEWEST, _MOST = 4, 16


def packets(ratio: FloatLike) -> FloatLike:
    """Return how many independent packets the light of a spot has, 1/contrast² for C = 1.

    Parameters
    ----------
    ratio
        x = σ_b/(λN), the beam's geometric image over the lens's λN.

    Notes
    -----
    ∬|γ(ξ − ξ')|² over the pupil, |γ|² = exp(−(2π σ_b Δξ/λf)²): π²x² for a pupil that is large against the grains of
    light in it, √π x more for the grains that its edge cuts, and 1 for the last one: 5 % too many at
    x = 1, 1.5 % at 2, 0.4 % at 4.
    """
    return 1.0 + math.sqrt(math.pi) * ratio + math.pi**2 * ratio * ratio


def slope_packets(ratio: FloatLike) -> FloatLike:
    """Return how many packets average the wavefront's slope: σ_a²/this is the variance of its mean over the light.

    The edge of the pupil counts twice as much as in :func:`packets`, for there the slope is largest (of a lens out of
    focus, ∮u² ds/∫u² dA = 4 against ∮ds/∫dA = 2). Good to 2 % from x = 1, for any smooth wavefront.
    """
    return 2.0 + 2.0 * math.sqrt(math.pi) * ratio + math.pi**2 * ratio * ratio


@dataclass(frozen=True)
class Optics:
    """What speckle on a line of pixels depends on, in pixels.

    Attributes
    ----------
    cell
        λN in the focal plane.
    aberration, diffusion
        Standard deviations σ_a of the lens's rays, square to its axis, and σ_d of the sensor's blur.
    modes
        Number of modes of the line that fluctuate (:class:`Packets`).
    """

    cell: float
    aberration: float
    diffusion: float
    modes: int

    @classmethod
    def of(
        cls,
        cell: float,
        aberration: float,
        diffusion: float,
        pitch: float,
        images: Iterable[tuple[float, ArrayPlace]],
    ) -> Optics:
        """Return the numbers of a lens and a sensor [m].

        ``images`` are σ_x in the focal plane [m] of spots along the line, and how they are seen there.
        """
        whole = cls(cell / pitch, aberration / pitch, diffusion / pitch, _MOST)
        found = (packets_of(whole, (one / pitch) ** 2, (one / pitch) ** 2, seen) for one, seen in images)
        ratio = max(float(packets.ratio) for packets in found)
        needed = math.ceil(math.log(_LEFT_OUT) / (2.0 * math.log(min(ratio, 0.99)))) + 1
        return replace(whole, modes=min(max(needed, _FEWEST), _MOST))


@dataclass(frozen=True)
class Packets:
    """The packets of a spot's light along the line; numbers, NumPy or Dr.Jit arrays.

    With K̄ the pixel under the spread of all packets, a Gaussian of σ, and r = σ_p/σ that of the packets' positions over
    it, Mehler's formula makes the covariance of the pixels a sum over modes,

        C² E[K_i K_j]/M = C²/M Σ_n (r σ)²ⁿ/n! ∂ⁿK̄_i/∂µⁿ ∂ⁿK̄_j/∂µⁿ:

    n = 0 is the energy, n = 1 the position, n = 2 the width, and so on.

    Attributes
    ----------
    energy
        Relative variance 1/M of the energy for C = 1.
    sigma
        σ [pixel].
    ratio
        r.
    on_surface
        Share of the variance of the packets' positions that comes from the surface, σ_x²/2; the rest is aberration.
    """

    energy: FloatLike
    sigma: FloatLike
    ratio: FloatLike
    on_surface: FloatLike

    def moving(self, energy: FloatLike, position: FloatLike) -> tuple[FloatLike, FloatLike]:
        """Return what a dwell leaves of the variance of the first mode and of all others."""
        return energy, self.on_surface * position + (1.0 - self.on_surface) * energy


def packets_of(optics: Optics, along: FloatLike, across: FloatLike, seen: ArrayPlace) -> Packets:
    """Return the packets of a spot.

    Parameters
    ----------
    optics
        Lens and sensor.
    along, across
        Variances of the beam's geometric image in the focal plane, along and across the line [pixel²].
    seen
        How the array sees that image, which is stretched and out of focus there [pixel]. Defocus is a phase in the
        pupil as aberration is; what the array stretches, it stretches packets and their sizes alike.
    """
    squares = optics.aberration**2, optics.diffusion**2, optics.cell**2, (optics.cell / math.pi) ** 2
    aberration, diffusion, cell, grain = beside(along, *squares)
    aberration = (aberration + seen.defocus * seen.defocus) / (seen.across * seen.across)
    diffusion = diffusion / (seen.along * seen.along)
    ratio = over((along * across) ** 0.25, optics.cell)
    energy = 1.0 / packets(ratio)
    surface = 0.5 * along
    landing = surface + aberration / (energy * slope_packets(ratio))
    own = grain * (1.0 + aberration / (along + cell))
    whole = landing + diffusion + own
    return Packets(energy, whole**0.5 * seen.along, (landing / whole) ** 0.5, surface / landing)
