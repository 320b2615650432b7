"""What a calibrated instrument believes of positions, and lanes of several scenarios."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.instrument import together
from scanner_sim.instrument.closed_loop import believed_positions as module
from scanner_sim.instrument.closed_loop.believed_positions import BelievedPositions, RangeNoise
from scanner_sim.render.device import Device
from scanner_sim.scan.protocol import Aim

Array = NDArray[np.float64]

PLACES = np.array([[0.1, -0.2, 5.0], [0.3, 0.05, 8.0], [-0.2, 0.1, 3.0]])


def believed(ways: dict[str, tuple[str, ...]], *, uncertain: bool = True) -> Any:
    made: Any = object.__new__(BelievedPositions)
    made._calibration = SimpleNamespace(is_uncertain=uncertain)
    made._ways = ways
    return made


def in_common(_: Any, way: str, position: Array) -> Array:
    """Four errors of each way: of Θ, φ and R."""
    rise = {"triangulation": 1.0, "tof": -0.3}[way] * np.arange(1.0, 5.0)
    return position[..., None] * 1e-3 * rise


def test_fused_ranges_share_the_calibrations_errors_by_their_weights(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: positions err by (1 − w) of the one way's errors and w of the other's, w = (v₁ − c)/(v₁ + v₂ − 2c)
    with v the variance of noise and of these errors together, and c the covariance of both; where one way has no range
    the other stands alone, and one way needs no noise."""
    monkeypatch.setattr(module, "position_in_common", in_common)
    both = believed({"": ("triangulation",), "tof.": ("tof",), "fused.": ("triangulation", "tof")})
    noise = RangeNoise(np.array([2e-2, 5e-2, np.nan]), np.array([1e-2, np.nan, 1e-2]), np.full(3, 1e-5))
    found = both.in_common(PLACES, lambda: noise)
    one, other = (in_common(None, way, PLACES) for way in ("triangulation", "tof"))
    v1 = 4e-4 + (one[0, 2] ** 2).sum()
    v2 = 1e-4 + (other[0, 2] ** 2).sum()
    shared = 1e-5 + one[0, 2] @ other[0, 2]
    share = (v1 - shared) / (v1 + v2 - 2.0 * shared)
    np.testing.assert_allclose(found[0], (1.0 - share) * one[0] + share * other[0], rtol=1e-12)
    np.testing.assert_allclose(found[1:], [one[1], other[2]], rtol=1e-12)

    def none() -> RangeNoise:
        raise AssertionError

    alone = believed({"": ("tof",)})
    np.testing.assert_array_equal(alone.in_common(PLACES, none), other)
    assert believed({"": ("tof",)}, uncertain=False).in_common(PLACES, none).shape == (3, 3, 0)
    ideal: Any = object.__new__(BelievedPositions)
    ideal._calibration = None
    assert ideal.in_common(PLACES, none).shape == (3, 3, 0)


class Body:
    """An object whose place tells who it is and when."""

    moves = True

    def __init__(self, number: float) -> None:
        self.number = number

    def pose_at(self, time: Array) -> Array:
        pose = np.tile(np.eye(4), (len(time), 1, 1))
        pose[:, 0, 3], pose[:, 1, 3] = self.number, time
        return pose


@pytest.mark.parametrize("powers", [(0.01, 0.02), (0.01, 0.01)])
def test_lanes_of_scenarios_stand_one_after_the_other(device: Device, powers: tuple[float, float]) -> None:
    """Claim: each scenario has all shots of the aim, with its own seed, its own laser and its own objects where they
    are at these times; a power that all have is not told."""
    angles = np.array([0.1, 0.2, 0.35])
    aim = Aim(
        np.array([4, 5, 9], dtype=np.uint32),
        angles,
        -angles,
        np.array([0.5, 0.6, 0.8]),
        0.1 * angles,
        0.2 * angles,
    )
    scenarios: Any = [
        SimpleNamespace(
            seed=seed,
            scanner=SimpleNamespace(laser=SimpleNamespace(power=power)),
            scene=SimpleNamespace(
                objects=[Body(10.0 * seed), SimpleNamespace(moves=False), Body(20.0 * seed)]
            ),
        )
        for seed, power in zip((3, 7), powers, strict=True)
    ]
    loaded: Any = SimpleNamespace(bodies=[object(), object()])
    each, seeds, poses = together.lanes_of(scenarios, loaded, aim)
    np.testing.assert_array_equal(each.shot, [4, 5, 9] * 2)
    np.testing.assert_array_equal(each.theta, np.tile(angles, 2))
    np.testing.assert_array_equal(each.phi, np.tile(-angles, 2))
    assert seeds.lanes.numpy().tolist() == [3, 3, 3, 7, 7, 7]
    assert (seeds.powers is None) == (powers[0] == powers[1])
    if seeds.powers is not None:
        np.testing.assert_allclose(seeds.spread(seeds.powers).numpy(), np.repeat(powers, 3), rtol=1e-6)
    for pose, number in zip(poses, (10.0, 20.0), strict=True):
        np.testing.assert_allclose(pose.position.x.numpy(), np.repeat([3.0 * number, 7.0 * number], 3))
        np.testing.assert_allclose(pose.position.y.numpy(), np.tile(aim.time, 2), rtol=1e-6)
    assert together.lanes_of(scenarios, SimpleNamespace(bodies=[]), aim)[2] == ()  # type: ignore[arg-type]
