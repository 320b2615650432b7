"""How Sun and Earth light a target: points of surfaces by geometry, shares by hand, radiances by Lambert's law."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba
import numpy as np
import pytest
from claims import mean, mean_square, share
from numpy.typing import NDArray
from prototype import Laser, Receiver
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from scanner_sim.analytic.geometry import point_from_shot, swept_image
from scanner_sim.foundation.device_streams import generator
from scanner_sim.render.background import illumination, reference
from scanner_sim.render.background.illumination import (
    Sight,
    SurfaceSamples,
    earth_irradiance,
    half_height,
    sun_at,
    sunlit_share,
    trace_sunlight,
    visible_samples,
)
from scanner_sim.render.background.reference import reference_background
from scanner_sim.render.background.sky import sky_light
from scanner_sim.render.beam.beamlets import probe_beamlets
from scanner_sim.render.beam.line_projection import LineProjection
from scanner_sim.render.beam.splitter import probe_beams
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import BeamletTables, OpticalLayout
from scanner_sim.scene.files.loader import load_scene
from scanner_sim.scene.objects import Scene

Array = NDArray[np.float64]
mi: Any = mitsuba

SUN_RADIUS = 4.65e-3
PITCH, HEIGHT, OFFSET, SEPARATION = 50e-6, 250e-6, 1e-3, 0.05

pytestmark = pytest.mark.usefixtures("device")


def wall(name: str, x: float, y: float, z: float, *size: float, **more: Any) -> dict[str, Any]:
    """A rectangle square to z."""
    return {"name": name, "shape": "rectangle", "size": size, "position": (x, y, z),
            "material": {"reflectance": 0.4, "reflectance_out_of_band": 0.1}, **more}  # fmt: skip


def scene(*objects: dict[str, Any]) -> Any:
    return load_scene(Scene(objects=objects))


def layout(offset: float = OFFSET, **changes: Any) -> OpticalLayout:
    return OpticalLayout(Laser(), Receiver(**changes), SEPARATION, 0.8, PITCH, HEIGHT, offset, 0.0)


def samples(points: Any, normals: Any) -> SurfaceSamples:
    return SurfaceSamples(mi.Point3f(np.asarray(points).T), mi.Normal3f(np.asarray(normals).T))


def earthshine(altitude: float, sun: Array, normal: Array) -> float:
    """Return the irradiance of a plate by an Earth of albedo 1 below, along z, by a sum over its disc.

    The ground at an angle γ from the middle of the disc is a point of the unit ball, its radiance the cosine of the
    Sun's zenith angle there over π.
    """
    reach = 1.0 + altitude / 6371e3
    versine = (np.arange(400) + 0.5) / 400.0 * (1.0 - math.sqrt(1.0 - 1.0 / reach**2))
    azimuth = (np.arange(400) + 0.5) / 400.0 * 2.0 * np.pi
    cosine, angle = np.meshgrid(1.0 - versine, azimuth, indexing="ij")
    sine = np.sqrt(1.0 - cosine**2)
    towards = np.stack([sine * np.cos(angle), sine * np.sin(angle), cosine])
    ahead = reach * cosine - np.sqrt(1.0 - (reach * sine) ** 2)
    ground = np.array([0.0, 0.0, -reach])[:, None, None] + ahead * towards
    lit = np.maximum(np.tensordot(sun, ground, 1), 0.0) / np.pi
    received = lit * np.maximum(np.tensordot(normal, towards, 1), 0.0)
    return float(received.mean() * 2.0 * np.pi * (1.0 - math.sqrt(1.0 - 1.0 / reach**2)))


def test_points_are_where_the_scanner_sees_the_object() -> None:
    """Claim: of a wall of 2 m at 5 m whose half x > 0 something hides, points lie evenly on the other half, before it
    by 10⁻⁵ of their distance, and face the scanner; no more than were asked for, and none of what is wholly hidden."""
    loaded = scene(
        wall("before", 0.5, 0.0, 2.5, 1.0, 2.0),
        wall("wall", 0.0, 0.0, 5.0, 2.0, 2.0),
        wall("behind", 0.0, 0.0, 6.0, 0.2, 0.2),
        wall("beyond", 0.0, 0.0, -1.0, 9.0, 9.0),
    )
    found = visible_samples(loaded, 2, 500, 3)
    x, y, z = found.point.numpy().astype(float)
    assert 400 < found.count <= 500
    assert x.max() < 1e-3
    np.testing.assert_allclose(5.0 - z, 1e-5 * np.sqrt(x**2 + y**2 + 25.0), atol=1e-6)
    np.testing.assert_allclose(found.normal.numpy().T, np.tile([0.0, 0.0, -1.0], (found.count, 1)), atol=1e-6)
    for values, middle, length in ((x, -0.5, 1.0), (y, 0.0, 2.0)):
        assert mean(values, middle)
        assert mean((values - middle) ** 2, length**2 / 12.0)
    assert visible_samples(loaded, 3, 500, 3).count == 0


def test_parts_of_a_mesh_that_moves_are_where_it_is(tmp_path: Path) -> None:
    """Claim: points of a part with a label of its own lie on that part at 5 m, whether or not its mesh moves."""
    text = "v -1 -1 0\nv 0 -1 0\nv 0 1 0\nv -1 1 0\nv 1 -1 0\nv 1 1 0\nusemtl a\nf 1 2 3 4\nusemtl b\nf 2 5 6 3\n"
    (tmp_path / "two.obj").write_text(text)
    mesh = {"name": "sat", "mesh": tmp_path / "two.obj", "position": (0.0, 0.0, 5.0), "label_parts": True}
    mesh |= {"materials": {"a": "z93_white", "b": "nickel"}}
    for motion in ({}, {"motion": {"type": "twist", "velocity": (0.0, 0.0, 0.1)}}):
        loaded = scene(mesh | motion)
        assert loaded.objects == ("sat.a", "sat.b")
        for number, (low, high) in enumerate(((-1.0, 0.0), (0.0, 1.0)), 1):
            x, _, z = visible_samples(loaded, number, 100, 0).point.numpy().astype(float)
            assert ((x > low - 1e-3) & (x < high + 1e-3)).all()
            np.testing.assert_allclose(z, 5.0, atol=1e-4)


def test_a_sphere_shows_its_near_cap_evenly() -> None:
    """Claim: heights over a ball are even (Archimedes), from the tangents' circle at R²/D on, and normals are radii."""
    ball = {"name": "ball", "shape": "sphere", "diameter": 2.0, "position": (0.0, 0.0, 5.0),
            "material": {"reflectance": 0.4}}  # fmt: skip
    found = visible_samples(scene(ball), 1, 1000, 0)
    height = (5.0 - found.point.numpy()[2]).astype(float)
    assert height.min() > 0.2 - 1e-3
    assert mean(height, 0.6, slack=1e-3)
    assert mean((height - 0.6) ** 2, 0.8**2 / 12.0, slack=1e-3)
    radii = found.point.numpy().T - [0.0, 0.0, 5.0]
    np.testing.assert_allclose(found.normal.numpy().T, radii, atol=1e-3)


def test_each_part_of_an_object_has_points_by_its_area() -> None:
    """Claim: of an object of two plates of 1 m² and 3 m² the larger has three quarters of the points, each drawn for
    itself: of 2000 places told to a millionth two pairs are one by chance, and 20 never."""
    loaded = scene(wall("small", -1.0, 0.0, 6.0, 1.0, 1.0), wall("large", 1.0, 0.0, 6.0, 1.0, 3.0))
    one = dr.minimum(loaded.object_of, 1)
    found = visible_samples(dataclasses.replace(loaded, object_of=one), 1, 2000, 1)
    x, y, _ = found.point.numpy().astype(float)
    left = x < 0.0
    assert share(int(left.sum()), len(x), 0.25)
    places = np.round(np.stack([np.abs(x) - 1.0, np.where(left, 3.0, 1.0) * y]), 6)
    assert len(np.unique(np.where(left, -1.0, 1.0) * places[0])) > 0.99 * len(x)
    assert len(np.unique(places[1])) > 0.99 * len(x)


def test_the_sunlit_share_is_that_of_the_points() -> None:
    """Claim: of 40 points on a wall a plate a metre before it shades 16; of those that are left ten face away."""
    loaded = scene(wall("plate", 0.5, 0.0, 4.0, 1.0, 9.0), wall("wall", 0.0, 0.0, 5.0, 9.0, 9.0))
    x = np.concatenate([np.linspace(0.05, 0.95, 16), np.linspace(-1.0, -0.05, 24)])
    points = np.stack([x, 0.0 * x, np.full(40, 5.0 - 1e-4)], axis=1)
    normals = np.tile([0.0, 0.0, -1.0], (40, 1))
    light = sky_light((0.0, 0.0, -1.0), SUN_RADIUS, None)
    assert sunlit_share(loaded, light, samples(points, normals), 0) == pytest.approx(24.0 / 40.0)
    normals[30:] *= -1.0
    assert sunlit_share(loaded, light, samples(points, normals), 0) == pytest.approx(14.0 / 40.0)
    eclipsed = sky_light((0.0, 0.0, -1.0), SUN_RADIUS, (0.0, 0.0, -1.0))
    assert sunlit_share(loaded, eclipsed, samples(points, normals), 0) == 0.0
    assert sunlit_share(loaded, sky_light(None, SUN_RADIUS, None), samples(points, normals), 0) == 0.0
    # However low the Sun stands over the wall, as long as all of its disc does.
    low = np.radians(1.0)
    grazing = sky_light((-np.cos(low), 0.0, -np.sin(low)), SUN_RADIUS, None)
    open_wall = scene(wall("wall", 0.0, 0.0, 5.0, 9.0, 9.0))
    facing = np.tile([0.0, 0.0, -1.0], (40, 1))
    assert sunlit_share(open_wall, grazing, samples(points, facing), 0) == 1.0


@pytest.mark.parametrize("turn", [0.0, 45.0, 135.0])
@pytest.mark.parametrize("height", [0.0, 0.4])
def test_an_edge_in_the_penumbra_leaves_its_part_of_the_sun(height: float, turn: float) -> None:
    """Claim: where a plate's edge stands before the middle of the Sun half of its disc is free, and 0.4 radii beside it
    all but a segment of (arccos h − h √(1 − h²))/π, whichever way the edge runs."""
    away, angle = 2.0 + height * SUN_RADIUS, math.radians(turn)
    plate = wall("plate", away * math.cos(angle), away * math.sin(angle), 4.0, 4.0, 9.0)
    plate |= {"rotation": {"axis": (0.0, 0.0, 1.0), "angle": angle}}
    loaded = scene(plate, wall("wall", 0.0, 0.0, 5.0, 9.0, 9.0))
    points = np.tile([0.0, 0.0, 5.0 - 1e-4], (4000, 1))
    light = sky_light((0.0, 0.0, -1.0), SUN_RADIUS, None)
    found = sunlit_share(loaded, light, samples(points, np.tile([0.0, 0.0, -1.0], (4000, 1))), 2)
    free = 1.0 - (math.acos(height) - height * math.sqrt(1.0 - height**2)) / math.pi
    assert share(round(4000 * found), 4000, free, slack=0.01)


@pytest.mark.parametrize("tilt", [0.0, 1.2])
@pytest.mark.parametrize("sun", [(0.0, 0.0, -1.0), (0.8, 0.0, -0.6), (0.0, -0.99, 0.14)])
def test_earthshine_is_the_sum_over_the_disc(tilt: float, sun: tuple[float, float, float]) -> None:
    """Claim: the albedo times the sum over the lit part of the disc, over noon, the morning and near the terminator.

    Tolerance: 4 rays from each of 4000 points. Values between 0 and 4 times their mean, which these are by a sum,
    scatter by √3 of it at most (Bhatia and Davis 2000): 5 standard errors are 7 %; of half the points, 10 %.
    """
    normal = np.array([math.sin(tilt), 0.0, math.cos(tilt)])
    loaded = scene(wall("wall", 0.0, 0.0, -50.0, 0.1, 0.1))
    light = sky_light(sun, SUN_RADIUS, (0.0, 0.0, 1.0), 400e3, 6371e3, (0.3, 0.3))
    wanted = 0.3 * earthshine(400e3, np.array(sun) / np.linalg.norm(sun), normal)
    assert wanted > 0.0
    given = samples(np.zeros((4000, 3)), np.tile(normal, (4000, 1)))
    found = earth_irradiance(loaded, light, 0.3, given, 0)
    assert found == pytest.approx(wanted, rel=0.07)
    half = samples(np.zeros((4000, 3)), np.repeat([normal, [0.0, 0.0, -1.0]], 2000, axis=0))
    assert earth_irradiance(loaded, light, 0.3, half, 0) == pytest.approx(0.5 * wanted, rel=0.1)


def test_what_stands_before_the_earth_hides_it() -> None:
    """Claim: of 4000 points half stand under a plate and look away from the Earth, and the rest have its light."""
    loaded = scene(wall("wall", 0.0, 0.0, 0.05, 90.0, 90.0))
    light = sky_light((0.0, 0.0, -1.0), SUN_RADIUS, (0.0, 0.0, 1.0))
    hidden, free = np.zeros((2000, 3)), np.tile([0.0, 0.0, 0.2], (2000, 1))
    up, down = np.tile([0.0, 0.0, 1.0], (2000, 1)), np.tile([0.0, 0.0, -1.0], (2000, 1))
    assert earth_irradiance(loaded, light, 0.3, samples(hidden, up), 0) == 0.0
    given = samples(np.concatenate([hidden, free]), np.concatenate([down, up]))
    wanted = 0.15 * earthshine(400e3, np.array([0.0, 0.0, -1.0]), up[0])
    assert earth_irradiance(loaded, light, 0.3, given, 0) == pytest.approx(wanted, rel=0.1)


def test_a_sunlit_wall_has_lamberts_radiance() -> None:
    """Claim: ρ cosθ/π of a Sun at 30° from the normal, all of it sharp, wherever it is looked at from; out of band with
    the material's ratio; lines of sight beside the wall, at the Sun itself, count as 0.

    Tolerance: a point of the disc is off its middle by α at most, and the cosine by α tanθ of itself, 2.7e-3.
    """
    sun = np.array([0.3, -0.4, -math.sqrt(0.75)])
    loaded = scene(wall("wall", 0.0, 0.0, 5.0, 6.0, 6.0))
    sight = Sight(np.array([0.0, 0.2, -0.3, 1.0]), np.array([0.0, -0.2, 0.1, 0.0]))
    light = sky_light(sun, SUN_RADIUS, None)
    found = trace_sunlight(loaded, layout(), light, sight, 1, 0)
    expected = 0.4 * math.sqrt(0.75) / math.pi
    ratio = float(loaded.out_of_band_ratio.numpy()[1])
    for values, factor in zip(found, (1.0, ratio, 1.0, ratio), strict=True):
        np.testing.assert_allclose(values[:3], factor * expected, rtol=2.8e-3)
        assert values[3] == 0.0
    at_sun = Sight(np.array([1.0]), np.array([0.0]))
    there = sky_light((math.sin(1.0), 0.0, math.cos(1.0)), SUN_RADIUS, None)
    assert [float(values[0]) for values in trace_sunlight(loaded, layout(), there, at_sun, 1, 0)] == [0.0] * 4


def test_earthshine_on_a_wall_is_not_sharp() -> None:
    """Claim: by the Earth alone a wall has ρ/π of its irradiance times each band's albedo, and none of it sharp."""
    loaded = scene(wall("wall", 0.0, 0.0, 5.0, 40.0, 40.0))
    sun = np.array([0.6, 0.0, 0.8])
    light = sky_light(sun, SUN_RADIUS, (0.0, 0.0, -1.0), 400e3, 6371e3, (0.3, 0.2))
    sight = Sight(np.linspace(-0.3, 0.3, 3000), np.zeros(3000))
    in_band, out, sharp, sharp_out = trace_sunlight(loaded, layout(), light, sight, 1, 0)
    expected = 0.4 / math.pi * earthshine(400e3, sun * [1.0, 1.0, -1.0], np.array([0.0, 0.0, 1.0]))
    ratio = float(loaded.out_of_band_ratio.numpy()[1])
    assert mean(in_band, 0.3 * expected, slack=1e-3 * expected)
    assert mean(out, 0.2 * ratio * expected, slack=1e-3 * expected)
    assert not sharp.any()
    assert not sharp_out.any()


def test_the_sun_is_looked_at_where_it_stands() -> None:
    """Claim: lines of sight lead to points of the disc by Θ = asin x, φ = atan(y/z); half are free where an edge stands
    before its middle as the lens sees it, none where the Earth is before it or the Sun is behind the scanner."""
    sun = np.array([0.2, -0.3, math.sqrt(1.0 - 0.13)])
    empty = scene(wall("wall", 0.0, 0.0, -5.0, 1.0, 1.0))
    sight, free = sun_at(empty, layout(), sky_light(sun, SUN_RADIUS, None), 0)
    theta, phi = sight.angle, sight.phi
    towards = np.stack([np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)])
    away = np.arccos(np.clip(sun @ towards, -1.0, 1.0))
    assert away.max() <= SUN_RADIUS + 2e-4
    # Points even over a disc lie at ⅔ of its radius on average.
    assert mean(away, 2.0 / 3.0 * SUN_RADIUS, slack=1e-5)
    assert free.all()
    assert len(free) == 256
    eclipsed = sky_light(sun, SUN_RADIUS, sun)
    assert not sun_at(empty, layout(), eclipsed, 0)[1].any()
    assert not sun_at(empty, layout(), sky_light(-sun, SUN_RADIUS, None), 0)[1].any()
    ahead = sky_light((0.0, 0.0, 1.0), SUN_RADIUS, None)
    base = Receiver().baseline
    behind_edge = scene(wall("edge", base + 5.0, 0.0, 20.0, 10.0, 9.0))
    _, free = sun_at(behind_edge, layout(), ahead, 0)
    assert share(int(free.sum()), 256, 0.5)


def test_half_a_pixels_height_is_an_angle() -> None:
    assert half_height(layout(focal_length=0.1)) == pytest.approx(math.atan(0.5 * HEIGHT / 0.1), rel=1e-12)


def test_points_and_lines_have_random_numbers_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: no two of the samplers of one seed draw from the same address."""
    real, asked = illumination.generator, []

    def noted(seed: int, stream: Any, first: Any, second: Any) -> Any:
        asked.append((int(first.numpy()[0]), int(np.min(second.numpy()))))
        return real(seed, stream, first, second)

    monkeypatch.setattr(illumination, "generator", noted)
    loaded = scene(wall("wall", 0.0, 0.0, 5.0, 2.0, 2.0))
    light = sky_light((0.0, 0.0, -1.0), SUN_RADIUS, (0.0, 1.0, 0.0))
    found = visible_samples(loaded, 1, 10, 0)
    sunlit_share(loaded, light, found, 0)
    earth_irradiance(loaded, light, 0.3, found, 0)
    sun_at(loaded, layout(), light, 0)
    assert len({address for address, _ in asked}) == len(asked) == 4


def test_brute_force_of_a_background_is_lamberts_radiance_through_the_lens() -> None:
    """Claim: of a wide sunlit wall each pixel has ρ cosθ/π A T S (pitch · height/f²) cos⁴ψ, for a Sun of 1 W/m² and ψ
    the angle at which it looks off the axis, about 17° here.

    Tolerance: 256 points of the disc, 2.7e-3 of the cosine each at most, and the fall over a pixel; a path that meets
    the Sun by itself, one of 5e4, counts as two.
    """
    sun = np.array([0.3, -0.4, -math.sqrt(0.75)])
    loaded = scene(wall("wall", 0.0, 0.0, 5.0, 90.0, 90.0))
    made = layout(offset=30e-3, focal_length=0.1)
    receiver, light = made.receiver, sky_light(sun, SUN_RADIUS, None)
    found = reference_background(loaded, made, light, 40, 0.1, -0.05, bounces=1, samples=256)
    psi = np.arctan((30e-3 + (np.arange(40) + 0.5) * PITCH) / 0.1)
    gain = np.pi / 4.0 * receiver.aperture**2 * receiver.transmission * 0.8 * PITCH * HEIGHT / 0.1**2
    expected = 0.4 * math.sqrt(0.75) / np.pi * gain * np.cos(psi) ** 4
    np.testing.assert_allclose(found.power, expected, rtol=1e-2)


def test_brute_force_of_a_background_looks_where_its_pixels_do() -> None:
    """Claim: an edge lies on the pixel whose ray (−p, q, f) from the lens meets it: pixels on one side have the wall's
    light, those on the other none. Of a wall that ends at the height of the axis each pixel has half, and its standard
    error is that of so many cases of two.

    A path that meets the Sun by itself, one of 5e4, counts as two, and changes the error of its pixel by 2 %: at the
    suite's level three pixels of the forty have one. The other errors differ by the fall of light over the line.
    """
    base = Receiver().baseline
    made = layout(focal_length=0.1, aberration=0.0)
    # The axis of the lens meets z = 5 at x = base; pixel p sees base − 5 p/f. The wall ends where pixel 20 begins.
    edge = base - 5.0 * (OFFSET + 20.0 * PITCH) / 0.1
    loaded = scene(wall("wall", edge + 10.0, 0.0, 5.0, 20.0, 90.0))
    light = sky_light((0.0, 0.0, -1.0), SUN_RADIUS, None)
    found = reference_background(loaded, made, light, 40, 0.0, 0.0, bounces=1, samples=16)
    whole, lit = np.median(found.power[:20]), found.power > 0.0
    assert lit[:20].all()
    assert not lit[20:].any()
    y, z = point_from_shot(5.0, 0.0, 0.3, SEPARATION)[1:]
    there = scene(wall("wall", 0.0, y, z, 1.0, 1.0))
    assert (reference_background(there, made, light, 2, 0.0, 0.3, bounces=1, samples=16).power > 0.0).all()
    assert not reference_background(there, made, light, 2, 0.3, 0.0, bounces=1, samples=16).power.any()
    loaded = scene(wall("wall", 0.0, 10.0, 5.0, 90.0, 20.0))
    found = reference_background(loaded, made, light, 40, 0.0, 0.0, bounces=1, samples=256)
    part = found.power / whole
    assert share(round(256 * part.sum()), 256 * 40, 0.5, slack=0.01)
    off = found.standard_error / (whole * np.sqrt(part * (1.0 - part) / 255.0)) - 1.0
    assert np.abs(off).max() < 0.1
    assert (np.abs(off) > 5e-3).sum() <= 3


def test_brute_force_of_a_background_is_blurred_by_the_point_spread() -> None:
    """Claim: before the corner of a wall a pixel has the shares of a Gaussian along and across the line: of 2 pixels
    along it, and as much of its height."""
    base, spread = Receiver().baseline, 100e-6
    made = layout(focal_length=0.1, aberration=spread)
    middle = OFFSET + 20.0 * PITCH
    loaded = scene(wall("wall", base - 5.0 * middle / 0.1 + 10.0, 10.0 + 5.0 * 150e-6 / 0.1, 5.0, 20.0, 20.0))
    light = sky_light((0.0, 0.0, -1.0), SUN_RADIUS, None)
    found = reference_background(loaded, made, light, 40, 0.0, 0.0, bounces=1, samples=2048)
    within = (np.arange(64) + 0.5) / 64.0
    p = OFFSET + (np.arange(40)[:, None] + within) * PITCH
    along = norm.cdf((middle - p) / spread).mean(axis=1)
    # The normal points down, along y: what is seen above the axis of the line is below it in the frame.
    across = float(norm.cdf(((within - 0.5) * HEIGHT - 150e-6) / spread).mean())
    receiver = made.receiver
    gain = np.pi / 4.0 * receiver.aperture**2 * receiver.transmission * 0.8 * PITCH * HEIGHT / 0.1**2
    whole = 0.4 / np.pi * gain * np.cos(np.arctan(p.mean(axis=1) / 0.1)) ** 4
    for pixels in (slice(0, 16), slice(16, 20), slice(20, 24)):
        count = 2048 * (pixels.stop - pixels.start)
        lit = count * (found.power / whole)[pixels].mean()
        assert share(round(lit), count, float(along[pixels].mean()) * across, slack=2e-3)


def test_shots_of_brute_force_are_independent() -> None:
    """Claim: two shots draw other numbers, the same shot the same ones."""
    loaded = scene(wall("wall", 0.0, 0.0, 5.0, 90.0, 90.0))
    light = sky_light((0.3, -0.4, -0.8), SUN_RADIUS, None)
    made = layout(aberration=0.0)
    one, again, other = (
        reference_background(loaded, made, light, 3, 0.0, 0.0, bounces=1, samples=8, shot=shot).power
        for shot in (0, 0, 1)
    )
    np.testing.assert_array_equal(one, again)
    assert (one != other).all()


def test_brute_force_of_a_background_shares_no_number_with_that_of_a_beam(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: of one seed and shot the beam and what is seen beside it draw at addresses that differ."""
    asked: list[int] = []

    def noted(seed: Any, stream: Any, shot: Any, number: Any) -> Any:
        asked.append(int(shot.numpy()[0]))
        return generator(seed, stream, shot, number)

    monkeypatch.setattr(reference, "generator", noted)
    loaded, light = (
        scene(wall("wall", 0.0, 0.0, 5.0, 90.0, 90.0)),
        sky_light((0.0, 0.0, -1.0), SUN_RADIUS, None),
    )
    reference_background(loaded, layout(), light, 2, 0.0, 0.0, bounces=1, samples=4, shot=77)
    background, asked[:] = set(asked), []
    reference.reference_line(loaded, layout(), 2, 0.0, 0.0, rays=8, shot=77)
    assert background
    assert asked
    assert background.isdisjoint(asked)


def test_the_reference_blurs_an_edge_by_the_point_spread() -> None:
    """Claim: a sunlit wall's end is on the line a normal distribution of the point spread's width, meant over pixels,
    times Lambert's radiance, what the lens collects, and cos⁴ of each pixel's angle.

    Set-up: a lens that blurs by four pixels. A blur 5 % too wide is found: over the dozen pixels about the edge it
    changes the light by three standard errors each.
    """
    made, pixels, samples = layout(aberration=200e-6), 80, 6000
    focal, base = made.receiver.focal_length, made.receiver.baseline
    edge = OFFSET + 40.3 * PITCH
    end = base - 5.0 * edge / focal
    loaded = scene(wall("wall", end + 4.0, 0.0, 5.0, 8.0, 8.0))
    light = sky_light((0.0, 0.0, -1.0), SUN_RADIUS, None)
    found = reference_background(loaded, made, light, pixels, 0.0, 0.0, bounces=1, samples=samples)
    fine = OFFSET + PITCH * (np.arange(32 * pixels) + 0.5) / 32.0
    lit = norm.sf(fine, edge, made.point_spread) / (1.0 + (fine / focal) ** 2) ** 2
    area = 0.25 * math.pi * made.receiver.aperture**2 * made.receiver.transmission * made.filter_transmission
    wanted = 0.4 / math.pi * area * PITCH * HEIGHT / focal**2 * lit.reshape(pixels, 32).mean(axis=1)
    whole = (found.power > 0.0) & (wanted > 1e-3 * wanted.max())
    error = np.sqrt(wanted * (wanted.max() - wanted) / samples)
    near = whole & (wanted < 0.99 * wanted.max()) & (wanted > 0.01 * wanted.max())
    assert near.sum() > 12
    assert mean_square((found.power - wanted)[near] / error[near], slack=0.02)
    np.testing.assert_allclose(found.power[:20], wanted[:20], rtol=2e-3)


@pytest.mark.parametrize(
    ("axis", "sweep"),
    [((0.0, 1.0, 0.0), (8e-3, 0.0)), ((1.0, 0.0, 0.0), (0.0, 8e-3)), ((1.0, 1.0, 0.0), (5e-3, -4e-3))],
)
def test_a_slope_that_is_swept_is_one_smooth_surface(axis: Any, sweep: tuple[float, float]) -> None:
    """Claim: seven probes tell the whole spot of a plane that leans by 60°, swept or not: it counts as smooth, and the
    sweep widens it as the judge's image moves. Tolerance: 2 % of the widening, of the second order."""
    turn = {"axis": axis, "angle": math.radians(60.0)}
    loaded = scene(wall("wall", 0.0, 0.0, 4.0, 40.0, 40.0, rotation=[turn]))
    made = OpticalLayout(Laser(), Receiver(), SEPARATION, 1.0, PITCH, 0.02, 0.0, 20e-6)
    theta, phi, probe = 0.03, -0.02, probe_beamlets()
    tables, projection, sigmas = BeamletTables.of(probe), LineProjection(made), []
    for travel in ((0.0, 0.0), sweep):
        columns = [mi.Float(value) for value in (theta, phi, *travel, 0.0)]
        shots = Shots(dr.arange(mi.UInt32, 1), *columns)
        probed = probe_beams(loaded, projection, probe, tables, shots)
        assert probed.footprint.numpy().tolist() == [0]
        sigmas.append(float(probed.whole_beams(projection, mi.UInt32(0), shots).sigma.numpy()[0]))
    normal = Rotation.from_rotvec(math.radians(60.0) * np.array(axis) / np.linalg.norm(axis)).apply(
        [0.0, 0.0, -1.0]
    )
    receiver = made.receiver
    _, spread = swept_image(
        theta, phi, sweep, receiver.focal_length, receiver.baseline, SEPARATION, (0.0, 0.0, 4.0), normal
    )
    assert sigmas[1] ** 2 - sigmas[0] ** 2 == pytest.approx(float(spread / PITCH) ** 2, rel=0.02)


def test_each_line_of_sight_has_random_numbers_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: no draw of a line of sight has the numbers of another draw or of another line; a path has 64 draws."""
    asked: list[Any] = []

    def trace(*given: Any) -> Any:
        asked.append(given[-1])
        raise StopIteration

    monkeypatch.setattr(illumination, "trace_paths", trace)
    angles = np.linspace(-0.1, 0.1, 40)
    sight = Sight(angles, angles)
    with pytest.raises(StopIteration):
        trace_sunlight(
            scene(wall("wall", 0.0, 0.0, 4.0, 9.0, 9.0)), layout(), sky_light(None, 0.0, None), sight, 1, 3
        )
    drawn = np.concatenate([asked[0](mi.UInt32(number)).numpy().T for number in (0, 1, 2, 17, 63)])
    assert len(np.unique(drawn, axis=0)) == 40 * 5
