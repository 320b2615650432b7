"""Runs that differ in their seeds alone are launched together, and are what each is alone."""

from __future__ import annotations

from pathlib import Path

import drjit as dr
import pytest

from scanner_sim import load_scenario, simulate, simulate_many
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.together import alike
from scanner_sim.products.image import RangeImage
from scanner_sim.render.device import Device

pytestmark = pytest.mark.slow

SEEDS = (3, 2**63 - 1, 3)
MOVING = ["scene.objects.module.motion={type: twist, velocity: [0.1 m/s, 0 m/s, 0.2 m/s]}"]
SUN = [
    "lighting={sun: {direction: [-0.35, -0.45, -0.8]}}",
    "transport.background_seed=4",
    "transport.background_samples=2",
    "transport.background_bounces=2",
]
CONDITIONS = {
    "dark": [],
    "moving": MOVING,
    "laser off in between": ["scanner.laser_off=0.3"],
    "without speckle": ["scanner.laser.speckle=false"],
    "wobbling and noisy encoders": ["scanner.mirrors.wobble=30 urad", "scanner.mirrors.jitter_seen=0.5"],
    "several bounces": ["transport.bounces=2"],
    "time of flight": ["ranging=tof"],
    "both": ["ranging=both", *MOVING],
    "under the Sun, moving, both": [*SUN, *MOVING, "ranging=both", "scanner.laser_off=0.3"],
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
    """Claim: same bytes, for the largest seed there is, equal ones, and scenarios of other powers among them."""
    scenario = scenario_of(repo_root, *CONDITIONS[condition])
    brighter, faint = (
        scenario_of(repo_root, *CONDITIONS[condition], f"scanner.laser.power={power}")
        for power in ("20.3 mW", "90 uW")
    )
    all_of_them = [brighter, *(seeded(scenario, seed) for seed in SEEDS), seeded(faint, 9)]
    if SUN[0] in CONDITIONS[condition]:
        # The light of each moving scene is traced anew, which is nearly all the work.
        all_of_them = all_of_them[:3]
    assert all(alike(scenario, one) for one in all_of_them)
    together = [content(image) for image in simulate_many(all_of_them, device="cpu")]
    assert together == [content(simulate(one, device="cpu")) for one in all_of_them]


def test_objects_that_move_may_stand_anywhere(device: Device, repo_root: Path) -> None:
    """Claim: same bytes where a module stands, turns and moves otherwise in each scenario, at rest in one of them."""
    at = "scene.objects.module."
    changes = (
        MOVING,
        [*MOVING, f"{at}position=[0.2 m, 0.1 m, 7 m]", f"{at}rotation={{axis: y, angle: 20 deg}}"],
        [f"{at}motion={{type: twist, velocity: [0 m/s, 0 m/s, 0 m/s]}}", f"{at}position=[0 m, 0 m, 6 m]"],
        [
            f"{at}motion={{type: twist, velocity: [0 m/s, 0 m/s, 1 m/s]}}",
            "scanner.laser.power=9 mW",
            "seed=7",
        ],
    )
    scenarios = [scenario_of(repo_root, *change) for change in changes]
    assert all(alike(scenarios[0], one) for one in scenarios)
    together = [content(image) for image in simulate_many(scenarios, device="cpu")]
    assert together == [content(simulate(one, device="cpu")) for one in scenarios]


def test_what_is_alike(repo_root: Path) -> None:
    """Claim: what changes the light of others, or what is loaded, keeps scenarios apart."""
    dark, moving = scenario_of(repo_root), scenario_of(repo_root, *MOVING)
    lit = scenario_of(repo_root, *SUN)
    assert alike(dark, scenario_of(repo_root, "output.pictures=false"))
    for change in (
        "scene.objects.module.position=[0 m, 0 m, 9 m]",
        "scanner.rate=10 kHz",
        "output.truth=[normal]",
    ):
        assert not alike(dark, scenario_of(repo_root, change))
    assert not alike(dark, moving)
    assert not alike(dark, lit)
    assert not alike(lit, scenario_of(repo_root, *SUN, "transport.background_seed=5"))
    own = scenario_of(repo_root, *SUN, "transport.background_seed=null")
    assert not alike(own, seeded(own, own.seed + 1))
    both = [
        scenario_of(repo_root, *SUN, *MOVING, f"scene.objects.module.position=[0 m, 0 m, {z} m]")
        for z in (6, 7)
    ]
    assert not alike(*both)


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


def test_seeds_without_a_seed_of_the_light_are_refused(device: Device, repo_root: Path) -> None:
    instrument = Instrument(scenario_of(repo_root, *SUN, "transport.background_seed=null"), device="cpu")
    with pytest.raises(InputError, match="only where its seed is given"):
        instrument.measure(instrument.aim(0.0, 0.0), seeds=[1, 2])
