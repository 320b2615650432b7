"""The angle encoders of the two mirrors: the deflections that ranging takes."""

from __future__ import annotations

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_streams import device_seeds, generator
from scanner_sim.foundation.device_types import Float, UInt32, Vector4f
from scanner_sim.foundation.streams import Seed, Stream
from scanner_sim.optics.deflection import Mirrors
from scanner_sim.render.shots import draw_errors

Array = NDArray[np.float64]


def read_encoders(
    shot: NDArray[np.uint32], theta: Array, phi: Array, mirrors: Mirrors, seed: Seed
) -> tuple[Array, Array]:
    """Return what the encoders of both mirrors read in the middle of each dwell [rad], each of shape (n,).

    Parameters
    ----------
    shot
        Number of each shot, shape (n,); it addresses the noise.
    theta, phi
        Deflections of the shafts [rad], shape (n,): the commanded ones with the jitter that encoders see.
    mirrors
        The encoders' noise and step.
    seed
        Seed of the noise: one, or one for each shot.

    Returns
    -------
    theta, phi
        Shaft plus normal noise, rounded to the step. What encoders do not see, the rest of the jitter, the other
        mirror's wobble and the drift of their own zero and scale, is in the true deflections only
        (:func:`scanner_sim.render.shots.true_shots`), and in the standard deviation of the reading.

    Notes
    -----
    Not modelled: non-linearity that stays (it belongs to the calibration), delay of the reading.
    """
    drawn = reading_normals(auto.UInt32(for_device(shot, np.uint32)), seed)
    dr.eval(drawn)
    return readings(theta, phi, drawn[0].numpy(), drawn[1].numpy(), mirrors)


def reading_normals(shot: UInt32, seed: Seed) -> tuple[Float, Float]:
    """Return the standard normal numbers of both encoders' noise for shots by number, Dr.Jit, shape (n,)."""
    drawn: Vector4f = generator(seed, Stream.READOUT, shot, auto.UInt32(0)).next_float32x4_normal()
    return drawn[0], drawn[1]


def readings(
    theta: Array,
    phi: Array,
    normal_theta: NDArray[np.float32],
    normal_phi: NDArray[np.float32],
    mirrors: Mirrors,
) -> tuple[Array, Array]:
    """Return what encoders read at deflections of the shafts [rad] with noise of given standard normal numbers."""
    read = [
        angle + np.asarray(normal, dtype=np.float64) * mirrors.readout_noise
        for angle, normal in ((theta, normal_theta), (phi, normal_phi))
    ]
    if mirrors.readout_step > 0.0:
        read = [np.rint(angle / mirrors.readout_step) * mirrors.readout_step for angle in read]
    return read[0], read[1]


def reading_noise(
    shot: NDArray[np.uint32], mirrors: Mirrors, seed: NDArray[np.uint64]
) -> tuple[Array, Array]:
    """Return by how much encoders that round nothing read more than the angle of their latching [rad], each (n,).

    The jitter that they see and their noise, which depend on the shots' numbers and seeds alone, each (n,):
    :func:`read_encoders` without the angles.
    """
    number, own = auto.UInt32(for_device(shot, np.uint32)), device_seeds(seed)
    seen = draw_errors(number, [], mirrors, own)[1]
    drawn = reading_normals(number, own)
    dr.eval(seen, drawn)
    theta, phi = (
        np.asarray(jitter.numpy(), dtype=np.float64)
        + np.asarray(normal.numpy(), dtype=np.float64) * mirrors.readout_noise
        for jitter, normal in zip(seen, drawn, strict=True)
    )
    return theta, phi
