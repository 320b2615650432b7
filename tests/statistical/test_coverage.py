"""Is what the instrument states true? (estimate − truth)/σ over materials, ranges, signal levels and incidence.

The truth of a voxel is the instrument's: the range along the direction in which the laser really shone, and the point
that eq 3 makes of it with the true deflections. The errors of the angles' readings hence belong to the error of the
point, and of the range as far as eq 1 takes Θ into account. Flagged voxels (status not 0) have no estimate and no σ.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from scanner_sim import Scenario
from scanner_sim.analytic.geometry import point_from_shot
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.scan.raster import raster_aim

Array = NDArray[np.float64]

PLANES, SIDE = 160, 27
"""Planes, and voxels along each side of the small scan of one: 116 640 voxels."""
HALF = np.deg2rad(5.1)
SEPARATION = 0.05
DEPOLARISED = float(np.sqrt(0.5))
LIBRARY = ("z93_white", "beta_cloth", "black_paint", "dyed_black_anodise", "black_oxide", "target_white")
"""Depolarising materials; those that keep the polarisation have a test of their own."""

pytestmark = pytest.mark.usefixtures("device")


@dataclass(frozen=True)
class Setting:
    """One plane: distance [m], inclination, direction of its middle [rad], laser power [W], surface, seed."""

    distance: float
    tilt: float
    axis: str
    theta: float
    phi: float
    power: float
    material: Any
    seed: int


def settings() -> Iterator[Setting]:
    """Yield planes from 2.2 to 25 m, inclined by up to 60°, over ±0.31 rad, of reflectances of 0.05 to 0.9."""
    random = np.random.default_rng(4)
    for number in range(PLANES):
        distance, grey, power = np.exp(random.uniform(np.log([2.2, 0.05, 3e-3]), np.log([25.0, 0.9, 15e-3])))
        tilt, theta, phi = random.uniform(-1.0, 1.0, 3) * np.deg2rad([60.0, 18.0, 18.0])
        named = number % 3 == 0
        material = LIBRARY[number // 3 % len(LIBRARY)] if named else {"reflectance": grey}
        yield Setting(distance, tilt, "xy"[number % 2], theta, phi, power, material, 100 + number)


def scenario(plane: Setting, processing: dict[str, Any], material: Any, pattern: bool) -> Scenario:
    """Return an instrument before a plane, all sources of error on.

    The wobble changes in 1 ms and not in 50: its spread is the same, and it averages out over a small scan. The plane
    is no larger than the scan, because single precision places it to 2·10⁻⁷ of its size.
    """
    arm = plane.distance * np.cos(plane.theta) - SEPARATION
    target = {
        "name": "plane",
        "shape": "rectangle",
        "size": [2.6 * plane.distance * np.tan(HALF) / np.cos(abs(plane.tilt) + HALF)] * 2,
        "position": [
            plane.distance * np.sin(plane.theta),
            arm * np.sin(plane.phi),
            SEPARATION + arm * np.cos(plane.phi),
        ],
        "rotation": [
            {"axis": plane.axis, "angle": plane.tilt},
            {"axis": "y", "angle": plane.theta},
            {"axis": "x", "angle": -plane.phi},
        ],
        "material": material or plane.material,
    }
    return Scenario.model_validate(
        {
            "schema": 1,
            "seed": plane.seed,
            "scanner": {
                "laser": {"power": plane.power},
                "mirrors": {"wobble_time": 1e-3},
                "position_sensor": {"noise": {"prnu": pattern}},
            },
            "scene": {"objects": [target]},
            "scan": {
                "type": "raster",
                "rows": SIDE,
                "columns": SIDE,
                "horizontal": [plane.theta - HALF, plane.theta + HALF],
                "vertical": [plane.phi - HALF, plane.phi + HALF],
            },
            "processing": processing,
        }
    )


@dataclass
class Pulls:
    """(estimate − truth)/σ of all valid voxels: of the range (n,), of x, y, z (n, 3), and χ² of the point (n,).

    ``plane`` is the number of each voxel's plane; ``valid`` the share of voxels that were not flagged.
    """

    range: Array
    point: Array
    chi2: Array
    plane: NDArray[np.intp]
    valid: float

    def error_of_mean(self, values: Array) -> float:
        """Return the standard error of the mean of some values, one per voxel, from the scatter of the planes."""
        means = [values[self.plane == number].mean() for number in np.unique(self.plane)]
        return float(np.std(means) / np.sqrt(len(means)))


@cache
def pulls(
    *,
    peak: str = "maximum_likelihood",
    correction: str = "none",
    contrast: float = DEPOLARISED,
    metal: bool = False,
    pattern: bool = True,
) -> Pulls:
    """Measure all planes; ``metal`` keeps the polarisation, ``pattern`` is that of the pixels' response."""
    processing = {"peak": peak, "bias_correction": correction, "speckle_contrast": contrast}
    material = {"reflectance": 0.5, "depolarisation": 0.0} if metal else None
    parts: list[tuple[Array, ...]] = []
    for number, plane in enumerate(settings()):
        made = scenario(plane, processing, material, pattern)
        shots = np.arange(made.scan.shots, dtype=np.uint32)
        layers = Instrument(made, device="cpu").measure(raster_aim(made.scan, shots, made.scanner.dwell))
        valid = layers["status"] == 0
        got = {name: np.asarray(values, dtype=np.float64)[valid] for name, values in layers.items()}
        true_range = got["truth.range_m"]
        truth = point_from_shot(true_range, got["truth.theta_rad"], got["truth.phi_rad"], SEPARATION)
        error = np.stack([got["P.X"], got["P.Y"], got["P.Z"]], axis=-1) - truth
        covariance = np.empty((len(true_range), 3, 3))
        for i, one in enumerate("xyz"):
            covariance[:, i, i] = got[f"sigma_{one}_m"] ** 2
            for j in range(i):
                covariance[:, i, j] = covariance[:, j, i] = got[f"cov_{'xyz'[j]}{one}_m2"]
        parts.append(
            (
                (got["range_m"] - true_range) / got["sigma_range_m"],
                error / np.sqrt(np.einsum("nii->ni", covariance)),
                np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error),
                np.full(len(true_range), number),
            )
        )
    ranges, points, squares, planes = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Pulls(ranges, points, squares, planes, len(ranges) / (PLANES * SIDE**2))


@pytest.mark.slow
@pytest.mark.parametrize(
    "processing",
    [
        {},
        {"pattern": False},
        {"peak": "gaussian"},
        {"peak": "blais_rioux_4", "correction": "computed"},
        {"metal": True, "contrast": 1.0},
    ],
    ids=["maximum_likelihood", "even response", "gaussian", "blais_rioux_4 corrected", "metal told"],
)
def test_coverage(processing: dict[str, Any]) -> None:
    """Claim: σ of range, x, y and z, and the covariance of the point, are true.

    Set-up: 160 planes of 729 voxels each, drawn at random: 2.2 to 25 m, inclined by up to 60° about either axis, up to
    0.31 rad off the axis, reflectances of 0.05 to 0.9 and six library materials, 3 to 15 mW; every source of error at
    its default; each plane has its own seed, hence its own pattern of the pixels' response. Expected: the mean 0 and
    the variance 1 of (estimate − truth)/σ, 95 % within 1.96 σ; χ² of three of the point: mean 3, 95 % below 7.81.
    Tolerance: the mean 0.02 and four standard errors, the variance 0.05, the share 1 %. The standard error is measured
    from the planes: the pattern of the response is common to the voxels of a plane, so that it is 0.008 to 0.010, and
    0.007 in ``even response``, where there is no pattern; that of the variance is 0.01. Power: without the term of
    speckle the variance is 2.5 and χ²/3 is 1.5.
    """
    got = pulls(**processing)
    assert len(got.range) > 100_000
    assert got.valid > 0.95
    for values in (got.range, *got.point.T):
        assert abs(values.mean()) < 0.02 + 4.0 * got.error_of_mean(values)
        assert values.var() == pytest.approx(1.0, abs=0.05)
        assert np.mean(np.abs(values) < 1.959964) == pytest.approx(0.95, abs=0.01)
    assert got.chi2.mean() / 3.0 == pytest.approx(1.0, abs=0.05)
    assert np.mean(got.chi2 < chi2.ppf(0.95, 3)) == pytest.approx(0.95, abs=0.01)


@pytest.mark.slow
def test_coverage_holds_in_every_part() -> None:
    """Claim: the variance of 1 is no balance of parts that are too small and too large.

    Set-up: as above with ``maximum_likelihood``, split into thirds by distance, inclination, power and place in the
    field. Expected: 1 in each. Tolerance: 0.10: 0.05, and 4 standard errors of 0.013 for a third.
    """
    got, drawn = pulls(), list(settings())
    keys = {
        "distance": [plane.distance for plane in drawn],
        "inclination": [abs(plane.tilt) for plane in drawn],
        "power": [plane.power for plane in drawn],
        "off the axis": [abs(plane.theta) for plane in drawn],
    }
    for name, values in keys.items():
        for part in np.array_split(np.argsort(values), 3):
            inside = np.isin(got.plane, part)
            assert got.range[inside].var() == pytest.approx(1.0, abs=0.10), name


@pytest.mark.slow
@pytest.mark.parametrize(
    "processing",
    [{"metal": True}, {"peak": "blais_rioux_4"}, {"peak": "parabola"}, {"peak": "centre_of_mass"}],
    ids=["metal", "blais_rioux_4", "parabola", "centre_of_mass"],
)
def test_where_sigma_falls_short(processing: dict[str, Any]) -> None:
    """Claim: what σ does not cover is known, and the settings of the tests above mend it.

    Set-up: the same planes. On surfaces that keep the laser's polarisation the speckle's variance is twice as large,
    and the instrument is not told. Estimators without correction have systematic errors, up to 0.02 px
    (``blais_rioux_4``), 0.06 px (``parabola``) and 0.005 px (``centre_of_mass``), which no σ holds. Expected: fewer
    than 95 % within 1.96 σ; how many follows from where the planes stand, but on metal the variance is below 2, the
    less the more other noise there is. Tolerance: four standard errors, from the scatter of the planes.
    """
    got = pulls(**processing)
    within = (np.abs(got.range) < 1.959964).astype(float)
    assert within.mean() < 0.95 - 4.0 * got.error_of_mean(within)
    if "metal" in processing:
        assert got.range.var() < 2.0 + 4.0 * got.error_of_mean(got.range**2)
