"""What is warned of in optics: spots too wide, few grains of speckle, mirrors that are too bright for a limit."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest

from scanner_sim import load_scenario
from scanner_sim.analytic.beam import beam_radius
from scanner_sim.config import scenario_warnings

SCAN = {"rows": 8, "columns": 8, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1), "motion": "stepped"}
NEAR = 0.1 * 0.2 / 12.8e-3
"""Range that the last of 256 pixels of 50 µm sees, 0.1 m behind a lens 0.2 m beside the laser."""


def doubts(words: str, *, material: Any = "z93_white", **parts: Any) -> list[str]:
    """Return the warnings with some words of a sphere ahead of a triangulating scanner."""
    ball = {
        "name": "ball",
        "shape": "sphere",
        "diameter": 0.1,
        "material": material,
        "position": (0.0, 0.0, 5.0),
    }
    made = load_scenario({"schema": 1, "scan": SCAN, "scene": {"objects": [ball]}, **parts})
    return [sentence for sentence in scenario_warnings(made) if words in sentence]


def image(distance: float, waist: float) -> float:
    """Return the standard deviation of the beam's image [m], by the judge."""
    return 0.5 * float(beam_radius(distance, waist, 0.0, 1.5e-6)) * 0.1 / distance


@pytest.mark.parametrize(
    ("aberration", "diffusion"), [(9.6, 0.5), (0.5, 9.6), (7.0, 6.5), (7.7, 0.5), (5.0, 5.9)]
)
def test_a_spot_of_more_than_eight_pixels_is_seen_by_its_core(aberration: float, diffusion: float) -> None:
    """Claim: image of the beam, lens and sensor blur it in squares, the widest where the beam's image is: at the near
    end; the sum is told with two digits, and beyond 8 pixels alone."""
    waist = 1e-3
    scanner = {
        "laser": {"waist_radius": waist},
        "receiver": {"aberration": aberration * 50e-6},
        "position_sensor": {"diffusion": diffusion * 50e-6},
    }
    whole = math.sqrt((image(NEAR, waist) / 50e-6) ** 2 + aberration**2 + diffusion**2)
    found = doubts("see its core only", scanner=scanner)
    assert bool(found) is (whole > 8.0)
    if found:
        assert f"at {NEAR:.3g} m the spot is {whole:.2g} pixel wide" in found[0]


@pytest.mark.parametrize("aberration", [25e-6, 1e-6])
def test_few_grains_that_are_blurred_are_told_with_their_ranges(aberration: float) -> None:
    """Claim: a lens of f/D has grains λ f/D; where the beam's image is below 1.5 of them, and the lens blurs it by more
    than its width, σ is not good: of 65 ranges from the nearest to 100 times that, in even steps of logarithms, the
    first and the last such are told. A sharp lens has none."""
    receiver = {"aberration": aberration, "aperture": 0.02}
    scanner = {"laser": {"waist_radius": 4e-3}, "receiver": receiver}
    grain = 1.5e-6 * 0.1 / 0.02
    ranges = NEAR * 100.0 ** (np.arange(65) / 64.0)
    few = [R for R in ranges if image(R, 4e-3) < 1.5 * grain]
    assert 3 < len(few) < 60
    found = doubts("few grains", scanner=scanner)
    assert bool(found) is (aberration > 1e-5)
    if found:
        ends = re.search(r"from (\S+) m to (\S+) m", found[0])
        assert ends is not None
        assert ends.groups() == (f"{few[0]:.3g}", f"{few[-1]:.3g}")
    assert not doubts("few grains", scanner=scanner | {"laser": {"waist_radius": 4e-3, "speckle": False}})


@pytest.mark.parametrize(("share", "doubted"), [(0.98, True), (1.02, False)])
def test_a_mirror_that_is_brighter_than_the_limit_is_told(share: float, doubted: bool) -> None:
    """Claim: a share s of ρ in a lobe whose gain falls to half at δ: over a white, s ρ/(4 α²) of the microfacets'
    distribution (1 + tan²/α²)⁻² / (π α²), which is at half of its peak where δ is twice the angle of a facet's normal.
    """
    grey, lobe, half = 0.6, 0.35, math.radians(0.8)
    alpha = math.tan(0.5 * half) / math.sqrt(math.sqrt(2.0) - 1.0)
    peak = grey * lobe / (4.0 * alpha**2)
    tape = {"type": "retroreflector", "reflectance": grey, "retro_share": lobe, "half_width": half}
    found = doubts(
        "retro-reflector", material=tape, processing={"validation": {"max_reflectance": share * peak}}
    )
    assert bool(found) is doubted
    if found:
        told = re.search(r"up to (\S+) times white", found[0])
        assert told is not None
        assert float(told.group(1)) == pytest.approx(peak, rel=6e-3)


def test_a_tilted_array_stretches_the_spot_on_it() -> None:
    """Claim: on an array that is turned by 30° the image and what lens and focus blur are longer along the line, by a
    third and a quarter at the near end, and what diffuses in the sensor is not; two digits are told."""
    tilt = {"array_tilt": math.radians(30.0), "focus_distance": "infinity"}
    for wanted in (8.52, 9.03, 9.52):

        def scanner(aberration: float) -> dict[str, Any]:
            line = {"diffusion": 2.0 * 50e-6}
            receiver = {"aberration": aberration * 50e-6, **tilt}
            return {"laser": {"waist_radius": 1e-3}, "receiver": receiver, "position_sensor": line}

        made = load_scenario({"schema": 1, "scan": SCAN, "scanner": scanner(1.0)}).scanner
        widest = max((made.nearest_range, 256.0 * made.nearest_range), key=lambda R: spread(made, R, 1.0))
        rest = spread(made, widest, 0.0)
        skewed = float(made.seen_at(widest).skewed)
        aberration = math.sqrt((wanted**2 - rest) / skewed**2)
        (found,) = doubts("see its core only", scanner=scanner(aberration))
        assert f"at {widest:.3g} m the spot is {wanted:.2g} pixel wide" in found


def spread(scanner: Any, distance: float, aberration: float) -> float:
    """Return the variance of a spot [pixel²] on a tilted array."""
    seen, own = scanner.seen_at(distance), image(distance, 1e-3) / 50e-6
    stretched = (aberration**2 + float(seen.defocus) ** 2) * float(seen.skewed) ** 2
    return (float(seen.along) * own) ** 2 + stretched + 2.0**2


@pytest.mark.parametrize(
    ("aperture", "focus", "key"),
    [
        (0.01, math.inf, "laser.waist_radius"),
        (0.03, math.inf, "receiver.focus_distance"),
        (0.008, 1.0, "laser.waist_radius"),
        (0.03, 1.0, "receiver.focus_distance"),
    ],
)
def test_a_spot_that_is_too_wide_names_what_makes_it_so(aperture: float, focus: float, key: str) -> None:
    """Claim: the focus, where it alone makes more than half of the width, and the beam's waist else, at the end of the
    ranges where the spot is the widest: whether that lies before the range in focus or behind it.

    A pupil of the diameter D focused on F, with an array at v = f F/(F − f), spreads a point at R over v D |1/R − 1/F|,
    a disc whose standard deviation is a quarter of that. Focused on infinity these are 3.2 of 9.8 pixels for 1 cm and
    9.6 of 13 for 3 cm at the near end, on 1 m 4.4 of 10 for 8 mm and 17 of 19 for 3 cm at the far end.
    """
    aberration, behind = 9.0, 0.1 / (1.0 - 0.1 / focus)
    near = NEAR * behind / 0.1

    def widths(distance: float) -> tuple[float, float]:
        """Return the whole width at a range, and what the focus makes of it [pixel]."""
        defocus = 0.25 * aperture * behind * abs(1.0 / distance - 1.0 / focus) / 50e-6
        own = image(distance, 1e-3) * behind / 0.1 / 50e-6
        return math.sqrt(own**2 + defocus**2 + aberration**2 + 2.0**2), defocus

    whole, defocus, widest = max((*widths(distance), distance) for distance in (near, 256.0 * near))
    assert (widest == near) is math.isinf(focus)
    assert (defocus > 0.5 * whole) is (key == "receiver.focus_distance")
    receiver = {
        "aperture": aperture,
        "aberration": aberration * 50e-6,
        "array_tilt": 0.0,
        "focus_distance": "infinity" if math.isinf(focus) else focus,
    }
    scanner = {"laser": {"waist_radius": 1e-3}, "receiver": receiver, "position_sensor": {"diffusion": 1e-4}}
    (found,) = doubts("see its core only", scanner=scanner)
    assert found.startswith(f"scanner.{key}: at {widest:.3g} m the spot is {whole:.2g} pixel wide")
