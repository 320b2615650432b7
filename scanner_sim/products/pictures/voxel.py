"""The picture of one voxel: its line of pixels, and how the range came out of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from scanner_sim.products.pictures.style import FAINT, INK, drawing
from scanner_sim.products.voxel import VoxelRecord

_SIGNAL, _LIGHT, _PEAK, _TRUTH, _LIMIT = "#9fb3c8", "#b4531a", "#0b4f8a", "#111111", "#8a2f52"
_MARGIN = 12
"""Pixels shown on either side of what matters."""


def draw_voxel(record: VoxelRecord, path: str | Path) -> None:
    """Draw the line of a voxel: all of it in a strip, and the part with the peak enlarged.

    Bars are the digitised signal, the stepped line is the light without noise with one standard deviation of the
    noise about it. Detected and true position, threshold, window and saturation are marked, and the foot says
    what came out, with the residual in pixels and millimetres.
    """
    with drawing(path, (9.0, 6.0)) as figure:
        strip = figure.add_axes((0.085, 0.765, 0.885, 0.115))
        close = figure.add_axes((0.085, 0.225, 0.885, 0.435))
        unit, power = _electrons(record)
        first, last = _interesting(record)
        _bars(strip, record, unit)
        strip.set_xlim(-0.5, record.pixels - 0.5)
        strip.axvspan(
            first - 0.5, last + 0.5, facecolor="none", edgecolor=FAINT, linewidth=0.8, linestyle="--"
        )
        strip.set_ylabel(power)
        _bars(close, record, unit)
        _marks(close, record, unit)
        close.set_xlim(first - 0.5, last + 0.5)
        _height(close, record, first, last, unit)
        close.set_xlabel("pixel of the line sensor")
        close.set_ylabel(f"signal [{power} electrons]" if power else "signal [electrons]")
        close.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, fontsize=7.0, columnspacing=1.4)
        _detail(close, record)
        position = f"Voxel: row {record.row}, column {record.column}"
        figure.text(0.085, 0.945, position, size=10.5, weight="bold")
        aim = f"Θ {math.degrees(record.theta):.3f}°, φ {math.degrees(record.phi):.3f}°".replace("-", "−")
        figure.text(
            0.085, 0.905, f"{aim}  ·  estimator: {record.method}  ·  {record.status.sentence}", color=FAINT
        )
        for line, text in enumerate(outcome(record)):
            figure.text(0.085, 0.105 - 0.04 * line, text, size=8.5)


def outcome(record: VoxelRecord) -> tuple[str, str]:
    """Return two sentences: position and range, each with its σ, the truth and the residual."""
    pixel = _compared(
        "Position",
        record.peak_px,
        record.sigma_peak_px,
        record.truth_peak_px,
        record.residual_px,
        1.0,
        "pixel",
    )
    metre = _compared(
        "Range", record.range_m, record.sigma_range_m, record.truth_range_m, record.residual_m, 1e3, "mm"
    )
    return pixel, metre


def _compared(
    name: str, value: float, sigma: float, truth: float, residual: float, scale: float, small: str
) -> str:
    """Return a sentence on one quantity; ``small`` is the unit of σ and residual, ``scale`` of it per unit."""
    unit = "m" if small == "mm" else small
    known = f"true {truth:.4f} {unit}" if math.isfinite(truth) else "the chief ray hits nothing"
    if not math.isfinite(value):
        return f"{name}: none detected; {known}."
    text = f"{name}: {value:.4f} {unit} ± {scale * sigma:.3g} {small}; {known}"
    if not math.isfinite(residual):
        return f"{text}."
    times = f" = {residual / sigma:+.2f} σ" if sigma > 0.0 else ""
    return f"{text}; residual {scale * residual:+.3g} {small}{times}."


def _electrons(record: VoxelRecord) -> tuple[float, str]:
    """Return a power of ten that keeps the labels of the signal short, and its name."""
    largest = max(
        float(np.nanmax(record.pixel_signal)), float(np.nanmax(record.expected_signal)), record.threshold
    )
    return (1e6, "10⁶") if largest >= 3e6 else (1e3, "10³") if largest >= 3e3 else (1.0, "")


def _interesting(record: VoxelRecord) -> tuple[int, int]:
    """Return first and last pixel of the enlarged part: around detection, truth, window and the brightest pixel."""
    positions = [
        record.peak_px,
        record.truth_peak_px,
        float(np.nanargmax(record.pixel_signal)),
        *(record.window or ()),
    ]
    inside = [position for position in positions if 0.0 <= position <= record.pixels - 1.0]
    return max(int(min(inside)) - _MARGIN, 0), min(int(max(inside)) + _MARGIN + 1, record.pixels - 1)


def _bars(axes: Axes, record: VoxelRecord, unit: float) -> None:
    edges = np.arange(record.pixels + 1) - 0.5
    light, noise = record.expected_signal / unit, record.noise_sigma / unit
    axes.stairs(record.pixel_signal / unit, edges, fill=True, color=_SIGNAL, label="digitised signal")
    axes.stairs(
        light + noise, edges, baseline=light - noise, fill=True, color=_LIGHT, alpha=0.22, linewidth=0.0
    )
    axes.stairs(
        light,
        edges,
        baseline=None,
        color=_LIGHT,
        linewidth=1.0,
        label="light without noise, ±1 σ of the noise",
    )
    axes.axhline(0.0, color=INK, linewidth=0.5)
    axes.spines[["top", "right"]].set_visible(False)


def _marks(axes: Axes, record: VoxelRecord, unit: float) -> None:
    """Mark threshold, saturation, window, detected and true position."""
    if record.window is not None:
        first, last = record.window
        axes.axvspan(first - 0.5, last + 0.5, color="#eef1f4", zorder=0, label="estimator's window")
    axes.axhline(
        record.threshold / unit, color=_LIMIT, linewidth=1.0, linestyle=(0, (4, 2)), label="threshold"
    )
    if float(np.nanmax(record.pixel_signal)) > 0.5 * record.saturation_level:
        axes.axhline(record.saturation_level / unit, color=_LIMIT, linewidth=1.4, label="saturation")
    if math.isfinite(record.truth_peak_px):
        axes.axvline(
            record.truth_peak_px, color=_TRUTH, linewidth=1.2, linestyle=":", label="true position", zorder=4
        )
    if math.isfinite(record.peak_px):
        sigma = record.sigma_peak_px if math.isfinite(record.sigma_peak_px) else 0.0
        axes.axvspan(record.peak_px - sigma, record.peak_px + sigma, color=_PEAK, alpha=0.30, linewidth=0.0)
        axes.axvline(record.peak_px, color=_PEAK, linewidth=1.2, label="detected position ± σ", zorder=3)


def _detail(axes: Axes, record: VoxelRecord) -> None:
    """Show in a corner how far detection and truth lie apart, which the pixels are too coarse for."""
    sigma = record.sigma_peak_px
    if not (math.isfinite(record.peak_px) and sigma > 0.0):
        return
    truth = record.residual_px if math.isfinite(record.residual_px) else 0.0
    reach = 1.15 * max(4.0 * sigma, abs(truth))
    offset = np.linspace(-reach, reach, 241)
    right = record.peak_px < 0.5 * sum(axes.get_xlim())
    corner = axes.inset_axes((0.77 if right else 0.02, 0.42, 0.21, 0.46))
    corner.fill_between(offset, np.exp(-0.5 * (offset / sigma) ** 2), color=_PEAK, alpha=0.30, linewidth=0.0)
    corner.axvline(0.0, color=_PEAK, linewidth=1.2)
    if math.isfinite(record.residual_px):
        corner.axvline(-truth, color=_TRUTH, linewidth=1.2, linestyle=":")
    corner.set(xlim=(-reach, reach), ylim=(0.0, 1.15), yticks=[])
    corner.locator_params(axis="x", nbins=3)
    corner.tick_params(labelsize=7.0)
    corner.set_xlabel("pixels from the detection", fontsize=7.0)
    corner.spines[["top", "right", "left"]].set_visible(False)


def _height(axes: Axes, record: VoxelRecord, first: int, last: int, unit: float) -> None:
    """Scale the enlarged part so that signal, light and threshold are all in sight."""
    part = slice(first, last + 1)
    high = max(
        float(np.nanmax(record.pixel_signal[part])),
        float(np.nanmax(record.expected_signal[part])),
        record.threshold,
    )
    low = min(float(np.nanmin(record.pixel_signal[part])), 0.0)
    axes.set_ylim((low - 0.03 * (high - low)) / unit, (high + 0.12 * (high - low)) / unit)
