"""What the laws of a comparison predict of speckle: how much of a spot its place is fitted to."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from made_settings import Array, setting

from scanner_sim.validation.compare import speckle


@pytest.mark.parametrize(("sigma", "guard"), [(1.25, 5), (1.26, 6), (2.0, 8), (1.21, 5)])
def test_a_spot_in_speckle_is_fitted_to_four_standard_deviations(
    sigma: float, guard: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: to each side as many whole pixels as hold four standard deviations, about the place where it lies on its
    pixel; the scatter of the places [pixel] times that of a range per pixel is σ, and of several places of a pixel the
    mean of the squares counts."""
    told = setting()
    seen = [SimpleNamespace(sigma=sigma, phase=phase) for phase in (0.125, 0.375)]
    monkeypatch.setattr(speckle, "spots", lambda _, R: [(R, one) for one in seen])
    monkeypatch.setattr(speckle, "_seen", lambda *_: np.ones((2, 4, 9)))
    asked: list[tuple[float, float, int]] = []

    def fitted(lines: Array, centre: float, width: float, reach: int) -> Array:
        asked.append((centre, width, reach))
        return np.array([0.0, 3.0, 4.0, 5.0]) * (1.0 if len(asked) % 2 else 2.0)

    monkeypatch.setattr(speckle, "fitted_place", fitted)
    found = speckle._predict_limit(told)
    middle = speckle._LINE // 2
    assert asked[:2] == [(middle + 0.125, sigma, guard), (middle + 0.375, sigma, guard)]
    ranges = speckle._ranges(told)
    # Of 0, 3, 4, 5 the mean is 3 and the variance (9 + 0 + 1 + 4)/3.
    spread = math.sqrt(0.5 * (1.0 + 4.0) * 14.0 / 3.0)
    for R in ranges:
        assert found[f"{R:.4g} m"].value == pytest.approx(
            1e3 * told.closed.range_per_pixel(R) * spread, rel=1e-9
        )


@pytest.mark.parametrize("blur", [(0.0, 30e-6), (55e-6, 40e-6)])
def test_judged_lines_are_as_wide_as_image_lens_and_sensor_make_them(blur: tuple[float, float]) -> None:
    """Claim: the mean of lines has the variance of image, lens, sensor and pixel together, and its middle where the
    spot lies in a pixel; without a blur of the lens there is none.

    Eight surfaces in two polarisations leave the width of the mean sure to 1 %, of which four times are granted, and a
    tenth for the tails of diffraction, whose variance has no end; a lens that blurs where it shall not, or the other
    way round, is off by a third.
    """
    image, pitch = 60e-6, 50e-6
    lines = speckle._lines((1.5e-6, 5.0), blur, pitch, image, 8)
    mean = lines.mean(axis=1)
    at = np.arange(mean.shape[1])
    for line, phase in zip(mean, speckle.phases(), strict=True):
        middle = float(at @ line / line.sum())
        width = float((at - middle) ** 2 @ line / line.sum())
        wanted = (image**2 + blur[0] ** 2 + blur[1] ** 2) / pitch**2 + 1.0 / 12.0
        assert width == pytest.approx(wanted, rel=0.14)
        assert middle == pytest.approx(speckle._LINE // 2 + phase, abs=0.3)


@pytest.mark.parametrize(("ratio", "quick"), [(0.5, False), (50.0, True)])
def test_few_grains_take_all_surfaces_however_quick(ratio: float, quick: bool) -> None:
    told = replace(setting(), quick=True)
    found = speckle._surfaces(told, ratio)
    assert found == (told.shots(speckle._SURFACES) if quick else speckle._SURFACES)
    assert told.shots(speckle._SURFACES) < speckle._SURFACES


@pytest.mark.parametrize("R", [2.5, 9.0])
def test_judged_lines_are_of_the_image_on_the_array(R: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: on a tilted array, which stretches what is along it, image, grains and aberration are longer by that:
    ½ w(R)/R, λ/D and the aberration over its own scale, each times the array's; what is out of focus adds in squares,
    and what diffuses in the sensor is not stretched."""
    receiver = {"array_tilt": 0.5, "focus_distance": 4.0, "aberration": 9e-6, "aperture": 0.017}
    laser = {"m_squared": 1.7, "waist_radius": 1.3e-3}
    told = setting(scanner={"receiver": receiver, "laser": laser, "position_sensor": {"diffusion": 11e-6}})
    asked: list[tuple[object, ...]] = []
    monkeypatch.setattr(speckle, "_lines", lambda *given: asked.append(given))
    speckle._seen(told, R)
    ((lens, blur, pitch, image, _),) = asked
    array = told.closed.array
    along, across = (float(one) for one in array.scale(R))
    assert along / across > 1.02
    # M² times the Rayleigh spread of the waist.
    waist, wavelength = 1.3e-3, told.scenario.scanner.laser.wavelength
    spread = 1.7 * wavelength / (math.pi * waist)
    away = R - told.scenario.scanner.laser.waist_distance
    assert image == pytest.approx(0.5 * math.hypot(waist, spread * away) * along / R, rel=1e-9)
    assert lens == pytest.approx((wavelength, along / 0.017))
    assert blur == pytest.approx((math.hypot(9e-6 * along / across, array.blur(R).along), 11e-6))
    assert pitch == told.scenario.scanner.position_sensor.pitch
