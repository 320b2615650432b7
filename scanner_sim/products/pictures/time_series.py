"""The pictures of shots in one direction: ranges and statuses over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from scanner_sim.foundation.status import Status
from scanner_sim.products.layers import numbered
from scanner_sim.products.pictures.style import FAINT, INK, STATUS_COLOUR, drawing, plot_label, ruled
from scanner_sim.products.shots import ShotTable

_SIZE = (7.4, 4.6)
_MOST_DOTS = 20_000
"""Dots of a picture; of more shots every second, third … is drawn."""
_SIGMAS = 5.0
"""Errors that are shown, in σ of the worst 5 % of the shots."""
_MEASURED = "#2b7a8c"


def in_one_direction(shots: ShotTable) -> bool:
    """Return whether all shots point alike, so that dots at their angles would hide one another."""
    return not np.ptp(shots.theta) and not np.ptp(shots.phi)


def draw_range_over_time(shots: ShotTable, path: str | Path) -> None:
    """Draw measured and true ranges over time, and below them by how much they differ, beside ±σ."""
    some, (unit, scale) = _drawn(shots), _unit(shots["range_m"])
    time, ranges, sigma, truth = (
        values[some].astype(np.float64)
        for values in (shots.time, shots["range_m"], shots["sigma_range_m"], shots["truth.range_m"])
    )
    with drawing(path, _SIZE, layout="constrained") as figure:
        whole, error = figure.subplots(2, sharex=True, height_ratios=(3, 2))
        whole.plot(time, scale * truth, color=INK, lw=0.8, label="truth", zorder=3)
        whole.plot(time, scale * ranges, ".", ms=2.5, color=_MEASURED, label="measured")
        error.fill_between(time, -1e3 * sigma, 1e3 * sigma, color=_MEASURED, alpha=0.25, lw=0, label="±σ")
        error.plot(time, 1e3 * (ranges - truth), ".", ms=2.5, color=_MEASURED)
        error.set(xlabel="time [s]", ylabel="measured − truth [mm]", ylim=_errors_shown(1e3 * sigma))
        whole.set(ylabel=f"range [{unit}]")
        for axes in (whole, error):
            ruled(axes)
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        _headed(whole, shots, "Range")


def draw_status_over_time(shots: ShotTable, path: str | Path) -> None:
    """Draw the status of each shot over time, one row for each that is present."""
    some = _drawn(shots)
    status, present = shots["status"][some], [code for code in Status if (shots["status"] == code).any()]
    with drawing(path, (_SIZE[0], 1.2 + 0.32 * len(present)), layout="constrained") as figure:
        axes = figure.subplots()
        for row, code in enumerate(present):
            time = shots.time[some][status == code]
            colour = _MEASURED if code is Status.VALID else STATUS_COLOUR.get(code, FAINT)
            axes.plot(time, np.full(time.shape, row), "|", ms=9, color=colour)
        shares = [100.0 * float(np.mean(shots["status"] == code)) for code in present]
        names = [f"{code.name} {share:.3g} %" for code, share in zip(present, shares, strict=True)]
        axes.set(yticks=range(len(present)), yticklabels=names, ylim=(len(present) - 0.5, -0.5))
        axes.set(xlabel="time [s]")
        ruled(axes)
        _headed(axes, shots, "Status")


def _drawn(shots: ShotTable) -> NDArray[np.intp]:
    return np.arange(0, len(shots), -(-len(shots) // _MOST_DOTS))


def _errors_shown(sigma: NDArray[np.float64]) -> tuple[float, float]:
    """Return the ends of an axis of errors: on edges some are so large that others would not be seen beside them."""
    known = sigma[np.isfinite(sigma)]
    end = _SIGMAS * float(np.percentile(known, 95.0)) if known.size else 1.0
    return -end, end


def _unit(ranges: NDArray[np.float32]) -> tuple[str, float]:
    """Return a unit in which ranges can be read, and how many of it make a metre."""
    known = ranges[np.isfinite(ranges)]
    return ("mm", 1e3) if known.size and known.max() < 1.0 else ("m", 1.0)


def _headed(axes: Axes, shots: ShotTable, title: str) -> None:
    names = ", ".join(map(plot_label, list(numbered(shots.objects).values())[:3]))
    theta, phi = np.degrees(shots.theta[0]), np.degrees(shots.phi[0])
    about = f"{names}  ·  Θ {theta:.3g}°, φ {phi:.3g}°  ·  {len(shots):,} shots in {shots.time[-1]:.3g} s"
    about += f"  ·  seed {shots.seed}  ·  {100.0 * shots.valid.mean():.1f} % valid"
    axes.set_title(title, loc="left", weight="bold", size=10.5, pad=18)
    axes.text(0.0, 1.03, about.removeprefix("  ·  "), transform=axes.transAxes, color=FAINT, fontsize=7.0)
