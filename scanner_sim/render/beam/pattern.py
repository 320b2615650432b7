"""The laser's light of patterns: shots in kernels that are recorded once, so that no array's size may depend on light.

As in a raster (:mod:`scanner_sim.render.beam.splitter`) a few beamlets probe what each beam meets and carry the light
of smooth ground; the other shots are traced again with many. How many these are the host must know: between both steps
it reads what the probes tell, and fills the indices up to one of a few numbers of lanes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_types import Float, Mask, UInt32
from scanner_sim.render.beam.beamlets import probe_beamlets
from scanner_sim.render.beam.edge_chords import ChordTables
from scanner_sim.render.beam.light import Light, Truth
from scanner_sim.render.beam.line_projection import LineProjection
from scanner_sim.render.beam.splitter import CLUSTERS, PARTED, probe_beams, split_beams
from scanner_sim.render.beam.swept_beamlets import SweptTables
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import BeamletTables, OpticalLayout
from scanner_sim.scene.files.loader import LoadedScene

_FEWEST_PARTED, _FEWEST_OTHER, _PARTS = 16, 4, 4
"""Lanes for shots of either kind that are traced again, at least, and in how many steps their number doubles: few are
few recordings."""
_FEWER, _FEWEST_BEAMLETS = 4, 19
"""How many times fewer beamlets do where chords tell the sides of an edge, and how many these are at least."""

Again: TypeAlias = "tuple[UInt32, Mask] | None"
"""Indices of shots in lanes of a number that few patterns have, and which of them there are; None for no shot."""


@dataclass
class PatternTables:
    """The beamlets of patterns, on the device.

    Those that ``probe``, the ``many``, and the ``few`` of beams that one edge parts in two, with their ``chords``.
    """

    probe: BeamletTables
    many: SweptTables
    few: SweptTables
    chords: ChordTables

    @classmethod
    def of(cls, count: int) -> PatternTables:
        """Return the tables for ``count`` beamlets where probes do not tell all."""
        few = max(_FEWEST_BEAMLETS, count // _FEWER)
        probe = BeamletTables.of(probe_beamlets(both_ends=True))
        return cls(probe, SweptTables.averaged(count), SweptTables.averaged(few), ChordTables.of_all())


@dataclass
class PatternProbes:
    """What the probes of n shots tell, Dr.Jit arrays of shape (n,).

    ``truth``; ``footprint`` and ``reach`` of :class:`Probed`; and the light of beams on smooth ground: ``amount``,
    ``position``, ``sigma`` and ``coherence`` of :class:`Light`.
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


def lanes_again(footprint: NDArray[np.uint32]) -> tuple[Again, Again]:
    """Return the shots that are traced again: those that one edge parts in two, and others."""
    parted = footprint == PARTED
    return _lanes(parted, _FEWEST_PARTED), _lanes((footprint != 0) & ~parted, _FEWEST_OTHER)


def _lanes(again: NDArray[np.bool_], fewest: int) -> Again:
    """Return the indices of some shots, filled up with the first, and which of them there are; None for none."""
    some = np.flatnonzero(again)
    if not len(some):
        return None
    octave = (max(len(some), fewest) - 1).bit_length() - 1
    step = max(fewest, 1 << octave) // _PARTS
    lanes = max(fewest, step * -(-len(some) // step))
    index, real = np.zeros(lanes, dtype=np.uint32), np.arange(lanes) < len(some)
    index[: len(some)] = some
    return mi.UInt32(for_device(index, np.uint32)), mi.Bool(for_device(real, np.bool_))


def pattern_light(
    loaded: LoadedScene,
    layout: OpticalLayout,
    tables: PatternTables,
    shots: Shots,
    probes: PatternProbes,
    parted: Again,
    other: Again,
) -> tuple[Float, ...]:
    """Follow the laser's light of a pattern's shots onto the line.

    Parameters
    ----------
    loaded, layout, tables
        Scene, optics and beamlets.
    shots, probes
        The n shots with their true deflections, and what their probes tell.
    parted, other
        From :func:`lanes_again`.

    Returns
    -------
    tuple
        The clusters of all shots, in their order, for :func:`light_of`. Light that met several surfaces is not in it.
    """
    projection = LineProjection(layout)
    number = dr.width(shots.theta)
    shot, smooth = dr.arange(mi.UInt32, number), probes.footprint == 0
    columns = {}
    for name, empty in (("amount", 0.0), ("position", 0.0), ("sigma", 1.0), ("coherence", 0.0)):
        # Each entry is written once: what is written may be one kernel, whose lanes have no order.
        columns[name] = dr.full(mi.Float, empty, CLUSTERS * number)
        dr.scatter(columns[name], getattr(probes, name), shot, smooth, mode=dr.ReduceMode.Permute)
    for lanes, beamlets, chords in ((parted, tables.few, tables.chords), (other, tables.many, None)):
        if lanes is None:
            continue
        index, real = lanes
        own, reach = shots.take(index), dr.gather(mi.Float, probes.reach, index)
        dr.eval(own)
        again = split_beams(loaded, projection, beamlets, own, reach, chords)
        lane = dr.arange(mi.UInt32, dr.width(again.amount))
        slot, row = lane // dr.width(index), lane % dr.width(index)
        to, there = slot * number + dr.gather(mi.UInt32, index, row), dr.gather(mi.Bool, real, row)
        for name, column in columns.items():
            dr.scatter(column, getattr(again, name), to, there, mode=dr.ReduceMode.Permute)
    dr.eval(columns)
    return tuple(columns.values())


def light_of(shots: Shots, clusters: tuple[Float, ...]) -> Light:
    """Return the light of all shots of patterns in clusters."""
    return Light(dr.arange(mi.UInt32, dr.width(shots.theta)), shots.number, *clusters)
