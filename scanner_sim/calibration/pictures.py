"""Pictures of a self-calibration: the field, what is left of the readings, and what became of the parameters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from scanner_sim.calibration.network import Field
from scanner_sim.calibration.selfcal import SelfCalibrated
from scanner_sim.calibration.starts import fit_board
from scanner_sim.products.pictures.style import FAINT, INK, drawing, plot_label, ruled
from scanner_sim.ranging.believed import believed_points

Array = NDArray[np.float64]

_BOARDS, _STATION, _BEFORE, _AFTER = "viridis", "#d98e4a", "#c9d6de", "#2b6f8f"
_MOST_NAMED = 12
"""Boards that a legend names."""
_CENTRE = 3.0
"""Residuals over σ at which the colours of residuals end."""


def draw_field(result: SelfCalibrated, path: str | Path) -> None:
    """Draw targets and stations where the adjustment found them, from above and from the side.

    Held-out boards stand where a calibrated station sees them.
    """
    field, now = result.field, result.adjusted.unknowns
    boards = {
        name: field.targets.places[field.targets.board == number] @ now.boards.rotation[number].T
        + now.boards.position[number]
        for number, name in enumerate(field.targets.boards)
    }
    held = _held_out_boards(result)
    with drawing(path, (7.6, 4.2), layout="constrained") as figure:
        for axes, (across, upward, title) in zip(
            figure.subplots(1, 2), ((0, 2, "from above"), (2, 1, "from the side")), strict=True
        ):
            colours = _colours(len(boards))
            for (name, places), colour in zip(boards.items(), colours, strict=True):
                axes.plot(
                    places[:, across], places[:, upward], "o", ms=3.2, color=colour, label=plot_label(name)
                )
            for name, places in held.items():
                label = f"{plot_label(name)}, held out"
                axes.plot(
                    places[:, across], places[:, upward], "o", ms=3.4, mfc="none", color=FAINT, label=label
                )
            _stations(axes, result, across, upward)
            axes.set_aspect("equal", adjustable="datalim")
            axes.set(xlabel=f"{'xyz'[across]} [m]", ylabel=f"{'xyz'[upward]} [m]")
            axes.set_title(f"The field {title}", loc="left", weight="bold", size=9.5)
            if upward == 1:
                axes.invert_yaxis()
            ruled(axes)
        if len(boards) + len(held) <= _MOST_NAMED:
            figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=6)


def _stations(axes: Axes, result: SelfCalibrated, across: int, upward: int) -> None:
    poses = result.adjusted.unknowns.stations
    at, ahead, aside = poses.position, poses.rotation[:, :, 2], poses.rotation[:, :, 0]
    axes.plot(at[:, across], at[:, upward], "^", ms=6, color=_STATION, label="station")
    reach = 0.12 * float(np.ptp(np.concatenate([at[:, across], at[:, upward]]))) + 0.3
    for direction, width in ((ahead, 1.4), (aside, 0.7)):
        ends = at + reach * direction
        lines = np.stack([at, ends], axis=1)
        for line in lines:
            axes.plot(line[:, across], line[:, upward], color=_STATION, lw=width)
    # From the side they stand one behind the other.
    named = result.field.stations if across == 0 else ()
    for name, place in zip(named, at, strict=False):
        offset = (place[across], place[upward])
        axes.annotate(plot_label(name), offset, xytext=(5, 4), textcoords="offset points", color=INK, size=7)


def _held_out_boards(result: SelfCalibrated) -> dict[str, Array]:
    """Return the targets of boards that only held-out sightings know, as one calibrated station sees each."""
    found: dict[str, Array] = {}
    held, poses = result.held, result.adjusted.unknowns.stations
    if held is None:
        return found
    points = _points(held, result)
    seen = held.sightings
    for station, number, chosen in held.views():
        name, here = held.targets.boards[number], held.stations[station]
        known = name in result.field.targets.boards or name in found or here not in result.field.stations
        if known:
            continue
        own = result.field.stations.index(here)
        turn, shift, _ = fit_board(held.targets.places[seen.target[chosen]], points[chosen])
        places = held.targets.places[held.targets.board == number] @ turn.T + shift
        found[name] = places @ poses.rotation[own].T + poses.position[own]
    return found


def draw_residuals(result: SelfCalibrated, path: str | Path) -> None:
    """Draw what is left of the readings over their σ: over the field of view, and against range by board."""
    field, residuals = result.field, result.adjusted.residuals
    seen = field.sightings
    theta, phi = np.rad2deg(seen.readings.theta), np.rad2deg(seen.readings.phi)
    reach = np.linalg.norm(_points(field, result), axis=1)
    board = field.targets.board[seen.target]
    with drawing(path, (7.6, 6.6), layout="constrained") as figure:
        rows = figure.subplots(3, 2, sharex="col", width_ratios=(1.0, 1.25))
        for row, (left, right) in enumerate(rows):
            name = ("Θ", "φ", "range reading")[row]
            dots = left.scatter(
                theta,
                phi,
                c=residuals[:, row],
                s=9,
                cmap="RdBu_r",
                vmin=-_CENTRE,
                vmax=_CENTRE,
                lw=0.2,
                ec=FAINT,
            )
            left.set(ylabel="φ [°]")
            left.set_aspect("equal", adjustable="datalim")
            left.invert_yaxis()
            for number, colour in enumerate(_colours(len(field.targets.boards))):
                own = board == number
                right.plot(
                    reach[own],
                    residuals[own, row],
                    "o",
                    ms=2.6,
                    color=colour,
                    label=plot_label(field.targets.boards[number]),
                )
            right.axhline(0.0, color=FAINT, lw=0.6, zorder=0)
            for level in (-2.0, 2.0):
                right.axhline(level, color=FAINT, lw=0.5, ls=":", zorder=0)
            right.set_ylabel(f"{name}: residual / σ")
            ruled(right)
        rows[0, 0].set_title("Residuals over the field of view", loc="left", weight="bold", size=9.5)
        rows[0, 1].set_title("Residuals against range", loc="left", weight="bold", size=9.5)
        rows[2, 0].set_xlabel("Θ [°]")
        rows[2, 1].set_xlabel("range [m]")
        figure.colorbar(
            dots, ax=list(rows[:, 0]), location="left", label="residual / σ", shrink=0.6, pad=0.02
        )
        if len(field.targets.boards) <= _MOST_NAMED:
            handles = rows[0, 1].get_legend_handles_labels()
            figure.legend(*handles, loc="outside lower center", ncols=6)


def draw_parameters(result: SelfCalibrated, path: str | Path) -> None:
    """Draw values and σ over tolerances, the correlations, and the misfit before and after."""
    names = [name.replace("_", " ") for name in result.field.sought]
    tall = 1.9 + 0.24 * len(names)
    with drawing(path, (9.4, tall), layout="constrained") as figure:
        bars, matrix, misfits = figure.subplots(1, 3, width_ratios=(1.15, 1.0, 0.6))
        _bars(bars, result, names)
        _matrix(figure, matrix, result.correlations, names)
        _misfits(misfits, result)


def _bars(axes: Axes, result: SelfCalibrated, names: list[str]) -> None:
    scale = result.field.tolerances
    at = np.arange(len(names))
    axes.barh(at, np.ones(len(at)), color=_BEFORE, height=0.74, label="tolerance")
    axes.barh(at, result.sigma / scale, color=_AFTER, height=0.42, label="σ after calibration")
    axes.plot(np.abs(result.values) / scale, at, "D", ms=3.4, color=_STATION, label="|value|")
    axes.set_yticks(at, names)
    axes.invert_yaxis()
    axes.set(xscale="log", xlabel="over the tolerance")
    axes.legend(loc="lower center", bbox_to_anchor=(0.4, 1.0), ncols=3, handlelength=1.2, columnspacing=1.0)
    ruled(axes)


def _matrix(figure: Figure, axes: Axes, values: Array, names: list[str]) -> None:
    image = axes.imshow(values, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
    axes.set_xticks(np.arange(len(names)), names, rotation=90)
    axes.set_yticks(np.arange(len(names)), names if len(names) > 14 else [""] * len(names))
    axes.set_title("Correlations", loc="left", weight="bold", size=9.5)
    figure.colorbar(image, ax=axes, shrink=0.7)


def _misfits(axes: Axes, result: SelfCalibrated) -> None:
    shown = [("fitted", result.fitted)]
    if result.held_out is not None:
        shown.append(("held out", result.held_out))
    at = np.arange(len(shown))
    before, after = ([getattr(one, key) for _, one in shown] for key in ("designed", "calibrated"))
    axes.bar(at - 0.2, before, 0.38, color=_BEFORE, label="as designed")
    axes.bar(at + 0.2, after, 0.38, color=_AFTER, label="calibrated")
    for place, value in zip([*(at - 0.2), *(at + 0.2)], [*before, *after], strict=True):
        axes.annotate(f"{value:.3g}", (place, value), ha="center", va="bottom", size=7)
    axes.axhline(1.0, color=FAINT, lw=0.7, ls="--")
    axes.set_xticks(at, [name for name, _ in shown])
    axes.set(
        yscale="log", ylabel="rms misfit of the boards / noise", ylim=(0.5, 2.0 * max(*before, *after, 1.0))
    )
    axes.legend(loc="lower center", bbox_to_anchor=(0.45, 1.0), ncols=1)
    ruled(axes)


def _points(field: Field, result: SelfCalibrated) -> Array:
    """Return the points of sightings as the calibrated instrument has them, in the scanner frame."""
    parameters = result.adjusted.unknowns.parameters
    return believed_points(field.sightings.readings, field.design, parameters, field.encoder_period).point


def _colours(count: int) -> list[tuple[float, ...]]:
    return [colormaps[_BOARDS](share) for share in np.linspace(0.0, 0.85, count)]
