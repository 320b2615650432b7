"""Planted faults are found by the laws of ``compare``, and a right program is not accused.

Levels: a right program fails a test of this file for fewer than one in 10⁴ seeds; seeds are fixed.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import claims
import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest

from scanner_sim import Scenario, load_scenario
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.time_of_flight import TimeOfFlight
from scanner_sim.instrument.triangulation import Triangulation
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup, FlatTarget
from scanner_sim.validation.compare.run import judge_laws

pytestmark = pytest.mark.usefixtures("device")

Patch = pytest.MonkeyPatch
LEVEL = 1e-3


@pytest.fixture(scope="module")
def scenario(repo_root: Path) -> Scenario:
    """The preset before a grey wall, with both ways of ranging."""
    return load_scenario(repo_root / "configs" / "plane.yaml", ["ranging=both"])


@pytest.fixture(scope="module")
def right() -> dict[tuple[str, bool], str]:
    """The verdicts of the right program by law, and whether with few shots, each reached once."""
    return {}


@pytest.fixture(autouse=True)
def nothing_calibrated_before(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Calibrate the detector of pulses with the fault, and anew without it."""
    from scanner_sim.signals.waveform import detection, edges

    kept = detection._calibrated, edges._computed
    for one in kept:
        one.cache_clear()
    yield
    for one in kept:
        one.cache_clear()


def wrapped(patch: Patch, owner: Any, name: str, changed: Callable[..., Any]) -> None:
    """Put ``changed(original, *arguments)`` in the place of a function, wherever it was imported."""
    original = getattr(owner, name)

    def replacement(*given: Any, **more: Any) -> Any:
        return changed(original, *given, **more)

    patch.setattr(owner, name, replacement)
    for module in list(sys.modules.values()):
        if module.__name__.startswith("scanner_sim.") and getattr(module, name, None) is original:
            patch.setattr(module, name, replacement)


def optics(patch: Patch, part: str, **factors: float) -> None:
    """Change numbers of the light's optics behind the back of whoever reads the scenario."""

    def changed(original: Any, self: Any, known: Any, loaded: Any, layout: Any, *rest: Any) -> None:
        piece = getattr(layout, part)
        values = {name: getattr(piece, name) * factor for name, factor in factors.items()}
        wrong = dataclasses.replace(layout, **{part: piece.model_copy(update=values)})
        original(self, known, loaded, wrong, *rest)

    for rangefinder in (Triangulation, TimeOfFlight):
        wrapped(patch, rangefinder, "__init__", changed)


def mirrors(patch: Patch, **factors: float) -> None:
    """Change the size of the mirrors' errors as they happen, not as they are stated."""
    from scanner_sim.render import shots

    def changed(original: Any, aim: Any, kept: Any, *given: Any, **more: Any) -> Any:
        values = {name: getattr(kept, name) * factor for name, factor in factors.items()}
        return original(aim, kept.model_copy(update=values), *given, **more)

    wrapped(patch, shots, "true_shots", changed)


def focal_length(patch: Patch) -> None:
    optics(patch, "receiver", focal_length=1.02)


def lambert(patch: Patch) -> None:
    optics(patch, "laser", power=np.pi)


def divergence(patch: Patch) -> None:
    optics(patch, "laser", waist_radius=1.05)


def cosine(patch: Patch) -> None:
    """Forget the cosine of the surface."""
    from scanner_sim.render.beam import splitter

    def changed(original: Any, loaded: Any, projection: Any, beamlets: Any, shots: Any) -> Any:
        returns = original(loaded, projection, beamlets, shots)
        spots = returns.spots
        shot = dr.arange(auto.UInt32, dr.width(spots.power)) // (
            dr.width(spots.power) // dr.width(shots.theta)
        )
        facing = dr.cos(dr.gather(auto.Float, shots.theta, shot)) * dr.cos(
            dr.gather(auto.Float, shots.phi, shot)
        )
        spots.power = spots.power / facing
        returns.strength = returns.strength / facing
        return returns

    wrapped(patch, splitter, "trace_returns", changed)


def sunlight(patch: Patch) -> None:
    """Forget the 1/π of the sunlit wall."""
    import scanner_sim.optics.band_irradiance as home

    wrapped(
        patch,
        home,
        "band_irradiance",
        lambda original, *given: tuple(np.pi * band for band in original(*given)),
    )


def sigma(patch: Patch) -> None:
    """State a σ that is 10 % too small."""

    def changed(original: Any, self: Any, aim: Any, **more: Any) -> Any:
        samples = original(self, aim, **more)
        for name in samples.measured:
            factor = 0.9 if name.startswith("sigma_") else 0.81 if "cov_" in name else 1.0
            samples.measured[name] = samples.measured[name] * factor
        return samples

    wrapped(patch, Instrument, "measure", changed)


def baseline(patch: Patch) -> None:
    """Turn the base's sign round in d sinΘ of eq 1."""
    from scanner_sim.ranging import ranges

    def changed(original: Any, p: Any, theta: Any, f: float, d: float, slope: float) -> Any:
        return original(p, theta, f, d, slope) - 2.0 * d * np.sin(theta)

    wrapped(patch, ranges, "range_from_position", changed)


def separation(patch: Patch) -> None:
    """Leave the separation of the mirrors out of eq 3."""
    from scanner_sim.ranging import axes

    wrapped(patch, axes, "coordinates", lambda original, r, theta, phi, apart: original(r, theta, phi, 0.0))


def photons(patch: Patch) -> None:
    """Draw Poisson numbers with 90 % of their standard deviation."""
    from scanner_sim.detector.line import exposure as line

    wrapped(
        patch,
        line,
        "poisson",
        lambda original, mean, normal, least=0.0: original(mean, 0.9 * normal, least),
    )


def read_out(patch: Patch) -> None:
    """Make the read noise 10 % larger than stated."""
    from scanner_sim.detector.line import exposure as line

    wrapped(
        patch,
        line,
        "_read_out",
        lambda original, charge, shot, read, *rest: original(charge, shot, 1.1 * read, *rest),
    )


def polarisation(patch: Patch) -> None:
    """Give paint the speckle of bare metal."""
    from scanner_sim.scene.files import loader

    def changed(original: Any, *given: Any, **more: Any) -> Any:
        loaded = original(*given, **more)
        return dataclasses.replace(loaded, coherence=loaded.coherence * 0.0 + 1.0)

    wrapped(patch, loader, "load_scene", changed)


def envelope(patch: Patch) -> None:
    """Let speckle average over the whole spot, as if its blur held packets of its own."""
    from scanner_sim.detector.line import speckle

    def changed(original: Any, optics: Any, along: Any, across: Any, seen: Any) -> Any:
        blur = optics.aberration**2 + optics.diffusion**2
        return original(optics, along + blur, across + blur, seen)

    wrapped(patch, speckle, "packets_of", changed)


def wavefront(patch: Patch) -> None:
    """Let the lens's aberration blur the light as diffusion does."""
    from scanner_sim.detector.line import speckle

    def changed(original: Any, light: Any, places: Any, optics: Any, *rest: Any, **more: Any) -> Any:
        blur = (optics.aberration**2 + optics.diffusion**2) ** 0.5
        return original(
            light, places, dataclasses.replace(optics, aberration=0.0, diffusion=blur), *rest, **more
        )

    wrapped(patch, speckle, "line_speckle", changed)


def synchronisation(patch: Patch) -> None:
    mirrors(patch, synchronisation=2.0)


def jitter(patch: Patch) -> None:
    mirrors(patch, jitter=0.8)


def well(patch: Patch) -> None:
    """Let pixels hold 5 % more than their full well."""
    from scanner_sim.detector.line import exposure as line

    def changed(original: Any, charge: Any, shot: Any, read: Any, sensor: Any, dwell: float) -> Any:
        return original(
            charge, shot, read, sensor.model_copy(update={"full_well": 1.05 * sensor.full_well}), dwell
        )

    wrapped(patch, line, "_read_out", changed)


def speed(patch: Patch) -> None:
    """Take light for 1e-4 faster than it is."""
    import scanner_sim.instrument.time_of_flight as lidar

    def changed(original: Any, delay: Any, *given: Any) -> Any:
        return original(1.0001 * delay, *given)

    wrapped(patch, lidar, "ranges_from_delays", changed)


def clock(patch: Patch) -> None:
    """Let the clock jitter by 10 % less than stated."""
    import scanner_sim.detector.photodiode.waveform as waveform

    def changed(
        original: Any, echoes: Any, shot: Any, pulse: Any, diode: Any, digitiser: Any, *rest: Any
    ) -> Any:
        steadier = digitiser.model_copy(update={"jitter": 0.9 * digitiser.jitter})
        return original(echoes, shot, pulse, diode, steadier, *rest)

    wrapped(patch, waveform, "record", changed)


def amplifier(patch: Patch) -> None:
    """Make the amplifier 15 % noisier than stated."""
    import scanner_sim.detector.photodiode.waveform as waveform

    def changed(original: Any, echoes: Any, shot: Any, pulse: Any, diode: Any, *rest: Any) -> Any:
        noisier = diode.model_copy(update={"amplifier_noise": 1.15 * diode.amplifier_noise})
        return original(echoes, shot, pulse, noisier, *rest)

    wrapped(patch, waveform, "record", changed)


def width(patch: Patch) -> None:
    """Send pulses that are 5 % longer than stated."""
    import scanner_sim.detector.photodiode.waveform as waveform

    def changed(original: Any, echoes: Any, shot: Any, pulse: Any, *rest: Any) -> Any:
        longer = pulse.model_copy(update={"width": 1.05 * pulse.width, "peak_power": pulse.peak_power})
        return original(echoes, shot, longer, *rest)

    wrapped(patch, waveform, "record", changed)


def travel(patch: Patch) -> None:
    """Forget that the spot moves in a dwell."""
    from scanner_sim.tracking import disc_fit

    wrapped(
        patch,
        disc_fit,
        "blurred_edge",
        lambda original, inside, moved, spot: original(inside, 0.0 * moved, spot),
    )


def corner(patch: Patch) -> None:
    """Lose one target of four."""
    from scanner_sim.validation.compare import targets

    def changed(original: Any, points: Any, theta: Any, *given: Any, **more: Any) -> Any:
        lost = np.array(theta)
        lost[..., 3] = np.nan
        return original(points, lost, *given, **more)

    wrapped(patch, targets, "estimate_pose", changed)


FAULTS: list[tuple[Callable[[Patch], None], str]] = [
    (focal_length, "spot_position"),
    (divergence, "spot_width"),
    (lambert, "link_budget"),
    (cosine, "link_budget"),
    (sunlight, "sunlight"),
    (sunlight, "snr"),
    (well, "saturation"),
    (baseline, "points"),
    (separation, "points"),
    (synchronisation, "sigma_synchronisation"),
    (polarisation, "speckle_limit"),
    (polarisation, "speckle_contrast"),
    (envelope, "speckle_contrast"),
    (wavefront, "speckle_limit"),
    (photons, "sigma_shot"),
    (read_out, "sigma_read"),
    (read_out, "cramer_rao"),
    (jitter, "covariance"),
    (sigma, "coverage"),
    (speed, "tof_range"),
    (amplifier, "tof_bound"),
    (clock, "tof_sigma"),
    (width, "tof_walk"),
    (travel, "centroid"),
    (corner, "pose"),
]


THOROUGH = [(sigma, "coverage"), (wavefront, "speckle_limit"), (read_out, "cramer_rao")]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "law"),
    [pytest.param(fault, law, id=f"{fault.__name__}-{law}") for fault, law in FAULTS],
)
def test_a_planted_fault_is_found(
    fault: Callable[[Patch], None],
    law: str,
    scenario: Scenario,
    right: dict[tuple[str, bool], str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: each of these faults of the simulator is found by the law that speaks of it, which holds without.

    Set-up: the preset, flat targets at 2.5, 6 and 15 m, a quarter of the shots, one law, family-wise level 10⁻³; the
    fault is planted in the simulator only, and the judge knows nothing of it. Expected: the verdicts ``holds`` and
    ``broken``. Tolerance: none. A law that holds is broken by chance once in 1000 seeds, 22 of them hence once in 45:
    the seed is fixed. Each fault is larger than what the law detects with 99 %, which needs all shots for some.
    """
    quick = (fault, law) not in THOROUGH
    setting = ComparisonSetup(scenario, FlatTarget(0.5, (2.5, 6.0, 15.0)), quick=quick, device="cpu")
    if (law, quick) not in right:
        right[law, quick] = judge_laws(setting, only=[law], level=LEVEL).findings[0].verdict
    fault(monkeypatch)
    (wrong,) = judge_laws(setting, only=[law], level=LEVEL).findings
    assert (right[law, quick], wrong.verdict) == ("holds", "broken")
    assert any(abs(check.effect) > check.detects_99 for check in wrong.checks)


@pytest.mark.slow
def test_a_right_program_is_not_accused(scenario: Scenario) -> None:
    """Claim: the preset breaks a law in at most the stated share of runs.

    Set-up: 6 seeds, eight laws with noise, a quarter of the shots, family-wise level 0.05. Expected: 0.3 runs in which
    any law is broken, or fewer: the accuracies of the closed forms make the tests stricter than they say. It would find
    a program that is accused in most runs; ``benchmarks/compare.py`` measures how often, with all laws and 20 seeds.
    """
    laws = (
        "points",
        "sigma_synchronisation",
        "sigma_shot",
        "sigma_read",
        "cramer_rao",
        "covariance",
        "centroid",
        "pose",
    )
    accused = []
    for seed in range(6):
        setting = ComparisonSetup(
            scenario.model_copy(update={"seed": 500 + 10_000 * seed}),
            FlatTarget(0.5, (2.5, 6.0, 15.0)),
            quick=True,
            device="cpu",
        )
        accused += [seed] if judge_laws(setting, only=laws, level=0.05).broken else []
    assert claims.at_most(len(accused), 6, 0.05), accused
