"""The picture of an orbit: a band of conditions for each target, and below it the light that explains them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from scanner_sim.products.pictures.style import FAINT, INK, drawing, plot_label
from scanner_sim.products.timeline import Timeline

Array = NDArray[np.float64]

CONDITION_COLOURS = ("#f0c24b", "#8fb3c9", "#3f6b8c", "#d0522f", "#23272c", "#8a4f9e")
"""Of the conditions by number: sunny, shady, shadier, glaring, dark, and against the light."""
_LINES = ("#b4531a", "#0b4f8a", "#4b7f52", "#8a2f52", "#6b737c")
_MOST_LINES = 5
_WIDE, _LEFT, _RIGHT = 9.0, 1.45, 0.75


def draw_timeline(timeline: Timeline, path: str | Path) -> None:
    """Draw the conditions of each target over one orbit, the Sun's disc, the share in sunlight and the background."""
    count = len(timeline.tracks)
    bands, curves, foot = 0.30 * count, 1.05, 0.30 * 2
    high = 0.62 + bands + 3 * (curves + 0.24) + 0.45 + foot
    with drawing(path, (_WIDE, high)) as figure:

        def panel(top: float, tall: float) -> Axes:
            across = 1.0 - (_LEFT + _RIGHT) / _WIDE
            return figure.add_axes((_LEFT / _WIDE, 1.0 - (top + tall) / high, across, tall / high))

        minutes = np.append(timeline.times, timeline.period) / 60.0
        band = panel(0.62, bands)
        _bands(band, timeline, minutes)
        panels = [panel(0.62 + bands + 0.24 + number * (curves + 0.24), curves) for number in range(3)]
        _shares(panels[0], timeline, minutes)
        _lit(panels[1], timeline, minutes)
        _charge(panels[2], timeline, minutes)
        for axes in (band, *panels):
            axes.set_xlim(0.0, minutes[-1])
            axes.tick_params(labelbottom=axes is panels[-1])
            axes.spines[["top", "right"]].set_visible(False)
        panels[-1].set_xlabel("time along the orbit [min]")
        figure.text(_LEFT / _WIDE, 1.0 - 0.26 / high, "Light along one orbit", size=10.5, weight="bold")
        eclipse = 100.0 * (1.0 - float(timeline.sun_visible.mean()))
        about = (
            f"period {timeline.period / 60.0:.1f} min  ·  {timeline.times.size} moments  ·  "
            f"eclipse {eclipse:.1f} % of the time  ·  at the right: share of normal conditions"
        )
        figure.text(_LEFT / _WIDE, 1.0 - 0.46 / high, about, color=FAINT)
        _legend(figure, timeline, high)


def _bands(axes: Axes, timeline: Timeline, minutes: Array) -> None:
    codes = np.stack([track.condition for track in timeline.tracks])
    count = len(timeline.labels)
    norm = BoundaryNorm(np.arange(count + 1) - 0.5, count)
    edges = np.arange(codes.shape[0] + 1) - 0.5
    axes.pcolormesh(minutes, edges, codes, cmap=ListedColormap(CONDITION_COLOURS[:count]), norm=norm)
    axes.hlines(edges[1:-1], 0.0, minutes[-1], color="white", linewidth=2.0)
    axes.set_ylim(edges[-1], edges[0])
    axes.set_yticks(range(codes.shape[0]), [plot_label(_cut(track.name)) for track in timeline.tracks])
    axes.tick_params(left=False)
    axes.spines["left"].set_visible(False)
    for row, track in enumerate(timeline.tracks):
        axes.text(
            1.01, row, f"{100.0 * timeline.shares(track)[0]:.0f} %", va="center", transform=axes.get_yaxis_transform()
        )  # fmt: skip


def _shares(axes: Axes, timeline: Timeline, minutes: Array) -> None:
    _steps(axes, minutes, timeline.sun_visible, _LINES[0], "Sun's disc not hidden by the Earth")
    _steps(axes, minutes, timeline.sun_in_view, CONDITION_COLOURS[5], "Sun's disc seen by a pixel")
    axes.set(ylim=(-0.05, 1.3), yticks=(0.0, 0.5, 1.0), ylabel="share")
    axes.legend(loc="upper right", ncols=2, fontsize=7.0, borderaxespad=0.1)


def _lit(axes: Axes, timeline: Timeline, minutes: Array) -> None:
    for track, colour in zip(timeline.tracks[:_MOST_LINES], _LINES, strict=False):
        _steps(axes, minutes, track.lit, colour, plot_label(_cut(track.name)))
    axes.set(ylim=(-0.05, 1.3), yticks=(0.0, 0.5, 1.0), ylabel="in sunlight")
    axes.legend(loc="upper right", ncols=_MOST_LINES, fontsize=7.0, borderaxespad=0.1)


def _charge(axes: Axes, timeline: Timeline, minutes: Array) -> None:
    axes.set_yscale("log")
    for track, colour in zip(timeline.tracks[:_MOST_LINES], _LINES, strict=False):
        _steps(axes, minutes, np.where(track.background >= 1.0, track.background, np.nan), colour, None)
    brightest = np.where(timeline.brightest >= 1.0, timeline.brightest, np.nan)
    _steps(axes, minutes, brightest, FAINT, "brightest in the field of view", "--")
    axes.axhline(timeline.full_well, color=INK, linewidth=0.8, linestyle=":", label="full well")
    axes.set(ylim=(10.0, 20.0 * max(timeline.full_well, np.nanmax([*brightest, 1.0]))), ylabel="charge [e⁻]")
    axes.legend(loc="upper right", ncols=2, fontsize=7.0, borderaxespad=0.1)


def _steps(
    axes: Axes, minutes: Array, values: Array, colour: str, label: str | None, style: str = "-"
) -> None:
    axes.stairs(values, minutes, baseline=None, color=colour, label=label, linestyle=style, linewidth=1.1)


def _legend(figure: Figure, timeline: Timeline, high: float) -> None:
    handles = [
        Patch(facecolor=colour, label=label.name)
        for colour, label in zip(CONDITION_COLOURS, timeline.labels, strict=False)
    ]
    figure.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(_LEFT / _WIDE, 0.10 / high), ncols=3, borderaxespad=0.0,
        borderpad=0.0, handlelength=1.4, handleheight=1.0, fontsize=7.5,
    )  # fmt: skip


def _cut(name: str) -> str:
    return name if len(name) <= 18 else f"{name[:17]}…"
