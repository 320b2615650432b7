"""Poses in pictures: errors of the six components over time, and the object's outline at estimated and true pose."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from scanner_sim.pose.series import PoseSeries
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.pictures.style import FAINT, INK, drawing, plot_label
from scanner_sim.tracking.record import Track, TrackTarget

Array = NDArray[np.float64]

METHOD_COLOUR = {
    "uv": "#0b4f8a",
    "xyz": "#d08a1d",
    "joint": "#4b7f52",
    "camera": "#7a4b8f",
    "combined": "#a3324b",
}
"""Colour of each method, the same in every picture."""
_MARK = {"uv": "o", "xyz": "s", "joint": "D", "camera": "^", "combined": "*"}
_SIZE = {"uv": 2.2, "xyz": 3.6, "joint": 2.2, "camera": 2.8, "combined": 3.2}
_WIDTH = {"uv": 0.9, "xyz": 2.2, "joint": 0.9, "camera": 0.9, "combined": 0.9}
"""Of marks and lines: with weights by full covariances ``xyz`` is nearly ``joint``, and must be seen below it."""
_COMPONENTS = (
    "x [mm]",
    "y [mm]",
    "z [mm]",
    "about x [mrad]",
    "about y [mrad]",
    "about z [mrad]",
)
_MOST_COLUMNS = 4
_TURN = np.linspace(0.0, 2.0 * np.pi, 61)
_APART = 0.12
"""Wanted displacement of an outline in the picture, over the object's size."""


def draw_poses(series: Sequence[PoseSeries], path: str | Path) -> None:
    """Draw estimated less true pose over time by component, with ±2σ, a column for each object or pair of objects.

    The first four are drawn. Poses that are not valid are left out; ticks at the top mark them.

    Parameters
    ----------
    series
        Poses; not empty.
    path
        The PNG to write.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    labels = list(dict.fromkeys(one.label for one in series))[:_MOST_COLUMNS]
    methods = list(dict.fromkeys(one.method for one in series))
    wide = max(2.9 * len(labels) + 0.9, 6.4)
    with drawing(path, (wide, 8.6)) as figure:
        grid = figure.subplots(6, len(labels), sharex=True, squeeze=False)
        figure.subplots_adjust(
            left=0.8 / wide, right=1.0 - 0.12 / wide, top=0.905, bottom=0.085, wspace=0.24, hspace=0.16
        )
        for column, label in enumerate(labels):
            chosen = [one for one in series if one.label == label]
            for component in range(6):
                _component(grid[component, column], chosen, component)
            grid[0, column].set_title(plot_label(label), loc="left", fontsize=8.0, weight="bold")
            grid[-1, column].set_xlabel("time [s]")
        for component, name in enumerate(_COMPONENTS):
            grid[component, 0].set_ylabel(name)
        figure.text(0.8 / wide, 0.972, "Poses over time: estimated − true", size=10.5, weight="bold")
        figure.text(0.8 / wide, 0.950, "lines: ±2σ  ·  ticks: no valid pose", color=FAINT)
        _methods(figure, methods, (0.8 / wide, 0.012))


def _component(axes: Axes, chosen: Sequence[PoseSeries], component: int) -> None:
    reach = 1e-3
    for number, one in enumerate(chosen):
        good = one.status == PoseStatus.VALID
        error, sigma = (1e3 * values[:, component] for values in (one.error, one.sigma))
        colour = METHOD_COLOUR[one.method]
        sigma = np.where(good, sigma, np.nan)
        axes.plot(one.time[good], error[good], _MARK[one.method], color=colour, ms=_SIZE[one.method], mew=0.0)
        for sign in (-2.0, 2.0):
            axes.plot(one.time, sign * sigma, color=colour, lw=_WIDTH[one.method])
        if (known := good & np.isfinite(error)).any():
            largest = float(np.percentile(np.abs(error[known]), 99.0))
            reach = max(reach, 2.6 * float(np.median(sigma[known])), 1.1 * largest)
        position = np.full(np.count_nonzero(~good), 0.97 - 0.05 * number)
        axes.plot(
            one.time[~good],
            position,
            "|",
            color=colour,
            ms=4.0,
            mew=0.7,
            transform=axes.get_xaxis_transform(),
        )
    axes.axhline(0.0, color=INK, lw=0.5)
    axes.set_ylim(-reach, reach)
    axes.margins(x=0.01)
    axes.spines[["top", "right"]].set_visible(False)


def draw_outlines(track: Track, series: Sequence[PoseSeries], path: str | Path) -> None:
    """Draw each object's outline at its last true and estimated poses, from the front and from above.

    The displacement between them is enlarged, by a factor that the picture names: it would not be seen otherwise.

    Parameters
    ----------
    track
        The run: it tells the targets on each object.
    series
        Poses; those of one object seen from another are not drawn. The first four objects are.
    path
        The PNG to write.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    own = [one for one in series if not one.relative_to]
    names = list(dict.fromkeys(one.name for one in own))[:_MOST_COLUMNS]
    wide = max(3.6 * len(names) + 0.3, 5.6)
    with drawing(path, (wide, 6.9)) as figure:
        grid = figure.subplots(2, len(names), squeeze=False, height_ratios=(1.6, 1.0))
        figure.subplots_adjust(
            left=0.7 / wide, right=1.0 - 0.15 / wide, top=0.885, bottom=0.125, wspace=0.28, hspace=0.26
        )
        for column, name in enumerate(names):
            targets = [target for target in track.targets if target.object == name]
            _object(grid[:, column], [one for one in own if one.name == name], targets)
        figure.text(0.7 / wide, 0.965, "Objects at true and estimated pose", size=10.5, weight="bold")
        figure.text(0.7 / wide, 0.938, "the last pose of each method; displacement enlarged", color=FAINT)
        methods = list(dict.fromkeys(one.method for one in own))
        _methods(figure, methods, (0.7 / wide, 0.012), with_truth=True)


def _object(
    panels: NDArray[np.object_], chosen: Sequence[PoseSeries], targets: Sequence[TrackTarget]
) -> None:
    """Draw one object into two panels: x over y as the scanner sees it, and x over z from above."""
    lines = _lines(targets)
    size = float(np.ptp(np.concatenate(lines), axis=0).max())
    last = {}
    for one in chosen:
        good = np.flatnonzero((one.status == PoseStatus.VALID) & np.isfinite(one.truth_position).all(axis=1))
        if good.size:
            last[one.method] = (one, int(good[-1]))
    front, above = panels
    if not last:
        front.set_title(
            f"{plot_label(chosen[0].name)}: no valid pose", loc="left", fontsize=8.0, weight="bold"
        )
        for axes in panels:
            axes.set_axis_off()
        return
    pairs = {method: [_placed(one, row, line) for line in lines] for method, (one, row) in last.items()}
    apart = max(float(np.abs(here - true).max()) for both in pairs.values() for here, true in both)
    factor = _round(_APART * size / apart) if apart > 0.0 else 1.0
    newest = max(last, key=lambda method: last[method][0].time[last[method][1]])
    for axes, second in ((front, 1), (above, 2)):
        for _, true in pairs[newest]:
            axes.plot(true[:, 0], true[:, second], color=INK, lw=1.3, zorder=1)
        for method, both in pairs.items():
            for (here, then), (_, true) in zip(both, pairs[newest], strict=True):
                shown = true + factor * (here - then)
                axes.plot(
                    shown[:, 0], shown[:, second], color=METHOD_COLOUR[method], lw=_WIDTH[method], zorder=2
                )
        axes.set_aspect("equal", adjustable="datalim")
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_xlabel("x [m]")
        axes.set_ylabel("y [m]" if second == 1 else "z [m]")
    front.invert_yaxis()
    time = max(one.time[row] for one, row in last.values())
    front.set_title(
        f"{plot_label(chosen[0].name)} at {time:.2f} s, × {factor:g}", loc="left", fontsize=8.0, weight="bold"
    )


def _lines(targets: Sequence[TrackTarget]) -> list[Array]:
    """Return the rims of an object's targets and the rectangle around them, along its axes [m], each (n, 3)."""
    centres = np.array([target.centre for target in targets])
    rims = []
    for target, centre in zip(targets, centres, strict=True):
        radius = 0.5 * target.appearance.diameter
        flat = [np.cos(_TURN), np.sin(_TURN), np.zeros_like(_TURN)]
        rims.append(centre + radius * np.stack(flat, axis=1))
    every = np.concatenate(rims)
    (left, upper, near), (right, lower, far) = every.min(axis=0), every.max(axis=0)
    corners = [(left, upper), (right, upper), (right, lower), (left, lower), (left, upper)]
    middle = 0.5 * (near + far)
    return [np.array([(x, y, middle) for x, y in corners]), *rims]


def _placed(series: PoseSeries, row: int, points: Array) -> tuple[Array, Array]:
    """Return points of an object at the estimated and at the true pose, each (n, 3)."""
    return (
        points @ series.rotation[row].T + series.position[row],
        points @ series.truth_rotation[row].T + series.truth_position[row],
    )


def _round(factor: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20, … that is not larger; at least 1."""
    if factor < 1.0:
        return 1.0
    ten = 10.0 ** np.floor(np.log10(factor))
    return float(max(step * ten for step in (1.0, 2.0, 5.0) if step * ten <= factor * (1.0 + 1e-12)))


def _methods(
    figure: Figure, methods: Sequence[str], corner: tuple[float, float], with_truth: bool = False
) -> None:
    handles = [
        Line2D([], [], color=METHOD_COLOUR[method], marker=_MARK[method], ms=3.5, lw=1.2, label=method)
        for method in methods
    ]
    if with_truth:
        handles.append(Line2D([], [], color=INK, lw=1.3, label="true"))
    figure.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=corner,
        ncols=5,
        borderaxespad=0.0,
        borderpad=0.0,
        fontsize=7.5,
    )
