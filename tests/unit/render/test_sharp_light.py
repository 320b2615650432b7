"""The sharp light of a panorama's bins: what share of a bin is lit, in two halves that know nothing of each other."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mitsuba
import numpy as np
import pytest
from claims import mean, scatter_ratio
from numpy.typing import NDArray
from prototype import Laser, Receiver

from scanner_sim.analytic.geometry import lens_node, scanner_axes
from scanner_sim.foundation.streams import Stream
from scanner_sim.render.background import panorama, sharp
from scanner_sim.render.background.panorama import Panorama
from scanner_sim.render.background.paths import trace_paths, trace_sharp
from scanner_sim.render.background.sky import sky_light
from scanner_sim.render.background.view import PanoramaView, Rows, panorama_view
from scanner_sim.render.transport import OpticalLayout
from scanner_sim.scene.files.loader import load_scene
from scanner_sim.scene.objects import Scene

Array = NDArray[np.float64]
mi: Any = mitsuba
PITCH, HEIGHT, SIDE, DISTANCE, TURN = 50e-6, 250e-6, 4.0, 5.0, math.radians(25.0)
RECEIVER = Receiver()
LAYOUT = OpticalLayout(Laser(), RECEIVER, 0.05, 0.8, PITCH, HEIGHT, 1e-3, 0.0)
ROWS, BINS, FINE = 36, 24, 24
STEP = PITCH / RECEIVER.focal_length
VIEW = PanoramaView(0.1 + 1.3 * STEP * np.arange(ROWS), 0.33, STEP, BINS)
WHITE = 0.4 / math.pi
"""Radiance of the wall, which the Sun lights from straight ahead."""

pytestmark = pytest.mark.usefixtures("device")


def halves(seed: int, samples: int) -> Array:
    """Return which share of each bin either half finds lit, (2, rows, bins): a wall's edge crosses them aslant."""
    wall = {"name": "wall", "shape": "rectangle", "size": (SIDE, SIDE), "position": (0.0, 0.0, DISTANCE),
            "rotation": [{"axis": (0.0, 0.0, 1.0), "angle": TURN}], "material": {"reflectance": 0.4}}  # fmt: skip
    light = sky_light((0.0, 0.0, -1.0), 4.65e-3, None)
    loaded = load_scene(Scene(objects=[wall]))  # type: ignore[list-item]
    found = sharp.evenly_sharp_light(loaded, LAYOUT, light, VIEW, samples, seed)
    return np.array([half[0].numpy().reshape(ROWS, BINS) for half in found]) / WHITE


def lit() -> Array:
    """Return the lit shares by plain sums over each bin's angles and the pixel's height, shape (rows, bins)."""
    even = (np.arange(FINE) + 0.5) / FINE - 0.5
    angle = VIEW.first + STEP * (np.arange(BINS)[:, None, None] + even[:, None])
    phi = VIEW.phi[:, None, None, None]
    along, _, normal = scanner_axes(angle, phi)
    ray = along + normal * (HEIGHT / RECEIVER.focal_length * even[:, None])
    origin = lens_node(phi, 0.05, RECEIVER.baseline)
    point = origin + ray * ((DISTANCE - origin[..., 2:]) / ray[..., 2:])
    x, y = point[..., 0], point[..., 1]
    across = np.cos(TURN) * x + np.sin(TURN) * y, np.cos(TURN) * y - np.sin(TURN) * x
    return np.asarray((np.maximum(*np.abs(across)) < 0.5 * SIDE).mean(axis=(2, 3)))


def test_a_bin_at_an_edge_is_lit_by_its_share() -> None:
    """Claim: over bins that an edge crosses the lit share is right on average, where much is lit as where little is.

    Set-up: 24 samples of each bin in both halves with four seeds. Expected: plain sums. Tolerance: rows have random
    starts of their own, so that their sums are independent; 10⁻³ for the plain sums. The lattice leaves less than a
    quarter of the variance that as many random samples would, w (1 − w)/24: of lines across a cell it is an eighth.
    """
    wanted = lit()
    errors = np.array([halves(seed, 24) for seed in range(4)]) - wanted
    assert ((wanted > 0.0) & (wanted < 1.0)).any(axis=1).all()
    assert mean(errors.sum(axis=-1), slack=1e-3)
    assert mean((errors * (wanted - 0.5)).sum(axis=-1), slack=1e-3)
    assert np.mean(errors**2) < 0.25 * np.mean(wanted * (1.0 - wanted) / 24.0)


def test_halves_differ_as_other_seeds_do() -> None:
    """Claim: the difference of both halves, of which the error of the background is told, scatters as that of two
    seeds. Row by row each is none, or a sample more or less: a ratio of less scatter than of normal numbers."""
    first, other = halves(3, 6), halves(4, 6)
    apart, told = ((one - two).sum(axis=-1) for one, two in ((first, other), (first[:, None], first[None])))
    assert scatter_ratio(float(told[0, 1].std()), float(apart.std()), (ROWS, 2.0 * ROWS))


def test_each_row_of_each_half_has_numbers_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: no two draw from one address; each takes two samples of it."""
    known, asked = sharp.generator, []

    def noted(seed: Any, stream: Stream, shot: Any, sample: Any) -> Any:
        asked.append((stream, int(shot.numpy()[0]), np.unique(sample.numpy())))
        return known(seed, stream, shot, sample)

    monkeypatch.setattr(sharp, "generator", noted)
    halves(1, 1)
    assert {part[:2] for part in asked} == {(Stream.BACKGROUND, 0xFFFFFF00)}
    taken = np.concatenate([[*part[2], *(part[2] + 1)] for part in asked])
    assert len(taken) == len(np.unique(taken)) == 2 * 2 * ROWS


@pytest.mark.parametrize("horizontal", [(-0.2, 0.3), (0.1, 0.1)])
def test_a_panorama_holds_all_that_the_pixels_see(horizontal: tuple[float, float]) -> None:
    """Claim: Θ − atan(p/f) of the last pixel at the first shot and the first pixel at the last lie within the first and
    the last bin's centre by one bin, and no more than two bins too many are made."""
    view = panorama_view(Rows(horizontal, np.zeros(1)), LAYOUT, 400)
    left = horizontal[0] - math.atan((1e-3 + 400 * PITCH) / RECEIVER.focal_length)
    right = horizontal[1] - math.atan(1e-3 / RECEIVER.focal_length)
    assert view.first == pytest.approx(left - STEP, abs=1e-12)
    assert STEP * (1.0 - 1e-9) <= view.first + (view.bins - 1) * view.step - right <= 2.0 * STEP


@pytest.mark.parametrize("between", [False, True])
def test_a_panorama_is_looked_at_between_its_bins(between: bool) -> None:
    """Claim: what is linear in the angle, and between rows in their number, is found; beyond the ends the last."""
    bins, rows, first, step = 20, 5, -0.1, 0.01
    view: Any = PanoramaView(np.linspace(0.0, 0.1, rows), first, step, bins)
    values = 3.0 + 2.0 * np.arange(bins) + 7.0 * np.arange(rows)[:, None]
    layer = mi.Float(values.astype(np.float32).ravel())
    angles = np.array([-0.1, -0.0965, 0.0123, 0.0899, 0.09, 0.2, -0.3])
    row = np.array([0.0, 1.25, 2.5, 3.9, 4.0, 1.0, 2.0]) if between else np.array([0, 1, 2, 3, 4, 1, 2])
    panorama = Panorama(view, layer, layer, layer, layer)
    given = mi.Float(row.astype(np.float32)) if between else mi.UInt32(row.astype(np.uint32))
    found = panorama.look(layer, given, mi.Float(angles.astype(np.float32))).numpy()
    wanted = 3.0 + 2.0 * np.clip((angles - first) / step, 0.0, bins - 1.0) + 7.0 * row
    np.testing.assert_allclose(found, wanted, rtol=1e-4)


MIRROR = """<scene version="3.0.0"><shape type="rectangle">
<transform name="to_world"><rotate x="1" angle="180"/><scale value="0.1"/></transform>
<bsdf type="twosided"><bsdf type="conductor"><string name="material" value="none"/>
<spectrum name="specular_reflectance" value="0.7"/></bsdf></bsdf>
</shape></scene>"""
"""A smooth mirror of 70 %, 0.2 m wide, that faces −z."""


def test_a_mirror_shows_the_sky_that_it_faces(tmp_path: Path) -> None:
    """Claim: a first mirror shows 0.7 of the Sun, 1/(π sin²α), in band and out of it, and of the Earth by both albedos,
    where nothing stands between; beside both, and behind what hides them, it is dark, and a grey wall has ρ/π cosζ.

    Set-up: rays of the mirrors' axis and others beside it meet mirrors at 3 m that are turned by 10° about y, and so
    send the light back under 20°: one to the Sun, one to a plate before the Sun, one 1° beside the Sun.
    Tolerance: the wall is lit from one point of the Sun's disc, 4.65 mrad tanζ = 2e-3 of its light.
    """
    path = tmp_path / "mirror.xml"
    path.write_text(MIRROR)
    aside, away = math.radians(20.0), np.array([0.0, 0.4, 0.8])
    sun = np.array([math.sin(aside), 0.0, -math.cos(aside)])
    turned = {"axis": "y", "angle": -math.radians(10.0)}
    mirrors = [
        {"name": f"mirror{number}", "file": path, "position": (0.0, y, 3.0), "rotation": turned}
        for number, y in enumerate(away[:2])
    ]
    plates = [
        {"name": "screen", "position": tuple(np.array([0.0, away[1], 3.0]) + 1.5 * sun), "size": (0.2, 0.2)},
        {"name": "wall", "position": (0.0, away[2], 3.0), "size": (0.2, 0.2)},
    ]
    grey = {"shape": "rectangle", "material": {"reflectance": 0.4}}
    loaded = load_scene(Scene(objects=[*mirrors, *(one | grey for one in plates)]))  # type: ignore[list-item]

    def seen(towards: Any, earth: Any = None) -> Array:
        light = sky_light(tuple(towards), 4.65e-3, earth, 400e3, albedo=(0.3, 0.7))
        origin = mi.Point3f(0.0, mi.Float(away), 0.0)
        half, drawn = mi.Float(np.full(3, 0.5)), mi.Float(np.full(3, 0.4))
        found = trace_sharp(
            loaded, light, origin, mi.Vector3f(0.0, 0.0, mi.Float(np.ones(3))),
            mi.Point2f(half, half), mi.Vector4f(drawn, drawn, drawn, drawn),
        )  # fmt: skip
        return np.array([part.numpy() for part in found])

    level = 0.7 / (math.pi * math.sin(4.65e-3) ** 2)
    wall = 0.4 / math.pi * math.cos(aside)
    np.testing.assert_allclose(seen(sun), [[level, 0.0, wall]] * 2, rtol=2e-3)
    beside = math.radians(21.0)
    wall = 0.4 / math.pi * math.cos(beside)
    np.testing.assert_allclose(
        seen([math.sin(beside), 0.0, -math.cos(beside)]), [[0.0, 0.0, wall]] * 2, rtol=2e-3
    )
    # Below the scene, lit from straight above: radiance a/π of the Earth, which the wall sees only by later light.
    shown = seen(-sun, tuple(sun))
    np.testing.assert_allclose(shown[:, 0], 0.7 * np.array([0.3, 0.7]) / math.pi, rtol=1e-4)
    assert not shown[:, 1:].any()


GLASS = (
    '<bsdf type="thindielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf>'
)
VEIL = """<bsdf type="mask"><float name="opacity" value="0.25"/><bsdf type="twosided"><bsdf type="diffuse">
<spectrum name="reflectance" value="0"/></bsdf></bsdf></bsdf>"""


@pytest.mark.parametrize(("through", "share"), [(GLASS, 2.0 * 1.5 / (1.5**2 + 1.0)), (VEIL, 0.75)])
def test_what_is_seen_straight_through_a_surface_is_sharp_and_whole(
    tmp_path: Path, through: str, share: float
) -> None:
    """Claim: through a pane of glass, 2n/(n² + 1) at right angles, and a black veil over a quarter, Sun and Earth are
    seen by what gets through of 1/(π sin²α), and of both albedos over π where the Sun stands aside, by its cosine.
    All of it is direct, by whole paths as by the sharp light alone: no point of either disc would have brought it.

    Set-up: the pane is 3 m ahead, the Sun or the Earth behind it. Tolerance: of a thousand evenly spaced numbers, by
    which a path goes through or not, at most one is on the wrong side, and single precision has 1e-4 of the Sun.
    """
    path, count = tmp_path / "pane.xml", 1000
    path.write_text(MIRROR[: MIRROR.index("<bsdf")] + through + MIRROR[MIRROR.index("\n</shape>") :])
    loaded = load_scene(Scene(objects=[{"name": "pane", "file": path, "position": (0.0, 0.0, 3.0)}]))  # type: ignore[list-item]
    even, half = mi.Float((np.arange(count) + 0.5) / count), mi.Float(np.full(count, 0.5))
    draws, origin = mi.Vector4f(even, half, half, half), mi.Point3f(0.0, 0.0, mi.Float(np.zeros(count)))
    ahead = mi.Vector3f(0.0, 0.0, mi.Float(np.ones(count)))
    sun = 1.0 / (math.pi * math.sin(4.65e-3) ** 2)
    for light, wanted in (
        (sky_light((0.0, 0.0, 1.0), 4.65e-3, None), np.array([sun, sun])),
        (
            sky_light((0.0, 0.8, -0.6), 4.65e-3, (0.0, 0.0, 1.0), 400e3, albedo=(0.3, 0.7)),
            0.6 * np.array([0.3, 0.7]) / math.pi,
        ),
    ):
        found, _ = trace_paths(loaded, light, 1, origin, ahead, lambda _: draws)
        alone = trace_sharp(loaded, light, origin, ahead, mi.Point2f(half, half), draws)
        for direct in ((found.direct, found.direct_out), alone):
            seen = [part.numpy().mean(dtype=np.float64) for part in direct]
            np.testing.assert_allclose(seen, share * wanted, rtol=2e-3)
        assert not found.indirect.numpy().any()
        assert not found.indirect_out.numpy().any()


@pytest.mark.parametrize(("spacing", "rows"), [(1.9, 1), (2.1, 0)])
def test_sharp_light_is_sampled_by_the_extremes_of_both_halves(
    monkeypatch: pytest.MonkeyPatch, spacing: float, rows: int
) -> None:
    """Claim: the contrast of a bin is that of the least and the largest sample of either half; a row above and below
    has a say where rows stand closer than two heights of a pixel."""
    sums = [[mi.Float(values) for values in half] for half in (([3, 0.5], [5, 9]), ([2, 0.7], [8, 6]))]
    monkeypatch.setattr(panorama, "contrast", lambda *given: given[0] + 100.0 * given[1] + 1e4 * given[3])
    monkeypatch.setattr(panorama, "sharp_light", lambda *given, finer, seed: (given[4], finer, seed))
    view: Any = SimpleNamespace(row_step=spacing * HEIGHT / RECEIVER.focal_length)
    seen: Any = "loaded", LAYOUT, "sky", view
    found, *others = panorama._sharp_by_contrast(*seen, sums, 4, 7)
    np.testing.assert_allclose(found, np.array([802.0, 900.5]) + 1e4 * rows)
    assert others == [4, 7]
