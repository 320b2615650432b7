"""Kernels that were compiled for one run serve every other: nothing that a campaign varies is a literal in them."""

from __future__ import annotations

from itertools import chain
from pathlib import Path

import drjit as dr
import pytest

from scanner_sim import load_scenario, simulate
from scanner_sim.config.scenario import Scenario
from scanner_sim.render.device import Device
from scanner_sim.signals.waveform import detection, edges

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
    "what is seen": {
        "seed": ["seed=7"],
        "position": ["scene.objects.module.position=[0.2 m, 0.7 m, 8 m]"],
        "attitude": ["scene.objects.module.rotation={axis: y, angle: 40 deg}"],
        "power": ["scanner.laser.power=7 mW"],
        "size": ["scan.rows=15", "scan.columns=36"],
        "field": ["scan.horizontal=[-10 deg, 12 deg]"],
    },
    "optics": {
        "base": ["scanner.receiver.baseline=230 mm"],
        "lens": ["scanner.receiver.focal_length=95 mm", "scanner.receiver.aperture=30 mm"],
        "colour": ["scanner.laser.wavelength=1.45 um", "scanner.filter.bandwidth=10 nm"],
        "beam": ["scanner.laser.waist_radius=1.9 mm", "scanner.laser.waist_distance=1 m"],
        "mirrors": ["scanner.mirrors.jitter=4 urad", "scanner.mirrors.axis_separation=30 mm"],
    },
    "electronics": {
        "line": ["scanner.position_sensor.pitch=51 um", "scanner.position_sensor.height=200 um"],
        "noise": ["scanner.position_sensor.read_noise=500 electron", "scanner.position_sensor.prnu=0.01"],
        "rate": ["scanner.rate=10 kHz"],
        "photodiode": ["scanner.lidar.photodiode.gain=5", "scanner.lidar.photodiode.saturation=0.3 mA"],
        "pulse": ["scanner.lidar.pulse.peak_power=50 W", "scanner.lidar.digitiser.jitter=30 ps"],
        "processing": ["processing.threshold=6", "processing.speckle_contrast=0.7"],
    },
}
"""What may change, by what of the shots it changes; those of a group change together, and one by one only where a
kernel is new, to name it. A spot of other widths may reach over more pixels, or need more modes of speckle: a kernel
belongs to four of either."""


def kernels(scenario: Scenario) -> set[str]:
    """Return the names of the kernels of a run; what the disk holds of earlier processes makes no difference."""
    # Each run counts with what an instrument is calibrated for once, whatever ran in this process before.
    detection._calibrated.cache_clear()
    edges._computed.cache_clear()
    dr.kernel_history_clear()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        simulate(scenario, device="cpu")
        return {kernel["hash"] for kernel in dr.kernel_history([dr.KernelType.JIT])}


@pytest.mark.parametrize("condition", CONDITIONS)
def test_no_kernel_is_compiled_for_another_run(device: Device, repo_root: Path, condition: str) -> None:
    """Claim: a run with another seed, pose, power, size, base, lens or noise needs no kernel but those of two runs.

    Two runs come first, because what the first finds in memory is not what later ones find: kernels differ where an
    array was computed by the kernel before. It can fail: one number of shots as a literal in one kernel is found.
    """
    base = [*CONDITIONS[condition], "scan.rows=12", "scan.columns=40"]
    config = repo_root / "configs" / "quickstart.yaml"
    known = set.union(*(kernels(load_scenario(config, base)) for _ in range(2)))

    def new(*changes: list[str]) -> int:
        return len(kernels(load_scenario(config, [*base, *chain(*changes)])) - known)

    for about, group in CHANGES.items():
        if count := new(*group.values()):
            pytest.fail(f"{count} by {about}: { ({name: new(change) for name, change in group.items()}) }")


def test_no_kernel_is_compiled_for_another_focus(device: Device, repo_root: Path) -> None:
    """Claim: another tilt of the array and another focus are numbers, as all others are.

    The spots are about as wide in all of these runs. It can fail: the slope of the array as a literal is found.
    """
    small = ["scan.rows=12", "scan.columns=40", "scanner.receiver.aperture=6 mm"]
    config, receiver = repo_root / "configs" / "quickstart.yaml", "scanner.receiver"
    first, *others = (
        [*small, f"{receiver}.array_tilt={tilt}", f"{receiver}.focus_distance={focus}"]
        for tilt, focus in (
            ("10 deg", "4 m"),
            ("10 deg", "4.1 m"),
            ("10.5 deg", "4 m"),
            ("9.6 deg", "3.95 m"),
        )
    )
    known = set.union(*(kernels(load_scenario(config, first)) for _ in range(2)))
    assert [len(kernels(load_scenario(config, other)) - known) for other in others] == [0, 0, 0]


def test_no_kernel_is_compiled_for_another_instrument_as_built(device: Device, repo_root: Path) -> None:
    """Claim: departures are numbers, whatever they are; only whether there are any is known to a kernel.

    It can fail: one coefficient of the lens as a literal is found.
    """
    small = ["scan.rows=12", "scan.columns=40", "ranging=both"]
    config, own = repo_root / "configs" / "quickstart.yaml", "scanner.as_built"
    shaken = "{turn: [[5 Hz, %s rad^2/Hz], [50 Hz, 1e-12 rad^2/Hz]]}"
    keys = {
        "base": ("1 mm", "2 mm"), "axis_skew": ("1 mrad", "2 mrad"), "theta_zero": ("1 mrad", "3 mrad"),
        "array_tilt": ("1 mrad", "2 mrad"), "radial_1": ("0.1", "0.2"), "tangential": ("0.01", "0.02"),
        "tof_zero": ("1 mm", "2 mm"), "field_blur": ("2 um", "3 um"), "base_expansion": ("10 ppm/K", "20 ppm/K"),
        "power_noise": ("0.01", "0.02"), "pulse_noise": ("0.01", "0.02"), "stray_light": ("0.02", "0.01"),
        "vibration": (shaken % "1e-10", shaken % "2e-10"),
    }  # fmt: skip
    first, second = (
        [*small, *(f"{own}.{key}={values[number]}" for key, values in keys.items())] for number in (0, 1)
    )
    known = set.union(*(kernels(load_scenario(config, first)) for _ in range(2)))
    assert not kernels(load_scenario(config, second)) - known
