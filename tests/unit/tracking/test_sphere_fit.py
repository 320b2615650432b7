"""Middles of spheres by the ranges on them, against rays that are shot here."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import claims
import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.foundation.status import Status
from scanner_sim.ranging.coordinates import coordinates
from scanner_sim.ranging.spot_light import spot_shift
from scanner_sim.tracking.samples import PatternSamples, rise_per_point
from scanner_sim.tracking.sphere_fit import SphereFit, sphere_fit

Array = NDArray[np.float64]

RADIUS, D_G, BASE, SPOT = 0.1, 0.05, 0.2, 0.12e-3
MIDDLES = np.array([[0.2, -0.15, 3.0], [-0.3, 0.25, 5.0], [0.0, 0.0, 9.0]])


def ray(theta: Array, phi: Array, middle: Array) -> tuple[Array, Array]:
    """Return where beams meet a sphere first, R [m], and a matt sphere's light at the lens; NaN where they miss."""
    centre = np.array(coordinates(middle[2], middle[0], middle[1], D_G))
    begin = np.stack(coordinates(np.zeros_like(theta), theta, phi, D_G), axis=-1)
    along = np.stack(coordinates(np.ones_like(theta), theta, phi, D_G), axis=-1) - begin
    # |begin + R along − centre|² = r², as a polynomial in R.
    away = begin - centre
    half, rest = (away * along).sum(axis=-1), (away * away).sum(axis=-1) - RADIUS**2
    with np.errstate(invalid="ignore"):
        reach = -half - np.sqrt(half**2 - rest)
    point = begin + reach[..., None] * along
    lens = begin + np.array([BASE, 0.0, 0.0]) - point
    far = np.linalg.norm(lens, axis=-1)
    return reach, ((point - centre) / RADIUS * lens).sum(axis=-1) / far**3


def pattern(middle: Array, duty_cycle: float = 1.0) -> PatternSamples:
    """Return 128 voxels of a figure over a sphere; ranges are means over the ways of dwells, by 60 rays each."""
    share = 2.0 * np.pi * (np.arange(128) + 0.5) / 128
    size = 1.1 * RADIUS / middle[2]
    theta, phi = middle[0] + size * np.cos(3.0 * share + 0.3), middle[1] + size * np.cos(2.0 * share - 0.4)
    way = duty_cycle * rise_per_point(np.stack([theta, phi]))
    steps = (np.arange(60) + 0.5) / 60 - 0.5
    reach, light = ray(theta + steps[:, None] * way[0], phi + steps[:, None] * way[1], middle)
    mean = (reach * light).sum(axis=0) / light.sum(axis=0)
    status = np.where(np.isfinite(mean), Status.VALID, Status.BELOW_THRESHOLD)
    one = np.ones((1, 128))
    return PatternSamples(
        50e-6 * np.arange(128) * one, theta * one, phi * one, one, 0.1 * one, mean * one, 2e-4 * one,
        status.astype(np.uint8)[None],
    )  # fmt: skip


def together(parts: list[PatternSamples]) -> PatternSamples:
    """Return patterns side by side."""
    return PatternSamples(
        *(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(PatternSamples))
    )


def fit(samples: PatternSamples, start: Array, outline: Array | None = None, **more: Any) -> SphereFit:
    """Return spheres by all voxels that have a range, of outlines that say nothing if none is given."""
    options: dict[str, Any] = {"by_line": None, "spot": SPOT, "stamp": samples.time.mean(axis=1)} | more
    known = np.tile(np.eye(2), (len(start), 1, 1)) if outline is None else outline
    return sphere_fit(samples, samples.valid, start, known, RADIUS, layout=(D_G, BASE), **options)


def aside(found: SphereFit) -> Array:
    """Return how far middles lie from the true ones, across and along [m]."""
    off: Array = (found.position - MIDDLES) * np.stack([MIDDLES[:, 2], MIDDLES[:, 2], np.ones(3)], axis=1)
    return off


@pytest.mark.parametrize("duty_cycle", [1.0, 0.4])
def test_middles_are_those_that_rays_are_shot_at(duty_cycle: float) -> None:
    """Claim: without noise the middle is right to a micrometre in any direction, though the fit begins a tenth of the
    radius aside; means over the way of a dwell, a centimetre, are taken for what they are: without, they lie 20 µm off.
    """
    samples = together([pattern(middle, duty_cycle) for middle in MIDDLES])
    start = MIDDLES + 0.1 * RADIUS * np.array([0.7, -0.7, 0.0]) / MIDDLES[:, 2:] + [0.0, 0.0, 3e-3]
    found = fit(samples, start, duty_cycle=duty_cycle)
    assert found.found.all()
    assert np.abs(aside(found)).max() < 1e-6
    assert np.abs(aside(fit(samples, start, duty_cycle=1e-9))[0]).max() > 2e-5 * duty_cycle


@pytest.mark.parametrize("share", [1.0, 0.3])
def test_what_triangulation_makes_of_a_spots_light_is_taken_off(share: float) -> None:
    """Claim: ranges that are longer by what the light of a spot does on each place's slopes, which differences of rays
    tell, have the same middle to a micrometre, all of it or the share that triangulation has in ranges by both; taken
    as they are, or as if they were triangulation's alone, it lies 10 µm off times what is too little or too much."""
    samples = together([pattern(middle, 1e-3) for middle in MIDDLES])
    step = 1e-6
    for row, middle in enumerate(MIDDLES):
        theta, phi, reach = samples.theta[row], samples.phi[row], samples.range[row]
        rise = [
            (ray(theta + a, phi + b, middle)[0] - ray(theta - a, phi - b, middle)[0]) / (2.0 * step)
            for a, b in ((step, 0.0), (0.0, step))
        ]
        slope = rise[0] / reach, rise[1] / (reach * np.cos(theta) - D_G)
        samples.range[row] += share * spot_shift(reach, theta, BASE, slope, SPOT * reach, 1.0 / RADIUS)
    for taken in (None, 0.0, 0.3, 1.0):
        known = None if taken is None else np.full(3, taken)
        off = np.abs(aside(fit(samples, MIDDLES, by_line=known, duty_cycle=1e-3))).max()
        wrong = abs((taken or 0.0) - share)
        assert off < 1e-6 if wrong == 0.0 else off > 1e-5 * wrong


@pytest.mark.parametrize("pointing", [0.0, 2e-4])
def test_errors_are_those_that_are_stated(pointing: float) -> None:
    """Claim: z² of all three coordinates together is 1, for errors of ranges and of the angles that are read.

    Set-up: 300 patterns at 3 m, 0.2 mm in range, dwells too short to matter. Expected: χ² of 900 numbers.
    """
    random, count = np.random.default_rng(41), 300
    samples = together([pattern(MIDDLES[0], 1e-3)] * count)
    samples.range[:] += 2e-4 * random.standard_normal(samples.range.shape)
    read = samples.at(samples.angles + pointing * random.standard_normal(samples.angles.shape))
    truth = np.tile(MIDDLES[0], (count, 1))
    found = fit(read, truth, pointing=pointing, duty_cycle=1e-3)
    assert found.found.all()
    root = np.linalg.cholesky(found.covariance / np.maximum(found.misfit, 1.0)[:, None, None])
    claim = claims.mean_square(np.linalg.solve(root, (found.position - truth)[..., None])[..., 0])
    assert claim
    assert claim.finds < 0.3
    assert claims.mean_square(np.sqrt(found.misfit), slack=0.1)


def test_the_misfit_of_few_ranges_is_one_in_the_mean() -> None:
    """Claim: χ² is divided by what the middle and its rate leave of ten ranges: six. Level 10⁻⁴, of 1000 patterns."""
    random, count = np.random.default_rng(43), 1000
    samples = together([pattern(MIDDLES[0], 1e-3)] * count)
    samples.range[:] += 2e-4 * random.standard_normal(samples.range.shape)
    away = np.hypot(*(samples.angles[0] - MIDDLES[0, :2, None]))
    kept = np.flatnonzero(away < 0.7 * RADIUS / 3.0)[:10]
    samples.status[:] = Status.BELOW_THRESHOLD
    samples.status[:, kept] = Status.VALID
    found = fit(samples, np.tile(MIDDLES[0], (count, 1)), duty_cycle=1e-3)
    assert kept.size == 10
    assert found.found.all()
    assert abs(found.misfit.mean() - 1.0) < 3.9 * np.sqrt(2.0 / (6 * count))


def test_a_sphere_that_comes_nearer_is_where_it_is_at_the_stamp() -> None:
    """Claim: a middle that moves along its sight by 0.3 m/s is told to a micrometre, for whichever time is asked."""
    samples, rate, stamp = pattern(MIDDLES[1], 1e-3), 0.3, np.array([2e-3])
    for point in range(128):
        moved = MIDDLES[1] + [0.0, 0.0, rate * (samples.time[0, point] - stamp[0])]
        samples.range[0, point] = ray(samples.theta[0, point], samples.phi[0, point], moved)[0]
    found = fit(samples, MIDDLES[1:2] + 1e-3, stamp=stamp, duty_cycle=1e-3)
    np.testing.assert_allclose(found.position[0], MIDDLES[1], atol=1e-6)


@pytest.mark.parametrize("by_line", [False, True])
def test_an_outline_is_one_more_observation(by_line: bool) -> None:
    """Claim: middle and covariance are those of both, weighed by their covariances; of triangulation the outline's φ
    counts alone."""
    samples = pattern(MIDDLES[0], 1e-3)
    samples.sigma_range[:] = 5e-3
    more: dict[str, Any] = {"duty_cycle": 1e-3, "spot": 1e-9, "by_line": np.ones(1) if by_line else None}
    alone = fit(samples, MIDDLES[:1], **more)
    start = MIDDLES[:1] + np.array([[4e-5, -7e-5, 0.0]])
    spread = np.array([[[4e-7, 1e-7], [1e-7, 2e-7]]])
    both = fit(samples, start, spread, **more)
    design = np.eye(3)[1:2] if by_line else np.eye(3)[:2]
    given = spread[0][1:, 1:] if by_line else spread[0]
    known = design.T @ np.linalg.inv(given)
    covariance = np.linalg.inv(np.linalg.inv(alone.covariance[0]) + known @ design)
    np.testing.assert_allclose(both.covariance[0], covariance, rtol=0.02, atol=1e-9)
    moved = covariance @ known @ design @ (start - alone.position)[0]
    np.testing.assert_allclose(both.position[0] - alone.position[0], moved, rtol=0.02, atol=1e-7)


def test_rows_do_not_depend_on_those_beside_them_and_few_ranges_tell_nothing() -> None:
    """Claim: every byte of patterns together is that of each alone. Without a start, or with seven ranges on the cap,
    nothing is found; with eight something is."""
    made = [pattern(middle) for middle in (*MIDDLES, MIDDLES[0], MIDDLES[0])]
    start = np.concatenate([MIDDLES, MIDDLES[:1], MIDDLES[:1] * np.nan])
    on_cap = np.flatnonzero(np.hypot(*(made[3].angles[0] - MIDDLES[0, :2, None])) < 0.7 * RADIUS / 3.0)
    for kept, told in ((7, False), (8, True)):
        samples = together(made)
        samples.status[3] = Status.BELOW_THRESHOLD
        samples.status[3, on_cap[:: len(on_cap) // kept][:kept]] = Status.VALID
        found = fit(samples, start)
        assert found.found.tolist() == [True, True, True, told, False]
    for row in range(4):
        alone = fit(samples.of(row), start[row : row + 1])
        for name, part in vars(alone).items():
            np.testing.assert_array_equal(part, getattr(found, name)[row : row + 1], err_msg=name)
