"""The area sensor of the video camera: charges to digital numbers.

After the EMVA's standard 1288 (release 4.0, 2021): Poisson photo-electrons and dark electrons, gains and dark currents
that differ from pixel to pixel, read noise, one gain, rounding. Beside it charge that overflows along columns, and that
is smeared along them where it is shifted under the light (Janesick, *Scientific charge-coupled devices*, SPIE Press
2001, ch. 5). Arrays are NumPy's, in double precision, for one frame.

Not modelled: colour filters, a shutter that rolls, lag from frame to frame, traps, after-images, reset noise apart from
the read noise, cosmic rays, interlaced fields.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Count, Part, Switch
from scanner_sim.foundation.streams import Stream, host_generator
from scanner_sim.foundation.units import ElectronRate, Electrons, ElectronsPerNumber, Length, Ratio, Time

Array = NDArray[np.float64]


class FrameSensor(Part):
    """An area sensor; its pixels stand in ``interior``. Numbers of a plain video camera, all assumed."""

    quantum_efficiency: Ratio = Field(default=0.35, gt=0.0, le=1.0)
    """Electrons per photon, at every wavelength of the band, with the share of the pixels that sees light (assumed; 0.2
    to 0.6 for charge-coupled sensors of the time)."""
    band: tuple[Length, Length] = Field(default=(400e-9, 700e-9), examples=[["400 nm", "700 nm"]])
    """Shortest and longest wavelength that is counted: a filter keeps the infrared out, as is usual."""
    full_well: Electrons = Field(default=40_000.0, ge=10.0, le=1e9)
    """Charge that a pixel holds (assumed)."""
    dark_current: ElectronRate = Field(default=200.0, ge=0.0, le=1e12)
    """Mean dark current of a pixel (assumed)."""
    dsnu: Ratio = Field(default=0.1, ge=0.0, le=1.0)
    """Standard deviation of the pixels' dark currents, over their mean (assumed)."""
    prnu: Ratio = Field(default=0.01, ge=0.0, le=0.2)
    """Standard deviation of the pixels' responses, over their mean (assumed)."""
    read_noise: Electrons = Field(default=40.0, ge=0.0, le=1e6)
    """Standard deviation of the read noise (assumed)."""
    bits: Count = Field(default=8, ge=1, le=16)
    """Bits of the converter; 8 as of video digitised then."""
    gain: ElectronsPerNumber | None = Field(default=None, ge=1e-3, le=1e9)
    """Electrons per digital number; by default the converter's range equals the full well."""
    black_level: Count = Field(default=2, ge=0)
    """Digital number of a pixel without charge."""
    blooming: Switch = True
    """Whether charge above the full well flows along the column into pixels that have room; else a drain takes it."""
    smear: Time = Field(default=0.0, ge=0.0, le=1e-3)
    """Time for which a charge stays under each other pixel of its column while it is shifted out under the light: 0 for
    sensors that store frames in the dark."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a band that does not ascend, and a black level that eats up the converter."""
        if not 0.0 < self.band[0] < self.band[1]:
            yield Fault("band", "the wavelengths must ascend from above 0 m.", "Write [shortest, longest].")
        if self.black_level > self.largest_number // 2:
            yield Fault(
                "black_level",
                f"{self.black_level} leaves less than half of the converter's {self.bits} bits.",
                f"Write {self.largest_number // 2} or less, or raise bits.",
            )

    @property
    def largest_number(self) -> int:
        """Largest digital number of the converter."""
        return int(2**self.bits) - 1

    @property
    def electrons_per_number(self) -> float:
        """Electrons per digital number."""
        return self.full_well / (self.largest_number - self.black_level) if self.gain is None else self.gain

    def variance(self, electrons: Array, time: float) -> Array:
        """Return the variance of charges [electron²] of so many mean photo-electrons in a time [s], below saturation.

        Poisson, dark, read noise and rounding; the patterns of gain and dark current are not noise of a frame.
        """
        rounding = self.electrons_per_number**2 / 12.0
        return electrons + self.dark_current * time + self.read_noise**2 + rounding


class Exposed(NamedTuple):
    """A frame: digital numbers, and pixels that reached the full well or the converter's end, shape (rows, columns)."""

    counts: NDArray[np.uint16]
    saturated: NDArray[np.bool_]


class Pattern(NamedTuple):
    """What distinguishes the pixels of one sensor: response and dark current over their means, (rows, columns)."""

    response: Array
    dark: Array


def pattern_of(sensor: FrameSensor, shape: tuple[int, int], seed: int) -> Pattern:
    """Return the pattern of a sensor of a seed; it is the same in all its frames. None of its factors is below 0."""
    normal = host_generator(seed, Stream.FRAME_PATTERN, 0).standard_normal((2, *shape))
    shares = np.array([sensor.prnu, sensor.dsnu])[:, None, None]
    return Pattern(*np.maximum(1.0 + shares * normal, 0.0))


def expose(sensor: FrameSensor, rate: Array, time: float, pattern: Pattern, seed: int, frame: int) -> Exposed:
    """Return the frame that light makes.

    Parameters
    ----------
    sensor
        The sensor.
    rate
        Mean photo-electrons per second of pixels of the mean response, shape (rows, columns).
    time
        Exposure [s].
    pattern
        Of :func:`pattern_of`.
    seed, frame
        Address of the noise: seed and number of the frame.
    """
    random = host_generator(seed, Stream.FRAME_NOISE, frame)
    charge = random.poisson(mean_charge(sensor, rate, time, pattern)).astype(np.float64)
    held = held_charge(sensor, charge)
    numbers = sensor.black_level + (
        (held + sensor.read_noise * random.standard_normal(held.shape)) / sensor.electrons_per_number
    )
    counts = np.clip(np.rint(numbers), 0, sensor.largest_number).astype(np.uint16)
    return Exposed(counts, (held >= sensor.full_well) | (counts == sensor.largest_number))


def mean_charge(sensor: FrameSensor, rate: Array, time: float, pattern: Pattern) -> Array:
    """Return the mean charge of pixels [electron], before anything overflows: light, smear and dark current."""
    lit = rate * pattern.response
    light = lit * time
    if sensor.smear > 0.0:
        light = light + sensor.smear * (lit.sum(axis=0, keepdims=True) - lit)
    return np.asarray(light + sensor.dark_current * time * pattern.dark)


def held_charge(sensor: FrameSensor, charge: Array) -> Array:
    """Return the charges that pixels hold when they are read [electron], shape (rows, columns)."""
    return overflow(charge, sensor.full_well) if sensor.blooming else np.minimum(charge, sensor.full_well)


def overflow(charge: Array, full_well: float) -> Array:
    """Return charges of which none exceeds the full well: the excess flows along its column.

    Half of each excess flows up and half down, past full pixels to the next that have room, and out of the
    array at the ends of the column.

    Parameters
    ----------
    charge
        Shape (rows, columns) [electron].
    full_well
        [electron].
    """
    held = np.minimum(charge, full_well)
    (lit,) = np.nonzero((charge > full_well).any(axis=0))
    if not lit.size:
        return held
    excess, column = charge[:, lit] - held[:, lit], held[:, lit]
    for order in (range(len(column)), reversed(range(len(column)))):
        flows = np.zeros(lit.size)
        for row in order:
            taken = np.minimum(flows, full_well - column[row])
            column[row] += taken
            flows += 0.5 * excess[row] - taken
    held[:, lit] = column
    return held
