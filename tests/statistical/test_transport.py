"""The light on the line: beamlets against brute force, and against the judge's closed forms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from scanner_sim.analytic import beam, geometry
from scanner_sim.config.scanner import Scanner
from scanner_sim.render.settings import Transport
from scanner_sim.scene.objects import Scene

PIXELS = 256
GREY = {"reflectance": 0.5}
SWEEP = (1e-3, 0.0)
"""Travel of Θ in a dwell: a raster of 512 columns over 30°."""
SCANNER = Scanner()

pytestmark = pytest.mark.usefixtures("device")


def wall(distance: float, axis: Any = "y", degrees: float = 0.0, **changes: Any) -> dict[str, Any]:
    """Return a large wall on the axis, turned."""
    turn = {"axis": axis, "angle": float(np.deg2rad(degrees))}
    place = {"position": (0.0, 0.0, distance), "rotation": turn, "size": (40.0, 40.0), "material": GREY}
    return {"name": "wall", "shape": "rectangle", **place, **changes}


def bench(height: float = SCANNER.position_sensor.height, **laser: float) -> Any:
    from scanner_sim.render.transport import OpticalLayout

    sensor = SCANNER.position_sensor
    return OpticalLayout(
        SCANNER.laser.model_copy(update=laser),
        SCANNER.receiver,
        SCANNER.mirrors.axis_separation,
        1.0,
        sensor.pitch,
        height,
        sensor.offset,
        sensor.diffusion,
    )


def both(
    objects: Sequence[dict[str, Any]],
    theta: np.ndarray,
    phi: np.ndarray,
    rays: int,
    travel: tuple[float, float] = (0.0, 0.0),
    synchronisation: float = 0.0,
    **laser: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the lines [W], shape (shots, pixels), by beamlets and by brute force."""
    import drjit as dr
    import mitsuba as mi

    from scanner_sim.render.background.reference import reference_line
    from scanner_sim.render.beam.line_projection import LineProjection
    from scanner_sim.render.beam.splitter import render_light
    from scanner_sim.render.shots import Shots
    from scanner_sim.scene.files.loader import load_scene

    loaded = load_scene(Scene(objects=tuple(objects)))
    theta, phi = theta.astype(np.float32), phi.astype(np.float32)
    same = [dr.full(mi.Float, value, len(theta)) for value in (*travel, synchronisation)]
    shots = Shots(dr.arange(mi.UInt32, len(theta)), mi.Float(theta), mi.Float(phi), *same)
    _, lights = render_light(loaded, LineProjection(bench(**laser)), Transport(), shots, 0)
    lines = np.zeros((len(theta), PIXELS))
    for light in lights:
        for place, index in enumerate(light.index.numpy()):
            lines[index] = light.line(place, PIXELS)
    reference = [
        reference_line(
            loaded,
            bench(**laser),
            PIXELS,
            float(t),
            float(p),
            travel=travel,
            synchronisation=synchronisation,
            rays=rays,
            shot=number,
        ).power
        for number, (t, p) in enumerate(zip(theta, phi, strict=True))
    ]
    return lines, np.array(reference)


def centroids(lines: np.ndarray) -> np.ndarray:
    return np.asarray((lines * np.arange(PIXELS)).sum(axis=1) / lines.sum(axis=1))


SMOOTH = {
    "plane at 2 m": ([wall(2.0)], 0.3),
    "plane at 10 m": ([wall(10.0)], 0.4),
    "tilted 60° about y": ([wall(3.0, "y", 60.0)], 0.08),
    "tilted 60° about x": ([wall(3.0, "x", 60.0)], 0.08),
    "tilted 60° askew": ([wall(2.2, (1.0, 1.0, 0.0), 60.0)], 0.04),
    "sphere of 200 mm": (
        [{"name": "ball", "shape": "sphere", "diameter": 0.2, "position": (0, 0, 3.0), "material": GREY}],
        0.018,
    ),
    "glossy metal": ([wall(3.0, "y", -6.0, material="aluminised_kapton")], 0.08),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", SMOOTH)
def test_smooth_surfaces_agree_with_brute_force(case: str) -> None:
    """Claim: on smooth surfaces the spot lies within 0.005 pixel rms of the truth, its energy within 1e-3.

    Set-up: 6 shots over the field, swept by 1 mrad while they are measured, against 2²¹ random rays each, at
    planes near and far, tilted 60° in three ways, a sphere out to 0.76 of its radius and a glossy metal (towards the
    limb the beamlets err more: 1e-3 and 0.01 pixel at 0.98 of the radius). Expected: equal lines. Tolerance:
    0.005 pixel rms, 0.0025 mean, 1e-3 of the energy; the reference's own noise is 0.0008 pixel and 1e-4 (far) to 2e-4
    (near) of the energy, a fifth of its bound, so that an error of 0.003 pixel in the mean is found with 93 %.
    """
    objects, span = SMOOTH[case]
    random = np.random.default_rng(1)
    theta, phi = random.uniform(-span, span, (2, 6))
    lines, reference = both(objects, theta, phi, 1 << 21, SWEEP)
    difference = centroids(lines) - centroids(reference)
    assert np.sqrt(np.mean(difference**2)) < 0.005
    assert abs(np.mean(difference)) < 0.0025
    energy = lines.sum(axis=1) / reference.sum(axis=1) - 1.0
    assert np.abs(energy).max() < 1e-3


EDGES = {
    "material": [
        wall(5.0, position=(2.0, 0.0, 5.0), size=(4.0, 4.0), material={"reflectance": 0.9}),
        wall(5.0, name="dark", position=(-2.0, 0.0, 5.0), size=(4.0, 4.0), material={"reflectance": 0.05}),
    ],
    "depth": [
        wall(5.0, position=(2.0, 0.0, 5.0), size=(4.0, 8.0)),
        wall(5.5, name="behind"),
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize("case", EDGES)
def test_edges_agree_with_brute_force(case: str) -> None:
    """Claim: across an edge the light is right within 2 % of the contrast, and unbiased.

    Set-up: 12 shots, swept by 1 mrad, across a vertical edge at 5 m, of reflectance (0.05 to 0.9) and of depth (0.5
    m, which also hides part of what is behind from the lens), against 2²⁰ random rays each. Expected: equal energy
    and equal lines. Tolerance: 2 % of the contrast for the worst shot, 0.5 % for the mean (the residual spread of
    0.4 % over 12 shots leaves 0.12 %).
    """
    theta = np.linspace(-0.004, 0.004, 12)
    phi = np.random.default_rng(2).uniform(-0.02, 0.02, 12)
    lines, reference = both(EDGES[case], theta, phi, 1 << 20, SWEEP)
    energy, expected = lines.sum(axis=1), reference.sum(axis=1)
    error = (energy - expected) / np.ptp(expected)
    assert np.ptp(expected) > 0.1 * expected.max()
    assert np.abs(error).max() < 0.02
    assert abs(error.mean()) < 0.005
    assert np.abs(lines - reference).max() < 0.02 * reference.max()


def test_two_edges_with_a_gap_between_them_are_two_peaks() -> None:
    """Claim: a beam on both sides of a gap, through which a part of it meets nothing, has a narrow peak of each side
    far down the line, too.

    Set-up: 3 shots across a gap of 0.8 mm between walls at 2 m and 2.05 m, seen at pixels 194 and 200, against 2¹⁹
    random rays each. Expected: equal lines. Tolerance: 5 % of the brightest pixel, for beamlets err by
    2 % here; peaks that flow together err by 60 %.
    """
    strips = [
        wall(2.0, position=(-2.0004, 0.0, 2.0), size=(4.0, 4.0)),
        wall(2.05, name="behind", position=(2.0004, 0.0, 2.05), size=(4.0, 4.0)),
    ]
    lines, reference = both(strips, np.array([-3e-4, 0.0, 3e-4]), np.zeros(3), 1 << 19)
    assert np.abs(lines - reference).max() < 0.05 * reference.max()
    # Between the peaks there is next to nothing.
    assert (reference[:, 197] < 0.1 * reference.max(axis=1)).all()
    assert (lines[:, 197] < 0.1 * reference.max(axis=1)).all()


def test_a_plane_agrees_with_brute_force_quickly() -> None:
    """Claim: as above, for one plane at 4 m tilted 30°.

    Set-up: 4 shots, 2²⁰ rays. Expected: equal centroid and energy. Tolerance: 5 standard errors of the
    reference (0.0016 pixel each).
    """
    theta, phi = np.array([-0.2, -0.05, 0.1, 0.2]), np.array([0.1, -0.1, 0.0, 0.2])
    lines, reference = both([wall(4.0, "y", 30.0)], theta, phi, 1 << 20)
    assert np.abs(centroids(lines) - centroids(reference)).max() < 0.008
    np.testing.assert_allclose(lines.sum(axis=1), reference.sum(axis=1), rtol=1e-3)


@pytest.mark.slow
def test_a_swept_plane_agrees_with_brute_force_quickly() -> None:
    """Claim: the same while the mirrors sweep along Θ and φ and the receiver looks 50 µrad past the laser.

    Set-up: a plane at 3 m askew by 60°, 4 shots swept by 4 mrad and −3 mrad, 2²⁰ rays with random moments.
    Expected: equal centroid, energy and variance. Tolerance: 5 standard errors of the reference for centroid
    (0.0016 pixel each; the angle alone is 0.1 pixel) and variance (0.5 %; the sweep is 6 to 30 % of it).
    """
    theta, phi = np.array([-0.05, -0.02, 0.02, 0.05]), np.array([0.05, -0.05, 0.0, 0.02])
    askew = [wall(3.0, (0.6, 1.0, 0.0), 60.0)]
    lines, reference = both(askew, theta, phi, 1 << 20, (4e-3, -3e-3), 50e-6)
    assert np.abs(centroids(lines) - centroids(reference)).max() < 0.008
    np.testing.assert_allclose(lines.sum(axis=1), reference.sum(axis=1), rtol=1e-3)
    np.testing.assert_allclose(variances(lines), variances(reference), rtol=0.025)
    still, _ = both(askew, theta, phi, 1)
    assert (variances(lines) / variances(still) > 1.05).all()


@pytest.mark.parametrize(("turn", "sweep"), [(0.0, (8e-3, 0.0)), (65.0, (8e-3, 0.0)), (-65.0, (0.0, 8e-3))])
def test_a_slope_smears_the_spot_as_the_judge_says(turn: float, sweep: tuple[float, float]) -> None:
    """Claim: a sweep leaves the spot where it is on a plane square to the beam, and smears it on a slope.

    Set-up: planes at 4 m, square to the axis, turned by 65° about y, and turned by −65° about x for a sweep along
    φ; sweeps of 8 mrad. Expected: mean and variance of the light change by those of the judge's p(Θ, φ), averaged
    over the dwell by quadrature of eq 1 on the plane. Tolerance: 1.5e-3 pixel, a fifth of the largest move; 1 % of
    the added variance of 0.245 pixel², or 1e-3 pixel² (points of the aperture belong to beamlets, hence to
    moments).
    """
    axis = "y" if sweep[0] else "x"
    plane = [wall(4.0, axis, turn)]
    angle = np.deg2rad(turn)
    normal = (-np.sin(angle), 0.0, -np.cos(angle)) if axis == "y" else (0.0, np.sin(angle), -np.cos(angle))
    place = np.array([0.03]), np.array([-0.02])
    (swept, _), (still, _) = both(plane, *place, 1, sweep), both(plane, *place, 1)
    chief = geometry.image_position(
        geometry.range_to_plane(*place, 0.05, (0.0, 0.0, 4.0), normal), place[0], 0.1, 0.2
    )
    mean, sigma = geometry.swept_image(0.03, -0.02, sweep, 0.1, 0.2, 0.05, (0.0, 0.0, 4.0), normal)
    pitch = SCANNER.position_sensor.pitch
    moved = float((centroids(swept) - centroids(still))[0])
    assert moved == pytest.approx(float(mean - chief[0]) / pitch, abs=1.5e-3)
    added = float((variances(swept) - variances(still))[0])
    assert added == pytest.approx((sigma / pitch) ** 2, rel=1e-2, abs=1e-3)
    assert (added > 0.02) == (turn != 0.0)


@pytest.mark.parametrize("sweep", [(0.06, 0.0), (0.0, 0.06)])
def test_a_sweep_of_hundreds_of_spots_adds_no_more_than_the_slope_does(sweep: tuple[float, float]) -> None:
    """Claim: however long the sweep, the spot stays as narrow as its image, but for the judge's smear.

    Set-up: a plane at 4 m turned by 30°, sweeps of 60 mrad, 230 standard deviations of the beam. Expected: the judge's
    added variance, 1 pixel². Tolerance: 2 % of it, or 3 % of the spot's own of 1 pixel²: 48 beamlets stand for the
    whole sweep. Beamlets that stand for moments as long as at 100 deviations add another pixel².
    """
    axis, angle = ("y", np.deg2rad(30.0)) if sweep[0] else ("x", np.deg2rad(-30.0))
    normal = (-np.sin(angle), 0.0, -np.cos(angle)) if axis == "y" else (0.0, np.sin(angle), -np.cos(angle))
    plane, place = [wall(4.0, axis, float(np.rad2deg(angle)))], (np.array([0.03]), np.array([-0.02]))
    (swept, _), (still, _) = both(plane, *place, 1, sweep), both(plane, *place, 1)
    _, sigma = geometry.swept_image(0.03, -0.02, sweep, 0.1, 0.2, 0.05, (0.0, 0.0, 4.0), normal)
    own = float(variances(still)[0])
    added = float(variances(swept)[0]) - own
    wanted = (sigma / SCANNER.position_sensor.pitch) ** 2
    assert added == pytest.approx(wanted, rel=2e-2, abs=3e-2 * own)


@pytest.mark.parametrize("distance", [3.0, 6.0])
def test_a_beam_with_its_waist_ahead_has_its_width_everywhere(distance: float) -> None:
    """Claim: a beam that is focused ahead of the scanner has its Gaussian width before and at its waist.

    Set-up: a waist of 0.5 mm at 6 m, walls square to the axis at 3 m, where the beam has converged by half, and at 6 m.
    Expected: variance of the line (f w/2R)² + aberration² + diffusion² + a pixel's 1/12, with w(z) by the judge's beam.
    Tolerance: 2 %; with its waist as far behind the scanner the beam would be three times wider at 3 m.
    """
    waist = {"waist_radius": 0.5e-3, "waist_distance": 6.0}
    lines, _ = both([wall(distance)], np.zeros(1), np.zeros(1), 1, **waist)
    w = float(beam.beam_radius(distance, 0.5e-3, 6.0, SCANNER.laser.wavelength))
    image = SCANNER.receiver.focal_length * 0.5 * w / distance
    sensor, receiver = SCANNER.position_sensor, SCANNER.receiver
    expected = (image**2 + sensor.diffusion**2 + receiver.aberration**2) / sensor.pitch**2 + 1.0 / 12.0
    assert float(variances(lines)[0]) == pytest.approx(expected, rel=0.02)


def test_a_wide_beam_on_a_steep_wall_has_the_width_of_both_its_directions() -> None:
    """Claim: light that is displaced up or down arrives elsewhere along the line, too, where the wall stands askew.

    Set-up: the beam on a wall at 2 m that recedes upwards by 80°, pixels so high that they cut nothing. Expected:
    p = f (d − x)/z with z = R + y tan 80°: variance (f w/2R)² (1 + (d tan 80°/R)²), the lens's blur and a pixel's 1/12.
    Tolerance: 1e-4 for single precision; the beam's depth, σ 3e-3 of R, makes some 1e-5. What the beamlets themselves
    are wide up and down is 2 % of it.
    """
    distance, steep = 2.0, np.deg2rad(80.0)
    lines, _ = both([wall(distance, "x", 80.0)], np.zeros(1), np.zeros(1), 1, height=0.05)
    sensor, receiver, laser = SCANNER.position_sensor, SCANNER.receiver, SCANNER.laser
    w = float(beam.beam_radius(distance, laser.waist_radius, laser.waist_distance, laser.wavelength))
    image = receiver.focal_length * 0.5 * w / distance
    both_ways = image**2 * (1.0 + (receiver.baseline * np.tan(steep) / distance) ** 2)
    blur = sensor.diffusion**2 + receiver.aberration**2
    assert float(variances(lines)[0]) == pytest.approx(
        (both_ways + blur) / sensor.pitch**2 + 1.0 / 12.0, rel=1e-4
    )


def variances(lines: np.ndarray) -> np.ndarray:
    apart = np.arange(PIXELS) - centroids(lines)[:, None]
    return np.asarray((lines * apart**2).sum(axis=1) / lines.sum(axis=1))
