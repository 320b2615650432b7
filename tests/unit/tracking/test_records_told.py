"""What a run tells of its visits: the box of a notebook, and one pattern of several."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from html_cells import cells
from made_track import make_track

from scanner_sim.config.load import scenario_from_text
from scanner_sim.instrument.closed_loop.whole_track import track_of
from scanner_sim.tracking.measurement import Measurement
from scanner_sim.tracking.record import TrackStatus


def test_a_notebook_shows_how_often_and_how_well_targets_were_measured() -> None:
    """Claim: visits and measurements of each target, the median σ of its range in millimetres, and its last state; what
    the run warns of stands below."""
    track = make_track(objects=1)
    page = track._repr_html_()
    records = track.records
    assert f"Track of {len(records)} visits in {records[-1].time:.4g} s, seed {track.seed}" in page
    heading, *rows, warning = cells(page)
    assert heading == ["target", "visits", "measured", "median σ of R", "state at the end"]
    assert warning == ["warning", "A warning."]
    for number, row in enumerate(rows):
        own = records[number::4]
        there = sum(one.status is TrackStatus.MEASURED for one in own)
        assert row == [f"node/{number + 1}", str(len(own)), str(there), "4 mm", "track"]
    assert rows[1][1] != rows[1][2]
    kept = [replace(one, covariance=one.covariance * (1.0 + one.number) ** 2) for one in records[:9:4]]
    rows = cells(replace(track, records=tuple(kept), warnings=())._repr_html_())
    assert [row[3] for row in rows[1:]] == ["20 mm", "none", "none", "none"]
    assert [row[4] for row in rows[1:]] == ["track", *["never visited"] * 3]
    assert len(rows) == 5


@pytest.mark.parametrize("row", [0, 2])
def test_one_of_several_patterns_is_told_by_itself(row: int) -> None:
    """Claim: each figure of the measurement of a pattern is that of its row, and one alone is itself."""
    count = 3
    figures = {
        name: 10.0 * number + np.arange(float(count))
        for number, name in enumerate(("time", "radius", "sigma_radius", "misfit", "fraction"), start=1)
    }
    whole = Measurement(
        position=np.arange(9.0).reshape(3, 3),
        covariance=np.arange(27.0).reshape(3, 3, 3),
        found=np.array([True, False, True]),
        **figures,
    )
    one = whole.of(row)
    for name, values in figures.items():
        assert getattr(one, name) == [values[row]]
    np.testing.assert_array_equal(one.position, whole.position[[row]])
    np.testing.assert_array_equal(one.covariance, whole.covariance[[row]])
    assert one.found == [row != 1]
    assert one.of(0) is one


def test_a_run_warns_of_targets_that_it_never_measured() -> None:
    """Claim: of each target that was never visited, and of each that was never measured what it mostly was instead."""
    track = make_track(objects=1)
    own = [[one for one in track.records if one.target == f"node/{member}"] for member in range(1, 4)]
    refused = [replace(one, status=TrackStatus.REFUSED) for one in own[1][:3]]
    limited = [replace(one, status=TrackStatus.LIMITED) for one in own[1][3:5]]
    missed = [replace(one, status=TrackStatus.NOT_FOUND) for one in own[2][:2]]
    made = track_of(
        scenario_from_text(track.scenario_yaml, name="it"),
        (*own[0], *refused, *limited, *missed),
        track.axes,
        ("said before",),
    )
    names = [one.name for one in made.targets]
    assert names == [f"node/{member}" for member in range(1, 5)]
    assert made.warnings == (
        "said before",
        f"'node/2' was never measured; mostly: {TrackStatus.REFUSED.sentence}",
        f"'node/3' was never measured; mostly: {TrackStatus.NOT_FOUND.sentence}",
        "'node/4' was never visited: the run is too short",
    )
