"""The tables of an orbit, of three moments written by hand."""

from __future__ import annotations

import csv
import io
import json

import numpy as np
import pytest

from scanner_sim.products.timeline import (
    ConditionGroup,
    Label,
    TargetTimeline,
    Timeline,
    orbit_csv,
    orbit_json,
)

TARGET = TargetTimeline(
    "node",
    condition=np.array([0, 1, 1, 2], dtype=np.uint8),
    lit=np.array([0.1, 0.2, 0.3, 0.8]),
    earth=np.array([0.01, 0.02, 0.03, 0.04]),
    background=np.array([5.0, 8.0, 7.0, 6.0]),
    sun_behind=np.array([0.0, 0.25, 0.0, 0.0]),
)
ORBIT = Timeline(
    times=np.array([0.0, 10.0, 20.0, 30.0]),
    period=40.0,
    sun_direction=np.array([[0.0, 0.6, 0.8]] * 4),
    sun_visible=np.array([1.0, 0.5, 0.5, 1.0]),
    sun_in_view=np.array([0.0, 0.125, 0.0, 0.0]),
    brightest=np.array([11.0, 12.0, 13.0, 14.0]),
    full_well=1e6,
    tracks=(TARGET,),
    labels=(Label("a", "A."), Label("b", "B."), Label("c", "C.")),
    groups=(ConditionGroup("a and c", "60 %", (0, 2)),),
    scenario_yaml="",
)


def test_shares_of_time_are_counts_of_moments() -> None:
    """Claim: of four moments one, two and one; the Sun is behind at the one at which some of it is, and the Earth hides
    a quarter of the Sun on the mean; the largest background is the largest."""
    told = json.loads(orbit_json(ORBIT))
    node = told["targets"]["node"]
    assert node["share"] == {"a": 0.25, "b": 0.5, "c": 0.25}
    assert node["grouped"] == {"a and c": 0.5}
    assert node["share_of_time_sun_behind"] == 0.25
    assert node["mean_sunlit_share"] == pytest.approx(0.35)
    assert node["mean_earth_over_sun"] == pytest.approx(0.025)
    assert node["largest_background_electron"] == 8.0
    assert (told["steps"], told["period_s"], told["eclipse_share"]) == (4, 40.0, 0.25)


def test_every_column_holds_what_its_name_says() -> None:
    """Claim: the second moment's line, name by name."""
    line = list(csv.DictReader(io.StringIO(orbit_csv(ORBIT))))[1]
    numbers = {name: float(line[name]) for name in line if name not in ("target", "condition_name")}
    assert (line["target"], line["condition_name"]) == ("node", "b")
    assert numbers == {
        "time_s": 10.0, "condition": 1.0, "sunlit_share": 0.2, "earth_over_sun": 0.02, "background_electron": 8.0,
        "sun_behind_share": 0.25, "sun_visible_share": 0.5, "sun_in_view_share": 0.125, "brightest_electron": 12.0,
        "sun_x": 0.0, "sun_y": 0.6, "sun_z": 0.8,
    }  # fmt: skip
