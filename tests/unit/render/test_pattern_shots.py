"""Shots that go to the device in two arrays are those of an aim, column by column."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from prototype import Mirrors
from scipy.spatial.transform import Rotation

from scanner_sim.foundation.parameters import PARAMETERS
from scanner_sim.optics.as_built import AsBuilt
from scanner_sim.optics.built_instrument import BuiltInstrument, still_errors
from scanner_sim.optics.deflection import TemperatureCourse
from scanner_sim.render.beam.pattern import _lanes
from scanner_sim.render.beam.pattern_shots import fired_shots, packed_shots
from scanner_sim.render.shots import true_shots
from scanner_sim.scan.protocol import Aim

pytestmark = pytest.mark.usefixtures("device")

COUNT, SEED, DUTY = 7, 11, 0.8
COURSE = TemperatureCourse(amplitude=4.0, period=50.0, rate=0.0)
SHAKEN = {
    "turn": [["1 Hz", "1e-9 rad^2/Hz"], ["20 Hz", "1e-10 rad^2/Hz"]],
    "shift": [["1 Hz", "1e-9 m^2/Hz"], ["9 Hz", "1e-9 m^2/Hz"]],
}
UNSTEADY = {"base_expansion": 2e-5, "focal_expansion": 3e-5, "vibration": SHAKEN}


def built_with(mirrors: Any, **changes: Any) -> BuiltInstrument:
    own = AsBuilt.model_validate({"power_noise": 0.1, "pulse_noise": 0.2, **changes})
    return BuiltInstrument(own, 1e-4 * np.arange(1.0, len(PARAMETERS) + 1.0), mirrors, 0.8, 5)


def aim() -> Aim:
    rng = np.random.default_rng(4)
    angles = rng.uniform(-0.3, 0.3, (2, COUNT))
    return Aim(
        rng.permutation(COUNT * 3)[:COUNT].astype(np.uint32), *angles, rng.uniform(0.0, 40.0, COUNT),
        *rng.uniform(-1e-3, 1e-3, (2, COUNT)),
    )  # fmt: skip


def poses(bodies: int) -> list[np.ndarray]:
    if not bodies:
        return []
    rng = np.random.default_rng(8)
    found = np.tile(np.eye(4), (bodies, COUNT, 1, 1))
    found[..., :3, :3] = Rotation.random(bodies * COUNT, rng).as_matrix().reshape(bodies, COUNT, 3, 3)
    found[..., :3, 3] = rng.uniform(-5.0, 5.0, (bodies, COUNT, 3))
    return list(found)


def numbers(values: Any) -> np.ndarray:
    return np.asarray(values.numpy(), dtype=np.float64)


@pytest.mark.parametrize("wobble", [0.0, 40e-6])
@pytest.mark.parametrize(
    ("built", "bodies"), [("unsteady", 0), ("designed", 2), ("steady", 2), ("unsteady", 2)]
)
def test_a_patterns_shots_are_those_of_its_aim(wobble: float, built: str, bodies: int) -> None:
    """Claim: angles, travel and errors are those of a raster's shots with the same numbers; what shakes, and poses of
    objects, arrive as they were packed, whatever stands before them. Tolerance: single precision."""
    mirrors = Mirrors(wobble=wobble, wobble_angle=0.02, wobble_time=0.7, jitter=3e-5, jitter_seen=0.3,
                      synchronisation=2e-5, temperature=COURSE)  # fmt: skip
    own = {
        "designed": None,
        "steady": built_with(mirrors),
        "unsteady": built_with(mirrors, **UNSTEADY),
    }[built]
    given, moved = aim(), poses(bodies)
    still = still_errors(mirrors, own, given.theta, given.phi, given.time)
    packed = packed_shots(given, still, mirrors, DUTY, moved, own)
    fired = fired_shots(mi.Float(packed[0]), mi.UInt32(packed[1]), COUNT, mirrors, bodies, SEED, own)
    alone, pointing = true_shots(given, mirrors, SEED, DUTY, None, own)

    np.testing.assert_array_equal(fired.shots.number.numpy(), given.shot)
    np.testing.assert_allclose(numbers(fired.aimed), given.theta, atol=2e-8)
    for axis, errors in enumerate((pointing.theta, pointing.phi)):
        np.testing.assert_allclose(numbers(fired.error[axis]) + still[axis], errors, atol=1e-9)
    for axis, seen in enumerate((pointing.seen_theta, pointing.seen_phi)):
        np.testing.assert_allclose(numbers(fired.seen[axis]), seen, atol=1e-9)
    for name, value in {"theta": given.theta + pointing.theta, "phi": given.phi + pointing.phi}.items():
        np.testing.assert_allclose(numbers(getattr(fired.shots, name)), value, atol=6e-8, err_msg=name)
    for name, value in {"travel_theta": given.travel_theta, "travel_phi": given.travel_phi}.items():
        np.testing.assert_allclose(numbers(getattr(fired.shots, name)), DUTY * value, rtol=1e-6, err_msg=name)
    np.testing.assert_allclose(
        numbers(fired.shots.synchronisation), numbers(alone.synchronisation), rtol=1e-6
    )

    departures = fired.shots.departures
    assert (departures is None) == (own is None)
    if own is not None:
        assert alone.departures is not None
        for name in ("power", "pulse"):
            assert numbers(getattr(departures, name)).std() > 0.02
            np.testing.assert_array_equal(
                numbers(getattr(departures, name)), numbers(getattr(alone.departures, name))
            )
    if built == "unsteady":
        assert own is not None
        warmer = COURSE.difference(given.time)
        np.testing.assert_allclose(numbers(departures.base), 0.8 * 2e-5 * warmer, rtol=1e-5)
        np.testing.assert_allclose(numbers(departures.focus), 3e-5 * warmer, rtol=1e-5)
        assert own.own.vibration is not None
        motion = own.own.vibration.motion(given.time, 5)
        found = np.stack([numbers(column) for column in (*departures.turn, *departures.shift)], axis=1)
        np.testing.assert_allclose(found, motion, rtol=1e-6)
        assert np.abs(motion).min() > 0.0
    if not bodies:
        assert not fired.shots.poses
        return
    for body, pose in enumerate(fired.shots.poses):
        turn = np.moveaxis(np.asarray(pose.rotation.numpy(), dtype=np.float64).reshape(3, 3, COUNT), -1, 0)
        np.testing.assert_allclose(turn, moved[body][:, :3, :3], atol=1e-6)
        np.testing.assert_allclose(np.asarray(pose.position.numpy()).T, moved[body][:, :3, 3], atol=1e-6)


@pytest.mark.parametrize("count", [1, 5, 31, 32, 33, 200])
def test_shots_that_are_fired_again_are_filled_up_with_the_first(count: int) -> None:
    """Claim: all of them, in their order, and lanes that are none beyond; a quarter more at most, but 32 lanes at
    least."""
    again = np.zeros(500, dtype=bool)
    some = np.sort(np.random.default_rng(count).choice(500, count, replace=False))
    again[some] = True
    found = _lanes(again, 32)
    assert found is not None
    index, real = (part.numpy() for part in found)
    assert real.sum() == count
    np.testing.assert_array_equal(index[:count], some)
    assert real[:count].all()
    assert not index[count:].any()
    assert max(count, 32) <= len(index) <= max(32, 1.25 * count + 1)
    assert _lanes(np.zeros(500, dtype=bool), 32) is None
