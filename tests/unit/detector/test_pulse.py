"""The pulse, the photodiode and the clock: what they say of themselves, and what they refuse."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import drjit.auto.ad as auto
import numpy as np
import pytest
from prototype import Digitiser, Laser, Photodiode, Pulse
from pydantic import ValidationError
from scipy.stats import norm

from scanner_sim.analytic import time_of_flight as judge
from scanner_sim.detector.photodiode.noise_colour import colouring_taps, correlation
from scanner_sim.detector.photodiode.photodiode import background_power
from scanner_sim.detector.photodiode.pulse_response import PulseResponse
from scanner_sim.foundation.errors import InputError
from scanner_sim.optics.pulse import read_pulse
from scanner_sim.render.device import Device
from scanner_sim.signals.waveform.detection import PulseDetector, pulse_detector
from scanner_sim.signals.waveform.edges import edge_table
from scanner_sim.signals.waveform.settings import PulseDetection


@pytest.mark.parametrize("shape", ["gaussian", "t2_exponential"])
def test_a_named_pulse_has_its_width_area_centroid_and_peak(shape: Any) -> None:
    """Half the peak spans the width; the area is the energy; the centroid is 0; the peak is the peak power."""
    pulse = Pulse(shape=shape, width=3e-9, peak_power=50.0)
    time, power = pulse.samples()
    above = time[power >= 0.5 * power.max()]
    assert above[-1] - above[0] == pytest.approx(3e-9, abs=2.1 * (time[1] - time[0]))
    assert np.trapezoid(power, time) == pytest.approx(1.0, abs=1e-6)
    assert abs(np.trapezoid(power * time, time)) < 1e-6 * pulse.sigma
    assert pulse.pulse_energy * power.max() == pytest.approx(50.0, rel=1e-5)


def test_the_preset_is_a_tenth_of_a_microjoule_twice() -> None:
    """100 W and 2 ns are 0.213 µJ, at 20 kHz 4.3 mW: below the 10 mW average of the preset."""
    assert Pulse().pulse_energy == pytest.approx(0.2129e-6, rel=1e-3)
    assert Pulse().mean_power < 10e-3
    assert Pulse(energy=1e-6).pulse_energy == 1e-6


def test_a_measured_pulse_is_read_centred_and_scaled(tmp_path: Path) -> None:
    file = tmp_path / "pulse.csv"
    file.write_text("# time, power\n5e-9,0\n6e-9,4\n8e-9,0\n")
    pulse = Pulse(shape=file, energy=1e-6)
    time, power = pulse.samples()
    # A triangle: its centroid is the mean of its corners.
    np.testing.assert_allclose(time, np.array([5.0, 6.0, 8.0]) * 1e-9 - 19e-9 / 3.0, atol=1e-18)
    assert power.max() == pytest.approx(2.0 / 3e-9)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "0 samples"),
        ("0,1\n1,1\n", "2 samples"),
        ("0,0\n1e-9,-1\n2e-9,0\n", "sample 2 is negative"),
        ("0,0\n2e-9,1\n1e-9,0\n", "sample 3 is not later"),
        ("0,0\n0,1\n1e-9,0\n", "sample 2 is not later"),
        ("0,0\n1e-9,0\n2e-9,0\n", "no power"),
        ("0,0\n1e-9,nan\n2e-9,0\n", "not finite"),
        ("0,0\n1e-9;1\n2e-9,0\n", "sample 2 is not two numbers"),
    ],
)
def test_a_bad_pulse_file_is_refused_with_its_reason(tmp_path: Path, text: str, problem: str) -> None:
    file = tmp_path / "pulse.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=problem):
        read_pulse(file)
    with pytest.raises(ValidationError, match=problem):
        Pulse(shape=file)


def test_a_pulse_files_text_is_taken_apart_once(tmp_path: Path) -> None:
    """Claim: the samples of the same text are the same arrays, which nobody may change; a text of the same length and
    date has its own, and so has a file of another name its own messages."""
    file, other = tmp_path / "pulse.csv", tmp_path / "other.csv"
    file.write_text("0,0\n1e-9,1\n2e-9,0\n")
    date = file.stat()
    first, again = read_pulse(file), read_pulse(file)
    assert all(one is same for one, same in zip(first, again, strict=True))
    for values in first:
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0
    file.write_text("0,0\n1e-9,3\n2e-9,0\n")
    os.utime(file, ns=(date.st_atime_ns, date.st_mtime_ns))
    assert read_pulse(file)[1].tolist() == [0.0, 3.0, 0.0]
    for path in (file, other):
        path.write_text("0,0\n")
        with pytest.raises(InputError, match=path.name):
            read_pulse(path)


@pytest.mark.parametrize("parts", [1, 2, 40])
@pytest.mark.parametrize("summit", [0.0, 1.0, 2.2, 3.0])
def test_a_pulse_of_few_samples_is_as_wide_as_their_polygon(
    summit: float, parts: int, tmp_path: Path
) -> None:
    """Claim: the variance of a triangle over 0 to 3 ns with the summit b is (9 + b² − 3 b)/18 ns², into however many
    parts its flanks are cut."""
    corners = np.unique([0.0, summit, 3.0])
    time = np.interp(np.arange(2 * parts + 1) / parts, np.linspace(0.0, 2.0, len(corners)), corners)
    power = np.interp(time, corners, np.where(corners == summit, 4.0, 0.0))
    file = tmp_path / "pulse.csv"
    np.savetxt(file, np.stack([1e-9 * time, power], axis=1), delimiter=",", fmt="%.17g")
    wanted = math.sqrt((9.0 + summit**2 - 3.0 * summit) / 18.0)
    assert Pulse(shape=file).sigma == pytest.approx(1e-9 * wanted, rel=1e-12)


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda: Pulse(peak_power=1.0, energy=1.0), "not both"),
        (lambda: Pulse(width=1e-6, repetition_rate=1e6), "longer than the period"),
        (lambda: Photodiode(gain=0.5), "greater than or equal to 1"),
        (lambda: Photodiode(bulk_dark_current=1e-4, gain=100.0), "dark current"),
        (lambda: Digitiser(gate=(5.0, 2.0)), "ascend"),
        (lambda: Digitiser(gate=(0.0, 1e6)), "samples per shot"),
        (lambda: Digitiser(rate=1.0), "greater than or equal to 1000000"),
    ],
)
def test_contradictions_are_faults(make: Any, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        make()


def test_a_record_must_hold_a_pulse_and_four_samples(device: Device) -> None:
    """Claim: of records some 13 samples apart those are refused that leave less than four beside a pulse."""
    pulse, taken, refused = Pulse(width=16e-9), {}, []
    for far in (4.0, 6.0, 8.0, 14.0):
        digitiser = Digitiser(rate=1e9, gate=(0.5, far))
        try:
            taken[digitiser.samples] = PulseDetector(pulse, Photodiode(), digitiser, PulseDetection()).half
        except InputError:
            refused.append(digitiser.samples)
    (half,) = set(taken.values())
    assert 0 < max(refused) < 2 * half + 4 <= min(taken)
    assert min(taken) - max(refused) < 20


def test_a_level_beyond_the_saturation_is_refused(device: Device) -> None:
    detection = PulseDetection(timing="leading_edge", level=1e-3)
    with pytest.raises(InputError, match="not below the saturation"):
        PulseDetector(Pulse(), Photodiode(saturation=0.5e-3), Digitiser(), detection)


def test_the_diode_agrees_with_the_judge() -> None:
    """F of McIntyre is 5.5 at M = 10 and k = 0.45; the noise bandwidth of a Gaussian is 1.064 B."""
    diode = Photodiode()
    assert diode.excess_noise == pytest.approx(judge.excess_noise(10.0, 0.45), rel=1e-12)
    assert diode.excess_noise == pytest.approx(5.545, abs=1e-3)
    assert diode.noise_bandwidth == pytest.approx(judge.noise_bandwidth(200e6), rel=1e-9)


def test_background_is_radiance_times_etendue() -> None:
    """A narrow field has the solid angle π/4 angle²: to 1e-6 at 5 mrad."""
    assert background_power(2.0, 5e-4, 0.5, 5e-3) == pytest.approx(5e-4 * np.pi / 4 * 25e-6, rel=1e-5)


@pytest.mark.parametrize("sigma", [0.05, 0.3, 0.66, 2.0, 6.0])
def test_the_colouring_taps_give_the_correlation(sigma: float) -> None:
    """The taps' own correlation is e^(−k²/4s²) to 1e-4 at every lag, whatever the sampling."""
    taps = colouring_taps(sigma)
    got = np.correlate(taps, taps, "full")[taps.size - 1 :]
    np.testing.assert_allclose(got, correlation(np.arange(got.size), sigma), atol=1e-4)
    assert taps.size % 4 == 1


@pytest.mark.parametrize("shape", ["gaussian", "t2_exponential"])
def test_device_and_double_precision_agree(device: Device, shape: Any) -> None:
    """The kernel's response is the double-precision one within 1e-3 of the peak for any variance, in area too."""
    response = PulseResponse.of(Pulse(shape=shape), 1e9)
    least = 0.44
    kernel = response.on_device(least)
    time = np.linspace(-40.0, 40.0, 4001)
    for variance in (least, least + 0.01, 1.0, 5.0, 30.0):
        got = kernel.values(auto.Float(time.astype(np.float32)), auto.Float(variance)).numpy()
        expected = response.values(time, variance)
        assert np.abs(got - expected).max() < 1e-3 * expected.max()
        assert np.trapezoid(got, time) == pytest.approx(1.0, abs=1e-3)
        # Its centroid stays, to single precision of a node's place, and variances add up, to the nodes' chords.
        middle = float(got.astype(np.float64) @ time) / float(got.sum(dtype=np.float64))
        assert abs(middle) < 2e-5
        assert float(got.astype(np.float64) @ time**2) * 0.02 == pytest.approx(
            response.variance + variance, rel=1e-3
        )


@pytest.mark.usefixtures("device")
def test_between_nodes_the_response_lies_on_their_chord() -> None:
    """Claim: of the variance of the table's first row the response errs by h²/8 of its bend at most, nodes h apart."""
    response, least = PulseResponse.of(Pulse(shape="t2_exponential"), 1e9), 0.44
    kernel, time = response.on_device(least), np.linspace(-20.0, 20.0, 20001)
    assert kernel.table is not None
    step = np.sqrt(response.variance + least) / float(kernel.table.density[0])
    expected = response.values(time, least)
    bend = np.abs(np.gradient(np.gradient(expected, time), time)).max()
    got = kernel.values(auto.Float(time.astype(np.float32)), auto.Float(least)).numpy()
    assert np.abs(got - expected).max() < 1.05 * step**2 / 8.0 * bend + 1e-6 * expected.max()


def test_a_tabulated_response_is_the_integral() -> None:
    """Against direct quadrature of pulse × Gaussian for t² e^(−t/τ): within 2e-5 of the peak."""
    pulse = Pulse(shape="t2_exponential")
    time, power = pulse.samples()
    response = PulseResponse.of(pulse, 1e9)
    at = np.linspace(-4.0, 8.0, 25)
    bell = np.exp(-0.5 * (at[:, None] - time[None, :] * 1e9) ** 2 / 0.44) / np.sqrt(2 * np.pi * 0.44)
    direct = np.trapezoid(bell * power * 1e-9, time * 1e9, axis=1)
    assert np.abs(response.values(at, 0.44) - direct).max() < 2e-5 * direct.max()


def test_a_pulse_is_over_before_the_next() -> None:
    """Claim: a period may be as long as the pulse, and no shorter."""
    length = Pulse().length
    assert Pulse(repetition_rate=1.0 / (1.02 * length)).length == length
    with pytest.raises(ValidationError, match="longer than the period"):
        Pulse(repetition_rate=1.0 / (0.98 * length))


def test_nothing_arrives_outside_of_a_pulses_span(tmp_path: Path) -> None:
    """Claim: without widening a measured pulse arrives from its file's first to its last sample, about its centroid;
    a Gaussian of variance v widens both ends by as many √v as a Gaussian pulse has, beyond which lie 1e-11 of it."""
    file = tmp_path / "pulse.csv"
    file.write_text("5e-9,0\n6e-9,4\n8e-9,0\n")
    response = PulseResponse.of(Pulse(shape=file), 2e9)
    begin, end = response.span(0.0)
    assert (begin, end) == pytest.approx((-8.0 / 3.0, 10.0 / 3.0), rel=1e-9)
    bell = PulseResponse.of(Pulse(width=3e-9), 2e9)
    reach = bell.span(0.7)[1] / np.sqrt(bell.variance + 0.7)
    assert 1e-13 < 2.0 * norm.sf(reach) < 1e-11
    assert response.span(0.7) == pytest.approx((begin - reach * 0.7**0.5, end + reach * 0.7**0.5), rel=1e-9)
    assert bell.variance == pytest.approx((6.0 / 2.3548200450309493) ** 2, rel=1e-6)


def test_a_file_that_holds_another_pulse_now_is_another_pulse(tmp_path: Path, device: Device) -> None:
    """Claim: response, detector and table of edges of a file that was written again are those of another file that
    holds the same, a box where there was a triangle; of one that stayed they are what they were."""
    file, twin = tmp_path / "pulse.csv", tmp_path / "twin.csv"
    file.write_text("0,0\n3e-9,4\n6e-9,0\n")
    twin.write_text("0,0\n0.1e-9,4\n5.9e-9,4\n6e-9,0\n")

    def made(path: Path) -> tuple[Any, ...]:
        pulse, receiver = Pulse(shape=path), (Photodiode(), Digitiser())
        edges = edge_table(pulse, *receiver, 40.0)
        return (
            PulseResponse.of(pulse, 1e9),
            pulse_detector(pulse, *receiver, PulseDetection(), Laser()),
            edges,
        )

    before = made(file)
    assert all(one is other for one, other in zip(made(file), before, strict=True))
    file.write_text(twin.read_text())
    response, detector, edges = made(file)
    other_response, other_detector, other_edges = made(twin)
    assert response.variance == other_response.variance > before[0].variance
    assert detector.half == other_detector.half > before[1].half
    assert edges.rows == other_edges.rows > before[2].rows
