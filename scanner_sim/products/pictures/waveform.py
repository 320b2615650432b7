"""Pictures of time of flight: a waveform with its echo, and ranges in grey levels as in the paper's Figure 2b."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.status import Status
from scanner_sim.products.image import RangeImage
from scanner_sim.products.pictures.style import FAINT, INK, house_style, save, save_grey
from scanner_sim.products.waveforms import WaveformSet

Array = NDArray[np.float64]

_DPI = 160
_ECHO = "#b5483a"


def range_levels(r: NDArray[np.float64], nearest: float, farthest: float) -> NDArray[np.uint8]:
    """Return ranges as grey levels: 255 at ``nearest``, 40 at ``farthest``, 0 where there is none.

    Parameters
    ----------
    r
        Ranges [m], shape (rows, columns), NaN without one.
    nearest, farthest
        Ends of the scale [m], nearest below farthest; what lies beyond is cut off.
    """
    share = np.clip((farthest - r) / (farthest - nearest), 0.0, 1.0)
    return np.where(np.isfinite(r), np.rint(40.0 + 215.0 * np.nan_to_num(share)), 0.0).astype(np.uint8)


def draw_grey(image: RangeImage, path: str | Path) -> None:
    """Write the ranges by time of flight as grey levels, a dot for each voxel: near is bright, black is none.

    The scale leaves out the outermost half per cent at either end.
    """
    ranges = image["tof.range_m"].astype(np.float64)
    finite = ranges[np.isfinite(ranges)]
    nearest, farthest = np.percentile(finite, (0.5, 99.5)) if finite.size else (0.0, 1.0)
    save_grey(range_levels(ranges, nearest, max(farthest, nearest + 1e-3)), path)


def draw_waveform(
    path: str | Path, waveforms: WaveformSet, number: int, fit: tuple[Array, Array] | None = None
) -> None:
    """Draw one record: current over time and range, with the delay that was found; enlarged about it.

    Parameters
    ----------
    path
        The picture, PNG.
    waveforms
        Records.
    number
        Which of them.
    fit
        Times [s] and currents [A] of the pulse that was fitted, which is drawn over the record.
    """
    current = waveforms.number[number] * waveforms.step * 1e6
    time = waveforms.time * 1e9
    delay, sigma = waveforms.delay[number], waveforms.sigma[number]
    status = Status(int(waveforms.status[number]))
    with house_style():
        figure = Figure(figsize=(5.6, 2.6 if fit is None else 4.6), dpi=_DPI, layout="constrained")
        axes = figure.add_subplot(1 if fit is None else 2, 1, 1)
        close = [] if fit is None else [figure.add_subplot(2, 1, 2)]
        for one in (axes, *close):
            one.axhline(0.0, color=FAINT, linewidth=0.5)
            one.plot(time, current, color=INK, linewidth=0.9, marker=".", markersize=2.5, label="waveform")
        for one in close:
            assert fit is not None
            one.plot(fit[0] * 1e9, fit[1] * 1e6, color=_ECHO, linewidth=1.0, label="fitted pulse")
            one.axvline(delay * 1e9, color=_ECHO, linewidth=0.7, linestyle="--", label="delay")
            one.set_xlim(fit[0][0] * 1e9, fit[0][-1] * 1e9)
            one.set_xlabel("time after the pulse [ns]")
            one.set_ylabel("current [µA]")
            one.spines["right"].set_visible(False)
            one.legend(fontsize=7.0, loc="upper right")
        title = f"voxel ({waveforms.row[number]}, {waveforms.column[number]})"
        if np.isfinite(delay):
            axes.axvline(delay * 1e9, color=_ECHO, linewidth=1.0)
            title += f": echo at {delay * 1e9:.3f} ± {sigma * 1e9:.3f} ns"
        else:
            title += f": {status.sentence}"
        axes.set_title(title, loc="left", fontsize=8.0)
        axes.set_xlabel("time after the pulse [ns]")
        axes.set_ylabel("current [µA]")
        axes.set_xlim(time[0], time[-1])
        # The range is the time by another scale: a second axis over the same line.
        above = axes.twiny()
        low, high = (0.5 * SPEED_OF_LIGHT * end * 1e-9 for end in axes.get_xlim())
        above.set_xlim(low, high)
        above.set_xlabel("range [m]", labelpad=2.0)
        for one in (axes, above):
            one.spines["right"].set_visible(False)
        save(figure, path)
