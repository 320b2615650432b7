"""What laws of light, speckle and noise ask of the instrument, and what they make of errors that are known."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_settings import GREY, MIDDLE, RANGES, Array, setting

from scanner_sim.analytic.spot import pixel_shares
from scanner_sim.foundation.status import Status
from scanner_sim.render.device import Device
from scanner_sim.validation.compare import (
    light,
    noise,
    point_errors,
    shape,
    speckle,
    test_bench,
)
from scanner_sim.validation.compare.law import Measured


def test_sunlight_is_measured_on_a_wall_that_sun_and_scanner_face(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: background and its ratio of one shot straight ahead at each range; one reflection; a wall four times as
    wide as far, no noise."""
    told = setting()
    seen = []

    def measure(_: Any, made: Any, aim: Any) -> dict[str, Array]:
        (wall,) = made.scene.objects
        R = wall.position[2]
        seen.append(R)
        assert wall.size == pytest.approx((4.0 * R, 4.0 * R))
        assert wall.material.reflectance == GREY
        assert made.lighting.sun.direction == (0.0, 0.0, -1.0)
        assert made.transport.background_bounces == 1
        assert not any(value for _, value in made.scanner.position_sensor.noise)
        assert (aim.theta.tolist(), aim.phi.tolist()) == ([0.0], [0.0])
        return {"background": np.array([100.0 * R]), "snr": np.array([7.0 / R])}

    monkeypatch.setattr(test_bench, "measure", measure)
    sun, ratio = light._measure_sun(told), light._measure_ratio(told)
    assert seen == [*RANGES, *RANGES]
    assert sun == {f"{R:.4g} m": Measured("exact", 100.0 * R) for R in RANGES}
    assert ratio == {f"{R:.4g} m": Measured("exact", 7.0 / R) for R in RANGES}


def test_the_law_of_sunlight_needs_a_band_within_the_response_and_room_for_its_window() -> None:
    """Claim: half of the band to each side of its middle; twice 200 µm of pixels."""
    told = setting()
    band = told.closed.band
    assert band is not None
    for share in (0.999, 1.001):
        edges = (band.centre - 0.5 * share * band.width, band.centre + 0.5 * share * band.width)
        for response in ((edges[0], 1.7e-6), (0.9e-6, edges[1])):
            sensor = {"position_sensor": {"response": response}}
            narrow = dataclasses.replace(told, scenario=told.scenario.changed(scanner=sensor))
            assert ("response" in light._filtered(narrow)) == (share < 1.0)
    assert not light._filtered(told)
    none = dataclasses.replace(told, scenario=told.scenario.changed(scanner={"filter": "none"}))
    assert "no filter" in light._filtered(none)


# Speckle.


def test_speckle_errs_by_coherent_less_even_light(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of the same directions and seeds, with speckle and without: the difference of ranges in mm, the ratio of
    charges; as many surfaces as are asked for, each with a seed of its own; facing plates that hold the field."""
    told = setting()
    monkeypatch.setattr(speckle, "_separate", lambda *_: (0.02, 3, 5))
    asked = []

    def measure(_: Any, made: Any, aim: Any, seeds: Any) -> dict[str, Array]:
        coherent = made.scanner.laser.speckle
        asked.append((coherent, made.scene.objects[0].position[2], seeds))
        assert len(set(seeds)) == 5
        edge = np.array([-0.02, 0.0, 0.02])
        np.testing.assert_allclose(aim.theta, np.tile(edge, 3), atol=1e-15)
        np.testing.assert_allclose(aim.phi, np.repeat(edge, 3), atol=1e-15)
        size = made.scene.objects[0].size[0]
        R = made.scene.objects[0].position[2]
        assert size == pytest.approx(2.4 * 0.05 * R + 16.0 * made.scanner.laser.radius(R))
        shot = np.arange(9.0)
        return {
            "range_m": R + 5e-4 * shot + (1e-3 * shot**2 if coherent else 0.0),
            "Y": 10.0 + shot + (2.0 if coherent else 0.0) * (10.0 + shot),
        }

    monkeypatch.setattr(test_bench, "measure", measure)
    errors, charges = speckle._shots(told, 1, MIDDLE)
    shot = np.arange(9.0)
    for error, charge in zip(errors, charges, strict=True):
        np.testing.assert_allclose(error, shot**2, atol=1e-9)
        np.testing.assert_allclose(charge, 3.0)
    wheres = [where for where, _ in noise.spots(told, MIDDLE)]
    assert [one[1] for one in asked] == pytest.approx(np.repeat(wheres, 2))
    assert [one[0] for one in asked] == [True, False] * len(wheres)
    assert len({one[2] for one in asked}) == len(wheres)


def test_the_judges_lines_are_of_the_beams_image_through_the_lens(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the image's σ is f w/(2 R), N is f over the aperture, λ the laser's; aberration, diffusion and pitch are
    those of the scenario. As many lines as are asked for, or the most where speckle is hardly averaged."""
    told = setting()
    given: list[Any] = []
    monkeypatch.setattr(speckle, "_lines", lambda *args: given.append(args))
    scanner = told.scenario.scanner
    speckle._seen(told, 20.0)
    ((lens, blur, pitch, image, count),) = given
    along = float(told.closed.array.scale(20.0)[0])
    # The array is all but square to the axis: the focal length, and a little for the rays' slant.
    assert along == pytest.approx(scanner.receiver.focal_length, rel=1e-3)
    assert lens == pytest.approx((scanner.laser.wavelength, along / scanner.receiver.aperture))
    assert blur[0] == pytest.approx(scanner.receiver.aberration, rel=1e-3)
    assert (blur[1], pitch) == (scanner.position_sensor.diffusion, scanner.position_sensor.pitch)
    radius = scanner.laser.waist_radius * math.hypot(
        1.0,
        (20.0 - scanner.laser.waist_distance) * scanner.laser.wavelength * scanner.laser.m_squared
        / (math.pi * scanner.laser.waist_radius**2),
    )  # fmt: skip
    assert image == pytest.approx(0.5 * radius * along / 20.0)
    assert count in (16, speckle._SURFACES)


@pytest.mark.parametrize("peak", ["gaussian", "maximum_likelihood"])
def test_speckle_is_told_by_the_scatter_of_the_estimator_on_the_judges_lines(
    monkeypatch: pytest.MonkeyPatch, peak: Any
) -> None:
    """Claim: lines that are moved by ±0.02 pixel, and brighter by a tenth, scatter by that much of R² pitch/(f d), and
    by 10 % of their charge, whatever the estimator, also where its taps reach beyond the lines. Their kurtosis is 1."""
    told = setting(processing={"peak": peak, "bias_correction": "none"})
    length = speckle._LINE
    moved = np.tile([-0.02, 0.02], 30) * math.sqrt(59.0 / 60.0)
    grown = 1.0 + np.repeat([-0.1, 0.1], 30) * math.sqrt(59.0 / 60.0)

    def lines(_: Any, R: float) -> Array:
        shares = []
        for _, seen in noise.spots(told, R):
            places = length // 2 + seen.phase + moved
            shares.append(
                [g * pixel_shares(p, seen.sigma, length) for p, g in zip(places, grown, strict=True)]
            )
        return np.array(shares)

    monkeypatch.setattr(speckle, "_seen", lines)
    monkeypatch.setattr(speckle, "_ranges", lambda _: RANGES)
    limit, contrast = speckle._predict_limit(told), speckle._predict_contrast(told)
    scanner = told.scenario.scanner
    for R in RANGES:
        # Places lie about the middle of a pixel, which is not quite R.
        squares = [where**4 for where, _ in noise.spots(told, R)]
        per_pixel = math.sqrt(np.mean(squares)) * scanner.position_sensor.pitch
        per_pixel /= scanner.receiver.focal_length * scanner.receiver.baseline
        one, other = limit[f"{R:.4g} m"], contrast[f"{R:.4g} m"]
        assert one.value == pytest.approx(20.0 * per_pixel, rel=0.02)
        assert (one.unit, other.unit) == ("mm", "%")
        assert other.value == pytest.approx(10.0, rel=1e-6)
        # 4 % of the model, 1.5 c² for a contrast of a tenth, and three of a sample of normal numbers.
        wide = math.sqrt(59.0 / 60.0)
        slack = 0.04 + 1.5 * (0.1 * wide) ** 2 + 3.0 * math.sqrt(2.0 / 240.0)
        assert one.accuracy == pytest.approx(slack * one.value, rel=1e-3)


def test_speckles_measured_numbers_are_those_of_the_shots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: σ of ranges in mm and of relative charges in %, root mean square over places; each range is a step."""
    told = setting()
    steps = []
    sign = np.where(np.arange(16) % 2 == 0, 1.0, -1.0) * math.sqrt(15.0 / 16.0)

    def shots(_: Any, step: int, R: float) -> Any:
        steps.append(step)
        return [R * sign + 5.0, 3.0 * R * sign], [1.0 + 0.1 * sign, 1.0 + 0.3 * sign]

    monkeypatch.setattr(speckle, "_shots", shots)
    monkeypatch.setattr(speckle, "_ranges", lambda _: RANGES)
    limit = speckle._measure_limit(told)
    assert [limit[f"{R:.4g} m"].value for R in RANGES] == pytest.approx([R * math.sqrt(5.0) for R in RANGES])
    (slope,) = (value for case, value in limit.items() if not case.endswith(" m"))
    assert slope.value == pytest.approx(1.0)
    contrast = speckle._measure_contrast(told)
    assert [contrast[f"{R:.4g} m"].value for R in RANGES] == pytest.approx([10.0 * math.sqrt(5.0)] * 3)
    assert steps == [0, 1, 2] * 2


def test_the_judges_lines_have_the_light_of_one_surface(device: Device) -> None:
    """Claim: of 60 surfaces behind a small lens the mean charge is that of an even one, 1, to four standard errors of
    its contrast √½/√M, for all places in a pixel; diffusion spreads lines by its square, in pixels."""
    image, lens, pitch = 25e-6, (1.5e-6, 4.0), 50e-6
    sharp, spread = (speckle._lines(lens, (0.0, blur), pitch, image, 60) for blur in (0.0, 40e-6))
    assert sharp.shape == spread.shape == (4, 60, speckle._LINE)
    modes = (math.pi * image / (lens[0] * lens[1])) ** 2
    error = math.sqrt(0.5 / modes / 60.0)
    for lines in (sharp, spread):
        np.testing.assert_allclose(lines.sum(axis=2).mean(axis=1), 1.0, atol=4.0 * error)
    x = np.arange(speckle._LINE) - speckle._LINE // 2

    def width(lines: Array) -> Array:
        mean = lines.mean(axis=1)
        mean = mean / mean.sum(axis=1, keepdims=True)
        middle = mean @ x
        return mean @ x**2 - middle**2

    np.testing.assert_allclose(width(spread) - width(sharp), (40e-6 / pitch) ** 2, rtol=0.02)
    # Places of the spot in its pixel, each a quarter from the next.
    places = sharp.mean(axis=1) / sharp.mean(axis=1).sum(axis=1, keepdims=True) @ x
    np.testing.assert_allclose(np.diff(places), 0.25, atol=0.01)


def test_the_judges_lines_are_those_of_a_lens_out_of_focus() -> None:
    """Claim: a lens whose point image has the standard deviation a per axis, its phase a defocus, spreads lines by a².

    The rim of the pupil throws wings of 2λN/(π³x²) (the slope −4λN/π of its transfer function at 0, transformed), of
    which a wider beam's image has more, as far as it is computed: 4.5 σ. Bound: four standard errors of 60 surfaces, by
    the images' own scatter, and what of the wings depends on how many samples that are.
    """
    image, lens, pitch, blur = 12e-6, (1.5e-6, 4.0), 25e-6, 30e-6
    x = (np.arange(speckle._LINE) - speckle._LINE // 2) * pitch
    found = [moment(speckle._lines(lens, (a, 0.0), pitch, image, 60)[2], x) for a in (0.0, blur)]
    (sharp, least), (spread, most) = found
    wings = 4.0 * lens[0] * lens[1] / math.pi**3 * 4.5 * (math.hypot(image, blur) - image)
    bound = 4.0 * math.hypot(least, most) + 0.2 * wings
    assert abs(spread - sharp - blur**2 - wings) < bound < 0.12 * blur**2


def moment(lines: Array, x: Array) -> tuple[float, float]:
    """Return the variance of the mean of lines (n, pixels) about its own middle, and its standard error."""
    whole = lines.mean(axis=0).sum()
    away = (x - lines.mean(axis=0) @ x / whole) ** 2
    variance = lines.mean(axis=0) @ away / whole
    return float(variance), float(np.std(lines @ (away - variance) / whole, ddof=1) / math.sqrt(len(lines)))


def test_light_and_width_are_granted_the_lenss_extent() -> None:
    """Claim: the square of the lens over the range of the point, which moves light by itself and a width by twice that,
    and single precision; the range is that of the beam to the wall."""
    told = setting()
    aperture = told.scenario.scanner.receiver.aperture
    width, charge = shape._predict_width(told), shape._predict_charge(told)
    positions = list(shape.field_positions(told, shape.wall_ranges(told)))
    assert len(positions) > 3
    for position in positions:
        extent = (aperture / position.distance) ** 2
        for found, factor in ((width, 2.0), (charge, 1.0)):
            one = found[position.name]
            assert one.accuracy == pytest.approx((factor * extent + shape._PRECISION) * one.value, rel=1e-9)
    lines = [np.eye(60)[20] * 3.0 + np.eye(60)[21]]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shape, "_wall_lines", lambda _: zip(positions[:1], lines, strict=True))
        (found,) = shape._measure_position(told).values()
        sensor = told.scenario.scanner.position_sensor
        # Three quarters on pixel 20 and a quarter on 21: 20.25, whose middle is half a pixel further.
        assert found.value == pytest.approx(1e3 * (sensor.offset + 20.75 * sensor.pitch))
    assert shape._width(np.array([1.0, 0.0, 1.0])) == pytest.approx(math.sqrt(1.0 - 1.0 / 12.0))


@pytest.mark.parametrize("blur", [5e-6, 10e-6, 60e-6])
def test_a_narrow_spot_is_as_wide_as_its_pixels_make_it(blur: float) -> None:
    """Claim: the width foretold is that of the spot's light on pixels, wherever it stands among them, less a pixel's
    own; of a wide spot that is the spot's, of a narrow one more than a tenth off."""
    told = setting(scanner={"receiver": {"aberration": blur}, "position_sensor": {"diffusion": blur}})
    place, ratios, foretold = np.arange(256), [], shape._predict_width(told)
    for position in shape.field_positions(told, shape.wall_ranges(told)):
        spot = shape._on_wall(told, position)
        shares = pixel_shares(spot.centre, spot.sigma, 256)
        variance = shares @ (place - shares @ place) ** 2 - 1.0 / 12.0
        found = foretold[position.name].value
        assert found == pytest.approx(math.sqrt(variance), rel=2e-4)
        ratios.append(found / spot.sigma)
    assert len(ratios) > 5
    assert bool(np.abs(np.log(ratios)).max() > 0.1) is (blur < 20e-6)


def test_noise_is_measured_straight_ahead_at_even_places_in_a_pixel(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: σ in mm, root mean square over four places, with the named noise alone; R² of it has the exponent 2."""
    told = setting()
    monkeypatch.setattr(noise, "_usable", lambda *_: RANGES)
    asked = []

    def errors(_: Any, made: Any, aim: Any) -> Array:
        (plate,) = made.scene.objects
        asked.append(plate.position[2])
        assert {name for name, value in made.scanner.position_sensor.noise if value} == {"shot", "read"}
        assert not aim.theta.any()
        assert not aim.phi.any()
        assert aim.theta.size == 16
        assert plate.material.reflectance == GREY
        # A plate that holds the beam eight radii to each side.
        assert plate.size[0] > 16.0 * made.scanner.laser.radius(plate.position[2])
        sign = np.where(np.arange(16) % 2 == 0, 1.0, -1.0) * math.sqrt(15.0 / 16.0)
        R = min(RANGES, key=lambda one: abs(math.log(one / plate.position[2])))
        return 1e-3 * R**2 * (1.0 + 2.0 * ((len(asked) - 1) % 4 == 0)) * sign + 0.5

    monkeypatch.setattr(test_bench, "range_errors", errors)
    found = noise._measure_sigma(
        told, number=3, noise=("shot", "read"), variance=lambda *_: 0.0, peak=None, slope=True  # type: ignore[arg-type, return-value]
    )  # fmt: skip
    # Three times as much at one of four places: √((9 + 3)/4).
    assert [found[f"{R:.4g} m"].value for R in RANGES] == pytest.approx(
        [math.sqrt(3.0) * R**2 for R in RANGES]
    )
    assert found[noise.SLOPE].value == pytest.approx(2.0)
    assert asked == pytest.approx([where for R in RANGES for where, _ in noise.spots(told, R)])


def test_points_err_by_what_is_measured_less_what_is_true(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: errors of x, y, z and R are the measured ones less those of the true range and angles, by eq 3; all shots
    go one way, five times of the wobble apart."""
    told = setting()
    position = next(one for one in shape.field_positions(told, (MIDDLE,)) if one.theta * one.phi != 0.0)
    off = 1e-3 * np.arange(1.0, 65.0).reshape(16, 4)
    true = MIDDLE + 0.1 * np.arange(16.0)
    separation = told.scenario.scanner.mirrors.axis_separation
    seen: list[Any] = []

    def measure(_: Any, made: Any, aim: Any) -> dict[str, Array]:
        seen.append(aim)
        arm = true * np.cos(aim.theta) - separation
        across, down, far = true * np.sin(aim.theta), arm * np.sin(aim.phi), arm * np.cos(aim.phi)
        return {
            "truth.range_m": true, "truth.theta_rad": aim.theta, "truth.phi_rad": aim.phi,
            "P.X": across + off[:, 0], "P.Y": down + off[:, 1], "P.Z": separation + far + off[:, 2],
            "range_m": true + off[:, 3],
        }  # fmt: skip

    monkeypatch.setattr(test_bench, "measure", measure)
    found = point_errors._errors_at(told, told.scenario, position, 16)
    np.testing.assert_allclose(found, off, atol=1e-12)
    (aim,) = seen
    assert (aim.theta == position.theta).all()
    assert (aim.phi == position.phi).all()
    np.testing.assert_allclose(np.diff(aim.time), 5.0 * told.scenario.scanner.mirrors.wobble_time)


def test_a_well_is_filled_by_a_laser_as_strong_as_it_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: with the power that fills the brightest pixel by the closed form to each share of the well: the largest
    charge of all pixels, and the share of voxels that say so; on the axis, without any noise but the well's end."""
    told = setting()
    peak = float(told.closed.facing(MIDDLE, GREY).line.max())
    asked: list[Any] = []

    def on_bench(of: Any, target: Any, *, seed: int, noise: Any) -> Any:
        asked.append((target, seed, noise))
        return SimpleNamespace(
            changed=lambda scanner: SimpleNamespace(scanner=told.scenario.scanner, **scanner)
        )

    def lines(of: Any, made: Any, aim: Any) -> Any:
        assert (aim.theta.tolist(), aim.phi.tolist()) == ([0.0], [0.0])
        return np.array([[1.0, made.laser["power"], 2.0]])

    monkeypatch.setattr(light.test_bench, "plate", lambda *given, **more: (given, more))
    monkeypatch.setattr(light.test_bench, "on_test_bench", on_bench)
    monkeypatch.setattr(light.test_bench, "lines", lines)
    flags = np.array([Status.SATURATED, Status.VALID, Status.SATURATED, Status.VALID, Status.SATURATED])
    monkeypatch.setattr(light.test_bench, "measure", lambda of, made, aim: {"status": flags})
    found = light._measure_saturation(told)
    assert list(found) == list(light._predict_saturation(told))
    well = light._well(told)
    for strength in light._STRENGTHS:
        case = f"{strength:g} times the full well"
        power = told.scenario.scanner.laser.power * strength * well / peak
        assert found[f"charge at {case}"].value == pytest.approx(max(power, 2.0))
        assert found[f"flag at {case}"].value == pytest.approx(0.6)
    assert {one[2] for one in asked} == {("saturation",)}
    assert {one[0][0] for one in asked} == {(MIDDLE, GREY)}
    assert all(one[0][1] == {"size": 0.5 * MIDDLE} for one in asked)
