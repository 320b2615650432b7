"""Pictures of a campaign's report: how a measure is distributed, and how it depends on each key."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import BinaryIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import EngFormatter, MaxNLocator
from numpy.typing import NDArray

from scanner_sim.campaign.dependence import Dependence
from scanner_sim.products.pictures.style import FAINT, drawing, plot_label, ruled

ALIVE, DEAD, BARS = "#2b6f8f", "#9aa3ab", "#c9d6de"
"""Colours of means of a key that does something, of one that does not, and of the histogram."""
_ACROSS = 4
"""Panels side by side."""


def draw_measure(
    path: BinaryIO,
    name: str,
    unit: str,
    values: NDArray[np.float64],
    dependences: Sequence[Dependence],
    units: Mapping[str, str],
) -> None:
    """Draw the histogram of a measure, and its means with 95 % intervals over the values of each key."""
    shown = [one for one in dependences if len(one.at)]
    panels = 1 + len(shown)
    down = math.ceil(panels / _ACROSS)
    label = _labelled(name, unit)
    with drawing(
        path, (2.15 * min(panels, _ACROSS) + 0.4, 2.0 * down), dpi=130, layout="constrained"
    ) as figure:
        every = list(figure.subplots(down, min(panels, _ACROSS), squeeze=False).flat)
        _histogram(every[0], label, unit, values)
        for axes, one in zip(every[1:], shown, strict=False):
            _means(axes, label, unit, one, units)
        for axes in every[panels:]:
            axes.set_visible(False)


def _histogram(axes: Axes, label: str, unit: str, values: NDArray[np.float64]) -> None:
    bins = max(5, min(40, round(math.sqrt(len(values)))))
    axes.hist(values, bins=bins, color=BARS, edgecolor="white", lw=0.4)
    axes.axvline(float(np.median(values)), color=FAINT, lw=0.8, ls="--")
    axes.set(xlabel=plot_label(label), ylabel="runs")
    axes.xaxis.set_major_locator(MaxNLocator(3))
    _prefixed(axes, unit, "1")
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
    ruled(axes)


def _means(axes: Axes, label: str, unit: str, one: Dependence, units: Mapping[str, str]) -> None:
    colour = DEAD if one.dead else ALIVE
    axes.errorbar(one.at, one.mean, 1.96 * one.error, fmt="o-", color=colour, ms=3, lw=0.9, elinewidth=0.7)
    short = one.key if len(one.key) <= 34 else "…" + one.key[-33:]
    axes.set_xlabel(plot_label(_labelled(short, units.get(one.key, "1"))), size=6.5)
    axes.set_ylabel(plot_label(label))
    axes.set_title("dead" if one.dead else "", size=7.5, color=FAINT, loc="right", pad=2)
    axes.xaxis.set_major_locator(MaxNLocator(4))
    axes.yaxis.set_major_locator(MaxNLocator(4))
    _prefixed(axes, units.get(one.key, "1"), unit)
    ruled(axes)


def _prefixed(axes: Axes, across: str, up: str) -> None:
    """Write very small and very large numbers with a prefix and the unit: a factor at an axis' end is easily missed."""
    for axis, ends, unit in ((axes.xaxis, axes.get_xlim(), across), (axes.yaxis, axes.get_ylim(), up)):
        if not 1e-2 <= max(map(abs, ends)) < 1e4:
            axis.set_major_formatter(EngFormatter(unit=unit.removesuffix("1")))


def _labelled(name: str, unit: str) -> str:
    return name if unit == "1" else f"{name} [{unit}]"
