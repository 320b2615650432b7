"""Is what a visit says of the next one's error true?"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import load_scenario, track_many
from scanner_sim.tracking.errors import ErrorParts, common_covariance
from scanner_sim.tracking.record import PatternRecord, TrackStatus
from scanner_sim.tracking.state import TrackMode

Array = NDArray[np.float64]

GRID = {
    "name": "grid",
    "array": {"diameter": 0.1, "rows": 6, "columns": 6, "spacing": (0.55, 0.55), "plate": 0.4},
    "position": (0.0, 0.0, 10.0),
}


@pytest.mark.slow
@pytest.mark.usefixtures("device")
def test_the_surface_keeps_as_much_of_the_error_as_is_stated() -> None:
    """Claim: errors of different visits to one disc have the products that the surface's part of them states.

    Set-up: two runs over 36 discs at 10 m, eight visits to each while it is tracked, without wobble and unlike pixels,
    so that nothing but the surface is left. Mean products of different visits over the stated variance, mean over Θ, φ
    and R.
    Expected: 1. Tolerance: 72 discs, whose squared lasting errors scatter by √2 and whose visits add as much again
    divided by eight: a mean of three times 72 such has a σ of 0.10, so 0.4 is four. Were all of the speckle to last, it
    would be 0.5; were none, it would not be stated.

    Claim: visits whose dwells lie within a tenth of a point of each other share the dither's part as well. Expected and
    tolerance as before; what lasts alone is a tenth less at least.
    """
    quiet = ("scanner.mirrors.wobble=0 rad", "scanner.position_sensor.noise.prnu=false")
    ratios, near = [], []
    scan = {"type": "track", "targets": ["grid"], "duration": 36 * 10 * 10.03e-3}
    document = {"schema": 1, "scene": {"objects": [GRID]}, "scan": scan}
    scenarios = [load_scenario(document | {"seed": seed}, quiet) for seed in (1, 2)]
    for made in track_many(scenarios, device="cpu"):
        for target in made.targets:
            late = [
                record
                for record in made.of(target.name)
                if record.status is TrackStatus.MEASURED and record.mode is TrackMode.TRACK
            ]
            assert len(late) >= 6
            error = np.array([record.position - record.truth for record in late])
            stated = np.mean([np.diagonal(record.errors.surface) for record in late], axis=0)
            assert np.linalg.eigvalsh([record.errors.white for record in late]).min() > 0.0
            count = len(late)
            product = (error.sum(axis=0) ** 2 - (error**2).sum(axis=0)) / (count * (count - 1))
            ratios.append(product / stated)
            near.append(_near(late, error))
    assert len(ratios) == 72
    assert abs(np.mean(ratios) - 1.0) < 0.4
    assert abs(np.mean(near) - 1.0) < 0.4


def _near(records: list[PatternRecord], error: Array) -> Array:
    """Return mean products of errors of visits whose dwells lie alike, over what is stated of them, of Θ, φ and R."""
    parts = ErrorParts.stack([record.errors for record in records])
    position, time = (
        np.array([record.position for record in records]),
        np.array([one.time for one in records]),
    )
    stated = common_covariance(parts, position, time, np.zeros(len(records)))
    apart = parts.dwell_place[:, None] - parts.dwell_place
    one, other = np.nonzero(np.triu(np.abs(apart - np.rint(apart)) < 0.1, 1))
    assert len(one) > 1
    assert (stated[one, other, 0, 0] > 1.1 * parts.surface[one, 0, 0]).all()
    found = (error[one] * error[other]).mean(axis=0)
    return np.asarray(found / np.diagonal(stated[one, other], axis1=1, axis2=2).mean(axis=0))
