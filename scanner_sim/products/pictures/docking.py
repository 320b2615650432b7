"""The picture of a docking: true and estimated path, what the tracker did, errors and light."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from scanner_sim.products.pictures.style import FAINT, INK, drawing, plot_label, ruled
from scanner_sim.tracking.record import Track, TrackStatus
from scanner_sim.tracking.state import TrackMode

Array = NDArray[np.float64]

_SIZE = (8.4, 9.6)
_AXES = (("x", "#0b4f8a"), ("y", "#4fb3c8"), ("z", "#b4531a"))
_MODES = {
    TrackMode.SEARCH: "#d0522f",
    TrackMode.LOST: "#f0c24b",
    TrackMode.ACQUIRE: "#8fb3c9",
    TrackMode.TRACK: "#2b7a8c",
}
_LEAST_SIGMAS, _MOST_SIGMAS = 4.0, 8.0


@dataclass(frozen=True)
class Docking:
    """What is drawn beside a track, at n times.

    Attributes
    ----------
    time
        Ascending [s], shape (n,).
    truth, estimate, sigma
        Position of the object in the scanner's frame, as it is, as a filter has it, and that one's standard deviations
        [m], each of shape (n, 3); NaN where nothing is known.
    sun_visible
        Share of the Sun's light that arrives, shape (n,); None in the dark.
    """

    time: Array
    truth: Array
    estimate: Array
    sigma: Array
    sun_visible: Array | None = None


def draw_docking(track: Track, docking: Docking, path: str | Path) -> None:
    """Draw a docking over its time: range, path across, modes of each target, errors beside ±3σ, and the light."""
    with drawing(path, _SIZE, layout="constrained") as figure:
        heights = (2.2, 1.7, 0.35 * max(len(track.targets), 3), 2.2, 0.9)
        panels = figure.subplots(5, sharex=True, height_ratios=heights)
        time, truth, estimate = docking.time, docking.truth, docking.estimate
        panels[0].plot(time, truth[:, 2], color=INK, lw=1.0, label="truth", zorder=3)
        panels[0].plot(time, estimate[:, 2], color=_AXES[2][1], lw=2.2, alpha=0.6, label="filter")
        panels[0].set(ylabel="z, along the sight [m]", ylim=(0.0, None))
        for axis, (name, colour) in enumerate(_AXES[:2]):
            panels[1].plot(time, truth[:, axis], color=INK, lw=1.0, zorder=3)
            panels[1].plot(time, estimate[:, axis], color=colour, lw=2.2, alpha=0.6, label=name)
        panels[1].set(ylabel="across [m]")
        _modes(panels[2], track)
        _errors(panels[3], docking)
        _light(panels[4], docking)
        for axes in panels:
            ruled(axes)
            if axes.get_legend_handles_labels()[0]:
                axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
        panels[-1].set_xlabel("time [s]")
        measured = sum(record.status is TrackStatus.MEASURED for record in track.records)
        figure.suptitle(
            f"Docking: {len(track.records)} visits, {measured} measured, seed {track.seed}",
            ha="left",
            x=0.02,
        )


def _modes(axes: Axes, track: Track) -> None:
    """Draw a row for each target: in which mode each visit was made, and with black ticks what was not measured."""
    for row, target in enumerate(track.targets):
        own = track.of(target.name)
        for mode, colour in _MODES.items():
            time = [record.time for record in own if record.mode is mode]
            axes.plot(
                time, np.full(len(time), row), "|", ms=9, color=colour, label=mode.value if not row else None
            )
        missed = [record.time for record in own if record.status is not TrackStatus.MEASURED]
        axes.plot(
            missed,
            np.full(len(missed), row + 0.3),
            "|",
            ms=4,
            color=INK,
            label=None if row else "not measured",
        )
    names = [plot_label(target.name) for target in track.targets]
    axes.set(yticks=range(len(names)), yticklabels=names, ylim=(len(names) - 0.4, -0.6))


def _errors(axes: Axes, docking: Docking) -> None:
    """Draw the errors over σ: nothing of an approach from 30 m to 1.5 m fits on one scale of millimetres."""
    over = (docking.estimate - docking.truth) / docking.sigma
    for axis, (name, colour) in enumerate(_AXES):
        final = 1e3 * docking.sigma[-1, axis]
        axes.plot(
            docking.time, over[:, axis], lw=0.8, color=colour, label=f"{name}, σ {final:.2g} mm at the end"
        )
    for end in (-3.0, 3.0):
        axes.axhline(end, color=FAINT, lw=1.0, ls="--", label="±3σ" if end > 0.0 else None)
    largest = np.max(np.abs(over), initial=0.0, where=np.isfinite(over))
    reach = float(np.clip(np.ceil(largest), _LEAST_SIGMAS, _MOST_SIGMAS))
    axes.set(ylabel="error over σ", ylim=(-reach, reach))


def _light(axes: Axes, docking: Docking) -> None:
    """Draw the share of the Sun's light."""
    if docking.sun_visible is None:
        axes.text(0.5, 0.5, "no Sun", transform=axes.transAxes, ha="center", va="center", color=FAINT)
    else:
        axes.fill_between(docking.time, docking.sun_visible, color="#f0c24b", lw=0, label="Sun's light")
    axes.set(ylabel="light", ylim=(0.0, 1.1), yticks=(0.0, 1.0))
