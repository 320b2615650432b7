"""Ranges of objects that move while they are scanned: is (range − truth)/σ standard normal there too?

Claim
    Every voxel measures the object where it is at the voxel's own instant, and σ stays true.
Set-up
    A white plate at 6 m, inclined by 20°, that comes nearer at 0.3 m/s, drifts aside at 0.2 m/s and turns at 10 deg/s
    about an oblique axis, through the default instrument with its noise and speckle, 60 × 80 voxels. Left out are what
    voxels have in common: the mirrors' errors and the pixels' unequal gain. The truth is the plate's plane at each
    voxel's time, in closed form.
Expected
    The pooled mean of n errors over σ is 0 ± 1/√n and the sum of their squares χ² with n degrees of freedom.
Tolerance
    4 standard errors each, and beyond them 0.015 σ of the mean for the estimator's own bias (10 µm) and 3 % of χ²
    for σ, which is itself estimated: a right program fails once in 10⁴ seeds. A plate at rest would be off by 70 mm at
    the end, one that is a row's time late by about a σ, which is 15 times what the mean may be off.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scanner_sim import Scenario
from scanner_sim.analytic.geometry import laser_origin, scanner_axes
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.scan.raster import raster_aim

SEPARATION = 0.05
PLACE, VELOCITY = np.array([0.0, 0.1, 6.0]), np.array([0.2, 0.0, -0.3])
TURN_RATE = np.deg2rad([6.0, 7.0, 4.0])
TILT = np.deg2rad(20.0)

pytestmark = pytest.mark.usefixtures("device")


def test_sigma_is_true_for_a_moving_plate() -> None:
    still = {"jitter": 0.0, "wobble": 0.0, "synchronisation": 0.0, "readout_noise": 0.0, "readout_step": 0.0}
    plate = {
        "name": "plate",
        "shape": "rectangle",
        "size": (2.0, 2.0),
        "position": tuple(PLACE),
        "rotation": {"axis": "y", "angle": TILT},
        "material": "z93_white",
        "motion": {"type": "twist", "velocity": tuple(VELOCITY), "turn_rate": tuple(TURN_RATE)},
    }
    scan = {"rows": 60, "columns": 80, "horizontal": (-0.08, 0.08), "vertical": (-0.06, 0.06)}
    told = Scenario.model_validate(
        {
            "schema": 1,
            "seed": 11,
            "scan": scan,
            "scanner": {"mirrors": still, "position_sensor": {"noise": {"prnu": False}}},
            "scene": {"objects": [plate]},
        }
    )
    shots = np.arange(told.raster.shots, dtype=np.uint32)
    aim = raster_aim(told.raster, shots, told.scanner.dwell)
    layers = Instrument(told, device="cpu").measure(aim)
    turn = Rotation.from_rotvec(aim.time[:, None] * TURN_RATE).as_matrix()
    normal = turn @ np.array([np.sin(TILT), 0.0, np.cos(TILT)])
    place = PLACE + aim.time[:, None] * VELOCITY
    along = scanner_axes(aim.theta, aim.phi)[0]
    truth = np.sum((place - laser_origin(aim.phi, SEPARATION)) * normal, axis=1) / np.sum(
        along * normal, axis=1
    )

    valid = layers["status"] == Status.VALID
    error = ((layers["range_m"] - truth) / layers["sigma_range_m"])[valid]
    n = error.size
    assert n > 0.98 * len(shots)
    assert abs(error.mean()) < 4.0 / np.sqrt(n) + 0.015
    assert abs(np.mean(error**2) - 1.0) < 4.0 * np.sqrt(2.0 / n) + 0.03
    # The test could fail: in a row's time the plate moves by more than half a σ.
    row = told.raster.columns
    assert np.median(np.abs(truth[row:] - truth[:-row])) > 0.5 * np.median(layers["sigma_range_m"][valid])
