"""Kernels that were compiled for one run serve every other: nothing that a campaign varies is a literal in them."""

from __future__ import annotations

from pathlib import Path

import drjit as dr
import pytest

from scanner_sim import load_scenario, simulate
from scanner_sim.config.scenario import Scenario
from scanner_sim.render.device import Device

pytestmark = pytest.mark.slow

SUNLIT = [
    "lighting={sun: {direction: [-0.5, -0.6, -0.6]}, earth: {direction: [0, 1, 0.3]}}",
    "transport.background_samples=2",
    "transport.background_bounces=2",
]
CONDITIONS = {
    "triangulation": [],
    "time of flight": ["ranging=tof"],
    "both": ["ranging=both"],
    "sunlit": SUNLIT,
    "two bounces": ["transport.bounces=2", "transport.bounce_paths=4"],
}
CHANGES = {
    "seed": ["seed=7"],
    "position": ["scene.objects.module.position=[0.2 m, 0.7 m, 8 m]"],
    "attitude": ["scene.objects.module.rotation={axis: y, angle: 40 deg}"],
    "power": ["scanner.laser.power=7 mW"],
    "size": ["scan.rows=15", "scan.columns=36"],
    "field": ["scan.horizontal=[-10 deg, 12 deg]"],
}
"""All that may change together or one by one, by what of the shots it changes."""


def new_kernels(scenario: Scenario) -> int:
    """Return the number of kernels of a run that this process did not know: compiled, or read from the disk."""
    dr.kernel_history_clear()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        simulate(scenario, device="cpu")
        launched = dr.kernel_history([dr.KernelType.JIT])
    return len({kernel["hash"] for kernel in launched if not kernel["cache_hit"]})


@pytest.mark.parametrize("condition", CONDITIONS)
def test_no_kernel_is_compiled_for_another_run(device: Device, repo_root: Path, condition: str) -> None:
    """Claim: a run with another seed, pose, power, size or field needs no kernel that is not known after two runs.

    Two runs come first, because what the first finds in memory is not what later ones find: kernels differ where an
    array was computed by the kernel before. It can fail: one number of shots as a literal in one kernel is found.
    """
    base = [*CONDITIONS[condition], "scan.rows=12", "scan.columns=40"]
    config = repo_root / "configs" / "quickstart.yaml"
    for _ in range(2):
        new_kernels(load_scenario(config, base))
    new = {name: new_kernels(load_scenario(config, [*base, *change])) for name, change in CHANGES.items()}
    assert new == dict.fromkeys(CHANGES, 0)
