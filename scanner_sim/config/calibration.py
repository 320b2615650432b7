"""Calibrations as files: believed parameters with their covariance, and the instrument to which they belong."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from scanner_sim.config.built import scanner_as_built
from scanner_sim.config.document import Document
from scanner_sim.config.reading import read_part
from scanner_sim.config.scanner import Scanner, geometry_of
from scanner_sim.config.scenario import Scenario
from scanner_sim.config.wording import choice
from scanner_sim.foundation.errors import Fault, ScenarioError
from scanner_sim.foundation.parameters import INDEX, NAMES, PARAMETERS, PERIODIC
from scanner_sim.foundation.parts import Number, Part
from scanner_sim.foundation.units import Angle, Length, Ratio, RatioPerKelvin, TemperatureDifference
from scanner_sim.optics.as_built import PerSquareAngle
from scanner_sim.optics.vibration import Vibration
from scanner_sim.ranging.believed import Design
from scanner_sim.ranging.calibration import Calibration
from scanner_sim.ranging.ranges import Geometry

Array = NDArray[np.float64]

_LEAST_SQUARE = -1e-9
"""Least eigenvalue of a correlation that rounding of its file leaves."""


class CalibratedLength(Part):
    """A length that was calibrated."""

    value: Length = Field(ge=-1.0, le=1.0)
    """By how much the instrument departs from its design."""
    sigma: Length | None = Field(default=None, ge=0.0, le=1.0)
    """Standard deviation of the value; without it the value is exact."""


class CalibratedAngle(Part):
    """An angle that was calibrated."""

    value: Angle = Field(ge=-0.5, le=0.5)
    """By how much the instrument departs from its design."""
    sigma: Angle | None = Field(default=None, ge=0.0, le=0.5)
    """Standard deviation of the value; without it the value is exact."""


class CalibratedRatio(Part):
    """A ratio that was calibrated."""

    value: Ratio = Field(ge=-10.0, le=10.0)
    """By how much the instrument departs from its design."""
    sigma: Ratio | None = Field(default=None, ge=0.0, le=10.0)
    """Standard deviation of the value; without it the value is exact."""


class CalibratedCubic(Part):
    """A third order that was calibrated."""

    value: PerSquareAngle = Field(ge=-10.0, le=10.0)
    """By how much the instrument departs from its design."""
    sigma: PerSquareAngle | None = Field(default=None, ge=0.0, le=10.0)
    """Standard deviation of the value; without it the value is exact."""


class CalibratedParameters(Part):
    """The parameters that were calibrated; those that are left out are as designed, exactly."""

    base: CalibratedLength | None = None
    focal_length: CalibratedLength | None = None
    axis_separation: CalibratedLength | None = None
    axis_offset: CalibratedLength | None = None
    axis_skew: CalibratedAngle | None = None
    theta_zero: CalibratedAngle | None = None
    phi_zero: CalibratedAngle | None = None
    theta_scale: CalibratedRatio | None = None
    phi_scale: CalibratedRatio | None = None
    theta_cubic: CalibratedCubic | None = None
    phi_cubic: CalibratedCubic | None = None
    theta_sine: CalibratedAngle | None = None
    theta_cosine: CalibratedAngle | None = None
    phi_sine: CalibratedAngle | None = None
    phi_cosine: CalibratedAngle | None = None
    array_offset: CalibratedLength | None = None
    array_scale: CalibratedRatio | None = None
    array_tilt: CalibratedAngle | None = None
    radial_1: CalibratedRatio | None = None
    radial_2: CalibratedRatio | None = None
    tangential: CalibratedRatio | None = None
    tof_zero: CalibratedLength | None = None
    tof_scale: CalibratedRatio | None = None


class KnownExpansion(Part):
    """A coefficient of temperature."""

    value: RatioPerKelvin = Field(ge=-1e-2, le=1e-2)
    """By how much the length grows, relative to itself."""
    sigma: RatioPerKelvin = Field(default=0.0, ge=0.0, le=1e-2)
    """Standard deviation of the value."""


class TemperatureOfUse(Part):
    """By how much the instrument in use is warmer than when it was calibrated: one number for all its parts."""

    sigma: TemperatureDifference = Field(ge=0.0, le=200.0)
    """Standard deviation of that difference, with the mean 0."""
    base_expansion: KnownExpansion | None = None
    """Of the base."""
    focal_expansion: KnownExpansion | None = None
    """Of the image distance. The zeros' coefficient is ``mirrors.drift_zero``, and in σ by itself."""

    def covariance(self, design: Design) -> Array:
        """Return what it adds to the covariance of the parameters, shape (parameters, parameters).

        With T and the coefficients a_i independent, and lengths l_i, the errors are a_i l_i T: their covariance is
        σ_T² l_i l_j (ā_i ā_j + δ_ij σ_i²).
        """
        known = (
            ("base", design.baseline, self.base_expansion),
            ("focal_length", design.image_distance, self.focal_expansion),
        )
        steady, unsure = np.zeros(len(NAMES)), np.zeros(len(NAMES))
        for name, length, expansion in known:
            if expansion is not None:
                steady[INDEX[name]] = self.sigma * length * expansion.value
                unsure[INDEX[name]] = self.sigma * length * expansion.sigma
        return np.asarray(np.outer(steady, steady) + np.diag(unsure**2))


class Correlation(Part):
    """Correlations of the parameters' errors."""

    of: tuple[str, ...] = Field(min_length=1, max_length=len(NAMES), examples=[["base", "theta_zero"]])
    """Parameters, in the order of the rows; the others are independent of all."""
    matrix: tuple[tuple[Annotated[Number, Field(ge=-1.0, le=1.0)], ...], ...] = Field(
        examples=[[[1.0, 0.4], [0.4, 1.0]]]
    )
    """Row after row, symmetric, with 1 on the diagonal."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield names that are none, and a matrix that is no correlation."""
        for number, name in enumerate(self.of):
            if name not in INDEX:
                yield Fault(f"of[{number}]", f"there is no parameter '{name}'.", choice(name, NAMES))
        if len(set(self.of)) < len(self.of):
            yield Fault("of", "it names a parameter twice.", "Name each once.")
        size = len(self.of)
        if len(self.matrix) != size or any(len(row) != size for row in self.matrix):
            shape = f"{len(self.matrix)} rows of {', '.join(sorted({str(len(row)) for row in self.matrix}))} numbers"
            yield Fault(
                "matrix", f"it has {shape} for {size} parameters.", f"Write {size} rows of {size} numbers."
            )
            return
        matrix = np.array(self.matrix)
        if (np.abs(matrix - matrix.T) > 1e-9).any() or (np.abs(np.diagonal(matrix) - 1.0) > 1e-9).any():
            yield Fault(
                "matrix",
                "it is not symmetric with 1 on the diagonal.",
                "Write correlations, not covariances.",
            )
        elif (least := float(np.linalg.eigvalsh(matrix).min())) < _LEAST_SQUARE:
            yield Fault(
                "matrix",
                f"it is not positive semi-definite: its least eigenvalue is {least:.3g}, and some combination of the "
                "parameters would have a negative variance.",
                "Write all digits of the adjustment's result.",
            )


class CalibrationFile(Part):
    """A calibration as a file has it."""

    schema_version: Literal[1] = Field(alias="schema", examples=[1])
    """Version of the file's form."""
    about: str = Field(default="", max_length=10_000)
    """When and how it was made."""
    instrument: str = Field(pattern=r"^[0-9a-f]{12}$", examples=["0123456789ab"])
    """Digest of the instrument's design, to which the parameters are deviations."""
    encoder_period: Angle | None = Field(default=None, gt=1e-6, le=7.0, examples=["30 mrad"])
    """Period of the encoders' periodic errors, which need it."""
    parameters: CalibratedParameters
    """The parameters, each with its value and standard deviation."""
    correlation: Correlation | None = None
    """Correlations of their errors; without it they are independent."""
    temperature: TemperatureOfUse | None = None
    """Temperatures at which the instrument is used; without it those of the calibration."""
    vibration: Vibration | None = None
    """How the platform shakes where the instrument is used; without it not at all."""
    power_noise: Ratio = Field(default=0.0, ge=0.0, le=0.3)
    """Standard deviation of the laser's power from shot to shot, relative."""
    pulse_noise: Ratio = Field(default=0.0, ge=0.0, le=0.3)
    """The same of the pulses' energy."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield correlations of what has no error, and periodic errors without a period."""
        for number, name in enumerate(() if self.correlation is None else self.correlation.of):
            known = getattr(self.parameters, name, None)
            if known is None or known.sigma is None:
                problem = f"{name} has no standard deviation, and so no correlation."
                yield Fault(
                    f"correlation.of[{number}]", problem, f"Write parameters.{name}.sigma, or leave it out."
                )
        if self.encoder_period is None and any(getattr(self.parameters, name) for name in PERIODIC):
            problem = "the encoders have periodic errors, and their period is not given."
            yield Fault("encoder_period", problem, "Write for example 30 mrad.")

    def believed(self, design: Design) -> Calibration:
        """Return the calibration of an instrument of a design."""
        known = {name: getattr(self.parameters, name) for name in NAMES}
        values = np.array([0.0 if one is None else one.value for one in known.values()])
        sigma = np.array([0.0 if one is None else one.sigma or 0.0 for one in known.values()])
        correlation = np.eye(len(NAMES))
        if self.correlation is not None:
            index = [INDEX[name] for name in self.correlation.of]
            correlation[np.ix_(index, index)] = self.correlation.matrix
        covariance = correlation * sigma * sigma[:, None]
        if self.temperature is not None:
            covariance += self.temperature.covariance(design)
        return Calibration(
            values,
            covariance,
            design,
            self.encoder_period or math.tau,
            self.vibration,
            self.power_noise,
            self.pulse_noise,
        )


def design_of(scanner: Scanner) -> Design:
    """Return the lengths of a scanner as designed."""
    image = scanner.receiver.line_image
    baseline, separation = scanner.receiver.baseline, scanner.mirrors.axis_separation
    return Design(image.depth, baseline, separation, math.atan(image.slope))


def design_digest(scanner: Scanner) -> str:
    """Return what tells the design of an instrument from others: of all lengths to which parameters are deviations."""
    line, lidar = scanner.line_choice, scanner.lidar_choice
    array = () if line == "none" else (line.pitch, line.offset, line.pixels)
    numbers = (*vars(design_of(scanner)).values(), *array)
    place = "none" if lidar == "none" else lidar.photodiode.place
    text = json.dumps([f"{value:.9g}" for value in numbers] + [place])
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def read_calibration(path: Path, scanner: Scanner) -> Calibration:
    """Read the calibration of a scanner.

    Raises
    ------
    InputError
        If the file cannot be read.
    ScenarioError
        If it has faults, or belongs to another instrument.
    """
    found, document = read_part(path, CalibrationFile, "a calibration")
    own = design_digest(scanner)
    if found.instrument != own:
        problem = (
            f"this calibration belongs to the instrument {found.instrument}, and the scenario's is {own}."
        )
        remedy = f"Take the calibration of this instrument, or write 'instrument: {own}' if it is the same."
        raise ScenarioError(
            [Fault("instrument", problem, remedy, document.line(("instrument",)))], source=str(path)
        )
    believed = found.believed(design_of(scanner))
    if faults := list(_nothing_left(believed, document)):
        raise ScenarioError(faults, source=str(path))
    return believed


def _nothing_left(believed: Calibration, document: Document) -> Iterator[Fault]:
    """Yield departures that leave no base, no image distance or no pitch of the array."""
    design = believed.design
    whole = {"base": design.baseline, "focal_length": design.image_distance, "array_scale": 1.0}
    for name, length in whole.items():
        if length + believed.value(name) <= 0.0:
            problem = f"it takes away all of the design's {PARAMETERS[INDEX[name]].dimension.format(length)}."
            line = document.line(("parameters", name, "value"))
            yield Fault(f"parameters.{name}.value", problem, "Write the departure from the design.", line)


def believed_instrument(scenario: Scenario) -> Calibration | None:
    """Return the calibration of a scenario's instrument; None where it believes that it is as designed.

    Raises
    ------
    InputError, ScenarioError
        As :func:`read_calibration`.
    """
    path = scenario.processing.calibration
    return None if path is None else read_calibration(path, scenario.scanner)


def geometry_believed(scanner: Scanner, calibration: Calibration | None) -> Geometry:
    """Return how an instrument turns its readings into points, as it believes itself to be."""
    return replace(geometry_of(scanner_as_built(scanner, calibration)), calibration=calibration)


def believed_geometry(scenario: Scenario) -> Geometry:
    """Return how a scenario's instrument turns its readings into points."""
    return geometry_believed(scenario.scanner, believed_instrument(scenario))


def believed_text(scenario: Scenario, geometry: Geometry) -> str:
    """Return the calibration of a scenario's geometry as the text of a file; empty without one."""
    known = geometry.calibration
    return "" if known is None else calibration_text(known, scenario.scanner, "as this result was made")


def calibration_text(calibration: Calibration, scanner: Scanner, about: str = "") -> str:
    """Return a calibration as the text of a file, with a unit on every value; reading it gives it back."""
    sigma = np.sqrt(np.diagonal(calibration.covariance))
    lines = ["# Scanner Sim calibration, schema 1", "schema: 1", f"about: {json.dumps(about)}"]
    lines.append(f"instrument: '{design_digest(scanner)}'")
    listed = [number for number in range(len(NAMES)) if calibration.values[number] or sigma[number]]
    if calibration.encoder_period != math.tau or {NAMES[number] for number in listed} & {*PERIODIC}:
        lines.append(f"encoder_period: {calibration.encoder_period!r} rad")
    for name in ("power_noise", "pulse_noise"):
        if getattr(calibration, name):
            lines.append(f"{name}: {getattr(calibration, name)!r}")
    if calibration.vibration is not None:
        lines.append("vibration:")
        lines += [f"  {name}: {points}" for name, points in _spectra(calibration.vibration).items()]
    lines.append("parameters:")
    for number in listed:
        spell = PARAMETERS[number].dimension.format
        own = f", sigma: {spell(float(sigma[number]))}" if sigma[number] else ""
        lines.append(f"  {NAMES[number]}: {{value: {spell(float(calibration.values[number]))}{own}}}")
    if not listed:
        lines[-1] += " {}"
    free = [number for number in listed if sigma[number]]
    matrix = calibration.covariance[np.ix_(free, free)] / sigma[free] / sigma[free][:, None]
    if (np.abs(matrix - np.eye(len(free))) > 0.0).any():
        lines += ["correlation:", f"  of: [{', '.join(NAMES[number] for number in free)}]", "  matrix:"]
        np.fill_diagonal(matrix, 1.0)
        rows = (", ".join(f"{value:.15g}" for value in np.clip(row, -1.0, 1.0).tolist()) for row in matrix)
        lines += [f"    - [{row}]" for row in rows]
    return "\n".join(lines) + "\n"


def _spectra(vibration: Vibration) -> dict[str, str]:
    """Return the spectra of a vibration as a file would spell them."""
    units, given = {"turn": "rad^2/Hz", "shift": "m^2/Hz"}, {"turn": vibration.turn, "shift": vibration.shift}
    return {
        name: "[" + ", ".join(f"[{rate!r} Hz, {density!r} {units[name]}]" for rate, density in points) + "]"
        for name, points in given.items()
        if points is not None
    }
