"""All the light on the line by plain sums: the laser's behind the filter, a background that is known, the lens's veil;
and the same background on the photodiode."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import drjit as dr
import mitsuba
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Laser, Receiver
from scipy.stats import norm

from scanner_sim.analytic.beam import beam_radius
from scanner_sim.render import field_of_view
from scanner_sim.render.background.reference import reference_line
from scanner_sim.render.background.view import PanoramaView, Rows
from scanner_sim.render.beam.light import Light
from scanner_sim.render.field_of_view import Field, batches_of_echoes, field_light
from scanner_sim.render.incident import Incident, KnownBackground, Throughput
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout
from scanner_sim.scene.files.loader import load_scene
from scanner_sim.scene.objects import Scene

Array = NDArray[np.float64]
mi: Any = mitsuba

PIXELS, PITCH, HEIGHT, OFFSET = 40, 50e-6, 250e-6, 1e-3
F, BASE, D = 0.1, 0.2, 0.05
THETA, NUMBER, COLUMNS = np.array([0.10, -0.05, 0.02]), np.array([3, 14, 25]), 10
"""Shots of the rows 0, 1 and 2."""
PASSED = np.linspace(0.5, 1.0, PIXELS)
IN_BAND, OUT_OF_BAND = np.linspace(3e5, 5e5, PIXELS), np.linspace(2e6, 1e6, PIXELS)
SPOTS = ((12.3, 2e-3, 0.8), (14.9, 1e-3, 1.1))
"""Position [pixel], power [W] and width [pixel] of two clusters of the first shot; the others' lie 5 and 10 on."""

pytestmark = pytest.mark.usefixtures("device")


def layout(**changes: Any) -> OpticalLayout:
    laser = Laser(waist_radius=1e-3, waist_distance=4.0)
    return OpticalLayout(laser, Receiver(**changes), D, 0.8, PITCH, HEIGHT, OFFSET, 0.0)


class Lattice:
    """A panorama whose radiance is a straight line in row and angle, times a layer's number."""

    in_band, out_of_band, error, error_out = 1.0, 0.1, 0.03, 0.004
    view = SimpleNamespace(
        row=lambda shots, index, columns: dr.gather(mi.UInt32, shots.number, index) // columns
    )

    def seen_by(self, _: Any) -> Lattice:
        return self

    def look(self, layer: float, row: Any, angle: Any) -> Any:
        return layer * (2.0 + 0.25 * mi.Float(row) + 3.0 * angle)


def seen(layer: float, row: Array, angle: Array) -> Array:
    return np.asarray(layer * (2.0 + 0.25 * row + 3.0 * angle))


def collected() -> tuple[Array, Array]:
    """Return the angle at which pixels look, and A T S cos⁴ψ/f² of each."""
    receiver = Receiver()
    angle = np.arctan((OFFSET + (np.arange(PIXELS) + 0.5) * PITCH) / F)
    gain = math.pi / 4.0 * receiver.aperture**2 * receiver.transmission * 0.8
    return angle, gain * PITCH * HEIGHT / F**2 * np.cos(angle) ** 4


def background(index: int) -> Array:
    """Return the background of a shot on each pixel [W]."""
    angle, gain = collected()
    at = THETA[index] - angle
    inside, outside = (seen(layer, np.array(float(index)), at) for layer in (1.0, 0.1))
    return np.asarray(gain * (IN_BAND * inside + OUT_OF_BAND * outside))


def spot(index: int, place: float, width: float) -> Array:
    return np.diff(norm.cdf((np.arange(PIXELS + 1) - 0.5 - place - 5.0 * index) / width))


def incident(stray: float = 0.0, lit: bool = True, speckle: Any = None) -> Incident:
    first = mi.UInt32(np.arange(3, dtype=np.uint32))
    every = [
        np.concatenate(
            [np.full(3, cluster[k]) + (5.0 * np.arange(3) if k == 0 else 0.0) for cluster in SPOTS]
        )
        for k in range(3)
    ]
    place, amount, sigma = (mi.Float(values.astype(np.float32)) for values in every)
    still = [dr.zeros(mi.Float, 3) for _ in range(4)]
    shots = Shots(mi.UInt32(NUMBER.astype(np.uint32)), mi.Float(THETA.astype(np.float32)), *still)
    throughput = Throughput(layout(), PIXELS, PASSED, IN_BAND, OUT_OF_BAND, stray)
    light = Light(first, shots.number, amount, place, sigma)
    panorama: Any = Lattice() if lit else None
    return Incident(light, shots, COLUMNS, throughput, panorama, speckle)


@pytest.mark.parametrize("lit", [False, True])
def test_pixels_have_laser_and_background(lit: bool) -> None:
    """Claim: the normal distribution's share of each cluster times the filter's of the pixel; the background where the
    pixel looks, Θ − ψ, in the shot's row. Tolerance: single precision."""
    made = incident(lit=lit)
    laser, around = made.lines()
    assert (around is not None) is lit
    for index in range(3):
        wanted = PASSED * sum(power * spot(index, place, width) for place, power, width in SPOTS)
        np.testing.assert_allclose(laser[index], wanted, atol=2e-9)
        if around is not None:
            np.testing.assert_allclose(around[index], background(index), rtol=2e-5)
        whole = wanted + (background(index) if lit else 0.0)
        np.testing.assert_allclose(made.line(index), whole, rtol=2e-5, atol=2e-9)
        np.testing.assert_allclose(made.line(index, background=False), wanted, atol=2e-9)


def test_a_background_that_is_known_by_pixel_is_that_of_the_shot() -> None:
    """Claim: each pixel of each shot has what is known of it, one after the other, before and with the laser's; beyond
    the line there is none, and of a known darkness there is none either. A panorama beside it is not asked."""
    known = 1e-6 * (1.0 + np.arange(3.0 * PIXELS).reshape(3, PIXELS))
    nothing: Any = None
    made = replace(incident(), known=KnownBackground(mi.Float(known.astype(np.float32).ravel()), nothing))
    alone = incident(lit=False)
    assert made.is_lit
    laser, around = made.lines()
    assert around is not None
    np.testing.assert_allclose(around, known, rtol=1e-6)
    np.testing.assert_allclose(laser, alone.lines()[0], atol=2e-9)
    pixel, index = mi.UInt32([0, 7, PIXELS - 1, PIXELS, PIXELS + 3]), mi.UInt32([2, 0, 1, 1, 0])
    wanted = [known[2, 0], known[0, 7], known[1, -1], 0.0, 0.0]
    np.testing.assert_allclose(made.background(pixel, index).numpy(), wanted, rtol=1e-6)
    pairs = [one.numpy() for one in made.pair(mi.UInt32([12, 14]), mi.UInt32([0, 0]))]
    plain = [one.numpy() for one in alone.pair(mi.UInt32([12, 14]), mi.UInt32([0, 0]))]
    np.testing.assert_allclose(pairs[0] - plain[0], known[0, [12, 14]], rtol=2e-3)
    np.testing.assert_allclose(pairs[1] - plain[1], known[0, [13, 15]], rtol=2e-3)
    dark = replace(alone, known=KnownBackground(None, nothing))
    assert not dark.is_lit
    assert not dark.background(pixel, index).numpy().any()


def test_a_veil_is_a_share_of_all_light_on_each_pixel() -> None:
    """Claim: a tenth of what the filter passes of laser and background goes evenly to all pixels, the rest stays;
    speckle is the laser's alone. The filter is that of each cluster's pixel."""
    made = incident(0.1, speckle=lambda pixel, index: 1.0 + 0.5 * mi.Float(pixel % 2))
    uneven = 1.0 + 0.5 * (np.arange(PIXELS) % 2)
    for index in (0, 2):
        laser = sum(power * spot(index, place, width) for place, power, width in SPOTS)
        passed = sum(power * PASSED[round(place + 5.0 * index)] for place, power, _ in SPOTS)
        veil = 0.1 * (passed + background(index).sum()) / PIXELS
        wanted = 0.9 * (PASSED * uneven * laser + background(index)) + veil
        np.testing.assert_allclose(made.line(index), wanted, rtol=3e-5)


def test_without_the_laser_the_background_has_its_own_veil() -> None:
    """Claim: a tenth of the background goes evenly to all pixels, and nothing of the laser; what the laser adds to a
    line has none of the background. Without stray light it is the background, and nothing in the dark."""
    for stray in (0.0, 0.1):
        made, pixel = incident(stray), mi.UInt32(np.arange(PIXELS, dtype=np.uint32))
        for index in (0, 2):
            beneath = background(index)
            wanted = (1.0 - stray) * beneath + stray * beneath.sum() / PIXELS
            found = made.unlit(pixel, dr.full(mi.UInt32, index, PIXELS)).numpy()
            np.testing.assert_allclose(found, wanted, rtol=3e-5)
            laser = sum(power * spot(index, place, width) for place, power, width in SPOTS)
            passed = sum(power * PASSED[round(place + 5.0 * index)] for place, power, _ in SPOTS)
            added = (1.0 - stray) * PASSED * laser + stray * passed / PIXELS
            np.testing.assert_allclose(made.line(index, background=False), added, rtol=3e-5, atol=3e-9)
    dark = incident(0.1, lit=False)
    assert not dark.unlit(mi.UInt32([0, 3]), mi.UInt32([1, 1])).numpy().any()


@pytest.mark.parametrize("window", [4.0, 9.3, 13.8])
def test_the_link_budget_counts_a_window_about_the_spot(window: float) -> None:
    """Claim: the laser's light by the filter at each cluster's pixel; the background over 200 µm, four pixels, or more
    of finer ones, about the clusters' centroid, the outer ones in part; its error with both bands together; the
    brightest pixel."""
    made = incident()
    assert made.throughput.window == pytest.approx(4.0)
    made.throughput.window = window
    budget = made.link_budget()
    angle, gain = collected()
    for index in range(3):
        places = np.array([place + 5.0 * index for place, *_ in SPOTS])
        amounts = np.array([power for _, power, _ in SPOTS]) * PASSED[np.rint(places).astype(int)]
        assert float(budget.laser[index]) == pytest.approx(amounts.sum(), rel=1e-5)
        assert float(budget.field[index]) == pytest.approx(amounts.sum(), rel=1e-5)
        centre = places @ amounts / amounts.sum()
        pixel = np.arange(PIXELS)
        share = np.clip(
            np.minimum(pixel + 0.5, centre + 0.5 * window) - np.maximum(pixel - 0.5, centre - 0.5 * window),
            0.0,
            1.0,
        )
        assert share.sum() == pytest.approx(window)
        assert float(budget.background[index]) == pytest.approx(share @ background(index), rel=1e-4)
        near = int(np.rint(centre))
        inside, outside = (
            seen(layer, np.array(float(index)), THETA[index] - angle[near]) for layer in (0.03, 0.004)
        )
        wanted = (share * gain) @ IN_BAND * inside + (share * gain) @ OUT_OF_BAND * outside
        assert float(budget.background_error[index]) == pytest.approx(float(wanted), rel=1e-4)


def test_pairs_tell_the_larger_background_of_both() -> None:
    """Claim: of a pixel and the next, without the laser; beyond the line there is none, and none in the dark."""
    made = incident()
    pixel = np.arange(0, PIXELS, 3)
    for index in range(3):
        shot = dr.full(mi.UInt32, index, len(pixel))
        found = made.pair(mi.UInt32(pixel.astype(np.uint32)), shot)[2].numpy()
        wanted = np.append(background(index), 0.0)
        np.testing.assert_allclose(found, np.maximum(wanted[pixel], wanted[pixel + 1]), rtol=2e-5)
    assert not incident(lit=False).pair(mi.UInt32(4), mi.UInt32(1))[2].numpy().any()


@pytest.mark.parametrize("end", [-0.51, PIXELS - 0.49])
def test_without_a_spot_on_the_array_its_middle_counts(end: float) -> None:
    """Claim: clusters half a pixel and more beside the array have no light on it, but all that the filter passes at the
    pixel beside them in the field; the array's middle is between 19 and 20."""
    made = incident()
    beside = dr.full(mi.Float, end, 6)
    made.light.position = beside
    budget = made.link_budget()
    assert budget.laser.numpy().tolist() == [0.0] * 3
    passed = PASSED[0 if end < 0.0 else -1] * sum(power for _, power, _ in SPOTS)
    np.testing.assert_allclose(budget.field.numpy(), passed, rtol=1e-6)
    for index in range(3):
        assert float(budget.background[index]) == pytest.approx(background(index)[18:22].sum(), rel=1e-4)


FIELD = Field(side=8e-3, aside=3e-3, baseline=0.02)


def test_the_photodiode_sees_the_mean_of_its_field() -> None:
    """Claim: of a radiance that is a straight line across the field, that in its middle, ``aside`` before the beam."""
    made, view = incident(), Lattice()
    power = field_light(view, FIELD, made.shots, COLUMNS, (7.0, 11.0))  # type: ignore[arg-type]
    middle = THETA - 3e-3
    wanted = [
        7.0 * seen(1.0, np.array(float(row)), angle) + 11.0 * seen(0.1, np.array(float(row)), angle)
        for row, angle in enumerate(middle)
    ]
    np.testing.assert_allclose(power.numpy(), wanted, rtol=1e-5)
    assert field_light(None, FIELD, made.shots, COLUMNS, (7.0, 11.0)).numpy().tolist() == [0.0] * 3


def test_bins_of_the_photodiodes_panorama_cover_its_field(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: an eighth of the field, a pixel of the line at least; two bins more than the field at each end of the
    row; a lens at the field's own base."""
    monkeypatch.setattr(field_of_view, "known_panorama", lambda *given: given)
    rows = Rows((-0.1, 0.12), np.array([0.0, 0.01]), None, between=True)
    for side, step in ((8e-3, 1e-3), (2e-3, PITCH / F)):
        field = Field(side, 3e-3, 0.02)
        own: Any = None
        _, optics, _, view, *_ = field_of_view.field_panorama(own, layout(), field, own, rows, own, 0)
        assert optics.pitch == pytest.approx(step * F)
        assert optics.height == pytest.approx(side * F)
        assert optics.receiver.baseline == 0.02
        assert isinstance(view, PanoramaView)
        assert view.first == pytest.approx(-0.1 - 3e-3 - 0.5 * side - 2.0 * step)
        last = view.first + (view.bins - 1) * view.step
        assert 0.12 - 3e-3 + 0.5 * side + 2.0 * step <= last + 1e-12
        assert last < 0.12 - 3e-3 + 0.5 * side + 3.0 * step
        assert view.between


def test_echoes_come_in_batches_with_their_own_background() -> None:
    made = incident()
    light = mi.Float([5.0, 6.0, 7.0])
    found = list(batches_of_echoes(iter([made.light]), light, 2))
    assert [part.index.numpy().tolist() for part, _ in found] == [[0, 1], [2]]
    assert [own.numpy().tolist() for _, own in found] == [[5.0, 6.0], [7.0]]
    (whole,) = batches_of_echoes(iter([made.light]), light, 3)
    assert whole[0] is made.light


@pytest.mark.parametrize(("travel", "synchronisation"), [((0.0, 0.0), 0.0), ((6e-3, 0.0), 2e-4)])
def test_random_rays_of_the_reference_make_the_spot_of_eq_1(
    travel: tuple[float, float], synchronisation: float
) -> None:
    """Claim: power ρ/π A T P cosα/r² by the base, place f d/R and σ² of beam, point spread and pixel; a wall that faces
    the scanner leaves the place alone while the mirrors sweep; a receiver that looks
    on by δ has it f (1 + p²/f²) δ farther out.

    Set-up: 2¹⁴ rays to a wall at 6 m, whose waist is at 4 m. Tolerance: 4.5 standard errors of the rays; the wall's
    range over the sweep of 3 mrad, (θ²/2), and the aperture's extent are a thousandth of them.
    """
    rays = 1 << 14
    psf, height, pixels, R = 60e-6, 5e-3, 256, 6.0
    receiver = Receiver()
    bench = OpticalLayout(
        Laser(waist_radius=1e-3, waist_distance=4.0), receiver, D, 0.8, PITCH, height, 0.0, psf
    )
    wall = {
        "name": "wall",
        "shape": "rectangle",
        "size": (4.0, 4.0),
        "position": (0.0, 0.0, R),
        "material": {"reflectance": 0.5},
    }
    loaded = load_scene(Scene.model_validate({"objects": [wall]}))
    found = reference_line(
        loaded, bench, pixels, 0.0, 0.0, travel=travel, synchronisation=synchronisation, rays=rays, seed=3
    )
    away = math.hypot(R, BASE)
    area = math.pi / 4.0 * receiver.aperture**2
    power = bench.laser.power * 0.5 / math.pi * area * receiver.transmission * 0.8 / away**2 * (R / away) ** 2
    total = found.power.sum()
    # Rays differ by the extent of beam and aperture alone.
    assert total == pytest.approx(power, rel=2e-4)
    place = (np.arange(pixels) + 0.5) * PITCH
    mean = found.power @ place / total
    variance = found.power @ (place - mean) ** 2 / total
    image = 0.5 * float(beam_radius(R, 1e-3, 4.0, bench.laser.wavelength)) * F / R
    p = F * BASE / R + F * (1.0 + (BASE / R) ** 2) * synchronisation
    wanted = image**2 + psf**2 + PITCH**2 / 12.0
    # The sweep moves the wall's point along the beam by R θ²/2, and p by less than a hundredth of a pixel.
    assert mean == pytest.approx(p, abs=4.5 * math.sqrt(wanted / rays) + 2e-7)
    assert variance == pytest.approx(wanted, rel=4.5 * math.sqrt(2.0 / rays) + 2e-3)
    # A pixel that holds the share s of the rays knows it to √(s (1 − s)/n).
    share = found.power / power
    brightest = int(share.argmax())
    error = power * math.sqrt(share[brightest] * (1.0 - share[brightest]) / rays)
    assert found.standard_error[brightest] == pytest.approx(error, rel=1e-2)


@pytest.mark.parametrize(
    ("tilt", "focus"), [(0.0, "infinity"), (0.0, 0.9), ("scheimpflug", "infinity"), (0.3, 0.8)]
)
def test_a_pixel_collects_by_the_solid_angle_that_it_sees(tilt: Any, focus: Any) -> None:
    """Claim: of an even radiance a pixel gets the pupil's area, slanted by cosψ, times the solid angle that it sees
    through the lens's node, cos³ψ Δt h/v: tangents Δt between its ends, h/v of its height at its depth v.

    Tolerance: the second order of a pixel in its place, (p/s)² of some 1e-3, and single precision."""
    receiver = Receiver(array_tilt=tilt, focus_distance=focus)
    image = receiver.line_image
    slope = F / BASE if tilt == "scheimpflug" else math.tan(tilt)
    depth = F if focus == "infinity" else image.depth
    if tilt == 0.0 and focus != "infinity":
        assert depth == pytest.approx(1.0 / (1.0 / F - 1.0 / focus))
    place = OFFSET + np.arange(PIXELS + 1) * PITCH
    cosine = 1.0 / math.hypot(1.0, slope)
    behind = depth + place * slope * cosine
    tangent = place * cosine / behind
    middle = OFFSET + (np.arange(PIXELS) + 0.5) * PITCH
    psi = np.arctan(middle * cosine / (depth + middle * slope * cosine))
    solid = np.cos(psi) ** 3 * np.diff(tangent) * HEIGHT / (depth + middle * slope * cosine)
    gain = math.pi / 4.0 * receiver.aperture**2 * receiver.transmission * 0.8
    own = layout(array_tilt=tilt, focus_distance=focus)
    found = Throughput(own, PIXELS, PASSED, IN_BAND, OUT_OF_BAND)
    np.testing.assert_allclose(found.angle.numpy(), psi, rtol=1e-5)
    wanted = gain * np.cos(psi) * solid
    np.testing.assert_allclose(found.in_band.numpy(), wanted * IN_BAND, rtol=2e-4)
    np.testing.assert_allclose(found.out_of_band.numpy(), wanted * OUT_OF_BAND, rtol=2e-4)
    np.testing.assert_allclose(found.laser.numpy(), PASSED, rtol=1e-6)


@pytest.mark.parametrize(
    ("end", "lit"),
    [
        (-0.52, False),
        (-0.48, True),
        (0.3, True),
        (PIXELS - 1.3, True),
        (PIXELS - 0.52, True),
        (PIXELS - 0.48, False),
    ],
)
def test_the_link_budget_counts_what_lies_on_the_array(end: float, lit: bool) -> None:
    """Claim: a cluster counts with all of its light where its middle lies on a pixel, by the share that the filter
    passes there; half a pixel beyond the first and the last there is none."""
    made = incident(lit=False)
    made.light.position = mi.Float([end, end, end, 20.0, 20.0, 20.0])
    budget = made.link_budget().laser.numpy()
    power = np.array([power for _, power, _ in SPOTS])
    nearest = min(max(round(end), 0), PIXELS - 1)
    wanted = power[1] * PASSED[20] + (power[0] * PASSED[nearest] if lit else 0.0)
    np.testing.assert_allclose(budget, wanted, rtol=1e-5)


def test_between_rows_a_shot_looks_at_its_share_of_both() -> None:
    """Claim: the row of a shot is where its φ lies between those of the panorama, as a number with a fraction, and the
    first or the last beyond them; a raster's is its number over the columns."""
    view = PanoramaView(-0.03 + 0.004 * np.arange(5.0), 0.0, 1e-3, 8, between=True)
    phi = np.array([-0.05, -0.03, -0.0288, -0.0163, -0.014, 0.2])
    shots = Shots(
        mi.UInt32(np.array([0, 9, 10, 19, 20, 47], np.uint32)), *(mi.Float(phi.tolist()) for _ in range(4))
    )
    index = dr.arange(mi.UInt32, 6)
    wanted = np.interp(phi, view.phi, np.arange(5.0))
    np.testing.assert_allclose(view.row(shots, index, 10).numpy(), wanted, atol=1e-4)
    assert replace(view, between=False).row(shots, index, 10).numpy().tolist() == [0, 0, 1, 1, 2, 4]


def test_nothing_beyond_the_last_pixel_is_bright() -> None:
    """Claim: the brightest background of the last pixel and the next is the last one's, whatever stands behind it."""
    made, last = incident(), mi.UInt32(PIXELS - 1)
    seen = made.throughput
    for name, factor in (("laser", 1.0), ("angle", 1.0), ("in_band", 1e3), ("out_of_band", 1e3)):
        table = getattr(seen, name).numpy()
        setattr(seen, name, mi.Float(np.append(table, factor * table[-1])))
    for index in range(3):
        found = made.pair(last, mi.UInt32(index))[2].numpy()[0]
        assert found == pytest.approx(background(index)[-1], rel=2e-5)
