"""Calibration: what the digital numbers of the sensor mean, and the variance of a charge.

Where the line was exposed once, a pixel's charge c is that of all light, and its variance

    floor + c + (prnu c)²,   floor = read² + step²/12 + dark.

Where it was exposed a second time without the laser, for a share s of the dwell, the charge is the difference

    c = c_on − k c_off,   k = (1 − s)/s,   of variance   floor_on + k² floor_off + c + (1 + k) k c_off + (prnu c)²,

all c above the dark level: Poisson noise of both exposures, and the fixed pattern of the laser's light alone, since
that of the background is the same in both and goes with it (propagation of independent errors).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.line.exposure import Signal
from scanner_sim.detector.line.position_sensor import PositionSensor
from scanner_sim.foundation.device_types import Float

_NEAR_FULL = 5.0
"""Standard deviations of the read noise below the full well from which a pixel counts as saturated."""


@dataclass(frozen=True)
class SensorCalibration:
    """What is known of the sensor: how a number becomes a charge, and the variance of a charge.

    The methods take numbers, NumPy or Dr.Jit arrays.

    Attributes
    ----------
    bias, gain
        Digital number without charge, and electrons per digital number.
    dark
        Mean dark charge of an exposure with the laser [electron].
    off_scale
        Time of that exposure over that of the one without the laser, k; 0 where there is none.
    floor
        Variance of a pixel without light, the subtracted exposure's included [electron²].
    shot_noise
        1 if light has Poisson noise, else 0.
    prnu
        Relative standard deviation of the pixels' response.
    full
        Charge in the well [electron] from which a pixel counts as saturated.
    """

    bias: float
    gain: float
    dark: float
    off_scale: float
    floor: float
    shot_noise: float
    prnu: float
    full: float

    @classmethod
    def of(cls, sensor: PositionSensor, dwell: float, laser_off: float = 0.0) -> SensorCalibration:
        """Return the calibration of a sensor for a dwell [s] and the share of it in which the laser is off."""
        switches, gain = sensor.noise, sensor.electrons_per_number
        read = sensor.read_noise if switches.read else 0.0
        dark = (1.0 - laser_off) * dwell * sensor.dark_current if switches.dark else 0.0
        steps = gain**2 / 12.0 if switches.quantisation else 0.0
        well = min(sensor.full_well, (sensor.largest_number - sensor.bias) * gain)
        floor = read**2 + steps + (dark if switches.shot else 0.0)
        off_scale = (1.0 - laser_off) / laser_off if laser_off > 0.0 else 0.0
        if laser_off > 0.0:
            floor += off_scale**2 * (read**2 + steps) + (off_scale * dark if switches.shot else 0.0)
        return cls(
            bias=float(sensor.bias),
            gain=gain,
            dark=dark,
            off_scale=off_scale,
            floor=floor,
            shot_noise=float(switches.shot),
            prnu=sensor.prnu if switches.prnu else 0.0,
            full=well - _NEAR_FULL * read if switches.saturation else float("inf"),
        )

    @property
    def floor_sigma(self) -> float:
        """Standard deviation of a pixel without light [electron]."""
        return float(self.floor**0.5)

    def charge(self, number: Float) -> Float:
        """Return the charge above the dark level [electron] of a digital number."""
        return (number - self.bias) * self.gain - self.dark

    def ambient(self, number: Float) -> Float:
        """Return the charge that is to be subtracted, k c_off [electron], of a number read without the laser."""
        return (number - self.bias) * self.gain * self.off_scale - self.dark

    def variance(self, charge: Float) -> Float:
        """Return the variance [electron²] of a pixel with a charge above the dark level [electron]."""
        light = (charge + abs(charge)) * 0.5
        return self.floor + self.shot_noise * light + (self.prnu * light) ** 2

    def variance_above(self, ambient: Float, charge: Float) -> Float:
        """Return the variance [electron²] of a charge [electron] that is left above a subtracted one."""
        beneath = (ambient + abs(ambient)) * 0.5
        return self.variance(charge) + self.shot_noise * (1.0 + self.off_scale) * beneath


def measured_lines(
    signal: Signal, calibration: SensorCalibration
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the charges of lines and their standard deviations [electron], NumPy arrays of shape (m, pixels)."""
    return measured_charges([signal.lines(exposure) for exposure in range(signal.exposures)], calibration)


def measured_charges(
    numbers: Sequence[NDArray[np.float32]], calibration: SensorCalibration
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the same from the digital numbers of one exposure or of both."""
    charge = np.asarray(calibration.charge(numbers[0].astype(np.float64)))
    if len(numbers) == 1:
        return charge, np.sqrt(calibration.variance(charge))
    ambient = calibration.ambient(numbers[1].astype(np.float64))
    return charge - ambient, np.sqrt(calibration.variance_above(ambient, charge - ambient))
