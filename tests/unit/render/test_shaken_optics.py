"""The optics as a platform's shaking leaves them: a rigid motion of beam and lens."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import drjit as dr
import mitsuba
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scanner_sim.optics.deflection import Frame

mi: Any = mitsuba

pytestmark = pytest.mark.usefixtures("device")


def numbers(vector: Any) -> NDArray[np.float64]:
    return np.asarray(mi.Vector3f(vector).numpy(), dtype=np.float64).T


def test_shaking_turns_axes_and_carries_points() -> None:
    """Claim: axes are turned about the scanner's origin, points are turned and shifted, each shot by its own; what is
    left out is of the third order of the turn, 4e-6 of the vector's length at 30 mrad, and its rounding. Without
    shaking nothing moves."""
    from scanner_sim.render.shot_departures import ShotDepartures

    turn = np.array([[0.01, -0.02, 0.015], [-0.012, 0.003, 0.02]])
    shift = np.array([[0.2, -0.3, 0.5], [-0.4, 0.1, -0.6]])
    vectors = np.random.default_rng(2).normal(size=(5, 3))
    given = Frame(*(mi.Vector3f(*vector.tolist()) for vector in vectors))
    columns = [mi.Float(column.tolist()) for column in (*turn.T, *shift.T)]
    moved = ShotDepartures(turn=columns[:3], shift=columns[3:]).moved(given)
    turned = np.stack([rotation.apply(vectors) for rotation in Rotation.from_rotvec(turn)])
    for place, (name, vector) in enumerate(zip(moved._fields, moved, strict=True)):
        wanted = turned[:, place] + (shift if name in ("laser", "lens") else 0.0)
        left_out = 4e-6 * float(np.linalg.norm(vectors[place])) + 1e-6
        np.testing.assert_allclose(numbers(vector), wanted, rtol=0.0, atol=left_out)
    still = ShotDepartures(base=mi.Float(0.1)).moved(given)
    assert still is given


def test_some_shots_have_their_own_departures() -> None:
    """Claim: of four shots those that are asked for come with all that is theirs, in the order that they are asked."""
    from scanner_sim.render.shot_departures import ShotDepartures

    columns = np.arange(40.0).reshape(10, 4)
    whole = ShotDepartures.of([mi.Float(column.tolist()) for column in columns[:8]])
    whole.power, whole.pulse = (mi.Float(column.tolist()) for column in columns[8:])
    some = whole.take(mi.UInt32([3, 1]))
    parts = [some.base, some.focus, *(some.turn or ()), *(some.shift or ()), some.power, some.pulse]
    np.testing.assert_array_equal([part.numpy() for part in parts], columns[:, [3, 1]])
    assert dr.width(some.base) == 2
    nothing = ShotDepartures().take(mi.UInt32([3, 1]))
    assert all(part is None for part in vars(nothing).values())


def test_the_lasers_power_scatters_about_itself() -> None:
    """Claim: power and pulses of n shots have the mean 1 and the noise that is told, independent of each other, and
    each shot its own numbers, whichever are asked for with it. Bounds: 1e-4 together, 4.3 standard errors each: σ/√n
    of a mean, 1/√2n of a σ, 1/√n of a correlation. Without noise there is nothing."""
    from scanner_sim.render.shot_departures import ShotDepartures

    count, noise = 20_000, (0.03, 0.08)
    own: Any = SimpleNamespace(power_noise=noise[0], pulse_noise=noise[1])
    built: Any = SimpleNamespace(own=own)
    made = ShotDepartures().with_noise(built, dr.arange(mi.UInt32, count), 5)
    values = np.array([made.power.numpy(), made.pulse.numpy()], dtype=np.float64)
    for value, sigma in zip(values, noise, strict=True):
        assert value.mean() == pytest.approx(1.0, abs=4.3 * sigma / np.sqrt(count))
        assert value.std() == pytest.approx(sigma, rel=4.3 / np.sqrt(2.0 * count))
    assert abs(np.corrcoef(values)[0, 1]) < 4.3 / np.sqrt(count)
    some = ShotDepartures().with_noise(built, mi.UInt32([7, 19_000]), 5)
    np.testing.assert_array_equal([some.power.numpy(), some.pulse.numpy()], values[:, [7, 19_000]])
    own.power_noise = own.pulse_noise = None
    still = ShotDepartures().with_noise(built, mi.UInt32([7]), 5)
    assert still.power is still.pulse is None
    own.power_noise, own.pulse_noise = None, 3.0
    wild = ShotDepartures().with_noise(built, dr.arange(mi.UInt32, 100), 5)
    assert (wild.power.numpy() == 1.0).all()
    assert wild.pulse.numpy().min() == 0.0
