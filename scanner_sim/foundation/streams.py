"""Random numbers by address: (seed, stream, shot, sample) names each number.

Every consumer draws from a stream of its own, and a number depends on its address alone, so a result never
depends on batches, threads, order or the number of processes. The generator is Philox 4x32 (Salmon, Moraes, Dror, Shaw,
*Parallel random numbers: as easy as 1, 2, 3*, SC 2011); numbers on the device are those of
:mod:`scanner_sim.foundation.device_streams`.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, TypeAlias

import numpy as np

Seed: TypeAlias = Any
"""Seed of a scenario, a number from 0 to 2⁶⁴ − 1; or one for each lane, a Dr.Jit array of 64-bit unsigned numbers."""


class Stream(IntEnum):
    """The consumers of random numbers. A value is part of every result: never renumber."""

    MIRRORS = 1
    DETECTOR = 2
    RESPONSE = 3
    BOUNCES = 4
    REFERENCE = 5
    BACKGROUND = 6
    SPECKLE = 7
    SYNCHRONISATION = 8
    AMBIENT = 9
    PHOTODIODE = 10
    CLOCK = 11
    READOUT = 13
    WOBBLE = 14
    BUILT = 20
    VIBRATION = 21
    POWER = 22
    POSES = 40
    SURVEY = 41
    ACCEPTANCE = 42
    FRAME_LIGHT = 50
    FRAME_STRATA = 51
    FRAME_NOISE = 52
    FRAME_PATTERN = 53


def host_generator(seed: int, stream: Stream, number: int) -> np.random.Generator:
    """Return the host's generator at an address, for draws that are no part of the light's way.

    NumPy's Philox 4x64 with seed and stream as its key; ``number`` counts the draws of the consumer, each of which may
    take up to 2¹⁹² numbers.
    """
    return np.random.Generator(np.random.Philox(key=(seed << 64) | int(stream), counter=number << 192))
