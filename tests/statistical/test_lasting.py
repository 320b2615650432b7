"""Is what a visit says of the next one's error true?"""

from __future__ import annotations

import numpy as np
import pytest

from scanner_sim import load_scenario, track
from scanner_sim.tracking.record import TrackStatus
from scanner_sim.tracking.state import TrackMode

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
    """
    quiet = ("scanner.mirrors.wobble=0 rad", "scanner.position_sensor.noise.prnu=false")
    ratios = []
    for seed in (1, 2):
        scan = {"type": "track", "targets": ["grid"], "duration": 36 * 10 * 10.03e-3}
        document = {"schema": 1, "seed": seed, "scene": {"objects": [GRID]}, "scan": scan}
        made = track(load_scenario(document, quiet), device="cpu")
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
    assert len(ratios) == 72
    assert abs(np.mean(ratios) - 1.0) < 0.4
