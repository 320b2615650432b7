"""The laser's light of a pattern: a fixed number of shots, whose arrays have sizes that no light can change.

A raster sorts its shots by what their beams meet (:mod:`scanner_sim.render.beam.splitter`), in groups of any size. Few
shots that are wanted again and again are better all followed alike, with beamlets that lie evenly across each one's
sweep (:mod:`scanner_sim.render.beam.swept_beamlets`): then the kernels of one pattern are those of every other. A chief
ray without light goes first; it gives the truth, and the width of the beam where it lands.

What that costs: at an edge across the sweep the light errs by up to 1/(2k) of its step, and by more at oblique ones.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from scanner_sim.render.beam.beamlets import Beamlets
from scanner_sim.render.beam.light import Light, Truth, cluster
from scanner_sim.render.beam.line_projection import LineProjection
from scanner_sim.render.beam.projection import trace_returns
from scanner_sim.render.beam.splitter import CLUSTERS
from scanner_sim.render.beam.swept_beamlets import SweptBeamlets, SweptTables
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import BeamletTables, OpticalLayout
from scanner_sim.scene.files.loader import LoadedScene


def chief_beamlet() -> Beamlets:
    """Return the beam's axis in the middle of the dwell, which has no light."""
    nothing = np.zeros((1, 2))
    none = nothing[:, 0]
    return Beamlets(nodes=nothing, weights=none, variances=none, aperture=nothing, times=none)


def pattern_light(
    loaded: LoadedScene, layout: OpticalLayout, chief: BeamletTables, tables: SweptTables, shots: Shots
) -> tuple[Truth, Light]:
    """Follow the laser's light of a pattern's shots onto the line.

    Parameters
    ----------
    loaded, layout
        Scene and optics.
    chief, tables
        :func:`chief_beamlet` and the beamlets, on the device.
    shots
        The n shots with their true deflections.

    Returns
    -------
    Truth, Light
        Of all shots, in their order. Light that met several surfaces is not in it.
    """
    projection = LineProjection(layout)
    axis = trace_returns(loaded, projection, chief, shots)
    index = dr.arange(mi.UInt32, dr.width(shots.theta))
    truth = Truth.of(loaded, axis.distance, axis.shape, index)
    dr.eval(truth)
    beamlets = SweptBeamlets.of(tables, layout, shots, truth.distance)
    dr.eval(beamlets.length, beamlets.cosine, beamlets.sine)
    spots = trace_returns(loaded, projection, beamlets, shots).spots
    dr.eval(spots)
    clusters = cluster(spots, index, beamlets.count, CLUSTERS, projection.resolution)
    return truth, Light(index, shots.number, *clusters)
