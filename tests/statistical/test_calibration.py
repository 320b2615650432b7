"""Calibrations of drawn instruments: where the truth lies, and what they are worth on boards that they did not see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration_fields import made_field
from claims import mean_square, share
from scipy.stats import chi2

from scanner_sim.calibration.adjustment import adjust
from scanner_sim.calibration.holdout import misfit
from scanner_sim.calibration.starts import start_of
from scanner_sim.foundation.parameters import INDEX

pytestmark = pytest.mark.slow

DRAWS = 200


def test_the_truth_lies_in_the_ellipsoid() -> None:
    """*Claim:* of instruments drawn from their tolerances 95 % lie in the 95 % ellipsoid of their calibration.

    *Set-up:* 200 fields of three stations and two boards, all parameters of the forward model, survey and readings with
    noise. *Expected:* (p̂ − p)ᵀ C⁻¹ (p̂ − p) is χ² with seven degrees of freedom, since tolerances are part of what is
    known. *Tolerance:* of the binomial and of χ² at the level of the suite; slopes leave out second orders of 1e-3 σ.
    """
    generator = np.random.default_rng(41)
    squares, weights = [], []
    for _ in range(DRAWS):
        field, truth = made_field(generator, stations=3)
        found = adjust(field, start_of(field))
        error = (found.unknowns.parameters - truth)[[INDEX[name] for name in field.sought]]
        squares.append(error @ np.linalg.solve(found.covariance, error))
        weights.append(found.unit_weight**2)
    freedom = len(field.sought)
    inside = np.asarray(squares) < chi2.ppf(0.95, freedom)
    claim = share(int(inside.sum()), DRAWS, 0.95)
    assert claim, claim
    whole = mean_square(np.sqrt(np.asarray(squares) / freedom), freedom=DRAWS * freedom)
    assert whole, whole
    assert np.mean(weights) == pytest.approx(1.0, abs=0.02)


def test_what_a_station_has_in_common_is_no_noise_of_its_own() -> None:
    """*Claim:* readings that err together within a station leave the truth in the ellipsoid if that is known.

    *Set-up:* 60 fields whose readings along the line have 2 σ more in two parts, one like all over the station and one
    that grows with range. *Expected:* χ² with seven degrees of freedom; taken as noise of each sighting, of the same
    σ, it is more than 1.5 times that. *Tolerance:* of χ² at the level of the suite.
    """
    generator = np.random.default_rng(43)
    known, taken = [], []
    for _ in range(60):
        field, truth = made_field(generator, stations=3)
        seen = field.sightings
        place = seen.readings.measured
        common = np.zeros((len(seen), 3, 2))
        common[:, 2, 0], common[:, 2, 1] = 1e-6, 1e-6 * (place - place.mean()) / place.std()
        drawn = generator.normal(size=(len(field.stations), 2))
        moved = place + np.einsum("nk,nk->n", common[:, 2], drawn[seen.station])
        readings = replace(seen.readings, measured=moved)
        own = seen.root.copy()
        own[:, 2, 2] = np.sqrt(own[:, 2, 2] ** 2 + (common[:, 2] ** 2).sum(axis=1))
        for squares, root, part in ((known, seen.root, common), (taken, own, common[:, :, :0])):
            one = replace(field, sightings=replace(seen, readings=readings, root=root, common=part))
            found = adjust(one, start_of(one))
            assert found.settled
            error = (found.unknowns.parameters - truth)[[INDEX[name] for name in field.sought]]
            squares.append(error @ np.linalg.solve(found.covariance, error) / len(field.sought))
    claim = mean_square(np.sqrt(known), freedom=60 * 7)
    assert claim, claim
    assert np.mean(taken) > 1.5


def test_held_out_boards_are_left_with_noise() -> None:
    """*Claim:* a calibration from two boards leaves the third, which it has not seen, with its noise alone; what it was
    fitted to gains more.

    *Expected:* rms over σ of the held-out views within 10 % of 1, from over 2 as designed. *Tolerance:* 40 fields have
    over 5000 degrees of freedom, 1 % of scatter.
    """
    generator = np.random.default_rng(41)
    fits, held = [], []
    for _ in range(40):
        field, _ = made_field(generator, stations=6, boards=3)
        own = field.targets.board[field.sightings.target]
        fitted = field.seeing(own < 2)
        found = adjust(fitted, start_of(fitted))
        fits.append(misfit(fitted, found.unknowns.parameters))
        held.append(misfit(field.seeing(own == 2), found.unknowns.parameters))
    calibrated = np.sqrt(np.mean([one.calibrated**2 for one in held]))
    designed = np.sqrt(np.mean([one.designed**2 for one in held]))
    assert designed > 2.0
    # Below 1 by four times its scatter at most, above by what the calibration itself may add.
    assert 0.96 < calibrated < 1.1
    assert np.mean([one.improvement for one in fits]) > np.mean([one.improvement for one in held])
