"""Coverage where the instrument is used at other temperatures than it was calibrated at."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from claims import mean_square, share
from numpy.typing import NDArray
from scipy.stats import chi2

from scanner_sim import Instrument, load_scenario
from scanner_sim.config.calibration import design_digest
from scanner_sim.foundation.parameters import INDEX
from scanner_sim.ranging.calibration import Calibration

Array = NDArray[np.float64]

RUNS, HOUR = 120, 3600.0
WARMER = 4.0
"""Standard deviation of the temperature [K]."""
EXPANSION = {"base": (23e-6, 6e-6), "focal": (15e-6, 8e-6)}
"""Aluminium between laser and lens, steel between lens and array: means and standard deviations [1/K]."""

pytestmark = pytest.mark.usefixtures("device")


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
    told = "".join(
        f"  {name}_expansion: {{value: {1e6 * value:g} ppm/K, sigma: {1e6 * sigma:g} ppm/K}}\n"
        for name, (value, sigma) in EXPANSION.items()
    )
    (folder / "calibration.yaml").write_text(
        f"schema: 1\ninstrument: '{design_digest(base.scanner)}'\nparameters: {{}}\n"
        f"temperature:\n  sigma: {WARMER:g} K\n{told}",
        encoding="utf-8",
    )
    base = base.replace({"processing.calibration": str(folder / "calibration.yaml")})
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
