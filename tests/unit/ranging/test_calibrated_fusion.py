"""Points of axes that miss each other by matrices, ranges of a leaning array, and ranges combined under a
calibration."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.ranging.believed import Design
from scanner_sim.ranging.calibration import Calibration
from scanner_sim.ranging.fusion import fuse_points
from scanner_sim.ranging.ranges import Deflections, Geometry, ranges_with_points
from scanner_sim.ranging.shared_noise import Overlap, SharedNoise
from scanner_sim.ranging.triangulation import position_from_range, range_from_position
from scanner_sim.ranging.uneven import Raster, texture

Array = NDArray[np.float64]

D, F, D_G = 0.2, 0.1, 0.05


def calibration(sigma: dict[str, float], **known: float) -> Calibration:
    values, covariance = np.zeros(len(NAMES)), np.zeros((len(NAMES), len(NAMES)))
    for name, value in known.items():
        values[INDEX[name]] = value
    for name, value in sigma.items():
        covariance[INDEX[name], INDEX[name]] = value**2
    return Calibration(values, covariance, Design(F, D, D_G), 0.4)


def test_points_are_turned_about_the_axis_where_it_is() -> None:
    """Claim: what the first mirror sends to (x, 0, z) is turned by φ about the line through (0, e, D_g) along
    (cos s, sin s, 0): SciPy's rotation; without e and s that is eq 3."""
    r, theta, phi = np.array([2.0, 5.0, 9.0]), np.array([0.3, -0.2, 0.05]), np.array([-0.25, 0.1, 0.35])
    for offset, skew in ((0.0, 0.0), (3e-3, 0.0), (0.0, 0.02), (-2e-3, -0.03)):
        known = calibration({}, axis_offset=offset, axis_skew=skew)
        found = np.stack(Geometry(F, D, D_G, 50e-6, 0.0, 0.0, calibration=known).point(r, theta, phi), axis=1)
        axis, middle = np.array([math.cos(skew), math.sin(skew), 0.0]), np.array([0.0, offset, D_G])
        for row in range(3):
            flat = np.array([r[row] * math.sin(theta[row]), 0.0, r[row] * math.cos(theta[row])])
            turned = middle + Rotation.from_rotvec(-phi[row] * axis).apply(flat - middle)
            np.testing.assert_allclose(found[row], turned, atol=1e-12)


@pytest.mark.parametrize("slope", [0.0, 0.3, -0.2])
def test_a_leaning_array_ranges_where_its_ray_meets_the_beam(slope: float) -> None:
    """Claim: a place p on the array is seen by the ray of the tangent t = p/(h + g p) against the beam, d cosΘ before
    and d sinΘ along it: R = d cosΘ/t + d sinΘ; and back."""
    theta = np.array([-0.4, -0.1, 0.2, 0.35])
    p = np.array([1e-3, 3e-3, 8e-3, 12e-3])
    tangent = p / (F + slope * p)
    wanted = D * np.cos(theta) / tangent + D * np.sin(theta)
    np.testing.assert_allclose(range_from_position(p, theta, F, D, slope), wanted, rtol=1e-12)
    np.testing.assert_allclose(position_from_range(wanted, theta, F, D, slope), p, rtol=1e-12)


def test_what_a_calibration_errs_by_weighs_ranges_and_is_no_noise() -> None:
    """Claim: with σ_b of the base, by which R = R_d d′/d errs, and σ_z of the pulse's zero, the share of the pulse is
    v₁/(v₁ + v₂) of the whole variances; the noise of the sum is that of both noises alone.

    Set-up: no deflection, where R = f d/p and the base moves no other number.
    """
    r, none, status = np.array([3.0, 6.0]), np.zeros(2), np.zeros(2, np.uint32)
    base, zero = 2e-4, 4e-3
    geometry = Geometry(F, D, D_G, 50e-6, 0.0, 0.0, calibration=calibration({"base": base, "tof_zero": zero}))
    deflections = Deflections(none, none, none, none)
    noise = np.array([1e-3, 5e-3]), np.array([6e-3, 6e-3])
    one, other = (ranges_with_points(r, own, status, own, none, deflections, geometry) for own in noise)
    fused, _, _ = fuse_points(one, other, deflections, geometry)
    v1, v2 = noise[0] ** 2 + (r * base / D) ** 2, noise[1] ** 2 + zero**2
    share = v1 / (v1 + v2)
    assert 0.1 < share.min() < share.max() < 0.9
    np.testing.assert_allclose(fused.sigma, np.hypot((1.0 - share) * noise[0], share * noise[1]), rtol=1e-6)
    np.testing.assert_allclose(fused.range, r)


@pytest.mark.parametrize("correlation", [0.9, -0.9])
def test_errors_of_a_calibration_that_go_together_weigh_ranges_so(correlation: float) -> None:
    """Claim: where the errors of base and of the pulse's zero are correlated, the share of the pulse is
    (v₁ − c)/(v₁ + v₂ − 2c) with c = −ρ σ_b σ_z R/d: a longer base makes ranges longer, a larger zero shorter.

    Set-up: as above.
    """
    r, none, status = np.array([3.0, 6.0]), np.zeros(2), np.zeros(2, np.uint32)
    base, zero = 2e-4, 4e-3
    known = calibration({"base": base, "tof_zero": zero})
    one, other = INDEX["base"], INDEX["tof_zero"]
    known.covariance[one, other] = known.covariance[other, one] = correlation * base * zero
    geometry = Geometry(F, D, D_G, 50e-6, 0.0, 0.0, calibration=known)
    deflections = Deflections(none, none, none, none)
    noise = np.array([4e-3, 5e-3]), np.array([6e-3, 6e-3])
    both = [ranges_with_points(r + off, own, status, own, none, deflections, geometry)
            for off, own in zip((0.0, 1e-3), noise, strict=True)]  # fmt: skip
    fused, _, _ = fuse_points(both[0], both[1], deflections, geometry)
    v1, v2 = noise[0] ** 2 + (r * base / D) ** 2, noise[1] ** 2 + zero**2
    covariance = -correlation * base * zero * r / D
    share = (v1 - covariance) / (v1 + v2 - 2.0 * covariance)
    assert 0.1 < share.min() < share.max() < 0.9
    np.testing.assert_allclose((fused.range - r) / 1e-3, share, rtol=1e-3)


def test_mirrors_at_rest_see_an_edge_where_each_voxels_pitch_is_coarse() -> None:
    """Claim: beyond a pitch of the spot's own kind the texture is that of a sharp edge in that voxel alone: rows of
    another pitch in the same raster change nothing of it, and a voxel of a fine pitch has the plain gradient."""
    shape = (9, 11)
    signal = np.tile(np.where(np.arange(11) < 5, 1.0, 1.3), (9, 1)).astype(float)
    signal[:, 5] = 1.2

    def moved(across: Array) -> Array:
        own = Raster(across, 3.0 * np.ones(shape), np.ones(shape), np.zeros(shape))
        none = np.zeros(shape)
        noise = SharedNoise(none, none, none, Overlap(none + 1.0, none + 1.0))
        return texture(signal, noise, own, np.zeros(shape, dtype=bool))

    coarse, fine = moved(np.full(shape, 4.0)), moved(np.full(shape, 0.5))
    mixed = moved(np.where(np.arange(9)[:, None] < 4, 4.0, 0.5) * np.ones(shape))
    np.testing.assert_allclose(mixed[1], coarse[1])
    np.testing.assert_allclose(mixed[7], fine[7])
