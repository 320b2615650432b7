"""Echoes: the pulse's light from the laser over the scene into the photodiode, each beamlet with its own path.

A beamlet's path is the line from the laser to the surface and from there to the lens node. To the node, not to the
point of the aperture that it is seen from: by Fermat's principle all ways through the lens to one image point are
optically as long (Born and Wolf, *Principles of optics*, 7th ed., 1999, sec. 3.3.2). The surface's tangent plane turns
the beamlet's width into a spread of its path, so that slopes stretch the pulse; beamlets at different depths split it.

Not modelled: the index of refraction of air (there is none in orbit), the spread of delays within the lens, and the
lens's point spread at the edge of the photodiode's field, which cuts sharply.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from scanner_sim.foundation.device_types import Float, UInt32, Vector3f
from scanner_sim.render.beam.beamlets import Beamlets, edge_beamlets, smooth_beamlets
from scanner_sim.render.beam.echo_bounces import with_bounces
from scanner_sim.render.beam.echo_clusters import Echoes, PhotodiodeView, gather_echoes
from scanner_sim.render.beam.light import Truth, batches_of_shots, chief_truth
from scanner_sim.render.rays import pose_scene
from scanner_sim.render.settings import Transport
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout, connect, device_frame, lanes, launch, meet
from scanner_sim.scene.files.loader import LoadedScene

CLUSTERS = 16
"""Echoes that a shot on an edge keeps."""
_NONZERO = 1e-6
_REFERENCES_PER_METRE = 64.0
"""References of paths are multiples of a 64th of a metre: differences from them are exact in single precision."""
_LEAST_COSINE = 0.02
"""Least cosine of incidence for the beamlet's footprint; nearer to grazing it stays at this size."""
_UNEVEN_DEPARTURE = 5e-3
"""Departure of a beamlet's path from the tangent plane [m] that calls for more beamlets."""
_EDGE_DEPARTURE = 20e-3
"""The same departure [m] that is taken for an edge."""
_UNEVEN_STRENGTH = 0.1
"""Relative spread of the returned strength that calls for more beamlets."""
_SMOOTH, _UNEVEN, _EDGE = 0, 1, 2


Speckle = Callable[[Echoes, Shots, Truth], Float]
"""What multiplies the shares of echoes by speckle, of the echoes, their shots and what their chief rays meet."""


@dataclass
class Returns:
    """What each beamlet brings back, Dr.Jit arrays of n · k entries.

    ``share`` of the pulse's power; ``path`` from the shot's reference and its standard deviation ``spread`` [m];
    ``strength`` per power of the beamlet; ``slope_a``, ``slope_b`` derivatives of the path along the beam's axes per
    standard deviation of the beam [m]; ``distance`` along the beamlet [m]; ``seen`` 1 where the photodiode sees it;
    ``shape`` registry index of the surface, 0 for none.
    """

    share: Float
    path: Float
    spread: Float
    strength: Float
    slope_a: Float
    slope_b: Float
    distance: Float
    seen: UInt32
    shape: UInt32


def render_echoes(
    loaded: LoadedScene,
    layout: OpticalLayout,
    view: PhotodiodeView,
    settings: Transport,
    shots: Shots,
    seed: int,
    speckle: Speckle | None = None,
) -> tuple[Truth, Iterator[Echoes]]:
    """Follow the pulses of a batch of shots to the photodiode.

    Parameters
    ----------
    loaded, layout, view, settings
        Scene, optics, the photodiode's look, and how finely the beam is split.
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
    iterator of Echoes
        Groups of shots that together hold every shot once.
    """
    count = dr.width(shots.theta)
    beamlets = smooth_beamlets(settings.beamlets)
    returns, reference = trace_returns(loaded, layout, view, beamlets, shots)
    chief = dr.arange(mi.UInt32, count) * len(beamlets.weights)
    truth = chief_truth(loaded, returns.distance, returns.shape, chief)
    footprint = _classify_footprints(loaded, layout, beamlets, returns, chief)
    dr.eval(truth, footprint)

    def groups() -> Iterator[Echoes]:
        smooth: UInt32 = dr.compress(footprint == _SMOOTH)
        if dr.width(smooth):
            own = dr.gather(mi.Float, reference, smooth)
            some = shots.take(smooth)
            direct = _gather(returns, smooth, len(beamlets.weights), 1, smooth, some, own)
            direct = _with_speckle(direct, some, truth.take(smooth), speckle)
            yield from with_bounces(loaded, layout, view, settings, shots, seed, direct)
        for kind, fine in ((_UNEVEN, settings.uneven_beamlets), (_EDGE, settings.edge_beamlets)):
            for index in batches_of_shots(dr.compress(footprint == kind), fine):
                own_shots = shots.take(index)
                many, own = trace_returns(loaded, layout, view, edge_beamlets(fine), own_shots)
                every = dr.arange(mi.UInt32, dr.width(index))
                direct = _gather(many, every, fine, CLUSTERS, index, own_shots, own)
                direct = _with_speckle(direct, own_shots, truth.take(index), speckle)
                yield from with_bounces(loaded, layout, view, settings, shots, seed, direct)

    return truth, groups()


def trace_returns(
    loaded: LoadedScene, layout: OpticalLayout, view: PhotodiodeView, beamlets: Beamlets, shots: Shots
) -> tuple[Returns, Float]:
    """Return what comes back of all beamlets of all shots, and the reference of the paths of each shot [m]."""
    count, lane = len(beamlets.weights), lanes(beamlets, shots)
    frame = view.frame(device_frame(layout, lane.own.theta, lane.own.phi))
    beam = launch(layout, frame, lane.node)
    loaded = pose_scene(loaded, lane.own.poses)
    si = meet(loaded, beam.origin, beam.direction)
    hit = si.is_valid()
    strength, seen = connect(loaded, layout, frame, si, lane.stop, hit)
    seen &= view.sees(frame, si.p)
    strength = dr.select(seen, strength, 0.0)
    back = mi.Vector3f(si.p - frame.lens)
    length = dr.norm(back)
    whole = dr.select(hit, si.t + length, 0.0)
    dr.eval(si, strength, seen, length, whole)
    # The nearest of what comes back: all paths of the shot are then small numbers of one sign.
    nearest = dr.block_reduce(dr.ReduceOp.Min, dr.select(hit, whole, dr.inf), count)
    reference = dr.select(
        dr.isfinite(nearest), dr.floor(nearest * _REFERENCES_PER_METRE) / _REFERENCES_PER_METRE, 0.0
    )
    half = 0.5 * dr.gather(mi.Float, reference, lane.shot)
    path = (si.t - half) + (length - half)

    # Derivatives of the path along the two axes of the beam, on the surface's tangent plane.
    cosine: Any = dr.dot(si.n, beam.direction)
    cosine = dr.select(dr.abs(cosine) < _LEAST_COSINE, dr.copysign(mi.Float(_LEAST_COSINE), cosine), cosine)
    laser = layout.laser
    away = (si.t - dr.opaque(mi.Float, laser.waist_distance)) / dr.opaque(mi.Float, laser.rayleigh_length)
    scale = dr.opaque(mi.Float, 0.5 * laser.waist_radius) * dr.sqrt(1.0 + dr.square(away))
    both = beam.direction + back / dr.maximum(length, _NONZERO)

    def slope(axis: Vector3f) -> Float:
        moved = axis - beam.direction * (dr.dot(si.n, axis) / cosine)
        return dr.dot(moved, both) * scale

    slope_a, slope_b = slope(frame.across), slope(frame.normal)
    spread = dr.opaque(mi.Float, beamlets.width) * dr.sqrt(dr.square(slope_a) + dr.square(slope_b))
    returns = Returns(
        share=lane.weight * strength,
        path=dr.select(hit, path, 0.0),
        spread=dr.select(hit, spread, 0.0),
        strength=strength,
        slope_a=slope_a,
        slope_b=slope_b,
        distance=dr.select(hit, si.t, dr.nan),
        seen=dr.select(seen, mi.UInt32(1), 0),
        shape=dr.select(hit, dr.reinterpret_array(mi.UInt32, si.shape), 0),
    )
    dr.eval(returns, reference)
    return returns, reference


def _gather(
    returns: Returns,
    indices: UInt32,
    count: int,
    clusters: int,
    index: UInt32,
    shots: Shots,
    reference: Float,
) -> Echoes:
    """Gather the returns of some shots, by their indices, into a few echoes."""
    found = gather_echoes(returns.share, returns.path, returns.spread, indices, count, clusters)
    return Echoes(index, shots.number, *found, reference)


def _with_speckle(echoes: Echoes, shots: Shots, truth: Truth, speckle: Speckle | None) -> Echoes:
    """Return echoes with their speckle."""
    if speckle is None:
        return echoes
    share = echoes.share * speckle(echoes, shots, truth)
    dr.eval(share)
    return dataclasses.replace(echoes, share=share)


def _classify_footprints(
    loaded: LoadedScene, layout: OpticalLayout, beamlets: Beamlets, returns: Returns, chief: UInt32
) -> UInt32:
    """Return what each shot's beam meets: a smooth surface, an uneven one or an edge."""

    def beamlet(values: Any, number: int) -> Any:
        return dr.gather(type(values), values, chief + number)

    material = dr.gather(mi.UInt32, loaded.material_of, beamlet(returns.shape, 0))
    seen, position = beamlet(returns.seen, 0), beamlet(returns.path, 0)
    slope_a, slope_b = beamlet(returns.slope_a, 0), beamlet(returns.slope_b, 0)
    # The beam's ruled lines turn about its axis by atan((z − z₀)/z_R).
    to_waist = beamlet(returns.distance, 0) - dr.opaque(mi.Float, layout.laser.waist_distance)
    twist = to_waist / dr.opaque(mi.Float, layout.laser.rayleigh_length)
    cosine = dr.rsqrt(1.0 + dr.square(twist))
    sine = twist * cosine
    edge, farthest = mi.Bool(False), mi.Float(0.0)
    weakest = strongest = beamlet(returns.strength, 0)
    for number, (a, b) in enumerate(beamlets.nodes.tolist()[1:], 1):
        edge |= dr.gather(mi.UInt32, loaded.material_of, beamlet(returns.shape, number)) != material
        edge |= beamlet(returns.seen, number) != seen
        flat = position + slope_a * (a * cosine - b * sine) + slope_b * (a * sine + b * cosine)
        farthest = dr.maximum(farthest, dr.abs(beamlet(returns.path, number) - flat))
        strength = beamlet(returns.strength, number)
        weakest, strongest = dr.minimum(weakest, strength), dr.maximum(strongest, strength)
    edge |= (seen == 1) & (farthest > _EDGE_DEPARTURE)
    uneven = (seen == 1) & (farthest > _UNEVEN_DEPARTURE) | (
        strongest - weakest > _UNEVEN_STRENGTH * strongest
    )
    return dr.select(edge, mi.UInt32(_EDGE), dr.select(uneven, mi.UInt32(_UNEVEN), mi.UInt32(_SMOOTH)))
