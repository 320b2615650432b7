"""Which voxels hit a target: every kind, by intensity and range together."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.foundation.status import Status
from scanner_sim.tracking.response import TargetKind, target_response, two_levels
from scanner_sim.tracking.samples import PatternSamples, angles_later

POINTS = 128
GATE = (9.0, 11.0)


def pattern(disc: dict[str, Any], ground: dict[str, Any]) -> tuple[PatternSamples, NDArray[np.bool_]]:
    """Return one pattern over a disc of 4 mrad in the middle; both parts give signal, range and status."""
    t = 2.0 * np.pi * (np.arange(POINTS) + 0.5) / POINTS
    theta, phi = 6e-3 * np.sin(3 * t)[None], 6e-3 * np.sin(2 * t)[None]
    on = np.hypot(theta, phi) < 4e-3
    rng = np.random.default_rng(3)

    def both(name: str, otherwise: float) -> Any:
        return np.where(on, disc.get(name, otherwise), ground.get(name, otherwise))

    signal, distance = both("signal", 1e5), both("range", 10.0)
    samples = PatternSamples(
        time=50e-6 * np.arange(POINTS)[None],
        theta=theta,
        phi=phi,
        signal=signal * (1.0 + 0.05 * rng.standard_normal(signal.shape)),
        sigma_signal=0.05 * signal,
        range=distance + 5e-3 * rng.standard_normal(signal.shape),
        sigma_range=np.full(signal.shape, 5e-3),
        status=both("status", Status.VALID).astype(np.uint8),
    )
    return samples, on


@pytest.mark.parametrize(
    ("kind", "disc", "ground"),
    [
        ("black", {"signal": 1e4}, {}),
        ("black", {"signal": np.nan, "range": np.nan, "status": Status.BELOW_THRESHOLD}, {}),
        ("white", {"signal": 1e6}, {}),
        ("white", {}, {"signal": np.nan, "range": np.nan, "status": Status.BELOW_THRESHOLD}),
        ("retro", {"signal": 1e7}, {}),
        ("retro", {"signal": 2e6, "range": np.nan, "status": Status.SATURATED}, {}),
        ("retro", {"signal": 2e6, "range": np.nan, "status": Status.BAD_AMPLITUDE}, {}),
        ("retro", {"signal": 0.0, "range": np.nan, "status": Status.SATURATED}, {}),
        ("retro", {"signal": 0.0, "range": np.nan, "status": Status.BAD_AMPLITUDE}, {}),
        ("raised", {"range": 9.9}, {}),
        ("raised", {}, {"range": np.nan, "status": Status.BELOW_THRESHOLD}),
        ("raised", {}, {"range": 30.0}),
        ("hole", {"range": 10.2}, {}),
        ("hole", {"range": np.nan, "status": Status.BELOW_THRESHOLD}, {}),
        ("hole", {"range": 30.0}, {}),
    ],
)
def test_every_kind_of_target_is_told(kind: str, disc: dict[str, Any], ground: dict[str, Any]) -> None:
    samples, on = pattern(disc, ground)
    found = target_response(samples, TargetKind(kind), GATE)
    assert found.clear.all()
    np.testing.assert_array_equal(found.hit, on)
    assert found.fraction[0] == pytest.approx(on.mean())


@pytest.mark.parametrize("status", [Status.SATURATED, Status.BAD_AMPLITUDE])
def test_what_is_clipped_is_brighter_than_all_that_was_measured(status: Status) -> None:
    """Claim: of a retro-reflector, half of it just not clipped and half without a signal, both halves hit, whatever the
    ground's light; the second is told as clipped, by its pattern's own light. A saturated signal is no measure.
    """
    samples, on = pattern({}, {})
    off = samples.theta - samples.theta[on].mean()
    lost = on & (off > 0.0)
    for ground in (1e4, 3e5):
        samples.signal[:] = np.where(on, 9e5, ground) * (1.0 + 0.02 * np.sin(np.arange(POINTS)))
        samples.status[lost], samples.range[lost] = status, np.nan
        for signal in (0.0, 4e5) if status is Status.SATURATED else (0.0,):
            samples.signal[lost] = signal
            found = target_response(samples, TargetKind.RETRO, GATE)
            np.testing.assert_array_equal(found.hit, on)
            np.testing.assert_array_equal(found.clipped, lost)
            known = samples.signal[~lost]
            np.testing.assert_allclose(found.value[lost], known.max() + 0.75 * (known.max() - known.min()))
            np.testing.assert_array_equal(found.value[~lost], known)
    assert not target_response(samples, TargetKind.WHITE, GATE).clipped.any()


def test_light_that_is_measured_is_not_clipped() -> None:
    """Claim: light of a retro-reflector that is brighter than any surface tells how much of the spot is on it."""
    samples, _ = pattern({"signal": 2e6, "range": np.nan, "status": Status.BAD_AMPLITUDE}, {})
    found = target_response(samples, TargetKind.RETRO, GATE)
    assert not found.clipped.any()
    np.testing.assert_array_equal(found.value, samples.signal)


@pytest.mark.parametrize("kind", list(TargetKind))
def test_noise_is_no_target(kind: TargetKind) -> None:
    """A plain wall, 500 patterns: noise makes two clear levels in none of them."""
    rng = np.random.default_rng(5)
    shape = (500, POINTS)
    samples = PatternSamples(
        *(np.zeros(shape) for _ in range(3)),
        signal=1e5 + 5e3 * rng.standard_normal(shape),
        sigma_signal=np.full(shape, 5e3),
        range=10.0 + 5e-3 * rng.standard_normal(shape),
        sigma_range=np.full(shape, 5e-3),
        status=np.zeros(shape, np.uint8),
    )
    found = target_response(samples, kind, GATE)
    assert not found.clear.any()
    assert not found.hit.any()


def test_few_glints_are_no_target() -> None:
    """Three voxels a hundred times as bright make no level of their own."""
    value = 1.0 + 0.01 * np.random.default_rng(7).standard_normal((1, POINTS))
    value[0, [5, 40, 41]] = 100.0
    assert not two_levels(value, np.ones_like(value, dtype=bool))[3].any()


def test_what_is_outside_of_the_gate_does_not_count() -> None:
    """A dark pole in front of a black disc's board: its voxels are neither target nor ground."""
    samples, on = pattern({"signal": 1e4}, {})
    pole = np.abs(samples.theta - 4.5e-3) < 0.5e-3
    samples.signal[pole], samples.range[pole] = 1e4, 7.0
    found = target_response(samples, TargetKind.BLACK, GATE)
    np.testing.assert_array_equal(found.hit, on & ~pole)
    assert not found.used[pole].any()


@pytest.mark.parametrize(("kind", "disc"), [("raised", {"range": 9.9}), ("hole", {"range": 10.2})])
def test_what_stands_before_the_gate_does_not_count_by_its_range(kind: str, disc: dict[str, Any]) -> None:
    """A pole before a raised disc, or a hole: unlike what is behind the gate it tells nothing of the target."""
    samples, on = pattern(disc, {})
    pole = np.abs(samples.theta - 4.5e-3) < 0.5e-3
    samples.range[pole] = 7.0
    found = target_response(samples, TargetKind(kind), GATE)
    np.testing.assert_array_equal(found.hit, on & ~pole)
    assert not found.used[pole].any()
    assert found.fraction[0] == pytest.approx((on & ~pole).sum() / (~pole).sum())


@pytest.mark.parametrize("kind", [TargetKind.BLACK, TargetKind.WHITE])
def test_what_is_too_faint_tells_one_number(kind: TargetKind) -> None:
    """Claim: voxels without a peak have the mean of light that is even from 0 to √12 of their σ, and all of them tell
    together what one of them would: Σ 1/σ² is 1/σ² of one, however many they are; none is surer than all with a peak.
    """
    nothing = {"signal": 0.0, "range": np.nan, "status": Status.BELOW_THRESHOLD}
    some: dict[str, Any] = {}
    samples, on = pattern(*((nothing, some) if kind is TargetKind.BLACK else (some, nothing)))
    faint = on if kind is TargetKind.BLACK else ~on
    assert 10 < faint.sum() < 120
    samples.sigma_signal[faint] = 3e3
    # A range may be known without light: what is left of an echo beside its baseline may be less than nothing.
    without = np.flatnonzero(faint)[:3]
    samples.status[0, without], samples.range[0, without] = Status.VALID, 10.0
    samples.signal[0, without] = [-40.0, 0.0, -2e3]
    found = target_response(samples, kind, GATE)
    even = np.linspace(0.0, np.sqrt(12.0) * 3e3, 2001)
    np.testing.assert_allclose(found.value[faint], even.mean())
    np.testing.assert_allclose((found.sigma[faint] ** -2.0).sum(), 3e3**-2, rtol=1e-12)
    np.testing.assert_array_equal(found.value[~faint], samples.signal[~faint])
    np.testing.assert_array_equal(found.sigma[~faint], samples.sigma_signal[~faint])
    assert found.used.all()
    np.testing.assert_array_equal(found.hit, on)
    samples.sigma_signal[~faint] = np.linspace(1e4, 8e4, (~faint).sum())
    np.testing.assert_array_equal(target_response(samples, kind, GATE).sigma[faint], 8e4)


def test_nothing_measured_is_not_clear() -> None:
    samples, _ = pattern({"status": Status.OUT_OF_GATE}, {"status": Status.OUT_OF_GATE})
    found = target_response(samples, TargetKind.BLACK, GATE)
    assert not found.clear.any()
    assert not found.used.any()


def test_a_known_delay_is_corrected_to_a_microradian() -> None:
    """Samples read 10 µs early of a pattern of 6 mrad; the ends have one-sided differences only."""
    t = (np.arange(POINTS) + 0.5) * 50e-6
    samples, _ = pattern({}, {})

    def angle(time: NDArray[np.float64]) -> NDArray[np.float64]:
        return 6e-3 * np.sin(2.0 * np.pi * 3.0 * time / 6.4e-3)[None]

    early = dataclasses.replace(samples, time=t[None], theta=angle(t - 10e-6), phi=angle(t - 10e-6))
    assert np.abs(early.theta - angle(t)).max() > 150e-6
    np.testing.assert_allclose(
        angles_later(early.time, early.angles, 10e-6)[:, 0, 2:-2], angle(t)[:, 2:-2], atol=2e-6
    )


def plain_levels(values: NDArray[np.float64]) -> tuple[float, float, float, bool]:
    """Return threshold, levels and whether they are two, of one pattern's values that count, by trying all splits."""
    order = np.sort(values)
    if len(order) < 8:
        return 0.0, 0.0, 0.0, False
    order = np.clip(order, order[3], order[-4])
    splits = range(4, len(order) - 3)
    split = min(splits, key=lambda k: k * order[:k].var() + (len(order) - k) * order[k:].var())
    first, second = np.median(order[:split]), np.median(order[split:])
    larger = order[:split] - first if 2 * split >= len(order) else order[split:] - second
    clear = second - first > 5.0 * 1.4826 * np.median(np.abs(larger)) and second > first
    return 0.5 * (first + second), float(first), float(second), bool(clear)


def test_levels_are_those_of_the_best_split() -> None:
    """Claim: of all splits that leave four values in each part that of the least scatter within both, its medians, and
    whether they are five median deviations of the larger part apart; 400 patterns of any counts, parts and noise."""
    rng, rows, points = np.random.default_rng(21), 400, 40
    on = rng.random((rows, points)) < rng.uniform(0.05, 0.95, (rows, 1))
    value = 1.0 + 0.2 * rng.standard_normal((rows, points)) + on * 10.0 ** rng.uniform(-1.0, 1.0, (rows, 1))
    value += 30.0 * (rng.random((rows, points)) < 0.03)
    used = rng.random((rows, points)) < rng.uniform(0.1, 1.0, (rows, 1))
    used[:20] = np.arange(points) < np.arange(20)[:, None]
    threshold, low, high, clear = two_levels(value, used)
    wanted = [plain_levels(row[some]) for row, some in zip(value, used, strict=True)]
    enough = used.sum(axis=1) >= 8
    np.testing.assert_array_equal(clear, [one[3] for one in wanted])
    for found, number in ((threshold, 0), (low, 1), (high, 2)):
        np.testing.assert_allclose(
            found[enough], np.array([one[number] for one in wanted])[enough], rtol=1e-12
        )
    assert 0.3 < clear.mean() < 0.9


@pytest.mark.parametrize("kind", [TargetKind.BLACK, TargetKind.WHITE])
def test_what_is_three_times_the_levels_away_is_a_glint(kind: TargetKind) -> None:
    """Claim: of the two values 2.9 and 3.1 times the levels' distance from their middle one counts, as what it is;
    ranges at the very ends of the gate count, those beyond do not."""
    samples, on = pattern({"signal": 1e4 if kind is TargetKind.BLACK else 1e6}, {})
    found = target_response(samples, kind, GATE)
    apart = abs(found.target[0] - found.ground[0])
    off = np.flatnonzero(~on[0])[:6]
    samples.signal[0, off[:2]] = found.threshold[0] + apart * np.array([2.9, 3.1])
    samples.range[0, off[2:]] = [9.0, 11.0, 9.0 - 1e-9, 11.0 + 1e-9]
    after = target_response(samples, kind, GATE)
    assert after.used[0, off].tolist() == [True, False, True, True, False, False]
    assert bool(after.hit[0, off[0]]) is (kind is TargetKind.WHITE)


@pytest.mark.parametrize("kind", ["raised", "hole"])
@pytest.mark.parametrize(("range_m", "counts"), [(9.2, False), (9.75, True), (10.25, True), (10.8, False)])
def test_ranges_far_from_both_levels_count_neither_way(kind: str, range_m: float, counts: bool) -> None:
    """Three glints before levels of 9.9 m and 10 m or behind: three times their distance off lie 9.65 m and 10.25 m."""
    nearer, farther = {"range": 9.9}, {"range": 10.0}
    samples, on = pattern(*((nearer, farther) if kind == "raised" else (farther, nearer)))
    odd = np.flatnonzero(~on[0])[[1, 20, 50]]
    samples.range[0, odd] = range_m - 0.01 * (range_m > 10.0)
    assert np.all(target_response(samples, TargetKind(kind), GATE).used[0, odd] == counts)
