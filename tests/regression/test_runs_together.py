"""Runs that differ in their seeds alone are launched together, and are what each is alone."""

from __future__ import annotations

from pathlib import Path

import drjit as dr
import pytest

from scanner_sim import load_scenario, simulate, simulate_many
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.products.image import RangeImage
from scanner_sim.render.device import Device

pytestmark = pytest.mark.slow

SEEDS = (3, 2**63 - 1, 0, 3)
MOVING = ["scene.objects.module.motion={type: twist, velocity: [0.1 m/s, 0 m/s, 0.2 m/s]}"]
CONDITIONS = {
    "dark": [],
    "moving": MOVING,
    "laser off in between": ["scanner.laser_off=0.3"],
    "without speckle": ["scanner.laser.speckle=false"],
    "wobbling and noisy encoders": ["scanner.mirrors.wobble=30 urad", "scanner.mirrors.jitter_seen=0.5"],
}


def scenario_of(repo_root: Path, *changes: str) -> Scenario:
    size = ["scan.rows=11", "scan.columns=13"]
    return load_scenario(repo_root / "configs" / "quickstart.yaml", [*size, *changes])


def seeded(scenario: Scenario, seed: int) -> Scenario:
    return scenario.model_copy(update={"seed": seed})


def content(image: RangeImage) -> tuple[object, ...]:
    """Return all that an image holds."""
    layers = {name: image[name].tobytes() for name in image.channels}
    return layers, image.seed, image.scenario_yaml, image.warnings, image.objects


@pytest.mark.parametrize("condition", CONDITIONS)
def test_each_run_is_what_it_is_alone(device: Device, repo_root: Path, condition: str) -> None:
    """Claim: same bytes, for the largest seed there is, equal ones, and one scenario of another power among them."""
    scenario = scenario_of(repo_root, *CONDITIONS[condition])
    brighter = scenario_of(repo_root, *CONDITIONS[condition], "scanner.laser.power=20 mW")
    all_of_them = [*(seeded(scenario, seed) for seed in SEEDS), brighter, seeded(scenario, 9)]
    together = [content(image) for image in simulate_many(all_of_them, device="cpu")]
    assert together == [content(simulate(one, device="cpu")) for one in all_of_them]


def launches(scenarios: list[Scenario]) -> int:
    """Return the number of kernels that were launched for scenarios."""
    dr.kernel_history_clear()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        list(simulate_many(scenarios, device="cpu"))
        return len(dr.kernel_history([dr.KernelType.JIT]))


def test_runs_together_need_as_few_launches_as_two(device: Device, repo_root: Path) -> None:
    """Claim: eight runs launch as many kernels as two, and no more than a tenth more than one."""
    dark = scenario_of(repo_root)
    eight = [seeded(dark, seed) for seed in range(8)]
    alone, two, together = (launches(eight[:count]) for count in (1, 2, 8))
    assert two == together <= 1.1 * alone


def test_what_cannot_go_together_goes_alone(device: Device, repo_root: Path) -> None:
    """Claim: runs by time of flight are given as they are alone; asked for together, an instrument says why not."""
    scenario = scenario_of(repo_root, "ranging=tof")
    both = [seeded(scenario, seed) for seed in (1, 2)]
    found = [content(image) for image in simulate_many(both, device="cpu")]
    assert found == [content(simulate(one, device="cpu")) for one in both]
    instrument = Instrument(scenario, device="cpu")
    with pytest.raises(InputError, match="several seeds are measured together in the dark"):
        instrument.measure(instrument.aim(0.0, 0.0), seeds=[1, 2])
