"""Picture of a waveform with its echo."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.status import Status
from scanner_sim.products.pictures.style import FAINT, INK, house_style, save
from scanner_sim.products.waveforms import WaveformSet

Array = NDArray[np.float64]

_DPI = 160
_ECHO = "#b5483a"


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
