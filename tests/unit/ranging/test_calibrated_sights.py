"""A calibrated instrument's sights there and back, the root of its covariance, and its errors as those of places."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Receiver

from scanner_sim.analytic import geometry as judge
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.ranging.believed import Design
from scanner_sim.ranging.calibration import Calibration, errors_in_common, position_in_common
from scanner_sim.ranging.ranges import Deflections, Geometry, ranged_peaks

Array = NDArray[np.float64]

DESIGN = Design(0.1, 0.2, 0.05)
R, THETA, PHI = np.array([2.0, 5.0, 9.0]), np.array([0.3, -0.2, 0.05]), np.array([-0.25, 0.1, 0.35])


def calibration(covariance: Array | None = None, **known: float) -> Calibration:
    values = np.zeros(len(NAMES))
    for name, value in known.items():
        values[INDEX[name]] = value
    none = np.zeros((len(NAMES), len(NAMES)))
    return Calibration(values, none if covariance is None else covariance, DESIGN, 0.4)


def test_mirrors_point_where_their_own_encoder_errs() -> None:
    """Claim: Θ = ϑ + z + s ϑ + q ϑ³ + a sin(2π ϑ/P) + b cos(2π ϑ/P), each mirror by its own numbers; and back."""
    known = {
        "zero": (2e-4, -3e-4), "scale": (1e-3, -2e-3), "cubic": (3e-3, 5e-3), "sine": (1e-4, 2e-4),
        "cosine": (3e-4, -1e-4),
    }  # fmt: skip
    one = calibration(
        **{
            f"{axis}_{name}": both[i]
            for name, both in known.items()
            for i, axis in enumerate(("theta", "phi"))
        }
    )
    for found, read, i in zip(one.deflections(THETA, PHI), (THETA, PHI), (0, 1), strict=True):
        zero, scale, cubic, sine, cosine = (both[i] for both in known.values())
        turn = 2.0 * math.pi * read / 0.4
        wanted = read + zero + scale * read + cubic * read**3 + sine * np.sin(turn) + cosine * np.cos(turn)
        np.testing.assert_allclose(found, wanted, rtol=1e-12)
    for found, read in zip(one.readings(*one.deflections(THETA, PHI)), (THETA, PHI), strict=True):
        np.testing.assert_allclose(found, read, atol=1e-10)


def test_a_point_is_found_again_by_its_sight() -> None:
    """Claim: with axes that miss each other and are askew a point has the sight that leads to it; with axes as designed
    it is eq 3's."""
    for known in ({}, {"axis_offset": 2e-3, "axis_skew": 4e-3}):
        geometry = Geometry(0.1, 0.2, 0.05, 50e-6, 0.0, 0.0, calibration=calibration(**known))
        point = geometry.point(R, THETA, PHI)
        for found, wanted in zip(geometry.sight_of(*point), (R, THETA, PHI), strict=True):
            np.testing.assert_allclose(found, wanted, rtol=1e-9)
        apart = np.stack(point, axis=-1) - judge.point_from_shot(R, THETA, PHI, 0.05)
        assert (np.abs(apart).max() > 1e-4) == bool(known)
    plain = Geometry(0.1, 0.2, 0.05, 50e-6, 0.0, 0.0)
    np.testing.assert_allclose(
        np.stack(plain.point(R, THETA, PHI), axis=-1), judge.point_from_shot(R, THETA, PHI, 0.05), rtol=1e-12
    )
    for found, wanted in zip(plain.sight_of(*plain.point(R, THETA, PHI)), (R, THETA, PHI), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_a_peak_has_the_position_of_its_pixel() -> None:
    """Claim: the middle of pixel n is at offset + (n + ½) pitch, and the judge's image there has its range."""
    geometry, none = Geometry(0.1, 0.2, 0.05, 50e-6, 3e-4, 0.0), np.zeros(3)
    place = judge.image_position(R, THETA, 0.1, 0.2)
    pixel = (place - 3e-4) / 50e-6 - 0.5
    np.testing.assert_allclose(geometry.position(pixel), place, rtol=1e-12)
    deflections = Deflections(THETA, PHI, none, none)
    found = ranged_peaks(pixel, none, none.astype(np.uint32), deflections, geometry, None)
    np.testing.assert_allclose(found.range, R, rtol=1e-12)


@pytest.mark.parametrize("distance", [1.5, 5.0, 9.0])
@pytest.mark.parametrize("theta", [-0.2, 0.0, 0.3])
def test_the_range_of_a_peak_is_that_whose_rays_are_there_on_average(distance: float, theta: float) -> None:
    """Claim: on an array that leans and is not in focus everywhere a spot lies in the middle of the rays through the
    pupil, whose points scatter by a fourth of the aperture: to the second order the mean of two such rays. Its range is
    read to a fiftieth of what it would be off if the lens were taken to be in focus."""
    receiver = Receiver(array_tilt=0.2, focus_distance=2.0, baseline=0.2, focal_length=0.1, aperture=0.05)
    line = receiver.line_image
    away = distance - 0.2 * math.sin(theta)
    depth = 1.0 / (1.0 / 0.1 - 1.0 / away)
    through = 0.0125 * np.array([-1.0, 1.0])
    ray = 0.2 * math.cos(theta) / away - through / depth
    across = (through + ray * line.depth) / (1.0 - line.slope * ray)
    place = math.hypot(1.0, line.slope) * float(across.mean())
    pixel, none = np.array([(place - 3e-4) / 50e-6 - 0.5]), np.zeros(1)
    known = Geometry(line.scale, 0.2, 0.05, 50e-6, 3e-4, 0.0, slope=line.slope, focus=line)
    found, blind = (
        ranged_peaks(
            pixel, none + 0.01, np.zeros(1, np.uint32), Deflections(none + theta, none, none, none), one, None
        ).range[0]
        for one in (known, replace(known, focus=None))
    )
    assert abs(blind - distance) > 1e-5
    assert abs(found - distance) < 0.02 * abs(blind - distance)


def test_the_root_of_a_covariance_keeps_what_is_small_beside_what_is_large() -> None:
    """Claim: L Lᵀ is the covariance in each entry, of lengths, angles and ratios of very unlike sizes; what is exact
    has no part in it."""
    names = ("base", "theta_zero", "array_scale", "axis_skew")
    root = np.random.default_rng(2).normal(size=(4, 4)) * np.array([[1e-3], [1e-9], [1e-1], [1e-5]])
    index = [INDEX[name] for name in names]
    covariance = np.zeros((len(NAMES), len(NAMES)))
    covariance[np.ix_(index, index)] = root @ root.T
    found = calibration(covariance).root
    again = found @ found.T
    np.testing.assert_allclose(again[np.ix_(index, index)], root @ root.T, rtol=1e-6)
    assert not np.delete(found, index, axis=0).any()
    # Errors that are one and the same leave one number.
    one = np.zeros((len(NAMES), len(NAMES)))
    one[np.ix_(index, index)] = np.outer(root[:, 0], root[:, 0])
    assert calibration(one).root.shape == (len(NAMES), 1)


@pytest.mark.parametrize("by", ["triangulation", "coaxial", "offset"])
def test_errors_of_a_place_are_those_of_its_point(by: str) -> None:
    """Claim: a place (Θ, φ, R) that is moved by C z has its point moved by B z: by differences of eq 3."""
    covariance = np.diag(np.full(len(NAMES), 1e-8))
    one = calibration(covariance)
    _, moved = errors_in_common(one, by, R, THETA, PHI)
    place = position_in_common(one, by, np.stack([THETA, PHI, R], axis=-1))
    assert place.shape == moved.shape == (3, 3, len(NAMES))
    for kind in range(len(NAMES)):
        theta, phi, r = 1e-2 * place[..., kind].T
        there, back = (
            judge.point_from_shot(R + sign * r, THETA + sign * theta, PHI + sign * phi, 0.05)
            for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose((there - back) / 2e-2, moved[..., kind], atol=1e-9, rtol=1e-6)
