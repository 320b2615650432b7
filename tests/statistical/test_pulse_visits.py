"""Single visits of discs by time of flight: one pulse to a dwell, so that a pattern meets the rim at a few places."""

from __future__ import annotations

import claims
import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import Scenario, track_many
from scanner_sim.render.device import Device
from scanner_sim.tracking.record import TrackStatus

pytestmark = pytest.mark.slow

RUNS = 32


def board(distance: float, seed: int, **more: object) -> Scenario:
    """Return four discs of 100 mm on white plates before the preset."""
    return Scenario.model_validate(
        {
            "schema": 1,
            "seed": seed,
            "scanner": {"preset": "nrc_2000", **more},
            "ranging": "triangulation" if more else "tof",
            "scene": {
                "objects": [
                    {
                        "name": "board",
                        "array": {
                            "diameter": 0.1, "plate": 0.3, "rows": 2, "columns": 2, "spacing": [1.2, 1.2],
                        },
                        "position": [0.0, 0.0, distance],
                    }
                ]
            },
            "scan": {"type": "track", "targets": ["board"], "duration": 0.12},
        }
    )  # fmt: skip


def pulls(boards: list[Scenario]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return errors over σ of all visits, shape (visits, 3), and which visit to its target each is."""
    found, which = [], []
    for track in track_many(boards, device="cpu"):
        visits: dict[str, int] = {}
        for record in track.records:
            if record.status == TrackStatus.MEASURED:
                number = visits.setdefault(record.target, 0)
                visits[record.target] += 1
                error = np.asarray(record.position) - np.asarray(record.truth)
                found.append(error / np.sqrt(np.diagonal(np.asarray(record.covariance))))
                which.append(number)
    return np.array(found), np.array(which)


@pytest.mark.parametrize(
    ("distance", "more"),
    [(6.5, {}), (8.5, {}), (12.0, {}), (18.0, {}), (8.0, {"laser_off": 0.5}), (14.0, {"laser_off": 0.5})],
)
def test_angles_of_discs_between_whose_voxels_are_gaps_err_by_no_more_than_stated(
    distance: float, more: dict[str, object], device: Device
) -> None:
    """Claim: where light leaves gaps along the rim, errors of visits have the stated σ, and no fat tail: of the first
    visit, a wide figure that crosses the rim at four places, they may be smaller: the circle tells the place, and its σ
    is that of the gaps.

    Set-up: pulses, of which plates nearer than 10 m clip the amplifier, and a laser that shines for half of each dwell;
    32 runs of four discs, three visits each. Tolerance: χ² of visits; a third for patterns that lie alike on their
    targets and share their speckle. It can fail: when voxels that speckle makes darker counted as partly on the disc,
    mean squares were 2 to 14 in φ, and at 6.5 m those of second visits 6.5, as clipped plates seemed no brighter than
    the amplifier shows.
    """
    z, visit = pulls([board(distance, seed, **more) for seed in range(RUNS)])
    for axis in (0, 1):
        for number in (0, 1, 2):
            chosen = z[visit == number, axis]
            assert len(chosen) > 0.85 * 4 * RUNS
            claim = claims.mean_square(chosen, slack=0.35)
            assert claim.figure < claim.high, claim
            assert claim.figure > claim.low or number == 0, claim
            assert claim.finds < 1.8
            assert claims.share(int((np.abs(chosen) > 4.5).sum()), len(chosen), 1e-5)
