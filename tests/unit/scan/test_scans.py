"""Where the shots of scans without rows point, and when; and what is said of scans that cannot be."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from prototype import Galvanometers, Mirrors

from scanner_sim import InputError, ScenarioError, load_scenario
from scanner_sim.config import scenario_warnings
from scanner_sim.scan import spiral
from scanner_sim.scan.fixed import FixedScan
from scanner_sim.scan.lissajous import LissajousPattern, figures
from scanner_sim.scan.lissajous_scan import LissajousScan
from scanner_sim.scan.listed import ListedScan, read_angles
from scanner_sim.scan.protocol import Aim, OpenScan, ScanSetup
from scanner_sim.scan.raster import RasterScan
from scanner_sim.scan.spiral import SpiralScan
from scanner_sim.scene.objects import Scene

DWELL = 50e-6
QUICK = Galvanometers(natural_frequency=1e6, slew=1e6, acceleration=1e10)
"""Servos whose lag is 0.22 µs, a two hundredth of a dwell."""
PLAIN = LissajousPattern(amplitude=0.05, points=512, dither_sampling=False, inversion=False)


def setup(galvanometers: Galvanometers = QUICK) -> ScanSetup:
    return ScanSetup(Scene(), Mirrors(), galvanometers, DWELL)


def whole(scan: OpenScan, galvanometers: Galvanometers = QUICK) -> Aim:
    (aim,) = scan.aims(setup(galvanometers), scan.shots)
    return aim


@pytest.fixture
def listed(tmp_path: Path) -> ListedScan:
    """Forty shots on a parabola, with gaps between them."""
    time = DWELL * (0.5 + np.arange(40) * 1.5)
    theta, phi = 0.1 - 3.0 * time + 1e3 * time**2, 0.02 + 5.0 * time
    lines = [
        f"{p!r},{t!r},{1e3 * at!r}"
        for t, p, at in zip(theta.tolist(), phi.tolist(), time.tolist(), strict=True)
    ]
    (tmp_path / "angles.csv").write_text("\n".join(["phi_rad,theta_rad,time_ms", *lines]) + "\n")
    return ListedScan(type="listed", file=tmp_path / "angles.csv", motion="continuous")


def test_a_fixed_scan_rests_in_its_direction() -> None:
    """Claim: all shots point alike and at rest, one interval apart; by default one dwell follows the other."""
    scan = FixedScan(type="fixed", direction=(0.1, -0.2), points=5, interval=3 * DWELL)
    aim = whole(scan)
    assert (aim.theta == 0.1).all()
    assert (aim.phi == -0.2).all()
    assert not aim.travel_theta.any()
    assert not aim.travel_phi.any()
    np.testing.assert_allclose(aim.time, DWELL * (0.5 + 3.0 * np.arange(5)), rtol=1e-12)
    assert scan.scan_time(setup()) == pytest.approx(13 * DWELL)
    assert scan.sweep(setup()).angle == 0.0
    close = FixedScan(type="fixed", points=4)
    np.testing.assert_allclose(whole(close).time, DWELL * (0.5 + np.arange(4)), rtol=1e-12)
    assert [len(part.shot) for part in close.aims(setup(), 3)] == [3, 1]
    assert not list(close.faults(setup()))


def test_what_a_fixed_scan_cannot_is_told() -> None:
    scan = FixedScan(type="fixed", direction=(0.6, 0.0), interval=0.5 * DWELL)
    first, second = scan.faults(setup())
    assert "scan.direction: 34.3775 deg lies beyond the mirrors" in str(first)
    assert "scan.interval: 2.5e-05 s is shorter than a dwell" in str(second)


def test_a_figure_is_that_of_equations_6_and_7(listed: ListedScan) -> None:
    """Claim: with servos that follow at once each shot is at the middle of its dwell on the figure about the centre;
    the second begins a figure and a turnaround after the first. To the way of a lag, A 2π m lag/T = 0.06 µrad; rates to
    half an update of the drive, 2π m/T · 6 µs = 0.5 %."""
    scan = LissajousScan(type="lissajous", pattern=PLAIN, centre=(0.02, -0.03), patterns=2, turnaround=1e-3)
    aim, period = whole(scan), 512 * DWELL
    late = np.repeat([0.0, period + 1e-3], 512) + 1e-3
    np.testing.assert_allclose(aim.time, late + np.tile((np.arange(512) + 0.5) * DWELL, 2), rtol=1e-9)
    turn = 2.0 * np.pi * (aim.time - late) / period
    lag = 0.05 * 2.0 * np.pi * 3.0 * QUICK.lag / period
    # The first dwells show the servos ring after the turn: ten of their periods.
    settled = np.tile(np.arange(512) > 2, 2)
    for angle, cycles, middle in ((aim.theta, 3, 0.02), (aim.phi, 2, -0.03)):
        expected = middle + 0.05 * np.sin(cycles * turn)
        assert np.abs(angle - expected)[settled].max() < 1.05 * lag + 1e-9
    rate = 0.05 * 2.0 * np.pi * 3.0 / period * np.cos(3 * turn) * DWELL
    np.testing.assert_allclose(aim.travel_theta[settled], rate[settled], atol=6e-3 * np.abs(rate).max())
    assert scan.scan_time(setup()) == pytest.approx(2.0 * (period + 1e-3))
    assert scan.horizontal == pytest.approx((-0.03, 0.07))


def test_servos_lag_behind_a_figure() -> None:
    """Claim: slow against the servo, the shafts are where the command was a lag 2ζ/ω ago; what is left is of second
    order, A (2π m lag/T)² = 2 µrad."""
    servo, scan = Galvanometers(), LissajousScan(type="lissajous", pattern=PLAIN)
    aim, period = whole(scan, servo), 512 * DWELL
    turn = 2.0 * np.pi * (aim.time - aim.time[0] + 0.5 * DWELL - servo.lag) / period
    left = 0.05 * (2.0 * np.pi * 3.0 * servo.lag / period) ** 2
    error = np.abs(aim.theta - 0.05 * np.sin(3 * turn))[32:]
    assert error.max() < 1.5 * left < 0.2 * 0.05 * 2.0 * np.pi * 3.0 * servo.lag / period


def test_a_spiral_has_even_steps_on_even_arms() -> None:
    """Claim: Θ + iφ = c ψ exp(iψ): arms radius/turns apart; equal lengths of arc between shots, against a polygon of a
    million corners; the last update ends at the radius."""
    scan = SpiralScan(type="spiral", radius=0.08, turns=12.5, points=4000, centre=(0.03, -0.01))
    theta, phi = scan.curve(np.linspace(0.0, 1.0, 1_000_001)) - np.array([[0.03], [-0.01]])
    radius, angle = np.hypot(theta, phi), np.unwrap(np.arctan2(phi, theta)[1:])
    np.testing.assert_allclose(radius[1:], 0.08 * (angle - angle[0]) / (2.0 * np.pi * 12.5), atol=2e-5)
    assert radius[-1] == pytest.approx(0.08, rel=1e-9)
    steps = np.hypot(np.diff(theta), np.diff(phi)).reshape(1000, 1000).sum(axis=1)
    np.testing.assert_allclose(steps, steps.mean(), rtol=1e-5)
    aim = whole(scan)
    np.testing.assert_allclose(aim.time, (np.arange(4000) + 0.5) * DWELL)
    expected = scan.curve((np.arange(4000) + 0.5) / 4000)
    # A lag behind: 0.22 of 50 µs, once the servos have left their rest.
    way = scan.sweep(setup()).angle
    assert way == pytest.approx(steps.sum() / 4000, rel=1e-6)
    assert np.abs(np.stack([aim.theta, aim.phi]) - expected)[:, 8:].max() < 0.01 * way
    # Rates of half an update before, an eighth of a dwell, in which the direction turns by 8 mrad at most here.
    travels = np.stack([aim.travel_theta, aim.travel_phi])[:, 100:-1]
    moved = np.gradient(np.stack([aim.theta, aim.phi]), axis=1)[:, 100:-1]
    assert np.abs(travels - moved).max() < 0.012 * way


def test_long_spirals_are_followed_piece_by_piece(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: servos go on from piece to piece as if there were none, to rounding."""
    scan = SpiralScan(type="spiral", radius=0.08, turns=12.5, points=500)
    together = whole(scan, Galvanometers())
    monkeypatch.setattr("scanner_sim.scan.spiral._POINTS_TOGETHER", 64)
    pieces = whole(scan, Galvanometers())
    assert [part.shape for part in scan._motion(setup())] == [(2, 500), (2, 500), (500,)]
    for name in ("theta", "phi", "travel_theta", "travel_phi"):
        np.testing.assert_allclose(getattr(pieces, name), getattr(together, name), rtol=0.0, atol=1e-12)


def test_listed_angles_are_read_in_their_units(listed: ListedScan) -> None:
    """Claim: columns by name in any order, exact in radians, times in the file's unit; travels of a parabola over even
    times are exact but at its ends."""
    aim = whole(listed)
    time = DWELL * (0.5 + np.arange(40) * 1.5)
    np.testing.assert_array_equal(aim.theta, 0.1 - 3.0 * time + 1e3 * time**2)
    np.testing.assert_allclose(aim.time, time, rtol=1e-12)
    np.testing.assert_allclose(aim.travel_theta[1:-1], (2e3 * time - 3.0)[1:-1] * DWELL, rtol=1e-6)
    np.testing.assert_allclose(aim.travel_phi, 5.0 * DWELL, rtol=1e-6)
    resting = whole(listed.model_copy(update={"motion": "stepped"}))
    assert not resting.travel_theta.any()
    assert not resting.travel_phi.any()
    assert listed.scan_time(setup()) == pytest.approx(time[-1] + 0.5 * DWELL)


def test_without_times_one_shot_follows_the_other(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "\ufefftheta_deg, phi_mrad\r\n90,-3\r\n-1.5,2.5\r\n\r\n", encoding="utf-8"
    )
    aim = whole(ListedScan(type="listed", file=tmp_path / "a.csv"))
    np.testing.assert_allclose(aim.theta, np.radians([90.0, -1.5]))
    np.testing.assert_allclose(aim.phi, [-3e-3, 2.5e-3])
    np.testing.assert_allclose(aim.time, [0.5 * DWELL, 1.5 * DWELL])


@pytest.mark.parametrize("batch", [1, 97, 10_000])
def test_batches_hold_all_shots_once(batch: int, listed: ListedScan) -> None:
    scans: list[OpenScan] = [
        LissajousScan(type="lissajous", pattern=PLAIN.model_copy(update={"points": 64}), patterns=3),
        SpiralScan(type="spiral", radius=0.1, turns=3, points=200),
        RasterScan(rows=9, columns=11, horizontal=(0.0, 0.1), vertical=(0.0, 0.1)),
        listed,
    ]
    for scan in scans:
        parts = list(scan.aims(setup(), batch))
        assert max(len(part.shot) for part in parts) <= batch
        one, together = whole(scan), np.argsort(np.concatenate([part.shot for part in parts]))
        order = np.argsort(one.shot)
        for name in Aim.__dataclass_fields__:
            pieces = np.concatenate([getattr(part, name) for part in parts])
            np.testing.assert_array_equal(pieces[together], getattr(one, name)[order])
        np.testing.assert_array_equal(np.sort(one.shot), np.arange(scan.shots))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no angles"),
        ("theta_deg,phi_deg\n", "has no angles"),
        ("theta,phi_deg\n1,2\n", r"line 1: 'theta' is no column .* theta_rad"),
        ("theta_deg,time_s\n1,2\n", "line 1: there is no column of phi"),
        ("theta_deg,theta_rad,phi_deg\n1,2,3\n", "line 1: there is several columns of theta"),
        ("theta_deg,phi_deg\n1,2\n1\n", "line 3 has 1 entries instead of 2"),
        ("theta_deg,phi_deg\n1,2\n\n3,4\n", "line 3 has 1 entries instead of 2"),
        ("theta_deg,phi_deg\n1,2\n1,x\n", "line 3, column phi_deg: 'x' is no number"),
        ("theta_deg,phi_deg\nnan,2\n", "line 2, column theta_deg: nan is no deflection"),
        ("theta_rad,phi_deg\n1,1e400\n", "line 2, column phi_deg: inf is no deflection"),
        ("theta_rad,phi_deg\n2,1\n", "line 2, column theta_rad: 2 is no deflection"),
        ("theta_deg,phi_deg,time_s\n1,1,1e9\n", "line 2, column time_s: 1e.09 is no time"),
        ("theta_deg,phi_deg,time_s\n1,1,2\n1,1,2\n", "line 3, column time: the time does not ascend"),
        (
            "theta_deg,phi_deg\n" + "x,y\n" * 9,
            "line 2, .*line 4, column theta_deg: 'x' is no number, and more",
        ),
        ("theta_deg,phi_deg\n1," + "2" * 2000, "line 2: it is longer than 1000 letters"),
    ],
)
def test_a_broken_list_is_refused_by_line_and_column(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_angles(path)
    with pytest.raises(ScenarioError, match=r"scan.file.*bad.csv") as caught:
        load_scenario({"schema": 1, "scan": {"type": "listed", "file": str(path)}})
    assert len(caught.value.faults) == 1


def test_a_list_of_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_bytes(b"theta_deg,phi_deg\n\xff\xfe,1\n")
    with pytest.raises(InputError, match="no text in UTF-8"):
        read_angles(tmp_path / "bad.csv")


def faults(scan: dict[str, object], **more: object) -> str:
    with pytest.raises(ScenarioError) as caught:
        load_scenario({"schema": 1, "scan": scan, **more})
    return str(caught.value)


def test_scans_beyond_the_mirrors_are_refused(tmp_path: Path) -> None:
    """Claim: the edge of the figure counts, its middle's angle and dither included."""
    figure = {"type": "lissajous", "pattern": {"amplitude": 0.3}, "centre": [0.19, 0.0]}
    load_scenario({"schema": 1, "scan": figure})
    assert "scan.pattern.amplitude" in faults(figure | {"centre": [0.0, -0.21]})
    dithered = {"amplitude": 0.3, "dither_position": 0.5}
    assert "28.6479 deg" in faults(figure | {"pattern": dithered})
    assert "scan.radius" in faults({"type": "spiral", "radius": 0.4, "centre": [0.2, 0.0]})
    (tmp_path / "far.csv").write_text("theta_deg,phi_deg\n0,0\n0,-29\n")
    assert "-29 deg lies beyond" in faults({"type": "listed", "file": str(tmp_path / "far.csv")})


def test_scans_with_too_few_points_or_too_many_shots_are_refused() -> None:
    assert "Write at least 160" in faults({"type": "spiral", "radius": 0.1, "turns": 20, "points": 159})
    load_scenario({"schema": 1, "scan": {"type": "spiral", "radius": 0.1, "turns": 20, "points": 160}})
    many = {"type": "lissajous", "patterns": 2049, "pattern": {"points": 2048, "amplitude": 0.1}}
    assert "4,196,352 shots are too many" in faults(many)
    assert "no such key" in faults({"type": "spiral", "radius": 0.1, "rows": 4})


def test_shots_that_overlap_in_time_are_refused(tmp_path: Path) -> None:
    """Claim: a dwell from middle to middle and half of one before the first; rounded to a millionth."""
    path, scan = tmp_path / "times.csv", {"type": "listed", "file": str(tmp_path / "times.csv")}
    path.write_text("theta_deg,phi_deg,time_us\n0,0,25\n0,0,75.00000001\n0,0,125\n")
    load_scenario({"schema": 1, "scan": scan})
    path.write_text("theta_deg,phi_deg,time_us\n0,0,25\n0,0,74\n0,0,125\n")
    assert "line 3: 7.4e-05 s is less than a dwell" in faults(scan)
    path.write_text("theta_deg,phi_deg,time_us\n0,0,24\n0,0,75\n")
    assert "line 2: 2.4e-05 s is less than a dwell" in faults(scan)


def test_what_has_no_rows_keeps_no_waveforms_of_voxels() -> None:
    spiral = {"type": "spiral", "radius": 0.1}
    text = faults(spiral, ranging="tof", output={"waveforms": "all"})
    assert "a scan of type spiral keeps no waveforms" in text


RASTER = {"type": "raster", "rows": 2, "columns": 2, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}


@pytest.mark.parametrize(
    ("key", "scan", "said"),
    [
        ("waveforms", {"type": "spiral", "radius": 0.1}, "a scan of type spiral keeps no waveforms"),
        ("lines", RASTER, "time of flight has no lines"),
    ],
)
def test_what_is_not_kept_is_said_at_its_key(key: str, scan: dict[str, object], said: str) -> None:
    assert f"output.{key}: {said}" in faults(scan, ranging="tof", output={key: "all"})


def test_scenarios_tell_which_scan_they_need() -> None:
    scenario = load_scenario({"schema": 1, "scan": {"type": "spiral", "radius": 0.1}})
    assert scenario.open_scan.shots == 8192
    assert scenario.targets == ()
    with pytest.raises(InputError, match=r"needs a raster, and the scenario has none \(scan.type: spiral"):
        _ = scenario.raster
    with pytest.raises(InputError, match="follows targets, and the scenario does not"):
        _ = scenario.following


@pytest.mark.parametrize(
    ("scan", "message"),
    [
        ({"type": "lissajous", "pattern": {"ratio": "5:3", "points": 4096, "amplitude": 0.05}}, "to and fro"),
        (
            {"type": "lissajous", "pattern": {"points": 128, "amplitude": 0.05}},
            "cannot follow 50 mrad at 469 Hz",
        ),
        (
            {"type": "lissajous", "pattern": {"points": 512, "amplitude": 0.3}},
            "scan.pattern.points: at the 8 m",
        ),
        ({"type": "spiral", "radius": 0.3, "turns": 100, "points": 2000}, "the mirrors are at their limits"),
        ({"type": "spiral", "radius": 0.2, "turns": 40, "points": 4000}, "scan.points: at the 8 m of 'wall'"),
    ],
)
def test_scans_that_make_little_sense_are_warned_of(scan: dict[str, object], message: str) -> None:
    wall = {
        "name": "wall",
        "shape": "rectangle",
        "size": [4, 4],
        "position": [0, 0, 8],
        "material": "grey_reference",
    }
    scenario = load_scenario({"schema": 1, "scene": {"objects": [wall]}, "scan": scan})
    assert any(message in sentence for sentence in scenario_warnings(scenario)), scenario_warnings(scenario)


@pytest.mark.parametrize(
    "scan",
    [
        {
            "type": "lissajous",
            "pattern": {"ratio": "5:3", "points": 8192, "amplitude": 0.05, "phases": [0, "-90 deg"]},
        },
        {"type": "lissajous", "pattern": {"ratio": "5:4", "points": 8192, "amplitude": 0.05}},
        {"type": "spiral", "radius": 0.08},
    ],
)
def test_sound_scans_raise_no_doubts(scan: dict[str, object]) -> None:
    wall = {
        "name": "wall",
        "shape": "rectangle",
        "size": [4, 4],
        "position": [0, 0, 8],
        "material": "grey_reference",
    }
    assert not scenario_warnings(load_scenario({"schema": 1, "scene": {"objects": [wall]}, "scan": scan}))


def test_a_list_swept_faster_than_the_mirrors_is_warned_of(tmp_path: Path) -> None:
    """Claim: 1° in a dwell of 50 µs is 349 rad/s, more than 280; resting mirrors are not asked."""
    (tmp_path / "fast.csv").write_text("theta_deg,phi_deg\n" + "\n".join(f"{k},0" for k in range(5)))
    scan = {"type": "listed", "file": str(tmp_path / "fast.csv"), "motion": "continuous"}
    warned = []
    for how in ("continuous", "stepped"):
        scenario = load_scenario({"schema": 1, "scan": {**scan, "motion": how}})
        warned.append([sentence for sentence in scenario_warnings(scenario) if "rad/s" in sentence])
    assert [len(some) for some in warned] == [1, 0]
    assert f"{math.radians(1.0) / DWELL:.3g} rad/s" in warned[0][0]


def test_a_list_of_voxels_is_on_the_raster_each_once() -> None:
    """Claim: rows and columns count from 0 to their last; what is outside, named twice or nothing is told."""
    raster = RasterScan(rows=3, columns=5, horizontal=(-0.1, 0.1), vertical=(-0.1, 0.1))
    whole = np.array([[row, column] for row in range(3) for column in range(5)])
    assert raster.not_voxels(whole) is None
    assert raster.not_voxels(whole[[3, 1]]) is None
    for bad in ([3, 0], [0, 5], [-1, 0], [0, -1]):
        problem = raster.not_voxels(np.array([[1, 1], bad]))
        assert problem is not None
        assert f"({bad[0]}, {bad[1]}) lies outside of the 3 × 5" in problem[0]
    problem = raster.not_voxels(np.array([[0, 1], [2, 4], [1, 0], [2, 4]]))
    assert problem is not None
    assert "(2, 4) is named more than once" in problem[0]
    assert raster.not_voxels(np.zeros((0, 2), dtype=int)) is not None


def test_a_spiral_takes_a_dwell_for_each_point() -> None:
    spiral = SpiralScan(type="spiral", radius=0.08, turns=12.5, points=4000, centre=(0.03, -0.01))
    assert spiral.scan_time(setup()) == pytest.approx(4000 * DWELL)
    assert (spiral.horizontal, spiral.vertical) == (
        pytest.approx((-0.05, 0.11)),
        pytest.approx((-0.09, 0.07)),
    )


def test_a_spiral_may_be_left_while_the_mirrors_catch_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: limits count from the first update that lies so many of the servos' lags behind the start, not before; the
    share is told of what is left."""
    scan = SpiralScan(type="spiral", radius=0.1, turns=3, points=200)
    servos, dwell = SimpleNamespace(lag=0.37e-3), 50e-6
    setup: Any = SimpleNamespace(galvanometers=servos, dwell=dwell)
    time = np.arange(800) * dwell / spiral._UPDATES
    caught_up = time >= spiral._CATCH_UP_LAGS * servos.lag
    for limited, said in ((~caught_up, 0), (caught_up & (np.cumsum(caught_up) == 1), 1)):
        monkeypatch.setattr(SpiralScan, "_motion", lambda *_, limited=limited: (None, None, limited))
        told = list(scan.warnings(setup))
        assert len(told) == said
        if told:
            assert f"for {100.0 / caught_up.sum():.2g} % of the spiral" in told[0]


def test_figures_of_a_scan_are_dithered_and_inverted_by_their_turn() -> None:
    """Claim: with servos that follow at once figure n of a scan is pattern n: with inversion every second one is the
    one before, mirrored through the centre; with dither they lie apart as the patterns do. Tolerance: two ways of a
    lag, each A 2π m lag/T; from one figure to the next of the same sense dither moves by a tenth of a point and more.
    """
    centre, points, cycles = np.array([[0.02], [-0.03]]), 512, np.array([[3.0], [2.0]])
    inverted = PLAIN.model_copy(update={"inversion": True})
    dithered = inverted.model_copy(update={"dither_sampling": True})
    lag = 0.05 * 2.0 * np.pi * 3.0 * QUICK.lag / (points * DWELL)
    found = {}
    for pattern in (inverted, dithered):
        aim = whole(LissajousScan(type="lissajous", pattern=pattern, centre=(0.02, -0.03), patterns=6))
        both = np.stack([aim.theta, aim.phi]).reshape(2, 6, points).transpose(1, 0, 2)[:, :, 3:] - centre
        np.testing.assert_allclose(both[1::2], -both[::2], atol=2.1 * lag)
        found[pattern.dither_sampling] = both
    turn = 2.0 * np.pi * (np.arange(points)[3:] + 0.5) / points
    for both in found[False][::2]:
        np.testing.assert_allclose(both, 0.05 * np.sin(cycles * turn), atol=1.05 * lag + 1e-9)
    shift = figures(dithered, np.arange(6), (0.02, -0.03)).phase + 0.5 * np.pi
    for number in (0, 2, 4):
        wanted = 0.05 * np.sin(cycles * turn + shift[number][:, None])
        np.testing.assert_allclose(found[True][number], wanted, atol=1.05 * lag + 1e-9)
    apart = np.abs(found[True][[0, 2, 4]] - found[True][[2, 4, 0]]).max(axis=(1, 2))
    assert apart.min() > 0.1 * 0.05 * 2.0 * np.pi * 3.0 / points > 5.0 * lag
