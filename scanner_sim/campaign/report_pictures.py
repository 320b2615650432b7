"""Pictures of a campaign: how a measure is distributed, how it depends on each key, and what Sobol's indices it has."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import BinaryIO

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator
from numpy.typing import NDArray

from scanner_sim.campaign.dependence import Dependence
from scanner_sim.products.pictures.style import FAINT, drawing, plot_label, ruled

ALIVE, DEAD, BARS = "#2b6f8f", "#9aa3ab", "#c9d6de"
"""Colours of means of a key that does something, of one that does not, and of the histogram."""
DOTS = "#d98e4a"
"""Colour of single runs, and of what a key makes together with others."""
_ACROSS = 4
"""Panels side by side."""
MOST_PANELS = 6
"""Values of other axes for which indices are drawn; of more, the first."""


def draw_measure(
    path: BinaryIO,
    name: str,
    unit: str,
    values: NDArray[np.float64],
    dependences: Sequence[Dependence],
    units: Mapping[str, str],
) -> None:
    """Draw the histogram of a measure, and over each key its means with 95 % intervals; drawn points behind them."""
    shown = [one for one in dependences if len(one.at) or one.points.size]
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
    axes.plot(*one.points, ".", color=DOTS, ms=4.0, mew=0.0, alpha=0.7, rasterized=True)
    axes.errorbar(one.at, one.mean, 1.96 * one.error, fmt="o-", color=colour, ms=3, lw=0.9, elinewidth=0.7)
    short = _short(one.key)
    axes.set_xlabel(plot_label(_labelled(short, units.get(one.key, "1"))), size=6.5)
    axes.set_ylabel(plot_label(label))
    axes.set_title("dead" if one.dead else "", size=7.5, color=FAINT, loc="right", pad=2)
    axes.xaxis.set_major_locator(MaxNLocator(3))
    axes.yaxis.set_major_locator(MaxNLocator(4))
    _prefixed(axes, units.get(one.key, "1"), unit)
    ruled(axes)


def _prefixed(axes: Axes, across: str, up: str) -> None:
    """Write very small and very large numbers with a prefix and the unit: a factor at an axis' end is easily missed."""
    for axis, ends, unit in ((axes.xaxis, axes.get_xlim(), across), (axes.yaxis, axes.get_ylim(), up)):
        if not 1e-2 <= max(map(abs, ends)) < 1e4:
            axis.set_major_formatter(EngFormatter(unit=unit.removesuffix("1")))


def draw_sensitivity(path: BinaryIO, sensitivity: xarray.Dataset) -> None:
    """Draw Sobol's indices as :func:`panel_sensitivity` does, into a file."""
    with drawing(path, sensitivity_size(sensitivity), dpi=130, layout="constrained") as figure:
        panel_sensitivity(figure, sensitivity)


def sensitivity_size(sensitivity: xarray.Dataset) -> tuple[float, float]:
    """Return width and height of the picture of Sobol's indices [inch]."""
    panels = min(math.prod(sensitivity["rows"].shape), MOST_PANELS)
    keys = sensitivity.sizes["key"]
    return 2.3 * min(panels, _ACROSS - 1) + 2.3, (0.28 * keys + 0.7) * math.ceil(panels / (_ACROSS - 1)) + 0.3


def panel_sensitivity(figure: Figure, sensitivity: xarray.Dataset) -> None:
    """Draw first and total order of each key with 95 % intervals, a panel for each value of the plan's other axes."""
    places = list(np.ndindex(sensitivity["rows"].shape))[:MOST_PANELS]
    across = min(len(places), _ACROSS - 1)
    every = figure.subplots(math.ceil(len(places) / across), across, squeeze=False, sharex=True, sharey=True)
    names = [_short(str(key)) for key in sensitivity["key"].values]
    at = np.arange(len(names), dtype=np.float64)
    for axes, place in zip(every.flat, places, strict=False):
        for name, shift, colour in (("first_order", -0.13, ALIVE), ("total_order", 0.13, DOTS)):
            value = sensitivity[name].values[place]
            ends = sensitivity[f"{name}_interval"].values[place]
            axes.hlines(at + shift, ends[:, 0], ends[:, 1], color=colour, lw=1.1)
            axes.plot(value, at + shift, "o", color=colour, ms=3.5, label=name.replace("_", " "))
        axes.axvline(0.0, color=FAINT, lw=0.6)
        axes.set_yticks(at, [plot_label(name) for name in names])
        axes.set_xlabel("share of the variance")
        axes.set_title(_place_said(sensitivity, place), size=7.5, color=FAINT, pad=3)
        ruled(axes)
    every.flat[0].invert_yaxis()
    for axes in list(every.flat)[len(places) :]:
        axes.set_visible(False)
    figure.legend(*every.flat[0].get_legend_handles_labels(), loc="outside lower right", ncols=2)


def _place_said(sensitivity: xarray.Dataset, place: tuple[int, ...]) -> str:
    """Return the values of the other axes at a place."""
    words = []
    for axis, step in zip(sensitivity["rows"].dims, place, strict=True):
        for key, values in sensitivity.coords.items():
            if values.dims == (axis,):
                value = values.values[step]
                said = f"{value:.4g}" if isinstance(value, float) else str(value)
                words.append(
                    f"{_short(str(key))} {said} {values.attrs.get('units', '')}".removesuffix(" 1").rstrip()
                )
    return plot_label(", ".join(words))


def _short(key: str) -> str:
    return key if len(key) <= 34 else "…" + key[-33:]


def _labelled(name: str, unit: str) -> str:
    return name if unit == "1" else f"{name} [{unit}]"
