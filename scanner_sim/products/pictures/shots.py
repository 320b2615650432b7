"""Pictures of a table of shots: dots at the angles of the shots, by range and by status, or both over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from scanner_sim.foundation.status import Status
from scanner_sim.products.layers import numbered
from scanner_sim.products.pictures.layer import thin_outline
from scanner_sim.products.pictures.style import (
    FAINT,
    RANGE_MAP,
    STATUS_COLOUR,
    house_style,
    plot_label,
    save,
)
from scanner_sim.products.pictures.time_series import (
    draw_range_over_time,
    draw_status_over_time,
    in_one_direction,
)
from scanner_sim.products.shots import ShotTable

_MOST_DOTS = 200_000
"""Dots of a picture; of more shots every second, third … is drawn."""
_LONG_SIDE, _LEAST_SIDE = 5.6, 1.6
"""Longer and least side of the axes [inch]."""
_LEFT, _RIGHT, _TOP, _BOTTOM, _LINE = 0.72, 0.85, 0.62, 0.55, 0.165
_VALID = "#2b7a8c"


def draw_shots_range(shots: ShotTable, path: str | Path) -> None:
    """Draw the measured ranges as coloured dots over faint ones of all shots; over time where all point alike.

    The scale leaves out the outermost half per cent at either end.
    """
    if in_one_direction(shots):
        return draw_range_over_time(shots, path)
    ranges = shots["range_m"]
    finite = ranges[np.isfinite(ranges)]
    low, high = np.percentile(finite, (0.5, 99.5)) if finite.size else (0.0, 1.0)
    short = max(1e-3 - (high - low), 0.0) / 2.0
    scale = ScalarMappable(Normalize(low - short, high + short), matplotlib.colormaps[RANGE_MAP])
    with house_style():
        figure, axes, some = _axes(shots, "Range", legend_lines=0)
        theta, phi, size = *_degrees(shots, some), _dot(len(some), figure, axes)
        axes.scatter(theta, phi, s=size, color="#d9dce0", linewidths=0.0)
        known = np.isfinite(ranges[some])
        axes.scatter(
            theta[known], phi[known], s=size, color=scale.to_rgba(ranges[some][known]), linewidths=0.0
        )
        if finite.size:
            _colour_bar(figure, axes, scale)
        save(figure, path)


def draw_shots_status(shots: ShotTable, path: str | Path) -> None:
    """Draw a dot in the colour of its status for each shot; over time where all point alike."""
    if in_one_direction(shots):
        return draw_status_over_time(shots, path)
    present = [code for code in Status if (shots["status"] == code).any()]
    with house_style():
        figure, axes, some = _axes(shots, "Status", legend_lines=len(present))
        theta, phi, size = *_degrees(shots, some), _dot(len(some), figure, axes)
        status, handles = shots["status"], []
        for code in present:
            where = status[some] == code
            colour = _VALID if code is Status.VALID else STATUS_COLOUR.get(code, FAINT)
            axes.scatter(theta[where], phi[where], s=size, color=colour, linewidths=0.0)
            share = 100.0 * float(np.mean(status == code))
            text = f"{share:.3g} %: {code.sentence}"
            handles.append(Line2D([], [], marker="o", ls="", ms=4.0, color=colour, label=text))
        left = axes.get_position().x0
        figure.legend(
            handles=handles,
            loc="lower left",
            bbox_to_anchor=(left, 0.06 / figure.get_size_inches()[1]),
            borderaxespad=0.0,
            borderpad=0.0,
            handlelength=1.0,
            labelspacing=0.45,
            fontsize=7.5,
        )
        save(figure, path)


PICTURES_OF_SHOTS: Mapping[str, Callable[[ShotTable, str | Path], None]] = MappingProxyType(
    {"range.png": draw_shots_range, "status.png": draw_shots_status}
)
"""The pictures of every table of shots, by the name of their file."""


def pictures_of_shots(shots: ShotTable) -> tuple[str, ...]:
    """Return the names of the pictures whose layers a table has: without ranges that of the statuses alone."""
    needed = ["range_m", *(["sigma_range_m", "truth.range_m"] if in_one_direction(shots) else [])]
    whole = all(name in shots for name in needed)
    return tuple(name for name in PICTURES_OF_SHOTS if whole or name != "range.png")


def _axes(shots: ShotTable, title: str, legend_lines: int) -> tuple[Figure, Axes, NDArray[np.intp]]:
    """Return a figure with axes in degrees about all shots, and the shots that are drawn."""
    ends = [(float(angle.min()), float(angle.max())) for angle in (shots.theta, shots.phi)]
    widest = max(last - first for first, last in ends)
    margin = 0.03 * widest + 1e-4
    (left, right), (upper, lower) = ((first - margin, last + margin) for first, last in ends)
    scale = _LONG_SIDE / max(right - left, lower - upper)
    wide, high = (max(scale * side, _LEAST_SIDE) for side in (right - left, lower - upper))
    across, down = wide + _LEFT + _RIGHT, high + _TOP + _BOTTOM + legend_lines * _LINE
    across = max(across, 5.2)
    figure = Figure(figsize=(across, down), dpi=150)
    box = _LEFT / across, (_BOTTOM + legend_lines * _LINE) / down, wide / across, high / down
    axes = figure.add_axes(box)
    axes.set(xlim=np.degrees((left, right)), ylim=np.degrees((lower, upper)))
    axes.set(xlabel="Θ to the right [°]", ylabel="φ downwards [°]")
    step = -(-len(shots) // _MOST_DOTS)
    drawn = "" if step == 1 else f"  ·  one in {step} drawn"
    names = map(plot_label, list(numbered(shots.objects).values())[:3])
    about = f"{', '.join(names)}  ·  {len(shots):,} shots in {shots.time[-1]:.3g} s"
    about += f"  ·  seed {shots.seed}  ·  {100.0 * shots.valid.mean():.1f} % valid{drawn}"
    figure.text(_LEFT / across, 1.0 - 0.30 / down, title, size=10.5, weight="bold")
    figure.text(_LEFT / across, 1.0 - 0.48 / down, about.removeprefix("  ·  "), color=FAINT, fontsize=7.0)
    return figure, axes, np.arange(0, len(shots), step)


def _degrees(shots: ShotTable, some: NDArray[np.intp]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return np.degrees(shots.theta[some]), np.degrees(shots.phi[some])


def _dot(count: int, figure: Figure, axes: Axes) -> float:
    """Return the area of a dot [pt²] with which so many fill about a third of the axes, within what can be seen."""
    wide, high = axes.get_position().size * figure.get_size_inches()
    return float(np.clip(0.3 * wide * high * 72.0**2 / max(count, 1), 0.4, 12.0))


def _colour_bar(figure: Figure, axes: Axes, scale: ScalarMappable) -> None:
    box, across = axes.get_position(), figure.get_size_inches()[0]
    bar = figure.colorbar(
        scale, cax=figure.add_axes((box.x1 + 0.14 / across, box.y0, 0.14 / across, box.height))
    )
    thin_outline(bar)
    bar.set_label("range [m]")
