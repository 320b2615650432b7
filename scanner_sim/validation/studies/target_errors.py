"""What the instrument errs about the positions of single targets, from simulated pixels.

A grid of equal discs on plates faces the scanner in the dark. Over each disc the mirrors run the tracker's patterns;
their voxels go through light, sensors, peaks, ranges and the fit of the disc. The errors are those of the measured
positions against the centres of the discs: angles from the line sensor's intensities, ranges from each rangefinder
that the instrument has.

Not in the errors: Sun and Earth, the tracker's own pointing, and what is common to all patterns: the mirrors' scale and
zero, a distortion of the scanner, the survey of the targets.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.built import with_serial_number
from scanner_sim.config.scanner import RangefinderName
from scanner_sim.config.scenario import Scenario
from scanner_sim.instrument.closed_loop.target_sensor import TargetSensor, aim_of
from scanner_sim.ranging.ranges import Columns
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scan.protocol import Aim
from scanner_sim.scan.schedule import PatternMotion
from scanner_sim.tracking.measurement import Measurement
from scanner_sim.tracking.state import TrackCommand, TrackMode
from scanner_sim.validation.studies.target_grid import (
    StudyTarget,
    grid_motions,
    spread_distances,
    target_grid,
)

Array = NDArray[np.float64]

_PREFIX: dict[RangefinderName, str] = {"triangulation": "", "tof": "tof."}
"""Before the names of a rangefinder's layers, where there is a line sensor."""


@dataclass(frozen=True, eq=False)
class TargetErrors:
    """Measured less true positions of targets at one range.

    Attributes
    ----------
    distance
        Of the grid's plane [m].
    rangings
        The n ways in which ranges were measured.
    error
        Θ, φ [rad], and R by each of them [m], shape (positions, observations, 2 + n); NaN where the target was not
        found. A position is one of the spot in its pixel: what the peak's estimator errs there is common to all targets
        at that range.
    sigma
        The standard deviations that were stated, shape (positions, observations, 2 + n).
    voxel
        Median of the stated σ of single voxels' angles and ranges, shape (2 + n,).
    """

    distance: float
    rangings: tuple[RangefinderName, ...]
    error: Array
    sigma: Array
    voxel: Array

    def of(self, ranging: RangefinderName) -> tuple[Array, Array]:
        """Return errors and stated σ of (Θ, φ, R) with one way of ranging, each (positions, observations, 3)."""
        chosen = [0, 1, 2 + self.rangings.index(ranging)]
        return self.error[..., chosen], self.sigma[..., chosen]

    @property
    def found(self) -> Array:
        """Shares of the observations with each quantity, shape (2 + n,)."""
        return np.asarray(np.isfinite(self.error).mean(axis=(0, 1)))

    @property
    def scatter(self) -> Array:
        """Root mean squares of the errors, shape (2 + n,)."""
        return _root_mean_square(self.error)

    @property
    def common(self) -> Array:
        """Root mean squares over positions of the mean errors, shape (2 + n,): what all targets of a visit share."""
        known = np.isfinite(self.error)
        with np.errstate(invalid="ignore"):
            means = np.where(known, self.error, 0.0).sum(axis=1) / known.sum(axis=1)
        return _root_mean_square(means[:, None])

    @property
    def stated(self) -> Array:
        """Root mean squares of the stated standard deviations, shape (2 + n,)."""
        return _root_mean_square(self.sigma)


def _root_mean_square(values: Array) -> Array:
    known = np.isfinite(values)
    squares = np.where(known, values, 0.0) ** 2
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(squares.sum(axis=(0, 1)) / known.sum(axis=(0, 1))))


@guest()
def measure_targets(
    scenario: Scenario,
    target: StudyTarget,
    distance: float,
    *,
    positions: int = 4,
    patterns: int = 4,
    device: DeviceChoice = "auto",
) -> TargetErrors:
    """Measure a grid of targets many times.

    Parameters
    ----------
    scenario
        Instrument and processing; its scene, lighting and scan are left out.
    target
        What is measured.
    distance
        Of the grid [m].
    positions
        Distances about this one at which the spot lies at evenly spaced positions in its pixel.
    patterns
        Patterns over each of the 36 targets at each position.
    device
        Where to compute.

    Returns
    -------
    TargetErrors
        Of positions × 36 · patterns observations. Each pattern is measured by itself.

    Raises
    ------
    InputError
        If the instrument has no line sensor, by whose light targets are told.
    """
    rangings = scenario.scanner.rangefinders
    scenario, errors, sigmas, voxels = with_serial_number(scenario), [], [], []
    for index, where in enumerate(spread_distances(scenario, distance, positions)):
        seed = (scenario.seed + 7919 * index + round(1e6 * distance)) % 2**63
        instrument, centres = target_grid(scenario, target, where, seed, device)
        motions = grid_motions(instrument.scenario, target, centres, patterns)
        layers = instrument.measure(aim_of(motions, np.arange(len(centres) * patterns)))
        truth = np.repeat(centres, patterns, axis=0)
        places, stated = zip(
            *(_seen(instrument.scenario, layers, motions, truth, target, ranging) for ranging in rangings),
            strict=True,
        )
        errors.append(_columns([place - truth for place in places]))
        sigmas.append(_columns(stated))
        voxels.append(_voxel_sigma(scenario, layers))
    return TargetErrors(distance, rangings, np.stack(errors), np.stack(sigmas), np.mean(voxels, axis=0))


def _columns(by_ranging: Sequence[Array]) -> Array:
    """Return Θ and φ of the first way of ranging, and R of each, shape (observations, 2 + n), of (observations, 3)."""
    return np.concatenate([by_ranging[0][:, :2], *(one[:, 2:] for one in by_ranging)], axis=1)


class _MeasuredPatterns:
    """Shots that were measured before: what an instrument is to the eye."""

    def __init__(self, layers: Columns) -> None:
        self._layers = layers

    def measure(self, aim: Aim, run: NDArray[np.int64], situations: object = None) -> Columns:  # noqa: ARG002 (there is one run)
        """Return the layers of the shots of an aim."""
        return {name: values[aim.shot] for name, values in self._layers.items()}


def _seen(
    scenario: Scenario,
    layers: Columns,
    motions: PatternMotion,
    truth: Array,
    target: StudyTarget,
    ranging: RangefinderName,
) -> tuple[Array, Array]:
    """Return positions and stated σ as the tracker's eye measures them, each (observations, 3); NaN where it does not.

    Light is the line sensor's: the photodiode's pulses last no dwell, and near targets saturate it.
    """
    own = {name: layers[f"{_PREFIX[ranging]}{name}"] for name in ("range_m", "sigma_range_m", "status")}
    own |= {name: layers[name] for name in ("Y", "sigma_Y")}
    # With its own light and another's range it is neither of both; of what triangulation's voxels share, time of flight
    # has nothing, as a fused range that is all of pulses.
    own["tof.sigma_range_m"] = np.zeros_like(own["sigma_range_m"])
    kind = "triangulation" if ranging == "triangulation" else "both"
    eye = TargetSensor((scenario.model_copy(update={"ranging": kind}),), _MeasuredPatterns(own))
    visits = np.arange(len(truth))
    orders = [TrackCommand(TrackMode.TRACK, truth[visit], 0.0, visit) for visit in visits.tolist()]
    followed = scenario.targets[0]  # all look alike
    run = np.zeros_like(visits)
    measured = eye.measure(motions, visits, run)
    _, seen, _ = eye.see(followed, measured, eye.expect(orders, motions, visits, run))
    taken = _taken(seen, target)[:, None]
    variance = np.diagonal(seen.covariance, axis1=1, axis2=2)
    return np.where(taken, seen.position, np.nan), np.sqrt(np.where(taken, variance, np.nan))


def _voxel_sigma(scenario: Scenario, layers: Columns) -> Array:
    """Return the medians of the stated σ of single voxels: Θ, φ, and R by each rangefinder."""
    angle = float(scenario.scanner.mirrors.reading_sigma(np.zeros(1), np.zeros(1))[0])
    ranges = []
    for ranging in scenario.scanner.rangefinders:
        sigma = np.asarray(layers[f"{_PREFIX[ranging]}sigma_range_m"], dtype=np.float64)
        known = sigma[np.isfinite(sigma)]
        ranges.append(float(np.median(known)) if known.size else math.nan)
    return np.array([angle, angle, *ranges])


def _taken(seen: Measurement, target: StudyTarget) -> NDArray[np.bool_]:
    """Return which measurements a tracker on its target would take, (n,): firm fits of a disc of the right size.

    The rules of :func:`scanner_sim.tracking.state.advance`, but for the prediction, which has no part here.
    """
    settings, expected = target.tracker, 0.5 * target.diameter / seen.position[:, 2]
    allowed = settings.size_tolerance * expected + 3.0 * seen.sigma_radius
    with np.errstate(invalid="ignore"):
        firm = np.sqrt(seen.covariance[:, 0, 0] + seen.covariance[:, 1, 1]) <= 0.5 * expected
        right = np.abs(seen.radius - expected) <= np.minimum(allowed, 0.5 * expected)
        return np.asarray(seen.found & firm & right & (seen.misfit <= settings.misfit))
