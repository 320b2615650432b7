"""The picture of an estimator's systematic error: over the pixel, and as far as a table takes it away."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from scanner_sim.products.pictures.style import FAINT, drawing

_SHOWN = 4
_MAP, _FROM, _TO = "viridis", 0.0, 0.85

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BiasCurve:
    """One passage of the spot over a pixel: a label, true phases [pixel], errors and what is left of them [pixel]."""

    label: str
    phase: Floats
    bias: Floats
    left: Floats


def draw_bias(estimator: str, curves: Sequence[BiasCurve], path: str | Path) -> None:
    """Draw errors against the sub-pixel phase for a few widths of the spot, and below them what is left.

    Parameters
    ----------
    estimator
        Name of the estimator.
    curves
        Passages by ascending width; a few of them, evenly chosen, are drawn.
    path
        The PNG to write.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    chosen = sorted({round(position) for position in np.linspace(0, len(curves) - 1, _SHOWN)})
    with drawing(path, (6.4, 4.6), layout="constrained") as figure:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
        for number, colour in zip(chosen, np.linspace(_FROM, _TO, len(chosen)), strict=True):
            curve, tint = curves[number], colormaps[_MAP](colour)
            upper.plot(curve.phase, 1e3 * curve.bias, "-o", ms=2.2, lw=0.9, color=tint, label=curve.label)
            lower.plot(curve.phase, 1e3 * curve.left, "-o", ms=2.2, lw=0.9, color=tint)
        for axes in (upper, lower):
            axes.axhline(0.0, color=FAINT, lw=0.6, zorder=0)
            axes.spines[["top", "right"]].set_visible(False)
        upper.set_ylabel("estimate − truth [10⁻³ pixel]")
        lower.set_ylabel("left by the\ncomputed table")
        lower.set(xlabel="true place of the spot within its brightest pixel [pixel]", xlim=(-0.5, 0.5))
        upper.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        upper.set_title(
            f"Systematic error of the estimator {estimator.replace('_', ' ')}",
            loc="left",
            weight="bold",
            size=10.5,
        )
