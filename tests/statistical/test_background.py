"""The background on the line: panoramas against brute force, and against what light must be."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from scanner_sim.scan.raster import RasterScan
from scanner_sim.scanner import Scanner
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
    from scanner_sim.render.transport import Bench

    sensor = SCANNER.position_sensor
    separation = SCANNER.mirrors.axis_separation
    return Bench(SCANNER.laser, SCANNER.receiver, separation, 1.0, sensor.pitch, sensor.height, sensor.offset)


def panorama_lines(
    loaded: Any,
    light: Any,
    albedo: Any,
    voxels: list[tuple[int, int]],
    bounces: int,
    seed: int,
    **changes: Any,
) -> np.ndarray:
    """Return the background [W] of voxels for a Sun of 1 W/m², shape (voxels, pixels)."""
    import drjit as dr
    import mitsuba as mi

    from scanner_sim.render.background import render_panorama
    from scanner_sim.render.incident import Incident, Throughput
    from scanner_sim.render.shots import Shots
    from scanner_sim.render.view import panorama_view

    theta, phi = RASTER.angles()
    view = panorama_view(RASTER.horizontal, phi, bench(), PIXELS)
    settings = {"bounces": bounces, "samples": 4, **changes}
    panorama = render_panorama(loaded, bench(), light, albedo, view, seed=seed, **settings)
    one = np.ones(PIXELS)
    throughput = Throughput(bench(), PIXELS, one, one, 0.0 * one)
    lines = []
    for row, column in voxels:
        shot = Shots(mi.UInt32([row * SIZE + column]), mi.Float([theta[column]]), mi.Float([phi[row]]))
        incident = Incident(None, shot, SIZE, throughput, panorama)
        lines.append(incident.background(dr.arange(mi.UInt32, PIXELS), dr.zeros(mi.UInt32, PIXELS)).numpy())
    return np.array(lines, dtype=np.float64)


def sunlit() -> tuple[Any, Any]:
    """Return a sky with the Sun over the scanner's left shoulder and the Earth below, and its albedo."""
    from scanner_sim.render.paths import Albedo
    from scanner_sim.render.sky import sky_light

    return sky_light((-0.5, -0.6, -0.6), 4.65e-3, (0.0, 1.0, 0.3)), Albedo(0.3, 0.3)


def test_panoramas_agree_with_brute_force() -> None:
    """Claim: one panorama per row serves every voxel: it gives what rays from each pixel's own field give.

    Set-up: a wall with a box before it that throws a shadow, Sun and Earth, four bounces; five voxels on the wall,
    in the shadow and at the box's edge. Eight panoramas of different seeds give mean and standard error of each
    pixel; brute force 2048 rays per pixel, from the pixel itself. Expected: z of the difference summed over each
    voxel's pixels is standard normal, but for the eight seeds' t distribution with 7 degrees of freedom.
    Tolerance: level 1e-5 for each voxel; a share of 0.5 % would be found on the wall, where the standard error is
    0.1 %.
    """
    from scanner_sim.render.reference import reference_background
    from scanner_sim.scene.loader import load_scene

    loaded = load_scene(Scene(objects=tuple(SHADOWED)))
    light, albedo = sunlit()
    voxels = [(10, 5), (32, 40), (33, 60), (50, 30), (20, 33)]
    lines = np.array([panorama_lines(loaded, light, albedo, voxels, 4, seed) for seed in range(8)])
    theta, phi = RASTER.angles()
    for number, (row, column) in enumerate(voxels):
        reference = reference_background(
            loaded,
            bench(),
            light,
            albedo,
            PIXELS,
            float(theta[column]),
            float(phi[row]),
            bounces=4,
            samples=2048,
            shot=number,
        )
        sums = lines[:, number].sum(axis=1)
        error = np.hypot(sums.std(ddof=1) / np.sqrt(8), np.sqrt((reference.standard_error**2).sum()))
        difference = sums.mean() - reference.power.sum()
        assert abs(difference) / error < stats.t.isf(0.5e-5, 7), (row, column)
        assert error < 0.01 * reference.power.sum()


def test_a_white_room_is_as_bright_as_its_sky() -> None:
    """Claim: nothing is lost or gained between sky, surface and line (white furnace).

    Set-up: a white plane (ρ = 1) that faces the Earth, whose disc fills half of the sky as seen from just above it,
    fully lit; one bounce. Expected: the irradiance of the lit Earth over π, by fixed directions. Tolerance: 1 %,
    five standard errors of the panorama's mean over 256 pixels.
    """
    from scanner_sim.render.incident import Throughput
    from scanner_sim.render.paths import Albedo
    from scanner_sim.render.sky import earth_directions, sky_light
    from scanner_sim.scene.loader import load_scene

    plane = {**WALL, "material": {"reflectance": 1.0}}
    loaded = load_scene(Scene(objects=(plane,)))
    # The Earth behind the scanner, and the Sun hidden from the wall's front, lighting the Earth's near side.
    light = sky_light((0.0, -0.6, 0.8), 4.65e-3, (0.0, 0.0, -1.0))
    line = panorama_lines(loaded, light, Albedo(1.0, 1.0), [(32, 32)], 1, 0)[0]
    directions, weights = earth_directions(light, 4096)
    irradiance = float((weights * np.maximum(-directions[:, 2], 0.0)).sum())
    one = np.ones(PIXELS)
    unit = Throughput(bench(), PIXELS, one, one, 0.0 * one).in_band.numpy().astype(np.float64)
    assert irradiance > 0.01
    assert line.sum() == pytest.approx(irradiance / np.pi * unit.sum(), rel=0.01)


def test_the_same_bytes_whatever_is_traced_together(monkeypatch: pytest.MonkeyPatch) -> None:
    from scanner_sim.render import background
    from scanner_sim.scene.loader import load_scene

    loaded = load_scene(Scene(objects=tuple(SHADOWED)))
    light, albedo = sunlit()
    whole = panorama_lines(loaded, light, albedo, [(32, 40)], 3, 5)
    monkeypatch.setattr(background, "_PATHS_TOGETHER", 1 << 16)
    np.testing.assert_array_equal(panorama_lines(loaded, light, albedo, [(32, 40)], 3, 5), whole)
