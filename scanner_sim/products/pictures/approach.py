"""Pictures of an approach: errors, σ and availability over range and light, and over the conditions of Table 1."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from numpy.typing import NDArray

from scanner_sim.products.approach import ApproachRow, ApproachStudy, EpochRow
from scanner_sim.products.pictures.style import FAINT, drawing, over_range, plain_decades, plot_label
from scanner_sim.products.pictures.timeline import CONDITION_COLOURS
from scanner_sim.products.pose_study import COMPONENTS

Array = NDArray[np.float64]

_MARKS = {
    "camera": ("#16191d", "*"),
    "uv": ("#b4531a", "o"),
    "xyz": ("#0b4f8a", "s"),
    "joint": ("#4b7f52", "^"),
    "xyz_tof": ("#8a2f52", "v"),
    "joint_tof": ("#6b737c", "D"),
}
_TITLES = ("across, x", "down, y", "along, z", "about x", "about y", "about z")
_UNSEEN = "#e3e6e9"
_WIDE = 1.03
"""Half the width of a bar of stated σ, as a ratio of ranges."""


def draw_approach(study: ApproachStudy, path: str | Path | BinaryIO, orbit: int = 0) -> None:
    """Draw what an approach gave under one light: six panels of errors and σ, the light, and availability."""
    epochs = [row for row in study.epochs if row.orbit == orbit]
    rows = [row for row in study.rows if row.orbit == orbit]
    with drawing(path, (9.6, 8.0), layout="constrained") as figure:
        grid = figure.add_gridspec(4, 3, height_ratios=(1.0, 1.0, 0.09, 0.6))
        for number, component in enumerate(COMPONENTS):
            axes = figure.add_subplot(grid[number // 3, number % 3])
            own = [row for row in rows if row.component == component]
            _same_ranges(axes, epochs)
            _component(axes, study, own, component)
            axes.set_title(_TITLES[number], loc="left", weight="bold", size=9.0)
        band, share = figure.add_subplot(grid[2, :]), figure.add_subplot(grid[3, :])
        for axes in (band, share):
            _same_ranges(axes, epochs)
        _band(band, epochs)
        _availability(share, study, [row for row in rows if row.component == COMPONENTS[0]])
        said = {row.condition for row in epochs}
        patches = [
            Patch(color=CONDITION_COLOURS[number], label=label.name)
            for number, label in enumerate(study.labels)
            if number in said
        ]
        _legend(figure, study, patches)
        light = f", light {orbit + 1} of {study.orbits}" if study.orbits > 1 else ""
        figure.suptitle(
            f"Pose on the way: {plot_label(study.name)}{light}", x=0.01, ha="left", weight="bold", size=10.5
        )
        figure.text(
            0.99,
            0.985,
            "marks: rms error, 95 %  ·  lines and bars: stated σ",
            ha="right",
            va="top",
            color=FAINT,
        )


def draw_conditions(study: ApproachStudy, path: str | Path | BinaryIO) -> None:
    """Draw the methods over the conditions of Table 1: share of tries with a pose, errors of place and attitude."""
    panels = (
        ("share of tries with a pose", "availability", "", 1.0),
        ("error of the place [mm]", "position_m", "position_sigma_m", 1e3),
        ("error of the attitude [m°]", "attitude_rad", "attitude_sigma_rad", 1e3 * float(np.degrees(1.0))),
    )
    counts = {row.condition: row for row in study.conditions}
    with drawing(path, (9.6, 7.4), layout="constrained") as figure:
        for axes, (words, key, stated, unit) in zip(figure.subplots(3, 1, sharex=True), panels, strict=True):
            for number, name in enumerate(study.methods):
                own = [row for row in study.conditions if row.method == name and row.tries]
                aside = 0.11 * (number - 0.5 * (len(study.methods) - 1))
                at = np.array([row.condition + aside for row in own])
                y = unit * np.array([getattr(row, key) for row in own])
                colour, mark = _MARKS[name]
                if stated:
                    sigma = unit * np.array([getattr(row, stated) for row in own])
                    axes.hlines(sigma, at - 0.045, at + 0.045, color=colour, lw=1.2)
                    axes.plot(at, y, mark, ms=4.0, color=colour)
                else:
                    ends = np.array([[row.availability_low, row.availability_high] for row in own])
                    bars = np.abs(ends.reshape(-1, 2).T - y)
                    axes.errorbar(at, y, bars, fmt=mark, ms=4.0, lw=0.7, capsize=1.5, color=colour)
            for edge in range(len(study.labels) - 1):
                axes.axvline(edge + 0.5, color=_UNSEEN, lw=0.8)
            axes.set(ylabel=words, xlim=(-0.5, len(study.labels) - 0.5))
            if stated:
                plain_decades(axes)
            else:
                axes.set(ylim=(-0.05, 1.05))
            axes.grid(axis="y", color=_UNSEEN, lw=0.5)
            axes.spines[["top", "right"]].set_visible(False)
        axes.set_xticks(
            range(len(study.labels)),
            [
                f"{label.name.replace(' in the', chr(10) + 'in the')}\n"
                + (_epochs(counts[number].epochs) if counts[number].tries else "did not occur")
                for number, label in enumerate(study.labels)
            ],
        )
        _legend(figure, study, columns=3)
        figure.suptitle(
            f"Pose by light: {plot_label(study.name)}", x=0.01, ha="left", weight="bold", size=10.5
        )
        figure.text(
            0.99,
            0.985,
            "marks: rms error or share, 95 %  ·  bars: stated σ",
            ha="right",
            va="top",
            color=FAINT,
        )


def _epochs(count: int) -> str:
    return "1 epoch" if count == 1 else f"{count} epochs"


def _legend(figure: Figure, study: ApproachStudy, patches: Sequence[Patch] = (), columns: int = 5) -> None:
    lines = [
        Line2D([], [], color=colour, marker=mark, ms=4.0, lw=0.0, label=words)
        for name, words in study.methods.items()
        for colour, mark in (_MARKS[name],)
    ]
    figure.legend(handles=[*lines, *patches], loc="outside lower center", ncols=columns, fontsize=7.5)


def _component(axes: Axes, study: ApproachStudy, rows: list[ApproachRow], component: str) -> None:
    shift = component.startswith("t_")
    unit = 1e3 if shift else 1e3 * np.degrees(1.0)
    for name, aside in _aside(study):
        colour, mark = _MARKS[name]
        own = sorted((row for row in rows if row.method == name), key=lambda row: row.range_m)
        x, error, low, high, sigma = (
            np.array([getattr(row, key) for row in own])
            for key in ("range_m", "error", "error_low", "error_high", "sigma")
        )
        bars = unit * np.stack([error - low, high - error])
        axes.plot(x, unit * sigma, color=colour, lw=1.0, zorder=2)
        # Between epochs without a pose there is no line.
        axes.hlines(unit * sigma, x / _WIDE, x * _WIDE, color=colour, lw=1.4, zorder=2)
        axes.errorbar(
            aside * x, unit * error, bars, fmt=mark, ms=3.4, lw=0.7, capsize=1.5, color=colour, zorder=3
        )
    over_range(axes, f"error [{'mm' if shift else 'm°'}]")
    plain_decades(axes)


def _band(axes: Axes, epochs: list[EpochRow]) -> None:
    """Draw the condition of the light at each epoch, up to half of the way to the next."""
    ordered = sorted(epochs, key=lambda row: row.range_m)
    ends = _ends(np.array([row.range_m for row in ordered]))
    for row, left, right in zip(ordered, ends[:-1], ends[1:], strict=True):
        colour = _UNSEEN if row.condition < 0 else CONDITION_COLOURS[row.condition]
        axes.add_patch(Rectangle((left, 0.0), right - left, 1.0, color=colour, lw=0.0))
    axes.set(ylim=(0.0, 1.0), yticks=(), xscale="log")
    axes.set_ylabel("light", rotation=0, ha="right", va="center")
    axes.tick_params(which="both", bottom=False, labelbottom=False)
    axes.spines[["top", "right", "left", "bottom"]].set_visible(False)


def _ends(ranges: Array) -> Array:
    """Return where the bands of ascending ranges (n,) begin and end, shape (n + 1,)."""
    if len(ranges) == 1:
        return np.array([0.9, 1.1]) * ranges
    middles = np.sqrt(ranges[1:] * ranges[:-1])
    return np.array([ranges[0] ** 2 / middles[0], *middles, ranges[-1] ** 2 / middles[-1]])


def _same_ranges(axes: Axes, epochs: list[EpochRow]) -> None:
    """Let all panels show the same ranges."""
    ranges = np.sort([row.range_m for row in epochs])
    ends = _ends(ranges)
    axes.set_xlim(float(ends[0]) * 0.98, float(ends[-1]) * 1.02)


def _aside(study: ApproachStudy) -> list[tuple[str, float]]:
    """Return the methods, and by what factor the marks of each stand aside: equal ones would hide one another."""
    middle = 0.5 * (len(study.methods) - 1)
    return [(name, 1.0 + 0.01 * (number - middle)) for number, name in enumerate(study.methods)]


def _availability(axes: Axes, study: ApproachStudy, rows: list[ApproachRow]) -> None:
    for name, aside in _aside(study):
        colour, mark = _MARKS[name]
        own = sorted((row for row in rows if row.method == name), key=lambda row: row.range_m)
        x, y, low, high = (
            np.array([getattr(row, key) for row in own])
            for key in ("range_m", "availability", "availability_low", "availability_high")
        )
        bars = np.stack([y - low, high - y])
        axes.errorbar(aside * x, y, bars, fmt=mark, ms=3.4, lw=0.7, capsize=1.5, color=colour)
    over_range(axes, "share with a pose")
    axes.set(yscale="linear", ylim=(-0.05, 1.05), yticks=(0.0, 0.5, 1.0))
