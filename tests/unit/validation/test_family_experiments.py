"""The ledger's experiments on ranges that are made by hand: which of them are asked for, and what is found in them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_benches import Array, Benches, quick_task, signs
from scipy.stats import norm

from scanner_sim.config import load_scanner
from scanner_sim.validation.reproduce.family import crossing, echoes, edges, spots, tiles
from scanner_sim.validation.reproduce.item import Task, Verdict

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


def test_reflectance_is_judged_where_it_biases_most(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of differences of 2 mm at 3 m and of 5 mm at 53 m the latter, with the errors of its two ends."""
    means = 1e-3 * np.array([[0.0, 1.0, 2.0, 0.5], [9.0, 5.0, 4.0, 8.0]])
    sigmas = 1e-3 * np.array([[1.0, 1.0, 1.0, 1.0], [3.2, 1.0, 6.4, 1.0]])

    def law(made: Any, shots: Any) -> Any:
        row, column = [3.0, 53.0].index(made.distance), [0.05, 0.15, 0.5, 0.9].index(made.reflectance)
        assert made.step == 4 * row + column
        return pulsed(shots, made.distance, means[row, column], sigmas[row, column])

    Benches(monkeypatch, echoes, law)
    found = echoes.reflectance_bias(TASK, "pulsed_scanner").finding
    assert (found.value, found.error) == pytest.approx((5.0, math.hypot(0.2, 0.4)))


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
    grey = np.array([one.reflectance for one in benches.asked]).reshape(3, 3)
    np.testing.assert_allclose(grey[:, 0], [0.0025, 0.05 * math.sqrt(0.05), 0.05])
    np.testing.assert_allclose(grey / grey[:, :1], np.tile([1.0, 4.0, 16.0], (3, 1)))


def triangulated(shots: Any, R: float, sigma: float, way: str = "") -> dict[str, Array]:
    truth = np.full(shots.shot.size, R)
    return {"truth.range_m": truth, f"{way}range_m": truth + sigma * signs(shots)}


def test_the_error_at_ten_metres_is_that_of_the_last_plate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: 16² voxels tell σ to σ/√512; shots lie over ±0.05 rad and are 0.1 s apart; close by the least counts."""
    benches = Benches(
        monkeypatch, spots, lambda made, shots: triangulated(shots, made.distance, 4e-5 * made.distance**2)
    )
    found = spots.at_ten(TASK, "nrc_2000").finding
    assert (found.value, found.error) == pytest.approx((4.0, 4.0 / math.sqrt(512.0)))
    assert [made.distance for made in benches.asked] == pytest.approx([2.0, 6.0, 10.0])
    for shots in benches.shots:
        np.testing.assert_allclose(shots.time, 0.1 * np.arange(256))
        assert (shots.theta.min(), shots.phi.max()) == pytest.approx((-0.05, 0.05))
    Benches(
        monkeypatch,
        spots,
        lambda made, shots: triangulated(shots, made.distance, 1e-5 + abs(made.distance - 0.55) * 1e-3),
    )
    found = spots.close_depth(TASK, "close_range_scanner").finding
    assert (found.value, found.error) == pytest.approx((10.0, 10.0 / math.sqrt(512.0)))


@pytest.mark.parametrize(
    ("five", "eight", "verdict"),
    [(1.2, 1.1, AGREES), (1.21, 1.1, DIFFERS), (1.19, 0.97, AGREES), (1.19, 0.95, DIFFERS)],
)
def test_both_ways_meet_where_their_errors_are_alike(
    monkeypatch: pytest.MonkeyPatch, five: float, eight: float, verdict: Verdict
) -> None:
    """Claim: 1e-4 R² and 4.9 mm are alike at 7 m. As good is less than 1.2 up to 5 m, worse more than 1 from 7.5 m."""

    def law(made: Any, shots: Any) -> Any:
        wanted = {"triangulation": "nrc_2000", "tof": "pulsed_scanner"}[made.rest["ranging"]]
        assert made.scanner == {"preset": wanted}
        sigma = 1e-4 * made.distance**2 if wanted == "nrc_2000" else 4.9e-3
        return triangulated(shots, made.distance, sigma)

    Benches(monkeypatch, spots, law)
    found = spots.meeting(TASK, "nrc_2000", "pulsed_scanner")
    assert found.finding.value == pytest.approx(7.0, rel=1e-9)
    # One over the slope, 2, of the line through four of six points a fifth of ln 10 apart, with 1/16 for each.
    x = np.log(np.geomspace(2.0, 20.0, 6))
    near = x[1:5] - x[1:5].mean()
    spread = math.sqrt(0.25 + (math.log(7.0) - x[1:5].mean()) ** 2 / float(near @ near))
    assert found.finding.error == pytest.approx(7.0 * spread / 16.0 / 2.0)
    # A ratio that is drawn through what is asked for at 5 and 7.5 m.
    distances = np.geomspace(2.0, 20.0, 6)
    told = np.array([0.5, 0.8, five, eight, 2.0, 3.0])

    def other(made: Any, shots: Any) -> Any:
        step = int(np.argmin(np.abs(distances - made.distance)))
        return triangulated(
            shots, made.distance, 1e-3 * (told[step] if made.rest["ranging"] != "tof" else 1.0)
        )

    Benches(monkeypatch, spots, other)
    row = spots.meeting(TASK, "nrc_2000", "pulsed_scanner").rows[0]
    ratio = np.interp([2.5, 5.0, 7.5, 10.0], distances, told)
    assert row.found == ", ".join(f"{one:.2f}" for one in ratio)
    expected = AGREES if ratio[1] < 1.2 and ratio[2] > 1.0 else DIFFERS
    assert row.verdict is expected is verdict


@pytest.mark.parametrize(
    ("power", "verdict"), [(-1.0, AGREES), (-1.155, AGREES), (-1.1557, DIFFERS), (-0.8443, DIFFERS)]
)
def test_speckle_is_held_against_the_published_limit(
    monkeypatch: pytest.MonkeyPatch, power: float, verdict: Verdict
) -> None:
    """Claim: C λ R²/(π D_ap d) is 2.375 mm at 5 m for 25 mm and 0.2 m, and goes as 1/D_ap; σ of 0.7 of it is found so.
    Three standard errors of a slope through three apertures, 0.1353, are granted, and 0.02. Only speckle is left on."""
    scanner = load_scanner("nrc_2000")

    def law(made: Any, shots: Any) -> Any:
        own = made.scanner
        assert own["laser"] == {"speckle": True}
        assert own["receiver"]["aberration"] == 0.0
        assert own["position_sensor"]["diffusion"] == 40e-6
        assert not any(own["position_sensor"]["noise"].values())
        assert made.rest["processing"] == {"peak": "maximum_likelihood", "speckle_contrast": 1.0}
        assert made.objects[0]["material"] == {"reflectance": 0.5, "depolarisation": 0.0}
        aperture = own["receiver"]["aperture"]
        limit = scanner.laser.wavelength * 5.0**2 / (math.pi * 25e-3 * scanner.receiver.baseline)
        return triangulated(shots, 5.0, 0.7 * limit * (aperture / 25e-3) ** power)

    benches = Benches(monkeypatch, spots, law)
    monkeypatch.setattr(
        spots, "images", lambda *given: [math.sqrt(59.0 / 60.0) * (-1.0) ** n for n in range(60)]
    )
    monkeypatch.setattr(spots, "centroid", lambda image: (2e-6 * image, 0.0))
    found = spots.speckle_limit(TASK, "nrc_2000")
    assert [made.scanner["receiver"]["aperture"] for made in benches.asked] == pytest.approx(
        [12.5e-3, 25e-3, 50e-3]
    )
    share = 1.0 / math.sqrt(2.0 * 16**2)
    if power == -1.0:
        assert (found.finding.value, found.finding.error) == pytest.approx(
            (0.7, 0.7 * share / math.sqrt(3.0))
        )
    slack = 3.0 * share / (math.log(2.0) * math.sqrt(2.0))
    assert found.rows[0].found == f"{power:.3f} ± {slack:.3f}"
    assert found.rows[0].verdict is verdict
    # Centroids of a Gaussian spot scatter by 1/√2 of the published limit; waves of σ = 2 µm by π σ/(λN), of 6 µm.
    waves = 2.0 * math.pi / 6.0
    assert found.expected == (
        f"{math.sqrt(0.5):.3f} for a Gaussian spot and a round lens; {waves:.2f} ± "
        f"{3.0 * waves / math.sqrt(120.0):.2f} by random waves"
    )


def test_the_least_share_of_speckle_is_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: without speckle σ is 0.3, 0.5 and 0.4 of that with it: the least share is 1 − 0.25, its error that of a
    ratio of two variances of 20² shots."""

    def law(made: Any, shots: Any) -> Any:
        row = [2.0, 6.0, 10.0].index(made.distance)
        on = made.scanner["laser"]["speckle"]
        assert made.step == 2 * row + on
        np.testing.assert_allclose(np.diff(shots.time), 0.1)
        return triangulated(shots, made.distance, 1e-3 * (1.0 if on else (0.3, 0.5, 0.4)[row]))

    Benches(monkeypatch, spots, law)
    found = spots.speckle_share(TASK, "nrc_2000").finding
    assert (found.value, found.error) == pytest.approx((0.75, 0.25 * 2.0 / 20.0))


def test_a_tilt_is_judged_in_parts_of_the_measuring_range(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: what the range changes by from no tilt to ±30° about either axis, in per cent of the measuring range."""
    scanner = load_scanner("nrc_2000")
    near, far = scanner.nearest_range, min(scanner.farthest_range, 10.0)
    seen = []

    def law(made: Any, shots: Any) -> Any:
        assert (shots.theta.tolist(), shots.phi.tolist()) == ([0.0], [0.0])
        assert made.distance == pytest.approx(0.5 * (near + far))
        assert made.scanner["mirrors"]["jitter"] == 0.0
        assert not any(made.scanner["position_sensor"]["noise"].values())
        assert made.rest["processing"] == {"peak": "maximum_likelihood"}
        (turn,) = made.objects[0]["rotation"]
        degrees = math.degrees(turn["angle"])
        seen.append((turn["axis"], round(degrees)))
        error = 2e-3 + (1e-4 * degrees if turn["axis"] == "x" else -2e-4 * abs(degrees))
        return {"truth.range_m": np.array([made.distance]), "range_m": np.array([made.distance + error])}

    Benches(monkeypatch, spots, law)
    found = spots.tilt(TASK, "nrc_2000").finding
    assert seen == [(axis, tilt) for axis in "xy" for tilt in (-30, -15, -5, 0, 5, 15, 30)]
    assert (found.value, found.error) == pytest.approx((100.0 * 6e-3 / (far - near), 0.0))


class Edges:
    """Views of edges whose line spread is known: wider by turns, block of rows by block."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, wider: Mapping[int, float]) -> None:
        self.views: list[Any] = []
        self.objects: list[Any] = []

        def layers(view: Any, task: Any, objects: Any, instrument: str, step: int) -> Any:
            self.views.append(view)
            self.objects.append(objects)
            laser = load_scanner(instrument).laser
            way = (
                (view.distance - laser.waist_distance) * laser.wavelength / (math.pi * laser.waist_radius**2)
            )
            # The light of a Gaussian beam of radius w has σ = w/2.
            sigma = 0.5 * laser.waist_radius * math.sqrt(1.0 + way**2)
            x = (np.arange(view.columns) - view.columns // 2) * view.pitch
            block = (np.arange(view.rows) // 16 % 3 - 1) * 0.01
            own = sigma * wider.get(step, 1.0) * (1.0 + block[:, None])
            # An edge a little beside the middle, from 5 to 80 units.
            return {"Y": 5.0 + 75.0 * norm.cdf((x - 0.3 * sigma) / own)}

        monkeypatch.setattr(edges.View, "layers", layers)


@pytest.mark.parametrize(
    ("wider", "verdict"), [(1.04, UNPRINTED), (1.05, DIFFERS), (0.96, UNPRINTED), (0.95, DIFFERS)]
)
def test_edges_have_the_width_of_the_beam(
    monkeypatch: pytest.MonkeyPatch, wider: float, verdict: Verdict
) -> None:
    """Claim: full widths at half maximum, 2.3548 σ, of blocks of 16 rows whose line spreads are 0.99, 1 and 1.01 of the
    beam's: their mean, with the standard error of three. Four of these and 2 % are granted at each of the ranges."""
    made = Edges(monkeypatch, {2: wider})
    found = edges.lateral(TASK, "nrc_2000")
    laser = load_scanner("nrc_2000").laser
    distances = np.linspace(1.6, 4.0, 4)
    way = (distances - laser.waist_distance) * laser.wavelength / (math.pi * laser.waist_radius**2)
    widths = 2.0 * math.sqrt(2.0 * math.log(2.0)) * 0.5 * laser.waist_radius * np.sqrt(1.0 + way**2)
    least = np.min(widths * np.array([1.0, 1.0, wider, 1.0]))
    best = int(np.argmin(widths * np.array([1.0, 1.0, wider, 1.0])))
    factor = wider if best == 2 else 1.0
    assert found.finding.value == pytest.approx(1e3 * least, rel=1e-5)
    assert found.finding.error == pytest.approx(1e3 * 0.01 * widths[best] * factor / math.sqrt(3.0), rel=1e-4)
    assert found.rows[0].verdict is verdict
    assert found.rows[0].expected == f"{1e3 * widths.min():.3g} to {1e3 * widths.max():.3g} mm"
    assert [view.distance for view in made.views] == pytest.approx(distances)
    for view, width, objects in zip(made.views, widths, made.objects, strict=True):
        assert view.pitch == pytest.approx(width / 18.0)
        assert view.apart == pytest.approx(min(2.0 * width, 0.25 * view.distance / 48.0))
        dark, bright = objects
        assert (dark["material"], bright["material"]) == ({"reflectance": 0.05}, {"reflectance": 0.8})
        # Both meet in the middle and fill the view.
        half = 0.5 * dark["size"][0]
        assert (dark["position"][0], bright["position"][0]) == pytest.approx((-half, half))
        assert half > 0.5 * view.rows * view.apart + 5.0 * width


def test_only_diffraction_widens_a_beam(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the mean over three ranges of found over ideal widths, and its standard error; close by in µm, with the
    beam's focus among the ranges."""
    Edges(monkeypatch, {0: 1.02, 1: 1.05, 2: 1.11})
    found = edges.diffraction(TASK, "nrc_2000").finding
    assert found.value == pytest.approx(1.06, rel=1e-5)
    own = 0.01 / math.sqrt(3.0) * np.array([1.02, 1.05, 1.11])
    assert found.error == pytest.approx(math.sqrt(np.sum(own**2)) / 3.0, rel=1e-4)
    made = Edges(monkeypatch, {})
    focus = load_scanner("close_range_scanner").laser
    found = edges.close_lateral(TASK, "close_range_scanner").finding
    assert [view.distance for view in made.views] == pytest.approx(
        sorted([0.35, 0.65, 0.95, focus.waist_distance])
    )
    assert found.value == pytest.approx(1e6 * 1.17741 * focus.waist_radius, rel=1e-4)
    assert found.error == pytest.approx(1e6 * 1.17741 * focus.waist_radius * 0.01 / math.sqrt(3.0), rel=1e-3)


def test_a_view_is_a_raster_on_the_tile(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: columns lie ``pitch`` apart and rows ``apart``, about the middle voxel, at the tile's range."""
    view = tiles.View(4.0, 1e-3, 3e-3, 5, 7)
    benches = Benches(monkeypatch, tiles, lambda made, shots: {"Y": shots.theta + 100.0 * shots.phi})
    found = view.layers(TASK, [{"position": (0.0, 0.0, 4.0)}], "nrc_2000", 3)["Y"]
    assert found.shape == (5, 7)
    across, down = np.arange(-3, 4) * 1e-3 / 4.0, np.arange(-2, 3) * 3e-3 / 4.0
    np.testing.assert_allclose(found, across[None, :] + 100.0 * down[:, None], atol=1e-15)
    assert (benches.asked[0].step, benches.asked[0].scanner) == (3, {"preset": "nrc_2000"})


def test_a_crack_is_a_gap_of_its_width_with_a_floor_below() -> None:
    """Claim: two halves at 4 m whose sides are a width apart, 10 mm thick, and a floor 10 mm below their face."""
    left, right, floor = tiles._cracked(0.4e-3)
    for side, box in ((-1.0, left), (1.0, right)):
        (x, y, z), (width, height, depth) = box["position"], box["size"]
        assert y == 0.0
        assert side * x - 0.5 * width == pytest.approx(0.2e-3)
        assert (z - 0.5 * depth, z + 0.5 * depth) == pytest.approx((4.0, 4.01))
        assert (width, height) == pytest.approx((0.4, 0.4))
        assert box["material"] == {"reflectance": 0.5}
    assert floor["position"] == pytest.approx((0.0, 0.0, 4.01))
    assert floor["size"] == pytest.approx((0.2, 0.4))


def test_the_narrowest_crack_is_the_mean_of_the_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a crack that is seen as c width is at the criterion 5 where width = 5/c; three runs of different c, the
    better of signal and range counts."""
    widths = np.geomspace(0.08e-3, 0.8e-3, 4)
    steps = []

    def layers(view: Any, task: Any, objects: Any, instrument: str, step: int) -> Any:
        steps.append(step)
        assert (view.distance, view.pitch, view.apart, view.columns) == (4.0, 0.35e-3, 0.35e-3, 161)
        run, number = divmod(step, 4)
        left, right = (one["position"][0] for one in objects[:2])
        assert right - left - 0.4 == pytest.approx(widths[number])
        seen = widths[number] * (2e4, 2.5e4, 1e4)[run]
        return {"Y": seen, "range_m": 0.5 * seen} if run else {"Y": 0.5 * seen, "range_m": seen}

    monkeypatch.setattr(tiles.View, "layers", layers)
    monkeypatch.setattr(tiles, "_visibility", lambda image: image)
    found = tiles.crack(TASK, "nrc_2000").finding
    each = 5e3 / np.array([2e4, 2.5e4, 1e4])
    assert steps == list(range(12))
    assert (found.value, found.error) == pytest.approx((each.mean(), each.std(ddof=1) / math.sqrt(3.0)))


@pytest.mark.parametrize(("off", "verdict"), [(3.9, UNPRINTED), (4.1, DIFFERS)])
def test_a_dent_errs_by_its_root_mean_square(
    monkeypatch: pytest.MonkeyPatch, off: float, verdict: Verdict
) -> None:
    """Claim: of four runs about a depth of 5 mm that scatter by 0.1 mm: √(mean² + scatter²) with one over √8 of it; the
    mean may be four standard errors off, and 10 µm."""
    scatter = np.array([1.0, -1.0, 1.0, -1.0]) * 1e-4
    standard = scatter.std(ddof=1) / 2.0
    mean = off * standard + 1e-5 if off > 4.0 else off * standard
    depths = iter(5e-3 + mean + scatter)
    runs = []

    def layers(view: Any, task: Any, objects: Any, instrument: str, step: int) -> Any:
        runs.append(step)
        assert objects[0]["position"] == (0.0, 0.0, 4.0)
        assert (view.distance, view.pitch, view.rows, view.columns) == (4.0, 3e-3, 40, 40)
        x, y = np.meshgrid(np.arange(40.0), np.arange(40.0))
        return {"P.X": x, "P.Y": y, "P.Z": x + 7.0 * y}

    def depth(x: Array, y: Array, z: Array) -> float:
        np.testing.assert_array_equal(z, x + 7.0 * y)
        assert x.shape == (1600,)
        return float(next(depths))

    monkeypatch.setattr(tiles.View, "layers", layers)
    monkeypatch.setattr(tiles, "_fitted_depth", depth)
    found = tiles.dent(TASK, "nrc_2000")
    size = 1e3 * math.hypot(mean, 1e-4)
    assert (found.finding.value, found.finding.error) == pytest.approx((size, size / math.sqrt(8.0)))
    assert found.rows[0].found == f"{1e3 * mean:+.3f} ± {3e3 * standard:.3f} mm"
    assert found.rows[0].verdict is verdict
    assert runs == [0, 1, 2, 3]


def test_an_unknown_of_the_map_changes_what_it_is_named_for() -> None:
    """Claim: an aperture is the lens's; aberration and diffusion share 40 µm in squares: 24 and 32."""
    size = crossing._Axis("aperture of the lens [mm]", 1e3, np.zeros(1), 0.0)
    assert size.changes(0.03) == {"receiver": {"aperture": 0.03}}
    blur = crossing._Axis("aberration of the lens [µm]", 1e6, np.zeros(1), 0.0)
    made = blur.changes(24e-6)
    assert made["receiver"] == {"aberration": 24e-6}
    assert made["position_sensor"] == {"diffusion": pytest.approx(32e-6)}
    assert blur.changes(41e-6)["position_sensor"] == {"diffusion": 0.0}


def test_a_clock_alone_makes_the_sigma_of_a_unit() -> None:
    """Claim: σ² of a unit whose clock makes 5 mm is that of one whose clock makes none, and (5 mm)², at each range."""
    scenario = crossing.bench(TASK, [], ranging="both").scenario
    distances = np.array([3.0, 12.0])
    with_clock, without = (crossing._pulses(scenario, sigma, distances) for sigma in (5e-3, 0.0))
    np.testing.assert_allclose(with_clock**2 - without**2, 25e-6, rtol=1e-9)
    assert without.max() < 5e-3


def test_a_map_holds_where_both_ways_err_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: v R² and t/100 are alike at √(t/100 v)."""
    axis = crossing._Axis("aperture", 1.0, np.array([1e-4, 2e-4]), 1e-4)
    monkeypatch.setattr(crossing, "_numbers", lambda task, axis, value: (value, value))
    monkeypatch.setattr(crossing, "_triangulation", lambda value, distances: value * distances**2)
    monkeypatch.setattr(crossing, "_pulses", lambda value, sigma, distances: sigma / 100.0 + 0.0 * distances)
    distances = np.geomspace(1.6, 60.0, 64)
    found = crossing._map(TASK, axis, np.array([0.5, 1.0, 2.0]), distances)
    wanted = np.sqrt(np.array([0.5, 1.0, 2.0])[:, None] / 100.0 / axis.values)
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


def test_a_point_of_the_map_is_simulated_about_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: five ranges from 0.7 to 1.4 of where it should be; the clock jitters by 2 σ/c; both ways from the same
    shots: 1e-4 R² and 10 mm are alike at 10 m, with 1/16 for the error of a ratio of 16² shots."""
    axis = crossing._Axis("aperture of the lens [mm]", 1e3, np.zeros(1), 0.0)

    def law(made: Any, shots: Any) -> Any:
        clock = made.scanner["lidar"]["digitiser"]
        assert clock["jitter"] == pytest.approx(2.0 * 8e-3 / LIGHT)
        assert clock["gate"] == (0.5, 80.0)
        assert made.scanner["receiver"] == {"aperture": 0.03}
        assert made.rest["ranging"] == "both"
        assert made.reflectance == 0.5
        np.testing.assert_allclose(np.diff(shots.time), 0.1)
        R = made.distance
        return triangulated(shots, R, 1e-4 * R**2) | triangulated(shots, R, 1e-2, "tof.")

    benches = Benches(monkeypatch, crossing, law)
    found, error = crossing._simulated(TASK, axis, 0.03, 8e-3, 9.0, 3)
    assert [made.distance for made in benches.asked] == pytest.approx([6.3, 7.65, 9.0, 10.62, 12.6])
    assert [made.step for made in benches.asked] == [30, 31, 32, 33, 34]
    assert found == pytest.approx(10.0)
    assert 0.0 < error == pytest.approx(spots.crossing_of(9.0 * np.array([0.7, 0.85, 1.0, 1.18, 1.4]),
        (9.0 * np.array([0.7, 0.85, 1.0, 1.18, 1.4]) / 10.0) ** 2, 1.0 / 16.0)[1])  # fmt: skip


@pytest.mark.parametrize(("off", "verdict"), [(0.99, UNPRINTED), (-1.01, DIFFERS)])
def test_the_map_is_judged_by_its_worst_point(
    monkeypatch: pytest.MonkeyPatch, repo_root: Path, off: float, verdict: Verdict
) -> None:
    """Claim: four standard errors and 2.5 % of the closed form are granted; told are σ of units that cross at 5 and 10
    m, with the shipped aberration and with none."""
    points = [crossing._Point(1.0, 0.01, 10.0, 10.1, 0.05)]
    slack = 4.0 * 0.05 + 0.025 * 8.0
    assert crossing._Point(1.0, 0.01, 8.0, 9.0, 0.05).slack == pytest.approx(slack)
    points += [crossing._Point(1.0, 0.01, 8.0, 8.0 + off * slack, 0.05)]
    monkeypatch.setattr(crossing, "_map", lambda *_: np.zeros((1, 1)))
    monkeypatch.setattr(crossing, "_points", lambda task, axis, step: tuple(points))
    asked = []

    def numbers(task: Task, axis: Any, value: float) -> tuple[float, None]:
        asked.append((axis.label, value))
        return value, None

    monkeypatch.setattr(crossing, "_numbers", numbers)
    monkeypatch.setattr(crossing, "range_budget", lambda value, R: {"all": 1e-4 * R**2 + 1e2 * value})
    task = quick_task(repo_root)
    rows = crossing.make_map(task).rows
    assert rows[0].verdict is verdict
    assert "4 points" in rows[0].what
    assert (rows[0].expected, rows[0].found) == (f"1 ± {slack / 8.0:.2f}", f"{1.0 + off * slack / 8.0:.2f}")
    aberration = load_scanner("nrc_2000").receiver.aberration
    assert rows[1].expected == f"{2.5 + 1e5 * aberration:.1f} to {10.0 + 1e5 * aberration:.1f} mm"
    assert rows[2].expected == "2.5 to 10.0 mm"
    assert {value for _, value in asked} == {aberration, 0.0}
    assert all(label.startswith("aberration") for label, _ in asked)


def test_points_of_the_map_are_those_that_may_be_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: least, shipped and largest value, where the closed forms cross between 2.3 and 24 m; each has a step
    of its own."""
    axis = crossing._Axis("aperture", 1.0, np.array([1.01, 5.0, 9.0]), 4.0)
    monkeypatch.setattr(crossing, "_numbers", lambda task, axis, value: (value, value))
    monkeypatch.setattr(crossing, "_triangulation", lambda value, R: 1e-2 * (R / (2.31 * value)) ** 2)
    monkeypatch.setattr(crossing, "_pulses", lambda value, sigma, R: sigma + 0.0 * R)
    asked: list[Any] = []

    def simulated(
        task: Task, axis: Any, value: float, sigma: float, near: float, step: int
    ) -> tuple[float, float]:
        asked.append((value, sigma, near, step))
        return near + 0.5, 0.1

    monkeypatch.setattr(crossing, "_simulated", simulated)
    found = crossing._points(TASK, axis, 100)
    assert [point.value for point in found] == [1.01, 4.0, 9.0]
    assert [one[2] for one in asked] == pytest.approx([2.31 * 1.01, 2.31 * 4.0, 2.31 * 9.0], rel=1e-6)
    assert [one[1] for one in asked] == [1e-2] * 3
    assert [one[3] for one in asked] == [101, 102, 103]
    assert [point.found - point.closed for point in found] == pytest.approx([0.5] * 3)
    for value in (2.28 / 2.31, 24.1 / 2.31):
        assert not crossing._points(TASK, crossing._Axis("aperture", 1.0, np.full(2, value), value), 0)
