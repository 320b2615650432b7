"""Focus and tilt of the array in the simulator against the judge's collineation and rays."""

from __future__ import annotations

import itertools
import math

import drjit.auto as auto
import numpy as np
import pytest
from prototype import Receiver
from pydantic import ValidationError

from scanner_sim.analytic.array import SensorArray
from scanner_sim.config.scanner import Scanner
from scanner_sim.optics.line_image import LineImage, line_image, sharp_everywhere
from scanner_sim.ranging.triangulation import (
    position_from_range,
    position_sigma,
    range_from_position,
    range_jacobian,
)
from scanner_sim.render.device import Device

F, D, A = 0.06, 0.1, 0.015
CASES = list(
    itertools.product(("scheimpflug", 0.0, 0.4, -0.2), (0.5, math.inf), (-0.3, 0.0, 0.3), (0.32, 0.6, 1.0))
)


def both(tilt: float | str, focus: float) -> tuple[SensorArray, LineImage]:
    """Return the judge's and the simulator's array."""
    return (
        SensorArray(F, D, A, tilt, focus),  # type: ignore[arg-type]
        line_image(F, D, A, focus, None if isinstance(tilt, str) else tilt),
    )


def test_positions_and_ranges_are_the_judges() -> None:
    for tilt, focus, theta, distance in CASES:
        judge, line = both(tilt, focus)
        p = position_from_range(distance, theta, line.scale, D, line.slope)
        assert float(judge.position(distance, theta)) == pytest.approx(float(p), rel=1e-12)
        assert float(line.position(D * math.cos(theta) / (distance - D * math.sin(theta)))) == pytest.approx(
            float(p)
        )
        assert float(range_from_position(p, theta, line.scale, D, line.slope)) == pytest.approx(
            distance, rel=1e-12
        )
        assert float(line.tangent(p)) == pytest.approx(float(judge.tangent(p)), rel=1e-12)


def test_derivatives_are_the_judges() -> None:
    """Claim: ∂R/∂p at fixed Θ, ∂R/∂Θ at fixed p, and the shift of a receiver that turns by itself."""
    step = 1e-6
    for tilt, focus, theta, distance in CASES:
        judge, line = both(tilt, focus)
        p = float(judge.position(distance, theta))
        by_p, by_theta = range_jacobian(p, theta, line.scale, D, line.slope)
        assert -float(by_p) == pytest.approx(float(judge.range_error(distance, theta)), rel=1e-8)
        turned = (judge.range(p, theta + step) - judge.range(p, theta - step)) / (2.0 * step)
        assert float(by_theta) == pytest.approx(float(turned), rel=1e-6, abs=1e-8)
        apart = float(position_sigma(p, 0.0, line.scale, 1.0, 1.0, line.slope))
        assert apart == pytest.approx(float(judge.turned(distance, theta)), rel=1e-8)


def test_scales_and_blur_are_those_of_the_judges_rays() -> None:
    """Claim: σ to first order in the pupil, the centroid of the blur to second."""
    # The second order: the array's depth over the pupil's σ, against its distance from the lens, where it is nearest.
    second = 3.0 * (0.25 * A * (F / D) / (0.8 * F)) ** 2
    for tilt, focus, theta, distance in CASES:
        judge, line = both(tilt, focus)
        seen = line.at(float(judge.position(distance, theta)), D * math.cos(theta), 1.0)
        along, across = judge.scale(distance, theta)
        assert F * float(seen.along) == pytest.approx(float(along), rel=1e-8)
        assert F * float(seen.across) == pytest.approx(float(across), rel=1e-9)
        rays = judge.blur(distance, theta)
        assert abs(seen.defocus) == pytest.approx(rays.across, rel=2e-3, abs=1e-12)
        assert abs(seen.defocus * seen.skewed) == pytest.approx(rays.along, rel=second, abs=1e-12)
        assert seen.spread(0.0, 0.0) == pytest.approx(rays.along**2, rel=2.0 * second, abs=1e-20)
        assert seen.shift == pytest.approx(rays.shift, rel=0.02, abs=1e-12)
        depth = distance - D * math.sin(theta)
        assert float(line.blur_at(seen.stretch, depth)) == pytest.approx(
            float(seen.defocus), rel=1e-9, abs=1e-12
        )


def test_numbers_and_the_device_have_one_law(device: Device) -> None:
    line = line_image(F, D, A, 0.5, 0.3)
    p = np.array([0.008, 0.012, 0.02])
    on_host, on_device = line.at(p, 0.09, 1e-5), line.at(auto.Float(p.astype(np.float32)), 0.09, 1e-5)
    for name in ("stretch", "across", "skewed", "defocus", "shift"):
        np.testing.assert_allclose(getattr(on_device, name).numpy(), getattr(on_host, name), rtol=1e-4)


def test_an_ideal_array_changes_nothing() -> None:
    """Claim: bit for bit what a program without focus computes."""
    line = sharp_everywhere(0.1)
    p = np.random.default_rng(5).uniform(1e-4, 1.3e-2, 1000)
    assert line.scale == 0.1
    assert (
        range_from_position(p, 0.2, line.scale, 0.2, line.slope)
        == 0.1 * 0.2 * np.cos(0.2) / p + 0.2 * np.sin(0.2)
    ).all()
    seen = line.at(p, 0.2, 1.0)
    assert (seen.along == 1.0).all()
    assert (seen.defocus == 0.0).all()
    assert (seen.spread(2.5e-9, 1.4e-10) == 2.5e-9).all()


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"array_tilt": 0.0, "focus_distance": 0.05}, "focus_distance"),
        ({"array_tilt": 1.3, "focus_distance": 0.5}, "array_tilt"),
        ({"array_tilt": math.atan(1.18), "focus_distance": 0.25}, "array_tilt"),
    ],
)
def test_what_has_no_image_is_told(change: dict[str, float], key: str) -> None:
    with pytest.raises(ValidationError, match=key):
        Receiver(**change)


def test_an_array_may_stand_as_near_to_the_lens_as_a_tenth_of_its_focal_length() -> None:
    """Claim: f + f (f − g d)/(L − f), by hand: at the slope g = 1.17, f = 0.1 m, d = 0.2 m and L = 0.25 m a little
    above 0.01 m, and at the 1.18 of the faults above below it."""
    receiver = Receiver(array_tilt=math.atan(1.17), focus_distance=0.25)
    depth = 0.1 + 0.1 * (0.1 - 1.17 * receiver.baseline) / 0.15
    assert receiver.line_image.depth == pytest.approx(depth)
    assert 0.01 < depth < 0.011


def test_an_array_that_leans_onto_the_lens_is_told() -> None:
    """Claim: its far end would stand at less than a fifth of the lens's distance to its other one."""
    with pytest.raises(ValidationError, match="leans towards the lens"):
        Scanner(receiver={"array_tilt": -1.3}, position_sensor={"offset": 0.075})


def test_what_has_no_meaning_is_not_judged() -> None:
    """Claim: a focus is not asked of an array that is sharp everywhere."""
    assert Receiver(array_tilt="scheimpflug", focus_distance=0.01).line_image.slope == pytest.approx(0.5)
    assert Receiver(focus_distance=0.01).line_image == sharp_everywhere(0.1)
