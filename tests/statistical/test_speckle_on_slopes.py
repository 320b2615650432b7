"""Speckle that neighbours share on surfaces that are inclined to the beam, through light, detector and estimator."""

from __future__ import annotations

import math

import numpy as np
import pytest
from claims import mean
from numpy.typing import NDArray

from scanner_sim import Scenario, simulate_many
from scanner_sim.render.device import Device

WAIST, WAVELENGTH, RANGE = 2e-3, 1.5e-6, 6.0
SIDE = 40


def board(axis: str, inclined: float, turned: float, seed: int) -> Scenario:
    """Return a board inclined by an angle [rad] about an axis and turned about its normal; noise is speckle alone."""
    radius = WAIST * math.hypot(1.0, RANGE * WAVELENGTH / (math.pi * WAIST**2))
    reach = 0.25 * radius / RANGE * (SIDE - 1)
    return Scenario.model_validate(
        {
            "schema": 1,
            "seed": seed,
            "scanner": {
                "receiver": {"aberration": 1e-8},
                "position_sensor": {
                    "diffusion": 4e-5,
                    "noise": {"shot": False, "read": False, "prnu": False},
                },
                "mirrors": {"jitter": 0.0, "wobble": 0.0},
            },
            "scene": {
                "objects": [
                    {
                        "name": "board",
                        "shape": "rectangle",
                        "size": [4.0, 4.0],
                        "position": [0.0, 0.0, RANGE],
                        "rotation": [{"axis": "z", "angle": turned}, {"axis": axis, "angle": inclined}],
                        "material": {"reflectance": 0.5},
                    }
                ]
            },
            "scan": {
                "type": "raster",
                "motion": "stepped",
                "rows": SIDE,
                "columns": SIDE,
                "horizontal": (-reach, reach),
                "vertical": (-reach, reach),
            },
        }
    )


def shared(values: NDArray[np.float64], down: int, right: int) -> float:
    """Return the mean product of values over their mean square with those so many rows and columns on."""
    there = values[down:, right:] * values[: SIDE - down, : SIDE - right]
    return float(there.mean() / np.square(values).mean())


@pytest.mark.parametrize(
    ("axis", "inclined"), [("x", 0.0), ("x", 30.0), ("y", 30.0), ("x", 60.0), ("y", 60.0)]
)
def test_neighbours_share_speckle_by_the_way_across_the_beam(
    axis: str, inclined: float, device: Device
) -> None:
    """Claim: errors of ranges half a radius of the beam apart have (1 − 2δ²) exp(−δ²) in common along the line,
    exp(−δ²) across it, and so at twice the way, however the surface is inclined: a beam sees of it what it covers, and
    two beams see alike where they overlap.

    Set-up: 32 boards before the preset's lens without aberration, each of 400 beams' areas, turned about their normals;
    speckle is the only noise. Tolerance: the scatter of the boards; 0.01 for the estimator and for what of a board's
    mean is taken away. It can fail: on a lattice in the board's own axes all is shared along a slope of 60°, and 0.10
    in place of 0.39 along the line on one of 30°.
    """
    boards = [board(axis, math.radians(inclined), 0.7 * number, number) for number in range(32)]
    errors = []
    for image in simulate_many(boards):
        assert image.valid.all()
        error = np.asarray(image["range_m"] - image["truth.range_m"], dtype=np.float64)
        errors.append(error - error.mean())
    for steps in (1, 2):
        way = 0.25 * steps**2
        law = math.exp(-way)
        for expected, (down, right) in (((1.0 - 2.0 * way) * law, (0, steps)), (law, (steps, 0))):
            claim = mean([shared(error, down, right) for error in errors], expected, slack=0.01)
            assert claim, claim
            assert claim.finds < 0.07
