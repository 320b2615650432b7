"""Where a scenario begins to be doubted or refused: just before the limit it is not, just behind it is."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from scanner_sim import load_scenario
from scanner_sim.analytic.beam import beam_radius
from scanner_sim.config import scanner as config_scanner
from scanner_sim.config import scenario_warnings
from scanner_sim.config.scanner import Scanner, speckle_optics
from scanner_sim.foundation.errors import ScenarioError

SCAN = {"rows": 8, "columns": 8, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1), "motion": "stepped"}
PITCH = 50e-6
NEAR, FAR = 0.1 * 0.2 / 12.8e-3, 0.1 * 0.2 / 12.8e-3 * 256
"""Range that the last of 256 pixels sees, and that at which a spot is half a pixel from p = 0."""


def doubts(*, distance: float = 5.0, scan: Any = None, motion: Any = None, **parts: Any) -> str:
    """Return the warnings of a sphere ahead of a triangulating scanner."""
    ball = {
        "name": "ball",
        "shape": "sphere",
        "diameter": 0.1,
        "material": "z93_white",
        "position": (0.0, 0.0, distance),
    }
    if motion is not None:
        ball["motion"] = motion
    given = {"schema": 1, "scan": SCAN if scan is None else scan, "scene": {"objects": [ball]}, **parts}
    return "\n".join(scenario_warnings(load_scenario(given)))


def radius(distance: float, waist: float = 2e-3) -> float:
    """Return the 1/e² radius of a beam, by the judge."""
    return float(beam_radius(distance, waist, 0.0, 1.5e-6))


def blurred(pixels: float, distance: float, waist: float = 2e-3) -> dict[str, Any]:
    """Return a scanner whose spot at a range has a standard deviation in pixels, by beam and diffusion alone."""
    image = 0.5 * radius(distance, waist) * 0.1 / distance
    diffusion = math.sqrt((pixels * PITCH) ** 2 - image**2)
    sensor = {"diffusion": diffusion}
    return {"laser": {"waist_radius": waist}, "receiver": {"aberration": 0.0}, "position_sensor": sensor}


@pytest.mark.parametrize(("threshold", "doubted"), [(2.95, True), (3.05, False)])
def test_noise_is_taken_for_returns_below_three_sigma(threshold: float, doubted: bool) -> None:
    assert ("noise alone" in doubts(processing={"threshold": threshold})) is doubted


@pytest.mark.parametrize(("pixels", "doubted"), [(0.34, True), (0.36, False)])
def test_a_spot_is_too_narrow_below_a_third_of_a_pixel(pixels: float, doubted: bool) -> None:
    """Claim: at 400 m, where the image of the spot is smallest, 0.35 pixel is the limit."""
    assert ("narrower than a pixel" in doubts(scanner=blurred(pixels, FAR))) is doubted


@pytest.mark.parametrize(("pixels", "doubted"), [(1.28, False), (1.32, True)])
def test_a_centre_of_mass_cuts_a_wide_spot(pixels: float, doubted: bool) -> None:
    """Claim: at 1.56 m, where the image of the spot is largest, 1.3 pixels are the limit."""
    found = doubts(scanner=blurred(pixels, NEAR, 1e-3), processing={"peak": "centre_of_mass"})
    assert ("cuts the spot" in found) is doubted


@pytest.mark.parametrize(("radii", "doubted"), [(0.29, False), (0.31, True)])
def test_motion_blurs_from_three_tenths_of_the_beam(radii: float, doubted: bool) -> None:
    """Claim: at 5 m, across, in a dwell of 50 µs."""
    twist = {"type": "twist", "velocity": (radii * radius(5.0) / 50e-6, 0.0, 0.0)}
    assert ("during a dwell" in doubts(motion=twist)) is doubted


@pytest.mark.parametrize(("diameters", "doubted"), [(7.9, False), (8.1, True)])
@pytest.mark.parametrize("off", [0.0, 0.5])
def test_a_sweep_is_long_from_eight_spots(diameters: float, doubted: bool, off: float) -> None:
    """Claim: at 5 m, by the angle from one of 21 columns to the next while the laser shines."""
    step = diameters * 2.0 * radius(5.0) / 5.0 / (1.0 - off)
    wide = {**SCAN, "columns": 21, "horizontal": (-10.0 * step, 10.0 * step), "motion": "continuous"}
    assert ("diameters while" in doubts(scan=wide, scanner={"laser_off": off})) is doubted


@pytest.mark.parametrize(("distance", "doubted"), [(0.45, True), (0.55, False), (34.0, False), (36.0, True)])
def test_echoes_from_outside_of_the_record_are_doubted(distance: float, doubted: bool) -> None:
    """Claim: the record reaches from 0.5 m to 35 m."""
    assert ("outside of what" in doubts(distance=distance, ranging="tof")) is doubted


@pytest.mark.parametrize(
    ("distance", "gate", "apparent"),
    [
        (155.0, (1.0, 100.0), "5.104"),
        (305.0, (1.0, 100.0), "5.208"),
        (50.0, (190.0, 210.0), "199.9"),
        (120.0, (1.0, 100.0), ""),
        (130.0, (1.0, 100.0), ""),
        (155.0, (140.0, 160.0), None),
        (200.0, (190.0, 210.0), None),
    ],
)
def test_echoes_of_other_pulses_are_doubted(
    distance: float, gate: tuple[float, float], apparent: str | None
) -> None:
    """Claim: pulses of 1 MHz repeat every c/2 MHz = 149.896 m; what lies so far from a place in the gate, and not in
    the gate itself, is told with that place."""
    lidar = {"pulse": {"repetition_rate": 1e6}, "digitiser": {"gate": gate}}
    found = doubts(distance=distance, ranging="tof", scanner={"lidar": lidar})
    assert ("outside of what" in found) is (apparent is not None)
    place = f"those of a surface at {apparent} m, as the pulses repeat every 149.9 m"
    assert (place in found) is bool(apparent)
    assert ("as the pulses repeat" in found) is bool(apparent)


@pytest.mark.parametrize(
    ("gate", "by_record", "by_array"),
    [
        ((1.6, 34.9), False, False),
        ((1.6, 35.1), True, False),
        ((1.5, 34.9), False, True),
        ((0.49, 34.9), True, True),
    ],
)
@pytest.mark.parametrize("ranging", ["triangulation", "tof", "both"])
def test_gates_beyond_what_a_rangefinder_sees_are_doubted(
    gate: tuple[float, float], by_record: bool, by_array: bool, ranging: str
) -> None:
    """Claim: the record reaches from 0.5 m to 35 m, the array sees from 1.5625 m on; each is asked where it ranges."""
    found = doubts(ranging=ranging, processing={"range_gate": gate})
    assert ("beyond the ranges that scanner.lidar.digitiser.gate records, 0.5 m to 35 m" in found) is (
        by_record and ranging != "triangulation"
    )
    assert ("beyond the ranges that the array sees, 1.56" in found) is (by_array and ranging != "tof")


@pytest.mark.parametrize(("pixels", "refused"), [(1990, False), (2010, True)])
def test_an_array_may_not_see_nearer_than_the_base(pixels: int, refused: bool) -> None:
    """Claim: f d/p = d where p = f, at 2000 pixels of 50 µm behind 100 mm."""
    given: dict[str, Any] = {"schema": 1, "scan": SCAN, "scanner": {"position_sensor": {"pixels": pixels}}}
    if refused:
        with pytest.raises(ScenarioError, match="nearer than the base"):
            load_scenario(given)
    else:
        load_scenario(given)


def test_numbers_of_a_scanner_follow_from_its_parts() -> None:
    """Claim: 3 and 4 µm blur by 5; 256 pixels of 50 µm from 2 mm on see f d/14.8 mm to f d/2 mm; 1.5 µm · f/4 is 6 µm;
    a laser that is off for a fifth of 50 µs shines for 40."""
    scanner = Scanner.model_validate(
        {
            "receiver": {"aberration": 3e-6},
            "position_sensor": {"diffusion": 4e-6, "offset": 2e-3},
            "laser_off": 0.2,
        }
    )
    assert scanner.point_spread == pytest.approx(5e-6)
    assert scanner.nearest_range == pytest.approx(0.02 / 14.8e-3)
    assert scanner.farthest_range == pytest.approx(10.0)
    assert scanner.exposure == pytest.approx(40e-6)
    assert speckle_optics(scanner).cell * PITCH == pytest.approx(6e-6)


def test_speckle_is_asked_for_over_the_images_of_the_beam(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: evenly along the line from its near end, where p sees d f/p: half the radius there, as the lens
    makes it smaller by f/R."""
    scanner = Scanner.model_validate({"position_sensor": {"diffusion": 4e-6, "offset": 2e-3}})
    found: list[Any] = []
    monkeypatch.setattr(config_scanner.Optics, "of", lambda *given: found.extend(given))
    speckle_optics(scanner)
    cell, aberration, diffusion, pitch, images = found
    f, d = scanner.receiver.focal_length, scanner.receiver.baseline
    assert (cell, pitch) == pytest.approx((1.5e-6 * f / scanner.receiver.aperture, PITCH))
    assert (aberration, diffusion) == (scanner.receiver.aberration, 4e-6)
    sizes = [size for size, _ in images]
    length = scanner.position_sensor.length
    ranges = [f * d / (2e-3 + length * (n + 1) / len(sizes)) for n in range(len(sizes))]
    assert sizes == pytest.approx([0.5 * scanner.laser.radius(R) * f / R for R in ranges])
    assert len(sizes) == 8


def test_a_fault_in_what_an_override_made_names_the_override() -> None:
    """Claim: all within the outermost key that was made is the override's doing, so also what is missing there."""
    ball = {"name": "ball", "shape": "sphere", "diameter": 0.1, "position": (0.0, 0.0, 5.0)}
    with pytest.raises(ScenarioError) as caught:
        load_scenario(
            {"schema": 1, "scan": SCAN, "scene": {"objects": [ball]}},
            ["scene.objects.ball.material.retro.half_width=1 deg"],
        )
    (missing,) = (fault.location for fault in caught.value.faults if "material.reflectance" in fault.location)
    assert missing.endswith("set by 'scene.objects.ball.material.retro.half_width=1 deg'")


@pytest.mark.parametrize(
    ("receiver", "told"),
    [
        ({"aperture": 3e-3, "array_tilt": 0.0, "focus_distance": 0.45}, "from 0.353 m to 0.417 m"),
        ({"aperture": 15e-3, "array_tilt": 0.0, "focus_distance": 0.45}, ""),
        ({"aperture": 3e-3}, ""),
        ({"aperture": 12e-3, "aberration": 6e-6}, "from 0.395 m to 0.409 m"),
    ],
)
def test_few_packets_under_a_wide_blur_are_told(
    receiver: dict[str, object], told: str, repo_root: Path
) -> None:
    """Claim: told where the beam's image is below 1.5 λf/A and the lens blurs it by more than that.

    The image of the waist, 51 µm/2 · 60 mm/0.4 m, is 3.8 µm. λf/A of f/4 is 2.5 µm, and 1.5 of it less than the image;
    that of f/5, 3.2 µm, and of f/20, 13 µm, are more. A blur is an upright array's that is focused at 0.45 m, or an
    aberration of 6 µm; the shipped array is Scheimpflug's, and 3 µm.
    """
    close = load_scenario(repo_root / "configs" / "relief.yaml").changed(scanner={"receiver": receiver})
    found = [words for words in scenario_warnings(close) if "speckle" in words]
    assert [told in words for words in found] == [True] * bool(told)
