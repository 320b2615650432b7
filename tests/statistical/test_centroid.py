"""Centres of targets: their errors, whether σ tells the truth, and what lag and delay do to them.

The responses come from the judge, who integrates spot and travel over the disc; noise goes onto the signals.
Levels: a right program fails a test of this file for fewer than one in 10⁴ seeds; seeds are fixed.
"""

from __future__ import annotations

import dataclasses

import claims
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Galvanometers

from scanner_sim.analytic import tracking as judge
from scanner_sim.scan.lissajous import LissajousPattern, figure_angles, figures
from scanner_sim.scan.schedule import Visiting, run_visit
from scanner_sim.scan.ways import mirrors_at
from scanner_sim.tracking.centroid import Centroid, better_of, circle_fit, hit_centroid
from scanner_sim.tracking.disc_fit import blurred_edge, disc_fit
from scanner_sim.tracking.response import TargetKind, target_response
from scanner_sim.tracking.samples import PatternSamples, angles_later

Array = NDArray[np.float64]

DWELL, SPOT, RADIUS = 50e-6, 0.155e-3, 5e-3
LEVELS = (0.1, 1.0)
GATE = (5.0, 15.0)


def samples_of(
    place: Array, travel: Array, centre: Array, noise: float, seen: Array, seed: int
) -> PatternSamples:
    """Return what is measured at true places (patterns, points, 2) of discs at (patterns, 2), angles as ``seen``."""
    rng = np.random.default_rng(seed)
    value = judge.disc_signal(place - centre[:, None], travel, np.zeros(2), RADIUS, SPOT, LEVELS)
    value = value + noise * rng.standard_normal(value.shape)
    one = np.ones_like(value)
    return PatternSamples(
        time=DWELL * (np.arange(value.shape[1]) + 0.5) * one,
        theta=seen[..., 0],
        phi=seen[..., 1],
        signal=value,
        sigma_signal=max(noise, 1e-3) * one,
        range=10.0 * one,
        sigma_range=0.01 * one,
        status=np.zeros(value.shape, np.uint8),
    )


def ideal(count: int, pattern: LissajousPattern) -> tuple[Array, Array]:
    """Return places and travels of mirrors without lag, (count, points, 2)."""
    figure = figures(pattern, np.arange(count), np.zeros(2))
    half = 0.5 / pattern.points
    middle = (np.arange(pattern.points) + 0.5) / pattern.points
    places = [
        np.stack(figure_angles(figure, pattern.cycles, middle + shift), axis=-1)
        for shift in (-half, 0.0, half)
    ]
    return places[1], places[2] - places[0]


def estimates(samples: PatternSamples) -> dict[str, Centroid]:
    response = target_response(samples, TargetKind.BLACK, GATE)
    hits, circle = hit_centroid(samples, response), circle_fit(samples, response)
    fit = disc_fit(samples, response, better_of(circle, hits), spot=SPOT)
    return {"hits": hits, "circle": circle, "fit": fit}


@pytest.mark.parametrize("noise", [0.01, 0.05])
def test_the_fit_reaches_the_bound_and_knows_it(noise: float) -> None:
    """Claim: the model fit is unbiased, has the least possible error, and reports it.

    Set-up: 600 patterns of 128 points, A = 8 mrad, on a disc of 5 mrad (100 mm at 10 m) in the pattern's centre; noise
    1 and 5 % of the white; dithered. Expected: mean square error = Cramér–Rao bound of the judge, mean over the
    patterns, (estimate − truth)/σ standard normal, misfit 1, all found. Tolerance: the bounds of 600 normal numbers at
    a level of 10⁻⁴, of the misfit those of 600 × 123; 4 % for the bound, the mean of ten patterns only. The misfit
    is below 1 by 0.2 % at 1 % noise and by 1.4 % at 5 % (means of 12 and 30 drawings, ± 0.1 %), as the fit is not
    linear in the place of an edge that is sharp between two voxels: 0.4 and 1.8 % are granted. Power: 30 % of either
    variance.
    """
    pattern = LissajousPattern(amplitude=8e-3)
    place, travel = ideal(600, pattern)
    result = estimates(samples_of(place, travel, np.zeros((600, 2)), noise, place, 11))["fit"]
    bound = np.mean(
        [
            np.diagonal(judge.centre_bound(place[k], travel[k], RADIUS, SPOT, LEVELS, noise))
            for k in range(0, 20, 2)
        ],
        axis=0,
    )
    assert result.found.all()
    z = result.centre / result.sigma
    for axis in (0, 1):
        assert claims.mean_square(result.centre[:, axis] / np.sqrt(bound[axis]), slack=0.04)
        honest = claims.mean_square(z[:, axis])
        assert honest
        assert honest.finds < 0.4
        assert claims.mean(z[:, axis])
    assert claims.mean_square(
        np.sqrt(result.misfit), freedom=600.0 * 123.0, slack={0.01: 0.004, 0.05: 0.018}[noise]
    )


@pytest.mark.parametrize(("amplitude", "share"), [(7e-3, 0.71), (8e-3, 0.625)])
def test_figures_of_the_three_estimators(amplitude: float, share: float) -> None:
    """Claim: at 5 % noise hits, circle and fit err by 0.08, 0.015 and 0.008 of the amplitude at most.

    Set-up: 400 discs of 5 mrad, up to 0.25 A off the pattern's centre; N = 128. Expected, measured:
    hits 0.035–0.07 A, circle 0.006–0.011 A, fit 0.004–0.007 A; physics without sub-sample edges would give the circle
    0.020–0.024 A. Each better than the one before. The fit's σ is its scatter, within the bounds of 400 normal numbers
    at a level of 10⁻⁴. Hits and circle scatter by where the path meets the edge, which is no noise: their σ are for
    choosing among them, and the scatter stays between half of them and 1.4 times.
    """
    pattern = LissajousPattern(amplitude=amplitude)
    rng = np.random.default_rng(13)
    place, travel = ideal(400, pattern)
    centre = rng.uniform(-0.25, 0.25, (400, 2)) * amplitude
    result = estimates(samples_of(place, travel, centre, 0.05, place, 17))
    rms = {}
    for name, limit in (("hits", 0.08), ("circle", 0.015), ("fit", 0.008)):
        found = result[name].found
        assert found.mean() > 0.99
        error = (result[name].centre - centre)[found]
        rms[name] = np.sqrt((error**2).mean())
        assert rms[name] < limit * amplitude
        z = error / result[name].sigma[found]
        if name == "fit":
            assert claims.mean_square(z[:, 0])
            assert claims.mean_square(z[:, 1])
        else:
            scatter = np.sqrt((z**2).mean(axis=0))
            assert scatter.min() > 0.5
            assert scatter.max() < 1.4
    assert rms["fit"] < rms["circle"] < 0.5 * rms["hits"]


def test_no_result_depends_on_the_batch() -> None:
    """Claim: a pattern's centre is the same alone and among others, to rounding of sums (1e-9 of the radius)."""
    place, travel = ideal(12, LissajousPattern(amplitude=8e-3))
    centre = np.random.default_rng(37).uniform(-2e-3, 2e-3, (12, 2))
    samples = samples_of(place, travel, centre, 0.05, place, 41)
    together = estimates(samples)
    names = [field.name for field in dataclasses.fields(samples)]
    for row in (0, 5, 11):
        one = PatternSamples(**{name: getattr(samples, name)[row : row + 1] for name in names})
        for name, alone in estimates(one).items():
            np.testing.assert_allclose(alone.centre[0], together[name].centre[row], atol=1e-9 * RADIUS)
            np.testing.assert_allclose(alone.covariance[0], together[name].covariance[row], rtol=1e-6)


def test_averaging_improves_as_it_should() -> None:
    """Claim: the mean of K dithered patterns errs by 1/√K of one.

    Set-up: 1024 fits at 5 % noise, means of 16 in turn (64 of them) of those that are found. Expected: a quarter.
    Tolerance: that of the ratio of both scatters, of 128 and 2048 numbers, at a level of 10⁻⁴.
    """
    place, travel = ideal(1024, LissajousPattern(amplitude=8e-3))
    fit = estimates(samples_of(place, travel, np.zeros((1024, 2)), 0.05, place, 19))["fit"]
    assert fit.found.mean() > 0.998
    mean = np.nanmean(fit.centre.reshape(64, 16, 2), axis=1)
    assert claims.scatter_ratio(
        4.0 * float(np.sqrt((mean**2).mean())), float(np.sqrt(np.nanmean(fit.centre**2))), (128.0, 2048.0)
    )


@pytest.fixture(scope="module")
def lagging() -> dict[str, Array]:
    """Forty patterns of one target as the default mirrors run them, inverted in turn: (40, 128, 2) each."""
    servo, mirrors = Galvanometers(), mirrors_at(0.0, 0.0)
    pattern = LissajousPattern(amplitude=8e-3)
    rows = []
    for number in range(40):
        motion, mirrors = run_visit(
            servo,
            mirrors,
            pattern,
            number,
            (0.0, 0.0),
            start=6.6e-3 * number + 0.2e-3,
            dwell=DWELL,
            visiting=Visiting(),
        )
        rows.append(motion)
    return {
        name: np.stack(
            [np.stack([getattr(m, f"{name}_{axis}") for axis in ("theta", "phi")], axis=-1) for m in rows]
        )
        for name in ("commanded", "true", "latched", "travel")
    }


@pytest.mark.parametrize(("angles", "least"), [("latched", 20e-6), ("commanded", 100e-6)])
def test_inversion_removes_the_bias_of_lag(lagging: dict[str, Array], angles: str, least: float) -> None:
    """Claim: lag (commanded angles) or delay (encoders) biases the centre; pairs of inverted patterns do not.

    Set-up: default mirrors (lag 64 µs, encoders 10 µs early), 40 patterns of 8 mrad on a disc of 5 mrad, 0.2 % noise,
    neither corrected. Expected: the mean over patterns of one direction is off by more than 20 µrad (encoders) or
    100 µrad (commands); the mean of pairs by less than 5 µrad for encoders, and less than a tenth
    of the bias for commands, whose pattern the mirrors' start deforms as well. Noise of the means: 0.4 µrad.
    """
    samples = samples_of(lagging["true"], lagging["travel"], np.zeros((40, 2)), 0.002, lagging[angles], 23)
    fit = estimates(samples)["fit"]
    assert fit.found.all()
    one_way = np.abs(fit.centre[::2].mean(axis=0)).max()
    pairs = np.abs(0.5 * (fit.centre[::2] + fit.centre[1::2]).mean(axis=0)).max()
    assert one_way > least
    assert pairs < (5e-6 if angles == "latched" else 0.1 * one_way)


def test_a_known_delay_removes_the_bias_without_inversion(lagging: dict[str, Array]) -> None:
    """Claim: correcting the encoders' angles by their known delay removes the bias of each pattern.

    Set-up: as above, patterns of one direction only. Expected: bias below 5 µrad with the correction, above 20 µrad
    without and above 40 µrad with the wrong sign. Noise of the mean: 0.5 µrad.
    """
    samples = samples_of(lagging["true"], lagging["travel"], np.zeros((40, 2)), 0.002, lagging["latched"], 29)

    def bias(delay: float) -> float:
        corrected = samples.at(angles_later(samples.time, samples.angles, delay))
        return float(np.abs(estimates(corrected)["fit"].centre[::2].mean(axis=0)).max())

    assert bias(Galvanometers().readout_delay) < 5e-6
    assert bias(0.0) > 20e-6
    assert bias(-Galvanometers().readout_delay) > 40e-6


def test_the_judge_and_the_simulator_agree_on_a_blurred_edge() -> None:
    """Claim: far from the disc's centre its edge is straight; 1e-3 of the levels, the bend s²/2r being taken in."""
    distance = np.linspace(RADIUS - 1e-3, RADIUS + 1e-3, 41)
    straight = blurred_edge(RADIUS - 0.5 * SPOT**2 / RADIUS - distance, np.zeros(41), np.full(41, SPOT))[0]
    np.testing.assert_allclose(straight, judge.spot_on_disc(distance, RADIUS, SPOT), atol=1e-3)
    moved = np.stack([distance, np.zeros(41)], axis=-1), np.tile([0.9e-3, 0.0], (41, 1))
    smeared = blurred_edge(
        RADIUS - 0.5 * SPOT**2 / RADIUS - distance, np.full(41, 0.9e-3), np.full(41, SPOT)
    )[0]
    np.testing.assert_allclose(
        smeared, judge.disc_signal(*moved, np.zeros(2), RADIUS, SPOT, (1.0, 0.0)), atol=2e-3
    )
