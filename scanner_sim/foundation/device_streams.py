"""Random numbers on the device by the addresses of :mod:`scanner_sim.foundation.streams`.

Philox 4x32 with seven rounds, the fewest that pass every test of randomness (Salmon et al., SC 2011), as Dr.Jit
provides it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from numpy.typing import ArrayLike

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_types import Float, UInt32, UInt64
from scanner_sim.foundation.streams import Seed, Stream

_ROUNDS = 7


def generator(seed: Seed, stream: Stream, shot: UInt32, sample: UInt32) -> Any:
    """Return the generator at an address; each of its calls gives four numbers.

    Parameters
    ----------
    seed
        One for all lanes, or one for each: a lane's numbers depend on its own seed alone, given either way.
    stream
        The consumer.
    shot, sample
        Dr.Jit 32-bit unsigned arrays (any broadcastable shapes, a seed's too): number of the shot, and which of its
        samples.

    Returns
    -------
    drjit.auto.Philox4x32
    """
    key = seed if dr.is_array_v(seed) else _on_device(seed)
    return auto.Philox4x32(key, shot, sample, auto.UInt32(int(stream)), _ROUNDS)


@dataclass
class RunSeeds:
    """Seeds of runs whose lanes go side by side, as many of each: Dr.Jit arrays.

    ``each`` are the seeds, shape (runs,), and ``run`` is which of them each lane has, shape (n,). ``powers`` of their
    lasers [W], where these differ.
    """

    each: UInt64
    run: UInt32
    powers: tuple[float, ...] | None = None

    @classmethod
    def of(cls, each: UInt64, lanes: int, powers: tuple[float, ...] | None = None) -> RunSeeds:
        """Return the seeds of so many lanes, one run after the other."""
        own = dr.opaque(auto.UInt32, lanes // dr.width(each))
        return cls(each, dr.arange(auto.UInt32, lanes) // own, powers)

    def take(self, index: UInt32) -> RunSeeds:
        """Return the seeds of some lanes, by their indices."""
        return RunSeeds(self.each, dr.gather(auto.UInt32, self.run, index), self.powers)

    @property
    def lanes(self) -> Seed:
        """The seed of each lane."""
        return dr.gather(auto.UInt64, self.each, self.run)

    def spread(self, values: ArrayLike) -> Float:
        """Return values of the runs, shape (runs,), as those of each lane, single precision."""
        return dr.gather(auto.Float, auto.Float(for_device(values)), self.run)


def device_seeds(seeds: ArrayLike) -> UInt64:
    """Return seeds as a Dr.Jit array."""
    return auto.UInt64(for_device(seeds, np.uint64))


def _on_device(seed: int) -> UInt64:
    """Return a seed as a Dr.Jit number that no kernel knows: the same one for all who ask, if nothing is recorded."""
    if dr.flag(dr.JitFlag.FreezingScope):
        return dr.opaque(auto.UInt64, seed)
    return _held(auto.UInt64, seed)


@lru_cache(maxsize=4)
def _held(kind: Any, seed: int) -> UInt64:
    return dr.opaque(kind, seed)
