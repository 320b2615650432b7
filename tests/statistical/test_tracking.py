"""The tracker in closed loop over targets that move, hide and lie in shadow edges; prediction; identities.

The world is the judge's disc under a Gaussian spot with noise on the signals; the mirrors are the simulator's. Seeds
are fixed; a right program fails a test of this file for fewer than one in 10⁴ of them.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import dataclass, replace

import claims
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Galvanometers

from scanner_sim.analytic import tracking as judge
from scanner_sim.foundation.status import Status
from scanner_sim.scan.lissajous import LissajousPattern
from scanner_sim.scan.schedule import Visiting, run_visit
from scanner_sim.scan.ways import MirrorPair, mirrors_at
from scanner_sim.tracking.identify import identify
from scanner_sim.tracking.measurement import Measurement, TargetAppearance, measure_target
from scanner_sim.tracking.prediction import initiate, predict, update
from scanner_sim.tracking.response import TargetKind
from scanner_sim.tracking.samples import PatternSamples, angles_later
from scanner_sim.tracking.state import (
    Refusal,
    TrackCommand,
    TrackerSettings,
    TrackMode,
    TrackState,
    advance,
    command,
    init,
)

Array = NDArray[np.float64]

DWELL, DIAMETER, RANGE = 50e-6, 0.1, 10.0
SPOT = 0.155e-3
LOOKS = TargetAppearance(kind=TargetKind.BLACK, diameter=DIAMETER)
SETTINGS = TrackerSettings()
SERVO = Galvanometers()
Disturb = Callable[[Array, Array, Array, Array], Array]


def none(time: Array, theta: Array, phi: Array, signal: Array) -> Array:
    return signal


@dataclass(frozen=True)
class Loop:
    """All that a closed loop carries from pattern to pattern."""

    state: TrackState
    order: TrackCommand
    mirrors: MirrorPair
    pattern: int = 0


def begin(expected: Array) -> Loop:
    state = init(expected, SETTINGS)
    return Loop(state, command(state, SETTINGS, DIAMETER, 0.0), mirrors_at(expected[0], expected[1]))


def turn(
    loop: Loop, truth: Callable[[float], Array], period: float, disturb: Disturb = none, noise: float = 0.03
) -> tuple[Loop, dict[str, object]]:
    """Run one pattern: mirrors, response, measurement, tracker."""
    order = loop.order
    motion, mirrors = run_visit(
        SERVO,
        loop.mirrors,
        LissajousPattern(amplitude=order.amplitude),
        order.number,
        order.position[:2],
        start=loop.pattern * period,
        dwell=DWELL,
        visiting=Visiting(),
    )
    moving = np.stack([truth(float(t)) for t in motion.time])
    place = np.stack([motion.true_theta, motion.true_phi], axis=-1) - moving[:, :2]
    travel = np.stack([motion.travel_theta, motion.travel_phi], axis=-1)
    signal = judge.disc_signal(place, travel, np.zeros(2), 0.5 * DIAMETER / RANGE, SPOT, (0.1, 1.0))
    signal = disturb(motion.time, motion.true_theta, motion.true_phi, signal)
    rng = np.random.default_rng([5, loop.pattern])
    signal = signal + noise * rng.standard_normal(signal.shape)
    distance = moving[:, 2] + 0.01 * rng.standard_normal(signal.shape)
    dark = signal < 0.02
    samples = PatternSamples(
        time=motion.time[None],
        theta=motion.latched_theta[None],
        phi=motion.latched_phi[None],
        signal=signal[None],
        sigma_signal=np.full((1, signal.size), noise),
        range=np.where(dark, np.nan, distance)[None],
        sigma_range=np.full((1, signal.size), 0.01),
        status=np.where(dark, Status.BELOW_THRESHOLD, Status.VALID).astype(np.uint8)[None],
    )
    samples = samples.at(angles_later(samples.time, samples.angles, SERVO.readout_delay))
    seen = measure_target(samples, LOOKS, float(order.position[2]), spot=SPOT)
    following = (loop.pattern + 1) * period + 64 * DWELL
    state = advance(loop.state, seen, SETTINGS, DIAMETER, following)
    ahead = command(state, SETTINGS, DIAMETER, following)
    record = {
        "time": float(motion.time.mean()),
        "mode": state.mode,
        "taken": state.refusal is Refusal.NONE,
        "refusal": state.refusal,
        "error": seen.position[0] - truth(float(seen.time[0] if seen.found[0] else motion.time.mean())),
        "sigma": np.sqrt(np.diagonal(seen.covariance[0])),
    }
    return Loop(state, ahead, mirrors, loop.pattern + 1), record


def run(
    loop: Loop, truth: Callable[[float], Array], patterns: int, period: float, disturb: Disturb = none
) -> tuple[Loop, list[dict[str, object]]]:
    records = []
    for _ in range(patterns):
        loop, record = turn(loop, truth, period, disturb)
        records.append(record)
    return loop, records


def still(time: float) -> Array:
    return np.array([0.1, -0.05, RANGE])


def moving(time: float) -> Array:
    """10 mm/s across and 1 deg/s of an arm of 0.5 m, at 10 m: 1 mrad/s and 0.87 mrad/s, and 5 mm/s away."""
    return np.array([0.1 + 1.0e-3 * time, -0.05 + 0.87e-3 * time, RANGE + 5e-3 * time])


def test_a_target_is_found_and_held_within_the_papers_accuracy() -> None:
    """Claim: a resting disc of 100 mm at 10 m is found 6 mrad beside its expected place, and then measured within
    100 µrad per axis and pattern, with honest σ.

    Set-up: 3 % noise, default mirrors, encoders' delay corrected, 6.6 ms a pattern, 80 patterns. Expected: tracking
    from the fifth pattern at the latest; rms error below 100 µrad (what is asked for; the fit reaches 20–40); z² per
    axis 1 in the mean. Tolerance of z²: the bounds of 70 normal numbers at a level of 10⁻⁴.
    """
    _, records = run(begin(still(0.0) + np.array([6e-3, -3e-3, 0.05])), still, 80, 6.6e-3)
    assert all(record["mode"] is TrackMode.TRACK for record in records[5:])
    errors = np.array([record["error"] for record in records[10:]])
    sigma = np.array([record["sigma"] for record in records[10:]])
    assert np.sqrt((errors[:, :2] ** 2).mean(axis=0)).max() < 100e-6
    for axis in range(3):
        assert claims.mean_square((errors / sigma)[:, axis])


def test_a_moving_target_of_four_is_not_lost() -> None:
    """Claim: 10 mm/s and 1 deg/s are followed with a visit every 40 ms (four targets). Expected: no loss in 4 s."""
    _, records = run(begin(moving(0.0)), moving, 100, 40e-3)
    assert all(record["mode"] is TrackMode.TRACK for record in records[3:])
    assert all(record["taken"] for record in records)


def test_a_target_hidden_for_a_second_is_found_within_five_patterns() -> None:
    """Claim: a moving target that a plain board of the same range hides for 1 s is found at once when it returns.

    Set-up: four targets, 40 ms a visit; the disc is covered from 1 to 2 s. Expected: lost meanwhile, and nothing taken
    for it; acquired within five patterns of its return and tracked again.
    """

    def covered(time: Array, theta: Array, phi: Array, signal: Array) -> Array:
        return np.where((time > 1.0) & (time < 2.0), 1.0, signal)

    _, records = run(begin(moving(0.0)), moving, 70, 40e-3, covered)
    hidden = [r for r in records if 1.0 < float(r["time"]) < 2.0]  # type: ignore[arg-type]
    back = [r for r in records if float(r["time"]) > 2.0]  # type: ignore[arg-type]
    assert not any(r["taken"] for r in hidden)
    assert hidden[-1]["mode"] in (TrackMode.LOST, TrackMode.SEARCH)
    assert any(r["taken"] for r in back[:5])
    assert back[-1]["mode"] is TrackMode.TRACK


@pytest.mark.slow
@pytest.mark.parametrize("dark", [0.05, 0.3])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_shadow_edge_of_equal_range_does_not_capture(dark: float, direction: float) -> None:
    """Claim: an edge of darkness that sweeps over the target does not take the tracker with it (Figure 18b).

    Set-up: a band of 25 mrad in which the signal falls to 5 or 30 %, at the target's own range, moves over it at
    30 mrad/s from either side. Expected: whatever was taken for the target lies within a tenth of its radius, 0.5 mrad,
    of the truth; some patterns are refused; once the band has passed, the target is tracked where it is. A tracker that
    took the darker part's centre would err by some millirad, half a pattern.
    """

    def shadow(time: Array, theta: Array, phi: Array, signal: Array) -> Array:
        ahead = direction * (theta - 0.1) - (-18e-3 + 30e-3 * time)
        return np.where((ahead < 0.0) & (ahead > -25e-3), dark * signal, signal)

    _, records = run(begin(still(0.0)), still, 190, 10e-3, shadow)
    taken = np.array([np.abs(r["error"][:2]).max() for r in records if r["taken"]])  # type: ignore[index]
    assert taken.max() < 0.5e-3
    assert records[20]["mode"] is TrackMode.TRACK
    assert any(not r["taken"] for r in records[20:])
    assert records[-1]["mode"] is TrackMode.TRACK


def test_glints_do_not_capture() -> None:
    """Claim: three voxels a hundred times as bright, at random places of each pattern, do not disturb.

    Expected: all within 0.3 mrad of those that are taken, and three quarters of 120 patterns taken: a glint on one of
    the few voxels of the rim makes a wrong size, which is refused. Tolerance: binomial at 10⁻⁴ for a share of 0.9.
    """

    def glints(time: Array, theta: Array, phi: Array, signal: Array) -> Array:
        where = np.random.default_rng(int(1e6 * time[0])).choice(signal.size, 3, replace=False)
        return np.where(np.isin(np.arange(signal.size), where), 100.0, signal)

    _, records = run(begin(still(0.0)), still, 123, 6.6e-3, glints)
    taken = [r for r in records[3:] if r["taken"]]
    assert claims.at_most(120 - len(taken), 120, 0.1)
    assert max(np.abs(r["error"][:2]).max() for r in taken) < 0.3e-3  # type: ignore[index]


def test_a_run_cut_in_two_equals_the_whole() -> None:
    """Claim: all that is remembered is in the state: saved, loaded and gone on with, the rest is the same."""
    start = begin(moving(0.0))
    _, whole = run(start, moving, 16, 40e-3)
    half, first = run(start, moving, 8, 40e-3)
    _, second = run(pickle.loads(pickle.dumps(half)), moving, 8, 40e-3)
    for one, other in zip(whole, first + second, strict=True):
        assert one["mode"] is other["mode"]
        np.testing.assert_array_equal(one["error"], other["error"])


def test_search_patterns_grow_and_begin_anew() -> None:
    state = init(still(0.0), SETTINGS)
    sizes = [command(replace(state, searched=k), SETTINGS, DIAMETER, 0.0).amplitude for k in range(6)]
    assert sizes[:4] == pytest.approx([8e-3, 11.2e-3, 15.68e-3, 20e-3])
    assert sizes[4] == sizes[0]


def test_the_filter_is_consistent() -> None:
    """Claim: prediction and update report their own errors.

    Set-up: 2000 targets with random accelerations of the filter's density, 30 visits. Expected: (x − truth)ᵀP⁻¹(x −
    truth) has mean 6, the surprise before updates mean 3. Tolerance: four standard errors, √(12/2000) and √(6/2000).
    """
    rng = np.random.default_rng(31)
    count, delta = 2000, 0.04
    acceleration_psd, noise = np.array([1e-4, 1e-4, 1e-2]), np.diag([50e-6, 80e-6, 5e-3]) ** 2
    rates = np.array([2e-3, 2e-3, 0.05])
    place, rate = np.zeros((count, 3)), rates * rng.standard_normal((count, 3))

    def measured() -> Array:
        return np.asarray(place + rng.standard_normal((count, 3)) @ np.sqrt(noise))

    motion = initiate(measured(), noise, rates, np.zeros(count))
    a, b = np.sqrt(delta**3 / 3.0), 0.5 * np.sqrt(3.0 * delta)
    for visit in range(1, 31):
        one, two = rng.standard_normal((2, count, 3)) * np.sqrt(acceleration_psd)
        place = place + rate * delta + a * one
        rate = rate + b * one + 0.5 * np.sqrt(delta) * two
        motion = predict(motion, np.full(count, visit * delta), acceleration_psd)
        seen = measured()
        motion, distance = update(motion, seen, noise)
    error = motion.mean - np.concatenate([place, rate], axis=1)
    whole = np.einsum("ci,ci->c", error, np.linalg.solve(motion.covariance, error[..., None])[..., 0])
    assert whole.mean() == pytest.approx(6.0, abs=4.0 * np.sqrt(12.0 / count))
    assert distance.mean() == pytest.approx(3.0, abs=4.0 * np.sqrt(6.0 / count))


def test_targets_of_an_array_are_told_apart() -> None:
    """Claim: measured targets get their own names, strangers none, and doubtful ones are marked."""
    expected = np.array([[0.0, 0.0, 10.0], [0.05, 0.0, 10.0], [0.0, 0.05, 10.0], [0.0005, 0.05, 10.0]])
    loose, tight = np.diag([1e-3, 1e-3, 0.02]) ** 2, np.tile(np.diag([3e-5, 3e-5, 5e-3]) ** 2, (4, 1, 1))
    offset = [4e-4, -3e-4, 0.01]
    measured = expected[[1, 0, 3, 0]] + offset
    measured[3] += [0.2, 0.0, 0.0]
    found = identify(measured, tight, expected, loose)
    np.testing.assert_array_equal(found.target[[0, 1, 3]], [1, 0, -1])
    assert found.target[2] in (2, 3)
    np.testing.assert_array_equal(found.unique, [True, True, False, False])
    assert np.isnan(found.surprise[3])
    both = identify(expected[[0, 0]], tight[:2], expected, loose)
    assert sorted(both.target.tolist()) == [-1, 0]


def test_a_search_also_goes_where_the_target_was_seen_last() -> None:
    """Claim: a target that was lost far from its first expected place is looked for at both, one cycle after another.

    Set-up: a target followed to 0.1 rad from where it was expected, then hidden for 60 patterns. Expected: searches at
    the last place first, and as many at the expected one, but for one cycle.
    """
    settings = TrackerSettings()
    expected, last = np.array([0.0, 0.0, 8.0]), np.array([0.1, 0.05, 8.0])
    state = replace(init(expected, settings), mode=TrackMode.TRACK, motion=init(last, settings).motion)
    nothing = Measurement(
        *(np.full(shape, np.nan) for shape in ((1,), (1, 3), (1, 3, 3), (1,), (1,), (1,), (1,))),
        found=np.zeros(1, dtype=bool),
    )
    places = []
    for number in range(60):
        state = advance(state, nothing, settings, 0.1, 0.01 * number)
        order = command(state, settings, 0.1, 0.01 * number)
        if order.mode is TrackMode.SEARCH:
            places.append(order.position[0])
    assert places[0] == 0.1
    assert abs(places.count(0.1) - places.count(0.0)) <= 5
    assert places.count(0.1) + places.count(0.0) == len(places) > 40
