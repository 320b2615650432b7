"""The background on the line: panoramas against brute force, and against what light must be."""

from __future__ import annotations

from typing import Any

import claims
import numpy as np
import pytest
from scipy import stats

from scanner_sim.config.scanner import Scanner
from scanner_sim.scan.raster import RasterScan
from scanner_sim.scene.objects import Scene

PIXELS, SIZE = 256, 64
SCANNER = Scanner()
RASTER = RasterScan(rows=SIZE, columns=SIZE, horizontal=(-0.2, 0.2), vertical=(-0.2, 0.2))
WALL = {"name": "wall", "shape": "rectangle", "size": (20.0, 20.0), "position": (0.0, 0.0, 8.0)}
GREY = {"reflectance": 0.6}
SHADOWED: list[dict[str, Any]] = [
    {**WALL, "material": GREY},
    {
        "name": "box",
        "shape": "box",
        "size": (1.0, 1.0, 1.0),
        "position": (0.3, 0.0, 6.0),
        "material": {"reflectance": 0.3},
    },
]

pytestmark = pytest.mark.usefixtures("device")


def bench() -> Any:
    from scanner_sim.render.transport import OpticalLayout

    sensor = SCANNER.position_sensor
    separation = SCANNER.mirrors.axis_separation
    place = sensor.pitch, sensor.height, sensor.offset, sensor.diffusion
    return OpticalLayout(SCANNER.laser, SCANNER.receiver, separation, 1.0, *place)


def panorama_lines(
    loaded: Any,
    light: Any,
    voxels: list[tuple[int, int]],
    bounces: int,
    seed: int,
    **changes: Any,
) -> np.ndarray:
    """Return the background [W] of voxels for a Sun of 1 W/m², shape (voxels, pixels)."""
    import drjit as dr
    import mitsuba as mi

    from scanner_sim.render.background.panorama import render_panorama
    from scanner_sim.render.background.view import Rows, panorama_view
    from scanner_sim.render.beam.light import Light
    from scanner_sim.render.incident import Incident, Throughput
    from scanner_sim.render.shots import Shots

    theta, phi = RASTER.angles()
    view = panorama_view(Rows(RASTER.horizontal, phi), bench(), PIXELS)
    settings = {"bounces": bounces, "samples": 4, **changes}
    panorama = render_panorama(loaded, bench(), light, view, seed=seed, **settings)
    one = np.ones(PIXELS)
    throughput = Throughput(bench(), PIXELS, one, one, 0.0 * one)
    lines = []
    for row, column in voxels:
        shot = Shots(mi.UInt32([row * SIZE + column]), mi.Float([theta[column]]), mi.Float([phi[row]]))
        dark = Light(mi.UInt32([0]), shot.number, mi.Float([0.0]), mi.Float([0.0]), mi.Float([1.0]))
        incident = Incident(dark, shot, SIZE, throughput, panorama)
        lines.append(incident.background(dr.arange(mi.UInt32, PIXELS), dr.zeros(mi.UInt32, PIXELS)).numpy())
    return np.array(lines, dtype=np.float64)


def sunlit() -> Any:
    """Return a sky with the Sun over the scanner's left shoulder and the Earth below."""
    from scanner_sim.render.background.sky import sky_light

    return sky_light((-0.5, -0.6, -0.6), 4.65e-3, (0.0, 1.0, 0.3), albedo=(0.3, 0.3))


def brute_force(loaded: Any, row: int, column: int, *, bounces: int, shot: int) -> Any:
    """Return the background of a voxel from its own pixels, 2048 rays each."""
    from scanner_sim.render.background.reference import reference_background

    theta, phi = (float(angles[place]) for angles, place in zip(RASTER.angles(), (column, row), strict=True))
    light = sunlit()
    return reference_background(
        loaded, bench(), light, PIXELS, theta, phi, bounces=bounces, samples=2048, shot=shot
    )


@pytest.mark.slow
def test_panoramas_agree_with_brute_force() -> None:
    """Claim: one panorama per row serves every voxel: it gives what rays from each pixel's own field give.

    Set-up: a wall with a box before it that throws a shadow, Sun and Earth, four bounces; five voxels on the wall,
    in the shadow and at the box's edge. Eight panoramas of different seeds give mean and standard error of each
    pixel; brute force 2048 rays per pixel, from the pixel itself. Expected: z of the difference summed over each
    voxel's pixels is standard normal, but for the eight seeds' t distribution with 7 degrees of freedom.
    Tolerance: level 1e-5 for each voxel; a share of 0.5 % would be found on the wall, where the standard error is
    0.1 %.
    """
    from scanner_sim.scene.files.loader import load_scene

    loaded = load_scene(Scene(objects=tuple(SHADOWED)))
    light = sunlit()
    voxels = [(10, 5), (32, 40), (33, 60), (50, 30), (20, 33)]
    lines = np.array([panorama_lines(loaded, light, voxels, 4, seed) for seed in range(8)])
    for number, (row, column) in enumerate(voxels):
        reference = brute_force(loaded, row, column, bounces=4, shot=number)
        sums = lines[:, number].sum(axis=1)
        error = np.hypot(sums.std(ddof=1) / np.sqrt(8), np.sqrt((reference.standard_error**2).sum()))
        difference = sums.mean() - reference.power.sum()
        assert abs(difference) / error < stats.t.isf(0.5e-5, 7), (row, column)
        assert error < 0.01 * reference.power.sum()


@pytest.mark.slow
def test_a_glossy_sphere_agrees_with_brute_force() -> None:
    """Claim: light that changes over a bent, glossy surface is not blurred beyond the Monte-Carlo error.

    Set-up: a sphere of weathered metal before a wall, Sun and Earth, two bounces; voxels at its middle, beside it
    and near its limb, each about 256 pixels that look at all of it. Eight panoramas and 2048 rays per pixel of brute
    force, as above. Expected: z of each voxel's sum, with the eight seeds' t distribution. Tolerance: level 1e-5;
    besides this the filter's reach may shift a sum by 0.5 % of it.
    """
    from scanner_sim.scene.files.loader import load_scene

    place = (-0.3, 0.0, 6.0)
    ball = {
        "name": "ball",
        "shape": "sphere",
        "diameter": 1.2,
        "position": place,
        "material": "weathered_aluminium",
    }
    loaded = load_scene(Scene(objects=({**WALL, "material": GREY}, ball)))
    light = sunlit()
    voxels = [(32, 24), (24, 30), (40, 34)]
    lines = np.array([panorama_lines(loaded, light, voxels, 2, seed) for seed in range(8)])
    for number, (row, column) in enumerate(voxels):
        reference = brute_force(loaded, row, column, bounces=2, shot=number)
        sums, total = lines[:, number].sum(axis=1), reference.power.sum()
        error = np.hypot(sums.std(ddof=1) / np.sqrt(8), np.sqrt((reference.standard_error**2).sum()))
        assert abs(sums.mean() - total) < stats.t.isf(0.5e-5, 7) * error + 0.005 * total, (row, column)


@pytest.mark.slow
def test_the_stated_error_is_the_actual_one() -> None:
    """Claim: the standard error that a panorama states is that of its mean over the window of 200 µm.

    Set-up: the wall and the box, 12 seeds. Actual squared error: the variance over the seeds of four bins' mean;
    stated: the mean square of ``error``. Both are summed over parts of the picture where one source rules: the
    smooth wall, and all bins about edges. Expected: ratio 1. Neighbours share noise over about 30 bins, so the
    picture has some hundreds of independent places, and with twelve seeds the ratio scatters by 10 %, as that of two
    variances of which one has 200 degrees of freedom. Tolerance: the bounds of that at 10⁻⁴, 0.69 to 1.50. Errors
    added linearly would give 4 or more, one half's error in place of the mean's 2.
    """
    from scanner_sim.render.background.panorama import render_panorama
    from scanner_sim.render.background.view import Rows, panorama_view
    from scanner_sim.scene.files.loader import load_scene

    loaded = load_scene(Scene(objects=tuple(SHADOWED)))
    light = sunlit()
    view = panorama_view(Rows(RASTER.horizontal, RASTER.angles()[1]), bench(), PIXELS)
    means, stated = [], []
    for seed in range(12):
        panorama = render_panorama(loaded, bench(), light, view, bounces=3, samples=4, seed=seed)
        layer = panorama.in_band.numpy().astype(np.float64).reshape(view.rows, view.bins)
        # Bins −2 to 2, the outer ones by half: the window of four pixels about a bin.
        means.append(
            (0.5 * layer[:, :-4] + layer[:, 1:-3:] + layer[:, 2:-2] + layer[:, 3:-1] + 0.5 * layer[:, 4:]) / 4
        )
        stated.append(panorama.error.numpy().astype(np.float64).reshape(layer.shape)[:, 2:-2] ** 2)
    actual, expected = np.var(means, axis=0, ddof=1), np.mean(stated, axis=0)
    rough = expected > np.quantile(expected, 0.8)
    for part in (rough, ~rough):
        found = claims.scatter_ratio(
            float(np.sqrt(expected[part].sum())), float(np.sqrt(actual[part].sum())), (np.inf, 200.0)
        )
        assert found
        assert found.finds < 0.41


def test_pixels_count_through_height_and_point_spread() -> None:
    from scanner_sim.render.background.view import height_quantiles

    place = height_quantiles(250e-6, 40e-6)
    middle = 0.5 * (place[1:] + place[:-1])
    assert middle.mean() == pytest.approx(0.0, abs=1e-9)
    assert middle.std() ** 2 == pytest.approx((250e-6) ** 2 / 12.0 + (40e-6) ** 2, rel=5e-3)
    np.testing.assert_allclose(height_quantiles(250e-6, 0.0)[[0, -1]], [-125e-6, 125e-6])


def test_a_white_room_is_as_bright_as_its_sky() -> None:
    """Claim: nothing is lost or gained between sky, surface and line (white furnace).

    Set-up: a white plane (ρ = 1) that faces the Earth, whose disc fills half of the sky as seen from just above it,
    fully lit; one bounce. Expected: the irradiance of the lit Earth over π, by fixed directions. Tolerance: 1 %,
    five standard errors of the panorama's mean over 256 pixels.
    """
    from scanner_sim.render.background.sky import earth_directions, sky_light
    from scanner_sim.render.incident import Throughput
    from scanner_sim.scene.files.loader import load_scene

    plane = {**WALL, "material": {"reflectance": 1.0}}
    loaded = load_scene(Scene(objects=(plane,)))
    # The Earth behind the scanner, and the Sun hidden from the wall's front, lighting the Earth's near side.
    light = sky_light((0.0, -0.6, 0.8), 4.65e-3, (0.0, 0.0, -1.0), albedo=(1.0, 1.0))
    line = panorama_lines(loaded, light, [(32, 32)], 1, 0)[0]
    directions, weights = earth_directions(light, 4096)
    irradiance = float((weights * np.maximum(-directions[:, 2], 0.0)).sum())
    one = np.ones(PIXELS)
    unit = Throughput(bench(), PIXELS, one, one, 0.0 * one).in_band.numpy().astype(np.float64)
    assert irradiance > 0.01
    assert line.sum() == pytest.approx(irradiance / np.pi * unit.sum(), rel=0.01)


def test_the_same_bytes_whatever_is_traced_together(monkeypatch: pytest.MonkeyPatch) -> None:
    from scanner_sim.render.background import panorama as background
    from scanner_sim.scene.files.loader import load_scene

    loaded = load_scene(Scene(objects=tuple(SHADOWED)))
    light = sunlit()
    whole = panorama_lines(loaded, light, [(32, 40)], 3, 5)
    monkeypatch.setattr(background, "_BINS_TOGETHER", 1 << 12)
    np.testing.assert_array_equal(panorama_lines(loaded, light, [(32, 40)], 3, 5), whole)
