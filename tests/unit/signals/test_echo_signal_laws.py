"""Echoes and speckle on their way to numbers: arrivals, shot noise, filters, edges, and what is kept of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import SHARP, Digitiser, Photodiode, Pulse
from scipy.special import ndtr
from scipy.stats import multivariate_normal, norm

from scanner_sim.analytic import speckle as judge
from scanner_sim.detector.line.speckle import line_speckle
from scanner_sim.detector.photodiode.pulse_response import PulseResponse
from scanner_sim.detector.photodiode.waveform import BLOCK, ClockErrors, Waveforms, arrive, record
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.time_of_flight import EchoDelays, TimeOfFlight
from scanner_sim.optics.speckle import Optics
from scanner_sim.ranging.ranges import Deflections
from scanner_sim.render.beam.surface_positions import SurfacePositions
from scanner_sim.scan.protocol import Aim
from scanner_sim.signals.waveform.calibration import peak_of, send
from scanner_sim.signals.waveform.detection import PulseDetector
from scanner_sim.signals.waveform.edge_noise import ShotCourse, Tap, delay_variance
from scanner_sim.signals.waveform.edge_timing import three_samples, vertex
from scanner_sim.signals.waveform.edges import _send_pulses, cross
from scanner_sim.signals.waveform.filter import (
    MatchedFilter,
    Noise,
    SampledPulse,
    false_alarm_probability,
)
from scanner_sim.signals.waveform.settings import PulseDetection

Array = NDArray[np.float64]
LIGHT = 299792458.0
QUIET = {"shot": False, "amplifier": False, "saturation": False, "quantisation": False, "clock": False}

pytestmark = pytest.mark.usefixtures("device")


def diode(*on: str, **more: Any) -> Photodiode:
    return Photodiode(**{"noise": QUIET | dict.fromkeys(on, True), **more})


def echoes(share: float, path: float, spread: float, reference: float, shots: int = 1) -> Any:
    """Return one echo of each of some shots."""
    values = [dr.full(auto.Float, value, shots) for value in (share, path, spread, reference)]
    return SimpleNamespace(**dict(zip(("amount", "position", "sigma", "reference"), values, strict=True)))


def arrived(digitiser: Digitiser, *echo: float, shots: int = 1, clock: bool = False) -> dict[str, Array]:
    """Return time of arrival [sample], variance [sample²] and power of the echoes."""
    known = diode("clock") if clock else diode()
    made = arrive(
        echoes(*echo, shots=shots), dr.arange(auto.UInt32, shots), Pulse(energy=2e-6), known, digitiser, 1
    )
    first, position = made.first.numpy().astype(np.float64), made.position.numpy().astype(np.float64)
    return {"when": first + position, "variance": made.variance.numpy(), "power": made.power.numpy()}


def test_an_echo_arrives_after_its_path() -> None:
    """Claim: 40 m and 3.2 m more are 43.2 m/c after the pulse, counted from the record's start; 30 mm of spread are
    0.03/c; its power is that of the pulse's energy in a sample."""
    digitiser = Digitiser(rate=2e9, gate=(10.0, 30.0), jitter=0.0)
    found = arrived(digitiser, 1e-9, 3.2, 0.03, 40.0)
    assert found["when"][0] == pytest.approx((43.2 / LIGHT - digitiser.start) * 2e9, abs=2e-5)
    assert found["variance"][0] == pytest.approx((0.03 / LIGHT * 2e9) ** 2, rel=1e-5)
    assert found["power"][0] == pytest.approx(1e-9 * 2e-6 * 2e9, rel=1e-5)


def test_what_comes_after_the_next_pulse_folds_back() -> None:
    """Claim: at 20 kHz 15 040 m of path arrive as 50 µs · c less."""
    digitiser = Digitiser(rate=1e9, gate=(10.0, 30.0), jitter=0.0)
    found = arrived(digitiser, 1e-9, 0.0, 0.0, 15040.0)
    assert found["when"][0] == pytest.approx((15040.0 / LIGHT - 50e-6 - digitiser.start) * 1e9, abs=1e-4)


def test_a_fast_clock_counts_more_and_an_uneven_one_scatters() -> None:
    """Claim: 1 % more samples to the same echo; 200 ps are 0.2 samples, which 4000 shots tell to 1.1 %: 5 % are 4.5 of
    it."""
    drifting = Digitiser(rate=1e9, gate=(10.0, 30.0), jitter=0.0, drift=0.01)
    found = arrived(drifting, 1e-9, 3.2, 0.0, 40.0, clock=True)
    wanted = (43.2 / LIGHT * 1.01 - drifting.start) * 1e9
    assert found["when"][0] == pytest.approx(wanted, abs=1e-4)
    uneven = Digitiser(rate=1e9, gate=(10.0, 30.0), jitter=200e-12)
    assert arrived(uneven, 1e-9, 3.2, 0.0, 40.0, shots=4000, clock=True)["when"].std() == pytest.approx(
        0.2, rel=0.05
    )


def test_light_brings_its_shot_noise() -> None:
    """Claim: at the top of a long pulse, far above its electronics, the variance is 2qM²F R₀B times the power there.

    Of 2000 shots a variance is known to 3.2 %: 15 % are 4.5 of it. Dark currents and amplifier are off.
    """
    known = diode("shot", bulk_dark_current=0.0, surface_dark_current=0.0)
    digitiser = Digitiser(rate=1e9, gate=(3.0, 12.0), jitter=0.0)
    pulse = Pulse(energy=2e-6, width=20e-9)
    made = record(
        echoes(1e-6, 0.0, 0.0, 15.0, 2000), dr.arange(auto.UInt32, 2000), pulse, known, digitiser, 1
    )
    current = made.records().astype(np.float64) * digitiser.step(known.saturation)
    sigma = 20e-9 / 2.3548200450309493
    peak = 1e-6 * 2e-6 / (math.sqrt(2.0 * math.pi) * sigma)
    top = round((15.0 / LIGHT - digitiser.start) * 1e9)
    band = 1.0 / (4.0 * math.sqrt(math.pi) * known.response_sigma)
    wanted = 2.0 * 1.602176634e-19 * 100.0 * 5.545 * 0.95 * band * peak
    assert current[:, top].mean() == pytest.approx(9.5 * peak, rel=0.02)
    assert current[:, top].var() == pytest.approx(wanted, rel=0.15, abs=0.0)


def test_a_timing_filter_is_blind_to_height_and_tells_delay_one_to_one() -> None:
    """Claim: at each phase taps · pulse = 0 and taps · derivative = 1 of a lopsided pulse, by differences of it."""
    response = PulseResponse.of(Pulse(shape="t2_exponential", width=3e-9), 1e9)
    made = MatchedFilter.of(response, Noise(coloured=1.0, white=0.1, per_current=0.0, sigma=0.66))
    pulse = SampledPulse(response, 0.66)
    away = np.arange(-made.half, made.half + 1.0)
    assert made.search @ pulse.values(away) == pytest.approx(1.0)
    for phase, taps in zip(np.arange(-64, 65) / 64, made.shift, strict=True):
        shape = pulse.values(away - phase)
        slope = (pulse.values(away - phase - 1e-3) - pulse.values(away - phase + 1e-3)) / 2e-3
        assert taps @ shape == pytest.approx(0.0, abs=1e-6)
        assert taps @ slope == pytest.approx(1.0, rel=2e-3)
        assert made.amplitude[round(64 * phase) + 64] @ shape == pytest.approx(1.0, rel=1e-9)


def test_a_pulse_is_heard_down_to_a_share_of_its_peak() -> None:
    """Claim: a Gaussian of 10 samples falls to 1e-4 of its peak at 10 √(2 ln 1e4) = 42.9, and to half over 23.5."""
    pulse = SampledPulse(PulseResponse(64.0), 6.0)
    assert pulse.half == 43 + 2
    assert pulse.width == pytest.approx(20.0 * math.sqrt(2.0 * math.log(2.0)), abs=0.1)


def test_nothing_of_a_pulse_arrives_outside_of_its_span() -> None:
    """Claim: less than 1e-9 of pulses of 3, smoothed by 4 samples, is left outside of either end."""
    low, high = PulseResponse(9.0).span(16.0)
    assert high == -low
    assert norm.sf(high / 5.0) < 1e-9


@pytest.mark.parametrize("neighbour", [0.3, -0.2, 0.8])
def test_noise_crosses_a_threshold_as_often_as_two_normal_numbers_do(neighbour: float) -> None:
    """Claim: 1 − exp(−Q(T) − (n − 1) P(y₀ ≤ T < y₁)), the latter of SciPy's bivariate normal distribution."""
    both = multivariate_normal([0.0, 0.0], [[1.0, neighbour], [neighbour, 1.0]]).cdf([-2.5, -2.5])
    upwards = norm.sf(2.5) - both
    wanted = 1.0 - math.exp(-norm.sf(2.5) - 49.0 * upwards)
    assert false_alarm_probability(2.5, 50, neighbour) == pytest.approx(wanted, rel=1e-3)


@dataclass
class Records:
    """Records one behind the other."""

    values: Array

    @property
    def shots(self) -> int:
        return len(self.values)

    @property
    def samples(self) -> int:
        return self.values.shape[1]

    @property
    def number(self) -> Any:
        return auto.Float(self.values.astype(np.float32).ravel())

    def address(self, sample: Any, place: Any) -> Any:
        return place * self.samples + sample


def test_each_record_has_its_own_three_samples_about_its_own_peak() -> None:
    records: Any = Records(np.arange(12.0).reshape(2, 6))
    found = three_samples(records, auto.UInt32([1, 4]), auto.Bool([True, True]))
    assert [part.numpy().tolist() for part in found] == [[0.0, 9.0], [1.0, 10.0], [2.0, 11.0]]


def test_a_level_is_crossed_on_chords_between_samples() -> None:
    """Claim: 0 2 10 9 1 0 rises through 6 half-way from its second to its third sample, and falls 3/8 behind its
    fourth: 1.875 samples lie between."""
    records: Any = Records(np.array([[0.0, 2.0, 10.0, 9.0, 1.0, 0.0], [5.0, 7.0, 8.0, 7.0, 6.5, 6.2]]))
    edges = cross(records, auto.UInt32([2, 2]), auto.Float([6.0, 6.0]), auto.Bool([True, True]))
    assert edges.sample.numpy()[0] == 1
    found = [float(part.numpy()[0]) for part in (edges.lead, edges.tail, edges.width, edges.rise, edges.fall)]
    assert found == pytest.approx([0.5, 0.375, 1.875, 8.0, 8.0])
    assert edges.whole.numpy().tolist() == [True, False]


def test_pulses_are_behind_their_rising_edge_by_the_root_of_a_logarithm() -> None:
    """Claim: a Gaussian of A times the level is σ√(2 ln A) behind, and twice that wide, for samples a tenth of σ apart.

    A chord errs by at most h²/8 V''/V', which is (t/σ² − 1/t)/8 at the distance t from the middle; 2e-3 for rounding.
    """
    digitiser = Digitiser(rate=1e10)
    known = diode("saturation", bandwidth=5e8)
    ratios = np.array([2.0, 8.0, 50.0])
    width, lead, delay = _send_pulses(Pulse(), known, digitiser, 100.0, ratios, 7, 0.3)
    sigma = math.hypot(2e-9 / 2.3548200450309493, known.response_sigma) * 1e10
    for row, ratio in enumerate(ratios):
        behind = sigma * math.sqrt(2.0 * math.log(ratio))
        chord = (behind / sigma**2 - 1.0 / behind) / 8.0 + 2e-3
        np.testing.assert_allclose(delay[row], behind, atol=chord)
        np.testing.assert_allclose(width[row], 2.0 * behind, atol=2.0 * chord)
    assert np.ptp(lead) > 0.5


class Held:
    """Values as an array on the device holds them."""

    def __init__(self, *values: float) -> None:
        self.values = np.array(values)

    def numpy(self) -> Any:
        return self.values


def test_what_was_timed_is_kept_in_seconds_and_in_its_place() -> None:
    timed = EchoDelays.empty(3)
    found = SimpleNamespace(
        seconds=lambda digitiser: np.array([5e-8, 6e-8]), sigma=Held(0.25, 0.5), signal=Held(1.0, 2.0),
        sigma_signal=Held(0.1, 0.3), snr=Held(30.0, 40.0), echoes=Held(1, 2), status=Held(0, 0),
    )  # fmt: skip
    timed.fill(np.array([2, 0], dtype=np.uint32), found, Digitiser(rate=2e9))
    np.testing.assert_allclose(timed.sigma, [2.5e-10, np.nan, 1.25e-10], rtol=1e-12)
    np.testing.assert_allclose(timed.delay, [6e-8, np.nan, 5e-8], rtol=1e-12)
    np.testing.assert_array_equal(timed.signal, [2.0, 0.0, 1.0])
    np.testing.assert_allclose(timed.sigma_signal, [0.3, 0.0, 0.1], rtol=1e-7)
    np.testing.assert_array_equal(timed.echoes, [2, 0, 1])


def test_an_echos_height_is_told_in_electrons() -> None:
    """Claim: 6 µA of pulses whose electron makes 2 pA are 3 million electrons."""
    unit = object.__new__(TimeOfFlight)
    unit.unit = SimpleNamespace(digitiser=Digitiser())  # type: ignore[assignment]
    unit.__dict__["amperes_per_electron"] = 2e-12
    found = SimpleNamespace(
        seconds=lambda digitiser: np.array([5e-8]), sigma=Held(0.25), signal=Held(6e-6),
        sigma_signal=Held(2e-7), snr=Held(30.0), echoes=Held(1), status=Held(0),
    )  # fmt: skip
    group = SimpleNamespace(index=np.array([0]), delays=found)
    unit.listen = lambda *_, **__: (None, Held(1e-9), iter([group]))  # type: ignore[method-assign]
    unit.ranges = lambda timed, _: timed  # type: ignore[method-assign,assignment,return-value]
    one = np.zeros(1)
    layers = unit.measure(
        Aim(np.zeros(1, np.uint32), *[one] * 5), None, Deflections(one, one, one, one)
    ).layers
    assert layers["tof.Y"] == pytest.approx([3e6])
    assert layers["tof.snr_detection"] == pytest.approx([30.0])
    assert layers["tof.sigma_Y"] == pytest.approx([1e5])


PIXELS, MIDDLE = 41, 20.2


@dataclass
class Light:
    """One spot of each shot."""

    amount: Any
    position: Any
    sigma: Any
    coherence: Any
    shots: int
    count: int = 1


@pytest.mark.parametrize("travel", [0.0, 1.5])
def test_speckle_on_the_line_has_the_variances_of_its_packets(travel: float) -> None:
    """Claim: of 4000 spots that share nothing the energy varies as the judge's packets do, C² v left₀, and the centroid
    by C² (left₁ σ²/2 v + left₀ σ_a² v'), left what a dwell leaves while the beam passes 1.5 of its radii.

    A variance of 4000 is known to 2.3 %; the program's packets are good to 2 %: 13 % are 4.5 of the one and the other.
    """
    shots, image, coherence = 4000, 2.0, 0.5
    optics = Optics(cell=0.5, aberration=1.4, diffusion=1.0, modes=8)
    sigma = math.sqrt(image**2 + optics.aberration**2 + optics.diffusion**2)
    light = Light(*(dr.opaque(auto.Float, value, shots) for value in (1.0, MIDDLE, sigma, coherence)), shots)
    row, column = np.divmod(np.arange(shots), 200)
    place = (5e-3 * column + 0.37e-3 * row % 1e-3, 5e-3 * row + 0.61e-3 * column % 1e-3)
    distance = 0.5e-3 / image  # the focal length is one pixel, the beam's radius 1 mm
    axes = [auto.Array3f(*(dr.full(auto.Float, float(k == n), shots) for k in range(3))) for n in range(3)]
    far = dr.full(auto.Float, distance, shots)
    point = auto.Array3f(*(auto.Float(values.astype(np.float32)) for values in place), far)
    places = SurfacePositions(
        point, axes[2], axes[0], axes[1], dr.full(auto.UInt32, 1, shots), 1e-3 + 0.0 * far, far
    )
    found = line_speckle(
        light, places, optics, 1.0, lambda _: SHARP, (travel * 1e-3 / distance, 0.0), PIXELS, 3
    )
    shot = dr.arange(auto.UInt32, shots)
    factors = np.stack(
        [found(dr.full(auto.UInt32, pixel, shots), shot).numpy() for pixel in range(PIXELS)], axis=1
    )
    mean = np.diff(ndtr((np.arange(PIXELS + 1) - 0.5 - MIDDLE) / sigma))
    lines = mean * factors.astype(np.float64)
    energy, slope = judge.pupil_averages(image / optics.cell)
    left = judge.averaged((travel * 1e-3, 0.0), 1e-3)
    whole = lines.sum(axis=1)
    assert whole.var() == pytest.approx(coherence * energy * left[0], rel=0.13)
    centroid = (lines - mean) @ (np.arange(PIXELS) - MIDDLE)
    wanted = coherence * (left[1] * 0.5 * image**2 * energy + left[0] * optics.aberration**2 * slope)
    assert centroid.var() == pytest.approx(wanted, rel=0.13)


def test_the_vertex_of_a_gaussian_is_its_own() -> None:
    """Claim: position and height of a Gaussian through three samples are exact, to single precision."""
    place, width = (part.ravel() for part in np.meshgrid(np.linspace(-0.5, 0.5, 9), (0.4, 0.8, 2.5)))
    samples = 40.0 * np.exp(-0.5 * ((np.arange(-1, 2)[:, None] - place) / width) ** 2)
    position, height = vertex(*(auto.Float(row.astype(np.float32)) for row in samples))
    np.testing.assert_allclose(position.numpy(), place, atol=1e-5)
    np.testing.assert_allclose(height.numpy(), 40.0, rtol=1e-6)


def test_the_variance_of_a_delay_has_all_covariances_of_its_samples() -> None:
    """Claim: wᵀ C w, with C of the electronics, of rounding and of the shot noise of the pulse.

    Set-up: a response of 3 samples, slow enough that shot noise is the light's variance smoothed by h² at the middle of
    two samples, times their correlation (moments of a product of two Gaussians). Tolerance: 0.5 % for the table.
    """
    digitiser, pulse, sigma = Digitiser(rate=1e9), Pulse(width=9e-9), 3.0
    shape = SampledPulse(PulseResponse.of(pulse, digitiser.rate), sigma)
    noise = Noise(coloured=4e-16, white=1e-16, per_current=3e-10, sigma=sigma)
    place, weight = np.array([0.0, 1.0, 1.0, 6.0]), np.array([2e5, -1e5, 4e5, 3e5])
    centroid, height = 4.3, 2e-6
    lag, middle = place[:, None] - place, 0.5 * (place[:, None] + place) - centroid
    widths = shape.response.variance + np.array([0.5, 1.0]) * sigma**2
    light = np.exp(-0.5 * middle**2 / widths[0]) * np.sqrt(widths[1] / widths[0])
    alike = np.exp(-0.25 * (lag / sigma) ** 2)
    covariance = alike * (noise.coloured + noise.per_current * height * light) + noise.white * (lag == 0.0)
    taps = [Tap(auto.Float(a), auto.Float(b)) for a, b in zip(place, weight, strict=True)]
    found = delay_variance(
        taps,
        noise,
        ShotCourse.of(shape),
        (auto.Float(centroid), auto.Float(height)),
        auto.Float(noise.coloured),
    )
    assert found[0] == pytest.approx(weight @ covariance @ weight, rel=5e-3)


def answers(
    detector: PulseDetector, line: Array, background: float = 0.0
) -> tuple[NDArray[np.intp], Array, float]:
    """Return which samples of a record are not clipped, by how much each moves the delay, and the stated σ [sample]."""
    near = np.flatnonzero((line > 0.0) & (line < detector.full - 1.0))
    lines = np.tile(line, (2 * near.size + 1, 1))
    step = 0.5
    lines[np.arange(near.size), near] += step
    lines[near.size + np.arange(near.size), near] -= step
    rows = np.zeros((-(-len(lines) // BLOCK) * BLOCK, line.size), dtype=np.float32)
    rows[: len(lines)] = lines
    packed = rows.reshape(-1, BLOCK, line.size // 4, 4).transpose(0, 2, 1, 3).ravel()
    made = Waveforms(auto.Float(packed), len(lines), line.size, dr.full(auto.Float, background, len(lines)))
    delays = detector.detect(made)
    place = delays.sample.numpy() + delays.fraction.numpy().astype(np.float64)
    slopes = (place[: near.size] - place[near.size : -1]) / (2.0 * step)
    return near, slopes, float(delays.sigma.numpy()[-1])


@pytest.mark.parametrize(
    ("timing", "strength"), [("leading_edge", 0.3), ("constant_fraction", 0.3), ("matched_filter", 8.0)]
)
def test_edges_answer_to_each_sample_as_their_sigma_says(timing: str, strength: float) -> None:
    """Claim: in white noise alone σ² is that of a sample times the sum of the squares of ∂delay/∂sample.

    Set-up: one noise-free pulse, a third of the saturation and eight times (timed by its edges), each sample moved by
    itself; what is clipped stays. Expected: the differences. Tolerance: 3 %, the cells of the tables.
    """
    digitiser, pulse = Digitiser(rate=1e9, jitter=0.0), Pulse()
    known = diode("quantisation", "saturation")
    peak = peak_of(pulse, known, digitiser) * pulse.pulse_energy * digitiser.rate * known.amperes_per_watt
    light = np.array([strength * known.saturation / peak])
    record = send(light, np.array([100.37]), pulse, diode("saturation"), digitiser).records()[0]
    detector = PulseDetector(
        pulse, known, digitiser, PulseDetection(timing=timing, level=0.02 * known.saturation)
    )
    _, slopes, sigma = answers(detector, record)
    assert sigma == pytest.approx(math.sqrt(float(np.sum(slopes**2)) / 12.0), rel=0.03, abs=2e-4)


@pytest.mark.parametrize("rate", [1e9, 2e9])
def test_edges_without_noise_err_as_their_sigma_says(rate: float) -> None:
    """Claim: where nothing is noisy, σ is what the table of the walk leaves: the rms of errors over it is 1.

    Set-up: 40 heights from 1.5 times the level to 45 times, at 37 phases of the samples. Tolerance: a third, for
    the table tells the errors of widths within a quarter of a sample together.
    """
    digitiser, pulse, known = Digitiser(rate=rate, jitter=0.0), Pulse(), diode("saturation")
    peak = peak_of(pulse, known, digitiser) * pulse.pulse_energy * rate * known.amperes_per_watt
    light = np.repeat(np.geomspace(0.03, 0.9, 40), 37) * known.saturation / peak
    truth = np.tile(100.0 + np.arange(37) / 37.0, 40)
    detection = PulseDetection(timing="leading_edge", level=0.02 * known.saturation)
    found = PulseDetector(pulse, known, digitiser, detection).detect(
        send(light, truth, pulse, known, digitiser)
    )
    error = found.sample.numpy() + found.fraction.numpy().astype(np.float64) - truth
    assert np.abs(error).max() < 0.01
    assert np.sqrt(np.mean((error / found.sigma.numpy()) ** 2)) == pytest.approx(1.0, abs=0.33)


@pytest.mark.parametrize("noise", ["quantisation", "amplifier", "shot"])
@pytest.mark.parametrize("timing", ["matched_filter", "gaussian_fit"])
def test_a_timed_pulse_answers_to_correlated_samples_as_its_sigma_says(timing: str, noise: str) -> None:
    """Claim: σ² is the sum of ∂delay/∂sample twice over the covariance of samples, with each noise by itself.

    Set-up: a noise-free Gaussian pulse of a third of the saturation, each sample moved by itself. Expected: the
    differences, with the covariance of the converter's steps, of noise behind a Gaussian response h, or of shot noise,
    the integral of the light at its arrival and of as much even light as its peak, times h at both samples. Tolerance:
    0.3 %, for the pulse between the phases of the filter.
    """
    digitiser, pulse, place = Digitiser(rate=1e9, jitter=0.0), Pulse(), 100.37
    known = diode(noise, "saturation", bulk_dark_current=0.0, surface_dark_current=0.0)
    amperes = pulse.pulse_energy * digitiser.rate * known.amperes_per_watt
    light = 0.3 * known.saturation / (peak_of(pulse, known, digitiser) * amperes)
    line = send(np.array([light]), np.array([place]), pulse, diode("saturation"), digitiser).records()[0]
    detector = PulseDetector(pulse, known, digitiser, PulseDetection(timing=timing))
    even = 0.3 * known.saturation / known.amperes_per_watt
    near, slopes, sigma = answers(detector, line, even)
    lag, response = near[:, None] - near, known.response_sigma * digitiser.rate
    time, step = np.linspace(place - 60.0, place + 60.0, 6001, retstep=True)
    width = pulse.width * digitiser.rate / 2.3548200450309493
    power = even + light * pulse.pulse_energy * digitiser.rate * norm.pdf(time, place, width)
    at = norm.pdf(near[:, None], time, response)
    charge = 1.602176634e-19 * known.gain**2 * known.excess_noise * known.responsivity * digitiser.rate
    covariance = {
        "quantisation": (lag == 0) * digitiser.step(known.saturation) ** 2 / 12.0,
        "amplifier": np.exp(-0.25 * (lag / response) ** 2) * known.dark_variance,
        "shot": charge * step * (at * power) @ at.T,
    }[noise] / digitiser.step(known.saturation) ** 2
    assert sigma == pytest.approx(math.sqrt(slopes @ covariance @ slopes), rel=3e-3)


def test_a_clock_as_built_is_late_and_fast_by_what_it_departs() -> None:
    """Claim: a clock that is fast by 1e-4 counts so many more samples of a path, and one whose ranges read 5 mm too far
    adds 10 mm to the path."""
    digitiser = Digitiser(rate=2e9, gate=(10.0, 30.0), jitter=0.0)

    def when(clock: ClockErrors) -> float:
        made = arrive(
            echoes(1e-9, 3.2, 0.03, 40.0), auto.UInt32(0), Pulse(energy=2e-6), diode(), digitiser, 1, clock
        )
        return float(made.first.numpy()[0]) + float(made.position.numpy()[0])

    exact = when(ClockErrors())
    assert when(ClockErrors(scale=1e-4)) - exact == pytest.approx(43.2 / LIGHT * 2e9 * 1e-4, rel=2e-3)
    assert when(ClockErrors(zero=5e-3)) - exact == pytest.approx(0.01 / LIGHT * 2e9, rel=1e-3)


@pytest.mark.parametrize("background", [0.0, 3e-7])
@pytest.mark.parametrize("noise", ["quantisation", "amplifier", "shot"])
def test_a_search_has_a_threshold_by_the_noise_of_its_line(noise: str, background: float) -> None:
    """Claim: T √(sᵀ C s) of the taps s, C of the steps, of the electronics' noise and of even light's shot noise."""
    digitiser, known = Digitiser(rate=1e9), diode(noise)
    detector = PulseDetector(Pulse(), known, digitiser, PulseDetection(timing="matched_filter"))
    nothing = np.zeros(BLOCK * digitiser.samples, dtype=np.float32)
    coloured = known.dark_variance + background * known.light_variance
    taps = detector.filter.search
    lag = np.arange(taps.size)[:, None] - np.arange(taps.size)
    response, step = known.response_sigma * digitiser.rate, digitiser.step(known.saturation)
    covariance = coloured * np.exp(-0.25 * (lag / response) ** 2)
    if noise == "quantisation":
        covariance = covariance + (lag == 0) * step**2 / 12.0
    wanted = detector.threshold * math.sqrt(taps @ covariance @ taps) / step
    found = np.asarray(detector._threshold(auto.Float(coloured)).numpy()).ravel()[0]
    if wanted > 0.0:
        assert found == pytest.approx(wanted, rel=1e-5)
    empty = Waveforms(auto.Float(nothing), BLOCK, digitiser.samples, dr.full(auto.Float, background, BLOCK))
    silent = detector.detect(empty)
    assert (silent.status.numpy() == Status.BELOW_THRESHOLD).all()
    assert not silent.signal.numpy().any()
