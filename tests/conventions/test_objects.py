"""Object frames: unrotated, the front faces −z (back at the scanner), x is right and y is down."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from scanner_sim.render.device import Device
from scanner_sim.scene.files.loader import load_scene
from scanner_sim.scene.objects import Rectangle, Scene
from scanner_sim.scene.poses import Rotation
from scanner_sim.scene.surfaces import Surface
from scanner_sim.scene.targets import target_positions

GREY = Surface(reflectance=0.5)


def _look(scene: Scene, x: float, y: float) -> Any:
    """Return what a ray meets that runs parallel to z at (x, y)."""
    return load_scene(scene).mitsuba.ray_intersect(
        mi.Ray3f(mi.Point3f(x, y, 0.0), mi.Vector3f(0.0, 0.0, 1.0))
    )


def _plate(**pose: Any) -> Scene:
    plate = Rectangle(name="plate", shape="rectangle", size=(2.0, 1.0), material=GREY, **pose)
    return Scene(objects=(plate,))


def test_front_looks_back_at_the_scanner(device: Device) -> None:
    met = _look(_plate(position=(0.0, 0.0, 5.0)), 0.0, 0.0)
    np.testing.assert_allclose(np.array(met.n).ravel(), (0.0, 0.0, -1.0), atol=1e-6)


def test_size_is_width_then_height(device: Device) -> None:
    scene = _plate(position=(0.0, 0.0, 5.0))
    assert _look(scene, 0.9, 0.0).is_valid()[0]
    assert not _look(scene, 0.0, 0.9).is_valid()[0]


def test_position_is_right_down_ahead(device: Device) -> None:
    scene = _plate(position=(3.0, 2.0, 5.0))
    assert float(_look(scene, 3.0, 2.0).t[0]) == pytest.approx(5.0, rel=1e-6)
    assert not _look(scene, -3.0, 2.0).is_valid()[0]
    assert not _look(scene, 3.0, -2.0).is_valid()[0]


def test_turn_about_y_brings_the_right_side_nearer(device: Device) -> None:
    """+20° about y (down) turns z towards x: the right edge comes nearer, the front looks to the left."""
    scene = _plate(position=(0.0, 0.0, 5.0), rotation=Rotation(axis="y", angle=float(np.deg2rad(20.0))))
    right = _look(scene, 0.5, 0.0)
    assert float(right.t[0]) == pytest.approx(5.0 - 0.5 * np.tan(np.deg2rad(20.0)), rel=1e-6)
    assert np.array(right.n).ravel()[0] < -0.3


def test_turn_about_x_moves_the_lower_side_away(device: Device) -> None:
    """+20° about x (right) turns y towards z: the lower edge goes further away, the front looks down."""
    scene = _plate(position=(0.0, 0.0, 5.0), rotation=Rotation(axis="x", angle=float(np.deg2rad(20.0))))
    lower = _look(scene, 0.0, 0.3)
    assert float(lower.t[0]) == pytest.approx(5.0 + 0.3 * np.tan(np.deg2rad(20.0)), rel=1e-6)
    assert np.array(lower.n).ravel()[1] > 0.3


def test_turns_are_made_in_their_order(device: Device) -> None:
    """A plate of 2 × 1 m, turned by a quarter about z and by nearly one about y.

    Quarter first: the width stands upright, untouched by the second turn. Quarter last: the width was made
    short by the first turn, and the height lies across.
    """
    quarter, turn = Rotation(axis="z", angle=np.pi / 2), Rotation(axis="y", angle=np.pi / 2 - 0.2)
    upright = _plate(position=(0.0, 0.0, 5.0), rotation=(quarter, turn))
    assert _look(upright, 0.0, 0.9).is_valid()[0]
    assert not _look(upright, 0.4, 0.0).is_valid()[0]
    across = _plate(position=(0.0, 0.0, 5.0), rotation=(turn, quarter))
    assert not _look(across, 0.0, 0.9).is_valid()[0]
    assert _look(across, 0.4, 0.0).is_valid()[0]


def test_targets_are_counted_from_the_top_left() -> None:
    places = target_positions(2, 3, 1.0, 0.5)
    np.testing.assert_allclose(places[0], (-1.0, -0.25, 0.0))
    np.testing.assert_allclose(places[1], (0.0, -0.25, 0.0))
    np.testing.assert_allclose(places[3], (-1.0, 0.25, 0.0))
