"""How far the charge of each pixel moves a spot's position: the estimators' own derivatives, on lines without noise.

Estimators that weigh pixels alike whatever their noise move by ∂p/∂q_i = N⁻¹ D_i for a spot of N electrons, and D_i
depends on where in its pixel the spot lies, and on its width, alone. ``maximum_likelihood`` weighs by the noise, and
has no such table.
"""

from __future__ import annotations

from functools import lru_cache

import drjit.auto.ad as auto
import numpy as np
from numpy.typing import NDArray

from scanner_sim.signals.line.bias import SpotTemplate
from scanner_sim.signals.line.digital_line import no_baseline
from scanner_sim.signals.line.estimators import CLOSED_FORMS
from scanner_sim.signals.processing import PeakMethod

Array = NDArray[np.float64]

_PLACES = 16
PLACES = (np.arange(_PLACES) + 0.5) / _PLACES - 0.5
"""Places of a spot from the centre of its brightest pixel, evenly over that pixel [pixel]."""
_WIDTHS = np.linspace(0.3, 12.0, 235)
"""Standard deviations of spots in the table [pixel]; between them it is linear."""


def sensitivity(method: PeakMethod, width: Array, pixels: NDArray[np.int64]) -> Array:
    """Return D_i, derivatives of a position by the charges of pixels relative to the spot's [pixel].

    The estimator runs on the device that is active when a table is first asked for; it is kept in NumPy's memory.

    Parameters
    ----------
    method
        One of :data:`~scanner_sim.signals.line.estimators.CLOSED_FORMS`.
    width
        Standard deviations of spots without the pixel's width [pixel], shape (n,).
    pixels
        Pixels, counted from the brightest one, shape (m,).

    Returns
    -------
    ndarray
        At all :data:`PLACES`, shape (n, 16, m); 0 where the estimator does not look.
    """
    steps, table = _table(method)
    first, last = _WIDTHS[0], _WIDTHS[-1]
    node = (np.clip(width, first, last) - first) * ((len(_WIDTHS) - 1) / (last - first))
    below = np.minimum(node.astype(np.int64), len(_WIDTHS) - 2)
    above = (node - below)[:, None, None]
    found = np.zeros((len(width), _PLACES, len(pixels)))
    found[:, :, np.searchsorted(pixels, steps)] = (1.0 - above) * table[below] + above * table[below + 1]
    return found


@lru_cache(maxsize=16)
def _table(method: PeakMethod) -> tuple[NDArray[np.int64], Array]:
    """Return the steps at which an estimator looks, (s,), and D there for all widths and places, (235, 16, s)."""
    width = np.repeat(_WIDTHS, _PLACES)
    place = auto.Float(np.tile(PLACES, len(_WIDTHS)).astype(np.float32))
    spots = SpotTemplate(place, auto.Float(width.astype(np.float32)), no_baseline())
    _, slopes = CLOSED_FORMS[method](spots)
    steps = sorted(slopes)
    columns = [np.broadcast_to(slopes[step].numpy(), width.shape).astype(np.float64) for step in steps]
    table = spots.charge * np.stack(columns, axis=-1)
    return np.array(steps), table.reshape(len(_WIDTHS), _PLACES, len(steps))
