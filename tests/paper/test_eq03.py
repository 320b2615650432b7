"""Eq 3: the coordinates of a point from its range and the two deflections."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scanner_sim.analytic import geometry
from scanner_sim.optics.deflection import deflected_frame
from scanner_sim.ranging import coordinates

ANGLES = st.floats(-0.5, 0.5)
RANGES = st.floats(1.0, 200.0)
SEPARATIONS = st.floats(0.0, 0.3)


@given(R=RANGES, theta=ANGLES, phi=ANGLES, D=SEPARATIONS)
def test_as_printed(R: float, theta: float, phi: float, D: float) -> None:
    """Claim: ``coordinates`` is eq 3 as printed.

    Set-up: the printed matrix with ψ = D_g/R, written out here. Expected: equal. Tolerance: 1e-13 of R.
    """
    psi = D / R
    printed = R * np.array(
        [
            np.sin(theta),
            (np.cos(theta) - psi) * np.sin(phi),
            (1.0 - np.cos(phi)) * psi + np.cos(theta) * np.cos(phi),
        ]
    )
    np.testing.assert_allclose(coordinates.coordinates(R, theta, phi, D), printed, rtol=0.0, atol=1e-13 * R)


@given(R=RANGES, theta=ANGLES, phi=ANGLES, D=SEPARATIONS)
def test_is_a_turn_of_the_plane_of_triangulation(R: float, theta: float, phi: float, D: float) -> None:
    """Claim: eq 3 is the point (R sinΘ, 0, R cosΘ) turned by φ about the line y = 0, z = D_g.

    Set-up: the judge turns with 4 × 4 matrices; the simulator's beam starts at ``laser`` and runs along
    ``along``. Expected: all three equal. Tolerance: 1e-13 of R, rounding.
    """
    turned = geometry.point_from_shot(R, theta, phi, D)
    frame = deflected_frame(np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi), D, 0.2)
    np.testing.assert_allclose(coordinates.coordinates(R, theta, phi, D), turned, rtol=0.0, atol=1e-13 * R)
    np.testing.assert_allclose(
        np.array(frame.laser) + R * np.array(frame.along), turned, rtol=0.0, atol=1e-13 * R
    )
    np.testing.assert_allclose(frame.lens, geometry.lens_node(phi, D, 0.2), rtol=0.0, atol=1e-15)
    for ours, judged in zip(
        (frame.along, frame.across, frame.normal), geometry.scanner_axes(theta, phi), strict=True
    ):
        np.testing.assert_allclose(ours, judged, rtol=0.0, atol=1e-15)


@given(R=RANGES, theta=ANGLES, phi=ANGLES, D=SEPARATIONS)
def test_inverse(R: float, theta: float, phi: float, D: float) -> None:
    """Claim: ``angles_and_range`` is the exact inverse of eq 3, as is the judge's.

    Set-up: random shots at 1–200 m. Expected: (R, Θ, φ) again. Tolerance: 1e-12, rounding amplified by at
    most R/(R cosΘ − D_g) < 2 in φ.
    """
    point = coordinates.coordinates(R, theta, phi, D)
    back = coordinates.angles_and_range(*point, D)
    np.testing.assert_allclose(back, (R, theta, phi), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(
        geometry.shot_from_point(np.stack(point), D), (R, theta, phi), rtol=1e-12, atol=1e-12
    )


def test_range_is_the_path_and_not_the_distance() -> None:
    """Claim: R is the path of light from the first axis; |(x, y, z)| is shorter when φ is not zero.

    Set-up: R 2 m, Θ 0, φ 0.5 rad, D_g 50 mm. The path goes from the origin by the second axis, 50 mm ahead:
    the straight line is |X|² = D_g² + (R − D_g)² + 2 D_g (R − D_g) cosφ, the law of cosines. Expected: its
    root, 1.9940 m. Tolerance: rounding; the difference to R is 6 mm, so a mix-up would show.
    """
    point = np.array(coordinates.coordinates(2.0, 0.0, 0.5, 0.05))
    expected = np.sqrt(0.05**2 + 1.95**2 + 2.0 * 0.05 * 1.95 * np.cos(0.5))
    assert np.linalg.norm(point) == pytest.approx(expected, rel=1e-13)
    assert expected == pytest.approx(1.9940, abs=5e-5)


@given(theta=ANGLES, phi=ANGLES)
def test_rays_to_a_plane_and_a_sphere(theta: float, phi: float) -> None:
    """Claim: the judge's ranges to surfaces put eq 3 onto these surfaces.

    Set-up: a tilted plane through (0.1, −0.2, 5) and a sphere of 3 m about (0, 0, 6). Expected: the point of
    eq 3 satisfies the surface's equation. Tolerance: 1e-12 m, rounding; at 0.5 rad the sphere is still hit
    in its front half.
    """
    D, normal, anchor = 0.05, np.array([0.3, -0.2, -1.0]), np.array([0.1, -0.2, 5.0])
    on_plane = np.stack(
        coordinates.coordinates(geometry.range_to_plane(theta, phi, D, anchor, normal), theta, phi, D)
    )
    assert (on_plane - anchor) @ normal == pytest.approx(0.0, abs=1e-12)
    R = geometry.range_to_sphere(0.5 * theta, 0.5 * phi, D, (0.0, 0.0, 6.0), 3.0)
    on_sphere = np.stack(coordinates.coordinates(R, 0.5 * theta, 0.5 * phi, D))
    assert np.linalg.norm(on_sphere - [0.0, 0.0, 6.0]) == pytest.approx(3.0, abs=1e-12)
    assert on_sphere[2] < 6.0
