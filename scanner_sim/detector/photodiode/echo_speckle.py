"""Speckle of echoes: how the energy of a pulse departs from its mean."""

from __future__ import annotations

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.detector.packets import gamma_like
from scanner_sim.detector.photodiode.waveform import ReceivedEchoes
from scanner_sim.detector.surface_noise import SurfacePoints, coarse_numbers, fine_numbers
from scanner_sim.foundation.device_types import Float
from scanner_sim.foundation.streams import Seed
from scanner_sim.optics.speckle import packets


def echo_speckle(
    light: ReceivedEchoes, positions: SurfacePoints, coherence: Float, aperture: float, seed: Seed
) -> Float:
    """Return what multiplies the echoes of m shots, shape (c · m,).

    Parameters
    ----------
    light
        Their light as it is on the average.
    positions
        Where their beams are.
    coherence
        C² of the light, shape (m,).
    aperture
        Of the lens, in wavelengths.
    seed
        Seed of the patterns, or that of each shot.

    Notes
    -----
    The light of a shot has M packets, M = (π w D/2λR)² for a large beam; an echo with a share of the light has as
    large a share of them, and its energy the variance C²/(M share), at most C². The pattern of a lone echo is that of
    the energy on the line: the beam and the lens are the same.
    """
    m = dr.width(light.reference)
    count = dr.width(light.amount) // m
    shot, shots = dr.arange(auto.UInt32, m), dr.opaque(auto.UInt32, m)
    ratio = 0.5 * dr.opaque(auto.Float, aperture) * positions.radius / positions.distance
    energy = coherence / packets(ratio)
    if count == 1:
        return gamma_like(dr.sqrt(energy), fine_numbers(positions, seed)[0])
    shares = [dr.gather(auto.Float, light.amount, shot + number * shots) for number in range(count)]
    whole = sum(shares, auto.Float(0.0))
    factor = dr.empty(auto.Float, count * m)
    for number, (share, normal) in enumerate(
        zip(shares, coarse_numbers(positions, count, 3, seed), strict=True)
    ):
        own = gamma_like(dr.sqrt(dr.minimum(energy * whole / dr.maximum(share, 1e-30), coherence)), normal)
        dr.scatter(factor, own, shot + number * shots, mode=dr.ReduceMode.Permute)
    return factor
