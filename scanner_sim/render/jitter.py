"""Where the mirrors really point: the commanded deflections with their jitter."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from scanner_sim.scan.raster import Aim
from scanner_sim.streams import Stream, generator


def true_deflections(aim: Aim, jitter: float, seed: int) -> tuple[Any, Any]:
    """Return the true Θ and φ [rad] of the shots of an aim, as Dr.Jit arrays of shape (n,).

    Each axis and shot has an independent normal error of standard deviation ``jitter`` [rad], common to laser
    and receiver, which share the mirrors.
    """
    normal = generator(seed, Stream.MIRRORS, mi.UInt32(aim.shot), mi.UInt32(0)).next_float32x4_normal()
    spread = dr.opaque(mi.Float, jitter)
    theta = mi.Float(aim.theta.astype(np.float32)) + spread * normal[0]
    phi = mi.Float(aim.phi.astype(np.float32)) + spread * normal[1]
    dr.eval(theta, phi)
    return theta, phi
