"""Between mirrors and tracker: encoders, shots' numbers, corrected delays, σ of signals, records and saved states."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import Scenario, load_scenario
from scanner_sim.analytic import geometry as judge
from scanner_sim.analytic.spot import pixel_shares
from scanner_sim.detector.encoders import reading_noise
from scanner_sim.instrument.closed_loop import target_sensor as voxels
from scanner_sim.instrument.closed_loop.records import point_of
from scanner_sim.instrument.closed_loop.saved_state import first_state, load_state, save_state
from scanner_sim.instrument.closed_loop.situation import InUse
from scanner_sim.instrument.closed_loop.target_sensor import (
    Encoders,
    SignalNoise,
    TargetSensor,
    aim_of,
    samples_of,
    unevenness,
)
from scanner_sim.render.device import Device
from scanner_sim.scan.schedule import PatternMotion
from scanner_sim.scene.light.lighting import LightChange
from scanner_sim.scene.moves import Move
from scanner_sim.tracking.prediction import Motion
from scanner_sim.tracking.samples import angles_later
from scanner_sim.tracking.state import Refusal, TrackCommand, TrackMode, TrackState

Array = NDArray[np.float64]

DISC = {"name": "node", "array": {"diameter": 0.1, "plate": 0.4}, "position": (0.1, 0.05, 9.0)}
POINTS = 128


def scenario(**mirrors: Any) -> Scenario:
    return load_scenario(
        {
            "schema": 1,
            "seed": 5,
            "scanner": {"mirrors": mirrors},
            "scene": {"objects": [DISC]},
            "scan": {"type": "track", "targets": ["node"]},
        }
    )


def motion() -> PatternMotion:
    """Return a pattern whose arrays are all different."""
    t = 2.0 * np.pi * (np.arange(POINTS) + 0.5) / POINTS
    theta, phi = 0.1 + 6e-3 * np.cos(3.0 * t), -0.05 + 6e-3 * np.sin(2.0 * t)
    one = PatternMotion(
        time=50e-6 * (np.arange(POINTS) + 0.5),
        commanded_theta=theta + 1e-4,
        commanded_phi=phi - 1e-4,
        true_theta=theta,
        true_phi=phi,
        latched_theta=theta - 3e-5,
        latched_phi=phi + 2e-5,
        travel_theta=np.gradient(theta),
        travel_phi=np.gradient(phi),
        limited=np.zeros((), dtype=np.bool_),
    )
    return PatternMotion.stack([one])


def read(encoders: Encoders, visit: int, run: int = 0) -> Array:
    """Return what encoders read of that pattern, shape (2, points)."""
    return np.asarray(encoders.read(motion(), np.array([visit]), np.array([run]))[0])


def latched() -> Array:
    return np.concatenate([motion().latched_theta, motion().latched_phi])


@pytest.mark.parametrize("visit", [0, 1, 63, 64, 65, 200])
def test_encoders_noise_belongs_to_the_shots_of_a_visit(device: Device, visit: int) -> None:
    """Claim: what is read is the latched angle with the noise that the shots' own numbers address, in any block."""
    known = scenario(readout_step=0.0)
    shots = aim_of(motion(), np.array([visit])).shot
    np.testing.assert_array_equal(shots, visit * POINTS + np.arange(POINTS))
    seeds = np.full(POINTS, known.seed, dtype=np.uint64)
    noise = np.stack(reading_noise(shots, known.scanner.mirrors, seeds))
    assert np.abs(noise).max() > 0.0
    np.testing.assert_allclose(read(Encoders([known]), visit) - latched(), noise, atol=1e-15)


def test_the_noise_of_encoders_does_not_repeat(device: Device) -> None:
    """Claim: of 300 visits none has the noise of another."""
    encoders = Encoders([scenario(readout_step=0.0)])
    seen = {read(encoders, visit).tobytes() for visit in range(300)}
    assert len(seen) == 300


def test_each_run_has_the_noise_of_its_seed(device: Device) -> None:
    """Claim: runs at different visits read what each of them reads alone, whatever block of numbers they are in, also
    where one of them comes to its next block of 64 visits and the other does not."""
    runs = [scenario(readout_step=0.0).model_copy(update={"seed": seed}) for seed in (5, 6, 2**62)]
    together, which, visit = Encoders(runs), np.array([2, 0]), np.array([126, 3])
    one = motion()
    both = PatternMotion(*(np.repeat(getattr(one, field.name), 2, axis=0) for field in fields(one)))
    for _ in range(3):
        found = together.read(both, visit, which)
        for row in (0, 1):
            alone = read(Encoders([runs[which[row]]]), int(visit[row]))
            np.testing.assert_array_equal(found[row], alone)
        visit = visit + 1
    assert (found[0] != found[1]).all()


def test_encoders_read_the_nearest_step(device: Device) -> None:
    step = 20e-6
    known = scenario(readout_step=step, readout_noise=0.0, jitter=0.0)
    angles = read(Encoders([known]), 3)
    assert np.abs(angles - latched()).max() <= 0.5 * step * (1.0 + 1e-9)
    np.testing.assert_allclose(angles / step, np.rint(angles / step), atol=1e-6)


def test_an_aim_has_the_true_angles_and_travels() -> None:
    run = motion()
    aim = aim_of(run, np.array([7]))
    for name in ("theta", "phi"):
        np.testing.assert_array_equal(getattr(aim, name), getattr(run, f"true_{name}")[0])
        np.testing.assert_array_equal(getattr(aim, f"travel_{name}"), getattr(run, f"travel_{name}")[0])
    np.testing.assert_array_equal(aim.time, run.time[0])


def layers(prefix: str = "") -> dict[str, NDArray[Any]]:
    """Return layers of a pattern, (1, points), the fused ones apart from the others."""
    made: dict[str, NDArray[Any]] = {"Y": 1e4 + np.arange(POINTS), "sigma_Y": np.full(POINTS, 50.0)}
    for number, name in enumerate(("", "fused.") if prefix else ("",)):
        made |= {
            f"{name}range_m": np.full(POINTS, 9.0 + number),
            f"{name}sigma_range_m": np.full(POINTS, 1e-3 * (1 + number)),
            f"{name}status": np.full(POINTS, number, dtype=np.uint32),
        }
    return {name: values[None] for name, values in made.items()}


@pytest.mark.usefixtures("device")
def test_a_known_delay_is_taken_off() -> None:
    """Claim: readings that were latched early by the delay become the angles of the dwell's middle: third order."""
    run, delay = motion(), 20e-6
    t = 2.0 * np.pi * (run.time - delay) / (POINTS * 50e-6)
    early = np.stack([0.1 + 6e-3 * np.cos(3.0 * t), -0.05 + 6e-3 * np.sin(2.0 * t)], axis=1)
    found = angles_later(run.time, early, delay)
    samples = samples_of(layers(), run, found, np.ones((1, POINTS)))
    for got, want in ((samples.theta[0], run.true_theta[0]), (samples.phi[0], run.true_phi[0])):
        # 0.4 dwells of h = 2π 3/128 each: the rises' own error, 0.4 h³/6 of 6 mrad.
        assert np.abs(got - want)[2:-2].max() < 2e-6
        assert np.abs(got - want).max() < 4e-6
    for corrects in (True, False):
        known = scenario()
        scan = known.following.model_copy(update={"correct_delay": corrects})
        sensor = TargetSensor([known.model_copy(update={"scan": scan})], None)  # type: ignore[arg-type]
        order = TrackCommand(TrackMode.TRACK, np.array([0.1, -0.05, 9.0]), 6e-3, 0)
        angles = sensor.expect([order], run, np.array([3]), np.array([0])).angles
        lag, raw = known.scanner.galvanometers.readout_delay, read(Encoders([known]), 3)[None]
        assert lag > 0.0
        np.testing.assert_array_equal(angles, angles_later(run.time, raw, lag) if corrects else raw)


@pytest.mark.usefixtures("device")
def test_what_is_expected_of_a_visit_is_that_of_its_range() -> None:
    """Claim: the beam's σ over the range in rad, and the σ of the image on the line in pixels, not its variance."""
    known = scenario()
    scanner = known.scanner
    for distance in (3.0, 9.0):
        order = TrackCommand(TrackMode.TRACK, np.array([0.1, -0.05, distance]), 6e-3, 0)
        sensor = TargetSensor([known], None)  # type: ignore[arg-type]
        found = sensor.expect([order], motion(), np.array([3]), np.array([0]))
        beam = 0.5 * float(scanner.laser.radius(distance))
        assert found.spot == pytest.approx([beam / distance], rel=1e-6)
        across = beam * scanner.receiver.focal_length / distance
        spread = math.hypot(scanner.receiver.aberration, scanner.position_sensor.diffusion)
        width = math.hypot(across, spread) / scanner.position_sensor.pitch
        assert found.image == pytest.approx([width], rel=1e-6)


def test_fused_ranges_are_taken_where_there_are_two() -> None:
    samples = samples_of(layers("fused."), motion(), np.zeros((1, 2, POINTS)), np.ones((1, POINTS)))
    assert (samples.range == 10.0).all()
    assert (samples.sigma_range == 2e-3).all()
    assert (samples.status == 1).all()


def test_signals_err_by_noise_speckle_and_model() -> None:
    """Claim: σ² = σ_N² + (0.005 N)² and, in coherent light, the speckle's relative variance times N²."""
    known = load_scenario(
        {
            "schema": 1,
            "scanner": {"laser": {"speckle": False}},
            "scene": {"objects": [DISC]},
            "scan": {"type": "track", "targets": ["node"]},
        }
    )
    given, run, image = layers(), motion(), np.ones(1)
    sigma = SignalNoise(known).sigma(given, SignalNoise(known).speckle(run, np.array([9.0])), image)
    np.testing.assert_allclose(sigma, np.sqrt(50.0**2 + (5e-3 * given["Y"]) ** 2), rtol=1e-12)
    grainy = SignalNoise(scenario())
    speckle = grainy.speckle(run, np.array([9.0]))
    assert speckle is not None
    assert (speckle.light > 1e-6).all()
    wanted = np.sqrt(50.0**2 + (5e-3**2 + speckle.light) * given["Y"] ** 2)
    np.testing.assert_allclose(grainy.sigma(given, speckle, image), wanted, rtol=1e-12)


def test_echoes_err_by_noise_and_by_one_per_cent() -> None:
    """Claim: of a photodiode σ² = σ_N² + (0.01 N)² + the speckle's part of N², and what is not known counts as none."""
    known = scenario().replace({"ranging": "tof"})
    given = layers()
    given["Y"] = np.where(np.arange(POINTS) % 5 == 0, np.nan, given["Y"])
    noise = SignalNoise(known)
    speckle = noise.speckle(motion(), np.array([9.0]))
    assert speckle is not None
    wanted = np.sqrt(50.0**2 + (0.01**2 + speckle.light) * np.nan_to_num(given["Y"]) ** 2)
    np.testing.assert_allclose(noise.sigma(given, speckle, np.ones(1)), wanted, rtol=1e-12)


@pytest.mark.parametrize("width", [0.8, 1.6])
def test_voxels_without_a_spot_may_hold_what_none_is_found_of(width: float) -> None:
    """Claim: where nothing was found light is even from none to the least that is found, which stands as high over the
    noise of its brightest pixel as the threshold asks: σ is 1/√12 of it; of two patterns each has its own image's."""
    known = scenario()
    given = {name: np.concatenate([values, values]) for name, values in layers().items()}
    given["Y"] = np.where(np.arange(POINTS) % 3 == 0, 0.0, given["Y"])
    # An edge of the background beneath some of them.
    given["sigma_Y"] = np.where(np.arange(POINTS) % 6 == 0, 5e3, given["sigma_Y"])
    found = SignalNoise(known).sigma(given, None, np.array([width, 1.0]))
    pixel = 50.0 / np.sqrt(9.0 + 81.0 * 0.2104 / 2.0)
    for row, s in enumerate((width, 1.0)):
        brightest = pixel_shares(20.0, s, 41).max()
        even = known.processing.threshold * pixel / brightest / np.sqrt(12.0)
        np.testing.assert_allclose(found[row, ::3], even, rtol=1e-6)
    np.testing.assert_allclose(found[:, 1::3], np.hypot(50.0, 5e-3 * given["Y"][:, 1::3]), rtol=1e-12)


def test_speckle_of_a_resting_beam_is_that_of_its_packets() -> None:
    """Claim: C²/M with M = 1 + √π x + π²x², x = (w/2) D/(λ R), the beam's image over λN."""
    known = scenario()
    laser, receiver = known.scanner.laser, known.scanner.receiver
    still = replace(motion(), travel_theta=np.zeros((1, POINTS)), travel_phi=np.zeros((1, POINTS)))
    distance = 9.0
    x = 0.5 * laser.radius(distance) * receiver.aperture / (laser.wavelength * distance)
    wanted = known.processing.speckle_contrast**2 / (1.0 + np.sqrt(np.pi) * x + np.pi**2 * x**2)
    found = SignalNoise(known).speckle(still, np.array([distance]))
    assert found is not None
    np.testing.assert_allclose(found.light, wanted, rtol=1e-5)


@pytest.mark.parametrize(("ranging", "by_line"), [("triangulation", 1.0), ("tof", None), ("both", 0.9)])
def test_the_tracker_knows_how_well_it_points(
    device: Device, monkeypatch: pytest.MonkeyPatch, ranging: str, by_line: float | None
) -> None:
    """Claim: unseen jitter, noise and step of the encoders, and the third difference of what they read, by squares; and
    how much of its ranges comes from a base: of σ of 1 mm and of 3 mm by pulses 3²/(1 + 3²)."""
    known = scenario(jitter=4e-6, jitter_seen=0.25, readout_noise=3e-6, readout_step=12e-6)
    known = known.model_copy(update={"ranging": ranging})
    told: dict[str, Any] = {}

    class AskedError(Exception):
        pass

    def ask(*_: Any, **asked: Any) -> None:
        told.update(asked)
        raise AskedError

    class Instrument:
        def measure(self, *_: Any) -> dict[str, NDArray[Any]]:
            return layers("fused.") | {"tof.sigma_range_m": np.full((1, POINTS), 3e-3)}

    monkeypatch.setattr(voxels, "measure_target", ask)
    target = known.targets[0]
    order = TrackCommand(TrackMode.TRACK, np.array([0.1, -0.05, 9.0]), 6e-3, 0)
    sensor, numbers = TargetSensor([known], Instrument()), (np.array([3]), np.array([0]))
    measured = sensor.measure(motion(), *numbers)
    with pytest.raises(AskedError):
        sensor.see(target, measured, sensor.expect([order], motion(), *numbers))
    angles = read(Encoders([known]), 3)[None]
    white = 0.75 * 4e-6**2 + 3e-6**2 + 12e-6**2 / 12.0
    np.testing.assert_allclose(told["pointing"], np.sqrt(white + unevenness(angles) ** 2), rtol=1e-9)
    assert told["spot"] == pytest.approx(float(known.scanner.laser.radius(9.0)) / 18.0)
    assert told["axis_separation"] == known.scanner.mirrors.axis_separation
    assert told["by_line"] == (None if by_line is None else pytest.approx(by_line))


def test_a_jump_of_the_acceleration_shows_as_a_third_difference() -> None:
    """Claim: of a jump by Δa in a dwell T up to Δa T²/12 is unknown; an even acceleration leaves nothing."""
    index = np.arange(40.0)
    even = np.stack([0.3 * index**2, -0.1 * index**2])
    np.testing.assert_allclose(unevenness(even[None]), 0.0, atol=1e-12)
    jump = even + np.stack([0.0 * index, 0.5 * 2e-3 * np.maximum(index - 20.0, 0.0) ** 2])
    (found,) = unevenness(jump[None])
    # The third difference of ½ Δa k² from k = 20 on is at most Δa, here half of it twice.
    third = np.abs(np.diff(jump[1], 3)).max()
    assert found.max() == pytest.approx(third / 12.0)
    assert third == pytest.approx(1e-3, rel=1e-6)
    assert set(np.flatnonzero(found > 1e-9)) <= set(range(17, 24))


def test_a_point_and_its_derivatives_are_the_judges() -> None:
    """Claim: x, y, z of a place are eq 3, and their derivatives those of it by Θ, φ and R."""
    place, separation = np.array([0.2, -0.3, 7.0]), 0.05
    point, slopes = point_of(place, separation)

    def at(where: Array) -> Array:
        return np.asarray(judge.point_from_shot(where[2], where[0], where[1], separation))

    np.testing.assert_allclose(point, at(place), rtol=1e-12)
    for axis, step in enumerate((1e-6, 1e-6, 1e-4)):
        change = step * np.eye(3)[axis]
        slope = (at(place + change) - at(place - change)) / (2.0 * step)
        np.testing.assert_allclose(slopes[:, axis], slope, rtol=1e-7, atol=1e-9)


def test_a_saved_state_is_read_as_it_was(tmp_path: Path) -> None:
    """Claim: every number of a run's state survives its file: none of them is at its first value."""
    known = scenario()
    start = first_state(known.targets, known.scan.tracker)  # type: ignore[union-attr]
    rng = np.random.default_rng(3)
    root = rng.normal(size=(6, 6))
    track = TrackState(
        mode=TrackMode.LOST,
        motion=Motion(
            np.array([0.1, -0.2, 8.0, 0.01, 0.02, 0.03]), root @ root.T + np.eye(6), np.float64(1.23456789)
        ),
        expected=np.array([0.3, -0.1, 7.5]),
        patterns=11,
        seen=2,
        missed=3,
        searched=4,
        refusal=Refusal.SIZE,
        told=True,
    )
    others = [
        replace(track, mode=mode, refusal=refusal) for mode, refusal in zip(TrackMode, Refusal, strict=False)
    ]
    mirrors = start.mirrors
    moved = replace(
        mirrors,
        state=mirrors.state._replace(
            angle=np.array([0.11, -0.12]),
            rate=np.array([1.5, -2.5]),
            command=np.array([0.13, -0.14]),
        ),
        slope=np.array([0.7, -0.8]),
        time=3.21,
    )
    state = replace(
        start,
        visits=17,
        clock=4.5678901234567,
        mirrors=moved,
        turn=2,
        skipped=1,
        tracks=tuple(others),
        followed=tuple(number != 1 for number in range(len(others))),
        amplitudes=tuple(None if number == 0 else 1e-3 * number for number in range(len(others))),
        used=InUse(
            (("node", Move(time=1.1, position=(0.1, 0.2, 9.3), velocity=(0.1, 1.0 / 3.0, 0.0))),),
            LightChange(time=0.7, sun=(0.1, -0.7, 1.0 / 3.0), visible=0.3),
        ),
        said=("it began in the dark", "and alone"),
    )
    save_state(tmp_path / "state.json", state, "the scenario", "the program")
    read, text = load_state(tmp_path / "state.json")
    assert text == "the scenario"
    for name in ("visits", "clock", "turn", "skipped", "followed", "amplitudes", "used", "said"):
        assert getattr(read, name) == getattr(state, name)
    for name in ("angle", "rate", "command"):
        np.testing.assert_array_equal(getattr(read.mirrors.state, name), getattr(moved.state, name))
    np.testing.assert_array_equal(read.mirrors.slope, moved.slope)
    assert read.mirrors.time == moved.time
    for one, other in zip(read.tracks, state.tracks, strict=True):
        for name in ("mode", "patterns", "seen", "missed", "searched", "refusal", "told"):
            assert getattr(one, name) == getattr(other, name)
        np.testing.assert_array_equal(one.expected, other.expected)
        for name in ("mean", "covariance", "time"):
            np.testing.assert_array_equal(getattr(one.motion, name), getattr(other.motion, name))


def test_a_run_begins_straight_ahead_with_all_targets_to_be_found() -> None:
    """Claim: the mirrors rest at (0, 0) at the time 0, nothing was visited or skipped, and every target is followed,
    with the amplitude that the tracker chooses, and is looked for where it is expected."""
    known = scenario()
    state = first_state(known.targets, known.following.tracker)
    assert (state.visits, state.clock, state.turn, state.skipped) == (0, 0.0, 0, 0)
    for part in (*state.mirrors.state, state.mirrors.slope):
        np.testing.assert_array_equal(part, np.zeros(2))
    assert state.mirrors.time == 0.0
    assert (state.followed, state.amplitudes) == ((True,), (None,))
    (track,), (target,) = state.tracks, known.targets
    np.testing.assert_array_equal(track.expected, target.expected)
    assert track.mode is TrackMode.SEARCH
