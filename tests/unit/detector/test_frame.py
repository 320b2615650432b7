"""The video camera's sensor, exposure control and glare: charges, numbers and times against closed forms."""

from __future__ import annotations

import itertools
from typing import Any

import claims
import numpy as np
import pytest
from pydantic import ValidationError

from scanner_sim.detector.frame.exposure import AutomaticExposure
from scanner_sim.detector.frame.glare import Glare, PointLight, strewn, veil_at
from scanner_sim.detector.frame.sensor import FrameSensor, expose, mean_charge, overflow, pattern_of
from scanner_sim.detector.frame.video_camera import CameraDoubt, VideoCamera

EVEN = {"prnu": 0.0, "dsnu": 0.0, "black_level": 0, "bits": 16, "gain": 1.0, "full_well": 60_000.0}


def test_overflow_fills_the_nearest_room_above_and_below() -> None:
    column = np.array([0.0, 0.0, 10.0, 70.0, 10.0, 0.0, 0.0])[:, None]
    assert overflow(column, 20.0).ravel().tolist() == [0.0, 15.0, 20.0, 20.0, 20.0, 15.0, 0.0]


def test_overflow_conserves_charge_within_long_columns_and_loses_it_at_their_ends() -> None:
    charge = np.random.default_rng(1).uniform(0.0, 30.0, (200, 40))
    charge[90:100, 5:9] = 400.0
    found = overflow(charge, 100.0)
    assert found.max() <= 100.0
    np.testing.assert_allclose(found.sum(axis=0), charge.sum(axis=0), rtol=1e-12)
    np.testing.assert_array_equal(found[:, 10:], charge[:, 10:])
    full = np.full((5, 1), 50.0)
    assert overflow(full, 20.0).sum() == 100.0


@pytest.mark.parametrize("first", [True, False])
def test_a_full_pixel_at_the_end_of_a_column_loses_half_of_its_excess(first: bool) -> None:
    """Claim: half flows off the sensor, half along the column, none to its other end."""
    column = np.array([80.0, 3.0, 0.0, 0.0, 0.0, 0.0])[:, None]
    held = np.array([20.0, 20.0, 13.0, 0.0, 0.0, 0.0])[:, None]
    if not first:
        column, held = column[::-1], held[::-1]
    np.testing.assert_allclose(overflow(column, 20.0), held, atol=1e-12)


def test_without_blooming_a_drain_takes_the_excess() -> None:
    rate = np.zeros((9, 9))
    rate[4, 4] = 2e7
    made = {
        flows: expose(
            FrameSensor(**EVEN, blooming=flows), rate, 0.05, pattern_of(FrameSensor(**EVEN), (9, 9), 0), 0, 0
        )
        for flows in (True, False)
    }
    assert made[True].saturated[:, 4].all()
    assert not made[True].saturated[:, 3].any()
    assert made[False].saturated.sum() == 1


def test_a_pixel_at_the_converters_end_is_saturated_however_deep_its_well() -> None:
    """Claim: 8 bits of 10 electrons each end at 2550: pixels of 4000 say 255 and are saturated, of 1500 not."""
    sensor = FrameSensor(**{**EVEN, "bits": 8, "gain": 10.0})
    rate = np.repeat([[1500.0, 4000.0]], 6, axis=0) / 0.01
    found = expose(sensor, rate, 0.01, pattern_of(sensor, (6, 2), 0), 3, 0)
    assert (found.counts[:, 1] == 255).all()
    np.testing.assert_array_equal(found.saturated, np.tile([False, True], (6, 1)))


@pytest.mark.parametrize("electrons", [0.0, 300.0, 20_000.0])
def test_the_photon_transfer_curve(electrons: float) -> None:
    """Claim: the variance of numbers over frames is that of light, dark current, reading and rounding.

    Set-up: even light, 64 frames of 64 × 64 pixels without patterns. Expected: (N + D t + r²)/g² + 1/12 (EMVA 1288, eq
    15). Bounds: χ² at the level of the claims; a departure of 2 % would be found.
    """
    sensor = FrameSensor(**{**EVEN, "gain": 4.0}, read_noise=20.0, dark_current=5000.0)
    even, time = np.full((64, 64), electrons / 0.01), 0.01
    pattern = pattern_of(sensor, even.shape, 3)
    counts = np.array([expose(sensor, even, time, pattern, 3, n).counts for n in range(64)], dtype=float)
    # Negative noise is cut off at black, so the mean stands above it.
    lifted = FrameSensor(**{**EVEN, "gain": 4.0, "black_level": 100}, read_noise=20.0, dark_current=5000.0)
    counts = np.array([expose(lifted, even, time, pattern, 3, n).counts for n in range(64)], dtype=float)
    expected = (electrons + 50.0 + 400.0) / 16.0 + 1.0 / 12.0
    assert lifted.variance(np.array(electrons), time) / 16.0 == pytest.approx(expected, rel=1e-12)
    mean = 100.0 + (electrons + 50.0) / 4.0
    claim = claims.mean_square((counts - mean) / np.sqrt(expected), slack=2e-3)
    assert claim, claim
    assert claim.finds < 0.02


def test_patterns_are_of_the_sensor_and_noise_is_of_the_frame() -> None:
    sensor = FrameSensor(prnu=0.02, dsnu=0.5)
    one, same, other = (pattern_of(sensor, (200, 200), seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.response, same.response)
    assert not np.array_equal(one.response, other.response)
    claim = claims.mean_square((one.response - 1.0) / 0.02)
    assert claim, claim
    assert (one.dark >= 0.0).all()
    rate = np.full((200, 200), 1e6)
    made = [expose(sensor, rate, 1e-3, one, 1, frame).counts for frame in (0, 0, 1)]
    np.testing.assert_array_equal(made[0], made[1])
    assert not np.array_equal(made[0], made[2])


def test_light_goes_by_the_response_and_dark_current_by_its_own_pattern() -> None:
    sensor = FrameSensor(prnu=0.05, dsnu=0.3, dark_current=1e4)
    pattern = pattern_of(sensor, (30, 30), 2)
    charge = mean_charge(sensor, np.full((30, 30), 2e6), 1e-2, pattern)
    np.testing.assert_allclose(charge, 2e4 * pattern.response + 100.0 * pattern.dark, rtol=1e-12)


def test_smear_is_the_light_of_the_rest_of_the_column() -> None:
    sensor = FrameSensor(**EVEN, dark_current=0.0, smear=1e-6)
    rate = np.zeros((10, 3))
    rate[4, 1] = 1e6
    charge = mean_charge(sensor, rate, 1e-3, pattern_of(sensor, (10, 3), 0))
    assert charge[4, 1] == pytest.approx(1e3)
    assert charge[[0, 9], 1] == pytest.approx([1.0, 1.0])
    assert charge[:, 0].sum() == 0.0


def test_the_control_settles_by_its_rate() -> None:
    """What is missing of the logarithm shrinks by 1 − rate from frame to frame, with a lag of one."""
    control = AutomaticExposure(type="automatic", rate=0.5, lag=1, longest=0.03, shortest=1e-6)
    slope, time, missing = 200.0, 1e-4, []
    for _ in range(8):
        missing.append(np.log(control.target / (slope * time)))
        time = control.following(time, slope * time)
    ratios = [b / a for a, b in itertools.pairwise(missing)]
    np.testing.assert_allclose(ratios, 0.5, rtol=1e-9)
    assert control.following(0.03, 0.0) == 0.03
    assert control.following(2e-6, 1.0) >= 1e-6


@pytest.mark.parametrize("black", [0, 300])
def test_a_settled_control_has_its_target(black: int) -> None:
    """Claim: the level is the share of the full well, whatever number stands for black."""
    sensor = FrameSensor(**{**EVEN, "bits": 12, "gain": None, "blooming": False, "black_level": black})
    light = np.linspace(0.0, 9e6, 400).reshape(20, 20)
    for measure in ("mean", "percentile"):
        control = AutomaticExposure(type="automatic", measure=measure, percentile=0.9, target=0.7)
        time = control.settled(sensor, light)
        held = np.minimum(light * time, sensor.full_well) / sensor.full_well
        level = held.mean() if measure == "mean" else np.quantile(held, 0.9)
        assert level == pytest.approx(0.7, rel=1e-4)


@pytest.mark.parametrize("measure", ["mean", "percentile"])
def test_a_control_stays_where_it_settled_on_a_flooded_scene(measure: str) -> None:
    """Claim: frames with noise, of a scene that fills whole columns, keep the control where it settled, to 2 %.

    Set-up: a patch a hundred times as bright as the rest, whose charge flows up and down its columns, with smear and
    dark current. A control that does not know them settles at more than twice the time.
    """
    sensor = FrameSensor(bits=12, blooming=True, smear=1e-3, dark_current=1e5)
    light = np.full((60, 80), 0.1 * sensor.full_well / 0.01)
    light[20:30, 10:26] *= 100.0
    control = AutomaticExposure(
        type="automatic", measure=measure, percentile=0.7, target=0.3, lag=1, shortest=1e-6
    )
    settled = control.settled(sensor, light)
    time, pattern = settled, pattern_of(sensor, light.shape, 3)
    for frame in range(12):
        time = control.following(
            time, control.level(sensor, expose(sensor, light, time, pattern, 3, frame).counts)
        )
    assert time == pytest.approx(settled, rel=0.02)
    dry = FrameSensor(bits=12, blooming=False, smear=0.0, dark_current=0.0)
    assert control.settled(dry, light) > 2.0 * settled


def test_full_pixels_count_as_full_to_the_control() -> None:
    """Claim: with half of the pixels full, at half of the converter's range, the others reach 0.2 of it for 0.35."""
    well = FrameSensor(**EVEN).full_well
    sensor = FrameSensor(
        **{**EVEN, "bits": 12, "black_level": 0, "gain": 2.0 * well / 4095.0, "blooming": False}
    )
    light = np.repeat([1e4 * well, 0.4 * well / 0.01], 50).reshape(10, 10)
    control = AutomaticExposure(type="automatic", measure="mean", target=0.35)
    assert control.settled(sensor, light) == pytest.approx(0.01, rel=1e-4)


def test_strewn_light_falls_where_it_is_said() -> None:
    glare = Glare(veil=0.1, width=2.0, ghost=0.01)
    point = np.zeros((101, 121))
    point[40, 30] = 1000.0
    found = strewn(glare, point, (60.0, 50.0))
    assert found[40, 30] == pytest.approx(890.0 + 100.0 / (8.0 * np.pi), rel=1e-9)
    assert found[40, 40] == pytest.approx(100.0 * 26.0**-1.5 / (8.0 * np.pi), rel=1e-6)
    assert found[60, 90] - found[60, 91] == pytest.approx(10.0, rel=0.01)
    # The kernel's integral is 1; what falls beside the frame is lost.
    y, x = np.mgrid[-600:601, -600:601]
    assert veil_at(glare, np.hypot(x, y)).sum() == pytest.approx(1.0, abs=5e-3)
    dark = np.zeros((20, 20))
    beside = strewn(glare, dark, (10.0, 10.0), PointLight((-30.0, 10.0), 1e6))
    assert beside[10, 0] == pytest.approx(1e5 * (1.0 + 15.0**2) ** -1.5 / (8.0 * np.pi), rel=1e-9)


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        ({"exposure": {"type": "fixed", "time": 0.0341}}, "0.0341 s is longer than a frame of 0.03333 s"),
        ({"exposure": {"type": "automatic", "longest": 0.0513}, "frame_rate": 20.0}, "longer than a frame"),
        ({"exposure": {"type": "automatic", "shortest": 0.03, "longest": 0.01}}, "not above shortest"),
        ({"sensor": {"bits": 4, "black_level": 9}}, "half of the converter"),
        ({"sensor": {"band": (7e-7, 4e-7)}}, "ascend"),
        ({"lens": {"glare": {"veil": 0.45, "ghost": 0.08}}}, "half of the light"),
        ({"as_built": {"focal_length": -0.05}}, "no interior orientation"),
        ({"interior": {"k1": -5.0}}, "folds"),
        ({"sampling": {"samples": 5}}, "4, 16"),
    ],
)
def test_impossible_cameras_are_refused(wrong: dict[str, Any], word: str) -> None:
    with pytest.raises(ValidationError, match=word):
        VideoCamera(**wrong)


@pytest.mark.parametrize(("bits", "most"), [(4, 7), (8, 127), (16, 32767)])
def test_a_black_level_leaves_half_of_the_converter(bits: int, most: int) -> None:
    """Claim: the largest that is taken leaves half of the 2^bits numbers above it; the next one is refused with that
    one as the remedy."""
    assert VideoCamera(sensor={"bits": bits, "black_level": most}).sensor.black_level == 2 ** (bits - 1) - 1
    with pytest.raises(ValidationError, match=f"Write {most} or less"):
        VideoCamera(sensor={"bits": bits, "black_level": most + 1})


def test_an_automatic_exposure_starts_anywhere_between_its_ends() -> None:
    """Claim: also at either of them, and not beyond."""
    ends = {"type": "automatic", "shortest": 1e-4, "longest": 0.02}
    for start in (1e-4, 0.003, 0.02):
        assert VideoCamera(exposure=ends | {"start": start}).exposure.start == start
    for start in (0.99e-4, 0.0202):
        with pytest.raises(ValidationError, match="is not between shortest"):
            VideoCamera(exposure=ends | {"start": start})


def test_doubts_of_a_camera_are_squared_in_the_order_of_its_parameters() -> None:
    """Claim: nothing is correlated; lengths, pixels and angles stand where the pose's derivatives have them."""
    sigma = [2e-5, 0.3, 0.7, 0.011, 0.13, 1.7, 3e-4, 5e-4]
    named = dict(zip(("k1", "k2", "k3", "p1", "p2"), sigma[3:], strict=True))
    doubt = CameraDoubt(
        focal_length=2e-5, principal_point=(0.3, 0.7), position=0.004, rotation=0.0021, **named
    )
    np.testing.assert_allclose(doubt.covariance, np.diag([one * one for one in sigma]), rtol=1e-12)
    np.testing.assert_allclose(doubt.mount_covariance, np.diag([1.6e-5] * 3 + [4.41e-6] * 3), rtol=1e-12)
