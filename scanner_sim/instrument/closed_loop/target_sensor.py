"""From patterns of the mirrors to their measured voxels: what lies between the tracker and the instrument.

Every array has a leading axis of patterns. They may be of several runs, each with a seed of its own; what a row holds
does not depend on the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.calibration import believed_instrument
from scanner_sim.config.scanner import RangefinderName, speckle_optics
from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.encoders import reading_noise
from scanner_sim.detector.packets import dwell_average
from scanner_sim.instrument.closed_loop.believed_positions import BelievedPositions, RangeNoise
from scanner_sim.instrument.closed_loop.situation import Situation
from scanner_sim.instrument.closed_loop.visit_errors import (
    PatternSpeckle,
    beam_radius,
    duty_cycle_of,
    error_parts,
    image_variance,
    seen_from,
    spot_packets,
)
from scanner_sim.ranging.fusion import share_of_pulses
from scanner_sim.ranging.ranges import Columns
from scanner_sim.scan.protocol import Aim
from scanner_sim.scan.schedule import PatternMotion
from scanner_sim.signals.line.peaks import faintest_signal
from scanner_sim.tracking.errors import ErrorParts
from scanner_sim.tracking.measurement import Measurement, measure_target
from scanner_sim.tracking.record import TrackTarget
from scanner_sim.tracking.samples import PatternSamples, angles_later
from scanner_sim.tracking.state import TrackCommand

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

_LEAST_NOISE_PHOTODIODE = 0.01
"""Relative differences of the light from a surface that no noise explains, on a photodiode that sees the whole spot."""
_LEAST_NOISE_LINE = 5e-3
"""Relative differences between a target's response and its model, a straight edge and a round spot, without any noise:
the scatter of 128 voxels on discs at 4 to 12 m, tilted by up to 20°: 0.3 to 1 %."""
_LEAST_NOISE = {"triangulation": _LEAST_NOISE_LINE, "tof": _LEAST_NOISE_PHOTODIODE}
_RANGED = ("range_m", "sigma_range_m", "status")
_FUSED = tuple(f"fused.{name}" for name in _RANGED)
_OTHERS = {
    ("triangulation",): (),
    ("tof",): ("tof.sigma_range_m",),
    ("triangulation", "tof"): ("tof.sigma_range_m", *_FUSED),
}
"""What of the instrument's layers the tracker looks at beside those of the first rangefinder."""
_SHOTS_TOGETHER = 8192
"""Shots of a run whose encoder noise is drawn together: it depends on their numbers alone."""
_MOST_SHOTS_TOGETHER = 65536
"""Shots of all runs."""


class MeasuresShots(Protocol):
    """What measures the shots of patterns."""

    def measure(self, aim: Aim, run: Numbers, situations: Sequence[Situation] | None = None) -> Columns:
        """Return the layers of the shots of an aim, pattern after pattern, each of a run; each of shape (n,)."""


def aim_of(motion: PatternMotion, visit: Numbers) -> Aim:
    """Return the aim of patterns as the mirrors ran them, one after the other.

    The shots of each are numbered on from visit · points.
    """
    points = motion.time.shape[1]
    first = visit * points
    shot = first[:, None] + np.arange(points)
    return Aim(
        shot=shot.astype(np.uint32).ravel(),
        theta=motion.true_theta.ravel(),
        phi=motion.true_phi.ravel(),
        time=motion.time.ravel(),
        travel_theta=motion.travel_theta.ravel(),
        travel_phi=motion.travel_phi.ravel(),
    )


class Encoders:
    """The encoders' readings of patterns.

    Parameters
    ----------
    scenarios
        Mirrors and pattern, which are the same in all, and the seed of each run.
    """

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        self._mirrors = scenarios[0].scanner.mirrors
        self._seeds = np.array([scenario.seed for scenario in scenarios], dtype=np.uint64)
        self._points = scenarios[0].following.pattern.points
        shots = min(_SHOTS_TOGETHER, _MOST_SHOTS_TOGETHER // len(scenarios))
        self._visits = max(1, shots // self._points)
        self._block = np.full(len(scenarios), -1)
        self._noise = np.zeros((len(scenarios), self._visits, 2, self._points))

    def read(self, motion: PatternMotion, visit: Numbers, run: Numbers) -> Array:
        """Return what the encoders read of patterns, each of a visit of a run: Θ and φ, (patterns, 2, points) [rad].

        The angles where they latched, earlier than the middle of the dwell, with the jitter that they see, their
        noise and their steps.
        """
        block, index = np.divmod(visit, self._visits)
        new = block != self._block[run]
        if new.any():
            self._draw(run[new], block[new])
        latched = np.stack([motion.latched_theta, motion.latched_phi], axis=1)
        angle = latched + self._noise[run, index]
        step = self._mirrors.readout_step
        return np.asarray(np.rint(angle / step) * step) if step > 0.0 else angle

    def _draw(self, run: Numbers, block: Numbers) -> None:
        """Draw a block of noise of each of some runs."""
        count = self._visits * self._points
        shot = np.arange(count) + block[:, None] * count
        seeds = np.repeat(self._seeds[run], count)
        noise = np.stack(reading_noise(shot.astype(np.uint32).ravel(), self._mirrors, seeds))
        shape = (2, len(run), self._visits, self._points)
        self._noise[run] = noise.reshape(shape).transpose(1, 2, 0, 3)
        self._block[run] = block


class SignalNoise:
    """What the instrument knows of the noise of its signals.

    Parameters
    ----------
    scenario
        Instrument and processing.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario, scanner = scenario, scenario.scanner
        self._optics = speckle_optics(scanner) if scanner.laser.speckle else None
        known, pulses = believed_instrument(scenario), scenario.rangefinders[0] == "tof"
        self._power = 0.0 if known is None else known.pulse_noise if pulses else known.power_noise

    def sigma(self, layers: Columns, speckle: PatternSpeckle | None, image: Array) -> Array:
        """Return the standard deviations of the signals of patterns, shape (patterns, points), in their own unit.

        Line sensor: σ² = σ_N² + (c N)² + (0.005 N)² + (ν N)², the third for what the model of a target leaves, and the
        noise ν of the laser's power that the calibration knows. N is the charge of nine pixels, σ_N its standard
        deviation by noise and by the light beneath it (:mod:`scanner_sim.signals.line.peaks`). c is the contrast of the
        whole spot's speckle, c² = C² A/M of the beam's image (:mod:`scanner_sim.optics.speckle`) with what the dwell
        leaves of its variance, A: ``speckle``.
        Where no spot was found there is any light from none to that of the faintest ones that are, of the standard
        deviation ``image`` on the line [pixel], shape (patterns,): σ is that of an even distribution, 1/√12 of it.
        Photodiode: σ_N = N/q with the height q of the echo over the noise, 1 % of N, for its noise is below what
        surfaces and light are uneven by, the same c without a dwell, and ν of the pulses' energy.
        """
        signal = np.asarray(layers["Y"], dtype=np.float64)
        signal = np.where(np.isnan(signal), 0.0, signal)
        noise = np.asarray(layers["sigma_Y"], dtype=np.float64)
        least = _LEAST_NOISE[self._scenario.rangefinders[0]]
        known = least**2 + self._power**2
        contrast = known if speckle is None else known + speckle.light
        sigma = np.sqrt(noise**2 + contrast * signal**2)
        if self._scenario.rangefinders[0] != "triangulation":
            return np.asarray(sigma)
        # Of a pattern the least: edges of the background beneath a peak are in σ_N too, and are no noise of pixels.
        faintest = faintest_signal(noise.min(axis=1), image, self._scenario.processing)[:, None]
        return np.where(signal > 0.0, sigma, faintest / math.sqrt(12.0))

    def speckle(self, motion: PatternMotion, distance: Array) -> PatternSpeckle | None:
        """Return what speckle does to the light of spots at ranges [m], shape (patterns,); None without.

        V, the speckle of single pixels by which the ranges' fit weighs them, is the mean over each pattern. A pulse
        lasts no dwell.
        """
        scanner = self._scenario.scanner
        if self._optics is None:
            return None
        radius, way = beam_radius(scanner, distance), (duty_cycle_of(self._scenario) * distance)[:, None]
        along, across = way * motion.travel_theta, way * np.cos(motion.true_theta) * motion.travel_phi
        left = dwell_average(along, across, radius[:, None])
        image = 0.5 * radius * scanner.receiver.focal_length / (distance * scanner.position_sensor.pitch)
        light = spot_packets(scanner, self._optics, image**2, distance)
        _, others = replace(light, on_surface=light.on_surface[:, None]).moving(*left)
        contrast = self._scenario.processing.speckle_contrast**2
        energy = contrast * light.energy
        single = np.array([ratio**4 for ratio in light.ratio.tolist()])
        grain = energy * (others.mean(axis=1) * single)
        return PatternSpeckle(self._optics, energy[:, None] * left[0], grain)


def samples_of(
    layers: Columns,
    motion: PatternMotion,
    angles: Array,
    sigma_signal: Array,
) -> PatternSamples:
    """Return the voxels of patterns.

    Parameters
    ----------
    layers
        What the instrument measured, each of shape (patterns, points). Ranges are the fused ones where there are two.
    motion
        The mirrors' motion, for the times.
    angles
        Read deflections, without a delay that is known, shape (patterns, 2, points) [rad].
    sigma_signal
        Standard deviations of the signals, shape (patterns, points).

    Notes
    -----
    The ranges were found with readings in the middle of the dwell: what a delay that is not taken off does to them,
    R tanΘ times the angle's error, is left out.
    """
    prefix = "fused." if "fused.range_m" in layers else ""
    signal, distance, sigma = (
        np.asarray(layers[name], dtype=np.float64)
        for name in ("Y", f"{prefix}range_m", f"{prefix}sigma_range_m")
    )
    return PatternSamples(
        time=motion.time,
        theta=angles[:, 0],
        phi=angles[:, 1],
        signal=signal,
        sigma_signal=sigma_signal,
        range=distance,
        sigma_range=sigma,
        status=layers[f"{prefix}status"].astype(np.uint8),
    )


@dataclass(frozen=True)
class ExpectedPatterns:
    """What is known of patterns before they are measured, whatever stands before the scanner.

    Attributes
    ----------
    motion
        How the mirrors run the patterns.
    number
        Of each pattern at its target, shape (patterns,).
    place, rates
        Where targets are expected, (Θ, φ, R), and how that changes per second, shape (patterns, 3).
    angles, pointing
        Read deflections, without a delay that is known, and what is unknown of them, shape (patterns, 2, points) and
        (patterns, points) [rad].
    speckle
        What is known of the speckle there; None without.
    spot
        Standard deviation of the spot as an angle [rad], shape (patterns,).
    image
        The same of its image on the line [pixel].
    """

    motion: PatternMotion
    number: Numbers
    place: Array
    rates: Array
    angles: Array
    pointing: Array
    speckle: PatternSpeckle | None
    spot: Array
    image: Array


class TargetSensor:
    """What the tracker sees through an instrument: voxels of patterns, and the positions of targets in them.

    Parameters
    ----------
    scenarios
        Instrument and scan, which are the same in all, and the seeds of the runs.
    instrument
        What measures shots.
    """

    def __init__(self, scenarios: Sequence[Scenario], instrument: MeasuresShots) -> None:
        scenario = scenarios[0]
        self._scenario, self._instrument = scenario, instrument
        self._encoders, self._noise = Encoders(scenarios), SignalNoise(scenario)
        self._believed = BelievedPositions(scenario)
        self._layers = ("Y", "sigma_Y", *_RANGED, *_OTHERS[scenario.rangefinders])
        mirrors = scenario.scanner.mirrors
        unseen = (1.0 - mirrors.jitter_seen) * mirrors.jitter**2
        self._pointing = math.sqrt(unseen + mirrors.readout_noise**2 + mirrors.readout_step**2 / 12.0)

    def expect(
        self, orders: Sequence[TrackCommand], motion: PatternMotion, visit: Numbers, run: Numbers
    ) -> ExpectedPatterns:
        """Return what is known of patterns before they are measured.

        Parameters
        ----------
        orders, motion
            Where the target is expected in each pattern, and how the mirrors run it.
        visit, run
            Number of each visit, and of the run whose seed it has: they address every random number. Shape (patterns,).
        """
        place = np.array([order.position for order in orders])
        distance = place[:, 2]
        angles = self._believed.deflections(self._encoders.read(motion, visit, run))
        corrected = self._scenario.following.correct_delay
        delay = self._scenario.scanner.galvanometers.readout_delay if corrected else 0.0
        return ExpectedPatterns(
            motion=motion,
            number=np.array([order.number for order in orders]),
            place=place,
            rates=np.array([order.rates for order in orders]),
            angles=angles_later(motion.time, angles, delay) if delay > 0.0 else angles,
            pointing=np.hypot(self._pointing, unevenness(angles)),
            speckle=self._noise.speckle(motion, distance),
            spot=beam_radius(self._scenario.scanner, distance) / (2.0 * distance),
            image=np.sqrt(image_variance(self._scenario.scanner, distance)),
        )

    def measure(
        self,
        motion: PatternMotion,
        visit: Numbers,
        run: Numbers,
        situations: Sequence[Situation] | None = None,
    ) -> Columns:
        """Return the layers of the shots of patterns, one pattern after the other.

        Parameters
        ----------
        motion, visit, run
            As of :meth:`expect`.
        situations
            Where things are about each pattern; by default as the scenarios say when they begin.
        """
        return self._instrument.measure(aim_of(motion, visit), run, situations)

    def see(
        self, target: TrackTarget, measured: Columns, expected: ExpectedPatterns
    ) -> tuple[PatternSamples, Measurement, ErrorParts]:
        """Return the voxels of patterns, where they show the target, and the parts of those positions' errors.

        Parameters
        ----------
        target
            What was looked for, alike in all runs.
        measured, expected
            What was measured of the patterns, and what was known before.
        """
        scanner, motion, rates = self._scenario.scanner, expected.motion, expected.rates
        layers = {
            name: measured[name].reshape(motion.time.shape) for name in self._layers if name in measured
        }
        sigma = self._noise.sigma(layers, expected.speckle, expected.image)
        samples = samples_of(layers, motion, expected.angles, sigma)
        middle = 0.5 * (motion.time[:, 0] + motion.time[:, -1])
        noise = cache(lambda: range_noise(layers, self._range_covariance(expected.place, middle)))
        by_line = share_of_line(self._scenario.rangefinders, noise, len(middle))
        seen = measure_target(
            samples.at_rest(middle, expected.place, rates),
            target.appearance,
            expected.place[:, 2],
            spot=expected.spot,
            duty_cycle=duty_cycle_of(self._scenario),
            pointing=expected.pointing,
            axis_separation=scanner.mirrors.axis_separation,
            baseline=seen_from(self._scenario),
            by_line=by_line if self._scenario.rangefinders[0] == "triangulation" else None,
        )
        seen = replace(seen, position=seen.position + rates * (seen.time - middle)[:, None])
        parts = error_parts(
            self._scenario,
            samples,
            seen,
            target,
            motion,
            expected.number,
            expected.speckle,
            by_line,
        )
        position = self._believed.designed(seen.position)
        common = self._believed.in_common(position, noise)
        if common.shape[-1]:
            parts = replace(parts, common=common)
        return samples, replace(seen, position=position, covariance=parts.whole), parts

    def _range_covariance(self, place: Array, time: Array) -> Array:
        """Return the covariance of the noise of both rangefinders at (Θ, φ, R), (patterns, 3), and times [s], in m²."""
        sigma_theta = self._scenario.scanner.mirrors.reading_sigma(place[:, 0], time)
        return self._believed.range_covariance(place, sigma_theta)


def share_of_line(
    rangefinders: tuple[RangefinderName, ...], noise: Callable[[], RangeNoise], patterns: int
) -> Array:
    """Return triangulation's share of the ranges of patterns, shape (patterns,): 1 or 0 where there is one of both."""
    if len(rangefinders) == 1:
        return np.full(patterns, float(rangefinders[0] == "triangulation"))
    line, pulses, covariance = noise()
    share = share_of_pulses(line, pulses, np.isfinite(line), np.isfinite(pulses), covariance)
    return np.nan_to_num(1.0 - share)


def range_noise(layers: Columns, covariance: Array) -> RangeNoise:
    """Return the noise of the ranges of patterns by either rangefinder: the median of their voxels, ∞ without any.

    ``covariance`` is that of both [m²], shape (patterns,).
    """

    def median(name: str) -> Array:
        values = np.asarray(layers[name], dtype=np.float64) if name in layers else np.full((1, 1), np.inf)
        known = np.isfinite(values)
        ascending = np.sort(np.where(known, values, np.inf), axis=1)
        middle = np.maximum(known.sum(axis=1) - 1, 0) // 2
        return np.asarray(np.take_along_axis(ascending, middle[:, None], axis=1)[:, 0])

    return RangeNoise(median("sigma_range_m"), median("tof.sigma_range_m"), covariance)


def unevenness(angles: Array) -> Array:
    """Return by how much angles may err where the mirrors do not accelerate evenly, shape (patterns, points) [rad].

    The middle of a dwell, its mean and the angle a delay later are known from the neighbours as far as the acceleration
    is even. A jump of it by Δa within a dwell T leaves up to Δa T²/12, and shows as a third difference of Δa T²: so it
    is where the mirrors still turn round when a pattern begins.

    Parameters
    ----------
    angles
        Read deflections, shape (patterns, 2, points) [rad].
    """
    third = np.abs(np.diff(angles, 3, axis=2)).max(axis=1)
    spread = np.concatenate([third[:, :1], third, third[:, -1:], third[:, -1:]], axis=1)
    spread[:, 1:] = np.maximum(spread[:, 1:], spread[:, :-1])
    return spread / 12.0
