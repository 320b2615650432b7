"""One pattern over its target, as in the paper's Figure 4: what was hit, the fitted circle and the true one.

Angles are deflections about the axes that the instrument believes: those of voxels are so, and points become so.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from scanner_sim.products.pictures.style import (
    FAINT,
    INK,
    RANGE_MAP,
    SIGNAL_MAP,
    drawing,
    plot_label,
)
from scanner_sim.tracking.centroid import Centroid, circle_fit
from scanner_sim.tracking.record import PatternRecord, Track, TrackStatus
from scanner_sim.tracking.response import Response, target_response
from scanner_sim.tracking.state import TrackMode

Array = NDArray[np.float64]

Rim = Callable[[PatternRecord], Array]
"""What gives the true outline of a visit's target, (Θ, φ) [rad], shape (n, 2)."""

_FIT, _TRUTH = "#c8401f", "#1f6f8b"
_FILLED, _OPEN = 26.0, 9.0
_TURN = np.linspace(0.0, 2.0 * np.pi, 181)


def telling_visit(track: Track) -> int | None:
    """Return the number of the visit that shows a pattern best, or None where no voxels were kept.

    The last one at which a followed target was measured; else the last with voxels at all.
    """
    kept = [record for record in track.records if record.samples.time.shape[1]]
    followed = [
        record for record in kept if record.status is TrackStatus.MEASURED and record.mode is TrackMode.TRACK
    ]
    return (followed or kept)[-1].number if kept else None


def response_of(track: Track, record: PatternRecord) -> Response:
    """Return which voxels of a visit hit, judged again from the voxels as the tracker does.

    The range gate lies about the measured range, or about the expected one where nothing was found.
    """
    appearance = next(target for target in track.targets if target.name == record.target)
    middle = record.position[2] if np.isfinite(record.position[2]) else appearance.expected[2]
    depth = appearance.appearance.depth
    return target_response(record.samples, appearance.appearance.kind, (middle - depth, middle + depth))


def draw_pattern(track: Track, visit: int, path: str | Path, rim: Rim | None = None) -> None:
    """Draw the voxels of one visit by signal and by range; and how far the centre lies from the truth.

    Parameters
    ----------
    track
        The run.
    visit
        Number of a visit whose voxels were kept.
    path
        The PNG to write.
    rim
        Gives the true outline; without it the circle that a target facing the scanner would show.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    record = next(record for record in track.records if record.number == visit)
    response = response_of(track, record)
    circle = circle_fit(record.samples, response)
    with drawing(path, (11.4, 4.3)) as figure:
        positions = ((0.055, 0.13, 0.25, 0.67), (0.43, 0.13, 0.25, 0.67), (0.82, 0.30, 0.165, 0.43))
        by_signal, by_range, centre = (figure.add_axes(position) for position in positions)
        outline = _outline(track, record) if rim is None else rim(record)
        samples = record.samples
        measured = samples.valid[0]
        _voxels(
            by_signal,
            record,
            response,
            1e-3 * samples.signal[0],
            measured,
            SIGNAL_MAP,
            "signal [10³ electrons]",
        )
        about = np.nanmedian(samples.range[0][measured]) if measured.any() else 0.0
        _voxels(
            by_range, record, response, 1e3 * (samples.range[0] - about), measured, RANGE_MAP,
            f"range about {about:.4f} m [mm]",
        )  # fmt: skip
        for axes in (by_signal, by_range):
            _circles(axes, record, _sight(track, record.point), circle, outline)
        by_signal.legend(
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            ncols=4,
            fontsize=7.0,
            borderpad=0.0,
            columnspacing=1.2,
        )
        _centre(centre, record)
        figure.text(0.055, 0.945, f"Pattern over {plot_label(record.target)}", size=10.5, weight="bold")
        figure.text(0.055, 0.90, _about(record, response), color=FAINT)


def _about(record: PatternRecord, response: Response) -> str:
    hits, counted = int(response.hit.sum()), int(response.used.sum())
    return (
        f"visit {record.number} at {record.time:.3f} s in state {record.mode.value}  ·  {hits} of {counted} voxels hit"
        f"  ·  {record.status.sentence}"
    )


def _away(record: PatternRecord, angles: Array) -> Array:
    """Return angles (n, 2) about the commanded centre [mrad]."""
    return 1e3 * (angles - record.centre)


def _voxels(
    axes: Axes,
    record: PatternRecord,
    response: Response,
    value: Array,
    shown: NDArray[np.bool_],
    colours: str,
    label: str,
) -> None:
    """Draw the path and its voxels: hits large and rimmed, misses small, what was not measured as a cross."""
    samples, hit = record.samples, response.hit[0]
    x, y = _away(record, np.stack([samples.theta[0], samples.phi[0]], axis=1)).T
    axes.plot(x, y, color="#c9ced4", lw=0.7, zorder=1)
    low: float | None = None
    high: float | None = None
    if shown.any():
        low, high = np.percentile(value[shown], (1.0, 99.0))
        high = max(high, low + 1e-6)
    for chosen, size, edge in ((shown & ~hit, _OPEN, "none"), (shown & hit, _FILLED, INK)):
        dots = axes.scatter(
            x[chosen], y[chosen], size, value[chosen], cmap=colours, vmin=low, vmax=high, edgecolors=edge,
            linewidths=0.5, zorder=3,
        )  # fmt: skip
    axes.scatter(x[~shown], y[~shown], 12.0, "#9aa3ac", marker="x", linewidths=0.7, zorder=2)
    axes.set_aspect("equal")
    axes.invert_yaxis()
    theta, phi = np.degrees(record.centre)
    axes.set_xlabel(f"Θ about {theta:.4f}° [mrad]")
    axes.set_ylabel(f"φ about {phi:.4f}° [mrad]", labelpad=1.0)
    box = axes.get_position()
    bar = axes.figure.add_axes((box.x1 + 0.008, box.y0, 0.009, box.height))
    axes.figure.colorbar(dots, cax=bar, label=label)


def _circles(axes: Axes, record: PatternRecord, measured: Array, circle: Centroid, outline: Array) -> None:
    if np.isfinite(measured).all():
        x, y = _away(record, measured[None])[0]
        axes.plot(x, y, "+", color=_FIT, ms=7.0, mew=1.2, zorder=5)
        if circle.found[0]:
            radius = 1e3 * circle.radius[0]
            axes.plot(
                x + radius * np.cos(_TURN), y + radius * np.sin(_TURN), color=_FIT, lw=1.2, zorder=4, label="fit"
            )  # fmt: skip
    axes.plot(*_away(record, outline).T, color=_TRUTH, lw=1.2, ls=(0, (4, 2)), zorder=4, label="truth")
    axes.scatter([], [], _FILLED, "white", edgecolors=INK, linewidths=0.5, label="hit")
    axes.scatter([], [], _OPEN, FAINT, label="miss")


def _sight(track: Track, point: Array) -> Array:
    """Return the deflections (Θ, φ) at a point (3,) [m], shape (2,) [rad]."""
    return np.array(track.axes.sight_of(*point)[1:])


def _outline(track: Track, record: PatternRecord) -> Array:
    appearance = next(target.appearance for target in track.targets if target.name == record.target)
    radius = 0.5 * appearance.diameter / record.truth[2]
    round_: Array = _sight(track, record.truth_point) + radius * np.stack(
        [np.cos(_TURN), np.sin(_TURN)], axis=1
    )
    return round_


def _centre(axes: Axes, record: PatternRecord) -> None:
    """Show the centre about the truth, with the ellipses of one and two σ."""
    axes.set_title("centre about the truth", loc="left", fontsize=8.0)
    axes.set(xlabel="Θ [µrad]", ylabel="φ [µrad]")
    axes.yaxis.labelpad = 1.0
    axes.plot(0.0, 0.0, "x", color=_TRUTH, ms=7.0, mew=1.2)
    axes.set_aspect("equal")
    axes.spines[["top", "right"]].set_visible(False)
    axes.locator_params(nbins=4)
    error = 1e6 * (record.position - record.truth)[:2]
    if not np.isfinite(error).all():
        axes.text(0.5, 0.6, "not found", transform=axes.transAxes, ha="center", color=FAINT)
        axes.set(xlim=(-1.0, 1.0), ylim=(1.0, -1.0), xticks=[], yticks=[])
        return
    axes.plot(*error, "+", color=_FIT, ms=7.0, mew=1.2)
    ring = _ellipse(record.covariance[:2, :2])
    if ring is None:
        axes.text(0.5, 0.06, "σ not known", transform=axes.transAxes, ha="center", color=FAINT)
        ring = np.zeros((2, 1))
    for times, shade in ((1.0, 1.0), (2.0, 0.45)):
        axes.plot(error[0] + times * ring[0], error[1] + times * ring[1], color=_FIT, lw=0.9, alpha=shade)
    reach = 1.15 * max(float(np.abs(error).max()) + 2.0 * float(np.abs(ring).max()), 1e-3)
    axes.set(xlim=(-reach, reach), ylim=(reach, -reach))


def _ellipse(covariance: Array) -> Array | None:
    """Return the ellipse of one σ [µrad], shape (2, n); None where it is not known, or wider than half a turn."""
    if not (np.abs(covariance) < np.pi**2).all():
        return None
    squares, along = np.linalg.eigh(1e12 * covariance)
    axes = np.sqrt(np.maximum(squares, 0.0))[:, None] * np.stack([np.cos(_TURN), np.sin(_TURN)])
    return np.asarray(along @ axes)
