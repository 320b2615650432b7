"""Coverage where the instrument is used at other temperatures than it was calibrated at."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from claims import mean_square, share
from numpy.typing import NDArray
from scipy.stats import chi2

from scanner_sim import Instrument, Scenario, load_scenario, track
from scanner_sim.config.calibration import design_digest
from scanner_sim.foundation.parameters import INDEX
from scanner_sim.instrument.closed_loop.poses import poses_of
from scanner_sim.ranging.calibration import Calibration

Array = NDArray[np.float64]

RUNS, POSES, HOUR = 120, 40, 3600.0
WARMER = 4.0
"""Standard deviation of the temperature [K]."""
EXPANSION = {"base": (23e-6, 6e-6), "focal": (15e-6, 8e-6)}
"""Aluminium between laser and lens, steel between lens and array: means and standard deviations [1/K]."""

pytestmark = pytest.mark.usefixtures("device")


def believing(base: Scenario, folder: Path) -> Scenario:
    """Return a scenario that knows how far its temperature may be from that of its calibration, and what that does."""
    told = "".join(
        f"  {name}_expansion: {{value: {1e6 * value:g} ppm/K, sigma: {1e6 * sigma:g} ppm/K}}\n"
        for name, (value, sigma) in EXPANSION.items()
    )
    (folder / "calibration.yaml").write_text(
        f"schema: 1\ninstrument: '{design_digest(base.scanner)}'\nparameters: {{}}\n"
        f"temperature:\n  sigma: {WARMER:g} K\n{told}",
        encoding="utf-8",
    )
    return base.replace({"processing.calibration": str(folder / "calibration.yaml")})


def measured(folder: Path) -> tuple[Array, Calibration]:
    """Return errors of ranges to a wall, σ and its common part, (runs, 9, 3), each run at a temperature of its own.

    Noise is the instrument's but for speckle and mirrors, which would hide the expansion in one voxel.
    """
    base = load_scenario(
        {
            "schema": 1,
            "scanner": {
                "laser": {"speckle": False},
                "mirrors": dict.fromkeys(
                    ("jitter", "wobble", "readout_noise", "readout_step", "drift_zero", "drift_scale"), 0.0
                ),
            },
            "scene": {"objects": [
                {"shape": "rectangle", "name": "wall", "material": "grey_reference", "position": [0.0, 0.0, 2.0],
                 "rotation": [{"axis": "y", "angle": 0.1}], "size": [6.0, 6.0]}
            ]},
            "scan": {"type": "raster", "rows": 2, "columns": 2, "horizontal": [-0.3, 0.3], "vertical": [-0.3, 0.3]},
                    }
    )  # fmt: skip
    base = believing(base, folder)
    theta, phi = (grid.ravel() for grid in np.meshgrid([-0.25, 0.0, 0.25], [-0.2, 0.05, 0.25]))
    generator, stated = np.random.default_rng(20), []
    for run in range(RUNS):
        changes = {"seed": run, "scanner.mirrors.temperature.rate": generator.normal(0.0, WARMER) / HOUR}
        for name, (value, sigma) in EXPANSION.items():
            changes[f"scanner.as_built.{name}_expansion"] = generator.normal(value, sigma)
        bench = Instrument(base.replace(changes))
        samples = bench.measure(replace(bench.aim(theta, phi), time=np.full(len(theta), HOUR)))
        assert not samples["status"].any()
        columns = {name: np.asarray(samples[name], dtype=np.float64) for name in samples}
        sigma, common = columns["sigma_range_m"], columns["sigma_common_m"]
        stated.append(np.stack([columns["range_m"] - columns["truth.range_m"], sigma, common], axis=1))
    known = bench.geometry.calibration
    assert known is not None
    return np.stack(stated), known


@pytest.mark.slow
def test_ranges_are_covered_over_temperatures(tmp_path: Path) -> None:
    """Claim: with coefficients and temperature drawn as the calibration states them, ranges err as σ says.

    *Expected:* mean square of error over σ 1, of each voxel over the runs, and of the mean of nine voxels over its
    common part and noise. The common error is a product of two normal numbers, of the temperature and of the sum of
    both coefficients, which both shorten ranges: with s = 10/38 the relative σ of that sum its kurtosis is
    3 (1 + 6 s² + 3 s⁴)/(1 + s²)² = 3.75, and its mean square scatters 17 % more than that of a normal number, by 2 % of
    itself; four times that is the slack, and as much again for σ itself.
    *Set-up:* three of nine voxels one by one. What the common part leaves out shows: without it the mean would be told
    to be over twice as good in its variance.
    """
    stated, known = measured(tmp_path)
    assert known.uncertain == ("base", "focal_length")
    base, focal = INDEX["base"], INDEX["focal_length"]
    assert known.covariance[base, focal] > 0.0
    error, sigma, common = np.moveaxis(stated, -1, 0)
    for voxel in (0, 4, 8):
        z = error[:, voxel] / sigma[:, voxel]
        assert mean_square(z, slack=0.12), f"voxel {voxel}"
        assert share(int((z**2 < chi2.ppf(0.95, 1)).sum()), RUNS, 0.95, slack=0.02), f"voxel {voxel}"
    noise = (sigma**2 - common**2).mean(axis=1) / 9.0
    mean = error.mean(axis=1)
    assert mean_square(mean / np.sqrt(common.mean(axis=1) ** 2 + noise), slack=0.12)
    assert np.mean(mean**2 / noise) > 2.0


@pytest.mark.slow
def test_poses_are_covered_over_temperatures(tmp_path: Path) -> None:
    """Claim: poses of a tracked array err as their covariance says where temperature and coefficients are drawn as the
    calibration states them, and its part ``common`` is what the temperature does.

    Set-up: four discs on a square of 0.12 m, 3 m off, whose distance their ranges tell, four visits to each, all noise;
    40 instruments whose base and image distance are what a temperature that stays makes of them. The last pose of each.
    Expected: mean square 1 of each of the six numbers and 95 % of eᵀC⁻¹e within the ellipsoid. Slack 12 % for the
    temperature's kurtosis as above, in the one direction that it moves, and a tenth for σ of tracked visits. Told
    without the common part, the distance would be better by far than it is.
    """
    array = {"diameter": 0.04, "rows": 2, "columns": 2, "spacing": (0.12, 0.12), "plate": 0.1}
    node = {
        "name": "node",
        "array": array,
        "position": (0.1, -0.1, 3.0),
        "rotation": {"axis": "y", "angle": 0.2},
    }
    scan = {"type": "track", "targets": ["node"], "duration": 4 * 5 * 10.03e-3}
    whole = load_scenario(
        {"schema": 1, "scene": {"objects": [node]}, "scan": scan, "pose": {"methods": ["xyz"]}}
    )
    base, generator, found = believing(whole, tmp_path), np.random.default_rng(21), []
    for run in range(POSES):
        warmer = generator.normal(0.0, WARMER)
        grown = {name: warmer * generator.normal(value, sigma) for name, (value, sigma) in EXPANSION.items()}
        receiver = base.scanner.receiver
        built = {
            "base": grown["base"] * receiver.baseline,
            "focal_length": grown["focal"] * receiver.line_image.depth,
        }
        (series,) = poses_of(track(base.replace({"seed": run, "scanner.as_built": built}), device="cpu"))
        last = np.flatnonzero(series.status == 0)[-1]
        found.append((series.error[last], series.covariance[last], series.common[last]))
    error, covariance, common = (np.stack(column) for column in zip(*found, strict=True))
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    for axis in range(6):
        assert mean_square(error[:, axis] / sigma[:, axis], slack=0.22), f"axis {axis}"
    square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
    assert share(int((square < chi2.ppf(0.95, 6)).sum()), POSES, 0.95, slack=0.02)
    alone = covariance[:, 2, 2] - common[:, 2, 2]
    assert np.mean(error[:, 2] ** 2 / alone) > 5.0
