"""Verdicts of the reproduced tables: what is taken for the paper's figures, and what is not any more."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from scanner_sim.validation.reproduce import tables
from scanner_sim.validation.reproduce.item import Task, Verdict


@pytest.mark.parametrize(
    ("share", "verdict"),
    [(0.45, Verdict.DIFFERS), (0.55, Verdict.AGREES), (0.65, Verdict.AGREES), (0.75, Verdict.DIFFERS)],
)
def test_sixty_per_cent_of_the_sunlit_time_are_fifty_to_seventy(
    share: float, verdict: Verdict, repo_root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: the share counts in the time in sunlight, here two thirds of the orbit, for every track."""
    lit = np.repeat([True, False], [60, 30])
    shares = np.array([share * lit.mean(), 0.0, 0.0, 0.0, 0.0, 0.0])
    timeline = SimpleNamespace(
        tracks=[SimpleNamespace(name="a"), SimpleNamespace(name="b")],
        shares=lambda track: shares if track.name == "a" else np.eye(6)[0] * 0.6 * lit.mean(),
        sun_visible=lit,
        times=np.arange(90.0),
    )
    monkeypatch.setattr(tables, "sweep_orbit", lambda *_, **__: timeline)
    rows = tables.table_1(Task(quick=True, device="cpu", repository=repo_root)).rows
    (row,) = (row for row in rows if row.what.startswith("normal, of the time in sunlight"))
    assert row.verdict is verdict
