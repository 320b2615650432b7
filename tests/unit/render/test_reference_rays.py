"""The reference that follows random rays: when in a dwell they leave, and where the mirrors stand by then."""

from __future__ import annotations

import math
from typing import Any

import mitsuba
import numpy as np
import pytest
from claims import mean
from prototype import Laser, Receiver

from scanner_sim.analytic.geometry import lens_node
from scanner_sim.render.background import reference
from scanner_sim.render.transport import OpticalLayout
from scanner_sim.scene.files.loader import load_scene
from scanner_sim.scene.objects import Scene

mi: Any = mitsuba
WALL = {
    "name": "wall", "shape": "rectangle", "size": (9.0, 9.0), "position": (0.0, 0.0, 4.0),
    "material": {"reflectance": 0.5},
}  # fmt: skip

pytestmark = pytest.mark.usefixtures("device")


def test_rays_leave_evenly_over_the_dwell(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: Θ and φ of each ray lie on the way of the dwell, together; evenly: 12 (u − ½)² is 1 on average. A line is
    the mean of its rays, of which some land beside it, and its error that of a mean."""
    aims: list[Any] = []

    def land(loaded: Any, layout: Any, aim: Any, synchronisation: float, number: Any, *rest: Any) -> Any:
        aims.append([part.numpy() for part in aim])
        index = number.numpy().astype(int)
        return (index % 4 - 1).astype(np.float32), (1.0 + index % 8).astype(np.float32)

    monkeypatch.setattr(reference, "_land", land)
    travel = (4e-3, -2e-3)
    none: Any = None
    line = reference.reference_line(none, none, 2, 0.3, -0.1, travel=travel, rays=4096, seed=5)
    share, phi = (aims[0][0] - 0.3) / travel[0], aims[0][1]
    np.testing.assert_allclose((phi + 0.1) / travel[1], share, atol=1e-4)
    assert np.abs(share).max() <= 0.5 + 1e-4
    assert mean(share)
    assert mean(12.0 * share**2, 1.0)
    # Rays 1 and 5 of eight land on pixel 0 with 2 and 6 W, 2 and 6 on pixel 1 with 3 and 7 W.
    np.testing.assert_allclose(line.power, [8.0 / 8.0, 10.0 / 8.0])
    variance = np.array([40.0, 58.0]) / 8.0 - line.power**2
    np.testing.assert_allclose(line.standard_error, np.sqrt(variance / 4096.0))


@pytest.mark.parametrize("turn", [-0.02, 0.02])
def test_a_receiver_that_looks_farther_sees_the_spot_nearer_the_laser(turn: float) -> None:
    """Claim: a point at the angle a from the receiver's axis lies at p = f tan a; an axis turned by s along Θ makes it
    f tan(a + s), since p grows against Θ. By a mean of rays, in pixels of 1 µm."""
    loaded = load_scene(Scene(objects=[WALL]))  # type: ignore[list-item]
    receiver = Receiver(aperture=1e-4)
    layout = OpticalLayout(Laser(waist_radius=1e-4), receiver, 0.05, 0.8, 1e-6, 1e-2, -0.02, 0.0)
    rays = mi.UInt32(np.arange(256))
    middles = []
    for angle in (0.0, turn):
        pixel, power = reference._land(loaded, layout, (0.0, 0.0), angle, rays, 3, 0)
        assert (power > 0.0).all()
        middles.append((float(np.median(pixel)) + 0.5) * 1e-6 - 0.02)
    away = math.atan(middles[0] / receiver.focal_length)
    assert middles[1] == pytest.approx(receiver.focal_length * math.tan(away + turn), abs=1e-5)


def test_light_goes_through_the_whole_aperture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: rays from the surface end evenly on the lens's disc, across the scanner's sight: 2 r²/a² is 1 on average,
    4 x²/a² across and along the other axis, too. Set-up: a wall straight ahead, 4096 rays."""
    loaded = load_scene(Scene(objects=[WALL]))  # type: ignore[list-item]
    receiver = Receiver(aperture=0.04)
    layout = OpticalLayout(Laser(), receiver, 0.05, 0.8, 50e-6, 1e-2, 0.0, 0.0)
    ends: list[Any] = []

    def noted(scene: Any, ray: Any) -> Any:
        ends.append(np.array(ray.o + ray.d * ray.maxt))
        return mi.Bool(False)

    monkeypatch.setattr(reference, "is_occluded", noted)
    reference._land(loaded, layout, (0.0, 0.0), 0.0, mi.UInt32(np.arange(4096)), 3, 0)
    # At Θ = φ = 0 the sight is along z, and the lens lies at the base's length on the x-axis.
    lens = lens_node(0.0, 0.05, receiver.baseline)
    x, y, z = ends[0] - lens[:, None]
    half = 0.5 * receiver.aperture
    # A shadow's ray ends a little before its goal.
    assert np.abs(z).max() < 0.01
    assert np.hypot(x, y).max() < 1.01 * half
    for part in (x, y):
        assert mean(part / half, slack=2e-3)
        assert mean(4.0 * (part / half) ** 2, 1.0, slack=5e-3)
