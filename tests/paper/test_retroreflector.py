"""The signal of a retro-reflecting sheet over range: beside the laser (triangulation) and around it (time of flight).

The first tests fix the judge; the last ones hold the simulator's light against it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from claims import mean

from scanner_sim import load_scenario, simulate
from scanner_sim.analytic.retroreflector import (
    Sheet,
    coaxial_power,
    entrance_share,
    gain,
    intensity,
    lobe_within,
    mean_entrance,
    offset_power,
)
from scanner_sim.config.scanner import Scanner
from scanner_sim.foundation.status import Status
from scanner_sim.scene.materials import MATERIALS
from scanner_sim.scene.objects import Scene

SCANNER = Scanner()
RANGES = (2.0, 5.0, 10.0, 20.0)
MATERIAL_NAMES = ("retro_sheet", "corner_cube_array")


def sheet(name: str) -> Sheet:
    """Return a material of the library in the judge's words."""
    entry = MATERIALS[name]
    lobe = entry.retro
    assert lobe is not None
    law, value = lobe.entrance
    beads = law == "entrance_half_angle"
    return Sheet(
        entry.reflectance,
        lobe.retro_share,
        lobe.half_width,
        half_angle=value if beads else None,
        refractive_index=1.0 if beads else value,
    )


@pytest.mark.parametrize("name", MATERIAL_NAMES)
def test_the_judge_keeps_energy(name: str) -> None:
    """Claim: the closed intensity, integrated over the hemisphere, is the reflectance.

    Set-up: light along the normal; ∫ I(δ) 2π sin δ dδ. Expected: ρ. Tolerance: 1e-6, the quadratures.
    """
    chosen = sheet(name)
    delta = np.geomspace(1e-8, np.pi / 2.0, 200_001)
    total = np.trapezoid(intensity(chosen, delta) * 2.0 * np.pi * np.sin(delta), delta)
    assert total == pytest.approx(chosen.reflectance, rel=1e-6)
    half = float(lobe_within(chosen, 2.0 * np.arctan(chosen.alpha)))
    assert half == pytest.approx(0.5, rel=1e-12)


def test_the_judge_knows_the_sheeting_of_the_standard() -> None:
    """Claim: the presets have the gains that white sheeting must have at least.

    Set-up: ASTM D4956, R_A at 0.2° and 0.5° and an entrance of −4°: 250 and 95 cd/lx/m² (type III, beads), 700 and 250
    (type VIII, prisms); at 30° entrance 150 (beads). Expected: π R_A, times E at 4° for the judge's entrance of 0.
    Tolerance: 5 %, the fit; 15 % for the entrance law.
    """
    for name, near, far in (("retro_sheet", 250.0, 95.0), ("corner_cube_array", 700.0, 250.0)):
        chosen = sheet(name)
        tilted = float(entrance_share(chosen, np.deg2rad(4.0)))
        measured = gain(chosen, np.deg2rad([0.2, 0.5])) * tilted
        assert measured == pytest.approx(np.pi * np.array([near, far]), rel=0.05)
        assert 300.0 * 0.95 < measured[1] < measured[0] < 2500.0
    assert entrance_share(sheet("retro_sheet"), np.deg2rad(30.0)) == pytest.approx(150.0 / 250.0, rel=0.15)


def test_corner_cube_closes_where_geometry_says() -> None:
    """Claim: a cube is dark from tan β' = 1/√2 on, 35.26° for a hollow one and 57.0° for n = 1.4529.

    Expected by hand: sin 35.264° = 1/√3, times n. Tolerance: 1e-9; half of a hollow cube's aperture is left at
    x = 0.4040 (the overlap of discs at 0.4040 diameters), β = 15.94°: 1e-3.
    """
    for index, closing in ((1.0, np.arcsin(np.sqrt(1.0 / 3.0))), (1.4529, np.arcsin(1.4529 / np.sqrt(3.0)))):
        cube = Sheet(1.0, 1.0, 0.01, refractive_index=index)
        assert float(entrance_share(cube, closing + 1e-9)) == pytest.approx(0.0, abs=1e-9)
        assert float(entrance_share(cube, closing - 0.02)) > 1e-4
    hollow = Sheet(1.0, 1.0, 0.01)
    assert float(entrance_share(hollow, np.deg2rad(15.94))) == pytest.approx(0.5, abs=1e-3)
    assert 0.0 < mean_entrance(hollow) < float(entrance_share(hollow, 0.0)) == 1.0


def bench(coaxial: bool) -> Any:
    """Return the preset's bench, or one whose lens is around the laser and whose line sees p = 0 at its middle."""
    from scanner_sim.render.transport import OpticalLayout

    sensor = SCANNER.position_sensor
    beside = OpticalLayout(
        SCANNER.laser,
        SCANNER.receiver,
        SCANNER.mirrors.axis_separation,
        1.0,
        sensor.pitch,
        1e-3,
        0.0,
        sensor.diffusion,
    )
    if not coaxial:
        return beside
    receiver = SCANNER.receiver.model_copy(update={"baseline": 1e-6})
    return replace(beside, receiver=receiver, offset=-0.5 * sensor.length)


def wall(material: Any, R: float, degrees: float = 0.0) -> Scene:
    return Scene.model_validate(
        {
            "objects": [
                {
                    "name": "wall",
                    "shape": "rectangle",
                    "size": (20.0, 20.0),
                    "position": (0.0, 0.0, R),
                    "rotation": {"axis": "y", "angle": float(np.deg2rad(degrees))},
                    "material": material,
                }
            ]
        }
    )


def line(
    material: Any, R: float, coaxial: bool, degrees: float = 0.0, beamlets: int = 256, travel: float = 0.0
) -> np.ndarray:
    """Return the power on every pixel [W] of the shot along the axis."""
    import mitsuba as mi

    from scanner_sim.render.beam.line_projection import LineProjection
    from scanner_sim.render.beam.splitter import render_light
    from scanner_sim.render.settings import Transport
    from scanner_sim.render.shots import Shots
    from scanner_sim.scene.files.loader import load_scene

    loaded = load_scene(wall(material, R, degrees))
    shot = Shots(mi.UInt32(0), mi.Float(0.0), mi.Float(0.0), mi.Float(travel))
    transport = Transport(uneven_beamlets=beamlets)
    _, (light,) = render_light(loaded, LineProjection(bench(coaxial)), transport, shot, seed=0)
    return np.asarray(light.line(0, SCANNER.position_sensor.pixels))


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize("coaxial", [False, True])
@pytest.mark.parametrize("name", MATERIAL_NAMES)
def test_signal_over_range(name: str, coaxial: bool) -> None:
    """Claim: a sheet's return follows the closed forms: strong around the laser, rising with range beside it.

    Set-up: sheets square to the beam at 2, 5, 10 and 20 m; 15 mW, lens of 25 mm around the laser or 0.2 m beside it.
    The pixels are 1 mm high, so that they see all of the spot. Expected: the judge's power; in triangulation it grows
    from 5 m to 20 m, while a white wall's falls by 16; around the laser the return beats a white wall at least
    600 times at every range. Tolerance: 1.5 %: the judge takes the beam, and beside the laser the lens too, as points
    (1 %), and its base is of the first order in the lobe's width; 256 beamlets add 0.1 %.
    """
    chosen, T = sheet(name), SCANNER.receiver.transmission
    ranges, P, aperture = np.array(RANGES), SCANNER.laser.power, SCANNER.receiver.aperture
    found = np.array([line(name, R, coaxial).sum() for R in RANGES])
    white = np.array([line({"reflectance": 1.0}, R, coaxial).sum() for R in RANGES])
    if coaxial:
        expected = coaxial_power(ranges, P, chosen, aperture, T)
        assert (found / white > 600.0).all()
    else:
        expected = offset_power(ranges, P, chosen, SCANNER.receiver.baseline, aperture, T)
        assert found[1] < found[2] < found[3]
        assert white[1] / white[3] == pytest.approx(16.0, rel=0.01)
        assert found[0] / white[0] < 1.0
    np.testing.assert_allclose(found, expected, rtol=0.015)


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize(("R", "degrees"), [(5.0, 0.0), (10.0, 0.0), (10.0, 35.0)])
def test_spot_against_brute_force(R: float, degrees: float) -> None:
    """Claim: the beamlets integrate the lobe over lens and beam as a million random rays do, tilted too.

    Set-up: the bead sheet, seen from 0.2 m, where the lobe is even enough for the seven beamlets of smooth ground.
    Expected: power and centroid of the brute force, sixteen times 65 536 rays. Tolerance: 1 % of the power, five
    standard errors of the rays being 0.4 %; 0.005 px beside the rays' chance.
    """
    from scanner_sim.render.background.reference import reference_line
    from scanner_sim.scene.files.loader import load_scene

    pixels = SCANNER.position_sensor.pixels
    loaded = load_scene(wall("retro_sheet", R, degrees))
    slow = np.array(
        [
            reference_line(loaded, bench(False), pixels, 0.0, 0.0, rays=1 << 16, seed=seed).power
            for seed in range(1, 17)
        ]
    )
    place = np.arange(pixels)
    centroids = slow @ place / slow.sum(axis=1)
    fast = line("retro_sheet", R, False, degrees)
    assert fast.sum() == pytest.approx(slow.sum(axis=1).mean(), rel=0.01)
    assert mean(centroids, fast @ place / fast.sum(), slack=0.005)


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize("name", ["evaporated_aluminium", "corner_cube_array"])
def test_narrow_lobes_move_swept_light_as_brute_force_says(name: str) -> None:
    """Claim: while a spot passes a point, a lobe returns more at one end of its moments than at the other, and the
    light of a swept spot lies where random rays with moments of their own put it.

    Set-up: 2 m, square to the beam, 9 mrad in a dwell; by the strength of the mean moment alone it is 0.009 and 0.007
    pixel off. Tolerance: what twelve times a million rays allow, 0.002 pixel, beside 0.001.
    """
    from scanner_sim.render.background.reference import reference_line
    from scanner_sim.scene.files.loader import load_scene

    place = np.arange(SCANNER.position_sensor.pixels)
    loaded, swept, rays = load_scene(wall(name, 2.0)), (9e-3, 0.0), 1 << 20
    slow = [
        reference_line(loaded, bench(False), len(place), 0.0, 0.0, travel=swept, rays=rays, seed=seed).power
        for seed in range(1, 13)
    ]
    fast = line(name, 2.0, False, travel=swept[0])
    assert mean([power @ place / power.sum() for power in slow], fast @ place / fast.sum(), slack=0.001)


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize("travel", [0.0, 1e-3, 9e-3])
@pytest.mark.parametrize("R", [2.0, 3.0, 6.0])
def test_a_lobe_moves_the_light_as_a_longer_range_would(R: float, travel: float) -> None:
    """Claim: the light of a sheet lies nearer to the lens than the beam's axis, where its lobe is seen at lesser
    angles; so the spot is that of a white wall farther away, at rest and while the mirrors turn.

    Expected: Stein's lemma, x = s² ∂ln I/∂x for a Gaussian of standard deviation s, and δR = x R/d. Along x the way to
    the lens turns by x/R and that of the light, whose wavefronts have the radius Rc = R + z_R²/R, by x/Rc: ∂δ/∂x =
    1/Rc − 1/R. Tolerance: 5 %. 256 beamlets of 0.125 s tell the slope of all but 1.6 % of the variance; at 2 m seven
    tell it, and the lobe bends over the lens.
    """
    laser, d, chosen = SCANNER.laser, SCANNER.receiver.baseline, sheet("retro_sheet")
    angles = np.arctan(d / R) + np.array([-1e-4, 1e-4])
    slope = np.diff(np.log(intensity(chosen, angles)))[0] / 2e-4
    s2 = 0.25 * laser.waist_radius**2 * (1.0 + (R / laser.rayleigh_length) ** 2)
    farther = s2 * slope * (1.0 / (R + laser.rayleigh_length**2 / R) - 1.0 / R) * R / d
    place = np.arange(SCANNER.position_sensor.pixels)

    def centroid(material: Any, R: float) -> float:
        power = line(material, R, False, travel=travel)
        return float(power @ place / power.sum())

    white = [centroid({"reflectance": 0.5}, away) for away in (R, R + 10.0 * farther)]
    found = (centroid("retro_sheet", R) - white[0]) / (0.1 * (white[1] - white[0]))
    assert found == pytest.approx(1.0, abs=0.05)


def statuses(material: Any, R: float, power: float = 15e-3, **processing: Any) -> set[int]:
    scenario = load_scenario(
        {
            "schema": 1,
            "scanner": {"laser": {"power": power}},
            "scene": wall(material, R).model_dump(),
            "scan": {"rows": 4, "columns": 4, "horizontal": (-0.01, 0.01), "vertical": (-0.01, 0.01)},
            "processing": processing,
        }
    )
    return {int(code) for code in np.unique(simulate(scenario, device="cpu")["status"])}


@pytest.mark.usefixtures("device")
def test_retro_reflectors_saturate_triangulation() -> None:
    """Claim: a retro-reflector that overfills the well is SATURATED, one that does not but is brighter than any surface
    may be is BAD_AMPLITUDE, and one that is allowed is measured; never a wrong range in silence.

    Set-up: full scans of 16 voxels. At 20 m both sheets fill the wells; at 10 m and 5 mW the bead sheet is 35 times
    white, over the default limit of 30, and under one of 3000; at 2 m it is below a white wall. Expected: these codes
    alone.
    """
    for name in MATERIAL_NAMES:
        assert statuses(name, 20.0) == {int(Status.SATURATED)}
        assert statuses(name, 20.0, validation={"max_reflectance": 3000.0}) == {int(Status.SATURATED)}
    assert statuses("retro_sheet", 10.0, 5e-3) == {int(Status.BAD_AMPLITUDE)}
    assert statuses("retro_sheet", 10.0, 5e-3, validation={"max_reflectance": 3000.0}) == {int(Status.VALID)}
    assert statuses("retro_sheet", 2.0) == {int(Status.VALID)}
