"""Lines and waveforms as a page keeps them: a window about each peak, in digital numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from scanner_sim.products.lines import charge_of_light
from scanner_sim.products.view.packing import packed

Array = NDArray[np.float64]
Columns = Mapping[str, NDArray[Any]]
"""A set of lines or waveforms, or some of its columns."""

WINDOW = {"line": 25, "waveform": 48}
"""Pixels of a line, and samples of a waveform, that are kept about a peak."""
LINE_COLUMNS = (
    "row",
    "column",
    "number",
    "number_off",
    "peak_px",
    "laser_w",
    "background_w",
    "laser_field_w",
    "truth.peak_px",
)
WAVEFORM_COLUMNS = ("row", "column", "number", "expected_a", "delay_s", "sigma_delay_s", "echoes")
_EXPECTED_LEVELS = 65535


@dataclass(frozen=True)
class SignalWindows:
    """Windows of n voxels.

    Attributes
    ----------
    kind
        Of lines, or of waveforms.
    row, column
        Where each voxel stands in the raster, shape (n,).
    first
        First pixel or sample of each window, shape (n,).
    number
        Digital numbers, shape (n, window).
    expected
        What the light alone would give, in digital numbers, shape (n, window).
    beneath
        Digital number above which the threshold stands, shape (n, window), where an exposure without the laser is
        subtracted; None where it is the same for all.
    place
        Of a line: the pixel on which the point that the beam's axis meets would fall; of a waveform: the sample at
        which the echo was timed; shape (n,), NaN without one.
    numbers
        What the page needs to draw them: see :func:`packed_windows`.
    """

    kind: Literal["line", "waveform"]
    row: NDArray[np.int32]
    column: NDArray[np.int32]
    first: NDArray[np.int32]
    number: NDArray[Any]
    expected: Array
    beneath: Array | None
    place: Array
    numbers: Mapping[str, float]


def line_windows(parts: Iterable[Columns], numbers: Mapping[str, float], step: int) -> SignalWindows:
    """Return windows of lines, of every ``step``-th row and column.

    Parameters
    ----------
    parts
        Lines, some voxels after the other; only what is kept of one stays in memory.
    numbers
        What the digital numbers mean, as in :class:`~scanner_sim.products.signal_set.SignalAbout`, and
        ``threshold_electron``.
    step
        1 keeps all.
    """
    gain, bias = numbers["electrons_per_number"], numbers["bias"]
    dark = bias + numbers["dark_electron"] / gain
    said = {"dark": dark, "threshold": numbers["threshold_electron"] / gain, "electrons": gain}

    def window_of(part: Columns) -> SignalWindows:
        keep = _kept(part, step)
        light = {
            name: part[name][keep] for name in ("laser_w", "laser_field_w", "background_w") if name in part
        }
        number, charge = part["number"][keep], charge_of_light(light, numbers, background=True)
        first = _first(number, part["peak_px"][keep], WINDOW["line"])
        beneath = None
        if "number_off" in part:
            off = part["number_off"][keep].astype(np.float64)
            beneath = _windows(bias + numbers["off_scale"] * (off - bias), first, WINDOW["line"])
        return SignalWindows(
            kind="line",
            row=part["row"][keep],
            column=part["column"][keep],
            first=first,
            number=_windows(number, first, WINDOW["line"]),
            expected=_windows(dark + charge / gain, first, WINDOW["line"]),
            beneath=beneath,
            place=part["truth.peak_px"][keep],
            numbers=said,
        )

    return _joined([window_of(part) for part in parts])


def waveform_windows(parts: Iterable[Columns], numbers: Mapping[str, float], step: int) -> SignalWindows:
    """Return windows of waveforms, of every ``step``-th row and column; arguments as of :func:`line_windows`."""
    start, rate, unit = (numbers[name] for name in ("start_s", "rate_hz", "step_a"))
    said = {"start_ns": 1e9 * start, "step_ns": 1e9 / rate, "microampere": 1e6 * unit}

    def window_of(part: Columns) -> SignalWindows:
        keep = _kept(part, step)
        number, at = part["number"][keep], (part["delay_s"][keep] - start) * rate
        first = _first(number, at, WINDOW["waveform"])
        return SignalWindows(
            kind="waveform",
            row=part["row"][keep],
            column=part["column"][keep],
            first=first,
            number=_windows(number, first, WINDOW["waveform"]),
            expected=_windows(part["expected_a"][keep].astype(np.float64) / unit, first, WINDOW["waveform"]),
            beneath=None,
            place=at,
            numbers=said,
        )

    return _joined([window_of(part) for part in parts])


def packed_windows(windows: SignalWindows) -> dict[str, Any]:
    """Return windows as data of a page.

    ``numbers`` of a line: digital number in the ``dark``, ``threshold`` above it, and ``electrons`` of a number; of a
    waveform: time of the first sample ``start_ns``, ``step_ns`` between two, and ``microampere`` of a number.
    """
    high = float(np.nanmax(windows.expected, initial=0.0))
    low = float(np.nanmin(windows.expected, initial=0.0))
    scale = max(high - low, 1e-300) / _EXPECTED_LEVELS
    levels = np.rint((np.nan_to_num(windows.expected, nan=low) - low) / scale)
    return {
        "kind": windows.kind,
        "numbers": dict(windows.numbers),
        "row": packed(windows.row),
        "column": packed(windows.column),
        "first": packed(windows.first),
        "number": packed(windows.number),
        "expected": packed(levels.astype(np.uint16)),
        "expected_low": low,
        "expected_scale": scale,
        "beneath": None if windows.beneath is None else packed(windows.beneath, 12),
        "place": packed(windows.place, 18),
    }


def _joined(parts: list[SignalWindows]) -> SignalWindows:
    def together(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(part, name) for part in parts])

    return SignalWindows(
        kind=parts[0].kind,
        row=together("row"),
        column=together("column"),
        first=together("first"),
        number=together("number"),
        expected=together("expected"),
        beneath=None if parts[0].beneath is None else together("beneath"),
        place=together("place"),
        numbers=parts[0].numbers,
    )


def _kept(part: Columns, step: int) -> NDArray[np.intp]:
    (kept,) = np.nonzero((part["row"] % step == 0) & (part["column"] % step == 0))
    return kept


def _first(number: NDArray[Any], peak: NDArray[Any], window: int) -> NDArray[np.int32]:
    """Return where a window about each peak begins; without a peak, about the largest number."""
    samples = number.shape[1]
    middle = np.where(np.isfinite(peak), np.nan_to_num(peak), np.argmax(number, axis=1))
    begin = np.clip(np.rint(middle) - window // 2, 0, max(samples - window, 0))
    return np.asarray(begin, dtype=np.int32)


def _windows(values: NDArray[Any], first: NDArray[np.int32], window: int) -> NDArray[Any]:
    window = min(window, values.shape[1])
    return np.take_along_axis(values, first[:, None] + np.arange(window), axis=1)
