"""Coverage where the platform shakes and the laser's power scatters, as the calibration knows."""

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
from scanner_sim.tracking.record import TrackStatus
from scanner_sim.tracking.state import TrackMode

Array = NDArray[np.float64]

RUNS, SECONDS = 80, 0.4
TURN = [[0.5, 4e-9], [5.0, 1e-9], [60.0, 1e-12]]
SHIFT = [[0.5, 2e-8], [20.0, 1e-10]]
"""A platform that turns by 0.1 mrad and shifts by 0.2 mm, slowly and fast beside the scan's 0.4 s."""

pytestmark = pytest.mark.usefixtures("device")


def believing(base: Scenario, folder: Path, said: str) -> Scenario:
    """Return a scenario whose calibration says something of its use."""
    text = f"schema: 1\ninstrument: '{design_digest(base.scanner)}'\nparameters: {{}}\n{said}"
    (folder / "calibration.yaml").write_text(text, encoding="utf-8")
    return base.replace({"processing.calibration": str(folder / "calibration.yaml")})


def cross(point: Array) -> Array:
    """Return the matrices of p × ., shape (..., 3, 3)."""
    return np.asarray(np.cross(point[..., None, :], np.eye(3)))


@pytest.mark.slow
def test_points_and_their_mean_are_covered_on_a_platform_that_shakes(tmp_path: Path) -> None:
    """Claim: points err as their covariances say, which hold the vibration; and the mean of points at known times as
    the correlation of the vibration has it.

    Set-up: nine points of a wall within 0.4 s, 80 platforms that shake each in its own way, by the spectra that the
    calibration has; noise is the preset's but for speckle. Expected: eᵀ C⁻¹ e has three degrees of freedom, of each of
    three voxels and of the mean, whose covariance is that of the noise over nine and Σ ρ(t_i − t_j) of turns and shifts
    over all pairs. Slack 3 % for σ itself. As noise of each voxel the mean would be told 1.8 times
    too good.
    """
    base = load_scenario(
        {
            "schema": 1, "scanner": {"laser": {"speckle": False}},
            "scene": {"objects": [
                {"shape": "rectangle", "name": "wall", "material": "grey_reference", "position": [0.0, 0.0, 3.0],
                 "size": [6.0, 6.0]}
            ]},
            "scan": {"type": "raster", "rows": 2, "columns": 2, "horizontal": [-0.3, 0.3], "vertical": [-0.3, 0.3]},
            "output": {"truth": ["point"]},
        }
    )  # fmt: skip
    spectra = "vibration:\n" + "".join(
        f"  {name}: {[[f'{rate} Hz', f'{value} {unit}'] for rate, value in points]}\n"
        for name, points, unit in (("turn", TURN, "rad^2/Hz"), ("shift", SHIFT, "m^2/Hz"))
    )
    knowing = believing(base, tmp_path, spectra)
    theta, phi = (grid.ravel() for grid in np.meshgrid([-0.25, 0.0, 0.25], [-0.2, 0.05, 0.25]))
    time = np.linspace(0.0, SECONDS, len(theta))
    error, stated, noise = [], [], []
    for run in range(RUNS):
        built = {"seed": run, "scanner.as_built": {"vibration": {"turn": TURN, "shift": SHIFT}}}
        found = []
        for own in (knowing, base):
            bench = Instrument(own.replace(built))
            found.append(bench.measure(replace(bench.aim(theta, phi), time=time)))
        samples, plain = found
        columns = {name: np.asarray(samples[name], dtype=np.float64) for name in samples}
        assert not columns["status"].any()
        error.append(np.stack([columns[f"P.{axis}"] - columns[f"truth.P.{axis}"] for axis in "XYZ"], axis=1))
        stated.append(covariances(columns))
        noise.append(covariances({name: np.asarray(plain[name], dtype=np.float64) for name in plain}))
    point = np.stack([columns[f"truth.P.{axis}"] for axis in "XYZ"], axis=1)
    e, c, alone = (np.stack(rows) for rows in (error, stated, noise))
    for voxel in (0, 4, 8):
        assert_covered(e[:, voxel], c[:, voxel])
    vibration = Instrument(knowing).geometry.calibration.vibration  # type: ignore[union-attr]
    assert vibration is not None
    turns, shifts = vibration.correlation(time[:, None] - time)
    turn, shift = vibration.deviations
    pairs = turn**2 * turns[..., None, None] * (cross(point)[:, None] @ np.swapaxes(cross(point), -1, -2))
    pairs = pairs + shift**2 * shifts[..., None, None] * np.eye(3)
    shared = pairs.mean(axis=(0, 1))
    told = alone.mean(axis=1) / len(theta) + shared
    assert_covered(e.mean(axis=1), told)
    # What noise of each voxel alone would expect of the errors that are covered: no draw is in it.
    white = c.mean(axis=1) / len(theta)
    expected = np.trace(np.linalg.inv(white) @ told, axis1=1, axis2=2).mean()
    assert expected > 1.75 * 3.0


def covariances(columns: dict[str, Array]) -> Array:
    """Return the covariances of points, (n, 3, 3)."""
    found = np.zeros((len(columns["range_m"]), 3, 3))
    for number, axis in enumerate("xyz"):
        found[:, number, number] = columns[f"sigma_{axis}_m"] ** 2
    for one, other in ((0, 1), (0, 2), (1, 2)):
        found[:, one, other] = found[:, other, one] = columns[f"cov_{'xyz'[one]}{'xyz'[other]}_m2"]
    return found


def assert_covered(error: Array, covariance: Array) -> None:
    z = np.linalg.solve(np.linalg.cholesky(covariance), error[..., None])[..., 0]
    assert mean_square(z, slack=0.03)
    assert share(int(((z**2).sum(axis=1) < chi2.ppf(0.95, 3)).sum()), RUNS, 0.95, slack=0.01)


@pytest.mark.slow
def test_centres_are_covered_where_the_power_scatters(tmp_path: Path) -> None:
    """Claim: centres of tracked discs err as σ says where the laser's power scatters by 5 % and the calibration knows.

    Set-up: 16 discs at 6 m, four tracked visits or more to each; without speckle and wobble, so that visits are
    independent and the power makes most of it. Expected: mean square 1. Slack 30 %, the range of the table *How honest
    σ is*. That it is the power is seen by σ, half as large again at least as where the power is even.
    """
    array = {"diameter": 0.1, "rows": 4, "columns": 4, "spacing": (0.5, 0.5), "plate": 0.4}
    base = load_scenario(
        {
            "schema": 1,
            "scanner": {
                "laser": {"speckle": False}, "mirrors": {"wobble": 0.0}, "as_built": {"power_noise": 0.05}
            },
            "scene": {"objects": [{"name": "grid", "array": array, "position": (0.0, 0.0, 6.0)}]},
            "scan": {"type": "track", "targets": ["grid"], "duration": 16 * 6 * 10.03e-3},
        }
    )  # fmt: skip
    sigmas = []
    for scenario in (
        believing(base, tmp_path, "power_noise: 5 %\n"),
        base.replace({"scanner.as_built": None}),
    ):
        late = [
            record
            for record in track(scenario, device="cpu").records
            if record.status is TrackStatus.MEASURED and record.mode is TrackMode.TRACK
        ]
        assert len(late) > 48
        sigma = np.sqrt([np.diagonal(record.covariance)[:2] for record in late])
        z = np.array([record.position[:2] - record.truth[:2] for record in late]) / sigma
        assert mean_square(z, slack=0.3)
        sigmas.append(sigma.mean())
    assert sigmas[0] > 1.5 * sigmas[1]
