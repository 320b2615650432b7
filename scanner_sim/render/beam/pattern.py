"""The laser's light of patterns: shots in kernels that are recorded once, so that no array's size may depend on light.

As in a raster (:mod:`scanner_sim.render.beam.splitter`) a few beamlets probe what each beam meets and carry the light
of smooth ground; the other shots are traced again with many. How many these are the host must know: between both steps
it reads what the probes tell, and fills the indices up to one of a few numbers of lanes.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_types import Float, Mask, UInt32
from scanner_sim.render.beam.beamlets import probe_beamlets
from scanner_sim.render.beam.light import Light, Truth
from scanner_sim.render.beam.line_projection import LineProjection
from scanner_sim.render.beam.splitter import CLUSTERS, probe_beams, split_beams
from scanner_sim.render.beam.swept_beamlets import SweptTables
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import BeamletTables, OpticalLayout
from scanner_sim.scene.files.loader import LoadedScene

_FEWEST, _PARTS = 16, 4
"""Lanes for shots that are traced again, at least, and in how many steps their number doubles: few are few
recordings."""


@dataclass
class PatternTables:
    """The beamlets of patterns, on the device: those that probe, and the many."""

    probe: BeamletTables
    many: SweptTables

    @classmethod
    def of(cls, count: int) -> PatternTables:
        """Return the tables for ``count`` beamlets where probes do not tell all."""
        return cls(BeamletTables.of(probe_beamlets(both_ends=True)), SweptTables.averaged(count))


@dataclass
class PatternProbes:
    """What the probes of n shots tell, Dr.Jit arrays of shape (n,).

    ``truth``; ``footprint`` 0 where the beam meets one smooth surface; ``reach`` of :class:`Probed`; and the light of
    such beams: ``amount``, ``position``, ``sigma`` and ``coherence`` of :class:`Light`.
    """

    truth: Truth
    footprint: UInt32
    reach: Float
    amount: Float
    position: Float
    sigma: Float
    coherence: Float


def probe_pattern(
    loaded: LoadedScene, layout: OpticalLayout, tables: PatternTables, shots: Shots
) -> PatternProbes:
    """Probe what the beams of a pattern's shots meet."""
    projection, every = LineProjection(layout), dr.arange(mi.UInt32, dr.width(shots.theta))
    probed = probe_beams(loaded, projection, probe_beamlets(both_ends=True), tables.probe, shots)
    whole = probed.whole_beams(projection, every, shots)
    return PatternProbes(
        probed.truth,
        probed.footprint,
        probed.reach,
        whole.amount,
        whole.position,
        whole.sigma,
        whole.coherence,
    )


def lanes_again(footprint: NDArray[np.uint32]) -> tuple[UInt32, Mask]:
    """Return the indices of the shots that are traced again, filled up with the first, and which of them there are."""
    uneven = np.flatnonzero(footprint)
    octave = (max(len(uneven), _FEWEST) - 1).bit_length() - 1
    step = max(_FEWEST, 1 << octave) // _PARTS
    lanes = max(_FEWEST, step * -(-len(uneven) // step))
    index, real = np.zeros(lanes, dtype=np.uint32), np.arange(lanes) < len(uneven)
    index[: len(uneven)] = uneven
    return mi.UInt32(for_device(index, np.uint32)), mi.Bool(for_device(real, np.bool_))


def pattern_light(
    loaded: LoadedScene,
    layout: OpticalLayout,
    tables: PatternTables,
    shots: Shots,
    probes: PatternProbes,
    index: UInt32,
    real: Mask,
) -> tuple[Float, ...]:
    """Follow the laser's light of a pattern's shots onto the line.

    Parameters
    ----------
    loaded, layout, tables
        Scene, optics and beamlets.
    shots, probes
        The n shots with their true deflections, and what their probes tell.
    index, real
        From :func:`lanes_again`.

    Returns
    -------
    tuple
        The clusters of all shots, in their order, for :func:`light_of`. Light that met several surfaces is not in it.
    """
    own, projection = shots.take(index), LineProjection(layout)
    dr.eval(own)
    again = split_beams(loaded, projection, tables.many, own, dr.gather(mi.Float, probes.reach, index))
    shot, number = dr.arange(mi.UInt32, dr.width(shots.theta)), dr.width(shots.theta)
    lane = dr.arange(mi.UInt32, dr.width(again.amount))
    slot, row = lane // dr.width(index), lane % dr.width(index)
    to, there = slot * number + dr.gather(mi.UInt32, index, row), dr.gather(mi.Bool, real, row)
    columns, smooth = [], probes.footprint == 0
    for name, empty in (("amount", 0.0), ("position", 0.0), ("sigma", 1.0), ("coherence", 0.0)):
        column = dr.full(mi.Float, empty, CLUSTERS * number)
        # Each entry is written once: both may be the same kernel, whose lanes have no order.
        dr.scatter(column, getattr(probes, name), shot, smooth, mode=dr.ReduceMode.Permute)
        dr.scatter(column, getattr(again, name), to, there, mode=dr.ReduceMode.Permute)
        columns.append(column)
    dr.eval(columns)
    return tuple(columns)


def light_of(shots: Shots, clusters: tuple[Float, ...]) -> Light:
    """Return the light of all shots of patterns in clusters."""
    return Light(dr.arange(mi.UInt32, dr.width(shots.theta)), shots.number, *clusters)
