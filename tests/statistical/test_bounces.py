"""Light that meets two surfaces: a false spot where the geometry puts it, and a veil of the right power."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import erf
from scipy.stats import norm

from scanner_sim.config.scanner import Scanner
from scanner_sim.render.settings import Transport
from scanner_sim.scene.objects import Scene

PIXELS = 256
SCANNER = Scanner()
MIRROR = """<scene version="3.0.0"><shape type="rectangle"><transform name="to_world"><rotate x="1" angle="180"/>
<scale value="0.1"/></transform><bsdf type="twosided"><bsdf type="conductor"><string name="material" value="none"/>
</bsdf></bsdf></shape></scene>"""

pytestmark = pytest.mark.usefixtures("device")


def lines(objects: list[dict[str, Any]], bounces: int, paths: int, count: int) -> np.ndarray:
    """Return the lines [W] of shots along the axis that differ in their random paths, shape (count, pixels)."""
    import drjit as dr
    import mitsuba as mi

    from scanner_sim.render.beam.line_projection import LineProjection
    from scanner_sim.render.beam.splitter import render_light
    from scanner_sim.render.shots import Shots
    from scanner_sim.render.transport import OpticalLayout
    from scanner_sim.scene.files.loader import load_scene

    sensor = SCANNER.position_sensor
    bench = OpticalLayout(
        SCANNER.laser,
        SCANNER.receiver,
        SCANNER.mirrors.axis_separation,
        1.0,
        sensor.pitch,
        sensor.height,
        sensor.offset,
        sensor.diffusion,
    )
    loaded = load_scene(Scene(objects=tuple(objects)))
    shots = Shots(dr.arange(mi.UInt32, count), dr.zeros(mi.Float, count), dr.zeros(mi.Float, count))
    _, lights = render_light(
        loaded, LineProjection(bench), Transport(bounces=bounces, bounce_paths=paths), shots, 0
    )
    result = np.zeros((count, PIXELS))
    for light in lights:
        for place, index in enumerate(light.index.numpy()):
            result[index] = light.line(place, PIXELS)
    return result


def test_a_mirror_throws_a_false_spot(tmp_path: Path) -> None:
    """Claim: behind a perfect mirror the spot is seen where the reflected beam lands, and only with two bounces.

    Set-up: a mirror at 3 m, turned 45°, sends the beam to −x, onto a wall in the plane x = −0.15 m. Expected:
    p = f (d + 0.15)/3 by the lens alone, and the power of a Lambertian wall seen at that angle, cut by the pixels'
    height. Tolerance: 0.05 pixel and 1 % (the beam's width changes distance and angle to the lens over the spot).
    """
    path = tmp_path / "mirror.xml"
    path.write_text(MIRROR)
    turn = {"axis": "y", "angle": np.pi / 4.0}
    wall = {"name": "wall", "shape": "rectangle", "size": (1.0, 1.0), "material": {"reflectance": 0.5}}
    objects = [
        {"name": "mirror", "file": path, "position": (0, 0, 3), "rotation": turn},
        {**wall, "position": (-0.15, 0, 3), "rotation": {"axis": "y", "angle": -np.pi / 2.0}},
    ]
    assert lines(objects, 1, 64, 1).sum() == 0.0
    line = lines(objects, 2, 256, 1)[0]
    receiver, across, along = SCANNER.receiver, SCANNER.receiver.baseline + 0.15, 3.0
    expected = receiver.focal_length * across / along / SCANNER.position_sensor.pitch - 0.5
    assert (line * np.arange(PIXELS)).sum() / line.sum() == pytest.approx(expected, abs=0.05)
    distance = np.hypot(across, along)
    power = SCANNER.laser.power * 0.5 / np.pi * (across / distance) * (along / distance) / distance**2
    power *= receiver.aperture_area * receiver.transmission
    image = receiver.focal_length * 0.5 * SCANNER.laser.radius(3.15) / along
    power *= erf(0.5 * SCANNER.position_sensor.height / np.hypot(image, SCANNER.point_spread) / np.sqrt(2.0))
    assert line.sum() == pytest.approx(power, rel=0.01)


@pytest.mark.slow
def test_a_corner_veils_the_line() -> None:
    """Claim: the light of two diffuse surfaces has the power of the double integral.

    Set-up: the beam meets a wall at 3 m (ρ 0.8); a second wall (ρ 0.6) stands on its left at x = −0.1 m, at right
    angles. Expected: Φ ρ₁ cosθ cosθ'/(π r²) on the second wall, seen through the field of each pixel, by
    quadrature over the wall. Tolerance: 4.4 standard errors of 256 shots (level 1e-5); they are 1 %, so that a
    missing π or cosine would be seen at once.
    """
    first = {"name": "first", "shape": "rectangle", "size": (4.0, 4.0), "position": (0, 0, 3.0)}
    second = {"name": "second", "shape": "rectangle", "size": (4.0, 4.0), "position": (-0.1, 0, 1.0)}
    objects = [
        {**first, "material": {"reflectance": 0.8}},
        {**second, "rotation": {"axis": "y", "angle": -np.pi / 2}, "material": {"reflectance": 0.6}},
    ]
    shots, paths = 256, 1024
    veil = (lines(objects, 2, paths, shots) - lines(objects, 1, paths, shots)).sum(axis=1)
    expected = veil_by_quadrature(0.8, 0.6, 3.0, -0.1)
    error = veil.std(ddof=1) / np.sqrt(shots)
    assert error < 0.03 * expected
    assert abs(veil.mean() - expected) < 4.4 * error + 1e-3 * expected


@pytest.mark.slow
def test_a_shallow_crease_keeps_its_light() -> None:
    """Claim: light goes from one side of a crease of 170° to the other as the double integral says.

    Set-up: the beam meets a wall at 10 m (ρ 0.8), 50 mm from a crease; from there a second wall (ρ 0.6) rises by 10°
    towards the scanner, 9 mm above the spot's plane where it is as far again. Expected: quadrature over the spot and
    the second wall. Tolerance: 4.4 standard errors of 1024 shots (level 1e-5), which must be below 4 %: rays that
    started 1 mm beside the wall lost 25 %, more than 6 of them.
    """
    depth, side, rise, shots = 10.0, -0.05, np.deg2rad(10.0), 1024
    first = {"name": "first", "shape": "rectangle", "size": (4.0, 4.0), "position": (2.0 + side, 0, depth)}
    middle = (side - np.cos(rise), 0, depth - np.sin(rise))
    second = {"name": "second", "shape": "rectangle", "size": (2.0, 2.0), "position": middle}
    objects = [
        {**first, "material": {"reflectance": 0.8}},
        {**second, "rotation": {"axis": "y", "angle": -rise}, "material": {"reflectance": 0.6}},
    ]
    veil = (lines(objects, 2, 1024, shots) - lines(objects, 1, 1024, shots)).sum(axis=1)
    expected = crease_by_quadrature(0.8, 0.6, depth, side, rise)
    error = veil.std(ddof=1) / np.sqrt(shots)
    assert error < 0.04 * expected
    assert abs(veil.mean() - expected) < 4.4 * error


def crease_by_quadrature(first: float, second: float, depth: float, side: float, rise: float) -> float:
    """Return the power [W] on the line of a wall's light that rises by an angle from a crease beside the spot."""
    receiver, sensor = SCANNER.receiver, SCANNER.position_sensor
    along = np.geomspace(1e-6, 2.0, 2001)
    half = 1.25 * sensor.height * depth / receiver.focal_length
    y = np.linspace(-half, half, 402)
    y = 0.5 * (y[1:] + y[:-1])
    x, z = (side - along * np.cos(rise))[:, None], (depth - along * np.sin(rise))[:, None]
    nodes, weights = np.polynomial.hermite_e.hermegauss(9)
    spot, weights = 0.5 * SCANNER.laser.radius(depth) * nodes, weights / weights.sum()
    received = np.zeros((along.size, y.size))
    for a, of_a in zip(spot, weights, strict=True):
        for b, of_b in zip(spot, weights, strict=True):
            squared = (x - a) ** 2 + (y - b) ** 2 + (z - depth) ** 2
            leaving, arriving = depth - z, np.cos(rise) * (z - depth) - np.sin(rise) * (x - a)
            received += of_a * of_b * np.maximum(leaving, 0.0) * np.maximum(arriving, 0.0) / squared**2
    across = receiver.baseline - x
    squared = across**2 + y**2 + z**2
    facing = np.maximum(across * np.sin(rise) + z * np.cos(rise), 0.0)
    seen = second / np.pi * facing * z / squared**2
    p, q, blur = receiver.focal_length * across / z, receiver.focal_length * y / z, SCANNER.point_spread
    inside = norm.cdf((0.5 * sensor.height - q) / blur) - norm.cdf((-0.5 * sensor.height - q) / blur)
    inside = inside * (norm.cdf((sensor.length - p) / blur) - norm.cdf(-p / blur))
    power = (
        SCANNER.laser.power * first / np.pi * (received * seen * inside * np.gradient(along)[:, None]).sum()
    )
    return float(power * (y[1] - y[0]) * receiver.aperture_area * receiver.transmission)


def veil_by_quadrature(first: float, second: float, depth: float, side: float) -> float:
    """Return the power [W] of the second wall's light on the line, by the rectangle rule over the wall."""
    receiver, sensor = SCANNER.receiver, SCANNER.position_sensor
    z = np.linspace(depth - 2.2, depth, 40_001)
    z = 0.5 * (z[1:] + z[:-1])[:, None]
    half = 0.5 * sensor.height * (depth + 0.1) / receiver.focal_length * 2.5
    y = np.linspace(-half, half, 201)
    y = 0.5 * (y[1:] + y[:-1])[None, :]
    to_spot = np.sqrt(side**2 + y**2 + (depth - z) ** 2)
    radiosity = SCANNER.laser.power * first / np.pi * (depth - z) * abs(side) / to_spot**4
    across = receiver.baseline - side
    to_lens = np.sqrt(across**2 + y**2 + z**2)
    seen = second / np.pi * (across / to_lens) * (z / to_lens) / to_lens**2
    p, q = receiver.focal_length * across / z, receiver.focal_length * y / z
    blur, length = SCANNER.point_spread, sensor.length
    inside = norm.cdf((0.5 * sensor.height - q) / blur) - norm.cdf((-0.5 * sensor.height - q) / blur)
    inside = inside * (norm.cdf((length - p) / blur) - norm.cdf(-p / blur))
    area = (z[1, 0] - z[0, 0]) * (y[0, 1] - y[0, 0])
    return float((radiosity * seen * inside).sum() * area * receiver.aperture_area * receiver.transmission)
