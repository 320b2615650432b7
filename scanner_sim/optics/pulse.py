"""The laser's pulse: its energy, its shape in time and how often it is fired."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Tag

from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.errors import Fault, InputError
from scanner_sim.foundation.named_files import read_text_file
from scanner_sim.foundation.parts import InputFile, Part
from scanner_sim.foundation.units import Energy, Frequency, Power, Time

Array = NDArray[np.float64]

PulseShape = Annotated[
    Annotated[Literal["gaussian", "t2_exponential"], Tag("(word)")]
    | Annotated[Path, InputFile((".csv",)), Tag("(file)")],
    Discriminator(lambda value: "(word)" if isinstance(value, str) and "." not in value else "(file)"),
    Field(examples=["gaussian", "pulse.csv"]),
]
"""A named shape, or a CSV file of samples."""

FWHM: Final = 2.0 * math.sqrt(2.0 * math.log(2.0))
"""Full width at half maximum of a Gaussian over its standard deviation."""

_T2_WIDTH = 3.394607797
"""Full width at half maximum of t² e^(−t/τ), in units of τ."""
_LARGEST = 100_000
"""Lines of the largest file that is read."""
_KEPT = 4
"""Files whose samples are kept."""


class Pulse(Part):
    """A pulsed laser; time 0 of a pulse is the centroid of its power.

    Shapes: ``gaussian``; ``t2_exponential``, P ∝ t² e^(−t/τ), which rises fast and falls slowly (Carlsson, Steinvall,
    Letalick, *Signature simulation and signal analysis for 3-D laser radar*, FOI-R-0163-SE, 2001); or the name of a
    CSV file with lines of time [s] and power (in any unit) of a measured pulse.
    """

    peak_power: Power | None = Field(default=None, ge=1e-12, le=1e9)
    """Highest power."""
    energy: Energy | None = Field(default=None, ge=1e-24, le=1e3)
    """Energy of a pulse, instead of ``peak_power``."""
    width: Time = Field(ge=1e-12, le=1e-3)
    """Full width at half maximum of the named shapes; a file has its own."""
    shape: PulseShape
    """Shape in time, or a CSV file of samples."""
    repetition_rate: Frequency = Field(ge=1.0, le=1e9)
    """Pulses per second."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield power beside energy or neither, a file that holds no pulse, and pulses longer than their period."""
        if self.peak_power is not None and self.energy is not None:
            yield Fault("energy", "a pulse has a peak power or an energy, not both.", "Keep one of them.")
        if self.peak_power is None and self.energy is None:
            yield Fault("peak_power", "a pulse has neither a peak power nor an energy.", "Write one of them.")
        if isinstance(self.shape, Path):
            try:
                read_pulse(self.shape)
            except InputError as error:
                yield Fault("shape", error.message, error.remedy)
                return
        if self.length > 1.0 / self.repetition_rate:
            yield Fault(
                "repetition_rate",
                f"the pulse lasts {self.length:.3g} s, longer than the period of {1.0 / self.repetition_rate:.3g} s.",
                "Lower the rate, or shorten the pulse.",
            )

    def samples(self) -> tuple[Array, Array]:
        """Return times [s] from the centroid, ascending, and power there per energy [1/s]; linear between them.

        The trapezoidal area is 1 and the centroid 0.
        """
        if isinstance(self.shape, Path):
            time, power = read_pulse(self.shape)
        elif self.shape == "gaussian":
            time = np.linspace(-7.0, 7.0, 2049) * self.width / FWHM
            power = np.exp(-0.5 * np.linspace(-7.0, 7.0, 2049) ** 2)
        else:
            scaled = np.linspace(0.0, 30.0, 4097)
            time, power = scaled * self.width / _T2_WIDTH, scaled**2 * np.exp(-scaled)
        power = power / np.trapezoid(power, time)
        # The centroid of a polygon: exact where time · power is integrated piece by piece.
        step, left, right = np.diff(time), power[:-1], power[1:]
        middle = np.sum(step * (time[:-1] * (2.0 * left + right) + time[1:] * (left + 2.0 * right))) / 6.0
        return time - middle, power

    @property
    def text(self) -> str:
        """What its file holds now, by which what is made of a pulse is kept beside the file's name; else empty."""
        return read_text_file(self.shape) if isinstance(self.shape, Path) else ""

    @property
    def sigma(self) -> float:
        """Standard deviation of the pulse in time [s]."""
        if self.shape == "gaussian":
            return self.width / FWHM
        # Of a polygon, as its centroid is.
        time, power = self.samples()
        early, late, left, right = time[:-1], time[1:], power[:-1], power[1:]
        beside = 2.0 * early * late
        piece = left * (3.0 * early**2 + beside + late**2) + right * (early**2 + beside + 3.0 * late**2)
        return math.sqrt(float(np.sum((late - early) * piece)) / 12.0)

    @property
    def length(self) -> float:
        """Time [s] outside of which there is no power worth counting."""
        time, _ = self.samples()
        return float(time[-1] - time[0])

    @property
    def pulse_energy(self) -> float:
        """Energy of a pulse [J]."""
        if self.energy is not None:
            return self.energy
        peak = self.peak_power
        assert peak is not None  # one of the two is given
        if self.shape == "gaussian":
            return peak * self.sigma * math.sqrt(2.0 * math.pi)
        return peak / float(self.samples()[1].max())

    @property
    def mean_power(self) -> float:
        """Power averaged over the pulses and the time between them [W]."""
        return self.pulse_energy * self.repetition_rate

    @property
    def ambiguity_range(self) -> float:
        """Range c/(2 rate) [m] by which surfaces differ whose echoes, of one pulse and of the next, come together."""
        return SPEED_OF_LIGHT / (2.0 * self.repetition_rate)


def read_pulse(path: Path) -> tuple[Array, Array]:
    """Read a measured pulse.

    Parameters
    ----------
    path
        CSV file; each line has a time [s] and a power. Lines that begin with # are left out.

    Returns
    -------
    tuple
        Times [s], ascending, and powers, shape (n,), n ≥ 3; read-only.

    Raises
    ------
    InputError
        If the file has no such lines, negative powers, times that do not ascend, or no power at all.
    """
    return _samples_of(read_text_file(path), path.name)


@lru_cache(maxsize=_KEPT)
def _samples_of(text: str, name: str) -> tuple[Array, Array]:
    """Return what :func:`read_pulse` does of a file's text: the same text is taken apart once."""
    remedy = "Write lines of time in seconds and power, as 1e-9,0.5"
    lines = text.splitlines()
    lines = [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
    if len(lines) < 3:
        raise InputError(f"{name} has {len(lines)} samples; a pulse needs three.", remedy=remedy)
    if len(lines) > _LARGEST:
        raise InputError(f"{name} has more than {_LARGEST} samples.", remedy="Thin them out.")
    values = []
    for number, line in enumerate(lines, 1):
        try:
            time, power = (float(word) for word in line.split(","))
        except ValueError:
            raise InputError(f"{name}: sample {number} is not two numbers.", remedy=remedy) from None
        values.append((time, power))
    table = np.array(values)
    if not np.isfinite(table).all():
        raise InputError(f"{name} has samples that are not finite.", remedy="Remove them.")
    descends = np.flatnonzero(np.diff(table[:, 0]) <= 0.0)
    if descends.size:
        raise InputError(
            f"{name}: the time of sample {descends[0] + 2} is not later than the one before.",
            remedy="Sort the samples by time, and keep one of each time.",
        )
    if (table[:, 1] < 0.0).any():
        first = int(np.flatnonzero(table[:, 1] < 0.0)[0]) + 1
        raise InputError(
            f"{name}: the power of sample {first} is negative.",
            remedy="Take the baseline off and cut the pulse where the noise begins.",
        )
    if not table[:, 1].any():
        raise InputError(f"{name} has no power.", remedy=remedy)
    table.flags.writeable = False
    return table[:, 0], table[:, 1]
