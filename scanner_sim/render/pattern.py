"""The laser's light of a pattern: a fixed number of shots, whose arrays have sizes that no light can change.

A raster sorts its shots by what their beams meet (:mod:`scanner_sim.render.light`) and so has groups of any size. Few
shots that are wanted again and again are better all followed alike, with the evenly spread beamlets that edges need:
then the kernels of one pattern are those of every other. A chief ray without light goes first and tells the truth.

What that costs: on smooth ground the spiral's fourth moments are not a Gaussian's, and the beamlets are points in the
choice between two sides of an edge: with k of them the light at an edge errs by about 1/(2k) of its step.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from scanner_sim.render.beamlets import Beamlets, edge_beamlets
from scanner_sim.render.clusters import cluster
from scanner_sim.render.light import Light, Truth, chief_truth
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import BeamletTables, Bench, trace_spots
from scanner_sim.scene.loader import LoadedScene

CLUSTERS = 16
"""Clusters that each shot keeps."""


def pattern_beamlets(count: int) -> Beamlets:
    """Return the beamlets of a pattern's shots: the chief ray, which has no light, and ``count`` for edges."""
    edge = edge_beamlets(count)
    chief = np.zeros((1, 2))
    return Beamlets(
        nodes=np.concatenate([chief, edge.nodes]),
        weights=np.concatenate([[0.0], edge.weights]),
        width=edge.width,
        aperture=np.concatenate([chief, edge.aperture]),
        times=np.concatenate([[0.0], edge.times]),
    )


def pattern_light(
    loaded: LoadedScene, bench: Bench, beamlets: BeamletTables, shots: Shots
) -> tuple[Truth, Light]:
    """Follow the laser's light of a pattern's shots onto the line.

    Parameters
    ----------
    loaded, bench
        Scene and optics.
    beamlets
        Those of :func:`pattern_beamlets`, on the device.
    shots
        The n shots with their true deflections.

    Returns
    -------
    Truth, Light
        Of all shots, in their order. Light that met several surfaces is not in it.
    """
    count, spots = dr.width(beamlets.weights), trace_spots(loaded, bench, beamlets, shots)
    light = spots.power, spots.position, spots.sigma, spots.across, spots.coherence
    dr.eval(light, spots.distance, spots.shape)
    index = dr.arange(mi.UInt32, dr.width(shots.theta))
    chief = index * count
    truth = chief_truth(loaded, spots.distance, spots.shape, chief)
    dr.eval(truth)
    clusters: Any = cluster(spots, index, count, CLUSTERS)
    return truth, Light(index, shots.number, clusters)
