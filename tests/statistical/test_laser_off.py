"""The second exposure without the laser: its noise, what its subtraction leaves, and whether σ knows.

The instrument is the preset with the laser off for half of the dwell, unless a test says otherwise. Levels: a right
program fails a test of this file for fewer than one in 10⁴ seeds; seeds are fixed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Laser, PositionSensor, Receiver
from scipy import stats

from scanner_sim import load_scenario, simulate
from scanner_sim.detector.line.exposure import Signal, electrons_per_watt, expose, pairwise
from scanner_sim.detector.line.noise import NoiseSwitches
from scanner_sim.foundation.status import Status
from scanner_sim.signals.line.calibration import SensorCalibration, measured_lines
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.peaks import Peaks, find_peaks
from scanner_sim.signals.processing import Processing

WAVELENGTH, DWELL = 1.5e-6, 50e-6
SENSOR = PositionSensor()
SUN = 2.2e5
"""Charge that a sunlit white surface leaves in a pixel in a whole dwell, behind the 30 nm filter [electron]."""
SEEDS = 1e-4
"""Share of seeds for which a right program may fail."""
DEVIATE = float(stats.norm.isf(0.5 * SEEDS))

Array = NDArray[np.float64]

pytestmark = pytest.mark.usefixtures("device")


def exposed(
    laser: Array, ambient: Array, laser_off: float, seed: int = 1, sensor: PositionSensor = SENSOR
) -> Signal:
    """Expose lines whose light gives these charges in a whole dwell [electron], shape (m, 256)."""
    scale = electrons_per_watt(sensor, WAVELENGTH, DWELL)
    both, alone = (
        auto.Float((light / scale).astype(np.float32).ravel()) for light in (laser + ambient, ambient)
    )

    def power(pixel: Any, place: Any) -> Any:
        return dr.gather(auto.Float, both, place * 256 + pixel)

    def background(pixel: Any, place: Any) -> Any:
        return dr.gather(auto.Float, alone, place * 256 + pixel)

    shots = dr.arange(auto.UInt32, len(laser))
    return expose(
        pairwise(power),
        shots,
        sensor,
        WAVELENGTH,
        DWELL,
        seed,
        background=pairwise(background),
        laser_off=laser_off,
    )


def spots(
    rng: np.random.Generator, count: int, near: float, far: float, darkest: float
) -> tuple[Array, Array]:
    """Return centres [pixel] and lines [electron] of the laser's spot on facing surfaces, at Θ = 0."""
    spot = ExpectedSpot.of(Laser(), Receiver(), 1.0, SENSOR, DWELL)
    distance = rng.uniform(near, far, count)
    centre = np.asarray(spot.pixel(distance, 0.0, 1.0))
    sigma = np.sqrt(sum(spot.variances(centre, 0.0, 1.0)))
    edges = np.arange(257) - 0.5
    shares = np.diff(stats.norm.cdf((edges - centre[:, None]) / sigma[:, None]), axis=1)
    charge = rng.uniform(darkest, 0.9, count) * spot.white / distance**2
    return centre, charge[:, None] * shares


def peaks_of(signal: Signal, sensor: PositionSensor = SENSOR) -> Peaks:
    spot = ExpectedSpot.of(Laser(), Receiver(), 1.0, sensor, (1.0 - signal.laser_off) * DWELL)
    return find_peaks(signal, sensor, Processing(), DWELL, spot)


def at_most(events: int, trials: int, rate: float) -> bool:
    """Tell whether a number of events is credible under a rate, at the level of this file."""
    return bool(events <= stats.binom(trials, rate).isf(SEEDS))


@pytest.mark.parametrize("laser_off", [0.2, 0.5, 0.8])
def test_each_exposure_has_its_own_light_and_noise(laser_off: float) -> None:
    """Claim: the numbers with and without the laser have the charges of their times, and independent noise.

    Set-up: 4000 lines of 256 pixels of 3e5 electrons of laser and 2e5 of ambient light a dwell, without a pattern of
    the pixels. Expected: means of (1 − s) 5e5 and s 2e5 electrons, dark charge in proportion, variances read² +
    step²/12 + charge, correlation 0. Tolerance: 3.9 standard errors over 1e6 pixels, plus 1e-4 of the mean for
    the rounding of float32. Power: noise drawn from one stream for both correlates by more than 0.1.
    """
    sensor = SENSOR.model_copy(update={"noise": NoiseSwitches(prnu=False)})
    count = 4000
    signal = exposed(np.full((count, 256), 3e5), np.full((count, 256), 2e5), laser_off, sensor=sensor)
    gain, trials = sensor.electrons_per_number, count * 256
    lines = [(signal.lines(part).astype(np.float64) - sensor.bias) * gain for part in (0, 1)]
    for line, light, time in zip(lines, (5e5, 2e5), (1.0 - laser_off, laser_off), strict=True):
        mean = (light + sensor.dark_current * DWELL) * time
        variance = mean + sensor.read_noise**2 + gain**2 / 12.0
        assert line.mean() == pytest.approx(mean, abs=DEVIATE * np.sqrt(variance / trials) + 1e-4 * mean)
        assert line.var() == pytest.approx(variance, rel=DEVIATE * np.sqrt(2.0 / trials) + 1e-3)
    correlation = np.corrcoef(lines[0].ravel(), lines[1].ravel())[0, 1]
    assert abs(correlation) < DEVIATE / np.sqrt(trials)


@pytest.mark.parametrize("laser_off", [0.2, 0.5, 0.8])
def test_the_difference_has_the_stated_variance(laser_off: float) -> None:
    """Claim: the difference is the laser's charge, and its variance that of the noise model.

    Set-up: 4000 lines; laser light of 0 to 1e6 electrons along the pixels, ambient light of 0 to 1e7 against it; the
    pixels' response spread by 0.5 %. Expected: deviations over the stated standard deviations have variance 1
    beyond the fixed pattern, which is the laser's alone. Tolerance: 3.9 standard errors and 0.5 % for variances
    taken at measured charges. Power: a fixed pattern of the ambient light left in would be ten times the noise.
    """
    count = 4000
    ramp = np.arange(256) / 255.0
    laser = np.tile((1.0 - laser_off) * 1e6 * ramp, (count, 1))
    ambient = np.tile(1e7 * ramp[::-1], (count, 1))
    signal = exposed(laser / (1.0 - laser_off), ambient, laser_off)
    known = SensorCalibration.of(SENSOR, DWELL, laser_off)
    measured, sigma = measured_lines(signal, known)
    pattern = measured.mean(axis=0) - laser[0]
    error = np.sqrt((sigma**2).mean(axis=0) / count)
    spread = np.hypot(SENSOR.prnu * laser[0], error)
    assert (pattern / spread).var() == pytest.approx(1.0, abs=DEVIATE * np.sqrt(2.0 / 256))
    random = sigma**2 - (SENSOR.prnu * np.maximum(measured, 0.0)) ** 2
    pull = (measured - measured.mean(axis=0)) / np.sqrt(random)
    assert pull.var() == pytest.approx(1.0, abs=DEVIATE * np.sqrt(2.0 / pull.size) + 5e-3)


@pytest.mark.slow
def test_structured_light_bends_nothing() -> None:
    """Claim: behind a second exposure no edge and no glint that is not saturated moves or hides the spot.

    Set-up: 50 000 lines, 2–11 m, reflectance 0.1–0.9, five edges of up to ± 5 sunlit white surfaces within 40
    pixels, and a narrow glint of up to 5 times the spot beside it. Expected: at least 99 % of those that are valid
    without the light stay valid, at most 1 in 10 000 of those is off by more than 6 σ (binomial). Power: with the
    laser always on fewer than half stay valid (checked here).
    """
    rng = np.random.default_rng(11)
    count = 50_000
    centre, laser = spots(rng, count, 2.0, 11.0, 0.1)
    pixel = np.arange(256)
    ambient = np.full((count, 256), SUN)
    for _ in range(5):
        place = (centre + rng.uniform(-40.0, 40.0, count))[:, None]
        ambient += 5.0 * SUN * rng.uniform(-1.0, 1.0, count)[:, None] * stats.norm.cdf((pixel - place) / 0.8)
    place = (centre + rng.uniform(-20.0, 20.0, count))[:, None]
    glint = laser.max(axis=1) * rng.uniform(0.0, 5.0, count)
    ambient = np.maximum(ambient, 0.0) + glint[:, None] * np.exp(-0.5 * (pixel - place) ** 2)
    dark = peaks_of(exposed(laser, 0.0 * ambient, 0.5)).status.numpy() == Status.VALID
    assert dark.mean() > 0.99
    lit = peaks_of(exposed(laser, ambient, 0.5))
    valid = lit.status.numpy() == Status.VALID
    assert np.mean(valid[dark]) >= 0.99
    pull = (lit.position.numpy() - centre)[valid] / lit.sigma.numpy()[valid]
    assert at_most(int(np.sum(np.abs(pull) > 6.0)), pull.size, 1e-4)
    always_on = peaks_of(exposed(laser, ambient, 0.0)).status.numpy() == Status.VALID
    assert np.mean(always_on[dark]) < 0.5


@pytest.mark.slow
def test_light_alone_is_no_range() -> None:
    """Claim: where the laser returns nothing, subtracted light becomes a range no oftener than noise alone does.

    Set-up: 100 000 lines without the laser over edges and glints of the laser's shape, up to 20 times a sunlit white
    surface. Expected: at most 1 in 10 000 valid (binomial): some 200 places a line pass the threshold of 6 σ
    by chance in 2e-7. Power: with the laser always on, 1 in 100 is a range (checked here).
    """
    rng = np.random.default_rng(12)
    count = 100_000
    centre, laser = spots(rng, count, 2.0, 11.0, 0.5)
    step = SUN * rng.uniform(0.0, 2.0, count)[:, None]
    place = (centre + rng.uniform(-8.0, 8.0, count))[:, None]
    ambient = step * stats.norm.cdf((np.arange(256) - place) / 0.8)
    ambient += laser * rng.uniform(0.0, 20.0, count)[:, None] * SUN / laser.max(axis=1)[:, None]
    nothing = np.zeros_like(ambient)
    valid = peaks_of(exposed(nothing, ambient, 0.5)).status.numpy() == Status.VALID
    assert at_most(int(valid.sum()), count, 1e-4)
    always_on = peaks_of(exposed(nothing, ambient, 0.0)).status.numpy() == Status.VALID
    assert always_on.mean() > 0.01


@pytest.mark.slow
@pytest.mark.parametrize(("bandpass", "sun"), [(True, True), (False, True), (True, False)])
def test_sigma_where_an_exposure_is_subtracted(bandpass: bool, sun: bool, repo_root: Path) -> None:
    """Claim: (estimate − truth)/σ of a plane in sunlight has the standard deviation 1: both exposures are in σ.

    Set-up: the plane of ``plane.yaml`` 10 m away, lit by the Sun, with the filter and without it, where the
    background's noise outweighs all other; 96 × 96 voxels. The pixels' response, one pattern for all of them, is
    off and judged elsewhere. Expected: 1, in the dark as well. Tolerance: 0.03, which is 4 standard errors of 9216
    voxels. Power: without the subtracted exposure's noise σ is too small by 1.4 or more in the Sun.
    """
    changes = [
        "scan.rows=96",
        "scan.columns=96",
        "scanner.laser_off=0.5",
        "scanner.position_sensor.noise.prnu=false",
    ]
    changes += ["lighting.sun={direction: [0.3, -0.3, -0.9]}"] if sun else []
    changes += [] if bandpass else ["scanner.filter=none"]
    image = simulate(load_scenario(repo_root / "configs" / "plane.yaml", changes), device="cpu")
    assert image.valid.mean() > 0.999
    pull = ((image["range_m"] - image["truth.range_m"]) / image["sigma_range_m"])[image.valid]
    assert pull.std() == pytest.approx(1.0, abs=0.03)
