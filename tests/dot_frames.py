"""Frames of dots made by the judge, which adds up areas, for tests of what finds them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic.dots import DotScene, dot_image
from scanner_sim.signals.dots.settings import FrameCalibration

BLUR, GAIN, READ, BLACK = 0.6, 40.0, 25.0, 10.0
CALIBRATION = FrameCalibration(BLACK, GAIN, READ, 1020.0, BLUR)


def scene(diameter: float, tilt: float, angle: float, u: float, v: float) -> DotScene:
    """Return a dot under a tilt, on white of 180 DN with a slope."""
    a = 0.5 * diameter
    noise = np.hypot(READ, GAIN / np.sqrt(12.0))
    return DotScene(u, v, a, a * np.cos(tilt), angle, BLUR, 180.0 * GAIN, 9.0, -5.0, 0.92, float(noise))


def tiled(
    scenes: Sequence[DotScene], half: int, rng: np.random.Generator | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a frame of dots side by side, with noise from ``rng`` or without any, and their centres."""
    side, across = 2 * half + 1, int(np.ceil(np.sqrt(len(scenes))))
    white = scenes[0].light
    electrons = np.full((side * across, side * across), white)
    centres = np.empty((len(scenes), 2))
    for number, one in enumerate(scenes):
        row, column = divmod(number, across)
        electrons[row * side : (row + 1) * side, column * side : (column + 1) * side] = dot_image(one, half)
        centres[number] = column * side + half + one.u, row * side + half + one.v
    if rng is None:
        return electrons / GAIN + BLACK, centres
    charge = rng.poisson(electrons) + rng.normal(0.0, READ, electrons.shape)
    return np.rint(charge / GAIN + BLACK), centres


def drawn(count: int, diameters: tuple[float, float], rng: np.random.Generator) -> list[DotScene]:
    """Return so many different dots [pixel], tilts to 60°, any angle and any place in a pixel."""
    return [
        scene(
            float(rng.uniform(*diameters)),
            float(rng.uniform(0.0, np.radians(60.0))),
            float(rng.uniform(0.0, np.pi)),
            *(float(x) for x in rng.uniform(-0.5, 0.5, 2)),
        )
        for _ in range(count)
    ]
