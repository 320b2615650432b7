"""Pictures of the error budget: σ of the range against the range, and the source that dominates an image."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.patches import Patch

from scanner_sim.products.budget import BudgetRow, Dominance, Mode, crossing
from scanner_sim.products.pictures.style import FAINT, INK, drawing, over_range

COLOURS = {
    "all": INK,
    "shot": "#d08a1d",
    "read": "#0b4f8a",
    "quantisation": "#6fa8c9",
    "response": "#7a5195",
    "speckle": "#b4331a",
    "speckle_all_diffusion": "#e6a494",
    "speckle_all_aberration": "#d98270",
    "jitter": "#4b7f52",
    "wobble": "#8fb35a",
    "synchronisation": "#2a8c8c",
    "readout": "#b5a642",
    "drift": "#8a2f52",
    "sun": "#e0c200",
    "stray": "#c08497",
    "vibration": "#577590",
    "power": "#a2a832",
    "amplifier": "#0b4f8a",
    "clock": "#2a8c8c",
    "estimator": "#9a8478",
    "misfit": "#9a8478",
    "deflection": "#4b7f52",
}
"""Colour of each source, the same in every picture."""
CURVES: dict[Mode, tuple[str, str]] = {
    "fused": (INK, "both combined"),
    "triangulation": ("#b4331a", "triangulation"),
    "tof": ("#0b4f8a", "time of flight"),
}
"""Colour and label of each way of ranging; later ones are drawn above earlier ones."""
_TITLES: dict[Mode, str] = {
    "triangulation": "triangulation",
    "tof": "time of flight",
    "fused": "both combined",
}
_DEEPEST = 1e-3
"""Lower end of the picture, relative to the least of all sources together."""
_NOWHERE = "#e8eaec"


def draw_budget(
    rows: Sequence[BudgetRow],
    reflectance: float,
    path: str | Path,
    *,
    mode: Mode = "triangulation",
    light: str = "dark",
) -> None:
    """Draw σ of the range against range in logarithms: lines are analytic, points with 95 % bars simulated.

    Parameters
    ----------
    rows
        The budget.
    reflectance
        Of the target, for the heading.
    path
        The PNG to write.
    mode
        The way of ranging whose sources are drawn.
    light
        What shines on the target, for the heading.
    """
    rows = [row for row in rows if row.mode == mode]
    with drawing(path, (7.4, 5.0), layout="constrained") as figure:
        axes = figure.subplots()
        for name in dict.fromkeys(row.source for row in rows):
            own = [row for row in rows if row.source == name]
            _draw_source(axes, own, COLOURS[name], name, strong=name == "all")
        whole = [1e3 * row.simulated_m for row in rows if row.source == "all" and row.simulated_m > 0.0]
        if whole:
            axes.set_ylim(_DEEPEST * min(whole), 3.0 * max(whole))
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        _finish(axes, f"Where the range error comes from: {_TITLES[mode]}", _about(reflectance, light))


def draw_curves(
    rows: Sequence[BudgetRow], reflectance: float, path: str | Path, *, light: str = "dark"
) -> None:
    """Draw σ of both ways of ranging, and of both combined, against range (Figure 12); marked is where they cross.

    Parameters
    ----------
    rows, reflectance, path, light
        As for :func:`draw_budget`.
    """
    rows = [row for row in rows if row.source == "all"]
    with drawing(path, (7.4, 4.6), layout="constrained") as figure:
        axes = figure.subplots()
        for mode, (colour, label) in CURVES.items():
            own = [row for row in rows if row.mode == mode]
            _draw_source(axes, own, colour, label, strong=True)
        meeting = crossing(rows, "analytic_m")
        meeting = crossing(rows, "simulated_m") if np.isnan(meeting) else meeting
        if np.isfinite(meeting):
            axes.axvline(meeting, color=FAINT, lw=0.8, ls=":")
            axes.annotate(
                f" equal at {meeting:.3g} m",
                (meeting, 0.03),
                xycoords=("data", "axes fraction"),
                color=FAINT,
            )
        axes.legend(loc="upper left")
        _finish(axes, "σ of the range by both ways of ranging (Figure 12)", _about(reflectance, light))


def _about(reflectance: float, light: str) -> str:
    """Return the second line of a heading."""
    return f"facing target of reflectance {reflectance:g}, {light}  ·  lines: closed forms, points: simulated, 95 %"


def _draw_source(axes: Axes, rows: Sequence[BudgetRow], colour: str, label: str, *, strong: bool) -> None:
    """Draw one curve: a line for closed forms, points with bars for the simulation."""
    x, line, y, low, high = (
        np.array([getattr(row, key) for row in rows])
        for key in ("range_m", "analytic_m", "simulated_m", "low_m", "high_m")
    )
    axes.plot(x, 1e3 * line, color=colour, lw=1.8 if strong else 1.0, zorder=2 if strong else 3)
    bars = 1e3 * np.stack([y - low, high - y])
    # The whole lies beneath its parts: one that makes nearly all of it stays in sight.
    size, level = (4.0, 2) if strong else (2.8, 4)
    axes.errorbar(
        x, 1e3 * y, bars, fmt="o", ms=size, lw=0.9, capsize=1.5, color=colour, label=label, zorder=level
    )


def _finish(axes: Axes, title: str, about: str) -> None:
    """Give axes over range and σ their scales, ticks and heading."""
    over_range(axes, "σ of the range [mm]")
    axes.set_title(title, loc="left", weight="bold", size=10.5, pad=20)
    axes.text(0.0, 1.02, about, transform=axes.transAxes, color=FAINT)


def draw_dominance(dominance: Dominance, path: str | Path) -> None:
    """Draw which source makes most of the stated σ of the range, voxel by voxel; grey where there is no range."""
    largest, shares = dominance.largest, dominance.shares()
    shown = [number for number, name in enumerate(dominance.sources) if shares[name] > 0.0]
    shown.sort(key=lambda number: -shares[dominance.sources[number]])
    picture = np.empty((*largest.shape, 3))
    picture[...] = to_rgb(_NOWHERE)
    for number in shown:
        picture[largest == number] = to_rgb(COLOURS[dominance.sources[number]])
    with drawing(path, (7.6, 5.2), layout="constrained") as figure:
        axes = figure.subplots()
        theta, phi = np.degrees(dominance.theta), np.degrees(dominance.phi)
        step = [0.5 * (a[1] - a[0]) if a.size > 1 else 0.5 for a in (theta, phi)]
        extent = (theta[0] - step[0], theta[-1] + step[0], phi[-1] + step[1], phi[0] - step[1])
        axes.imshow(picture, extent=extent, interpolation="nearest")
        axes.set(xlabel="Θ [°]", ylabel="φ [°]")
        title = f"The source that makes most of σ: {_TITLES[dominance.mode]}"
        axes.set_title(title, loc="left", weight="bold", size=10.5)
        names = [dominance.sources[number] for number in shown]
        patches = [Patch(color=COLOURS[name], label=f"{name} {100.0 * shares[name]:.3g} %") for name in names]
        if (largest < 0).any():
            patches.append(Patch(color=_NOWHERE, label="no range"))
        axes.legend(handles=patches, loc="upper left", bbox_to_anchor=(1.0, 1.0))
