"""The sky's corners: what is missing, what is in front of what, and the emitter in other people's scenes."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest

SUN = (0.6, -0.8, 0.0)
DOWN = (0.0, 1.0, 0.0)
RADIUS = 4.65e-3
SCENE = """<scene version="3.0.0"><emitter type="orbit_sky" id="sky"><vector name="sun_direction" x="0" y="-1" z="-1"/>
{earth}</emitter><shape type="rectangle"><transform name="to_world"><rotate x="1" angle="180"/><translate z="5"/>
</transform></shape></scene>"""

pytestmark = pytest.mark.usefixtures("device")


def vectors(*rows: Any) -> Any:
    import mitsuba as mi

    unit = np.array(rows, dtype=float)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return mi.Vector3f(*(mi.Float(column) for column in unit.T))


def everything(light: Any, direction: Any) -> np.ndarray:
    from scanner_sim.render.background.sky import earth_radiance, pdf_earth, pdf_sun, sun_radiance

    return np.array([law(light, direction) for law in (sun_radiance, pdf_sun, earth_radiance, pdf_earth)])


@pytest.mark.parametrize(
    ("sun", "radius", "earth", "altitude"),
    [
        ((0.0, 0.0, 0.0), RADIUS, None, 400e3),
        ((np.nan, 0.0, 1.0), RADIUS, None, 400e3),
        ((0.0, 1.0), RADIUS, None, 400e3),
        (SUN, 0.0, None, 400e3),
        (SUN, 2.0, None, 400e3),
        (SUN, RADIUS, (0.0, 0.0, 0.0), 400e3),
        (SUN, RADIUS, DOWN, 0.0),
    ],
)
def test_impossible_skies_are_refused(sun: Any, radius: float, earth: Any, altitude: float) -> None:
    from scanner_sim.render.background.sky import sky_light

    with pytest.raises(ValueError, match=r"direction|Sun|above"):
        sky_light(sun, radius, earth, altitude)


def test_without_a_sun_all_is_dark() -> None:
    import mitsuba as mi

    from scanner_sim.render.background.sky import earth_directions, sample_earth, sample_sun, sky_light

    light = sky_light(None, 0.0, DOWN)
    assert not everything(light, vectors(SUN, DOWN, (0.0, 0.0, 1.0))).any()
    u = mi.Point2f([0.1, 0.9], [0.2, 0.7])
    assert not np.array(sample_sun(light, u)[1]).any()
    assert not np.array(sample_earth(light, u)[1]).any()
    assert not earth_directions(light, 16)[1].any()


def test_without_an_earth_only_the_sun_shines() -> None:
    from scanner_sim.render.background.sky import earth_directions, sky_light

    light = sky_light(SUN, RADIUS, None, 0.0)
    found = everything(light, vectors(SUN, DOWN))
    assert found[0, 0] == pytest.approx(1.0 / (np.pi * np.sin(RADIUS) ** 2), rel=1e-5)
    assert found[1, 0] == pytest.approx(1.0 / (2.0 * np.pi * (1.0 - np.cos(RADIUS))), rel=1e-5)
    assert not found[:, 1].any()
    assert not found[2:].any()
    assert not earth_directions(light, 16)[1].any()


def test_length_of_a_direction_is_of_no_account() -> None:
    from scanner_sim.render.background.sky import sky_light

    direction = vectors(SUN, (0.1, 1.0, 0.2))
    near = everything(sky_light(SUN, RADIUS, DOWN), direction)
    far = everything(sky_light(np.array(SUN) * 1e8, RADIUS, np.array(DOWN) * 7.0), direction)
    np.testing.assert_allclose(near, far, rtol=1e-5)


def test_the_edge_of_the_suns_disc() -> None:
    from scanner_sim.render.background.sky import sky_light, sun_radiance

    sun, across = np.array(SUN), np.array([0.8, 0.6, 0.0])
    light = sky_light(SUN, RADIUS, None)
    inside, outside = (sun + across * np.tan(RADIUS * share) for share in (0.999, 1.001))
    assert np.array(sun_radiance(light, vectors(inside)))[0] > 0.0
    assert np.array(sun_radiance(light, vectors(outside)))[0] == 0.0


def test_the_lit_limb_is_on_the_suns_side() -> None:
    """Over the terminator the ground towards the Sun is lit, with cosζ = sin of the way to it, the other is not."""
    from scanner_sim.render.background.sky import earth_radiance, sky_light

    light = sky_light((1.0, 0.0, 0.0), RADIUS, DOWN, 400e3, 6371e3)
    way = np.deg2rad(10.0)
    reach = 1.0 + 400e3 / 6371e3
    seen = np.arctan2(np.sin(way), reach - np.cos(way))
    east, west = (np.sin(seen), np.cos(seen), 0.0), (-np.sin(seen), np.cos(seen), 0.0)
    found = np.array(earth_radiance(light, vectors(east, west, DOWN)))
    assert found[0] == pytest.approx(np.sin(way) / np.pi, rel=1e-4)
    assert found[1] == 0.0
    assert found[2] == pytest.approx(0.0, abs=1e-3)


def test_the_earth_hides_the_sun_and_the_night_is_black() -> None:
    from scanner_sim.render.background.sky import sky_light

    found = everything(sky_light((0.3, 1.0, 0.0), RADIUS, DOWN), vectors((0.3, 1.0, 0.0), DOWN))
    assert found[1, 0] > 0.0
    assert not found[[0, 2, 3]].any()


def test_the_limb_is_where_geometry_puts_it() -> None:
    from scanner_sim.render.background.sky import earth_radiance, sky_light

    light = sky_light((0.0, -1.0, 0.0), RADIUS, DOWN, 400e3, 6371e3)
    limb = np.arcsin(6371.0 / 6771.0)
    at = [(np.sin(limb + step), np.cos(limb + step), 0.0) for step in (-1e-4, 1e-4)]
    found = np.array(earth_radiance(light, vectors(*at)))
    assert found[0] > 0.25
    assert found[1] == 0.0


def test_the_sun_sets_at_the_limb() -> None:
    """Claim: of a disc that the limb cuts, what is 0.1 mrad above it is seen, and what is as far below is not."""
    from scanner_sim.render.background.sky import sky_light, sun_radiance

    limb = np.arcsin(6371.0 / 6771.0)
    at = [(np.sin(limb + step), np.cos(limb + step), 0.0) for step in (-1e-4, 1e-4, 1e-3)]
    light = sky_light(at[2], RADIUS, DOWN, 400e3, 6371e3)
    hidden, seen, middle = np.array(sun_radiance(light, vectors(*at)))
    assert hidden == 0.0
    assert seen == middle > 0.0


def test_directions_to_the_sun_are_spread_evenly_over_its_disc() -> None:
    """Claim: with one number even in 1 − cosγ from the middle to the rim, with the other even in azimuth: of twelve
    steps of it the mean lies on the axis, and its square is alike to all sides."""
    import mitsuba as mi

    from scanner_sim.render.background.sky import sample_sun, sky_light

    light, steps = sky_light(SUN, 0.3, None), (np.arange(12) + 0.3) / 12.0
    sun = np.array(SUN) / np.linalg.norm(SUN)
    across = np.cross(sun, [0.3, -0.5, 0.7])
    across /= np.linalg.norm(across)
    beside = np.cross(sun, across)
    for share in (0.2, 0.9):
        found, density = sample_sun(light, mi.Point2f(mi.Float(np.full(12, share)), mi.Float(steps)))
        there = np.array(found).reshape(3, 12).T
        away = share * (1.0 - np.cos(0.3))
        np.testing.assert_allclose(there @ sun, 1.0 - away, atol=1e-6)
        np.testing.assert_allclose(there.mean(axis=0), (1.0 - away) * sun, atol=1e-6)
        parts = there @ np.stack([across, beside], axis=1)
        half = 0.5 * away * (2.0 - away)
        np.testing.assert_allclose(parts.T @ parts / 12.0, half * np.eye(2), atol=1e-6)
        np.testing.assert_allclose(np.array(density), 1.0 / (2.0 * np.pi * (1.0 - np.cos(0.3))), rtol=1e-5)


def test_fixed_directions_lie_on_the_lit_earth() -> None:
    from scanner_sim.render.background.sky import earth_directions, earth_radiance, sky_light

    light = sky_light((1.0, 0.1, 0.0), RADIUS, DOWN)
    direction, weight = earth_directions(light, 200)
    assert direction.shape == (200, 3)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1.0, atol=1e-6)
    assert (weight > 0.0).mean() > 0.99
    assert (np.array(earth_radiance(light, vectors(*direction))) > 0.0).mean() > 0.99
    np.testing.assert_array_equal(earth_directions(light, 200)[1], weight)


def test_another_place_is_no_other_kernel() -> None:
    import drjit as dr
    import mitsuba as mi

    from scanner_sim.render.background.sky import earth_radiance, sample_earth, sky_light

    @dr.freeze
    def brightness(light: Any, u: Any) -> Any:
        direction, density = sample_earth(light, u)
        return dr.mean(earth_radiance(light, direction) / density)

    u = mi.Point2f(dr.linspace(mi.Float, 0.05, 0.95, 100), 0.5)
    found = [
        float(brightness(sky_light((np.sin(a), -np.cos(a), 0.0), RADIUS, DOWN), u)[0])
        for a in (0.0, 0.5, 1.0)
    ]
    assert brightness.n_recordings == 1
    assert found[0] > found[1] > found[2] > 0.0


def loaded(earth: str) -> Any:
    import mitsuba as mi

    from scanner_sim.render.plugins.sky_emitter import register_orbit_sky

    assert register_orbit_sky() is register_orbit_sky()
    mi.set_log_level(mi.LogLevel.Error)
    return mi.load_string(SCENE.format(earth=earth))


def irradiance(scene: Any) -> float:
    """Return the irradiance of the plate by 256 samples of the emitter."""
    import drjit as dr
    import mitsuba as mi

    si = scene.ray_intersect(mi.Ray3f(mi.Point3f(0.0), mi.Vector3f(0.0, 0.0, 1.0)))
    side = (dr.arange(mi.Float, 16) + 0.5) / 16.0
    u = mi.Point2f(*dr.meshgrid(side, side))
    ds, weight = scene.sample_emitter_direction(dr.gather(type(si), si, dr.zeros(mi.UInt32, 256)), u, True)
    return float(dr.mean(weight[0] * dr.maximum(dr.dot(ds.d, si.n), 0.0))[0])


def test_the_emitter_is_read_from_a_scene_and_follows_its_parameters() -> None:
    import mitsuba as mi

    scene = loaded('<float name="irradiance" value="2"/>')
    assert scene.environment().is_environment()
    assert "OrbitSky" in str(scene.environment())
    assert irradiance(scene) == pytest.approx(np.sqrt(2.0), rel=1e-3)
    parameters = mi.traverse(scene)
    parameters["sky.sun_direction"] = [0.0, 0.0, -3.0]
    parameters["sky.irradiance"] = 1.0
    parameters.update()
    assert irradiance(scene) == pytest.approx(1.0, rel=1e-3)
    assert not any("earth" in key for key in parameters.keys())  # noqa: SIM118  not a dictionary


def test_the_emitters_earth_adds_its_light() -> None:
    import mitsuba as mi

    scene = loaded('<vector name="earth_direction" x="0" y="0" z="-1"/><float name="albedo" value="0.5"/>')
    parameters = mi.traverse(scene)
    assert irradiance(scene) == 0.0  # the Sun stands behind the Earth, which shows its night
    parameters["sky.sun_direction"] = [0.0, 0.0, 1.0]
    parameters.update()
    high = irradiance(scene)
    assert high == pytest.approx(0.5 * 0.882, rel=0.02)
    parameters["sky.albedo"] = 0.0
    parameters.update()
    assert irradiance(scene) == 0.0


def test_the_emitter_says_what_it_cannot() -> None:
    import mitsuba as mi

    from scanner_sim.render.plugins.sky_emitter import register_orbit_sky

    register_orbit_sky()
    with pytest.raises(RuntimeError, match="sun_direction"):
        mi.load_dict({"type": "orbit_sky"})
    with pytest.raises(NotImplementedError, match="sensor"):
        loaded("").environment().sample_ray(0.0, 0.5, [0.5, 0.5], [0.5, 0.5])


def test_the_emitter_needs_arrays_of_rays() -> None:
    """In a process of its own: a plugin stays registered with the variant that it was made in."""
    code = """
import mitsuba as mi
from scanner_sim.foundation.errors import InputError
from scanner_sim.render.plugins.sky_emitter import register_orbit_sky
mi.set_variant("scalar_rgb")
try:
    register_orbit_sky()
except InputError as error:
    print(error)
mi.set_variant("llvm_ad_mono")
print(register_orbit_sky().__name__)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=240)
    assert (done.returncode, done.stderr) == (0, "")
    first, second = done.stdout.splitlines()
    assert first == (
        "orbit_sky computes for arrays of rays, and the variant scalar_rgb has none. "
        "Set llvm_ad_mono or cuda_ad_mono."
    )
    assert second == "OrbitSky"


def test_the_emitter_without_words_is_the_sun_and_the_earth_of_a_low_orbit() -> None:
    """Claim: left-out keys are an irradiance of 1 W/m², a Sun of 4.65 mrad, and an Earth of 6371 km and an albedo of
    0.3, 400 km below."""
    from scanner_sim.render.plugins.sky_emitter import register_orbit_sky

    register_orbit_sky()
    import mitsuba as mi

    told = {
        "irradiance": 1.0,
        "sun_angular_radius": 4.65e-3,
        "earth_altitude": 400e3,
        "earth_radius": 6371e3,
        "albedo": 0.3,
    }
    placed = {"type": "orbit_sky", "sun_direction": [0.0, -1.0, 0.3], "earth_direction": [0.0, 1.0, 0.2]}

    def light(**changes: float) -> list[float]:
        found = mi.traverse(mi.load_dict({**placed, **changes}))
        return [float(found[name].numpy().item()) for name in told]

    assert light() == pytest.approx(list(told.values()), rel=1e-6)
    assert light() == light(**told)


def test_the_emitter_tells_of_a_direction_what_it_told_when_it_chose_it() -> None:
    """Claim: over 256 directions density and radiance are those of the sample, whose weight is their ratio; a lane that
    is not active has neither, and a ray that leaves the scene that way sees the same."""
    import drjit as dr
    import mitsuba as mi

    scene = loaded(
        '<vector name="earth_direction" x="0.2" y="1" z="0.3"/><float name="irradiance" value="3"/>'
    )
    sky = scene.environment()
    side = (dr.arange(mi.Float, 16) + 0.5) / 16.0
    at = dr.zeros(mi.Interaction3f, 256)
    ds, weight = sky.sample_direction(at, mi.Point2f(*dr.meshgrid(side, side)), True)
    density, radiance = (
        np.asarray(values.numpy()) for values in (ds.pdf, sky.eval_direction(at, ds, True)[0])
    )
    assert density.min() > 0.0
    assert radiance.max() > 0.0
    np.testing.assert_allclose(sky.pdf_direction(at, ds, True).numpy(), density, rtol=1e-6)
    np.testing.assert_allclose(weight[0].numpy() * density, radiance, rtol=1e-5)
    active = mi.Bool(np.arange(256) % 3 == 0)
    some = np.where(np.arange(256) % 3 == 0, 1.0, 0.0)
    np.testing.assert_allclose(sky.pdf_direction(at, ds, active).numpy(), some * density, rtol=1e-6)
    np.testing.assert_allclose(sky.eval_direction(at, ds, active)[0].numpy(), some * radiance, rtol=1e-6)
    ray = dr.zeros(mi.SurfaceInteraction3f, 256)
    ray.wi = -ds.d
    np.testing.assert_allclose(sky.eval(ray, True)[0].numpy(), radiance, rtol=1e-6)
    assert dr.none(sky.bbox().valid())
