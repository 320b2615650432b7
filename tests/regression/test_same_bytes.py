"""The same scenario gives the same bytes, however the work is split."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import drjit as dr
import numpy as np
import pytest
from every_path import CHANGES, CONFIG

from scanner_sim import load_scenario, simulate
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.simulate import simulate_voxel
from scanner_sim.products.image import RangeImage
from scanner_sim.render.device import Device

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def scenario(repo_root: Path) -> Scenario:
    """The module with relief, edges, two bounces, sunlight and both rangings: every path through the program."""
    return load_scenario(repo_root / "configs" / CONFIG, CHANGES)


@pytest.fixture(scope="module")
def image(device: Device, scenario: Scenario) -> RangeImage:
    return simulate(scenario, device="cpu")


@pytest.fixture
def threads_restored(device: Device) -> Iterator[None]:
    before = dr.thread_count()
    yield
    dr.set_thread_count(before)


def same(one: RangeImage, other: RangeImage) -> bool:
    return one.channels.keys() == other.channels.keys() and all(
        one[name].tobytes() == other[name].tobytes() for name in one.channels
    )


@pytest.mark.parametrize(("batch", "threads"), [(97, 1), (5000, 3)])
def test_any_batch_and_any_number_of_threads(
    scenario: Scenario, image: RangeImage, batch: int, threads: int, threads_restored: None
) -> None:
    assert same(simulate(scenario, device="cpu", batch=batch, threads=threads), image)


@pytest.mark.pinned
def test_another_process(scenario: Scenario, image: RangeImage, repo_root: Path, tmp_path: Path) -> None:
    script = (
        "import sys; from scanner_sim import load_scenario, simulate\n"
        f"image = simulate(load_scenario(sys.argv[1], {CHANGES!r}), device='cpu')\n"
        "open(sys.argv[2], 'wb').write(b''.join(image[name].tobytes() for name in image.channels))"
    )
    target = tmp_path / "bytes"
    config = repo_root / "configs" / CONFIG
    subprocess.run([sys.executable, "-c", script, str(config), str(target)], check=True)
    assert target.read_bytes() == b"".join(image[name].tobytes() for name in image.channels)


def test_another_seed_gives_other_noise_of_the_same_truth(scenario: Scenario, image: RangeImage) -> None:
    other = simulate(scenario.model_copy(update={"seed": scenario.seed + 1}), device="cpu")
    assert not same(other, image)
    both = (other["truth.object"] > 0) & (image["truth.object"] > 0)
    # The mirrors' jitter belongs to the seed: the chief rays differ by microradians.
    assert np.nanmedian(np.abs(other["truth.range_m"] - image["truth.range_m"])[both]) < 1e-3


def test_a_voxel_alone_is_the_voxel_of_the_image(scenario: Scenario, image: RangeImage) -> None:
    for row, column in ((0, 0), (8, 12)):
        record = simulate_voxel(scenario, row, column, device="cpu")
        assert float(record.status) == image["status"][row, column]
        np.testing.assert_array_equal(np.float32(record.peak_px), image["peak_px"][row, column])
        np.testing.assert_array_equal(np.float32(record.range_m), image["range_m"][row, column])


def test_an_instrument_can_be_used_again(scenario: Scenario, image: RangeImage) -> None:
    from scanner_sim.scan.raster import raster_aim, tiled_order

    bench = Instrument(scenario, device="cpu")
    aim = raster_aim(scenario.scan, tiled_order(scenario.scan), scenario.scanner.dwell)
    for _ in range(2):
        layers = bench.measure(aim)
        order = np.argsort(aim.shot)
        # Neighbours have a say in the image only.
        alone = np.isin(image["status"].ravel(), (Status.ISOLATED, Status.MIXED))
        ranges = np.where(alone, np.nan, layers["range_m"][order]).astype(np.float32)
        np.testing.assert_array_equal(ranges, image["range_m"].ravel())
