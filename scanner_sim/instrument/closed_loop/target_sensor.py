"""From a pattern of the mirrors to its measured voxels: what lies between the tracker and the instrument."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.scanner import speckle_optics
from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.encoders import reading_noise
from scanner_sim.detector.packets import dwell_average
from scanner_sim.instrument.closed_loop.visit_errors import duty_cycle_of, error_parts
from scanner_sim.optics.speckle import packets_of
from scanner_sim.ranging.ranges import Columns
from scanner_sim.scan.protocol import Aim
from scanner_sim.scan.schedule import PatternMotion
from scanner_sim.tracking.errors import ErrorParts
from scanner_sim.tracking.measurement import Measurement, measure_target
from scanner_sim.tracking.record import TrackTarget
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.state import TrackCommand

Array = NDArray[np.float64]

_LEAST_NOISE_PHOTODIODE = 0.01
"""Relative differences of the light from a surface that no noise explains, on a photodiode that sees the whole spot."""
_LEAST_NOISE_LINE = 5e-3
"""Relative differences between a target's response and its model, a straight edge and a round spot, without any noise:
the scatter of 128 voxels on discs at 4 to 12 m, tilted by up to 20°: 0.3 to 1 %."""
_LEAST_NOISE = {"triangulation": _LEAST_NOISE_LINE, "tof": _LEAST_NOISE_PHOTODIODE}
_SHOTS_TOGETHER = 8192
"""Shots whose encoder noise is drawn together: it depends on their numbers alone."""


class MeasuresShots(Protocol):
    """What measures the shots of an aim."""

    def measure(self, aim: Aim) -> Columns:
        """Return the layers of the shots, each of shape (n,)."""


def aim_of(motion: PatternMotion, visit: int) -> Aim:
    """Return the aim of a pattern as the mirrors ran it; shots are numbered on from visit · points."""
    points = len(motion.time)
    first = visit * points
    return Aim(
        shot=np.arange(first, first + points, dtype=np.uint64).astype(np.uint32),
        theta=motion.true_theta,
        phi=motion.true_phi,
        time=motion.time,
        travel_theta=motion.travel_theta,
        travel_phi=motion.travel_phi,
    )


class Encoders:
    """The encoders' readings of patterns.

    Parameters
    ----------
    scenario
        Mirrors, pattern and seed.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._mirrors, self._seed = scenario.scanner.mirrors, scenario.seed
        self._points = scenario.following.pattern.points
        self._visits = max(1, _SHOTS_TOGETHER // self._points)
        self._block = -1
        self._noise = np.zeros((2, 0))

    def read(self, motion: PatternMotion, visit: int) -> Array:
        """Return what the encoders read of a pattern, Θ and φ, shape (2, points) [rad].

        The angles where they latched, earlier than the middle of the dwell, with the jitter that they see, their
        noise and their steps.
        """
        block, index = divmod(visit, self._visits)
        if block != self._block:
            count = self._visits * self._points
            shot = (np.arange(count, dtype=np.uint64) + block * count).astype(np.uint32)
            self._block = block
            self._noise = np.stack(reading_noise(shot, self._mirrors, self._seed))
        start = index * self._points
        latched = np.stack([motion.latched_theta, motion.latched_phi])
        angle = latched + self._noise[:, start : start + self._points]
        step = self._mirrors.readout_step
        return np.asarray(np.rint(angle / step) * step) if step > 0.0 else angle


class SignalNoise:
    """What the instrument knows of the noise of its signals.

    Parameters
    ----------
    scenario
        Instrument and processing.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario

    def sigma(self, layers: Columns, speckle: Array) -> Array:
        """Return the standard deviations of the signals of a pattern, shape (points,), in their own unit.

        Line sensor: σ² = σ_N² + (c N)² + (0.005 N)², the last for what the model of a target leaves. N is the charge of
        nine pixels, σ_N its standard deviation by noise and by the light beneath it
        (:mod:`scanner_sim.signals.line.peaks`). c is the contrast of the whole spot's speckle, c² = C² A/M of the
        beam's image (:mod:`scanner_sim.optics.speckle`) with what the dwell leaves of its variance, A: ``speckle``.
        Photodiode: σ_N = N/q with the height q of the echo over the noise, 1 % of N, for its noise is below what
        surfaces and light are uneven by, and the same c without a dwell.
        """
        signal = np.nan_to_num(np.asarray(layers["Y"], dtype=np.float64))
        noise = np.asarray(layers["sigma_Y"], dtype=np.float64)
        least = _LEAST_NOISE[self._scenario.rangefinders[0]]
        return np.asarray(np.sqrt(noise**2 + (least**2 + speckle) * signal**2))

    def speckle(self, motion: PatternMotion, distance: float) -> tuple[Array, float]:
        """Return what speckle does to the light of spots at a range [m].

        Its relative variance in the dwells of a pattern, shape (points,), and V, the speckle of single pixels by which
        the ranges' fit weighs them, mean over the pattern
        (:attr:`~scanner_sim.signals.line.speckle.SpotSpeckle.single`). A pulse lasts no dwell.
        """
        scanner = self._scenario.scanner
        if not scanner.laser.speckle:
            return np.zeros(len(motion.time)), 0.0
        radius, way = float(scanner.laser.radius(distance)), duty_cycle_of(self._scenario) * distance
        left = dwell_average(
            way * motion.travel_theta, way * np.cos(motion.true_theta) * motion.travel_phi, radius
        )
        image = 0.5 * radius * scanner.receiver.focal_length / (distance * scanner.position_sensor.pitch)
        light = packets_of(speckle_optics(scanner), image**2, image**2)
        _, others = light.moving(*left)
        contrast = self._scenario.processing.speckle_contrast**2
        energy = contrast * float(light.energy)
        return energy * left[0], energy * float(np.mean(others) * light.ratio**4)


def samples_of(
    layers: Columns,
    motion: PatternMotion,
    angles: Array,
    sigma_signal: Array,
    delay: float,
) -> PatternSamples:
    """Return the voxels of a pattern.

    Parameters
    ----------
    layers
        What the instrument measured, each of shape (points,). Ranges are the fused ones where there are two.
    motion
        The mirrors' motion, for the times.
    angles
        Read deflections, shape (2, points) [rad].
    sigma_signal
        Standard deviations of the signals, shape (points,).
    delay
        Known delay of the readings [s] that is taken off; 0 for none.

    Notes
    -----
    The ranges were found with readings in the middle of the dwell: what a delay that is not taken off does to them,
    R tanΘ times the angle's error, is left out.
    """
    prefix = "fused." if "fused.range_m" in layers else ""
    signal, distance, sigma = (
        np.asarray(layers[name], dtype=np.float64)[None]
        for name in ("Y", f"{prefix}range_m", f"{prefix}sigma_range_m")
    )
    samples = PatternSamples(
        time=motion.time[None],
        theta=angles[0][None],
        phi=angles[1][None],
        signal=signal,
        sigma_signal=sigma_signal[None],
        range=distance,
        sigma_range=sigma,
        status=layers[f"{prefix}status"].astype(np.uint8)[None],
    )
    return samples.later(delay) if delay > 0.0 else samples


class TargetSensor:
    """What the tracker sees through an instrument: voxels of patterns, and the positions of targets in them.

    Parameters
    ----------
    scenario
        Instrument and scan.
    instrument
        What measures shots.
    """

    def __init__(self, scenario: Scenario, instrument: MeasuresShots) -> None:
        self._scenario, self._instrument = scenario, instrument
        self._encoders, self._noise = Encoders(scenario), SignalNoise(scenario)
        mirrors = scenario.scanner.mirrors
        unseen = (1.0 - mirrors.jitter_seen) * mirrors.jitter**2
        self._pointing = math.sqrt(unseen + mirrors.readout_noise**2 + mirrors.readout_step**2 / 12.0)

    def see(
        self, target: TrackTarget, order: TrackCommand, motion: PatternMotion, visit: int
    ) -> tuple[PatternSamples, Measurement, ErrorParts]:
        """Return the voxels of a pattern, where they show the target, and the parts of that position's error.

        Parameters
        ----------
        target, order
            What was looked for, and where it was expected.
        motion
            How the mirrors ran the pattern.
        visit
            Number of the visit, which addresses every random number.
        """
        scanner, expected = self._scenario.scanner, float(order.position[2])
        layers = self._instrument.measure(aim_of(motion, visit))
        delay = scanner.galvanometers.readout_delay if self._scenario.following.correct_delay else 0.0
        light, grain = self._noise.speckle(motion, expected)
        sigma = self._noise.sigma(layers, light)
        angles = self._encoders.read(motion, visit)
        samples = samples_of(layers, motion, angles, sigma, delay)
        spot = float(scanner.laser.radius(expected)) / (2.0 * expected)
        seen = measure_target(
            samples,
            target.appearance,
            expected,
            spot=spot,
            duty_cycle=duty_cycle_of(self._scenario),
            pointing=np.hypot(self._pointing, unevenness(angles))[None],
            axis_separation=scanner.mirrors.axis_separation,
        )
        parts = error_parts(self._scenario, samples, seen, target.appearance, motion, light, grain)
        return samples, replace(seen, covariance=parts.whole[None]), parts


def unevenness(angles: Array) -> Array:
    """Return by how much angles may err where the mirrors do not accelerate evenly, shape (points,) [rad].

    The middle of a dwell, its mean and the angle a delay later are known from the neighbours as far as the acceleration
    is even. A jump of it by Δa within a dwell T leaves up to Δa T²/12, and shows as a third difference of Δa T²: so it
    is where the mirrors still turn round when a pattern begins.

    Parameters
    ----------
    angles
        Read deflections, shape (2, points) [rad].
    """
    third = np.abs(np.diff(angles, 3, axis=1)).max(axis=0)
    spread = np.concatenate([third[:1], third, third[-1:], third[-1:]])
    spread[1:] = np.maximum(spread[1:], spread[:-1])
    return spread / 12.0
