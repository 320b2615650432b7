"""Simulated sightings: which visits count, and what of their errors a mean takes away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from made_track import make_track

from scanner_sim.calibration.simulated import _mean
from scanner_sim.tracking.record import TrackStatus
from scanner_sim.tracking.state import TrackMode


def test_a_sighting_is_the_mean_of_the_visits_that_followed() -> None:
    """Claim: visits that search do not count; white parts fall with the number of visits, lasting ones do not.

    The mirrors wobble anew from visit to visit, 80 ms apart, if that takes them 10 ms, and not if it takes an hour.
    What unlike pixels and wobble do is told apart, as standard deviations.
    """
    track = make_track(seconds=1.2)
    target = track.targets[0].name
    for lasts, share in ((0.01, 1.0), (3600.0, 0.0)):
        wobble = replace_errors(wobble=9e-12, wobble_time=lasts, wobble_angle=0.05)
        records = [
            replace(one, mode=TrackMode.TRACK, errors=replace(one.errors, **wobble))
            for one in track.of(target)
            if one.status is TrackStatus.MEASURED
        ]
        assert len(records) > 3
        astray = replace(records[0], mode=TrackMode.ACQUIRE, position=records[0].position + 1.0)
        found = _mean(replace(track, records=(astray, *records)), target)
        assert found is not None
        position, covariance, unlike = found
        np.testing.assert_allclose(position, np.mean([one.position for one in records], axis=0), rtol=1e-12)
        wanted = np.mean([one.errors.white for one in records], axis=0) / len(records)
        wanted = wanted + np.mean([one.errors.surface + one.errors.shared for one in records], axis=0)
        wanted -= np.diag([9e-12, 9e-12, 0.0]) * share * (1.0 - 1.0 / len(records))
        np.testing.assert_allclose(covariance, wanted, rtol=1e-3, atol=1e-15)
        left = 3e-6 * (1.0 - share * (1.0 - 1.0 / len(records))) ** 0.5
        when = np.mean([one.time for one in records])
        np.testing.assert_allclose(unlike, (2e-4, 80.0, 1.2, left, when), rtol=1e-3)


def replace_errors(**changes: float) -> dict[str, np.ndarray]:
    """Errors of made-up visits whose images stay on their pixels."""
    numbers = {"pixels": 4e-8, "image": 80.0, "image_width": 1.2} | changes
    return {name: np.array(value) for name, value in numbers.items()}
