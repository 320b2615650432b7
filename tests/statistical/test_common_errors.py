"""Coverage where the instrument is not as its calibration has it: noise of each voxel, and what all of them share.

Each run has an instrument of its own, whose true parameters are drawn from the calibration's covariance, and noise of
its own. One scene, and one calibration of which every run believes the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from claims import at_most, mean_square, share
from numpy.typing import NDArray
from scipy.stats import chi2

from scanner_sim import Instrument, Scenario, load_scenario
from scanner_sim.config.calibration import calibration_text, design_of
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.instrument.samples import Samples
from scanner_sim.ranging.calibration import Calibration, errors_in_common
from scanner_sim.ranging.fusion import CHANCE

Array = NDArray[np.float64]

RUNS, SIDE = 120, 4
SIGMA = {
    "base": 2e-4, "focal_length": 6e-5, "axis_separation": 5e-4, "axis_skew": 2e-4, "theta_zero": 1.5e-4,
    "phi_zero": 2e-4, "theta_scale": 4e-4, "array_offset": 2e-6, "tangential": 1e-3, "tof_zero": 8e-3,
    "tof_scale": 5e-4,
}  # fmt: skip
"""Standard deviations of a calibration that is good to some millimetres at 4 m: as large as the noise."""
CORRELATED = {
    ("base", "focal_length"): -0.7,
    ("theta_zero", "array_offset"): 0.8,
    ("tof_zero", "tof_scale"): -0.5,
}
BELIEVED = {"base": 3e-4, "theta_zero": -2e-4, "tof_zero": 1e-2}

pytestmark = pytest.mark.usefixtures("device")


def covariance() -> Array:
    sigma, correlation = np.array([SIGMA.get(name, 0.0) for name in NAMES]), np.eye(len(NAMES))
    for (one, other), value in CORRELATED.items():
        correlation[INDEX[one], INDEX[other]] = correlation[INDEX[other], INDEX[one]] = value
    return np.asarray(correlation * sigma * sigma[:, None])


def values() -> Array:
    return np.array([BELIEVED.get(name, 0.0) for name in NAMES])


def scenario(folder: Path) -> Scenario:
    found = load_scenario(
        {
            "schema": 1, "ranging": "both",
            "scene": {"objects": [
                {"shape": "rectangle", "name": "wall", "material": "grey_reference", "position": [0.2, 0.1, 4.0],
                 "rotation": [{"axis": "y", "angle": 0.2}], "size": [6.0, 6.0]}
            ]},
            "scan": {"type": "raster", "rows": 2, "columns": 2, "horizontal": [-0.3, 0.3], "vertical": [-0.3, 0.3]},
            "output": {"truth": ["point"]},
        }
    )  # fmt: skip
    own = Calibration(values(), covariance(), design_of(found.scanner))
    (folder / "calibration.yaml").write_text(calibration_text(own, found.scanner), encoding="utf-8")
    return found.replace(
        {"processing.calibration": str(folder / "calibration.yaml"), "output.jacobian": True}
    )


@dataclass(frozen=True)
class Measured:
    """Errors of points and ranges of one way of ranging, what was stated of them, and ∂(x, y, z)/∂parameter."""

    error: Array
    covariance: Array
    range_error: Array
    sigma: Array
    common: Array
    slopes: Array


@cache
def measured(runs: int = RUNS) -> tuple[dict[str, Measured], Array, Calibration]:
    """Return what some instruments measure by each way of ranging, where, and what they believe.

    Runs in which the two ways disagree at a voxel, as they do by chance at a level of their own, are left out.
    """
    rows: dict[str, list[tuple[Array, ...]]] = {"": [], "tof.": [], "fused.": []}
    draws = values() + np.random.default_rng(20).multivariate_normal(np.zeros(len(NAMES)), covariance(), runs)
    theta, phi = (
        angles.ravel() for angles in np.meshgrid(np.linspace(-0.3, 0.3, SIDE), np.linspace(-0.28, 0.3, SIDE))
    )
    with TemporaryDirectory() as folder:
        base = scenario(Path(folder))
        for run, draw in enumerate(draws):
            built = {name: float(value) for name, value in zip(NAMES, draw, strict=True) if value}
            bench = Instrument(base.replace({"seed": run, "scanner.as_built": built}))
            samples = bench.measure(bench.aim(theta, phi))
            if not any(np.any(samples[f"{prefix}status"]) for prefix in rows):
                for prefix, kept in rows.items():
                    kept.append(stated(samples, prefix))
    calibration = bench.geometry.calibration
    assert calibration is not None
    assert at_most(runs - len(rows[""]), runs, SIDE * SIDE * CHANCE)
    found = {
        prefix: Measured(*(np.stack(column) for column in zip(*kept, strict=True)))
        for prefix, kept in rows.items()
    }
    return found, np.stack([theta, phi]), calibration


def stated(samples: Samples, prefix: str) -> tuple[Array, ...]:
    """Return errors of points, their covariances, errors of ranges, σ, its common part and derivatives of one run."""
    columns = {name: np.asarray(samples[name], dtype=np.float64) for name in samples}
    error = np.stack([columns[f"{prefix}P.{axis}"] - columns[f"truth.P.{axis}"] for axis in "XYZ"], axis=1)
    matrix = np.zeros((len(error), 3, 3))
    for number, axis in enumerate("xyz"):
        matrix[:, number, number] = columns[f"{prefix}sigma_{axis}_m"] ** 2
    for one, other in ((0, 1), (0, 2), (1, 2)):
        matrix[:, one, other] = matrix[:, other, one] = columns[f"{prefix}cov_{'xyz'[one]}{'xyz'[other]}_m2"]
    sigma = columns[f"{prefix}sigma_range_m"]
    common = columns.get(f"{prefix}sigma_common_m", 0.0 * sigma)
    slopes = [[columns.get(f"{prefix}J.{name}.{axis}", 0.0 * sigma) for name in NAMES] for axis in "XYZ"]
    range_error = columns[f"{prefix}range_m"] - columns["truth.range_m"]
    return error, matrix, range_error, sigma, common, np.moveaxis(slopes, -1, 0)


@pytest.mark.slow
@pytest.mark.parametrize("prefix", ["", "tof.", "fused."])
def test_points_are_covered_over_instruments(prefix: str) -> None:
    """Claim: eᵀ C⁻¹ e of one voxel over instruments has the mean of three degrees of freedom, and 95 % lie within.

    Expected: by construction, to first order in the parameters. Slack 2 % of the variance, for the second order and for
    what the estimators' own σ may err. Every voxel has the same instruments: of one voxel the runs are independent.
    """
    found = measured()[0][prefix]
    for voxel in (0, 6, SIDE * SIDE - 1):
        root = np.linalg.cholesky(found.covariance[:, voxel])
        z = np.linalg.solve(root, found.error[:, voxel, :, None])[..., 0]
        assert mean_square(z, slack=0.02), f"voxel {voxel}"
        inside = int(((z**2).sum(axis=1) < chi2.ppf(0.95, 3)).sum())
        assert share(inside, len(z), 0.95, slack=0.01), f"voxel {voxel}"


@pytest.mark.slow
@pytest.mark.parametrize("prefix", ["", "tof."])
def test_the_mean_over_voxels_has_the_common_error(prefix: str) -> None:
    """Claim: the mean range error of a run scatters by the common part, and by the noise over the voxels' number.

    Taken as noise alone, the mean of 16 voxels would be told to be better by far more than it is.
    """
    found, aims, calibration = measured()
    own = found[prefix]
    r = 4.0 / np.cos(aims[0]) / np.cos(aims[1])
    mean_r = own.range_error.mean(axis=1)
    noise = np.sqrt(np.maximum(own.sigma**2 - own.common**2, 0.0))
    by = "triangulation" if not prefix else "coaxial"
    moved, _ = errors_in_common(calibration, by, r, *aims)
    expected = np.sqrt((moved.mean(axis=0) ** 2).sum() + (noise**2).sum(axis=1) / (SIDE * SIDE) ** 2)
    # The wall is tilted by 0.2 rad, so that r is known to some per cent, and its effect to twice that.
    assert mean_square(mean_r / expected, slack=0.2)
    assert np.mean((mean_r / (np.sqrt((noise**2).sum(axis=1)) / (SIDE * SIDE))) ** 2) > 3.0


@pytest.mark.slow
def test_the_mean_of_fused_ranges_has_the_common_error() -> None:
    """Claim: what the layer of fused ranges calls common is what a mean over voxels keeps; the rest averages out.

    Slack: the common errors of 16 voxels all over the field are not wholly alike, 30 % of the variance.
    """
    own = measured()[0]["fused."]
    noise = np.mean(own.sigma**2 - own.common**2, axis=1) / (SIDE * SIDE)
    expected = np.sqrt(np.mean(own.common, axis=1) ** 2 + noise)
    assert mean_square(own.range_error.mean(axis=1) / expected, slack=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("prefix", ["", "tof.", "fused."])
def test_the_mean_of_a_wall_is_covered_by_the_derivatives(prefix: str) -> None:
    """Claim: the covariance of the mean of 16 points, from what each states and ∂point/∂parameter, covers its error.

    Every pair of voxels has J₁ C J₂ᵀ in common, and each has its noise, what it states less J C Jᵀ: the mean has
    J̄ C J̄ᵀ and the mean noise over 16. Slack 2 % of the variance, as of one voxel.
    """
    own, known = measured()[0][prefix], covariance()
    shared = own.slopes @ known @ np.swapaxes(own.slopes, -1, -2)
    middle = own.slopes.mean(axis=1)
    whole = middle @ known @ np.swapaxes(middle, -1, -2) + (own.covariance - shared).mean(axis=1) / SIDE**2
    z = np.linalg.solve(np.linalg.cholesky(whole), own.error.mean(axis=1)[..., None])[..., 0]
    assert mean_square(z, slack=0.02)
    assert share(int(((z**2).sum(axis=1) < chi2.ppf(0.95, 3)).sum()), len(z), 0.95, slack=0.01)


def test_the_common_part_is_part_of_sigma() -> None:
    """Claim: of every instrument, voxel and way of ranging it is less than all of σ, and more than a third."""
    for prefix in ("", "tof.", "fused."):
        own = measured(2)[0][prefix]
        assert (own.common < own.sigma).all()
        assert (own.common > 0.3 * own.sigma).all()
