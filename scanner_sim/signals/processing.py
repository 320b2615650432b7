"""How signals are processed: the sensor's line and the pulse's echo."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from pydantic import Discriminator, Field, Tag

from scanner_sim.foundation.errors import Fault, InputError
from scanner_sim.foundation.parts import InputFile, Number, Part, Switch
from scanner_sim.foundation.units import Angle, Length
from scanner_sim.signals.line.bias_table import read_bias
from scanner_sim.signals.own import Function, OwnEstimators
from scanner_sim.signals.waveform.settings import PulseDetection

MARGIN: Mapping[str, int] = MappingProxyType(
    {
        "centre_of_mass": 3,
        "parabola": 1,
        "gaussian": 1,
        "blais_rioux_2": 2,
        "blais_rioux_4": 3,
        "blais_rioux_8": 5,
        "maximum_likelihood": 2,
    }
)
"""The estimators of the peak: how many pixels to each side of the brightest one each needs. ``maximum_likelihood``
reads four standard deviations of the spot to each side, but takes what the array has of them."""

PEAKS = OwnEstimators("processing.peak", "register_peak", "--peak", MARGIN)
"""Estimators of the peak beside them that the user has registered."""

if TYPE_CHECKING:
    PeakMethod: TypeAlias = str
else:
    PeakMethod = PEAKS.name_type


def register_peak(name: str, function: Function) -> None:
    """Make a function of your own an estimator of the peak: ``processing.peak: name``.

    Parameters
    ----------
    name
        Letters, digits and _.
    function
        Called as ``function(lines, known)`` with some hundreds to thousands of lines at a time: ``lines`` their charges
        [electron] above the dark level, float64 of shape (n, pixels); ``known`` a
        :class:`~scanner_sim.signals.line.own_peak.KnownLines`. It returns (position, sigma, status) of each line, each
        of shape (n,): position [pixel], 0 in the middle of the first one, its standard deviation [pixel], and a code of
        :class:`~scanner_sim.foundation.status.Status`, which an enumeration or any integers may hold. It must treat
        each line by itself, and alike whenever it is called.

    Raises
    ------
    InputError
        If the name is none, is taken by the program or by another function, or the function is none.

    Notes
    -----
    The function finds the spot, tells what is none, and states σ by itself: ``threshold``, ``ambiguity`` and
    ``validation`` of ``processing`` do nothing more, but for what neighbours in a raster say and for
    ``validation.background``. The light of a shot is summed about its position, less that beside it
    where this is on. The name is known in this process alone.
    """
    PEAKS.register(name, function)


BiasChoice = Annotated[
    Annotated[Literal["none", "computed"], Tag("(word)")]
    | Annotated[Path, InputFile((".csv",)), Tag("(file)")],
    Discriminator(lambda value: "(word)" if isinstance(value, str) and "." not in value else "(file)"),
    Field(examples=["computed"]),
]
"""A table of systematic errors: none, one that is computed, or a file."""


CalibrationPath = Annotated[Path, InputFile((".yaml", ".yml")), Field(examples=["calibration.yaml"])]
"""A calibration's file."""


class Validation(Part):
    """What tells the laser's spot from sunlight: edges, glints and the Sun must not become ranges."""

    background: Switch = True
    """Search for the peak that stands out like a spot, and subtract the light beside it. Without it the
    brightest pixel of the line wins, whatever lit it."""
    shape: Switch = True
    """Refuse peaks that have not the width or the shape of the spot."""
    false_alarm: Number = Field(default=1e-4, ge=1e-12, le=0.1)
    """Probability with which noise alone makes a spot of the right shape fail the test of its shape."""
    beam_width: tuple[Number, Number] = (0.7, 1.5)
    """Least and largest image of the beam along the line, relative to that on a surface which faces the
    scanner: tilted surfaces and edges lie between."""
    tolerance: Number = Field(default=0.1, ge=0.0, le=1.0)
    """Departure of each pixel from the spot's shape, relative to its height, that passes as harmless."""
    misfit: Number = Field(default=1.0, ge=0.0, le=100.0)
    """Standard deviation of the position [pixel] for a departure from the shape, root mean square, of the spot's
    height: what does not fit the spot may also have moved it. 0 trusts every shape that passes."""
    max_reflectance: Number | None = Field(default=30.0, gt=0.0, le=1e9)
    """Brightest surface there can be, relative to a white Lambertian one that faces the scanner; more is no
    laser light from that range. ``null`` is no limit."""
    min_reflectance: Number = Field(default=0.005, ge=0.0, le=1.0)
    """Darkest surface, tilt included, relative to the same: a peak that is surely fainter is left out of the
    search. 0 is no limit."""
    isolated: Number | None = Field(default=6.0, ge=0.0, le=1e6)
    """Standard deviations by which the range of a voxel may differ from that of a neighbour, beyond the rise of the
    steepest surface; a voxel that differs from all its neighbours is refused. ``null`` keeps it."""
    steepest: Angle = Field(default=math.radians(80.0), ge=0.0, le=1.57)
    """Inclination of the steepest surface whose voxels still count as neighbours."""
    mixed: Angle | None = Field(default=math.radians(70.0), ge=0.0, le=1.57)
    """Inclination from which the way to a neighbour's range, or to a neighbour without one, is an edge: a spot that
    reaches it holds light of more than one surface and is refused. ``null`` keeps it."""
    uneven: Switch = True
    """Whether σ of a range holds what reflectance and relief that change over the spot may move it by, as far as the
    neighbours in the raster show it: ``sigma_texture_m``. Relief alone moves ranges by time of flight."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield widths that do not ascend."""
        if not 0.0 <= self.beam_width[0] < self.beam_width[1]:
            yield Fault("beam_width", "the widths must ascend from 0 or more.", "Write [0.7, 1.5].")


class Processing(Part):
    """Peak detection and validation."""

    peak: PeakMethod = "maximum_likelihood"
    """Estimator of the sub-pixel position. ``maximum_likelihood`` weighs each pixel by its noise and by speckle: it
    errs about half as much as ``gaussian`` for a twentieth more time. Or the name of a function of your own, see the
    guide *Your own estimator*."""
    bias_correction: BiasChoice = "none"
    """Table by which the estimator's systematic error is taken off: ``computed`` from the spot that the instrument
    should make, or a CSV file that ``scanner-sim calibrate`` has measured with this estimator and this
    ``calibration``."""
    threshold: Number = Field(default=6.0, ge=0.0, le=1e6)
    """Least height of a peak, in standard deviations of the line without it (read, dark and quantisation noise,
    and that of the light beneath the peak)."""
    speckle_contrast: Number = Field(default=1.0 / math.sqrt(2.0), ge=0.0, le=1.0)
    """Contrast of the laser's speckle that σ and the test of the shape reckon with: 0.71 is that of surfaces which
    depolarise, 1 of those which do not. Without ``scanner.laser.speckle`` it has no effect."""
    ambiguity: Number = Field(default=0.5, gt=0.0, le=1.0)
    """A second, separate peak higher than this share of the first makes the shot ambiguous."""
    calibration: CalibrationPath | None = None
    """File of a calibration: what the instrument believes of its departures from its design, with its covariance, which
    enters σ. By default it believes that it is as designed."""
    range_gate: tuple[Length, Length] | None = Field(default=None, examples=[["2 m", "30 m"]])
    """Nearest and farthest range that is accepted; by default all that the array sees, or the
    digitiser records."""
    validation: Validation = Validation()
    """What tells the laser's spot from sunlight."""
    pulse: PulseDetection = PulseDetection()
    """How the echoes of time of flight are found and timed."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a range gate that does not ascend, and a table of systematic errors that cannot be used."""
        if self.range_gate is not None and not 0.0 <= self.range_gate[0] < self.range_gate[1]:
            yield Fault("range_gate", "the gate must ascend from 0 m or more.", "Write [nearest, farthest].")
        if PEAKS.is_own(self.peak) and self.bias_correction != "none":
            yield Fault(
                "bias_correction",
                f"a systematic error of the program's estimators is corrected, and {self.peak} is none of them.",
                "Write bias_correction: none, and correct the position in the function.",
            )
        elif isinstance(self.bias_correction, Path):
            try:
                table = read_bias(self.bias_correction)
            except InputError as error:
                yield Fault("bias_correction", error.message, error.remedy)
                return
            if table.estimator != self.peak:
                yield Fault(
                    "bias_correction",
                    f"{self.bias_correction} was measured with the estimator {table.estimator}, not {self.peak}.",
                    f"Write peak: {table.estimator}, or calibrate again.",
                )
