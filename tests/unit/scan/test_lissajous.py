"""Lissajous patterns and the visits that run them."""

from __future__ import annotations

import numpy as np
import pytest
from prototype import Galvanometers, Mirrors
from pydantic import ValidationError

from scanner_sim.foundation.units import FROM_FILE
from scanner_sim.optics.jump import attainable_amplitude
from scanner_sim.scan.lissajous import (
    LissajousPattern,
    dwell_places,
    figure_angles,
    figure_slopes,
    figures,
    frequencies,
    sample_shares,
)
from scanner_sim.scan.lissajous_scan import LissajousScan
from scanner_sim.scan.protocol import ScanSetup
from scanner_sim.scan.schedule import Course, Visiting, pattern_warnings, run_visit, run_visits, visits
from scanner_sim.scan.ways import mirrors_at
from scanner_sim.scene.objects import Scene

DWELL = 50e-6
SERVO = Galvanometers()
PLAIN = LissajousPattern(dither_sampling=False, inversion=False, amplitude=5e-3)


def angles(pattern: LissajousPattern, number: int, points: int) -> np.ndarray:
    return np.stack(
        figure_angles(figures(pattern, [number], (0.0, 0.0)), pattern.cycles, sample_shares(points))
    )[:, 0]


def test_the_equations() -> None:
    """Eqs 6 and 7 at an instant, spelled out."""
    pattern = PLAIN.model_copy(update={"phases": (0.3, -0.4), "aspect": 2.0})
    theta, phi = figure_angles(figures(pattern, [0], (0.1, -0.2)), pattern.cycles, [0.15])
    assert theta[0, 0] == pytest.approx(5e-3 * np.cos(2 * np.pi * 3 * 0.15 + 0.3) + 0.1, abs=1e-15)
    assert phi[0, 0] == pytest.approx(10e-3 * np.cos(2 * np.pi * 2 * 0.15 - 0.4) - 0.2, abs=1e-15)


def test_sines_cross_the_centre_and_the_other_phases_miss_it() -> None:
    """A 3:2 figure with phases (90°, 0) stays 0.43 A away from its centre, as docs/theory/scan.md says."""
    missing = PLAIN.model_copy(update={"phases": (0.5 * np.pi, 0.0)})
    assert np.hypot(*angles(PLAIN, 0, 128)).min() < 0.01 * PLAIN.amplitude
    nearest = np.hypot(*angles(missing, 0, 20_000)).min() / PLAIN.amplitude
    assert nearest == pytest.approx(0.4277, abs=1e-4)


def test_inversion_runs_every_second_pattern_the_other_way() -> None:
    pattern = LissajousPattern()
    np.testing.assert_allclose(angles(pattern, 0, 128), -angles(pattern, 1, 128), atol=1e-15)
    np.testing.assert_allclose(angles(pattern, 5, 128), -angles(pattern, 4, 128), atol=1e-15)


def test_dither_fills_the_gaps_of_a_pattern() -> None:
    """The places along the figure of 16 patterns lie between one another: no gap above two of 16 steps of a point."""
    pattern = LissajousPattern(inversion=False)
    step = 2.0 * np.pi / 128
    start = figures(pattern, np.arange(16), (0.0, 0.0)).phase
    moved = np.sort(np.mod((start[:, 0] - pattern.phases[0]) / 3.0, step))
    gaps = np.diff(moved, append=moved[0] + step)
    assert gaps.max() < 2.2 * step / 16
    np.testing.assert_allclose(
        (start[:, 0] + 0.5 * np.pi) / 3.0, (start[:, 1] + 0.5 * np.pi) / 2.0, atol=1e-14
    )


def test_dwells_lie_where_their_places_say() -> None:
    """Claim: middles of dwells lie k + u points along the curve of the undithered figure, with the mirrors' own lag.

    Set-up: six visits as the servo runs them; the first 60 points, in which it catches up, do not count.
    Expected: within 0.02 points, a fiftieth of the lag: it is that of slow motion.
    Two visits of a pair, one of them inverted, lie on both sides of a point.
    """
    pattern = LissajousPattern(amplitude=5e-3)
    places = dwell_places(pattern, np.arange(6), SERVO.lag / DWELL)
    assert places is not None
    visiting, mirrors, start = Visiting(), mirrors_at(0.0, 0.0), 0.02
    for number, place in enumerate(places.tolist()):
        motion, mirrors = run_visit(
            SERVO, mirrors, pattern, number, (0.0, 0.0), start=start, dwell=DWELL, visiting=visiting
        )
        start += 8e-3
        index = np.arange(60, pattern.points)
        along = (place + (index if number % 2 == 0 else -index)) / pattern.points
        wanted = np.stack(figure_angles(figures(PLAIN, [0], (0.0, 0.0)), pattern.cycles, along))[:, 0]
        found = np.stack([motion.true_theta, motion.true_phi])[:, index]
        step = 2.0 * np.pi * 3.0 * pattern.amplitude / pattern.points
        assert np.abs(found - wanted).max() < 0.02 * 1.3 * step, number
    np.testing.assert_allclose(places[::2], -places[1::2])
    for other in ({"dither_phase": 0.1}, {"dither_position": 0.1}, {"phases": (0.5 * np.pi, 0.0)}):
        assert dwell_places(LissajousPattern(**other), np.arange(2), 0.0) is None


@pytest.mark.parametrize("aspect", [1.0, 0.4, 2.5])
def test_position_and_phase_dither_stay_within_their_bounds(aspect: float) -> None:
    """Claim: a figure is moved by up to a tenth of its own half width along Θ, and of its own half height along φ."""
    pattern = LissajousPattern(
        dither_position=0.1, dither_phase=0.2, dither_sampling=False, inversion=False, aspect=aspect
    )
    figure = figures(pattern, np.arange(500), (0.1, 0.2))
    away = (figure.position - [0.1, 0.2]) / (pattern.amplitude * np.array([1.0, aspect]))
    assert np.abs(away).max() <= 0.1 + 1e-9
    assert np.abs(away).max(axis=0).min() > 0.095
    assert abs(away.mean(axis=0)).max() < 2e-3
    assert 0.19 < np.abs(figure.phase[:, 0] - pattern.phases[0]).max() <= 0.2


def test_dithers_are_even_about_the_figure_without() -> None:
    """Claim: of 1000 patterns the dithers of phase and sampling cancel in the mean, to a thousandth of their width."""
    pattern = LissajousPattern(dither_phase=0.2, dither_sampling=False, inversion=False)
    moved = figures(pattern, np.arange(1000), (0.0, 0.0)).phase - pattern.phases
    assert abs(moved[:, 0].mean()) < 4e-4
    assert moved[:, 0].min() < -0.19
    assert moved[:, 0].max() > 0.19
    np.testing.assert_array_equal(moved[:, 1], 0.0)
    pattern = LissajousPattern(inversion=False)
    along = (figures(pattern, np.arange(1000), (0.0, 0.0)).phase - pattern.phases) / np.array(pattern.cycles)
    step = 2.0 * np.pi / pattern.points
    np.testing.assert_allclose(along.mean(axis=0), 0.0, atol=1e-3 * step)
    assert np.ptp(along, axis=0).min() > 0.99 * step


@pytest.mark.parametrize(
    ("wrong", "remedy"),
    [
        ({"ratio": "4:2"}, "Write 2:1"),
        ({"ratio": "9:8", "points": 71}, "at least 72"),
        ({"ratio": "2:7", "points": 55}, "55 points sample 7 cycles .* at least 56"),
    ],
)
def test_senseless_patterns_are_refused(wrong: dict[str, object], remedy: str) -> None:
    if "points" in wrong:
        LissajousPattern.model_validate({**wrong, "points": int(wrong["points"]) + 1})  # type: ignore[call-overload]
    with pytest.raises(ValidationError, match=f"(?s){remedy}"):
        LissajousPattern.model_validate(wrong)


def test_patterns_are_read_with_units() -> None:
    pattern = LissajousPattern.model_validate(
        {"ratio": "3:2", "points": 128, "amplitude": "2.5 mrad"}, context=FROM_FILE
    )
    assert pattern.amplitude == 2.5e-3
    with pytest.raises(ValidationError):
        LissajousPattern.model_validate({"amplitude": 2.5e-3}, context=FROM_FILE)


@pytest.mark.parametrize("points", [96, 128])
def test_each_mirror_is_judged_by_its_own_amplitude_and_frequency(points: int) -> None:
    """Claim: a pattern that is wide in φ asks that of the mirror of φ alone, at the frequency of φ."""
    frequency = frequencies(LissajousPattern(points=points), DWELL)[1]
    most = float(attainable_amplitude(SERVO, frequency))
    for share in (0.999, 1.001):
        wide = LissajousPattern(amplitude=0.125 * most, aspect=8.0 * share, points=points)
        told = list(pattern_warnings(wide, SERVO, DWELL))
        assert [sentence.split()[1:5] for sentence in told] == [["the", "mirror", "of", "φ"]] * (share > 1.0)


def test_impossible_patterns_are_doubted_with_what_is_possible() -> None:
    """The number of points in the message is one that the mirrors follow."""
    pattern = LissajousPattern(amplitude=30e-3)
    (sentence,) = pattern_warnings(pattern, SERVO, DWELL)
    assert "cannot follow 30 mrad at 469 Hz; at most 23" in sentence
    points = int(sentence.rsplit(" ", 2)[1])
    assert not list(pattern_warnings(pattern.model_copy(update={"points": points}), SERVO, DWELL))
    assert not list(pattern_warnings(LissajousPattern(), SERVO, DWELL))


def test_visits_of_one_target_turn_round_in_time() -> None:
    """Patterns of one target follow each other in 6.6 ms, inverted ones too; the mirrors lag by 64 µs and little more.

    6 mrad at 469 Hz are 17.7 rad/s, and 1.13 mrad of lag.
    """
    mirrors = mirrors_at(0.1, 0.05)
    plan = visits(1, 6, 6.6e-3, 6.4e-3)
    for number, start in zip(plan.number, plan.start, strict=True):
        motion, mirrors = run_visit(
            SERVO,
            mirrors,
            LissajousPattern(),
            int(number),
            (0.1, 0.05),
            start=float(start),
            dwell=DWELL,
            visiting=Visiting(),
        )
        assert motion.time[0] == pytest.approx(start + 0.5 * DWELL, abs=1e-9)
        assert np.abs(motion.true_theta - motion.commanded_theta).max() < 1.4e-3
        assert np.abs(motion.true_theta - 0.1).max() < 6.3e-3


def test_several_targets_are_reached_in_time_and_settled() -> None:
    """Jumps of 0.5 rad: patterns start when the schedule says, and lag no more than the steady pattern does."""
    period = Visiting().period(128, DWELL, 2, SERVO)
    mirrors = mirrors_at(0.0, 0.0)
    plan = visits(2, 6, period, 128 * DWELL)
    for target, number, start in zip(*plan, strict=True):
        centre = np.array([[-0.245, 0.1], [0.245, -0.1]])[target]
        motion, mirrors = run_visit(
            SERVO,
            mirrors,
            LissajousPattern(),
            int(number),
            centre,
            start=float(start),
            dwell=DWELL,
            visiting=Visiting(),
        )
        assert motion.time[0] == pytest.approx(start + 0.5 * DWELL, abs=DWELL / 3)
        assert not motion.limited
        assert np.abs(motion.true_theta - motion.commanded_theta).max() < 1.3e-3


def test_a_jump_that_needs_longer_gets_it() -> None:
    motion, mirrors = run_visit(
        SERVO,
        mirrors_at(-0.5, 0.0),
        LissajousPattern(),
        0,
        (0.5, 0.0),
        start=0.0,
        dwell=DWELL,
        visiting=Visiting(),
    )
    assert motion.time[0] > 5e-3
    assert mirrors.time == pytest.approx(motion.time[-1] + 0.5 * DWELL, abs=1e-12)
    assert np.abs(motion.true_theta - motion.commanded_theta).max() < 1.3e-3
    mean = 0.5 * (motion.true_theta[2:] - motion.true_theta[:-2])
    np.testing.assert_allclose(motion.travel_theta[5:-1], mean[4:], atol=2e-5)


@pytest.mark.parametrize(("targets", "apart"), [(5, 0.2), (1, 1e-4), (1, 2e-3)])
@pytest.mark.parametrize("amplitude", [20e-3, 60e-3])
def test_a_pattern_after_a_large_one_begins_where_it_should(
    amplitude: float, targets: int, apart: float
) -> None:
    """Search patterns at the mirrors' limits, and beyond them, leave nothing to the small ones between them.

    4.45 mrad at 469 and 313 Hz lag by 0.84 mrad along Θ and 0.56 mrad along φ; with the haste of turning round
    1.3 mrad. Mirrors that swing at their limits were off by 16 to 250 mrad.
    """
    mirrors, random = mirrors_at(0.0, 0.0), np.random.default_rng(1)
    period = Visiting().period(128, DWELL, targets, SERVO)
    for number in range(40):
        large = number % 2 == 0
        motion, mirrors = run_visit(
            SERVO,
            mirrors,
            LissajousPattern(amplitude=amplitude if large else 4.45e-3),
            number,
            random.uniform(-apart, apart, 2),
            start=mirrors.time + period - 128 * DWELL,
            dwell=DWELL,
            visiting=Visiting(),
        )
        if large:
            assert motion.limited == (amplitude > 23e-3)
            continue
        assert not motion.limited
        assert np.abs(motion.true_theta - motion.commanded_theta).max() < 1.3e-3
        assert np.abs(motion.true_phi - motion.commanded_phi).max() < 1.3e-3


def test_large_patterns_of_one_target_are_given_the_time_to_turn() -> None:
    """20 mrad arrive with 59 rad/s: turning takes at least twice that over the acceleration, and no detour.

    Patterns of 6 mrad turn in the 0.2 ms that the printed 6.6 ms leave.
    """
    for amplitude, least, most in ((6e-3, 0.2e-3, 0.2e-3), (20e-3, 0.59e-3, 0.8e-3)):
        mirrors, pattern = mirrors_at(0.0, 0.0), LissajousPattern(amplitude=amplitude)
        for number in range(4):
            before = mirrors.time
            motion, mirrors = run_visit(
                SERVO,
                mirrors,
                pattern,
                number,
                (0.0, 0.0),
                start=before + 0.2e-3,
                dwell=DWELL,
                visiting=Visiting(),
            )
            gap = motion.time[0] - 0.5 * DWELL - before
            assert number == 0 or least - 1e-9 < gap < most + 1e-9
            assert np.abs(motion.true_theta).max() < 1.06 * amplitude


def test_slopes_of_a_figure_are_differences() -> None:
    """Claim: over t/T, of both axes at any phase, to the second order of the step."""
    pattern = LissajousPattern(ratio="3:2", amplitude=4e-3, aspect=1.5, phases=(0.3, 1.1), dither_phase=0.4)
    figure = figures(pattern, np.arange(3), np.array([0.1, -0.2]))
    share = np.linspace(0.0, 1.0, 7)
    later, before = (
        np.stack(figure_angles(figure, (3, 2), share + way * 1e-6), axis=1) for way in (1.0, -1.0)
    )
    np.testing.assert_allclose(figure_slopes(figure, (3, 2), share), (later - before) / 2e-6, atol=1e-8)


@pytest.mark.parametrize(("ratio", "aspect"), [("3:2", 1.7), ("4:5", 0.6)])
def test_a_figure_sweeps_fastest_where_both_mirrors_do(ratio: str, aspect: float) -> None:
    """Claim: the largest way of the beam in a dwell is that of a figure of sines through its middle, where both mirrors
    are fastest: the longest chord of a fine polygon, in dwells. The ends are an amplitude from the middle, each mirror
    by its own, and wider by what dither moves the figure."""
    pattern = LissajousPattern(ratio=ratio, aspect=aspect, amplitude=0.04, points=400, dither_position=0.25)
    scan = LissajousScan(type="lissajous", pattern=pattern, centre=(0.05, -0.02), patterns=3)
    fine = pattern.model_copy(update={"dither_position": 0.0, "dither_sampling": False})
    chords = np.hypot(*np.diff(angles(fine, 0, 400_000), axis=1))
    setup = ScanSetup(Scene(), Mirrors(), SERVO, DWELL)
    assert scan.sweep(setup).angle == pytest.approx(1000.0 * chords.max(), rel=1e-5)
    assert scan.horizontal == pytest.approx((0.05 - 0.05, 0.05 + 0.05))
    assert scan.vertical == pytest.approx((-0.02 - 0.05 * aspect, -0.02 + 0.05 * aspect))
    assert scan.scan_time(setup) == pytest.approx(3 * (0.2e-3 + 400 * DWELL))
    assert scan.shots == 1200


def test_visits_that_need_unlike_times_are_run_together_as_each_alone() -> None:
    """Claim: of patterns whose mirrors wait, jump and turn round, together, each is that of its own visit, byte for
    byte and in its place, and so are the mirrors after it."""
    pattern, visiting = LissajousPattern(amplitude=4e-3, points=64), Visiting()
    mirrors = [mirrors_at(0.1, 0.05), mirrors_at(-0.2, 0.1), mirrors_at(0.0, 0.0), mirrors_at(0.1, 0.05)]
    course = Course(
        np.array([3, 0, 5, 2]),
        np.array([[0.1, 0.05], [0.2, -0.1], [0.01, 0.0], [0.1, 0.05]]),
        np.array([4e-3, 6e-3, 5e-3, 3e-3]),
        np.array([0.2e-3, 1e-3, 20e-3, 0.2e-3]),
    )
    motion, after = run_visits(SERVO, mirrors, pattern, course, dwell=DWELL, visiting=visiting)
    assert len({round(time / (DWELL / 4)) for time in motion.time[:, 0].tolist()}) == 3
    for row in range(4):
        own = Course(*(part[row : row + 1] for part in vars(course).values()))
        alone, (left,) = run_visits(
            SERVO, mirrors[row : row + 1], pattern, own, dwell=DWELL, visiting=visiting
        )
        for name, part in vars(motion).items():
            np.testing.assert_array_equal(part[row], getattr(alone, name)[0], err_msg=name)
        np.testing.assert_array_equal(after[row].slope, left.slope)
        assert after[row].time == left.time
        for part, other in zip(after[row].state, left.state, strict=True):
            np.testing.assert_array_equal(part, other)


def test_dithers_of_place_sampling_and_phase_go_by_themselves() -> None:
    """Claim: over many figures none of the four shifts, of the instants, of both places and of the phase, goes with
    another but the phase with the place along φ, which share a sequence; each fills its range evenly.

    Expected: of an evenly filled cube no correlation, and a variance of a third of the square of the half range;
    tolerance: discrepancy of 2000 points of the sequence, some (ln n)³/n.
    """
    pattern = LissajousPattern(
        dither_position=0.3, dither_phase=0.4, points=100, amplitude=0.01, inversion=False
    )
    plain = pattern.model_copy(update={"dither_phase": 0.0})
    number = np.arange(2000)
    shifted, still = (figures(one, number, (0.1, -0.2)) for one in (pattern, plain))
    step = 2.0 * np.pi / 100.0 * np.array([3.0, 2.0])
    instant = (still.phase - plain.phases) / step
    np.testing.assert_allclose(instant[:, 0], instant[:, 1], atol=1e-12)
    place = (still.position - [0.1, -0.2]) / 0.003
    phase = (shifted.phase[:, 0] - still.phase[:, 0]) / 0.4
    every = np.stack([2.0 * instant[:, 0], *place.T, phase])
    assert np.abs(every).max() <= 1.0 + 1e-9
    covariance = every @ every.T / 2000
    np.testing.assert_allclose(np.diag(covariance), 1.0 / 3.0, atol=0.005)
    apart = covariance[np.triu_indices(4, 1)]
    np.testing.assert_allclose(apart[:5], 0.0, atol=0.01)
    assert apart[5] == pytest.approx(1.0 / 3.0, abs=0.005)
