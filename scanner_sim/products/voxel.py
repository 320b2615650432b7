"""The record of one voxel: everything between the light on the line sensor and the range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.status import Status


@dataclass(frozen=True, eq=False)
class VoxelRecord:
    """The line of one voxel and what the instrument made of it. NaN stands where there is no number.

    Attributes
    ----------
    row, column
        Row and column in the raster.
    theta, phi
        Commanded deflections [rad].
    pixel_signal
        Digitised signal after subtraction of the offset, and of the exposure without the laser where there is
        one, [electron], shape (pixels,).
    expected_signal
        Signal that the light of it would give, without noise, [electron], shape (pixels,).
    noise_sigma
        Standard deviation of each pixel of the noise model [electron], shape (pixels,).
    threshold
        Detection threshold [electron].
    saturation_level
        Signal at which a pixel counts as saturated [electron].
    status
        Why there is a range, or why not.
    peak_px, sigma_peak_px
        Detected position [pixel] and its standard deviation; the centre of pixel i is at i.
    range_m, sigma_range_m, sigma_texture_m
        Range [m], its standard deviation, and the part of that which comes from light that is uneven over the spot.
    truth_peak_px, truth_range_m
        Where the light of the point that the chief ray meets falls on the instrument as built [pixel]; its range [m].
    method
        Name of the peak estimator.
    window
        First and last pixel that the estimator used, both included; None where it used none.

    Raises
    ------
    ValueError
        If the lines differ in length or the window leaves them.
    """

    row: int
    column: int
    theta: float
    phi: float
    pixel_signal: NDArray[np.floating]
    expected_signal: NDArray[np.floating]
    noise_sigma: NDArray[np.floating]
    threshold: float
    saturation_level: float
    status: Status
    peak_px: float
    sigma_peak_px: float
    range_m: float
    sigma_range_m: float
    sigma_texture_m: float
    truth_peak_px: float
    truth_range_m: float
    method: str
    window: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        """Check that the three lines belong together."""
        shapes = {self.pixel_signal.shape, self.expected_signal.shape, self.noise_sigma.shape}
        if len(shapes) != 1 or self.pixel_signal.ndim != 1 or not self.pixel_signal.size:
            raise ValueError(f"the lines of a voxel must have one shape (pixels,), not {sorted(shapes)}")
        if self.window is not None and not 0 <= self.window[0] <= self.window[1] < self.pixels:
            raise ValueError(f"the window {self.window} leaves the line of {self.pixels} pixels")

    @property
    def pixels(self) -> int:
        """Number of pixels of the line."""
        return self.pixel_signal.size

    @property
    def residual_px(self) -> float:
        """Detected minus true position [pixel]; NaN where one of them is missing."""
        return self.peak_px - self.truth_peak_px

    @property
    def residual_m(self) -> float:
        """Measured minus true range [m]; NaN where one of them is missing."""
        return self.range_m - self.truth_range_m
