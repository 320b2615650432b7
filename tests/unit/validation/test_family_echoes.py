"""The ledger's experiments on ranges by pulses, on instruments that answer by a law."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from drawn import bars, line
from made_benches import Benches, drawn, quick_task, signs

from scanner_sim.validation.reproduce.family import echoes
from scanner_sim.validation.reproduce.item import Verdict

TASK = quick_task()


UNPRINTED, DIFFERS, AGREES = Verdict.UNPRINTED, Verdict.DIFFERS, Verdict.AGREES


LIGHT = 299_792_458.0


def pulsed(shots: Any, R: float, mean: float, sigma: float, snr: float = 1.0, Y: float = 1.0) -> Any:
    """Return layers of time of flight alone, with errors of a mean and a standard deviation."""
    truth = np.full(shots.shot.size, R)
    # With n − 1 in the denominator a scatter of ±1 has √(n/(n − 1)).
    scale = math.sqrt(1.0 - 1.0 / truth.size)
    return {
        "truth.range_m": truth,
        "range_m": truth + mean + sigma * scale * signs(shots),
        "tof.snr_detection": np.full(truth.size, snr),
        "Y": np.full(truth.size, Y),
    }


def test_shots_of_two_rangefinders_are_those_of_time_of_flight() -> None:
    """Claim: where both range, the prefix tof. is taken; what has no range does not count."""
    error = np.array([1.0, 3.0, math.nan, 2.0])
    layers = {"truth.range_m": np.full(4, 10.0), "range_m": np.full(4, 99.0), "tof.range_m": 10.0 + error}
    layers |= {
        "Y": np.zeros(4),
        "tof.Y": np.full(4, 7.0),
        "tof.snr_detection": np.array([1.0, 2.0, 3.0, 90.0]),
    }
    made = echoes._Shots(layers)
    assert (made.mean, made.sigma, made.count, made.snr, made.signal) == pytest.approx(
        (2.0, 1.0, 3, 2.5, 7.0)
    )
    assert made.mean_error == pytest.approx(1.0 / math.sqrt(3.0))
    assert made.sigma_share == pytest.approx(0.5)


@pytest.mark.parametrize(("weakest", "verdict"), [(9.05, UNPRINTED), (8.95, DIFFERS)])
def test_walk_is_half_of_what_means_differ_by(
    monkeypatch: pytest.MonkeyPatch, weakest: float, verdict: Verdict
) -> None:
    """Claim: of means of 1, −2, 0.5 and 3 mm half the difference of the ends is 2.5 mm, with half of the error of a
    difference; heights must differ by more than nine. Plates at 50 m, as large as the field and square to it."""
    means = 1e-3 * np.array([1.0, -2.0, 0.5, 3.0])
    sigmas = 1e-3 * np.array([9.0, 3.2, 9.0, 6.4])

    def law(made: Any, shots: Any) -> Any:
        assert made.rest["processing"] == {"pulse": {"timing": "constant_fraction"}}
        assert made.rest["ranging"] == "tof"
        snr = 50.0 if made.step == 3 else 50.0 / weakest
        return pulsed(shots, made.distance, means[made.step], sigmas[made.step], snr)

    benches = Benches(monkeypatch, echoes, law)
    found = echoes.walk(TASK, "pulsed_scanner")
    # 16² shots: a standard error of a 16th of σ.
    assert (found.finding.value, found.finding.error) == pytest.approx((2.5, 0.5 * math.hypot(0.2, 0.4)))
    grey = [made.reflectance for made in benches.asked]
    assert grey == pytest.approx([0.09 * 10.0 ** (step / 3.0) for step in range(4)])
    assert found.rows[0].verdict is verdict
    (width, height), turn = benches.asked[0].objects[0]["size"], benches.asked[0].objects[0]["rotation"]
    assert benches.asked[0].distance == 50.0
    assert turn == [{"axis": "y", "angle": 0.0}]
    assert height == pytest.approx(2.4 * math.tan(0.01) * 50.0 + 0.2)
    assert width == pytest.approx(height + 0.5)
    assert np.abs(benches.shots[0].theta).max() == pytest.approx(0.01)
    assert benches.asked[0].scanner == {"preset": "pulsed_scanner"}
    # Drawn about the middle of the largest and the least, ½ mm, over the height of the echo, three errors to each side.
    (axes,) = drawn(monkeypatch, echoes, found)
    ((_, marks, ends),) = bars(axes)
    heights = np.array([50.0 / weakest] * 3 + [50.0])
    np.testing.assert_allclose(marks, np.stack([heights, [0.5, -2.5, 0.0, 2.5]], axis=1), atol=1e-9)
    np.testing.assert_allclose(ends - marks[:, 1:], 3e3 * sigmas[:, None] / 16.0 * [-1.0, 1.0], rtol=1e-6)


@pytest.mark.parametrize(("fraction", "verdict"), [(1.01, UNPRINTED), (0.99, DIFFERS)])
def test_noise_of_an_edge_is_found_at_ten_times_the_noise(
    monkeypatch: pytest.MonkeyPatch, fraction: float, verdict: Verdict
) -> None:
    """Claim: of a plate of 0.9 whose echo is 36 times the noise one of 0.25 has ten; σ errs by σ/√(2 n). A Gaussian of
    3 ns is steepest at its σ, where it falls by e^(−1/2)/σ: 31.5 mm; a constant fraction must err by more."""

    def law(made: Any, shots: Any) -> Any:
        lidar, pulse = made.scanner["lidar"], made.rest["processing"]["pulse"]
        assert (lidar["pulse"]["width"], lidar["photodiode"]["bandwidth"]) == (3e-9, 1e9)
        assert lidar["digitiser"]["rate"] == 4e9
        assert lidar["photodiode"]["noise"] == {"shot": False}
        assert made.scanner["laser"] == {"speckle": False}
        assert made.distance == 300.0
        wide = 0.03 * (fraction if pulse["timing"] == "constant_fraction" else 1.0)
        return pulsed(shots, 300.0, 0.1, wide, 40.0 * made.reflectance)

    benches = Benches(monkeypatch, echoes, law)
    found = echoes.edge_noise(TASK, "pulsed_scanner")
    assert [made.reflectance for made in benches.asked] == pytest.approx([0.9, 0.25, 0.25])
    pulses = [made.rest["processing"]["pulse"] for made in benches.asked]
    assert pulses[0] == pulses[1] == {"timing": "leading_edge", "walk_correction": False}
    assert pulses[2] == {"timing": "constant_fraction"}
    assert [made.step for made in benches.asked] == [0, 1, 2]
    assert (found.finding.value, found.finding.error) == pytest.approx((30.0, 30.0 / math.sqrt(2.0 * 399.0)))
    sigma = 3e-9 / math.sqrt(8.0 * math.log(2.0))
    times = np.linspace(0.5, 1.5, 1001) * sigma
    steepest = np.abs(np.gradient(np.exp(-0.5 * (times / sigma) ** 2), times)).max()
    assert found.expected.startswith(f"{1e3 * 0.5 * LIGHT / steepest / 10.0:.0f} mm")
    assert found.rows[0].verdict is verdict
    assert found.rows[0].found == f"{30.0 * fraction:.0f} mm"
    # Drawn are the errors of the edge about their mean [mm], here as many of −30 as of 30.
    (axes,) = drawn(monkeypatch, echoes, found)
    heights = {patch.get_x() + 0.5 * patch.get_width(): patch.get_height() for patch in axes.patches}  # type: ignore[attr-defined]
    filled = {middle: height for middle, height in heights.items() if height}
    assert list(filled) == pytest.approx([-30.0, 30.0], rel=0.05)
    assert list(filled.values()) == [200, 200]


def test_reflectance_is_judged_where_it_biases_most(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of differences of 2 mm at 3 m and of 5 mm at 53 m the latter, with the errors of its two ends."""
    means = 1e-3 * np.array([[0.0, 1.0, 2.0, 0.5], [9.0, 5.0, 4.0, 8.0]])
    sigmas = 1e-3 * np.array([[1.0, 1.0, 1.0, 1.0], [3.2, 1.0, 6.4, 1.0]])

    def law(made: Any, shots: Any) -> Any:
        row, column = [3.0, 53.0].index(made.distance), [0.05, 0.15, 0.5, 0.9].index(made.reflectance)
        assert made.step == 4 * row + column
        return pulsed(shots, made.distance, means[row, column], sigmas[row, column])

    Benches(monkeypatch, echoes, law)
    made = echoes.reflectance_bias(TASK, "pulsed_scanner")
    assert (made.finding.value, made.finding.error) == pytest.approx((5.0, math.hypot(0.2, 0.4)))
    # Drawn is each mean less that of its four, with three standard errors.
    (axes,) = drawn(monkeypatch, echoes, made)
    for (name, marks, ends), mean, sigma, distance in zip(bars(axes), means, sigmas, (3, 53), strict=True):
        assert name == f"{distance} m"
        expected = np.stack([[0.05, 0.15, 0.5, 0.9], 1e3 * (mean - mean.mean())], axis=1)
        np.testing.assert_allclose(marks, expected, atol=1e-9)
        np.testing.assert_allclose(ends - marks[:, 1:], 3e3 * sigma[:, None] / 16.0 * [-1.0, 1.0], rtol=1e-6)


@pytest.mark.parametrize(
    ("shares", "value", "error", "verdict"),
    [
        # Between 30° and 50°: v + 3 e is 45° for a = 7/44.
        ([0.0, 0.155, 0.95, 0.96, 0.97, 0.98], 30.0 + 6.9 / 0.795, 1.69 / 0.795, UNPRINTED),
        ([0.0, 0.163, 0.95, 0.96, 0.97, 0.98], 30.0 + 6.74 / 0.787, 1.674 / 0.787, DIFFERS),
        # Between 60° and 70°: v − 3 e is 60° for a = 2/7.
        ([0.0, 0.05, 0.1, 0.29, 0.95, 0.96], 60.0 + 2.1 / 0.66, 0.71 / 0.66, UNPRINTED),
        ([0.0, 0.05, 0.1, 0.28, 0.95, 0.96], 60.0 + 2.2 / 0.67, 0.72 / 0.67, DIFFERS),
    ],
)
def test_incidence_rules_where_it_has_half_of_the_variance(
    monkeypatch: pytest.MonkeyPatch, shares: list[float], value: float, error: float, verdict: Verdict
) -> None:
    """Claim: a share s of the variance makes σ larger by 1/√(1 − s), and errs by (1 − s) 2/side of 20² shots; where it
    crosses a half, between two tried angles, the larger error over the slope is that of the angle. Plates are turned
    about the vertical, and as much wider; the second case, at 100 m, has a clock without jitter, the first crosses at
    55°."""
    tilts = []

    def law(made: Any, shots: Any) -> Any:
        own = "lidar" in made.scanner
        assert made.distance == (100.0 if own else 20.0)
        if own:
            assert made.scanner["lidar"] == {"digitiser": {"jitter": 0.0}}
        assert made.reflectance == 0.5
        (turn,) = made.objects[0]["rotation"]
        assert turn["axis"] == "y"
        width, height = made.objects[0]["size"]
        assert width == pytest.approx(height / math.cos(turn["angle"]) + 0.5)
        tilts.append(math.degrees(turn["angle"]))
        share = (shares if own else [0.0, 0.2, 0.4, 0.6, 0.7, 0.8])[made.step % 6]
        return pulsed(shots, made.distance, 0.0, 0.01 / math.sqrt(1.0 - share))

    benches = Benches(monkeypatch, echoes, law)
    made = echoes.incidence(TASK, "pulsed_scanner")
    assert tilts == pytest.approx(2 * [0.0, 30.0, 50.0, 60.0, 70.0, 80.0])
    assert [one.step for one in benches.asked] == list(range(12))
    assert (made.finding.value, made.finding.error) == pytest.approx((55.0, 0.06 / 0.02))
    assert made.rows[0].found == echoes.Finding(value, error).text("°")
    assert made.rows[0].verdict is verdict
    # Drawn are σ [mm] and the share of the variance of both cases, with three standard errors.
    left, right = drawn(monkeypatch, echoes, made)
    for number, (_, marks, ends) in enumerate(bars(right)):
        share = np.array([[0.0, 0.2, 0.4, 0.6, 0.7, 0.8], shares][number])
        np.testing.assert_allclose(
            line(left, number), np.stack([tilts[:6], 10.0 / np.sqrt(1.0 - share)], axis=1)
        )
        np.testing.assert_allclose(marks, np.stack([tilts[:6], share], axis=1), atol=1e-9)
        np.testing.assert_allclose(ends - marks[:, 1:], 0.3 * (1.0 - share)[:, None] * [-1.0, 1.0], rtol=1e-6)


@pytest.mark.parametrize(
    ("power", "expected"),
    [
        (-1.09, [AGREES, UNPRINTED]),
        (-1.11, [AGREES, DIFFERS]),
        (-0.01, [AGREES, UNPRINTED]),
        (0.01, [DIFFERS, DIFFERS]),
    ],
)
def test_intensity_is_judged_by_the_ratio_of_its_ends(
    monkeypatch: pytest.MonkeyPatch, power: float, expected: list[Verdict]
) -> None:
    """Claim: the last of three ranges of equal light over the first, here 1.3, with the error of a mean of three ratios
    of 24² shots each; the exponent is that of the two weakest, which must lie between −1.1 and 0."""

    def law(made: Any, shots: Any) -> Any:
        signal = 1e9 * made.reflectance / made.distance**2
        factor = {40.0: 1.0, 80.0: 5.0, 160.0: 1.3}[made.distance]
        return pulsed(shots, made.distance, 0.0, factor * signal**power, Y=signal)

    benches = Benches(monkeypatch, echoes, law)
    made = echoes.intensity(TASK, "pulsed_scanner")
    assert (made.finding.value, made.finding.error) == pytest.approx(
        (1.3, 1.3 * math.sqrt(2.0 / 3.0) / math.sqrt(2.0 * 24**2))
    )
    assert [one.verdict for one in made.rows] == expected
    assert made.rows[1].found == f"{power:.2f}"
    # No two have one noise.
    assert [one.step for one in benches.asked] == list(range(9))
    grey = np.array([one.reflectance for one in benches.asked]).reshape(3, 3)
    np.testing.assert_allclose(grey[:, 0], [0.0025, 0.05 * math.sqrt(0.05), 0.05])
    np.testing.assert_allclose(grey / grey[:, :1], np.tile([1.0, 4.0, 16.0], (3, 1)))
    # The picture has σ [mm] over the signal, a curve for each range.
    (axes,) = drawn(monkeypatch, echoes, made)
    for column, ((_, marks, _), factor) in enumerate(zip(bars(axes), (1.0, 5.0, 1.3), strict=True)):
        signal = 1e9 * grey[:, column] / (40.0 * 2.0**column) ** 2
        np.testing.assert_allclose(marks, np.stack([signal, 1e3 * factor * signal**power], axis=1), rtol=1e-4)
