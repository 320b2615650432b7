"""The shots of a pattern on their way to the device: all that changes from pattern to pattern, in two arrays.

Dr.Jit reads NumPy's memory as it lies. Two arrays of the same layout for every pattern, aligned alike, let kernels that
were recorded for one serve all others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_types import Float, UInt32
from scanner_sim.foundation.streams import Seed
from scanner_sim.optics.built_instrument import BuiltInstrument
from scanner_sim.optics.deflection import Mirrors
from scanner_sim.render.shot_departures import COLUMNS, ShotDepartures
from scanner_sim.render.shots import Lattice, Shots, draw_errors, lattice_position
from scanner_sim.scan.protocol import Aim
from scanner_sim.scene.files.loader import packed_poses, unpacked_poses

Array = NDArray[np.float64]

_ALIGNMENT = 64
"""Alignment of what is handed to the device [bytes]: Dr.Jit makes a kernel for each alignment that it meets."""
_ANGLES = 5
"""Columns of angles: aimed Θ, Θ and φ with drift, and both travels."""


@dataclass
class Fired:
    """The shots of a pattern as they are fired, Dr.Jit arrays of shape (points,).

    ``shots``; ``aimed`` the commanded Θ [rad]; ``error`` the random errors along Θ and φ [rad], and ``seen`` what of
    them the encoders read.
    """

    shots: Shots
    aimed: Float
    error: list[Float]
    seen: list[Float]


def packed_shots(
    aim: Aim,
    still: Sequence[Array],
    mirrors: Mirrors,
    duty_cycle: float,
    poses: Sequence[Array],
    built: BuiltInstrument | None = None,
) -> tuple[Float, UInt32]:
    """Return the shots of an aim as two Dr.Jit arrays, column after column, for :func:`fired_shots`.

    Parameters
    ----------
    aim
        The commanded shots.
    still
        Errors of Θ and φ that are known beforehand [rad], each of shape (points,): drift, and what encoders read wrong.
    mirrors, duty_cycle
        The mirrors, and the share of the dwell in which the laser shines.
    poses
        Of the objects that move, at the shots' times, each of shape (points, 4, 4).
    built
        The instrument as built; None is built as designed.
    """
    numbers: list[NDArray[Any]] = [
        aim.theta,
        aim.theta + still[0],
        aim.phi + still[1],
        duty_cycle * aim.travel_theta,
        duty_cycle * aim.travel_phi,
    ]
    integers: list[NDArray[Any]] = [aim.shot]
    if mirrors.wobble > 0.0:
        moment = lattice_position(aim.time, mirrors.wobble_time)
        for angle in (aim.theta, aim.phi):
            for cell, part in (lattice_position(angle, mirrors.wobble_angle), moment):
                integers.append(cell)
                numbers.append(part)
    if built is not None and not built.is_steady:
        numbers += built.unsteadiness(aim.time).columns
    if poses:
        numbers.append(packed_poses(list(poses)))
    return mi.Float(_join_columns(numbers, np.float32)), mi.UInt32(_join_columns(integers, np.uint32))


def fired_shots(
    numbers: Float,
    integers: UInt32,
    points: int,
    mirrors: Mirrors,
    bodies: int,
    seed: Seed,
    built: BuiltInstrument | None = None,
) -> Fired:
    """Return the shots that :func:`packed_shots` packed, with the mirrors' random errors of their numbers.

    Parameters
    ----------
    numbers, integers, points
        The packed arrays, and the number of shots.
    mirrors, bodies, seed, built
        The mirrors, number of moving objects, seed of the errors, and the instrument as built.
    """
    lane = dr.arange(mi.UInt32, points)

    def columns(kind: Any, packed: Any, first: int, count: int) -> list[Any]:
        indices = (lane + dr.opaque(mi.UInt32, points * (first + number)) for number in range(count))
        return [dr.gather(kind, packed, index) for index in indices]

    aimed, theta, phi, travel_theta, travel_phi = columns(mi.Float, numbers, 0, _ANGLES)
    (number,) = columns(mi.UInt32, integers, 0, 1)
    lattices = []
    for mirror in range(2 if mirrors.wobble > 0.0 else 0):
        parts = columns(mi.Float, numbers, _ANGLES + 2 * mirror, 2)
        cells = columns(mi.UInt32, integers, 1 + 2 * mirror, 2)
        lattices.append(Lattice(cells[0], parts[0], cells[1], parts[1]))
    error, seen, synchronisation = draw_errors(number, lattices, mirrors, seed)
    first = _ANGLES + 2 * len(lattices)
    departures = None if built is None else ShotDepartures()
    if built is not None and not built.is_steady:
        departures = ShotDepartures.of(columns(mi.Float, numbers, first, COLUMNS))
        first += COLUMNS
    if built is not None and departures is not None:
        departures = departures.with_noise(built, number, seed)
    poses = unpacked_poses(numbers, bodies, points, points * first) if bodies else None
    own = theta + error[0], phi + error[1]
    shots = Shots(number, *own, travel_theta, travel_phi, synchronisation, poses, departures=departures)
    fired = Fired(shots, aimed, error, seen)
    dr.eval(fired)
    return fired


def _join_columns(columns: list[NDArray[Any]], kind: Any) -> NDArray[Any]:
    """Return columns one after the other, in aligned memory of their own."""
    size = sum(len(column) for column in columns)
    memory = np.empty(size + _ALIGNMENT // 4, dtype=kind)
    start = -memory.ctypes.data % _ALIGNMENT // 4
    joined = memory[start : start + size]
    np.concatenate(columns, out=joined, casting="same_kind")
    return joined
