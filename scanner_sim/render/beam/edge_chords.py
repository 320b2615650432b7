"""How an edge parts the light of a beam: found along chords, lines across the beam, and not counted by beamlets.

Of k beamlets on both sides of an edge some count for the wrong side, whose light then errs by about k^(−¾). Yet a
beam that meets two things has one edge between them, which a chord across it crosses once; a dozen rays that halve the
way to it find the place to a hundredth of the beam's width, and the light on both sides of it follows in closed form.
The chords stand at the nodes of a Gauss rule, so that a bent edge counts as well as a straight one. Beamlets then tell
only what each side returns: their light is weighed by their side's share and moved to its middle.

Coordinates are those of the swept beam where it lands, in its standard deviations: u = x + L t along its travel of
length L in the dwell, a Gaussian convolved with a box, and y across it (:mod:`scanner_sim.render.beam.swept_beamlets`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import eigen
from scanner_sim.foundation.device_loops import for_each
from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_types import Float, Mask, UInt32
from scanner_sim.render.beam.projection import BeamletReturns, Projection, Spots, follow, met_by
from scanner_sim.render.beam.swept_beamlets import SweptBeamlets, between_rows, lengths
from scanner_sim.render.rays import met_shape, one_kernel, pose_scene
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import Drawn, Lanes
from scanner_sim.scene.files.loader import LoadedScene

Array = NDArray[np.float64]

CHORDS = 7
"""Chords of an edge: of straight and bent ones by lot, within two standard deviations of the beam's middle, the light
on one side errs by 0.0005 (rms), by 0.001 with five; by 0.003 with 480 beamlets that are counted."""
_REACH = 3.6
"""Standard deviations of the beam to which a chord reaches, beyond its travel: 0.0003 of the light lie beyond."""
_HALVINGS = 10
"""How often the way to an edge is halved."""
_SHORTEST = 0.2
"""Travel below which a swept beam is taken for a wider Gaussian: closed forms would lose their digits."""
_MOST_APART = 8.0
"""Beamlets by which the count on one side may differ from what chords say: of 24 000 straight edges by lot it was up to
4.6 of 120, where rows of them lie along the edge. Beyond, there is more than one edge."""
_ALONE = 0.5
"""Variance of the light of a side that no beamlet meets, in those of the beam: little across the edge, all along it."""
_FARTHEST = 1.0
"""Standard deviations by which the middle of the beamlets of a side may be moved."""


@dataclass
class ChordTables:
    """Gauss rules of swept beams, on the device: entry row · :data:`CHORDS` + k is node k at the length of a row."""

    nodes: Float
    weights: Float

    @classmethod
    def of_all(cls) -> ChordTables:
        """Return the tables."""
        return cls(*(mi.Float(for_device(values)) for values in gauss_rules()))

    def draw(self, row: Float, chord: UInt32) -> tuple[Float, Float]:
        """Return node and weight of chords at lengths, in rows."""
        node, weight = between_rows(row, CHORDS, chord, self.nodes, self.weights)
        return node, weight


@lru_cache(maxsize=1)
def gauss_rules() -> tuple[Array, Array]:
    """Return nodes and weights of x + L t for all lengths L, shape (lengths, chords).

    Gauss's rule by the eigenvalues of Jacobi's matrix (Golub, Welsch, *Mathematics of Computation* 23, 1969), whose
    entries Stieltjes' procedure finds: here with x by a Gauss–Hermite rule and t by a Gauss–Legendre one.
    """
    place, share = np.polynomial.hermite_e.hermegauss(2 * CHORDS)
    moment, part = np.polynomial.legendre.leggauss(2 * CHORDS)
    at = (place[:, None] + 0.5 * lengths()[:, None, None] * moment).reshape(len(lengths()), -1)
    mass = (share[:, None] * part).ravel() / (share.sum() * part.sum())
    before, now, norm = np.zeros_like(at), np.ones_like(at), np.ones(len(at))
    matrix = np.zeros((len(at), CHORDS, CHORDS))
    for order in range(CHORDS - 1):
        # Both are even: no polynomial shares a mean with its own square.
        before, now = now, at * now - (matrix[:, order, order - 1, None] ** 2 if order else 0.0) * before
        last, norm = norm, (mass * now**2).sum(axis=1)
        matrix[:, order, order + 1] = matrix[:, order + 1, order] = np.sqrt(norm / last)
    values, vectors = eigen(matrix)
    return values, vectors[:, 0] ** 2


def weigh_sides(
    loaded: LoadedScene,
    projection: Projection,
    split: SweptBeamlets,
    chords: ChordTables,
    returns: BeamletReturns,
    shots: Shots,
) -> Spots:
    """Return the spots of beams that are split by an edge, weighed by what chords tell of its sides.

    Parameters
    ----------
    loaded, projection, split, shots
        As of :func:`~scanner_sim.render.beam.projection.trace_returns`.
    chords
        The rules of chords.
    returns
        What it returned. Beams that meet one thing, or of which chords and beamlets do not agree, stay as they are.

    Returns
    -------
    Spots
        Of one more for each shot than there are beamlets, the last: light of a side that no beamlet meets, as
        the middle of that side returns it.
    """
    laid = returns.laid
    slopes_laid = laid.slope_a, laid.slope_b, laid.slope_time
    dr.eval(returns.spots, returns.shape, returns.seen, laid.reference, *slopes_laid)
    counted = _counted(split, returns)
    dr.eval(counted)
    first = _by_chords(loaded, projection, split, chords, shots, counted)
    found = _sides(split, counted, *first)
    dr.eval(found)
    every = dr.arange(mi.UInt32, dr.width(shots.theta))
    middle, time = split.start(found.u, found.y, every)
    nothing = mi.Float(0.0)
    drawn = Drawn(middle, [nothing, nothing], found.alone, time, mi.Float(_ALONE), nothing, None)
    alone = follow(
        loaded, projection, Lanes(**vars(drawn), count=1, shot=every, beamlet=every, own=shots)
    ).spots
    dr.eval(alone)
    count = split.count
    lane = dr.arange(mi.UInt32, dr.width(shots.theta) * (count + 1))
    shot = lane // (count + 1)
    is_more = lane - shot * (count + 1) == count
    at = dr.select(is_more, shot, lane - shot)
    factor, moved = found.of(_is_first(returns, at, shot * count), shot)
    slopes = (dr.gather(mi.Float, slope, at) for slope in slopes_laid)
    move = sum((step * slope for step, slope in zip(moved, slopes, strict=True)), start=mi.Float(0.0))
    # What met nothing has no slopes.
    move = dr.select(dr.gather(mi.Float, returns.spots.power, at) > 0.0, move, 0.0)

    def both(name: str, change: Callable[[Float], Float] = lambda values: values) -> Float:
        own, more = (dr.gather(mi.Float, getattr(part, name), at) for part in (returns.spots, alone))
        return dr.select(is_more, more, change(own))

    spots = Spots(
        both("power", lambda power: power * factor),
        both("position", lambda place: place + move),
        both("sigma"),
    )
    if alone.coherence is not None:
        spots.coherence = both("coherence")
    dr.eval(spots)
    return spots


@dataclass
class _Counted:
    """The side of each shot's first beamlet, shape (m,).

    What it meets, ``shape`` and ``seen`` of :class:`BeamletReturns`; how many beamlets do, and the sums of their u and
    y.
    """

    shape: UInt32
    seen: UInt32
    number: Float
    along: Float
    across: Float


@dataclass
class _Sides:
    """What is to be done to beamlets of each shot, shape (m,): of the first one's side, and of the other.

    ``factor`` of their light; ``across``, ``normal`` and ``time`` by which they are moved along the beam's two axes
    where it lands [standard deviations] and along the dwell. ``alone`` is the share of the light of a side that
    no beamlet meets, and (``u``, ``y``) its middle.
    """

    factor: list[Float]
    across: list[Float]
    normal: list[Float]
    time: list[Float]
    alone: Float
    u: Float
    y: Float

    def of(self, first: Mask, shot: UInt32) -> tuple[Float, list[Float]]:
        """Return factor and moves of beamlets of shots, on the side of the ``first`` or on the other."""

        def chosen(values: list[Float]) -> Float:
            one, other = (dr.gather(mi.Float, value, shot) for value in values)
            return dr.select(first, one, other)

        return chosen(self.factor), [chosen(values) for values in (self.across, self.normal, self.time)]


def _is_first(returns: BeamletReturns, lane: UInt32, first: UInt32) -> Mask:
    """Return whether beamlets meet what a first one does, and are seen as it is."""
    same = dr.gather(mi.UInt32, returns.shape, lane) == dr.gather(mi.UInt32, returns.shape, first)
    return same & (dr.gather(mi.UInt32, returns.seen, lane) == dr.gather(mi.UInt32, returns.seen, first))


def _counted(split: SweptBeamlets, returns: BeamletReturns) -> _Counted:
    shot, count = dr.arange(mi.UInt32, dr.width(split.length)), split.count

    def add(number: UInt32, *sums: Float) -> tuple[Float, ...]:
        own = _is_first(returns, shot * count + number, shot * count)
        values = (mi.Float(1.0), *split.place(number, shot))
        return tuple(total + dr.select(own, value, 0.0) for total, value in zip(sums, values, strict=True))

    nothing = dr.zeros(mi.Float, dr.width(shot))
    sums = for_each(count, add, nothing, nothing, nothing)
    shape, seen = (dr.gather(mi.UInt32, values, shot * count) for values in (returns.shape, returns.seen))
    return _Counted(shape, seen, *sums)


def _by_chords(
    loaded: LoadedScene,
    projection: Projection,
    split: SweptBeamlets,
    chords: ChordTables,
    shots: Shots,
    counted: _Counted,
) -> tuple[Float, Float, Float]:
    """Return what chords tell of the side of the first beamlets: its share of the light, and that times its (u, y)."""
    lane = dr.arange(mi.UInt32, dr.width(shots.theta) * CHORDS)
    shot = lane // CHORDS
    own = shots.take(shot)
    length, row = dr.gather(mi.Float, split.travel, shot), dr.gather(mi.Float, split.length, shot)
    wide = dr.sqrt(1.0 + dr.square(length) / 12.0)
    # The middle of a side of a Gaussian lies along the covariance times the edge's normal.
    along, across = (dr.gather(mi.Float, value, shot) for value in (counted.along, counted.across))
    runs_along = dr.abs(along) >= dr.abs(across) * wide
    node, weight = chords.draw(dr.select(runs_along, 0.0, row), lane - shot * CHORDS)
    reach = _REACH + dr.select(runs_along, 0.5 * length, 0.0)
    posed = pose_scene(loaded, own.poses)
    first_shape, first_seen = (dr.gather(mi.UInt32, values, shot) for values in (counted.shape, counted.seen))

    def is_first(place: Float) -> Mask:
        u, y = dr.select(runs_along, place, node), dr.select(runs_along, node, place)
        start, time = split.start(u, y, shot)
        # As near to an edge as the last of them come, a rounding decides: it must not depend on the batch.
        stop = [mi.Float(0.0), mi.Float(0.0)]
        _, _, si, _, seen = met_by(posed, projection, own, start, stop, time, coherent=False)
        return (met_shape(si) == first_shape) & (dr.select(seen, mi.UInt32(1), 0) == first_seen)

    def turn(number: UInt32, low: Float, high: Float, begins: Mask, ends: Mask) -> tuple[Any, ...]:
        place = dr.select(number == 0, -reach, dr.select(number == 1, reach, 0.5 * (low + high)))
        there = is_first(place)
        begins = dr.select(number == 0, there, begins)
        ends = dr.select(number == 1, there, ends)
        halves = number > 1
        low = dr.select(halves & (there == begins), place, low)
        high = dr.select(halves & (there != begins), place, high)
        return low, high, begins, ends

    no = dr.full(mi.Bool, False, dr.width(lane))
    state: tuple[Any, ...] = (-reach, mi.Float(reach), no, mi.Bool(no))
    state = for_each(_HALVINGS + 2, turn, *state, one_kernel=one_kernel(loaded))
    dr.eval(state)
    low, high, begins, ends = state
    crossing = 0.5 * (low + high)
    below, moment = swept_moments(crossing, dr.select(runs_along, length, 0.0))
    # The part of the first's side on each chord, and its first moment.
    part = dr.select(begins == ends, dr.select(begins, 1.0, 0.0), dr.select(begins, below, 1.0 - below))
    moment = dr.select(begins == ends, 0.0, dr.select(begins, moment, -moment))
    sums = weight * part, weight * moment, weight * part * node
    share, by_chord, beside = (dr.block_sum(value, CHORDS) for value in sums)
    runs_along = dr.gather(mi.Bool, runs_along, dr.arange(mi.UInt32, dr.width(shots.theta)) * CHORDS)
    u, y = dr.select(runs_along, by_chord, beside), dr.select(runs_along, beside, by_chord)
    return share, u, y


def _sides(split: SweptBeamlets, counted: _Counted, share: Float, u: Float, y: Float) -> _Sides:
    """Return what is to be done to beamlets of both sides, of the first ones' share of the light and its moments."""
    count, every = split.count, dr.arange(mi.UInt32, dr.width(share))
    number = counted.number
    parted = (share > 0.0) & (share < 1.0) & (dr.abs(share * count - number) < _MOST_APART)
    # Means of both sides add up to those of the beam, which are 0, and those of all beamlets are too.
    sides: list[list[Float]] = []
    alone, middle = mi.Float(0.0), [mi.Float(0.0), mi.Float(0.0)]
    for sign, part, size in ((1.0, share, number), (-1.0, 1.0 - share, count - number)):
        means, none = [sign * u / part, sign * y / part], parted & (size == 0.0)
        further, aside = (
            dr.clip(mean - sign * counts / size, -_FARTHEST, _FARTHEST)
            for mean, counts in zip(means, (counted.along, counted.across), strict=True)
        )
        moves = split.moved(further, aside, every)
        changed = parted & ~none
        sides.append(
            [
                dr.select(parted, dr.select(none, 0.0, part * count / size), 1.0),
                *(dr.select(changed, move, 0.0) for move in moves),
            ]
        )
        alone = dr.select(none, part, alone)
        middle = [dr.select(none, mean, value) for mean, value in zip(means, middle, strict=True)]
    factor, across_beam, normal, time = ([one, other] for one, other in zip(*sides, strict=True))
    return _Sides(factor, across_beam, normal, time, alone, *middle)


def swept_moments(place: Float, length: Float) -> tuple[Float, Float]:
    """Return the distribution function of u = x + L t at places u, and the mean of u below them times it.

    F = [G(u + L/2) − G(u − L/2)]/L with G(z) = z Φ(z) + φ(z), the integral of Φ; and u F − [H(u + L/2) − H(u − L/2)]/L
    with H(z) = ½[(z² + 1) Φ(z) + z φ(z)], the integral of G.
    """
    safe, wide = dr.maximum(length, _SHORTEST), dr.sqrt(1.0 + dr.square(length) / 12.0)
    once, twice = [], []
    for side in (-0.5, 0.5):
        z = place + side * safe
        below, density = _normal(z)
        once.append(z * below + density)
        twice.append(0.5 * ((dr.square(z) + 1.0) * below + z * density))
    swept = (once[1] - once[0]) / safe
    short, density = _normal(place / wide)
    is_swept = length > _SHORTEST
    below = dr.select(is_swept, swept, short)
    return below, dr.select(is_swept, place * swept - (twice[1] - twice[0]) / safe, -wide * density)


def _normal(z: Float) -> tuple[Float, Float]:
    """Return the standard normal distribution function and its density."""
    return 0.5 + 0.5 * dr.erf(z * math.sqrt(0.5)), dr.exp(-0.5 * dr.square(z)) / math.sqrt(2.0 * math.pi)
