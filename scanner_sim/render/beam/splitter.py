"""The laser's light of a batch of shots: beams split into as many beamlets as what they meet asks for.

Shots are sorted by what their beam meets, which a few beamlets probe. On smooth surfaces its light is one Gaussian, the
beam's on the tangent plane with the probes' mean and power; where they disagree on material, visibility or position,
the shot is traced again with many beamlets and keeps the shape of its light in clusters, each with exact power, mean
and variance. All this is the same for the line sensor and for the photodiode; what differs is in their projections
(:mod:`scanner_sim.render.beam.projection`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_types import Float, UInt32
from scanner_sim.render.beam.beamlets import Beamlets, edge_beamlets, probe_beamlets
from scanner_sim.render.beam.bounces import trace_bounces
from scanner_sim.render.beam.edge_chords import ChordTables, weigh_sides
from scanner_sim.render.beam.light import Light, Truth, cluster
from scanner_sim.render.beam.projection import BeamletReturns, Projection, trace_returns
from scanner_sim.render.beam.swept_beamlets import SweptBeamlets, SweptTables
from scanner_sim.render.garbage import each_whole, garbage_waits
from scanner_sim.render.settings import Transport
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import BeamletTables
from scanner_sim.scene.files.loader import LoadedScene

CLUSTERS = 16
"""Clusters that a shot on an edge keeps."""
BOUNCE_CLUSTERS = 64
"""Clusters of the light that met several surfaces; it may cover the whole line, or the whole record."""
_BATCH = 1 << 22
"""Beamlets, or surface points of random paths, that are traced together: bounds the memory."""
_SMOOTH, _UNEVEN, _EDGE, PARTED = range(4)
"""What a beam meets: one smooth surface, an uneven one, an edge, or one edge that parts it in two."""

Speckle = Callable[[Light, Shots, Truth], Float]
"""What multiplies the amounts of clusters by speckle, of the light, its shots and what their chief rays meet."""


@garbage_waits()
def render_light(
    loaded: LoadedScene,
    projection: Projection,
    settings: Transport,
    shots: Shots,
    seed: int,
    speckle: Speckle | None = None,
) -> tuple[Truth, Iterator[Light]]:
    """Follow the laser's light of a batch of shots to its detector.

    Parameters
    ----------
    loaded, projection, settings
        Scene, where the light is laid, and how finely the beam is split.
    shots
        The n shots with their true deflections.
    seed
        Seed of the random paths of several bounces.
    speckle
        Of light that met one surface; without it there is none.

    Returns
    -------
    Truth
        Of all shots.
    iterator of Light
        Groups of shots that together hold every shot once.
    """
    shots = projection.fired(shots)
    probe = probe_beamlets()
    probed = probe_beams(loaded, projection, probe, BeamletTables.of(probe), shots)
    truth = probed.truth

    def direct() -> Iterator[Light]:
        kinds, finer = np.minimum(probed.footprint.numpy(), _EDGE), []
        smooth = _indices(kinds == _SMOOTH)
        if dr.width(smooth):
            yield probed.whole_beams(projection, smooth, shots.take(smooth))
        for kind, count in ((_UNEVEN, settings.uneven_beamlets), (_EDGE, settings.edge_beamlets)):
            tables = SweptTables.averaged(count)
            for index in _batches(_indices(kinds == kind), count):
                own, reach = shots.take(index), dr.gather(mi.Float, probed.reach, index)
                found = split_beams(loaded, projection, tables, own, reach)
                finer.append(dataclasses.replace(found, index=index))
        # Together: what follows is recorded and launched for each group anew.
        if finer:
            yield Light.of_all(finer)

    def groups() -> Iterator[Light]:
        for light in direct():
            if speckle is not None:
                factor = speckle(light, shots.take(light.index), truth.take(light.index))
                light = dataclasses.replace(light, amount=light.amount * factor)
                dr.eval(light.amount)
            yield from _with_bounces(loaded, projection, settings, shots, seed, light)

    return truth, each_whole(groups())


@dataclass
class Probed:
    """What the beamlets of a ``probe`` tell of n shots, Dr.Jit arrays of shape (n,).

    ``returns`` of them; ``truth`` of the chief ones; ``footprint`` 0 where a beam meets one smooth surface,
    which its probes know all about, and :data:`PARTED` where one edge parts it in two; ``reach`` how far away the
    surface is that counts [m], the chief ray's or the nearest where it meets none, ∞ for nothing.
    """

    probe: Beamlets
    returns: BeamletReturns
    truth: Truth
    footprint: UInt32
    reach: Float

    def whole_beams(self, projection: Projection, index: UInt32, shots: Shots) -> Light:
        """Return the light of beams that meet one smooth surface each, by the indices of their shots.

        The chief beamlet's is that of the whole beam on its tangent plane, at rest and cut by the detector's field. The
        mean of all beamlets' places, weighted by what they return, tells how curvature and a change of strength shift
        it, and a sweep widens it by its variance over the dwell.
        """
        laid, spots, weights = self.returns.laid, self.returns.spots, self.probe.weights.tolist()
        chief = index * len(weights)

        def beamlet(values: Float, number: int = 0) -> Float:
            return dr.gather(mi.Float, values, chief + number)

        middle = beamlet(laid.position) - beamlet(laid.shift)
        total, moved = weights[0] * beamlet(self.returns.strength), mi.Float(0.0)
        for place, weight in enumerate(weights[1:], 1):
            strength = weight * beamlet(self.returns.strength, place)
            total += strength
            moved += dr.select(strength > 0.0, strength * (beamlet(laid.position, place) - middle), 0.0)
        lit = total > 0.0
        amount = dr.select(lit, projection.power(shots) * beamlet(laid.kept) * total, 0.0)
        position = dr.select(lit, beamlet(spots.position) + moved / total, 0.0)
        variance = dr.square(beamlet(spots.sigma)) + dr.square(beamlet(laid.slope_time)) / 12.0
        sigma = dr.sqrt(dr.select(lit, variance, projection.resolution.least_variance))
        coherence = None if spots.coherence is None else beamlet(spots.coherence)
        reference = laid.reference if laid.reference is None else dr.gather(mi.Float, laid.reference, index)
        light = Light(index, shots.number, amount, position, sigma, coherence, reference)
        dr.eval(light)
        return light


def probe_beams(
    loaded: LoadedScene, projection: Projection, probe: Beamlets, tables: BeamletTables, shots: Shots
) -> Probed:
    """Probe what the beams of shots meet.

    ``probe`` is one of :func:`~scanner_sim.render.beam.beamlets.probe_beamlets`, and ``tables`` hold it on the device.
    """
    returns = trace_returns(loaded, projection, tables, shots)
    dr.eval(returns)
    chief = dr.arange(mi.UInt32, dr.width(shots.theta)) * tables.count
    truth = Truth.of(loaded, returns.distance, returns.shape, chief)
    footprint = _classify_footprints(loaded, projection, probe, returns, chief)
    # Sweeps are as long as they are at the surface that counts: the chief ray's, or the nearest where it meets none.
    nearest = dr.select(dr.isfinite(returns.distance), returns.distance, dr.inf)
    nearest = dr.block_reduce(dr.ReduceOp.Min, nearest, tables.count)
    reach = dr.select(dr.isfinite(truth.distance), truth.distance, nearest)
    dr.eval(truth, footprint, reach)
    return Probed(probe, returns, truth, footprint, reach)


def split_beams(
    loaded: LoadedScene,
    projection: Projection,
    tables: SweptTables,
    shots: Shots,
    reach: Float,
    chords: ChordTables | None = None,
) -> Light:
    """Return the light of beams that are split into many beamlets, in clusters.

    ``tables`` of the beamlets; ``reach`` to the surfaces that count (:class:`Probed`); with ``chords`` these tell how
    the edge that parts a beam in two shares out its light.
    """
    split = SweptBeamlets.of(tables, projection.layout, shots, reach)
    dr.eval(split.columns)
    many = trace_returns(loaded, projection, split, shots)
    spots, count = many.spots, tables.count
    if chords is None:
        dr.eval(spots, many.laid.reference)
    else:
        spots, count = weigh_sides(loaded, projection, split, chords, many, shots), count + 1
    every = dr.arange(mi.UInt32, dr.width(shots.theta))
    found = cluster(spots, every, count, CLUSTERS, projection.resolution)
    return Light(every, shots.number, *found, many.laid.reference)


def _indices(where: NDArray[np.bool_]) -> UInt32:
    return mi.UInt32(for_device(np.flatnonzero(where), np.uint32))


def _batches(indices: UInt32, lanes: int) -> Iterator[UInt32]:
    """Yield indices of shots in batches whose lanes, so many each, fit the memory."""
    together = max(1, _BATCH // lanes)
    for start in range(0, dr.width(indices), together):
        some = dr.arange(mi.UInt32, min(together, dr.width(indices) - start)) + dr.opaque(mi.UInt32, start)
        yield dr.gather(mi.UInt32, indices, some)


def _with_bounces(
    loaded: LoadedScene, projection: Projection, settings: Transport, shots: Shots, seed: int, direct: Light
) -> Iterator[Light]:
    """Yield the light of a group, in parts that fit the memory, with the light of several bounces added."""
    if settings.bounces == 1:
        yield direct
        return
    beamlets = edge_beamlets(settings.bounce_paths)
    points = settings.bounce_paths * (settings.bounces - 1)
    for some in _batches(dr.arange(mi.UInt32, direct.shots), points):
        part = direct.part(some)
        own = shots.take(part.index)
        spots = trace_bounces(
            loaded, projection, beamlets, settings.bounces, own, seed, reference=part.reference
        )
        every = dr.arange(mi.UInt32, part.shots)
        late = cluster(spots, every, points, BOUNCE_CLUSTERS, projection.resolution)
        yield part.join(Light(part.index, part.shot, *late, part.reference))


def _classify_footprints(
    loaded: LoadedScene, projection: Projection, probe: Beamlets, returns: BeamletReturns, chief: UInt32
) -> UInt32:
    """Return what each shot's beam meets: a smooth surface, an uneven one or an edge.

    Where beamlets disagree with the chief one on material or visibility, or lie far off its tangent plane, there is an
    edge; where they leave the plane a little or return unequally, the surface is uneven. An edge parts the beam in two
    where those that meet another shape than the chief one, or are seen otherwise, agree among themselves, and the rest
    lies on the chief one's plane.
    """

    def beamlet(values: Any, number: int = 0) -> Any:
        return dr.gather(type(values), values, chief + number)

    layout, resolution, laid = projection.layout, projection.resolution, returns.laid
    material, seen = dr.gather(mi.UInt32, loaded.material_of, beamlet(returns.shape)), beamlet(returns.seen)
    position = beamlet(laid.position) - beamlet(laid.shift)
    slope_a, slope_b, slope_time = (beamlet(slope) for slope in (laid.slope_a, laid.slope_b, laid.slope_time))
    # The beam's ruled lines turn about its axis by atan((z − z₀)/z_R).
    twist = layout.twist(beamlet(returns.distance))
    cosine = dr.rsqrt(1.0 + dr.square(twist))
    sine = twist * cosine
    edge, farthest = mi.Bool(False), mi.Float(0.0)
    shape = beamlet(returns.shape)
    other_shape, other_seen, differs, mixed = shape, seen, mi.Bool(False), mi.Bool(False)
    for number, (a, b) in enumerate(probe.nodes.tolist()[1:], 1):
        flat = position + slope_a * (a * cosine - b * sine) + slope_b * (a * sine + b * cosine)
        flat += slope_time * float(probe.times[number])
        own_shape, own_seen = beamlet(returns.shape, number), beamlet(returns.seen, number)
        departure = dr.select(seen == 1, dr.abs(beamlet(laid.position, number) - flat), 0.0)
        far = departure > resolution.edge_departure
        edge |= (dr.gather(mi.UInt32, loaded.material_of, own_shape) != material) | (own_seen != seen) | far
        beyond = (own_shape != shape) | (own_seen != seen)
        mixed |= (beyond & differs & ((own_shape != other_shape) | (own_seen != other_seen))) | (
            ~beyond & far
        )
        other_shape = dr.select(beyond & ~differs, own_shape, other_shape)
        other_seen = dr.select(beyond & ~differs, own_seen, other_seen)
        differs |= beyond
        farthest = dr.maximum(farthest, departure)
    parted = edge & differs & ~mixed
    strength = [beamlet(returns.strength, number) for number in range(len(probe.weights))]
    uneven = (farthest > resolution.uneven_departure) | projection.is_unequal(strength)
    uneven |= (seen == 1) & (dr.abs(slope_time) > resolution.gaussian_travel)
    uneven_or_smooth = dr.select(uneven, mi.UInt32(_UNEVEN), _SMOOTH)
    return dr.select(parted, PARTED, dr.select(edge, _EDGE, uneven_or_smooth))
