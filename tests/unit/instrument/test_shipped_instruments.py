"""Shipped instruments, and others drawn about them, from 0.1 m to 500 m: what is valid is a number."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from scanner_sim import ScenarioError, load_scenario, simulate_shots
from scanner_sim.config.preset import shipped_presets
from scanner_sim.config.scanner import Scanner
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.status import Status
from scanner_sim.products.shots import ShotTable
from scanner_sim.signals.processing import MARGIN
from scanner_sim.signals.waveform.settings import TIMINGS

pytestmark = pytest.mark.usefixtures("device")

RANGES = np.geomspace(0.1, 500.0, 40)
SURFACES = [(0.5, 0.0), (0.02, 1.2), (1.0, 0.8), (0.05, 0.3)]
"""Reflectance, and incidence [rad]."""
FACTORS = {
    "laser": {"power": (0.03, 30.0), "waist_radius": (0.3, 2.0)},
    "receiver": {"baseline": (0.5, 1.5), "focal_length": (0.8, 1.6), "aperture": (0.3, 1.0)},
    "position_sensor": {"read_noise": (0.01, 10.0), "full_well": (0.1, 10.0)},
}
"""Least and largest factor of what is drawn."""
ECHO_FACTORS = {"photodiode": {"gain": (0.1, 10.0), "bandwidth": (0.3, 3.0)}, "pulse": {"width": (0.3, 3.0)}}


def scenario_of(scanner: object, number: int, *, reflectance: float, incidence: float) -> Scenario:
    """A wall that stands farther away from shot to shot, read by one of the estimators."""
    places = [
        {"time": float(at), "position": [0.0, 0.0, R], "rotation": {"axis": "y", "angle": incidence}}
        for at, R in enumerate(RANGES.tolist())
    ]
    wall = {
        "name": "wall",
        "shape": "rectangle",
        "size": [3000.0, 3000.0],
        "material": {"reflectance": reflectance},
        "motion": {"type": "waypoints", "points": places},
    }
    peaks = tuple(MARGIN)
    processing = {"peak": peaks[number % len(peaks)], "pulse": {"timing": TIMINGS[number % len(TIMINGS)]}}
    found = load_scenario(
        {
            "schema": 1,
            "seed": number,
            "scanner": scanner,
            "scene": {"objects": [wall]},
            "scan": {"type": "fixed", "points": len(RANGES), "interval": 0.999},
            "processing": processing,
        }
    )
    return found.changed(ranging="both") if len(found.scanner.rangefinders) == 2 else found


def drawn(preset: str, random: np.random.Generator) -> Scanner:
    """An instrument about a shipped one, as possible as that."""
    known = Scanner(preset=preset)
    while True:
        block: dict[str, object] = {"preset": preset}
        for part, factors in FACTORS.items():
            if part == "position_sensor" and "triangulation" not in known.rangefinders:
                continue
            block[part] = _scaled(getattr(known, part), factors, random)
        if "tof" in known.rangefinders:
            block["lidar"] = {
                part: _scaled(getattr(known.lidar, part), factors, random)
                for part, factors in ECHO_FACTORS.items()
            }
        try:
            return load_scenario({"schema": 1, "scanner": block, "scan": {"type": "fixed"}}).scanner
        except ScenarioError:
            continue


def _scaled(
    part: object, factors: dict[str, tuple[float, float]], random: np.random.Generator
) -> dict[str, float]:
    return {
        key: max(
            getattr(part, key) * float(np.exp(random.uniform(*np.log(ends)))), 1.0 if key == "gain" else 0.0
        )
        for key, ends in factors.items()
    }


def not_numbers(shots: ShotTable) -> Iterator[str]:
    """Yield the channels that hold what is no number where the range is valid, and no σ where σ is 0 or less."""
    for prefix in ("", "tof.", "fused."):
        if f"{prefix}range_m" not in shots.channels:
            continue
        valid = shots[f"{prefix}status" if f"{prefix}status" in shots.channels else "status"] == Status.VALID
        for name, values in shots.channels.items():
            own = name.startswith(prefix) and (prefix or not name.startswith(("tof.", "fused.")))
            if not own or name.endswith("status") or name.startswith("truth."):
                continue
            # Of no background the ratio to it is infinite.
            good = ~np.isnan(values[valid]) if name == "snr" else np.isfinite(values[valid])
            if not good.all() or (
                name.rpartition(".")[2] == "sigma_range_m" and not (values[valid] > 0.0).all()
            ):
                yield name


@pytest.mark.parametrize("preset", shipped_presets())
@pytest.mark.parametrize("number", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2, 3))])
def test_valid_is_a_number_from_a_decimetre_to_half_a_kilometre(preset: str, number: int) -> None:
    """Claim: with every estimator, near and far, bright and dark, facing and grazing, a valid shot has finite channels
    and a positive σ; there are valid ones, and nothing is valid that was not seen.

    So of a centre of mass: the truth lies among the pixels that it reads, three to each side, but for five σ of noise,
    one of 10⁴ in all shots together. A wide spot moves it by up to two pixels, of which the program warns.
    """
    reflectance, incidence = SURFACES[number]
    shots = simulate_shots(
        scenario_of({"preset": preset}, number, reflectance=reflectance, incidence=incidence)
    )
    assert not list(not_numbers(shots))
    if number == 0:
        valid = shots["status"] == Status.VALID
        assert valid.any()
        pull = (shots["range_m"] - shots["truth.range_m"])[valid] / shots["sigma_range_m"][valid]
        read = (
            MARGIN["centre_of_mass"] / shots["sigma_peak_px"][valid] if "peak_px" in shots.channels else 0.0
        )
        assert (np.abs(pull) < 5.0 + read).all()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("preset", shipped_presets())
def test_valid_is_a_number_for_instruments_drawn_about_them(preset: str, seed: int) -> None:
    """Claim: the same of instruments whose laser, lens, line and diode are drawn over a decade and more."""
    random = np.random.default_rng([seed, 11])
    scanner = drawn(preset, random)
    for number, (reflectance, incidence) in enumerate(SURFACES):
        shots = simulate_shots(
            scenario_of(scanner, number + seed, reflectance=reflectance, incidence=incidence)
        )
        assert not list(not_numbers(shots)), (number, scanner)
