"""Waveforms of time of flight with the light that they were made of, as columns with units."""

from __future__ import annotations

from typing import Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from scanner_sim.products.signal_set import (
    CLUSTERS,
    READ,
    SURFACE,
    WHERE,
    SignalColumn,
    SignalSet,
    of_channel,
)

Array = NDArray[np.float64]

WAVEFORM_SIGNALS = (
    *READ,
    SignalColumn(
        "number", "1", "digital number of each sample; times step_a it is the current", "samples", "number"
    ),
    SignalColumn(
        "expected_a",
        "A",
        "current of the light alone behind the electronics: no noise, no speckle, no jitter of the clock",
        "samples",
    ),
    SignalColumn("delay_s", "s", "delay of the echo after the pulse; NaN without one", "one", "f8"),
    SignalColumn("sigma_delay_s", "s", "standard deviation of the delay, clock apart", "one", "f8"),
    SignalColumn("height_a", "A", "height of the echo"),
    of_channel("tof.snr_detection"),
    SignalColumn("echoes", "1", "number of echoes", "one", "i4"),
    SignalColumn("status", "1", "why there is an echo, or why not: neighbours have no say here", "one", "i4"),
)
"""Columns that noise and processing make; drawn again, they are others."""

WAVEFORM_LIGHT = (
    SignalColumn("background_w", "W", "light of Sun and Earth on the photodiode"),
    SignalColumn(CLUSTERS, "1", "Gaussian echoes that the light of the voxel is made of", "one", "i4"),
    SignalColumn(
        "echo_share",
        "1",
        "share of the pulse's power that each echo brings back, without speckle",
        "clusters",
    ),
    SignalColumn(
        "echo_path_m", "m", "path there and back of each echo, less the voxel's reference_m", "clusters"
    ),
    SignalColumn("echo_sigma_m", "m", "standard deviation of each echo's path", "clusters"),
    SignalColumn("reference_m", "m", "path that those of the echoes are counted from"),
    SignalColumn("coherence", "1", "squared contrast of the speckle of what the beam's axis meets"),
    *SURFACE,
)
"""Columns of the light, which no seed of the noise changes."""


@final
class WaveformSet(SignalSet):
    """Waveforms of n voxels with what was found in them, the light before noise, and the truth.

    ``waveforms["echo_share"]`` and other columns are those of :data:`WAVEFORM_SIGNALS` and :data:`WAVEFORM_LIGHT`.
    """

    FORM: ClassVar[str] = "scanner-sim waveforms, 2"
    COLUMNS: ClassVar[tuple[SignalColumn, ...]] = (*WHERE, *WAVEFORM_SIGNALS, *WAVEFORM_LIGHT)
    SAMPLE: ClassVar[str] = "sample"

    @property
    def rate(self) -> float:
        """Samples per second."""
        return self.about.numbers["rate_hz"]

    @property
    def step(self) -> float:
        """Current of a digital number [A]."""
        return self.about.numbers["step_a"]

    @property
    def time(self) -> Array:
        """Time of each sample after the pulse [s], shape (samples,)."""
        return np.asarray(self.about.numbers["start_s"] + np.arange(self.samples) / self.rate)

    @property
    def delay(self) -> Array:
        """Delay of the echo [s], shape (n,); NaN without one."""
        return self["delay_s"]

    @property
    def sigma(self) -> Array:
        """Standard deviation of the delay, the clock's apart [s], shape (n,)."""
        return self["sigma_delay_s"]

    @property
    def echoes(self) -> NDArray[np.int32]:
        """Number of echoes, shape (n,)."""
        return self["echoes"]

    def _coordinates(self) -> dict[str, Any]:
        return {"time": ("sample", self.time, {"units": "s", "long_name": "time after the pulse"})}
