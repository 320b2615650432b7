"""What of an instrument as built differs from shot to shot, on the device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_streams import generator
from scanner_sim.foundation.device_types import Float, UInt32, Vector3f
from scanner_sim.foundation.streams import Seed, Stream
from scanner_sim.optics.built_instrument import BuiltInstrument, Unsteadiness
from scanner_sim.optics.deflection import Frame

COLUMNS = 8
"""Columns of :attr:`~scanner_sim.optics.built_instrument.Unsteadiness.columns`."""


@dataclass
class ShotDepartures:
    """Departures of n shots, Dr.Jit arrays of shape (n,), each list three of them; None is none.

    ``base`` by which it is longer [m], ``focus`` by which the image distance is, relative; ``turn`` [rad] and ``shift``
    [m] of the scanner; ``power`` and ``pulse`` of the laser, over their means.
    """

    base: Float = None
    focus: Float = None
    turn: list[Float] | None = None
    shift: list[Float] | None = None
    power: Float = None
    pulse: Float = None

    @classmethod
    def of(cls, columns: Sequence[Float]) -> ShotDepartures:
        """Return those of columns as :class:`~scanner_sim.optics.built_instrument.Unsteadiness` has them."""
        return cls(columns[0], columns[1], list(columns[2:5]), list(columns[5:8]))

    @classmethod
    def made(
        cls, unsteadiness: Unsteadiness | None, built: BuiltInstrument, number: UInt32, seed: Seed
    ) -> ShotDepartures:
        """Return the departures of shots by number, from what is known of each beforehand and what is drawn."""
        columns = [] if unsteadiness is None else unsteadiness.columns
        known = [mi.Float(for_device(column, np.float32)) for column in columns]
        found = cls.of(known) if known else cls()
        return found.with_noise(built, number, seed)

    def with_noise(self, built: BuiltInstrument, number: UInt32, seed: Seed) -> ShotDepartures:
        """Return the same with the noise of the laser's power, drawn for shots by number."""
        noise = built.own.power_noise or 0.0, built.own.pulse_noise or 0.0
        if noise == (0.0, 0.0):
            return self
        normal = generator(seed, Stream.POWER, number, mi.UInt32(0)).next_float32x4_normal()
        # A power is not negative: with 30 % of noise one shot in two thousand would be.
        self.power, self.pulse = (
            dr.maximum(1.0 + dr.opaque(mi.Float, sigma) * normal[lane], 0.0)
            for lane, sigma in enumerate(noise)
        )
        return self

    def take(self, index: UInt32) -> ShotDepartures:
        """Return some of them, by their indices."""

        def taken(values: Float) -> Float:
            return None if values is None else dr.gather(mi.Float, values, index)

        def three(parts: list[Float] | None) -> list[Float] | None:
            return None if parts is None else [dr.gather(mi.Float, part, index) for part in parts]

        return ShotDepartures(
            taken(self.base),
            taken(self.focus),
            three(self.turn),
            three(self.shift),
            taken(self.power),
            taken(self.pulse),
        )

    def moved(self, frame: Frame) -> Frame:
        """Return deflected optics, Dr.Jit vectors, as the platform's shaking leaves them."""
        if self.turn is None or self.shift is None:
            return frame
        turn, shift = mi.Vector3f(*self.turn), mi.Vector3f(*self.shift)

        def turned(vector: Vector3f) -> Vector3f:
            # To the second order in the turn: what is left out is 1e-9 m of 10 m and a milliradian.
            once = dr.cross(turn, vector)
            return vector + once + 0.5 * dr.cross(turn, once)

        axes = (turned(mi.Vector3f(axis)) for axis in (frame.along, frame.across, frame.normal))
        points = (turned(mi.Vector3f(point)) + shift for point in (frame.laser, frame.lens))
        return Frame(*axes, *points)
