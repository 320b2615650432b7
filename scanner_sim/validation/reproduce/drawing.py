"""One look for the pictures of the paper's items."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scanner_sim.products.pictures.style import FAINT, house_style, save

BLUE, RED, GREEN, OCHRE, PURPLE = "#0b4f8a", "#b4331a", "#4b7f52", "#d08a1d", "#7a5195"
"""Colours of curves, in this order."""
COLOURS = (BLUE, RED, GREEN, OCHRE, PURPLE)

_TICKS = (0.5, 1, 2, 3, 5, 10, 20, 30, 50, 100, 200)


def sheet(
    path: Path,
    title: str,
    about: str,
    draw: Callable[[Sequence[Axes]], None],
    panels: int = 1,
    height: float = 3.9,
) -> None:
    """Draw panels side by side under one heading and write them as PNG.

    Parameters
    ----------
    path
        The file.
    title, about
        Heading, and what is said aside.
    draw
        Takes the axes and draws into them.
    panels
        Their number.
    height
        Of the sheet [inch].
    """
    with house_style():
        figure = Figure(figsize=(7.4, height), dpi=150, layout="constrained")
        axes = figure.subplots(1, panels, squeeze=False)[0]
        draw(list(axes))
        for one in axes:
            if one.axison and not one.images:
                one.grid(which="major", color="#e3e6e9", lw=0.5)
                one.set_axisbelow(True)
                one.spines[["top", "right"]].set_visible(False)
        figure.suptitle(title, x=0.01, ha="left", weight="bold", size=10.5)
        figure.supxlabel(about, x=0.01, ha="left", color=FAINT, size=7.5)
        save(figure, path)


def ranges(axes: Axes, axis: str = "x") -> None:
    """Give an axis of ranges logarithms and round ticks."""
    _logarithmic(axes, axis, _TICKS)
    getattr(axes, f"set_{axis}label")("range [m]")


def logarithms(axes: Axes, axis: str = "xy") -> None:
    """Give axes logarithms and plain numbers as ticks: 1, 2 and 5 of each power of ten."""
    for one in axis:
        _logarithmic(axes, one, [step * 10.0**power for power in range(-4, 7) for step in (1, 2, 5)])


def _logarithmic(axes: Axes, axis: str, round_numbers: Sequence[float]) -> None:
    getattr(axes, f"set_{axis}scale")("log")
    low, high = getattr(axes, f"get_{axis}lim")()
    ticks = [tick for tick in round_numbers if low <= tick <= high]
    set_ticks: Any = getattr(axes, f"set_{axis}ticks")
    set_ticks(ticks, [f"{tick:g}" for tick in ticks])
    set_ticks([], minor=True)
