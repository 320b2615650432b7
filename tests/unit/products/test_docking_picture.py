"""The picture of a docking: it shows what it is given."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from made_track import make_track
from matplotlib.axes import Axes

from scanner_sim.products.pictures.docking import Docking, draw_docking


@pytest.mark.parametrize("lit", [True, False])
def test_it_draws_truth_estimate_modes_errors_and_light(
    lit: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: all of a run's numbers are on it: truth and estimate beside each other, errors over σ, every target."""
    run = make_track(objects=1)
    time = np.array([record.time for record in run.records])
    truth = np.stack([0.1 * np.sin(9.0 * time), 0.05 + 0.0 * time, 8.0 - 4.0 * time], axis=1)
    sigma = np.full((len(time), 3), 2e-3)
    estimate = truth + 1.5 * sigma
    estimate[:5] = np.nan
    drawn: list[np.ndarray] = []
    plot = Axes.plot

    def note(axes: Axes, *values: object, **style: object) -> object:
        drawn.append(np.asarray(values[1], dtype=np.float64))
        return plot(axes, *values, **style)

    monkeypatch.setattr(Axes, "plot", note)
    light = np.linspace(1.0, 0.0, len(time)) if lit else None
    draw_docking(run, Docking(time, truth, estimate, sigma, light), tmp_path / "docking.png")
    for wanted in (truth[:, 2], estimate[:, 2], truth[:, 0], estimate[:, 1]):
        assert any(one.shape == wanted.shape and np.array_equal(one, wanted, equal_nan=True) for one in drawn)
    over = np.where(np.isnan(estimate[:, 0]), np.nan, 1.5)
    assert any(one.shape == over.shape and np.allclose(one, over, equal_nan=True) for one in drawn)
    rows = [
        one for one in drawn if len(one) and (one == one[0]).all() and float(one[0]) in (0.0, 1.0, 2.0, 3.0)
    ]
    assert sum(map(len, rows)) >= len(run.records)
    picture = matplotlib.image.imread(tmp_path / "docking.png")
    assert picture.shape[0] > 600
    assert picture[..., :3].std() > 0.05
