"""Beamlets that lie as evenly across a sweep as their number allows, each shot's along its own.

At an edge a beamlet is on one side or the other, and the light errs by how unevenly beamlets lie across it. While the
spot travels by L standard deviations of the beam, a beamlet at (x, y) that shines at the moment t of the dwell passes
at x + L t along the travel. Beamlet j of k takes the quantile (j + ½)/k of the distribution of x + L t, a Gaussian
convolved with a box, and its x from what that leaves; y and that choice follow sequences without clusters, mirrored so
that all odd moments vanish. Edges across the travel then err by 1/(2k) of the light at most, where a fixed set of
positions errs by several times as much; for edges along it the positions are as good as any.

What a beam meets depends on x + L t and y alone. So where the distance is known for which L holds, a beamlet need not
have one moment: it can stand for all moments at which the beam passes its place, fired at their mean, and their
variance widens its spot by what the receiver turns meanwhile (:func:`averaged_positions`). Two dimensions are left to
be covered in place of three.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from scanner_sim.foundation.device_types import Float, UInt32
from scanner_sim.render.beam.beamlets import aperture_lattice, aperture_spiral, edge_width, whiten
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import Drawn, OpticalLayout

Array = NDArray[np.float64]

_LENGTHS = 256
"""Lengths of the travel for which positions are tabled, evenly in L/(1 + L)."""
_LONGEST = 100.0
"""Largest of them; beyond, beamlets lie as for this one, and the beam is the shorter at each of their places."""
_ACROSS, _CHOICE = (3.0 - math.sqrt(5.0)) / 2.0, 0.7548776662
"""Steps of the sequences that choose y, by the golden section, and x, by the plastic number: their multiples are spread
most evenly, alone and against each other."""
_HALVINGS = 60
_SHORTEST = 0.2
"""Travel below which the moments at one place are taken as those at this one."""


@dataclass
class SweptTables:
    """Positions of k beamlets for all lengths of travel, on the device.

    ``along``, ``times`` and ``across`` hold entry row · k + j for beamlet j at the length of a row; positions are in
    standard deviations of the beam, times in dwells. ``stop_across`` and ``stop_normal`` are points of the unit disc of
    the aperture, entry j; ``width`` is the standard deviation of each beamlet. ``time_variance`` is that of the moments
    for which a beamlet stands; None where it has a single one.
    """

    along: Float
    times: Float
    across: Float
    stop_across: Float
    stop_normal: Float
    width: float
    time_variance: Float | None = None

    @classmethod
    def of(cls, count: int) -> SweptTables:
        """Return the tables of ``count`` beamlets with a moment of their own each: what others are judged by."""
        width = edge_width(count)
        along, times, across = swept_positions(count, np.sqrt(1.0 - width**2))
        a, b, c, d, e = _uploaded(along, times, across, *aperture_spiral(count).T)
        return cls(a, b, c, d, e, width)

    @classmethod
    def averaged(cls, count: int) -> SweptTables:
        """Return the tables of ``count`` beamlets that stand for all moments at which the beam is there."""
        width = edge_width(count)
        along, times, across, variance = averaged_positions(count, np.sqrt(1.0 - width**2))
        stops = _shared_out(aperture_lattice(count), along + lengths()[:, None] * times, across)
        a, b, c, d, e, left = _uploaded(along, times, across, *stops.T, variance)
        return cls(a, b, c, d, e, width, left)

    @property
    def count(self) -> int:
        """Number of beamlets."""
        return int(dr.width(self.stop_across))


@dataclass
class SweptBeamlets:
    """The beamlets of m shots, each along its own travel: tables, and for each shot where it stands in them.

    ``length`` in rows of the tables, ``travel`` the same in standard deviations of the beam, ``briefer`` by which the
    variance of moments at one place is less than there, ``cosine`` and ``sine`` of the angle by which positions are
    turned at the laser; ``right`` and ``down`` the direction of the travel where it lands.
    """

    tables: SweptTables
    length: Float
    travel: Float
    briefer: Float
    cosine: Float
    sine: Float
    right: Float
    down: Float

    @classmethod
    def of(cls, tables: SweptTables, layout: OpticalLayout, shots: Shots, distance: Float) -> SweptBeamlets:
        """Return the beamlets of shots whose chief rays go a distance [m], NaN for nothing."""
        laser = layout.laser
        waist = dr.opaque(mi.Float, laser.waist_distance)
        reach = dr.select(dr.isfinite(distance), distance, waist)
        twist = layout.twist(reach)
        straight = dr.rsqrt(1.0 + dr.square(twist))
        sigma = dr.opaque(mi.Float, 0.5 * laser.waist_radius) / straight
        right = reach * shots.travel_theta
        down = (reach * dr.cos(shots.theta) - dr.opaque(mi.Float, layout.axis_separation)) * shots.travel_phi
        way = dr.sqrt(dr.square(right) + dr.square(down))
        moves = way > 1e-6 * sigma
        c, s = dr.select(moves, right / way, 1.0), dr.select(moves, down / way, 0.0)
        # The beam's ruled lines turn positions by atan(twist) on their way: they start turned back.
        length = dr.minimum(way / sigma, _LONGEST)
        row = length / (1.0 + length) * ((_LENGTHS - 1) * (1.0 + _LONGEST) / _LONGEST)
        turned = twist * straight
        briefer = dr.square(_LONGEST / dr.maximum(way / sigma, _LONGEST))
        return cls(tables, row, length, briefer, c * straight + s * turned, s * straight - c * turned, c, s)

    @property
    def count(self) -> int:
        """Number of beamlets."""
        return self.tables.count

    @property
    def columns(self) -> list[Float]:
        """What it holds of each shot."""
        return [value for value in vars(self).values() if value is not self.tables]

    def draw(self, beamlet: UInt32, shot: UInt32) -> Drawn:
        """Return beamlets of shots."""
        tables = self.tables
        x, time, y, time_variance = self._of_tables(
            beamlet, shot, tables.along, tables.times, tables.across, tables.time_variance
        )
        stop = [dr.gather(mi.Float, values, beamlet) for values in (tables.stop_across, tables.stop_normal)]
        variance = dr.opaque(mi.Float, tables.width**2)
        time_variance *= dr.gather(mi.Float, self.briefer, shot)
        weight = mi.Float(1.0 / self.count)
        node = self._turned(x, y, shot)
        if tables.time_variance is None:
            return Drawn(node, stop, weight, time, variance, time_variance, None)
        # x = u − L t; beyond the longest L of the tables moments are the briefer.
        rate = -dr.gather(mi.Float, self.travel * dr.rsqrt(self.briefer), shot)
        drift = self._turned(rate, mi.Float(0.0), shot)
        return Drawn(node, stop, weight, time, variance, time_variance, drift)

    def place(self, beamlet: UInt32, shot: UInt32) -> tuple[Float, Float]:
        """Return where beamlets of shots pass, u = x + L t along the travel and y across it."""
        tables = self.tables
        x, time, y = self._of_tables(beamlet, shot, tables.along, tables.times, tables.across)
        return x + dr.gather(mi.Float, self.travel, shot) * time, y

    def start(self, u: Float, y: Float, shot: UInt32) -> tuple[list[Float], Float]:
        """Return node and moment of rays that pass such places, as the likeliest of those that do."""
        time = dr.clip(self._likeliest(u, shot)[1], -0.5, 0.5)
        return self._turned(u - dr.gather(mi.Float, self.travel, shot) * time, y, shot), time

    def moved(self, u: Float, y: Float, shot: UInt32) -> tuple[Float, Float, Float]:
        """Return by how much beamlets move along the beam's two axes where it lands, and in time, that move so."""
        x, time = self._likeliest(u, shot)
        right, down = (dr.gather(mi.Float, value, shot) for value in (self.right, self.down))
        return x * right - y * down, x * down + y * right, time

    def _likeliest(self, u: Float, shot: UInt32) -> tuple[Float, Float]:
        """Return the parts of u that x and t have by regression."""
        length = dr.gather(mi.Float, self.travel, shot)
        x = u / (1.0 + dr.square(length) / 12.0)
        return x, x * length / 12.0

    def _turned(self, x: Float, y: Float, shot: UInt32) -> list[Float]:
        """Return nodes at the laser, of places along the travel and across it."""
        cosine, sine = dr.gather(mi.Float, self.cosine, shot), dr.gather(mi.Float, self.sine, shot)
        return [x * cosine - y * sine, x * sine + y * cosine]

    def _of_tables(self, beamlet: UInt32, shot: UInt32, *tables: Float | None) -> list[Float]:
        """Return what tables hold for beamlets of shots; 0 of one that is not there."""
        return between_rows(dr.gather(mi.Float, self.length, shot), self.count, beamlet, *tables)


def between_rows(row: Float, count: int, number: UInt32, *tables: Float | None) -> list[Float]:
    """Return what tables hold between two rows, of ``count`` numbers each; 0 of a table that is not there."""
    low = dr.minimum(mi.UInt32(row), _LENGTHS - 2)
    at, part = low * count + number, row - mi.Float(low)
    return [
        mi.Float(0.0)
        if values is None
        else dr.lerp(dr.gather(mi.Float, values, at), dr.gather(mi.Float, values, at + count), part)
        for values in tables
    ]


def _shared_out(stops: Array, passed: Array, across: Array) -> Array:
    """Return points of the aperture, shape (k, 2), which share nothing with where beamlets pass, at rest and when fast.

    Light that is returned unequally over the aperture would else move the spot.
    """
    places = np.stack([np.ones(len(stops)), passed[0], passed[-1], across[0], across[-1]], axis=1)
    return 0.5 * whiten(stops - places @ np.linalg.lstsq(places, stops, rcond=None)[0])


def _uploaded(*tables: Array) -> list[Float]:
    return [mi.Float(values.astype(np.float32).ravel()) for values in tables]


def swept_positions(count: int, spread: float) -> tuple[Array, Array, Array]:
    """Return x, t and y of beamlets of one weight, shape (lengths, count): first and second moments are exact.

    Parameters
    ----------
    count
        Number of beamlets k.
    spread
        Standard deviation s of x and y.

    Notes
    -----
    F(u) = [G(u + L/2) − G(u − L/2)]/L with G(z) = z Φ(z/s) + s φ(z/s) is the distribution of u = x + L t, for t even on
    ±½; given u, x is Gaussian within u ± L/2.
    """
    length, safe, passed = _quantiles(count, spread)
    choice, across = _mirrored_multiples(count, _CHOICE), spread * ndtri(_mirrored_multiples(count, _ACROSS))
    first, last = (ndtr((passed + side * safe) / spread) for side in (-0.5, 0.5))
    along = spread * ndtri(np.clip(first + choice * (last - first), 1e-12, 1.0 - 1e-12))
    times = (passed - along) / safe
    # What is known of t beside u = x + L t is independent of it; all second moments are then made exact.
    whole = spread**2 + length**2 / 12.0
    share = length / 12.0 / whole
    passed = _scale_to(passed, whole)
    across = _scale_to(_remove_shared(np.broadcast_to(across, passed.shape), passed), spread**2)
    rest = _scale_to(
        _remove_shared(_remove_shared(times - share * passed, passed), across), spread**2 / 12.0 / whole
    )
    times = share * passed + rest
    return passed - length * times, times, across


@lru_cache(maxsize=8)
def averaged_positions(count: int, spread: float) -> tuple[Array, Array, Array, Array]:
    """Return x, t, y and the variance of t of beamlets that stand for all moments at which the beam is at their place.

    Arguments as those of :func:`swept_positions`; so are the moments, the variances of t added to those of its means.

    Notes
    -----
    Given u = x + L t, x is Gaussian within u ± L/2: its mean and variance are those of the truncated normal
    distribution (Johnson, Kotz, Balakrishnan, *Continuous univariate distributions* 1, 1994, ch. 13).
    """
    length, _, passed = _quantiles(count, spread)
    # On the lower side, where the distribution's tail keeps its digits; below a short length t is even.
    down, reach = -np.abs(passed), np.maximum(length, _SHORTEST)
    first, last = ((down + side * reach) / spread for side in (-0.5, 0.5))
    density = [np.exp(-0.5 * end**2) / np.sqrt(2.0 * np.pi) for end in (first, last)]
    within = ndtr(last) - ndtr(first)
    mean = (density[0] - density[1]) / within
    variance = 1.0 + (first * density[0] - last * density[1]) / within - mean**2
    times = -np.sign(passed) * (down - spread * mean) / reach
    left = variance * (spread / reach) ** 2
    whole = spread**2 + length**2 / 12.0
    passed = _scale_to(passed, whole)
    # What t shares with u is L/12 of the whole, and with y nothing; on short ways it depends on u in proportion.
    bend = np.where(length > _SHORTEST, _remove_shared(times, passed), 0.0)
    times = bend + (length / 12.0 / whole) * passed
    across = np.broadcast_to(spread * ndtri(_mirrored_multiples(count, _ACROSS)), passed.shape)
    across = _remove_shared(_remove_shared(across, passed), np.where(length > _SHORTEST, bend, passed))
    across = _scale_to(across, spread**2)
    left *= (1.0 / 12.0 - (times**2).mean(axis=1, keepdims=True)) / left.mean(axis=1, keepdims=True)
    return passed - length * times, times, across, left


def lengths() -> Array:
    """Return the lengths of travel of the tables' rows [standard deviations of the beam], shape (lengths,)."""
    share = np.linspace(0.0, _LONGEST / (1.0 + _LONGEST), _LENGTHS)
    return np.asarray(share / (1.0 - share))


def _quantiles(count: int, spread: float) -> tuple[Array, Array, Array]:
    """Return lengths L, the same without 0, both of shape (lengths, 1), and the quantiles (j + ½)/k of x + L t."""
    length = lengths()[:, None]
    level = (np.arange(count) + 0.5) / count
    safe = np.maximum(length, 1e-3)
    high = np.broadcast_to(6.0 * spread + safe, (_LENGTHS, count)).copy()
    low = -high
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        below = _distribution(middle, safe, spread) < level
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return length, safe, 0.5 * (low + high)


def _remove_shared(values: Array, other: Array) -> Array:
    """Return rows of values made free of what they share with the rows of others; the means of both are 0."""
    shared = (values * other).sum(axis=1, keepdims=True) / (other**2).sum(axis=1, keepdims=True)
    return np.asarray(values - shared * other)


def _scale_to(values: Array, variance: Array | float) -> Array:
    """Return rows of values with a variance; their means are 0."""
    return np.asarray(values * np.sqrt(variance / (values**2).mean(axis=1, keepdims=True)))


def _distribution(position: Array, length: Array, spread: float) -> Array:
    """Return the distribution function of x + L t."""

    def integral(z: Array) -> Array:
        return np.asarray(
            z * ndtr(z / spread) + spread * np.exp(-0.5 * (z / spread) ** 2) / np.sqrt(2.0 * np.pi)
        )

    return np.asarray((integral(position + 0.5 * length) - integral(position - 0.5 * length)) / length)


def _mirrored_multiples(count: int, step: float) -> Array:
    """Return multiples of a step modulo 1, of which the first and the last, and so on, add up to 1."""
    values = (0.5 + step * (np.arange(count) - 0.5 * (count - 1))) % 1.0
    return np.clip(values, 0.25 / count, 1.0 - 0.25 / count)
