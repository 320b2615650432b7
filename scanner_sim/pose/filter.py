"""A filter for poses and their rates, from the visits of a tracker one after another: the reference for users' own.

A Kalman filter that takes every visit's error for new is sure of itself too soon: of the error of a range nine tenths
are the same in the next visit, and some of it is that of the next target (:mod:`scanner_sim.tracking.errors`). This one
carries, beside pose and rates, what lasts or is shared: for each target the error of its surface (3), its share of the
mirrors' wobble (2) and of the unlike pixels (3, :mod:`scanner_sim.pose.pixel_process`), what goes as cosine (3) and as
sine (3) with the place of the dwells on its surface; and for all of them one number of the encoders' drift, and one for
each error of the calibration. All but the pixels' are Gauss-Markov processes of variance 1,

    b ← ρ b + √(1 − ρ²) noise,   ρ = exp(−step/length).

Noise has the correlation that the process has between targets (Bar-Shalom, Li, Kirubarajan, *Estimation with
Applications to Tracking and Navigation*, 2001, section 8.2 on coloured measurement noise, by state augmentation). Steps
are of time for wobble, of the turn about the line of sight and of the range for surfaces, of the image for pixels;
records state the lengths. The rest of the white part is the measurement's noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.arithmetic import applied, exp, product, solve_linear
from scanner_sim.optics.deflection import WOBBLE_LASTS, wobble_correlation
from scanner_sim.pose.collinearity import project
from scanner_sim.pose.first_motions import Expected, Push, first_motion
from scanner_sim.pose.pixel_process import SHARES, SPREAD, moved_on
from scanner_sim.pose.transforms import rotation_from_vector, turn_jacobian
from scanner_sim.tracking.errors import pixel_correlation
from scanner_sim.tracking.record import PatternRecord, TrackStatus, TrackTarget
from scanner_sim.tracking.state import TrackMode

Array = NDArray[np.float64]

RIGID_STATES = 12
"""Numbers of an object: position, attitude, velocity and rate of turn."""
_TARGET_STATES = 14
"""Numbers of a target: three of its surface, two of the wobble, three of the pixels, six of the dwells' places."""
_PIXELS, _DWELLS = 5, 8
"""The first of the pixels and of the dwells' places."""
_DITHER_FADES = 3.0
"""How much sooner than the surface's part that of the dwells' places is another: cos(2π δ/s) in the mean over
directions, J₀, at dwells s = 2.3 radii of the beam apart falls to 1/e in 0.64 of them, and the surface's in two."""
_ANYWHERE, _ANYHOW = 10.0, 1.0
"""Standard deviations of place [m] and attitude [rad] about a motion that visits alone decide: they tell nothing."""


@dataclass(frozen=True)
class FilterState:
    """What is known of m objects with n targets in all at a time.

    Attributes
    ----------
    time
        When [s].
    position, rotation
        Of the objects' origins [m], shape (m, 3), and ``scanner_from_object``, (m, 3, 3).
    velocity, turn_rate
        Their rates [m/s] and [rad/s], along the scanner's axes, each (m, 3).
    bias
        Estimates of the lasting errors, in their standard deviations but for the pixels' modes, shape (14 n + 1 + k,):
        those of the targets, the drift and the k errors of the calibration.
    covariance
        Of all errors, shape (12 m + 14 n + 1 + k, 12 m + 14 n + 1 + k): for each object (δt, δω, δv, δ rate), with
        position + δt and exp([δω]×) rotation, then the biases.
    surprise
        Squared Mahalanobis distance of the last visit's (Θ, φ, R) from what was predicted: χ² of three degrees of
        freedom (normalised innovation squared).
    """

    time: float
    position: Array
    rotation: Array
    velocity: Array
    turn_rate: Array
    bias: Array
    covariance: Array
    surprise: float = np.nan

    def covariance_of(self, number: int = 0) -> Array:
        """Return the covariance of one object's (δt, δω, δv, δ rate) [m, rad, m/s, rad/s], shape (12, 12)."""
        part = slice(RIGID_STATES * number, RIGID_STATES * (number + 1))
        return self.covariance[part, part]


@dataclass(frozen=True)
class FilterModel:
    """What the filter knows beforehand.

    Attributes
    ----------
    objects
        For each object the targets on it by their names in the records, along its own axes [m], shape (3,).
    axis_separation
        D_g [m].
    acceleration, turn_acceleration
        Spectral densities of the objects' accelerations, the squared change of a rate in a second [m²/s³, rad²/s³].
    fastest, fastest_turn
        Standard deviations of velocity [m/s] and rate of turn [rad/s] before anything is seen.
    """

    objects: Mapping[str, Mapping[str, ArrayLike]]
    axis_separation: float
    acceleration: float = 1e-6
    turn_acceleration: float = 1e-6
    fastest: float = 0.1
    fastest_turn: float = 0.1

    @classmethod
    def of(
        cls,
        targets: Sequence[TrackTarget],
        axis_separation: float,
        *,
        acceleration: float = 1e-6,
        turn_acceleration: float = 1e-6,
    ) -> FilterModel:
        """Return the filter for all objects that carry at least three of a run's targets; see the attributes."""
        every: dict[str, dict[str, ArrayLike]] = {}
        for target in targets:
            every.setdefault(target.object, {})[target.name] = target.centre
        carriers = {name: own for name, own in every.items() if len(own) >= 3}
        return cls(carriers, axis_separation, acceleration, turn_acceleration)

    @property
    def targets(self) -> dict[str, tuple[int, Array]]:
        """Number of the object and position on it [m] of each target, in the order of the state."""
        return {
            target: (number, np.asarray(point, dtype=np.float64))
            for number, own in enumerate(self.objects.values())
            for target, point in own.items()
        }

    def begin(self, records: Sequence[PatternRecord], pushes: Sequence[Push] = ()) -> FilterState:
        """Return the state after the first visits, at the time of the last of them.

        Each visit counts at its own time: the filter goes over them along the likeliest motion that is even but for the
        pushes. Before they are seen nothing is known but how large rates may be.

        Raises
        ------
        InputError
            As of :func:`~scanner_sim.pose.first_motions.first_motion`, if these visits do not tell enough.
        """
        visits = sorted(
            (record for record in records if counts(record) and record.target in self.targets),
            key=lambda record: record.time,
        )
        state = self._first(visits, pushes)
        bias, still = RIGID_STATES * len(self.objects), np.zeros_like(state.velocity)
        # What is known of rates is about zero.
        off = np.concatenate([still, still, -state.velocity, -state.turn_rate], axis=1).ravel()
        coming = sorted((push for push in pushes if push.time >= state.time), key=lambda push: push.time)
        for record in visits:
            while coming and coming[0].time <= record.time:
                push = coming.pop(0)
                state, onward = self._carried(state, replace(record, time=push.time))
                state, off = pushed(state, push), applied(onward[:bias, :bias], off)
            state, onward = self._carried(state, record)
            off = applied(onward[:bias, :bias], off)
            change, whole, _ = self._correction(state, record, off)
            off = off + change[:bias]
            state = replace(state, bias=state.bias + change[bias:], covariance=whole)
        return self._moved(state, np.concatenate([off, 0.0 * state.bias]), state.covariance)

    def _first(self, visits: Sequence[PatternRecord], pushes: Sequence[Push]) -> FilterState:
        """Return the likeliest motion at the time of the first visit, and what is known before anything is seen.

        Of places and attitudes the covariance is about that motion and says nothing, of rates it is about zero.
        """
        expected = Expected(self.fastest, self.fastest_turn, self.acceleration, self.turn_acceleration)
        span = (visits[0].time, visits[-1].time) if visits else (0.0, 0.0)
        motions = [
            first_motion(
                name,
                own,
                visits,
                span,
                self.axis_separation,
                expected,
                [push for push in pushes if push.number == number],
            )
            for number, (name, own) in enumerate(self.objects.items())
        ]
        errors = max(record.errors.common.shape[-1] for record in visits)
        bodies, biases = len(self.objects), _TARGET_STATES * len(self.targets) + 1 + errors
        loose = np.repeat([_ANYWHERE, _ANYHOW, self.fastest, self.fastest_turn], 3) ** 2
        spread, bias = (
            np.diag(np.concatenate([np.tile(loose, bodies), np.zeros(biases)])),
            RIGID_STATES * bodies,
        )
        position, rotation, velocity, turn_rate = (np.array(part) for part in zip(*motions, strict=True))
        state = FilterState(span[0], position, rotation, velocity, turn_rate, np.zeros(biases), spread)
        spread[bias:, bias:] = self._targets_at(state, visits[0]).together
        return state

    def updated(self, state: FilterState, record: PatternRecord) -> FilterState:
        """Return the state after a visit; one that measured nothing, or another target, changes nothing."""
        if not counts(record) or record.target not in self.targets:
            return state
        ahead = self.predicted(state, record)
        change, covariance, surprise = self._correction(
            ahead, record, np.zeros(RIGID_STATES * len(self.objects))
        )
        return replace(self._moved(ahead, change, covariance), surprise=surprise)

    def _correction(
        self, ahead: FilterState, record: PatternRecord, off: Array
    ) -> tuple[Array, Array, float]:
        """Return what a visit adds to a state at its time, the covariance after it, and its surprise.

        ``off`` are the errors (δt, δω, δv, δ rate) of the objects in the state that are known already.
        """
        number = list(self.targets).index(record.target)
        body, point = self.targets[record.target]
        arm = applied(ahead.rotation[body], point)
        wanted, gradients = project(
            (ahead.position[body] + arm)[:, None], self.axis_separation, with_range=True
        )
        by_shift = gradients[..., 0].T
        rigid, own = RIGID_STATES * body, RIGID_STATES * len(self.objects) + _TARGET_STATES * number
        drift = own + _TARGET_STATES * (len(self.targets) - number)
        common = slice(drift + 1, drift + 1 + record.errors.common.shape[-1])
        slope = np.zeros((3, len(ahead.covariance)))
        slope[:, rigid : rigid + 3] = by_shift
        slope[:, rigid + 3 : rigid + 6] = np.cross(arm, by_shift)
        slope[:, own : own + _TARGET_STATES], slope[:2, drift] = _by_bias(record), record.errors.drift
        slope[:, common] = record.errors.common
        known = applied(slope, np.concatenate([off, ahead.bias]))
        away = record.position - wanted[:, 0] - known
        noise = record.errors.white - record.errors.dither[0]
        crossed = product(slope, ahead.covariance)
        spread = product(crossed, slope.T) + noise
        gain = solve_linear(spread, crossed).T
        surprise = float((away * solve_linear(spread, away[:, None])[:, 0]).sum())
        keep = np.eye(len(crossed.T)) - product(gain, slope)
        whole = product(keep, ahead.covariance, keep.T) + product(gain, noise, gain.T)
        return applied(gain, away), 0.5 * (whole + whole.T), surprise

    def _moved(self, state: FilterState, change: Array, covariance: Array) -> FilterState:
        """Return the state with a correction added."""
        bodies = RIGID_STATES * len(self.objects)
        shift, turn, speed, rate = np.moveaxis(change[:bodies].reshape(-1, 4, 3), 1, 0)
        return replace(
            state,
            position=state.position + shift,
            rotation=product(rotation_from_vector(turn), state.rotation),
            velocity=state.velocity + speed,
            turn_rate=state.turn_rate + rate,
            bias=state.bias + change[bodies:],
            covariance=covariance,
        )

    def predicted(self, state: FilterState, record: PatternRecord) -> FilterState:
        """Return the state at the time of a visit: steady rates, and biases that fade.

        Of the visit its time counts, and the lengths over which errors fade.
        """
        return self._carried(state, record)[0]

    def _carried(self, state: FilterState, record: PatternRecord) -> tuple[FilterState, Array]:
        """Return the state at the time of a visit, and how errors go on to it."""
        step, size = record.time - state.time, len(state.covariance)
        onward, noise = np.eye(size), np.zeros((size, size))
        ahead = _evenly(state, record.time)
        turned, bent = rotation_from_vector(step * state.turn_rate), turn_jacobian(step * state.turn_rate)
        acceleration_psd = np.repeat([self.acceleration, self.turn_acceleration], 3)
        first = np.arange(6)
        for body in range(len(self.objects)):
            position, rate = RIGID_STATES * body + first, RIGID_STATES * body + 6 + first
            onward[position[:3], rate[:3]] = step
            onward[position[3:, None], rate[3:]] = step * bent[body]
            onward[position[3:, None], position[3:]] = turned[body]
            noise[position, position], noise[rate, rate] = (
                acceleration_psd * abs(step) ** 3 / 3.0,
                acceleration_psd * abs(step),
            )
            noise[position, rate] = noise[rate, position] = acceleration_psd * step * abs(step) / 2.0
        there = self._targets_at(ahead, record)
        # From the rates alone: what noise does to a position is no motion.
        transition = self._transition(ahead, record, step, self._targets_at(state, record), there)
        bias = slice(RIGID_STATES * len(self.objects), size)
        onward[bias, bias] = transition
        # Transitions are alike where processes are correlated, so that no noise has a negative variance.
        noise[bias, bias] = there.together - product(transition, there.together, transition.T)
        covariance = product(onward, state.covariance, onward.T) + noise
        return replace(ahead, bias=applied(transition, state.bias), covariance=covariance), onward

    def _transition(
        self, ahead: FilterState, record: PatternRecord, step: float, before: _Places, there: _Places
    ) -> Array:
        """Return the transition of the biases, shape (14 n + 1 + k, 14 n + 1 + k)."""
        errors, moved, nearer = record.errors, there.image - before.image, there.range - before.range
        fade = np.ones((len(moved), _TARGET_STATES))
        for number, (body, _) in enumerate(self.targets.values()):
            roll = abs(float((ahead.turn_rate[body] * there.sight[number]).sum()))
            way = roll * abs(step) / errors.turn + abs(nearer[number]) / errors.approach
            fade[number, :2], fade[number, 2], fade[number, _DWELLS:] = exp(
                -way * np.array([1.0, float(errors.range_fades), _DITHER_FADES])
            )
        fade[:, 3:_PIXELS] = exp(-abs(step) / (WOBBLE_LASTS * errors.wobble_time))
        transition = np.diag(np.concatenate([fade.ravel(), np.ones(len(ahead.bias) - fade.size)]))
        of_pixels = moved_on(float(np.sqrt((moved**2).mean()) / errors.image_width))
        for first in range(_PIXELS, fade.size, _TARGET_STATES):
            transition[first : first + 3, first : first + 3] = of_pixels
        return transition

    def _targets_at(self, state: FilterState, record: PatternRecord) -> _Places:
        """Return where the targets are.

        Images follow from that of the record by p ∝ cosΘ/R, eq 1 but for d sinΘ beside R: a tenth of a pixel at most.
        """
        errors = record.errors
        points = np.array(
            [
                state.position[body] + applied(state.rotation[body], point)
                for body, point in self.targets.values()
            ]
        )
        (theta, phi, reach), _ = project(points.T, self.axis_separation, with_range=True)
        depth = float(record.position[2] / np.cos(record.position[0]))
        image = errors.image * depth * np.cos(theta) / reach
        count = len(points)
        together, end = np.eye(len(state.bias)), _TARGET_STATES * count
        for axis, angle in ((3, phi), (4, theta)):
            apart = (angle[:, None] - angle) / errors.wobble_angle
            together[axis:end:_TARGET_STATES, axis:end:_TARGET_STATES] = wobble_correlation(apart)
        alike = pixel_correlation((image[:, None] - image) / errors.image_width)
        for one, other in np.ndindex(SPREAD.shape):
            together[_PIXELS + one : end : _TARGET_STATES, _PIXELS + other : end : _TARGET_STATES] = (
                SPREAD[one, other] * alike
            )
        return _Places(points / np.sqrt((points**2).sum(axis=1))[:, None], reach, image, together)


class _Places(NamedTuple):
    """Where n targets are: directions (n, 3), ranges [m] and images [pixel], (n,).

    ``together`` is the stationary covariance of the biases there, (14 n + 1 + k, 14 n + 1 + k).
    """

    sight: Array
    range: Array
    image: Array
    together: Array


def pushed(state: FilterState, push: Push) -> FilterState:
    """Return a state at the time of a push with the velocity that it leaves."""
    velocity, covariance = state.velocity.copy(), state.covariance.copy()
    velocity[push.number] += push.velocity
    rates = RIGID_STATES * push.number + 6 + np.arange(3)
    covariance[rates, rates] += push.sigma**2
    return replace(state, velocity=velocity, covariance=covariance)


def _evenly(state: FilterState, time: float) -> FilterState:
    """Return the objects at another time [s], moving on at their rates."""
    step = time - state.time
    return replace(
        state,
        time=time,
        position=state.position + step * state.velocity,
        rotation=product(rotation_from_vector(step * state.turn_rate), state.rotation),
    )


def counts(record: PatternRecord) -> bool:
    """Return whether a visit measured a target that is followed."""
    return record.status is TrackStatus.MEASURED and record.after is TrackMode.TRACK


def _by_bias(record: PatternRecord) -> Array:
    """Return by how much a target's biases move what is measured of it, shape (3, 14)."""
    errors = record.errors
    turn, root = 2.0 * np.pi * float(errors.dwell_place), errors.dither_root[0]
    slope = np.zeros((3, _TARGET_STATES))
    slope[:, :3] = errors.surface_root
    slope[0, 3] = slope[1, 4] = np.sqrt(errors.wobble)
    slope[2, _PIXELS:_DWELLS] = np.sqrt(errors.pixels) * SHARES
    slope[:, _DWELLS : _DWELLS + 3], slope[:, _DWELLS + 3 :] = np.cos(turn) * root, np.sin(turn) * root
    return slope
