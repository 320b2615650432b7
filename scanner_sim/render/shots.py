"""Where the mirrors really point: the commanded deflections with their jitter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from scanner_sim.scan.raster import Aim
from scanner_sim.streams import Stream, generator


@dataclass
class Shots:
    """Shots as they are fired, Dr.Jit arrays of shape (n,).

    ``number`` of each shot (it addresses random numbers), true deflections ``theta`` and ``phi`` [rad].
    """

    number: Any
    theta: Any
    phi: Any

    def some(self, index: Any) -> Shots:
        """Return the shots at some places."""
        return Shots(
            dr.gather(mi.UInt32, self.number, index),
            dr.gather(mi.Float, self.theta, index),
            dr.gather(mi.Float, self.phi, index),
        )


def true_shots(aim: Aim, jitter: float, seed: int) -> Shots:
    """Return the shots of an aim with the mirrors' errors.

    Each axis and shot has an independent normal error of standard deviation ``jitter`` [rad], common to laser
    and receiver, which share the mirrors.
    """
    number = mi.UInt32(aim.shot)
    normal = generator(seed, Stream.MIRRORS, number, mi.UInt32(0)).next_float32x4_normal()
    spread = dr.opaque(mi.Float, jitter)
    theta = mi.Float(aim.theta.astype(np.float32)) + spread * normal[0]
    phi = mi.Float(aim.phi.astype(np.float32)) + spread * normal[1]
    dr.eval(number, theta, phi)
    return Shots(number, theta, phi)
