"""What is drawn of an instrument: each departure, each line of its vibration, each mirror's wobble by itself."""

from __future__ import annotations

import math
from itertools import combinations

import drjit as dr
import drjit.auto.ad as auto
import mitsuba as mi
import numpy as np
import pytest
from prototype import Mirrors

from scanner_sim.detector.encoders import read_encoders, reading_noise
from scanner_sim.foundation.parameters import NAMES
from scanner_sim.optics.as_built import AsBuilt
from scanner_sim.optics.vibration import Vibration
from scanner_sim.render.shots import Lattice, true_shots, wobble
from scanner_sim.scan.protocol import Aim

pytestmark = pytest.mark.usefixtures("device")

QUIET = Mirrors(jitter=0.0, wobble=0.0, synchronisation=0.0)


def test_departures_are_drawn_independent_of_each_other() -> None:
    """Claim: over 400 instruments no two departures go together.

    Tolerance: of normal numbers √n r is normal; 5 standard deviations, 6e-7 for a pair, 1e-4 for all.
    """
    assert len(NAMES) > 20
    built = AsBuilt.model_validate(
        {name: {"tolerance": "1e-3"} if name.endswith("_scale") else None for name in NAMES}
    )
    drawn = [name for name in NAMES if getattr(built, name) is not None]
    values = np.array([built.parameters(seed) for seed in range(400)])[
        :, [NAMES.index(name) for name in drawn]
    ]
    assert len(drawn) >= 3
    for one, other in combinations(range(len(drawn)), 2):
        assert abs(np.corrcoef(values[:, one], values[:, other])[0, 1]) < 5.0 / 20.0, (
            drawn[one],
            drawn[other],
        )


def test_lines_of_a_vibration_have_frequencies_of_their_own() -> None:
    """Claim: sines of the bands' middles do not make up the motion, as they would if only phases were drawn."""
    density = 1e-10
    shaken = Vibration.model_validate(
        {"turn": [["1 Hz", f"{density} rad^2/Hz"], ["2 Hz", f"{density} rad^2/Hz"]]}
    )
    time = np.arange(0.0, 600.0, 0.25)
    moved = shaken.motion(time, 5)[:, 0]
    middle = 2.0 ** ((np.arange(256) + 0.5) / 256.0)
    waves = math.tau * np.outer(time, middle)
    basis = np.concatenate([np.cos(waves), np.sin(waves)], axis=1)
    left = moved - basis @ np.linalg.lstsq(basis, moved, rcond=None)[0]
    assert moved.var() == pytest.approx(density, rel=0.3)
    assert left.var() > 0.2 * moved.var()


def test_a_vibration_is_alike_as_its_spectrum_says() -> None:
    """Claim: the correlation is ∫ S cos(2π f τ) df over the power, by a fine sum over the spectrum, to 1e-3; without a
    spectrum there is none. And the motion that is drawn has it: mean over 400 seeds, each of three axes; five
    standard deviations of a mean of 1200 products are 0.2."""
    points = [[0.5, 4e-9], [5.0, 1e-9], [60.0, 1e-12]]
    shaken = Vibration.model_validate({"turn": points})
    apart = np.array([0.0, 0.02, 0.1, 0.4, 57.0, 83.0])
    rate = np.geomspace(0.5, 60.0, 200_001)
    density = np.exp(np.interp(np.log(rate), *np.log(np.transpose(points))))
    power = np.trapezoid(density, rate)
    wanted = [np.trapezoid(density * np.cos(2.0 * np.pi * rate * away), rate) / power for away in apart]
    found, none = shaken.correlation(apart)
    np.testing.assert_allclose(found, wanted, atol=1e-3)
    np.testing.assert_array_equal(none, 0.0)
    moved = np.stack([shaken.motion(1.3 + apart, seed)[:, :3] for seed in range(400)])
    drawn = (moved * moved[:, :1]).mean(axis=(0, 2)) / shaken.deviations[0] ** 2
    np.testing.assert_allclose(drawn, wanted, atol=0.2)


def test_turns_and_shifts_of_a_platform_are_drawn_independent_of_each_other() -> None:
    """Claim: of six motions with one shape of spectrum no two go together: neither those about unlike axes, nor a turn
    about an axis and the shift along it, as one draw for both would make them.

    Set-up: 40 seeds at ten moments 17 s apart, of which a flat spectrum from 1 to 200 Hz keeps nothing.
    Tolerance: of normal numbers √n r is normal; 5 standard deviations, 6e-7 for a pair, 1e-5 for all.
    """
    shaken = Vibration(turn=((1.0, 1e-10), (200.0, 1e-10)), shift=((1.0, 4e-12), (200.0, 4e-12)))
    moments = 17.0 * np.arange(10)
    moved = np.concatenate([shaken.motion(moments, seed) for seed in range(40)])
    assert moved.shape == (400, 6)
    for one, other in combinations(range(6), 2):
        assert abs(np.corrcoef(moved[:, one], moved[:, other])[0, 1]) < 5.0 / 20.0, (one, other)


def test_mirrors_wobble_by_themselves_and_apart_from_jitter() -> None:
    """Claim: wobbles of both mirrors, in the same 4000 cells of their lattices, and jitter of shots of these
    numbers go with nothing else.

    Tolerance: 5 standard deviations of √n r.
    """
    mirrors = QUIET.model_copy(update={"wobble": 30e-6})
    count, zero = 4000, np.zeros(4000)
    moment = dr.arange(mi.UInt32, count)
    lattice = Lattice(dr.zeros(mi.UInt32, count), mi.Float(0.0), moment, mi.Float(0.0))
    seed = auto.UInt64(7)
    found = [wobble(lattice, mirrors, seed, mirror).numpy() for mirror in (0, 1)]
    jitter = QUIET.model_copy(update={"jitter": 10e-6})
    aim = Aim(np.arange(count, dtype=np.uint32), zero, zero, zero + 1.0, zero, zero)
    _, shaken = true_shots(aim, jitter, 7)
    for one, other in combinations((*found, shaken.theta, shaken.phi), 2):
        assert abs(np.corrcoef(one, other)[0, 1]) < 5.0 / math.sqrt(count)
    assert [values.std() for values in found] == pytest.approx([30e-6, 30e-6], rel=0.06)


@pytest.mark.parametrize("seen", [0.0, 1.0])
def test_noise_of_a_reading_is_the_reading_of_nothing(seen: float) -> None:
    """Claim: encoders that round nothing read their noise, and of the jitter what they see."""
    mirrors = QUIET.model_copy(
        update={"jitter": 40e-6, "jitter_seen": seen, "readout_noise": 3e-6, "readout_step": 0.0}
    )
    shot, zero = np.arange(50, dtype=np.uint32), np.zeros(50)
    seeds = np.full(50, 9, dtype=np.uint64)
    aim = Aim(shot, zero, zero, zero, zero, zero)
    _, shaken = true_shots(aim, mirrors, 9)
    expected = read_encoders(shot, shaken.seen_theta, shaken.seen_phi, mirrors, 9)
    np.testing.assert_allclose(reading_noise(shot, mirrors, seeds), expected, rtol=0.0, atol=1e-11)


def test_what_a_shaken_platform_keeps_is_the_transform_of_its_spectrum() -> None:
    """Claim: the correlation at τ is ∫ S cos(2π f τ) df over ∫ S df, of turns and of shifts each by its own spectrum:
    by half a million even steps of each. Within one of 256 bands a density is taken as even: 2e-3."""
    turn = ((5.0, 1e-10), (40.0, 2e-10), (60.0, 1e-12), (300.0, 3e-13))
    shift = ((0.7, 1e-12), (9.0, 1e-14))
    apart = np.array([[0.0, 1e-3, 7e-3], [0.03, 0.4, 3.1]])
    found = Vibration(turn=turn, shift=shift).correlation(apart)
    for spectrum, told in zip((turn, shift), found, strict=True):
        frequency, density = np.log(np.array(spectrum)).T
        f = np.linspace(spectrum[0][0], spectrum[-1][0], 500_001)
        power = np.exp(np.interp(np.log(f), frequency, density))
        wanted = [np.trapezoid(power * np.cos(2.0 * np.pi * f * one), f) for one in apart.ravel()]
        np.testing.assert_allclose(told.ravel(), np.array(wanted) / np.trapezoid(power, f), atol=2e-3)
    assert not Vibration(turn=turn).correlation(apart)[1].any()
