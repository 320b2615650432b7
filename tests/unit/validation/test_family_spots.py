"""The ledger's experiments on ranges by the spot, and of both rangefinders, on instruments that answer by a law."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from drawn import bars, line
from made_benches import Benches, drawn, quick_task, triangulated

from scanner_sim.config import load_scanner
from scanner_sim.validation.reproduce.family import spots
from scanner_sim.validation.reproduce.item import Verdict

TASK = quick_task()
UNPRINTED, DIFFERS, AGREES = Verdict.UNPRINTED, Verdict.DIFFERS, Verdict.AGREES


def test_the_error_at_ten_metres_is_that_of_the_last_plate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: 16² voxels tell σ to σ/√512; shots lie over ±0.05 rad and are 0.1 s apart; close by the least counts."""
    benches = Benches(
        monkeypatch, spots, lambda made, shots: triangulated(shots, made.distance, 4e-5 * made.distance**2)
    )
    found = spots.at_ten(TASK, "nrc_2000").finding
    assert (found.value, found.error) == pytest.approx((4.0, 4.0 / math.sqrt(512.0)))
    assert [made.distance for made in benches.asked] == pytest.approx([2.0, 6.0, 10.0])
    # Plates are measured with random numbers of their own, or all of their errors would be one draw.
    assert len({made.step for made in benches.asked}) == 3
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


def test_pictures_of_spots_show_errors_over_range(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a dot for each plate, at its range and its error, in mm or µm."""
    law = Benches(
        monkeypatch, spots, lambda made, shots: triangulated(shots, made.distance, 4e-5 * made.distance**2)
    )
    for experiment, preset, unit in (
        (spots.at_ten, "nrc_2000", 1e3),
        (spots.close_depth, "close_range_scanner", 1e6),
    ):
        law.asked.clear()
        (axes,) = drawn(monkeypatch, spots, experiment(TASK, preset))
        (line,) = (one for one in axes.lines if one.get_label() == "simulated, rms")
        asked = np.array([made.distance for made in law.asked])
        np.testing.assert_allclose(line.get_xdata(), asked)
        np.testing.assert_allclose(line.get_ydata(), unit * 4e-5 * asked**2)
        if unit == 1e6:
            (stated,) = (one for one in axes.lines if one.get_label() == "as published")
            np.testing.assert_array_equal(stated.get_ydata(), 10.0)


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
    # Drawn are both errors [mm] with three of their own.
    distances = np.geomspace(2.0, 20.0, 6)
    (axes,) = drawn(monkeypatch, spots, found)
    for (_, marks, ends), sigma in zip(bars(axes), (0.1 * distances**2, np.full(6, 4.9)), strict=True):
        np.testing.assert_allclose(marks, np.stack([distances, sigma], axis=1))
        np.testing.assert_allclose(
            ends / sigma[:, None], [[1.0 - 3.0 / math.sqrt(512.0), 1.0 + 3.0 / math.sqrt(512.0)]] * 6
        )
    # A ratio that is drawn through what is asked for at 5 and 7.5 m.
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
    # Drawn over the aperture [mm]: the published limit, over √2, and σ with three standard errors [mm].
    (axes,) = drawn(monkeypatch, spots, found)
    apertures = np.array([12.5, 25.0, 50.0])
    limit = (
        1e3
        * scanner.laser.wavelength
        * 25.0
        / (math.pi * 25e-3 * scanner.receiver.baseline)
        * 25.0
        / apertures
    )
    np.testing.assert_allclose(line(axes, 0), np.stack([apertures, limit], axis=1))
    np.testing.assert_allclose(line(axes, 1), np.stack([apertures, limit / math.sqrt(2.0)], axis=1))
    ((_, marks, ends),) = bars(axes)
    sigma = 0.7 * limit[1] * (apertures / 25.0) ** power
    np.testing.assert_allclose(marks, np.stack([apertures, sigma], axis=1))
    np.testing.assert_allclose(ends, sigma[:, None] * [1.0 - 3.0 * share, 1.0 + 3.0 * share])


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
    made = spots.tilt(TASK, "nrc_2000")
    found = made.finding
    assert seen == [(axis, tilt) for axis in "xy" for tilt in (-30, -15, -5, 0, 5, 15, 30)]
    assert (found.value, found.error) == pytest.approx((100.0 * 6e-3 / (far - near), 0.0))
    (axes,) = drawn(monkeypatch, spots, made)
    tilts = np.array([-30.0, -15.0, -5.0, 0.0, 5.0, 15.0, 30.0])
    for number, microns in enumerate((100.0 * tilts, -200.0 * np.abs(tilts))):
        np.testing.assert_allclose(line(axes, number), np.stack([tilts, microns], axis=1), atol=1e-6)
