"""A tracking run in pictures: errors over time with their σ, and all targets in the field of view."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patheffects import AbstractPathEffect, withStroke
from numpy.typing import NDArray

from scanner_sim.products.image import RangeImage
from scanner_sim.products.pictures.style import FAINT, INK, drawing, plot_label
from scanner_sim.tracking.record import PatternRecord, Track, TrackStatus
from scanner_sim.tracking.state import TrackMode

Array = NDArray[np.float64]

STATE_COLOUR = {
    TrackMode.SEARCH: "#d0522f",
    TrackMode.ACQUIRE: "#e0b02c",
    TrackMode.TRACK: "#3f8558",
    TrackMode.LOST: "#7a3b8f",
}
"""Colour of each state, the same in every picture."""

_LINE, _BAND = "#0b4f8a", "#bcd3e6"
_MOST_ROWS = 8
_QUANTITIES = (("Θ error [µrad]", 1e6), ("φ error [µrad]", 1e6), ("range error [mm]", 1e3))
_MARGIN = 0.12
"""Free space around the targets, over their extent."""
_LEAST = 0.012
"""Smallest half-width of the field that is drawn [rad]."""


def draw_track(track: Track, path: str | Path) -> None:
    """Draw measured less true (Θ, φ, R) of each target over time, with ±2σ, and the tracker's state as a band.

    The first eight targets are drawn. Ticks at the top mark visits at which the target was not measured.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    shown = track.targets[:_MOST_ROWS]
    tall = 1.15
    high = 0.78 + tall * len(shown) + 0.62
    with drawing(path, (10.0, high)) as figure:
        grid = figure.subplots(len(shown), 3, sharex=True, squeeze=False)
        figure.subplots_adjust(
            left=0.075, right=0.99, top=1.0 - 0.78 / high, bottom=0.62 / high, wspace=0.24, hspace=0.22
        )
        for row, target in enumerate(shown):
            records = track.of(target.name)
            for axis, axes in enumerate(grid[row]):
                _errors(axes, records, axis)
            grid[row, 0].set_title(plot_label(target.name), loc="left", fontsize=8.0, weight="bold", pad=3.0)
        for axis, axes in enumerate(grid[-1]):
            axes.set_xlabel("time [s]")
            grid[0, axis].text(1.0, 1.04, _QUANTITIES[axis][0], transform=grid[0, axis].transAxes, ha="right")
        figure.text(0.075, 1.0 - 0.24 / high, "Targets over time: measured − true", size=10.5, weight="bold")
        rest = len(track.targets) - len(shown)
        more = f"  ·  not drawn: {rest} more" if rest else ""
        about = f"points: measured visits  ·  band: ±2σ  ·  ticks: not measured  ·  at the foot: state{more}"
        figure.text(0.075, 1.0 - 0.46 / high, about, color=FAINT)
        _states(figure, 0.10 / high)


def _errors(axes: Axes, records: Sequence[PatternRecord], axis: int) -> None:
    measured = [record for record in records if record.status is TrackStatus.MEASURED]
    scale = _QUANTITIES[axis][1]
    time = np.array([record.time for record in measured])
    error = scale * np.array([record.position[axis] - record.truth[axis] for record in measured])
    sigma = scale * np.array([np.sqrt(record.covariance[axis, axis]) for record in measured])
    reach = 1.0
    if len(measured):
        axes.fill_between(time, -2.0 * sigma, 2.0 * sigma, color=_BAND, lw=0.0)
        axes.plot(time, error, ".", color=_LINE, ms=2.6, mew=0.0)
        reach = 1.2 * max(3.0 * float(np.median(sigma)), float(np.percentile(np.abs(error), 99.5)))
    axes.axhline(0.0, color=INK, lw=0.5)
    axes.set_ylim(-1.25 * reach, 1.1 * reach)
    missed = [record.time for record in records if record.status is not TrackStatus.MEASURED]
    across = axes.get_xaxis_transform()
    axes.plot(missed, np.full(len(missed), 0.97), "|", color=FAINT, ms=4.0, mew=0.6, transform=across)
    for mode, start, stop in _stretches(records):
        axes.broken_barh([(start, stop - start)], (0.0, 0.045), color=STATE_COLOUR[mode], transform=across)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.0)


def _stretches(records: Sequence[PatternRecord]) -> list[tuple[TrackMode, float, float]]:
    """Return states with the times between which they last."""
    found: list[tuple[TrackMode, float, float]] = []
    for mode, group in groupby(records, key=lambda record: record.mode):
        times = [record.time for record in group]
        if found:
            found[-1] = (*found[-1][:2], times[0])
        found.append((mode, times[0], times[-1]))
    return found


def _states(figure: Figure, height: float) -> None:
    handles = [Patch(color=colour, label=mode.value) for mode, colour in STATE_COLOUR.items()]
    figure.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(0.075, height), ncols=4, borderaxespad=0.0, borderpad=0.0,
        handlelength=1.4, fontsize=7.5,
    )  # fmt: skip


def draw_field(track: Track, path: str | Path, backdrop: RangeImage | None = None) -> None:
    """Draw all targets as the scanner sees them, each with its last pattern and its last of a search (paper, Figure 5).

    Parameters
    ----------
    track
        The run.
    path
        The PNG to write.
    backdrop
        An image of the scene; its signal is drawn in grey levels behind the targets. None draws a sketch.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    last = [track.of(target.name)[-1] for target in track.targets if track.of(target.name)]
    left, right, upper, lower = field_of(track)
    wide, tall = right - left, lower - upper
    scale = 7.2 / max(wide, tall)
    size = (max(scale * wide, 3.6) + 0.9, scale * tall + 1.35)
    with drawing(path, size) as figure:
        axes = figure.add_axes((0.7 / size[0], 0.75 / size[1], 1.0 - 0.9 / size[0], 1.0 - 1.35 / size[1]))
        ink = INK
        if backdrop is not None:
            ink = "white"
            _backdrop(axes, backdrop)
        for target in track.targets:
            records = [record for record in track.of(target.name) if np.isfinite(record.truth).all()]
            axes.plot(
                *np.degrees([record.truth[:2] for record in records]).reshape(-1, 2).T,
                color="#5fc3d6",
                lw=1.0,
            )
        for target in track.targets:
            looking = [one for one in track.of(target.name) if one.mode in (TrackMode.SEARCH, TrackMode.LOST)]
            if looking:
                _path(axes, looking[-1], lw=0.6, ls=(0, (4, 3)))
        for record in last:
            _visit(axes, record, ink)
        axes.set(xlim=np.degrees((left, right)), ylim=np.degrees((lower, upper)), aspect="equal")
        axes.set(xlabel="Θ [°]", ylabel="φ [°]")
        figure.text(
            0.7 / size[0], 1.0 - 0.26 / size[1], "Targets in the field of view", size=10.5, weight="bold"
        )
        about = "each target's last pattern; dashed: its last of search or loss  ·  +: measured  ·  blue: true path"
        figure.text(0.7 / size[0], 1.0 - 0.46 / size[1], about, color=FAINT, fontsize=7.0)
        _states(figure, 0.10 / size[1])


def field_of(track: Track) -> tuple[float, float, float, float]:
    """Return the part of the field that holds all patterns and targets: ends of Θ, then of φ [rad]."""
    spots = [record.centre + sign * record.amplitude for record in track.records for sign in (-1.0, 1.0)]
    spots += [record.truth[:2] for record in track.records]
    positions = np.array([spot for spot in spots if np.isfinite(spot).all()]).reshape(-1, 2)
    if not len(positions):
        return -0.5, 0.5, -0.5, 0.5
    low, high = positions.min(axis=0), positions.max(axis=0)
    margin = np.maximum(_MARGIN * (high - low).max(), _LEAST - 0.5 * (high - low))
    low, high = low - margin, high + margin
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def _path(axes: Axes, record: PatternRecord, **style: Any) -> Array:
    """Draw the pattern of a visit, or, where its voxels were not kept, a circle of its amplitude; return its angles."""
    if record.samples.time.shape[1]:
        angles = np.stack([record.samples.theta[0], record.samples.phi[0]])
    else:
        turn = np.linspace(0.0, 2.0 * np.pi, 91)
        angles = record.centre[:, None] + record.amplitude * np.stack([np.cos(turn), np.sin(turn)])
    axes.plot(*np.degrees(angles), color=STATE_COLOUR[record.mode], **style)
    return np.asarray(angles)


def _visit(axes: Axes, record: PatternRecord, ink: str) -> None:
    """Draw the last visit to a target: its pattern, the measured centre and the name."""
    angles = _path(axes, record, lw=0.9)
    if record.status is TrackStatus.MEASURED:
        axes.plot(*np.degrees(record.position[:2]), "+", color=ink, ms=5.0, mew=0.9)
    x, y = np.degrees([angles[0].max(), angles[1].mean()])
    rim: list[AbstractPathEffect] = [withStroke(linewidth=2.0, foreground="black")] if ink == "white" else []
    label = axes.annotate(
        plot_label(record.target),
        (x, y),
        (4.0, 0.0),
        textcoords="offset points",
        va="center",
        color=ink,
        fontsize=7.0,
    )
    label.set_path_effects(rim)


def _backdrop(axes: Axes, image: RangeImage) -> None:
    signal = np.where(image["Y"] > 0.0, image["Y"], np.nan)
    finite = signal[np.isfinite(signal)]
    low, high = np.log10(np.percentile(finite, (1.0, 99.5))) if finite.size else (0.0, 1.0)
    levels = np.clip((np.log10(signal) - low) / max(high - low, 0.3), 0.0, 1.0)
    theta, phi = np.degrees(image.theta), np.degrees(image.phi)
    across, down = (0.5 * abs(angles[-1] - angles[0]) / (angles.size - 1) for angles in (theta, phi))
    extent = (theta[0] - across, theta[-1] + across, phi[-1] + down, phi[0] - down)
    # Dimmed, so that the patterns stand out.
    axes.imshow(
        0.75 * np.nan_to_num(levels), cmap="gray", vmin=0.0, vmax=1.0, extent=extent, interpolation="nearest"
    )
