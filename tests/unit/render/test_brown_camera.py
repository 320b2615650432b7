"""The Mitsuba sensor ``brown_camera`` in somebody's own scene."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from scanner_sim.foundation.errors import InputError
from scanner_sim.optics.interior_orientation import InteriorOrientation

pytestmark = pytest.mark.usefixtures("device")

LENS = {"focal_length": 12e-3, "pixel_pitch": 50e-6, "k1": -0.3, "k2": 0.1, "p1": 2e-3}


def sensor(**settings: Any) -> Any:
    import mitsuba as mi

    from scanner_sim.render.plugins.brown_camera import register_brown_camera

    register_brown_camera()
    film = {
        "type": "hdrfilm",
        "width": 64,
        "height": 48,
        "rfilter": {"type": "box"},
        "component_format": "float32",
    }
    return mi.load_dict({"type": "brown_camera", "film": film, **LENS, **settings})


def test_rays_go_where_the_calibration_says() -> None:
    import mitsuba as mi

    turn = mi.ScalarTransform4f().translate([0.3, 0.0, 1.0]).rotate([0, 1, 0], 10.0)
    made = sensor(to_world=turn, principal_u=30.0, principal_v=25.0)
    law = InteriorOrientation(columns=64, rows=48, principal_point=(30.0, 25.0), **LENS)
    pixels = np.random.default_rng(1).uniform(-0.5, (63.5, 47.5), (500, 2))
    share = ((pixels + 0.5) / (64, 48)).T
    ray, weight = made.sample_ray(0.0, 0.5, mi.Point2f(share), mi.Point2f(0.5))
    angle = np.radians(10.0)
    rotation = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    expected = law.directions(pixels) @ rotation.T
    # A fiftieth of a thousandth of a pixel, of which 240 are a radian, and single precision.
    np.testing.assert_allclose(np.array(ray.d).T, expected, atol=2e-4 / 240.0)
    np.testing.assert_allclose(np.array(ray.o)[:, 0], (0.3, 0.0, 1.0), rtol=1e-6)
    assert np.array(weight).min() == 1.0


def test_its_box_is_its_pinhole() -> None:
    import mitsuba as mi

    turn = mi.ScalarTransform4f().translate([0.3, -0.2, 1.5]).rotate([0.2, 1.0, 0.4], 25.0)
    box = sensor(to_world=turn).bbox()
    for corner in (box.min, box.max):
        np.testing.assert_allclose(np.array(corner).ravel(), (0.3, -0.2, 1.5), rtol=1e-6)


def test_the_ray_beside_is_that_of_the_next_pixel() -> None:
    """Claim: differentials in x and y are the rays of the next column and of the next row."""
    import mitsuba as mi

    made = sensor(principal_u=30.0, principal_v=25.0)
    law = InteriorOrientation(columns=64, rows=48, principal_point=(30.0, 25.0), **LENS)
    pixels = np.array([[10.0, 7.0], [40.3, 20.8]])
    share = ((pixels + 0.5) / (64, 48)).T
    ray, _ = made.sample_ray_differential(0.0, 0.5, mi.Point2f(share), mi.Point2f(0.5))
    assert ray.has_differentials
    for found, step in ((ray.d_x, (1.0, 0.0)), (ray.d_y, (0.0, 1.0))):
        # As above.
        np.testing.assert_allclose(np.array(found).T, law.directions(pixels + step), atol=2e-4 / 240.0)
    for origin in (ray.o_x, ray.o_y):
        np.testing.assert_allclose(np.array(origin), 0.0, atol=1e-9)


def test_a_scene_is_rendered_with_it() -> None:
    import mitsuba as mi

    law = InteriorOrientation(columns=64, rows=48, **LENS)
    scene = mi.load_dict(
        {
            "type": "scene",
            "camera": sensor(),
            "integrator": {"type": "direct"},
            "lamp": {
                "type": "sphere",
                "center": [0.8, 0.5, 10.0],
                "radius": 0.1,
                "emitter": {"type": "area", "radiance": {"type": "uniform", "value": 1.0}},
            },
        }
    )
    image = np.array(mi.render(scene, spp=64, seed=1))[:, :, 0]
    v, u = np.mgrid[:48, :64]
    found = (image * u).sum() / image.sum(), (image * v).sum() / image.sum()
    assert found == pytest.approx(tuple(law.project((0.8, 0.5, 10.0))), abs=0.1)


def test_a_lens_that_folds_is_refused() -> None:
    with pytest.raises((InputError, RuntimeError), match="brown_camera"):
        sensor(k1=-9.0)


def test_a_fault_of_a_camera_is_told_with_its_key_and_remedy() -> None:
    """Claim: a single fault is told by the key, what is wrong and what to write; without faults the principal point is
    the middle of the film, each end counted from the first pixel's centre."""
    from scanner_sim.render.plugins.brown_camera import _interior

    with pytest.raises(InputError, match=r"brown_camera: .*focal_length") as told:
        _interior({**LENS, "focal_length": -1e-3}, 64, 48)
    assert "metres" in told.value.remedy
    found = _interior({**LENS, "k3": 0.02, "p2": -1e-3, "principal_v": 20.0}, 64, 48)
    assert found.principal_point == (31.5, 20.0)
    assert (found.k1, found.k2, found.k3, found.p1, found.p2) == (-0.3, 0.1, 0.02, 2e-3, -1e-3)
    assert (found.columns, found.rows, found.focal_length, found.pixel_pitch) == (64, 48, 12e-3, 50e-6)
    assert _interior(LENS, 64, 48).principal_point == (31.5, 23.5)
