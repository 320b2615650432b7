"""Pictures of a pose study: Figure 15 by component, and arrays compared at one range."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import LogLocator, NullFormatter

from scanner_sim.products.pictures.style import FAINT, count_in_decades, drawing, ruled
from scanner_sim.products.pose_study import COMPONENTS, PoseRow, PoseStudy

MODES = {
    ("uv", "none"): ("angles (uv)", "#0b4f8a", "o"),
    ("xyz", "triangulation"): ("points (xyz), triangulation", "#b4331a", "s"),
    ("joint", "triangulation"): ("both (joint), triangulation", "#d08a1d", "D"),
    ("xyz", "tof"): ("points (xyz), time of flight", "#7a5195", "^"),
    ("joint", "tof"): ("both (joint), time of flight", "#4b7f52", "v"),
}
"""Name, colour and mark of each method of measuring."""
_TITLES = {
    "t_x": "shift across, $t_x$",
    "t_y": "shift down, $t_y$",
    "t_z": "shift in depth, $t_z$",
    "omega_x": "tilt about x, $ω_x$",
    "omega_y": "tilt about y, $ω_y$",
    "omega_z": "roll, $ω_z$",
}
_TICKS = (2, 3, 5, 7, 10, 14, 20, 30, 40)


def draw_figure_15(study: PoseStudy, path: str | Path) -> None:
    """Draw the errors of the base array against range in logarithms, a panel for each component.

    Points with 95 % bars are simulated, lines are closed forms with the simulated scatter of single targets.

    Parameters
    ----------
    study
        The study.
    path
        The PNG to write.
    """
    base = [row for row in study.rows if row.array == study.base and row.size_m == study.base_size]
    with drawing(path, (9.6, 6.6), layout="constrained") as figure:
        panels = figure.subplots(2, 3, sharex=True)
        for axes, component in zip(panels.ravel(), COMPONENTS, strict=True):
            for mode, (name, colour, mark) in MODES.items():
                own = [row for row in base if row.mode == mode and row.component == component]
                if own:
                    _draw_mode(axes, own, name, colour, mark)
            unit = "mm" if component.startswith("t") else "mrad"
            axes.set(xscale="log", ylabel=f"error [{unit}]")
            count_in_decades(axes)
            axes.set_title(_TITLES[component], loc="left", weight="bold", size=9.0)
            low, high = axes.get_xlim()
            ticks = [tick for tick in _TICKS if low < tick < high]
            axes.set_xticks(ticks, [str(tick) for tick in ticks])
            axes.set_xticks([], minor=True)
            _plain_ticks(axes.yaxis, axes.get_ylim())
            ruled(axes)
        for axes in panels[1]:
            axes.set_xlabel("range [m]")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
        figure.suptitle(
            f"Error of the pose of four targets, {study.base_size:g} m × {study.base_size:g} m (Figure 15)",
            x=0.01,
            ha="left",
            weight="bold",
            size=10.5,
        )
        about = "marks: simulated, 95 %  ·  lines: closed forms"
        figure.text(0.99, 0.985, about, ha="right", va="top", color=FAINT)


def _draw_mode(axes: Axes, own: list[PoseRow], name: str, colour: str, mark: str) -> None:
    """Draw one method of measuring into a panel."""
    x, line, y, low, high = (
        np.array([getattr(row, key) for row in own])
        for key in ("range_m", "analytic", "simulated", "low", "high")
    )
    axes.plot(x, 1e3 * line, color=colour, lw=1.0, zorder=2)
    bars = 1e3 * np.stack([y - low, high - y])
    axes.errorbar(x, 1e3 * y, bars, fmt=mark, ms=3.4, lw=0.8, capsize=1.5, color=colour, label=name, zorder=3)


def _plain_ticks(axis: Axis, ends: tuple[float, float]) -> None:
    """Label an axis in logarithms with plain numbers: decades, 2 and 5 between them where it spans few, and 3 in one.

    A locator that finds a single place would label all digits, one over the other.
    """
    span = ends[1] / ends[0]
    between = (2.0, 3.0, 5.0) if span < 10.0 else (2.0, 5.0) if span < 60.0 else ()
    axis.set_major_locator(LogLocator(subs=(1.0, *between)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def draw_arrays(study: PoseStudy, path: str | Path) -> None:
    """Draw the errors of all arrays at the range nearest to 10 m: a row for each array, a panel for each component."""
    distance = min({row.range_m for row in study.rows}, key=lambda r: abs(np.log(r / 10.0)))
    rows = [row for row in study.rows if row.range_m == distance]
    arrays = list(dict.fromkeys((row.array, row.size_m, row.targets) for row in rows))
    with drawing(path, (10.4, 1.6 + 0.26 * len(arrays)), layout="constrained") as figure:
        panels = figure.subplots(1, 4, sharey=True)
        shown = ("t_x", "t_z", "omega_y", "omega_z")
        for axes, component in zip(panels, shown, strict=True):
            for mode, (name, colour, mark) in MODES.items():
                own = [row for row in rows if row.mode == mode and row.component == component]
                if not own:
                    continue
                position = [arrays.index((row.array, row.size_m, row.targets)) for row in own]
                axes.plot([1e3 * row.analytic for row in own], position, "|", ms=9.0, mew=1.0, color=colour)
                axes.plot(
                    [1e3 * row.simulated for row in own], position, mark, ms=3.6, color=colour, label=name
                )
            unit = "mm" if component.startswith("t") else "mrad"
            axes.set(xscale="log", xlabel=f"error [{unit}]")
            _plain_ticks(axes.xaxis, axes.get_xlim())
            axes.set_title(_TITLES[component], loc="left", weight="bold", size=9.0)
            ruled(axes)
        names = [f"{name}, {size:.3g} m ({targets})" for name, size, targets in arrays]
        panels[0].set_yticks(range(len(arrays)), names)
        panels[0].invert_yaxis()
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5)
        figure.suptitle(
            f"Arrays at {distance:.3g} m, with the number of their targets",
            x=0.01,
            ha="left",
            weight="bold",
            size=10.5,
        )
        figure.text(0.99, 0.985, "marks: simulated, strokes: closed forms", ha="right", va="top", color=FAINT)
