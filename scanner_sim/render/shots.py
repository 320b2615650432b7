"""Where the mirrors really point: the commanded deflections with the mirrors' errors.

Three angles belong to a shot. The *commanded* one is in the aim. The *true* one, where the light goes, differs from it
by jitter, wobble and drift, all common to laser and receiver. The *measured* one is the encoders'
(:mod:`scanner_sim.detector.encoders`). Besides, the receiver looks past the laser's direction by the synchronisation
error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_streams import RunSeeds, generator
from scanner_sim.foundation.device_types import Float, UInt32
from scanner_sim.foundation.streams import Seed, Stream
from scanner_sim.optics.built_instrument import BuiltInstrument, still_errors
from scanner_sim.optics.deflection import Mirrors
from scanner_sim.render.rays import take_poses
from scanner_sim.render.shot_departures import ShotDepartures
from scanner_sim.scan.protocol import Aim
from scanner_sim.scene.files.loader import Pose

Array = NDArray[np.float64]


@dataclass
class Shots:
    """Shots as they are fired, Dr.Jit arrays of shape (n,).

    ``number`` of each shot (it addresses random numbers); true deflections ``theta`` and ``phi`` in the middle of the
    dwell, ``travel_theta`` and ``travel_phi`` by which they change while the laser shines, ``synchronisation`` by which
    the receiver looks further along Θ than the laser [rad]. What is not given is 0. ``poses`` of the moving objects in
    the middle of the dwell; None leaves them where the loaded scene has them. ``even_travel`` is by how much Θ is
    commanded to change in a dwell, φ at rest, where it is the same for all shots [rad]; else None. ``seeds`` of the
    runs that the shots belong to; None where all belong to one. ``commanded`` deflection Θ [rad], which is no part of
    the light's way; None where nobody asks for it. ``departures`` of the instrument as built that differ from shot to
    shot; None where none do.
    """

    number: UInt32
    theta: Float
    phi: Float
    travel_theta: Float = None
    travel_phi: Float = None
    synchronisation: Float = None
    poses: tuple[Pose, ...] | None = None
    even_travel: float | None = None
    seeds: RunSeeds | None = None
    commanded: Float | None = None
    departures: ShotDepartures | None = None

    def __post_init__(self) -> None:
        """Put zeros where nothing was given."""
        for name in ("travel_theta", "travel_phi", "synchronisation"):
            if getattr(self, name) is None:
                setattr(self, name, dr.zeros(mi.Float, dr.width(self.theta)))

    @property
    def ways(self) -> tuple[Float, Float]:
        """Angles by which each beam moves while the laser shines, along the line and across it: δΘ, cosΘ δφ [rad]."""
        return self.travel_theta, dr.cos(self.theta) * self.travel_phi

    def take(self, index: UInt32) -> Shots:
        """Return some shots, by their indices."""
        angles = (self.theta, self.phi, self.travel_theta, self.travel_phi, self.synchronisation)
        theta, phi, travel_theta, travel_phi, synchronisation = (
            dr.gather(mi.Float, values, index) for values in angles
        )
        number = dr.gather(mi.UInt32, self.number, index)
        poses = None if self.poses is None else take_poses(self.poses, index)
        even, seeds = self.even_travel, None if self.seeds is None else self.seeds.take(index)
        told = None if self.commanded is None else dr.gather(mi.Float, self.commanded, index)
        departed = None if self.departures is None else self.departures.take(index)
        return Shots(
            number, theta, phi, travel_theta, travel_phi, synchronisation, poses, even, seeds, told, departed
        )


@dataclass(frozen=True)
class Pointing:
    """By how much the true deflections of n shots differ from the commanded ones [rad], shape (n,), float64.

    ``theta`` and ``phi`` are the whole differences, ``seen_theta`` and ``seen_phi`` the part that the encoders read.
    """

    theta: Array
    phi: Array
    seen_theta: Array
    seen_phi: Array


def true_shots(
    aim: Aim,
    mirrors: Mirrors,
    seed: int | RunSeeds,
    duty_cycle: float = 1.0,
    poses: tuple[Pose, ...] | None = None,
    built: BuiltInstrument | None = None,
) -> tuple[Shots, Pointing]:
    """Return the shots of an aim as they are fired.

    Parameters
    ----------
    aim
        The n commanded shots.
    mirrors
        The mirrors and their errors.
    seed
        Seed of the errors, or those of several runs' shots.
    duty_cycle
        Share of the dwell in which the laser shines; it is centred on the aim's time.
    poses
        Of the moving objects at the aim's times, from
        :meth:`~scanner_sim.scene.files.loader.LoadedScene.poses_at`.
    built
        The instrument as built; None is built as designed.

    Returns
    -------
    Shots, Pointing
        The shots, and their errors. Jitter and synchronisation error are independent normal numbers for each axis and
        shot; wobble is :func:`wobble`; the rest is :func:`~scanner_sim.optics.built_instrument.still_errors`.
    """
    number = mi.UInt32(for_device(aim.shot, np.uint32))
    lattices, seeds = lattices_of(aim, mirrors), seed if isinstance(seed, RunSeeds) else None
    own = seed if seeds is None else seeds.lanes
    random, shaft, synchronisation = draw_errors(number, lattices, mirrors, own)
    dr.eval(number, random, shaft, synchronisation)
    still = still_errors(mirrors, built, aim.theta, aim.phi, aim.time)
    errors = [np.asarray(random[axis].numpy(), dtype=np.float64) + still[axis] for axis in (0, 1)]
    shots = Shots(
        number,
        _to_float(aim.theta + errors[0]),
        _to_float(aim.phi + errors[1]),
        _to_float(duty_cycle * aim.travel_theta),
        _to_float(duty_cycle * aim.travel_phi),
        synchronisation,
        poses,
        float(aim.travel_theta[0]) if not np.ptp(aim.travel_theta) and not aim.travel_phi.any() else None,
        seeds,
        _to_float(aim.theta),
        None if built is None else departures_of(built, aim, number, own),
    )
    encoders = [np.asarray(part.numpy(), dtype=np.float64) for part in shaft]
    return shots, Pointing(errors[0], errors[1], encoders[0], encoders[1])


def departures_of(built: BuiltInstrument, aim: Aim, number: UInt32, seed: Seed) -> ShotDepartures:
    """Return what of an instrument as built differs between the shots of an aim."""
    known = None if built.is_steady else built.unsteadiness(aim.time)
    return ShotDepartures.made(known, built, number, seed)


def draw_errors(
    number: UInt32, lattices: list[Lattice], mirrors: Mirrors, seed: Seed
) -> tuple[list[Float], list[Float], Float]:
    """Return the random errors of shots: true deflections, what of them the encoders see, and the synchronisation.

    Parameters
    ----------
    number
        Numbers of the n shots, Dr.Jit.
    lattices
        Where both mirrors stand in their wobble (:func:`lattices_of`); none where nothing wobbles.
    mirrors, seed
        Size of the errors, and seed.

    Returns
    -------
    tuple
        Errors along Θ and φ [rad], their parts that the encoders read, and by how much the receiver looks past the
        laser; Dr.Jit, shape (n,).
    """
    normal = generator(seed, Stream.MIRRORS, number, mi.UInt32(0)).next_float32x4_normal()
    other = generator(seed, Stream.SYNCHRONISATION, number, mi.UInt32(0)).next_float32x4_normal()
    unseen = dr.opaque(mi.Float, mirrors.jitter * (1.0 - mirrors.jitter_seen) ** 0.5)
    seen = dr.opaque(mi.Float, mirrors.jitter * mirrors.jitter_seen**0.5)
    shaft = [seen * normal[axis + 2] for axis in (0, 1)]
    random = [unseen * normal[axis] + shaft[axis] for axis in (0, 1)]
    for mirror, lattice in enumerate(lattices):
        # The first mirror's wobble is across its own motion, along φ, and the second's along Θ.
        random[1 - mirror] += wobble(lattice, mirrors, seed, mirror)
    return random, shaft, dr.opaque(mi.Float, mirrors.synchronisation) * other[0]


@dataclass
class Lattice:
    """Where a mirror stands in the lattice of its wobble, Dr.Jit arrays of shape (n,).

    ``angle`` and ``moment`` are the cells of deflection and time, ``angle_part`` and ``moment_part`` the positions in
    them, 0 to 1.
    """

    angle: UInt32
    angle_part: Float
    moment: UInt32
    moment_part: Float

    @classmethod
    def of(cls, deflection: Array, time: Array, mirrors: Mirrors) -> Lattice:
        """Return the positions of a mirror at deflections [rad] and times since the start [s], shape (n,)."""
        columns: list[Any] = []
        for values, spacing in ((deflection, mirrors.wobble_angle), (time, mirrors.wobble_time)):
            cell, part = lattice_position(values, spacing)
            columns += [mi.UInt32(for_device(cell, np.uint32)), _to_float(part)]
        return cls(*columns)


def lattice_position(values: Array, spacing: float) -> tuple[NDArray[np.uint32], Array]:
    """Return the cells of a lattice in which values lie, and their positions in them, 0 to 1."""
    at = values / spacing
    cell = np.floor(at)
    # Cells below 0 wrap round: 2³² of them are enough for any.
    return cell.astype(np.int64).astype(np.uint32), at - cell


def lattices_of(aim: Aim, mirrors: Mirrors) -> list[Lattice]:
    """Return the lattices of both mirrors, or none where they do not wobble."""
    if mirrors.wobble <= 0.0:
        return []
    return [Lattice.of(angle, aim.time, mirrors) for angle in (aim.theta, aim.phi)]


def wobble(lattice: Lattice, mirrors: Mirrors, seed: Seed, mirror: int) -> Float:
    """Return the cross-axis error of a mirror [rad], a Dr.Jit array of shape (n,).

    Independent normal numbers stand on a lattice over the mirror's deflection (spacing ``wobble_angle``) and time
    (``wobble_time``). Between four of them the weights' squares add up to 1, so that the error has the same standard
    deviation everywhere; it is continuous with its first derivative, and what lies two cells apart is independent.
    A motion that is repeated soon meets the same error (it is *synchronous* with the motion), which is how the wobble
    of bearings behaves. The correlation's shape is an assumption.

    Parameters
    ----------
    lattice
        The mirror's position in it.
    mirrors
        Size of the wobble.
    seed, mirror
        Address of the random numbers; mirror 0 deflects by Θ, mirror 1 by φ.
    """
    nodes = []
    for first, part in ((lattice.angle, lattice.angle_part), (lattice.moment, lattice.moment_part)):
        step = 0.5 * dr.pi * dr.square(part) * (3.0 - 2.0 * part)
        sine, cosine = dr.sincos(step)
        nodes.append(((first, cosine), (first + 1, sine)))
    total = mi.Float(0.0)
    for angle, by_angle in nodes[0]:
        for moment, by_time in nodes[1]:
            drawn = generator(seed, Stream.WOBBLE, moment, angle).next_float32x4_normal()
            total += by_angle * by_time * drawn[mirror]
    return dr.opaque(mi.Float, mirrors.wobble) * total


def _to_float(values: Array) -> Float:
    return mi.Float(for_device(values))
