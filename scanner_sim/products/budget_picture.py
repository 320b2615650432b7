"""Pictures of the error budget: σ of the range against the range, and the source that dominates an image."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scanner_sim.products.budget import BudgetRow, Dominance
from scanner_sim.products.style import FAINT, INK, house_style, save

COLOURS = {
    "all": INK,
    "shot": "#d08a1d",
    "read": "#0b4f8a",
    "quantisation": "#6fa8c9",
    "response": "#7a5195",
    "speckle": "#b4331a",
    "jitter": "#4b7f52",
    "wobble": "#8fb35a",
    "synchronisation": "#2a8c8c",
    "readout": "#b5a642",
    "drift": "#8a2f52",
    "estimator": "#9a8478",
    "misfit": "#9a8478",
    "deflection": "#4b7f52",
}
"""Colour of each source, the same in every picture."""
_DEEPEST = 1e-3
"""Lower end of the picture, relative to the least of all sources together."""
_NOWHERE = "#e8eaec"


def draw_budget(rows: Sequence[BudgetRow], reflectance: float, path: str | Path) -> None:
    """Draw σ of the range against range in logarithms: lines are analytic, points with 95 % bars simulated.

    Parameters
    ----------
    rows
        The budget.
    reflectance
        Of the target, for the heading.
    path
        The PNG to write.
    """
    names = list(dict.fromkeys(row.source for row in rows))
    with house_style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(7.4, 5.0), dpi=150, layout="constrained")
        axes = figure.subplots()
        for name in names:
            own = [row for row in rows if row.source == name]
            x, line, y, low, high = (
                np.array([getattr(row, key) for row in own])
                for key in ("range_m", "analytic_m", "simulated_m", "low_m", "high_m")
            )
            colour, strong = COLOURS[name], name == "all"
            axes.plot(x, 1e3 * line, color=colour, lw=1.8 if strong else 1.0, zorder=3 if strong else 2)
            bars = 1e3 * np.stack([y - low, high - y])
            size = 4.0 if strong else 2.8
            axes.errorbar(
                x, 1e3 * y, bars, fmt="o", ms=size, lw=0.9, capsize=1.5, color=colour, label=name, zorder=4
            )
        whole = [1e3 * row.simulated_m for row in rows if row.source == "all" and row.simulated_m > 0.0]
        axes.set(xscale="log", yscale="log", xlabel="range [m]", ylabel="σ of the range [mm]")
        if whole:
            axes.set_ylim(_DEEPEST * min(whole), 3.0 * max(whole))
        ticks = [
            tick for tick in (1, 2, 3, 5, 10, 20, 30, 50) if axes.get_xlim()[0] < tick < axes.get_xlim()[1]
        ]
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
        axes.set_xticks([], minor=True)
        axes.grid(which="major", color="#e3e6e9", lw=0.5)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        axes.set_title(
            "Where the range error comes from: triangulation", loc="left", weight="bold", size=10.5, pad=20
        )
        about = f"facing target of reflectance {reflectance:g}, dark  ·  lines: closed forms, points: simulated, 95 %"
        axes.text(0.0, 1.02, about, transform=axes.transAxes, color=FAINT)
        save(figure, path)


def draw_dominance(dominance: Dominance, path: str | Path) -> None:
    """Draw which source makes most of the stated σ of the range, voxel by voxel; grey where there is no range."""
    largest, shares = dominance.largest, dominance.shares()
    shown = [number for number, name in enumerate(dominance.sources) if shares[name] > 0.0]
    shown.sort(key=lambda number: -shares[dominance.sources[number]])
    with house_style():
        from matplotlib.colors import to_rgb
        from matplotlib.figure import Figure
        from matplotlib.patches import Patch

        picture = np.empty((*largest.shape, 3))
        picture[...] = to_rgb(_NOWHERE)
        for number in shown:
            picture[largest == number] = to_rgb(COLOURS[dominance.sources[number]])
        figure = Figure(figsize=(7.6, 5.2), dpi=150, layout="constrained")
        axes = figure.subplots()
        theta, phi = np.degrees(dominance.theta), np.degrees(dominance.phi)
        step = [0.5 * (a[1] - a[0]) if a.size > 1 else 0.5 for a in (theta, phi)]
        extent = (theta[0] - step[0], theta[-1] + step[0], phi[-1] + step[1], phi[0] - step[1])
        axes.imshow(picture, extent=extent, interpolation="nearest")
        axes.set(xlabel="Θ [deg]", ylabel="φ [deg]")
        axes.set_title("The source that makes most of σ", loc="left", weight="bold", size=10.5)
        names = [dominance.sources[number] for number in shown]
        patches = [Patch(color=COLOURS[name], label=f"{name} {100.0 * shares[name]:.3g} %") for name in names]
        patches.append(Patch(color=_NOWHERE, label="no range"))
        axes.legend(handles=patches, loc="upper left", bbox_to_anchor=(1.0, 1.0))
        save(figure, path)
