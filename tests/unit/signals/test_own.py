"""Estimators of the user's own: what is registered, what is refused, and what they are told."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import own_estimators
import pytest
from prototype import Digitiser, Photodiode, Pulse
from scipy.special import ndtr

from scanner_sim import InputError, ScenarioError, load_scenario, register_peak, register_pulse, simulate
from scanner_sim.config import resolved_yaml, scenario_from_text
from scanner_sim.detector.photodiode.pulse_response import PulseResponse
from scanner_sim.detector.photodiode.waveform import BLOCK, Waveforms
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.render.device import Device
from scanner_sim.signals.line import own_peak
from scanner_sim.signals.line.calibration import SensorCalibration
from scanner_sim.signals.line.own_peak import KnownLines
from scanner_sim.signals.line.speckle import ExpectedSpeckle
from scanner_sim.signals.own import estimated
from scanner_sim.signals.processing import PEAKS
from scanner_sim.signals.waveform.detection import PulseDetector
from scanner_sim.signals.waveform.filter import Noise, SampledPulse, moments_of
from scanner_sim.signals.waveform.own_pulse import KnownRecords, _top, find_own_delays
from scanner_sim.signals.waveform.settings import PULSES, PulseDetection


@pytest.fixture(autouse=True)
def _forgotten() -> Iterator[None]:
    PEAKS.clear()
    PULSES.clear()
    yield
    PEAKS.clear()
    PULSES.clear()


def _mine(lines: Any, known: Any) -> Any:
    return np.full(len(lines), 5.0), np.ones(len(lines)), np.zeros(len(lines), dtype=int)


def _other(lines: Any, known: Any) -> Any:
    return _mine(lines, known)


@pytest.mark.parametrize(
    ("register", "taken"), [(register_peak, "gaussian"), (register_pulse, "leading_edge")]
)
def test_a_name_belongs_to_one_function(register: Callable[..., None], taken: str) -> None:
    """Claim: the same call twice does nothing; another function, a name of the program and what is none are refused."""
    register("mine", _mine)
    register("mine", _mine)
    for name, function, word in (
        ("mine", _other, "another function"),
        (taken, _mine, "of the program"),
        ("my peak", _mine, "no name"),
        ("../x", _mine, "no name"),
        ("late", 3, "no function"),
    ):
        with pytest.raises(InputError, match=word):
            register(name, function)


@pytest.mark.parametrize(
    ("register", "key", "call"),
    [
        (register_peak, "processing.peak", "register_peak"),
        (register_pulse, "processing.pulse.timing", "register_pulse"),
    ],
)
def test_a_scenario_names_what_is_registered(
    repo_root: Any, register: Callable[..., None], key: str, call: str
) -> None:
    """Claim: an unknown name is one fault with key, names and the call; a scenario that was stored still opens."""
    path = repo_root / "configs" / "plane.yaml"
    register("known", _mine)
    with pytest.raises(ScenarioError) as refused:
        load_scenario(path, [f"{key}=mine"])
    (fault,) = refused.value.faults
    assert fault.location.startswith(key)
    assert call in fault.remedy
    assert "MODULE:FUNCTION" in fault.remedy
    assert "known" in fault.remedy
    register("mine", _mine)
    scenario = load_scenario(path, [f"{key}=mine"])
    assert pickle.loads(pickle.dumps(scenario)) == scenario
    text = resolved_yaml(scenario)
    assert scenario_from_text(text, name="it") == scenario
    PEAKS.clear()
    PULSES.clear()
    assert scenario_from_text(text, name="it", stored=True) == scenario
    with pytest.raises(ScenarioError):
        scenario_from_text(text, name="it")
    with pytest.raises(ScenarioError, match="no estimator"):
        scenario_from_text(text.replace("mine", "m/ne"), name="it", stored=True)


def test_a_stored_scenario_is_refused_when_it_is_simulated_again(small_scenario: str) -> None:
    text = f"{small_scenario}processing: {{peak: mine}}\n"
    with pytest.raises(InputError, match="no estimator 'mine' is registered"):
        simulate(scenario_from_text(text, name="it", stored=True), device="cpu")


def test_the_programs_correction_is_not_for_others(repo_root: Any) -> None:
    register_peak("mine", _mine)
    with pytest.raises(ScenarioError, match="bias_correction: none"):
        load_scenario(
            repo_root / "configs/plane.yaml", ["processing.peak=mine", "processing.bias_correction=computed"]
        )


GOOD = np.zeros(3), np.ones(3), np.zeros(3, dtype=int)


@pytest.mark.parametrize(
    ("returned", "word"),
    [
        (None, "NoneType, not three"),
        (GOOD[:2], "tuple, not three"),
        ((np.zeros(4), *GOOD[1:]), r"\(4,\)"),
        ((np.zeros((3, 1)), *GOOD[1:]), r"\(3, 1\)"),
        ((["a", "b", "c"], *GOOD[1:]), "no arrays"),
        ((*GOOD[:2], np.zeros(3, dtype=bool)), "no code"),
        ((*GOOD[:2], np.zeros(3)), "no code"),
        ((*GOOD[:2], np.array([0, 1, 99])), "no code"),
        ((np.array([0.0, np.nan, np.inf]), *GOOD[1:]), "not finite, 2 of 3"),
        ((GOOD[0], np.array([1.0, np.nan, 1.0]), GOOD[2]), "σ is no number of 0 or more, 1 of 3"),
        ((GOOD[0], np.array([1.0, -1.0, 1.0]), GOOD[2]), "σ is no number"),
    ],
)
def test_nonsense_is_one_fault_that_names_the_estimator(returned: Any, word: str) -> None:
    with pytest.raises(InputError, match=word) as refused:
        estimated("mine", lambda: returned, 3)
    assert "'mine'" in str(refused.value)
    assert refused.value.remedy


@pytest.mark.parametrize(
    ("error", "said"),
    [(ZeroDivisionError("so it is"), "ZeroDivisionError: so it is"), (SystemExit(3), "SystemExit: 3")],
)
def test_an_estimator_that_fails_is_one_fault(error: BaseException, said: str) -> None:
    def failing() -> None:
        raise error

    with pytest.raises(InputError, match=f"'mine' fails: {said}"):
        estimated("mine", failing, 3)


def test_what_is_not_valid_has_no_position() -> None:
    place, sigma, status = estimated(
        "mine", lambda: ([1, np.nan], [np.nan, -1.0], [Status.AMBIGUOUS, Status.SATURATED]), 2
    )
    assert np.isnan(place).all()
    assert np.isnan(sigma).all()
    assert status.tolist() == [3, 2]


def test_a_position_lies_on_the_line(small_scenario: str) -> None:
    """Claim: −1/2 to the last pixel's edge, else one fault."""
    register_peak("mine", lambda lines, known: (np.full(len(lines), 255.6), *_mine(lines, known)[1:]))
    with pytest.raises(InputError, match="'mine' returns valid positions outside of the line, 0 to 255"):
        simulate(scenario_from_text(f"{small_scenario}processing: {{peak: mine}}\n", name="it"), device="cpu")


def test_a_delay_lies_in_the_record(small_scenario: str) -> None:
    register_pulse("mine", lambda records, known: (np.ones(len(records)), *_mine(records, known)[1:]))
    text = f"{small_scenario}ranging: tof\nprocessing: {{pulse: {{timing: mine}}}}\n"
    with pytest.raises(InputError, match="'mine' returns valid delays outside of the record"):
        simulate(scenario_from_text(text, name="it"), device="cpu")


@pytest.mark.usefixtures("device")
def test_sigma_with_speckle_is_that_of_the_programs_estimators(small_scenario: str) -> None:
    """Claim: Σ over the modes of speckle is the one of ``SpotSpeckle`` to single precision, wherever the spot lies."""
    instrument = Instrument(scenario_from_text(small_scenario, name="it"), device="cpu")
    line = instrument.triangulation
    position, theta = np.array([20.3, 57.5, 130.9]), np.array([0.0, 0.1, -0.2])
    steps, whole = np.arange(-3, 4), 3e6
    slope = np.cos(steps[:, None] + np.arange(3))
    gradient, centre = np.zeros((3, 256)), np.rint(position).astype(int)
    gradient[np.arange(3)[:, None], centre[:, None] + steps] = slope.T
    speckle = line.expected_speckle()
    known = KnownLines(1.0, 0.0, 0.0, 1.0, 6.0, theta, np.zeros((3, 256)), np.zeros(0), line.spot, speckle)
    sine, cosine = (auto.Float(of(theta)) for of in (np.sin, np.cos))
    spot = speckle.about(line.spot, auto.Int32(centre), sine, cosine)
    shift, sigma = auto.Float(position - centre), known.spot_sigma(position)
    # Charges whose sum is the share of the spot that the steps hold.
    share = ndtr((3.5 - position + centre) / sigma) - ndtr((-3.5 - position + centre) / sigma)
    charges = {int(step): auto.Float(whole * share / steps.size) for step in steps}
    slopes = {int(step): auto.Float(row) for step, row in zip(steps, slope, strict=True)}
    wanted = spot.propagated_variance(slopes, charges, shift).numpy()
    got = known.position_sigma(gradient, position, np.full(3, whole)) ** 2
    np.testing.assert_allclose(got, wanted, rtol=3e-5)
    few = replace(known, theta=theta[:1], variance=known.variance[:1])
    assert (
        few.position_sigma(gradient[:1], position[:1], np.full(1, whole)) ** 2 == got[0]
    )  # beside any other


def test_sigma_of_a_delay_is_that_of_correlated_noise() -> None:
    """Claim: with amplifier and converter noise it is the variance that the matched filter's moments have."""
    noise, rate = Noise(coloured=4.0, white=1.0, per_current=0.0, sigma=1.3), 2e9
    shape = SampledPulse(
        PulseResponse.of(Pulse(shape="gaussian", width=2e-9, peak_power=1e3, repetition_rate=2e4), rate), 1.3
    )
    weights = np.cos(np.arange(9.0))[None]
    moments = moments_of(weights, noise, shape, np.zeros(1))
    wanted = 4.0 * moments.coloured[0] + moments.white[0]
    time, gradient = 1.7e-8 + np.arange(40) / rate, np.zeros((1, 40))
    gradient[0, 11:20] = weights
    known = KnownRecords(time, 1.0, np.zeros(0), np.ones(1), np.array([4.0]), noise, shape)
    got = known.delay_sigma(gradient, np.ones((1, 40)))
    np.testing.assert_allclose(got**2, wanted, rtol=1e-12)
    known = KnownRecords(time, 1.0, np.zeros(0), np.ones(2), np.full(2, 4.0), noise, shape)
    both = np.concatenate([gradient, np.roll(gradient, 9, axis=1)])
    assert known.delay_sigma(both, np.ones((2, 40)))[0] == got[0]  # beside any other, to the bit
    # The pulse of 2 ns at half its height, behind a Gaussian of 1.3 samples.
    spread = np.hypot(2e-9 / (2.0 * np.sqrt(2.0 * np.log(2.0))), 1.3 / rate)
    apart = np.linspace(-3e-9, 3e-9, 25)
    np.testing.assert_allclose(known.pulse(apart), np.exp(-0.5 * (apart / spread) ** 2), atol=1e-6)


def test_the_numbers_given_are_the_instruments(small_scenario: str) -> None:
    """Claim: lines are charges above the dark level, with the instrument's numbers; no argument holds the truth."""
    seen: dict[str, Any] = {}

    def spy(lines: Any, known: Any) -> Any:
        seen.update(lines=lines, known=known)
        return own_estimators.centroid(lines, known)

    register_peak("spy", spy)
    scenario = scenario_from_text(f"{small_scenario}processing: {{peak: spy}}\n", name="it")
    image = simulate(scenario, device="cpu")
    known, sensor = seen["known"], scenario.scanner.position_sensor
    assert seen["lines"].shape == known.variance.shape == known.saturated.shape == (48, sensor.pixels)
    assert seen["lines"].dtype == np.float64
    assert (known.gain, known.pitch, known.read_noise) == (
        sensor.electrons_per_number, sensor.pitch, sensor.read_noise,
    )  # fmt: skip
    steps = (seen["lines"] + known.dark) / known.gain
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    np.testing.assert_allclose(np.sort(image["peak_px"].ravel()), np.sort(
        own_estimators.centroid(seen["lines"], known)[0]), rtol=2.0**-23)  # fmt: skip


def test_a_delay_is_a_sample_and_a_fraction_from_the_start(device: Device) -> None:
    """Claim: 12.75 and 30.25 samples after the record's start are kept to single precision, σ in samples; the height
    is that of the samples there, and over the noise of one without signal the ratio that is told. A record without an
    echo has no height, and σ is that noise. The threshold that a function is told is a current."""
    digitiser = Digitiser(rate=1e9)
    made = PulseDetector(Pulse(), Photodiode(), digitiser, PulseDetection())

    told: list[Any] = []

    def mine(records: Any, known: Any) -> Any:
        told.append(known)
        status = np.array([Status.VALID, Status.VALID, Status.BELOW_THRESHOLD])
        return known.time[0] + np.array([12.75, 30.25, 20.0]) / 1e9, np.full(3, 2e-10), status

    count = digitiser.samples
    heights = np.zeros((BLOCK, count), np.float32)
    heights[:3, 5:40] = [[30.0], [7.0], [1.0]]
    packed = heights.reshape(BLOCK, count // 4, 4).transpose(1, 0, 2).ravel()
    records = Waveforms(auto.Float(packed), 3, count, dr.zeros(auto.Float, 3))
    coloured = np.array([1e-12, 4e-12, 9e-12])
    heard = 4.0 * coloured
    found = made._detect_by(mine, records, auto.Float(heard.tolist()), auto.Float(coloured.tolist()))
    # Beside the noise that is told stands the converter's, a twelfth of a step's square.
    quiet = np.sqrt(coloured + made.step**2 / 12.0)
    # Three samples alike are a flat top: its height is theirs.
    wanted = np.array([30.0, 7.0, 0.0]) * made.step
    np.testing.assert_allclose(found.signal.numpy(), wanted, rtol=2e-5)
    np.testing.assert_allclose(found.snr.numpy(), wanted / quiet, rtol=3e-5)
    assert found.sigma_signal.numpy()[2] == pytest.approx(quiet[2], rel=1e-5)
    # The search counts in digital numbers, of which each is a step of the current.
    counted = made._threshold(auto.Float(heard.tolist())).numpy()
    np.testing.assert_allclose(told[0].threshold, counted * made.step, rtol=1e-6)
    np.testing.assert_allclose(told[0].coloured, coloured, rtol=1e-6)
    assert found.status.numpy().tolist() == [Status.VALID, Status.VALID, Status.BELOW_THRESHOLD]
    place = (found.sample.numpy() + found.fraction.numpy())[:2]
    np.testing.assert_allclose(place, [12.75, 30.25], rtol=1e-6)
    np.testing.assert_allclose(found.sigma.numpy()[:2], 0.2, rtol=1e-6)
    assert np.isnan(found.sigma.numpy()[2])


def test_sigma_of_a_delay_has_the_shot_noise_of_its_samples() -> None:
    """Claim: gᵀ C g with C = √(vᵢ vⱼ) ρ(i − j) + w δ, v the variance without signal and what each current adds."""
    rng, sigma = np.random.default_rng(3), 1.3
    noise = Noise(coloured=4.0, white=1.0, per_current=0.3, sigma=sigma)
    none: Any = None
    known = KnownRecords(np.arange(30) / 2e9, 1.0, np.zeros(0), np.ones(2), np.array([4.0, 7.0]), noise, none)
    gradient, currents = np.zeros((2, 30)), rng.uniform(-5.0, 90.0, (2, 30))
    gradient[:, 8:15] = rng.normal(size=(2, 7))
    lag = np.arange(30)[:, None] - np.arange(30)
    for row, dark in enumerate((4.0, 7.0)):
        root = np.sqrt(dark + 0.3 * np.maximum(currents[row], 0.0))
        covariance = np.outer(root, root) * np.exp(-0.25 * (lag / sigma) ** 2) + np.eye(30)
        wanted = math.sqrt(gradient[row] @ covariance @ gradient[row])
        assert known.delay_sigma(gradient, currents)[row] == pytest.approx(wanted, rel=1e-12)


def test_an_own_function_is_given_currents() -> None:
    """Claim: records in ampere, one digital number a step, and which samples are at the converter's end."""
    records = np.array([[0.0, 3.0, 100.0, 99.0], [1.0, 2.0, 3.0, 4.0]], dtype=np.float32)
    pulse: Any = SimpleNamespace(summit=0.0)
    noise = Noise(coloured=1.0, white=1.0, per_current=0.0, sigma=1.0)
    known = KnownRecords(np.arange(4) / 1e9, 2e-6, np.zeros(0), np.ones(2), np.ones(2), noise, pulse)
    given: list[Any] = []

    def own(currents: Any, about: Any) -> Any:
        given.append((currents, about.saturated, about.threshold))
        return np.full(2, 2e-9), np.full(2, 1e-10), np.zeros(2, dtype=np.uint32)

    find_own_delays("own", own, records, known, 100.0)
    currents, saturated, threshold = given[0]
    np.testing.assert_allclose(currents, 2e-6 * records, rtol=1e-7)
    np.testing.assert_array_equal(saturated, records >= 100.0)
    np.testing.assert_array_equal(threshold, 1.0)


def test_a_function_may_work_on_what_it_is_given(small_scenario: str) -> None:
    """Claim: what a function makes of its lines and records changes nothing of the light that is told beside it."""

    def wiping(estimator: Any) -> Any:
        def own(values: Any, known: Any) -> Any:
            found = estimator(values, known)
            values[:] = 0.0
            return found

        return own

    images = []
    for number, way in enumerate((lambda function: function, wiping)):
        register_peak(f"line{number}", way(own_estimators.centroid))
        register_pulse(f"echo{number}", way(own_estimators.pulse_vertex))
        processing = f"processing: {{peak: line{number}, pulse: {{timing: echo{number}}}}}\nranging: both\n"
        images.append(simulate(scenario_from_text(small_scenario + processing, name="it"), device="cpu"))
    assert (images[0]["status"] == 0).any()
    assert (images[0]["tof.status"] == 0).any()
    for name in images[0].channels:
        np.testing.assert_array_equal(images[1][name], images[0][name], err_msg=name)


def test_the_top_of_a_pulse_is_the_highest_of_three_samples() -> None:
    """Claim: those about the delay and the top's distance behind it, here 0.3 samples, but the record's ends."""
    pulse: Any = SimpleNamespace(summit=0.3)
    noise = Noise(coloured=1.0, white=1.0, per_current=0.0, sigma=1.0)
    known = KnownRecords(5e-9 + np.arange(9) / 1e9, 1.0, np.zeros(0), np.ones(6), np.ones(6), noise, pulse)
    currents = np.tile([9.0, 1.0, 8.0, 4.0, 3.0, 6.0, 7.0, 2.0, 5.0], (6, 1))
    # Tops at 4.1, 4.6 and 3.4 samples, at the beginning, at the end, and nowhere.
    delay = 5e-9 + np.array([3.8, 4.3, 3.1, -0.3, 7.7, math.nan]) / 1e9
    np.testing.assert_array_equal(_top(currents, delay, known)[:5], [5, 6, 2, 1, 7])


def test_some_of_the_shots_have_their_own_travel() -> None:
    """Claim: travel of each shot is cut as the shots are, one number for all is theirs, and a plain one stays."""
    ways = np.float32([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    for given, wanted in ((auto.Float(ways), ways[2:5]), (auto.Float(0.7), np.float32([0.7] * 3))):
        known = ExpectedSpeckle(optics=None, contrast=0.6, travel=(given, 0.25))  # type: ignore[arg-type]
        found = own_peak._of_rows(known, slice(2, 5), 6)
        np.testing.assert_array_equal(found.travel[0].numpy(), wanted)
        assert (found.travel[1], found.contrast) == (0.25, 0.6)


@pytest.mark.parametrize(
    ("sample", "inside"), [(-0.01, False), (0.0, True), (0.4, True), (3.0, True), (3.01, False)]
)
def test_a_delay_lies_within_its_record(sample: float, inside: bool) -> None:
    """Claim: valid delays are taken from the first sample's time to the last one's; others are refused, with both."""
    pulse: Any = SimpleNamespace(summit=0.0)
    noise = Noise(coloured=1.0, white=1.0, per_current=0.0, sigma=1.0)
    time = 5e-9 + np.arange(4) / 1e9
    known = KnownRecords(time, 2e-6, np.zeros(0), np.ones(2), np.ones(2), noise, pulse)

    def own(currents: Any, about: Any) -> Any:
        return np.array([6e-9, 5e-9 + sample / 1e9]), np.full(2, 1e-10), np.zeros(2, dtype=np.uint32)

    records = np.ones((2, 4), dtype=np.float32)
    if inside:
        assert find_own_delays("own", own, records, known, 100.0).delay[1] == 5e-9 + sample / 1e9
        return
    with pytest.raises(InputError, match="outside of the record, 5e-09 s to 8e-09 s"):
        find_own_delays("own", own, records, known, 100.0)


def test_sigma_of_a_place_is_that_of_its_pixels() -> None:
    """Claim: without speckle √Σ (∂p/∂f)² var f over the pixels of each line, and no line has a share of another's."""
    rng = np.random.default_rng(6)
    gradient, variance = rng.normal(size=(3, 40)), rng.uniform(1.0, 9.0, (3, 40))
    none: Any = None
    known = KnownLines(1.0, 0.0, 0.0, 1.0, 6.0, np.zeros(3), variance, np.zeros(0), none, None)
    found = known.position_sigma(gradient, np.full(3, 20.0), np.full(3, 1e9))
    np.testing.assert_allclose(found, np.sqrt((gradient**2 * variance).sum(axis=1)), rtol=1e-12)


def test_pixels_are_full_in_either_exposure() -> None:
    """Claim: from the number on that holds full well, dark charge and black level, with the laser or without."""
    calibration = SensorCalibration(10.0, 2.0, 60.0, 4.0, 400.0, 1.0, 0.1, 1500.0)
    lit = np.float32([[759.0, 760.0, 40.0, 40.0]])
    unlit = np.float32([[20.0, 20.0, 759.0, 760.0]])
    assert own_peak._full([lit, unlit], calibration).tolist() == [[False, True, False, True]]
    assert own_peak._full([lit], calibration).tolist() == [[False, True, False, False]]


def test_the_light_of_a_place_is_that_of_the_brightest_of_three_pixels() -> None:
    """Claim: of the nearest pixel and its neighbours, within the line; of the whole line where there is no place."""
    charge = np.array([[3.0, 9.0, 1.0, 5.0, 8.0, 7.0, 2.0]] * 6)
    charge = np.vstack([charge, [3.0, 4.0, 1.0, 5.0, 8.0, 7.0, 9.0]])
    place = np.array([2.3, 3.4, 5.6, -0.4, 6.4, np.nan, np.nan])
    assert own_peak._brightest(charge, place).tolist() == [1, 4, 5, 1, 5, 1, 6]


def test_lines_come_in_parts_with_what_belongs_to_them(
    monkeypatch: pytest.MonkeyPatch, small_scenario: str
) -> None:
    """Claim: 48 lines, at most 20 at once, have each their own deflection and noise, as all of them together have; read
    noise that is not made is not told."""
    seen: list[Any] = []

    def spy(lines: Any, known: Any) -> Any:
        seen.append([known.theta, known.variance, lines])
        assert {len(part) for part in seen[-1]} == {len(lines)}
        assert known.read_noise == 0.0
        return own_estimators.centroid(lines, known)

    register_peak("spy", spy)
    text = f"{small_scenario}processing: {{peak: spy}}\n"
    scenario = scenario_from_text(text, name="it", overrides=["scanner.position_sensor.noise.read=false"])
    simulate(scenario, device="cpu")
    monkeypatch.setattr(own_peak, "_TOGETHER", 20)
    whole, seen[:] = seen[0], []
    simulate(scenario, device="cpu")
    assert [len(part[0]) for part in seen] == [20, 20, 8]
    assert len(np.unique(whole[0])) == 8
    for number, column in enumerate(whole):
        np.testing.assert_array_equal(np.concatenate([part[number] for part in seen]), column)
