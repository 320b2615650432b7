"""What laws of time of flight ask of the instrument, and what they make of errors that are known."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from made_settings import MIDDLE, RANGES, SCAN, Array, lidar, setting

from scanner_sim.analytic import geometry
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.render.device import Device
from scanner_sim.validation.compare import (
    pulses,
    test_bench,
    time_walk,
)


def test_echoes_are_asked_for_where_gate_and_amplifier_let_them(device: Device) -> None:
    """Claim: a plate of the middle range that lies four widths of the echo, as ranges, within the gate; a
    ratio of 20, 100 and 500 of the noise, while the plate is no whiter than white and the peak less than 0.8 of the
    saturation."""
    told = setting(ranging="both")
    width = 2.0 * SPEED_OF_LIGHT * math.hypot(*pulses.pulse_widths(told))
    for gate, expected in (
        ((MIDDLE - 1.001 * width, 15.0), MIDDLE),
        ((MIDDLE - 0.999 * width, 30.0), RANGES[2]),
        ((5.0, RANGES[2] + 1.001 * width), RANGES[2]),
        ((5.0, RANGES[2] + 0.999 * width), MIDDLE),
        ((0.5, RANGES[2] + 1.001 * width), MIDDLE),
        ((0.5, MIDDLE + 0.999 * width), RANGES[0]),
        ((RANGES[2] - 0.999 * width, RANGES[2] + 2.0 * width), None),
    ):
        assert pulses.echo_range(lidar(told, digitiser={"gate": gate})) == expected, gate
    sigma, _ = pulses.dark_noise(told)
    white = pulses.echo_peak(told, MIDDLE, 1.0) / sigma
    assert {name.split()[2] for name in pulses._echoes(told)} == {
        f"{ratio:g}" for ratio in (20.0, 100.0, 500.0) if ratio <= white
    }
    power = told.scenario.scanner.lidar.pulse.pulse_energy
    for ratio in (20.0, 100.0, 500.0):
        # So much energy that a white plate returns a little less, or a little more, than the ratio.
        for share in (0.999, 1.001):
            faint = lidar(told, pulse={"energy": power * ratio * share / white})
            found = {name.split()[2]: grey for name, (_, grey) in pulses._echoes(faint).items()}
            assert (f"{ratio:g}" in found) == (share > 1.0)
            if share > 1.0:
                assert found[f"{ratio:g}"] == pytest.approx(1.0 / share)


@pytest.mark.parametrize(("share", "kept"), [(0.801, False), (0.799, True)])
def test_echoes_stay_below_the_saturation(monkeypatch: pytest.MonkeyPatch, share: float, kept: bool) -> None:
    """Claim: of an echo of 100 times the noise the peak is less than 0.8 of what the amplifier bears."""
    told = setting(ranging="both")
    saturation = told.scenario.scanner.lidar.photodiode.saturation
    monkeypatch.setattr(pulses, "dark_noise", lambda _: (share * saturation / 100.0, 0.0))
    monkeypatch.setattr(pulses, "echo_peak", lambda *_: 1e9 * saturation)
    found = pulses._echoes(told)
    assert list(found) == [f"echo of {ratio} times the noise, 9 m" for ratio in ("20", "100")[: 1 + kept]]


def test_a_receiver_has_the_named_noise_alone() -> None:
    """Claim: of what the scenario has on; no drift of the clock, no speckle, mirrors without errors, no gate."""
    told = lidar(setting(ranging="both"), photodiode={"noise": {"amplifier": False}})
    changes = pulses.silent(told, "amplifier", "quantisation", timing="matched_filter")
    made = told.scenario.changed(**changes)
    on = {name for name, value in made.scanner.lidar.photodiode.noise if value}
    assert on == {"quantisation"}
    assert made.scanner.lidar.digitiser.drift == 0.0
    assert not made.scanner.laser.speckle
    assert made.scanner.mirrors.jitter == made.scanner.mirrors.wobble == 0.0
    assert (made.rangefinders, made.processing.range_gate) == (("tof",), None)
    assert made.processing.pulse.timing == "matched_filter"


@pytest.mark.parametrize(("most", "aside"), [(0.4, 0.15), (0.1, 0.1)])
def test_plates_for_echoes_stand_side_by_side(
    monkeypatch: pytest.MonkeyPatch, most: float, aside: float
) -> None:
    """Claim: each faces the beam at its range, over 0.15 rad to each side or as far as mirrors reach, and is shot at as
    often as asked; errors in mm, plate by plate; no plate hides another, and each holds eight radii of the beam."""
    small = SCAN | {"horizontal": (-0.05, 0.05), "vertical": (-0.05, 0.05)}
    told = setting(ranging="both", scanner={"mirrors": {"max_deflection": most}}, scan=small)
    ranges, greys = [9.0, 9.1, 9.2, 9.3], [0.1, 0.2, 0.3, 0.4]
    seen: list[Any] = []

    def errors(_: Any, scenario: Any, aim: Any) -> Array:
        seen.append((scenario, aim))
        return 1e-3 * np.arange(12.0)

    monkeypatch.setattr(test_bench, "range_errors", errors)
    found = pulses.plate_errors(told, ranges, greys, 5, 3, pulses.silent(told))
    np.testing.assert_allclose(found, np.arange(12.0).reshape(4, 3))
    ((made, aim),) = seen
    theta = np.linspace(-aside, aside, 4)
    np.testing.assert_allclose(aim.theta, np.repeat(theta, 3))
    np.testing.assert_array_equal(aim.phi, 0.0)
    assert made.seed == 5
    separation = made.scanner.mirrors.axis_separation
    radius = made.scanner.laser.radius(9.0)
    for plate, R, grey, angle in zip(made.scene.objects, ranges, greys, theta, strict=True):
        np.testing.assert_allclose(
            plate.position, geometry.point_from_shot(R, angle, 0.0, separation), atol=1e-12
        )
        assert plate.rotation[1].angle == pytest.approx(angle)
        assert plate.material.reflectance == grey
        assert min(plate.size) > 16.0 * radius
        assert max(plate.size) < R * 2.0 * aside / 3.0


def test_scatter_and_bias_of_echoes_pool_their_seeds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: σ over places in a sample is the root mean square of theirs, about the mean of each, of all seeds; a bias
    is the mean of all. Amplifier and converter make noise, and the clock where it is asked for."""
    told = setting(2, ranging="both")
    asked: list[Any] = []

    def errors(_: Any, ranges: Any, greys: Any, seed: int, shots: int, made: Any) -> Array:
        asked.append((seed, shots, made, list(greys)))
        np.testing.assert_allclose(
            (np.array(ranges) - MIDDLE) * told.scenario.scanner.lidar.digitiser.rate / (0.5 * SPEED_OF_LIGHT),
            [-0.375, -0.125, 0.125, 0.375],
            atol=1e-9,
        )
        sign = np.where(np.arange(shots) % 2 == 0, 1.0, -1.0) * math.sqrt((shots - 1) / shots)
        place = np.arange(4.0)[:, None]
        return place + (1.0 + (len(asked) % 2)) * sign

    monkeypatch.setattr(pulses, "plate_errors", errors)
    echoes = pulses._echoes(told)
    found = pulses.TOF_SIGMA.measure(told)
    assert list(found) == list(echoes)
    assert [one.value for one in found.values()] == pytest.approx([math.sqrt(2.5)] * len(echoes))
    assert len({seed for seed, *_ in asked}) == 2 * len(echoes)
    assert [greys for *_, greys in asked[::2]] == [[grey] * 4 for _, grey in echoes.values()]
    on = {name for name, value in asked[0][2]["scanner"]["lidar"]["photodiode"]["noise"].items() if value}
    assert on == {"amplifier", "quantisation", "clock"}
    asked.clear()
    bias = pulses.TOF_RANGE.measure(told)
    assert [one.value for one in bias.values()] == pytest.approx([1.5] * len(echoes))
    on = {name for name, value in asked[0][2]["scanner"]["lidar"]["photodiode"]["noise"].items() if value}
    assert on == {"amplifier", "quantisation"}
    assert asked[0][2]["processing"]["pulse"] == {"timing": "matched_filter", "echo": "strongest"}


def test_the_clock_has_a_law_where_it_jitters() -> None:
    told = setting(ranging="both")
    assert not pulses._clocked(told)
    assert pulses._clocked(lidar(told, digitiser={"jitter": 0.0})) == "the clock has no jitter"
    assert pulses._clocked(lidar(told, photodiode={"noise": {"clock": False}})) == "the clock has no jitter"


def test_a_walk_is_the_mean_of_the_places_less_that_of_the_lowest_echo(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: means 0, 1 … 7 mm of eight places, moved by 0, −2, −5 and −9 mm, are 2, 5 and 9 nearer; standard errors of
    the places are those of their means, of two ratios in squares."""
    told = setting(ranging="both")
    moves, asked = iter([0.0, -2.0, -5.0, -9.0]), []

    def errors(_: Any, ranges: Any, greys: Any, seed: int, shots: int, made: Any) -> Array:
        asked.append(
            (ranges, greys, made["processing"]["pulse"], made["scanner"]["lidar"]["photodiode"]["noise"])
        )
        sign = np.where(np.arange(shots) % 2 == 0, 1.0, -1.0) * math.sqrt((shots - 1) / shots)
        return np.arange(8.0)[:, None] + next(moves) + 0.4 * sign

    monkeypatch.setattr(time_walk, "plate_errors", errors)
    found = time_walk._measure_walk(told)
    assert [one.value for one in found.values()] == pytest.approx([2.0, 5.0, 9.0])
    # 16 shots of σ = 0.4 at 8 places: 0.1/√8 each.
    assert [one.error for one in found.values()] == pytest.approx([0.1 / math.sqrt(8.0) * math.sqrt(2.0)] * 3)
    level = time_walk._walk_level(told)
    for (ranges, greys, pulse, noises), ratio in zip(asked, (2.0, 4.0, 8.0, 16.0), strict=True):
        peaks = [pulses.echo_peak(told, *pair) for pair in zip(ranges, greys, strict=True)]
        assert peaks == pytest.approx([ratio * level] * 8)
        assert pulse == {"timing": "leading_edge", "level": level, "walk_correction": False, "overlap": False}
        assert {name for name, value in noises.items() if value} == {"amplifier"}


@pytest.mark.parametrize(
    ("share", "reason"), [(1.001, ""), (0.999, "the level would lie within the noise at this range")]
)
def test_a_level_lies_ten_times_above_the_noise(
    monkeypatch: pytest.MonkeyPatch, share: float, reason: str
) -> None:
    told = setting(ranging="both")
    monkeypatch.setattr(time_walk, "_walk_level", lambda _: share * 10.0 * pulses.dark_noise(told)[0])
    assert time_walk._walks(told) == reason


@pytest.mark.parametrize("share", [0.49, 0.51])
def test_the_strongest_echo_of_a_walk_is_half_of_the_saturation(
    monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    """Claim: sixteen times the level, of a white plate at the farthest range, and no more than half of what the
    amplifier bears."""
    told = setting(ranging="both")
    saturation = told.scenario.scanner.lidar.photodiode.saturation
    asked: list[Any] = []
    monkeypatch.setattr(
        time_walk, "echo_peak", lambda _, R, grey: asked.append((R, grey)) or share * saturation
    )
    assert 16.0 * time_walk._walk_level(told) == pytest.approx(min(share, 0.5) * saturation)
    assert asked == [(time_walk._walk_ranges(told)[-1], 1.0)]
