"""Lines of the position sensor with the light that fell on them, as columns with units."""

from __future__ import annotations

from collections.abc import Mapping
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

LINE_SIGNALS = (
    *READ,
    SignalColumn("number", "1", "digital number of each pixel", "samples", "number"),
    SignalColumn(
        "number_off", "1", "the same of the exposure without the laser", "samples", "number", wanted=False
    ),
    of_channel("peak_px"),
    of_channel("sigma_peak_px"),
    of_channel("Y"),
    SignalColumn("sigma_Y", "electron", "standard deviation of Y by all but speckle"),
    of_channel("snr_detection"),
    SignalColumn("status", "1", "why there is a peak, or why not: neighbours have no say here", "one", "i4"),
)
"""Columns that noise and processing make; drawn again, they are others."""

LINE_LIGHT = (
    SignalColumn(
        "laser_w",
        "W",
        "laser light that falls on each pixel, behind the filter, without speckle and stray light",
        "samples",
    ),
    SignalColumn(
        "background_w",
        "W",
        "light of Sun and Earth on each pixel, stray light apart, in watts that free as many electrons as the laser's",
        "samples",
        wanted=False,
    ),
    SignalColumn("laser_total_w", "W", "laser light that reaches the array"),
    SignalColumn(
        "laser_field_w", "W", "the same with what falls beside the array: stray light is a share of it"
    ),
    SignalColumn("background_window_w", "W", "background in a window of 200 µm about the laser's light"),
    SignalColumn("background_window_error_w", "W", "standard error of that from the finite number of paths"),
    SignalColumn("background_peak_w", "W", "background on the brightest pixel"),
    SignalColumn(
        CLUSTERS, "1", "Gaussian clusters that the laser light of the voxel is made of", "one", "i4"
    ),
    SignalColumn("cluster_w", "W", "power of each cluster before the filter's angle counts", "clusters"),
    SignalColumn("cluster_px", "pixel", "position of each cluster on the line", "clusters"),
    SignalColumn("cluster_sigma_px", "pixel", "standard deviation of each cluster", "clusters"),
    SignalColumn("cluster_coherence", "1", "squared contrast of the speckle of each cluster", "clusters"),
    *SURFACE,
    SignalColumn(
        "truth.peak_px",
        "pixel",
        "where the light of the point that the beam's axis meets falls on the instrument as built",
        "one",
        "f8",
    ),
)
"""Columns of the light, which no seed of the noise changes."""


@final
class LineSet(SignalSet):
    """Lines of n voxels: digital numbers, what the estimator made of them, the light before noise, and the truth.

    ``lines["laser_w"]`` and other columns are those of :data:`LINE_SIGNALS` and :data:`LINE_LIGHT`.
    """

    FORM: ClassVar[str] = "scanner-sim lines, 2"
    COLUMNS: ClassVar[tuple[SignalColumn, ...]] = (*WHERE, *LINE_SIGNALS, *LINE_LIGHT)
    SAMPLE: ClassVar[str] = "pixel"

    @property
    def position(self) -> Array:
        """Position p on the sensor of the centre of each pixel [m], shape (pixels,): 0 is what infinity shows."""
        numbers = self.about.numbers
        return np.asarray(numbers["offset_m"] + (np.arange(self.samples) + 0.5) * numbers["pitch_m"])

    @property
    def charge(self) -> Array:
        """Charge of each pixel above the dark level, less that of the exposure without the laser [electron]."""
        numbers = self.about.numbers
        gain, bias, dark = (numbers[name] for name in ("electrons_per_number", "bias", "dark_electron"))
        charge = (self.number - bias) * gain - dark
        if "number_off" not in self:
            return np.asarray(charge)
        return np.asarray(charge - ((self["number_off"] - bias) * gain * numbers["off_scale"] - dark))

    @property
    def expected(self) -> Array:
        """Charge that the light alone would give, without speckle and noise [electron], shape (n, pixels).

        The laser's and the background's; without the latter where an exposure without the laser is subtracted.
        """
        return charge_of_light(self, self.about.numbers, background="number_off" not in self)

    def _coordinates(self) -> dict[str, Any]:
        return {"position": ("pixel", self.position, {"units": "m", "long_name": "position on the sensor"})}


def charge_of_light(
    columns: Mapping[str, NDArray[Any]], numbers: Mapping[str, float], *, background: bool
) -> Array:
    """Return the charge that light alone gives the pixels of n voxels, without speckle and noise [electron].

    Parameters
    ----------
    columns
        Of :data:`LINE_LIGHT`: the light on the pixels, and the laser's in the line's field.
    numbers
        What digital numbers mean, as in :class:`~scanner_sim.products.signal_set.SignalAbout`. Their ``stray_light`` is
        the share of all light behind the filter that lies evenly over the pixels (veiling glare, ISO 9358).
    background
        Whether the light of Sun and Earth counts.

    Returns
    -------
    ndarray
        Shape (n, pixels).
    """
    light, stray = columns["laser_w"].astype(np.float64), numbers["stray_light"]
    whole = columns["laser_field_w"].astype(np.float64)
    if background and "background_w" in columns:
        light = light + columns["background_w"]
        whole = whole + columns["background_w"].sum(axis=1, dtype=np.float64)
    light = (1.0 - stray) * light + (stray / light.shape[1] * whole)[:, None]
    return np.asarray(light * numbers["electrons_per_watt"])
