"""A layer as it is drawn: its scale of colours, and why there is nothing where there is nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from textwrap import shorten
from typing import Any

import numpy as np
from matplotlib.colorbar import Colorbar
from matplotlib.colors import FuncNorm, LogNorm, Normalize
from matplotlib.patches import Patch
from matplotlib.ticker import EngFormatter, FixedLocator, LogLocator, ScalarFormatter
from numpy.typing import NDArray

from scanner_sim.foundation.status import Status
from scanner_sim.products.pictures.style import FAINT, STATUS_COLOUR

_ROUND = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 45.0, 90.0)
"""Numbers of a scale that is compressed towards its ends."""
_LETTERS = 0.05
"""Share of a colour bar that a number takes."""


@dataclass(frozen=True)
class Layer:
    """What is drawn: values of shape (rows, columns), NaN where there are none, and their scale to [0, 1]."""

    values: NDArray[np.floating]
    norm: Normalize

    @property
    def extend(self) -> str:
        """At which ends of the scale there are values beyond it."""
        low, high = (float(end) for end in (self.norm.vmin or 0.0, self.norm.vmax or 0.0))
        below, above = bool((self.values < low).any()), bool((self.values > high).any())
        return "both" if below and above else "min" if below else "max" if above else "neither"


def linear(values: NDArray[np.float32]) -> Layer:
    """Return a layer on an even scale, which leaves out the outermost half per cent at either end."""
    return Layer(values, Normalize(*_spread(values, 0.5, 99.5, least=1e-3)))


def logarithmic(values: NDArray[np.float32], dark: float | None) -> Layer:
    """Return a layer on a logarithmic scale that spans the bulk of its values, a factor of 1.5 at least.

    Without ``dark``, what is not above 0 is no value; with it, what is below is as dark as the scale is at its end.
    """
    if dark is None:
        values = scaled_by = np.where(values > 0.0, values, np.float32(np.nan))
    else:
        values = np.maximum(np.nan_to_num(values), np.float32(1e-3 * dark))
        scaled_by = values[values >= dark]
    low, high = _spread(scaled_by, 0.5, 99.8, least=0.0)
    return Layer(values, LogNorm(*((low, high) if high > 1.5 * low else (low / 1.5, high * 1.5))))


def causes_of(found: NDArray[np.float32], empty: NDArray[np.bool_]) -> dict[Status, NDArray[np.bool_]]:
    """Return where each status is the cause of an empty voxel, shape (rows, columns), for those that occur."""
    where = {status: empty & (found == status) for status in Status}
    return {status: mask for status, mask in where.items() if mask.any()}


def patches_of(
    causes: Mapping[Status, NDArray[np.bool_]], longest: int, in_spite: str = "no neighbour to compare with"
) -> list[Patch]:
    """Return a patch for each cause with its share and its sentence, of at most ``longest`` letters.

    ``in_spite`` is that of voxels which have a range and no value.
    """
    patches = []
    for status, where in causes.items():
        sentence = in_spite if status is Status.VALID else status.sentence
        text = shorten(f"{_per_cent(where)}: {sentence}", longest)
        colour = STATUS_COLOUR.get(status, FAINT)
        patches.append(Patch(facecolor=colour, edgecolor=FAINT, linewidth=0.3, label=text))
    return patches


def thin_outline(bar: Colorbar) -> None:
    """Draw the frame of a colour bar as thin as others."""
    outline: Any = bar.outline  # Matplotlib 3.10 takes it for several lines.
    outline.set_linewidth(0.6)


def label_bar(bar: Colorbar, norm: Normalize, label: str) -> None:
    """Give a colour bar its label, and numbers that fit its scale."""
    thin_outline(bar)
    bar.set_label(label)
    bar.formatter = ScalarFormatter(useOffset=False)
    if isinstance(norm, LogNorm):
        decades = np.log10(float(norm.vmax or 1.0) / float(norm.vmin or 1.0))
        bar.locator = LogLocator(subs=(1.0, 2.0, 5.0) if decades < 4.0 else (1.0,))
        bar.formatter = EngFormatter()
        bar.minorticks_off()
    elif isinstance(norm, FuncNorm):
        bar.locator = FixedLocator(_apart(norm))


def _apart(norm: FuncNorm) -> list[float]:
    """Return round numbers of a scale that is even about zero, of which no two stand on one another."""
    kept = [0.0]
    for number in _ROUND:
        if number <= float(norm.vmax or 0.0) and float(norm(number)) - float(norm(kept[-1])) >= _LETTERS:
            kept.append(number)
    return [-number for number in reversed(kept[1:])] + kept


def _per_cent(where: NDArray[np.bool_]) -> str:
    """Return the share of voxels in words that neither round to nothing nor to everything."""
    share = 100.0 * float(where.mean())
    if where.all():
        return "100 %"
    return (
        "below 0.01 %" if share < 0.01 else f"{share:.2g} %" if share < 10.0 else f"{min(share, 99.9):.1f} %"
    )


def step_of(angles: NDArray[np.float64]) -> float:
    """Return the step between angles [rad]; a single one counts as a milliradian wide."""
    return float(angles[-1] - angles[0]) / (angles.size - 1) if angles.size > 1 else 1e-3


def _spread(values: NDArray[np.floating], low: float, high: float, least: float) -> tuple[float, float]:
    """Return two percentiles of the finite values, at least ``least`` apart; (0.1, 1) where there are none."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.1, 1.0
    first, last = (float(value) for value in np.percentile(finite, (low, high)))
    short = max(least - (last - first), 0.0) / 2.0
    return first - short, last + short
