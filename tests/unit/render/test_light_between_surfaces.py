"""Sunlight that comes by way of other surfaces: paths of two plates at right angles, held to sums over both."""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import mitsuba
import numpy as np
import pytest
from claims import mean
from numpy.typing import NDArray

from scanner_sim.foundation.device_streams import generator
from scanner_sim.foundation.streams import Stream
from scanner_sim.render.background.paths import trace_paths
from scanner_sim.render.background.sky import sky_light
from scanner_sim.scene.files.loader import load_scene
from scanner_sim.scene.objects import Scene

Array = NDArray[np.float64]
Reflected = dict[str, tuple[float, float]]
mi: Any = mitsuba
FINE, PATHS = 28, 60_000
SEEN = np.array([0.3, 0.4, 5.0])
REFLECTED = {"wall": (0.8, 0.6), "floor": (0.7, 0.35)}
"""Reflectance in band and out of band."""
DARK = {"wall": (0.0, 0.6), "floor": (0.0, 0.35)}
"""Nothing in band, and the same out of it."""

pytestmark = pytest.mark.usefixtures("device")


def plates() -> dict[str, tuple[Array, Array]]:
    """Return centres of the parts of a wall at z = 5 m and of a floor at y = 1 m below it, and their normals."""
    even = 2.0 * (np.arange(FINE) + 0.5) / FINE - 1.0
    a, b = (part.ravel() for part in np.meshgrid(even, even))
    return {
        "wall": (np.stack([a, b, 0.0 * a + 5.0], axis=1), np.array([0.0, 0.0, -1.0])),
        "floor": (np.stack([a, 0.0 * a + 1.0, b + 4.0], axis=1), np.array([0.0, -1.0, 0.0])),
    }


def shares(at: Array, normal: Array, parts: Array, other: Array) -> Array:
    """Return cos cos′ dA/(π r²) of parts as seen from points, shape (points, parts)."""
    way = parts - at[:, None]
    square = (way**2).sum(axis=-1)
    return np.asarray(
        np.maximum(way @ normal, 0.0)
        * np.maximum(-way @ other, 0.0)
        / (math.pi * square**2)
        * (2.0 / FINE) ** 2
    )


def expected(bounces: int, band: int, reflected: Reflected = REFLECTED) -> float:
    """Return the radiance of the wall's point for a Sun of 1 W/m² straight above the floor, by so many surfaces."""
    (wall, ahead), (floor, up) = plates().values()
    grey = {name: both[band] for name, both in reflected.items()}
    there, back = shares(wall, ahead, floor, up), shares(floor, up, wall, ahead)
    sent = lit = np.full(len(floor), grey["floor"])
    for _ in range(2, bounces - 1, 2):
        lit = grey["floor"] * (back @ (grey["wall"] * (there @ lit)))
        sent = sent + lit
    return float(grey["wall"] / math.pi * (shares(SEEN[None], ahead, floor, up) @ sent)[0])


def traced(light: Any, bounces: int, reflected: Reflected = REFLECTED) -> tuple[Any, Array]:
    """Return what paths to the wall's point bring, and where they met it."""
    objects = [
        {"name": name, "shape": "rectangle", "size": (2.0, 2.0), "position": place, "rotation": turns,
         "material": {"reflectance": reflected[name][0], "reflectance_out_of_band": reflected[name][1]}}
        for name, place, turns in (
            ("wall", (0.0, 0.0, 5.0), []),
            ("floor", (0.0, 1.0, 4.0), [{"axis": (1.0, 0.0, 0.0), "angle": -0.5 * math.pi}]),
        )
    ]  # fmt: skip
    loaded = load_scene(Scene(objects=objects))  # type: ignore[arg-type]
    lane, way = dr.arange(mi.UInt32, PATHS), (SEEN / np.linalg.norm(SEEN)).tolist()

    def random(draw: Any) -> Any:
        return generator(7, Stream.BACKGROUND, lane, draw).next_float32x4()

    direction = mi.Vector3f(*way) + dr.zeros(mi.Vector3f, PATHS)
    found, first = trace_paths(loaded, light, bounces, dr.zeros(mi.Point3f, PATHS), direction, random)
    return found, first.point.numpy()[:, 0]


def test_light_of_other_surfaces_is_the_sum_over_them() -> None:
    """Claim: a wall that the Sun just misses has what a lit floor sends it, by four surfaces also what it sent that
    itself, in either band by the product of all reflectances; nothing of it is direct.

    Tolerance: 2 ‰ of the sums over 28 × 28 parts of each plate. Of the same paths those of four surfaces bring what
    they bring more, whatever the others do: paths that end early are made up for by those that go on.
    """
    light = sky_light((0.0, -1.0, 2e-4), 1e-4, None)
    (one, met), (two, _), (four, _) = (traced(light, bounces) for bounces in (1, 2, 4))
    np.testing.assert_allclose(met, SEEN, atol=1e-5)
    assert not four.direct.numpy().any()
    assert not one.indirect.numpy().any()
    for band, name in enumerate(("indirect", "indirect_out")):
        few, more = (getattr(found, name).numpy().astype(np.float64) for found in (two, four))
        wanted = expected(2, band)
        assert mean(few, wanted, slack=2e-3 * wanted)
        wanted = expected(4, band) - wanted
        further = mean(more - few, wanted, slack=2e-3 * wanted)
        assert further
        assert further.finds < 0.3 * wanted


def test_earthshine_comes_by_other_surfaces_too() -> None:
    """Claim: of an Earth that is 0.1° wide, straight above and full, the floor has ⅔ of its albedo times its solid
    angle's share, (R/d)², as a sphere of Lambert's law sends back; the wall has of that what it has of the Sun."""
    radius, distance = 6371e3, 6371e3 / 1e-3
    light = sky_light((0.0, 1.0, 2e-4), 1e-4, (0.0, -1.0, 2e-3), distance - radius, radius, albedo=(0.3, 0.2))
    found, _ = traced(light, 2)
    for band, values in enumerate((found.indirect, found.indirect_out)):
        wanted = expected(2, band) * (0.3, 0.2)[band] * 2.0 / 3.0 * 1e-6
        assert mean(values.numpy().astype(np.float64), wanted, slack=5e-3 * wanted)


@pytest.mark.parametrize("dark", [("wall",), ("floor",), ("wall", "floor")])
def test_what_is_black_in_band_has_its_light_out_of_band(dark: tuple[str, ...]) -> None:
    """Claim: plates of which one or both reflect nothing in band have no light there, and out of band what their
    reflectances there give, whichever is black in band; so has the floor the Sun's own light.

    Tolerance: as of the light of other surfaces. What the floor has of the Sun is Lambert's ρ cosθ/π, to 1e-4.
    """
    plates = {**REFLECTED, **{name: DARK[name] for name in dark}}
    light = sky_light((0.0, -1.0, 2e-4), 1e-4, None)
    two, four = (traced(light, bounces, plates)[0] for bounces in (2, 4))
    assert not four.indirect.numpy().any()
    few, more = (found.indirect_out.numpy().astype(np.float64) for found in (two, four))
    wanted = expected(2, 1)
    assert mean(few, wanted, slack=2e-3 * wanted)
    further = expected(4, 1) - wanted
    assert mean(more - few, further, slack=2e-3 * wanted)
    behind = sky_light((0.0, 0.0, -1.0), 1e-4, None)
    seen, _ = traced(behind, 1, plates)
    assert seen.direct.numpy() == pytest.approx(plates["wall"][0] / math.pi, rel=1e-4)
    assert seen.direct_out.numpy() == pytest.approx(plates["wall"][1] / math.pi, rel=1e-4)


def test_a_retroreflector_that_is_black_in_band_scatters_out_of_it() -> None:
    """Claim: where the whole sky before it is as bright as the Sun, a sheet seen 0.3 rad askew has its reflectance out
    of band times that brightness, and in band nothing. A Sun of the irradiance 1 has 1/(π sin²α).

    Tolerance: 2 %, by what leaves the sheet below its horizon and the last degree of the sky; chance besides.
    """
    sheet = {
        "type": "retroreflector",
        "kind": "bead_sheet",
        "reflectance": 0.0,
        "reflectance_out_of_band": 0.6,
    }
    item = {"name": "sheet", "shape": "rectangle", "size": (9.0, 9.0), "position": (0.0, 0.0, 5.0)}
    material = {**sheet, "retro_share": 0.3, "half_width": 0.01}
    loaded = load_scene(Scene(objects=[{**item, "material": material}]))  # type: ignore[list-item]
    light = sky_light((0.0, 0.0, -1.0), math.radians(89.0), None)
    lane = dr.arange(mi.UInt32, 4000)
    found, _ = trace_paths(
        loaded, light, 1, dr.zeros(mi.Point3f, 4000), mi.Vector3f(math.sin(0.3), 0.0, math.cos(0.3)) + 0.0 * lane,
        lambda draw: generator(7, Stream.BACKGROUND, lane, draw).next_float32x4(),
    )  # fmt: skip
    brightness = 1.0 / (math.pi * math.sin(math.radians(89.0)) ** 2)
    claim = mean((found.direct_out + found.indirect_out).numpy(), 0.6 * brightness, slack=0.012 * brightness)
    assert claim
    assert claim.finds < 0.05 * brightness
    assert not (found.direct + found.indirect).numpy().any()
