"""One orbit in tables: how Sun and Earth light each target, moment by moment, and what share of time it adds up to."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from scanner_sim.products.files.tables import six_digits
from scanner_sim.products.json_text import json_text
from scanner_sim.products.provenance import versions

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Label:
    """A condition: its name in a few words and what counts as it, in one sentence."""

    name: str
    meaning: str


@dataclass(frozen=True)
class ConditionGroup:
    """Conditions that are counted together, and their share of time as somebody else estimates it, in words."""

    name: str
    estimate: str
    conditions: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class TargetTimeline:
    """One target along the orbit; arrays of shape (n,).

    Attributes
    ----------
    name
        The target.
    condition
        Number of the condition of each moment.
    lit
        Share of what the scanner sees of it that the Sun reaches, 0 to 1.
    earth
        Mean irradiance by the Earth, in units of the Sun's.
    background
        Mean charge of sunlight from it in a pixel and dwell [electron].
    sun_behind
        Share of its points at whose measurement some pixel looks into the Sun, 0 to 1.
    """

    name: str
    condition: NDArray[np.uint8]
    lit: Floats
    earth: Floats
    background: Floats
    sun_behind: Floats


@dataclass(frozen=True, eq=False)
class Timeline:
    """One orbit: evenly spaced moments, shape (n,), each of which stands for an n-th of the period.

    Attributes
    ----------
    times
        After the scenario's moment [s].
    period
        Of the orbit [s].
    sun_direction
        Unit vectors towards the Sun in the scanner's frame, shape (n, 3); NaN without a Sun.
    sun_visible
        Share of its disc that the Earth does not hide.
    sun_in_view
        Share of its disc that some pixel sees somewhere in the scan.
    brightest
        Largest charge of sunlight from a surface in the field of view, in a pixel and dwell [electron].
    full_well
        Charge at which a pixel saturates [electron].
    tracks
        The targets.
    labels
        The conditions, by number.
    groups
        Estimates to compare with.
    scenario_yaml
        The resolved scenario.
    warnings
        Sentences for the user.
    made_by
        Versions of the programs that made it.
    """

    times: Floats
    period: float
    sun_direction: Floats
    sun_visible: Floats
    sun_in_view: Floats
    brightest: Floats
    full_well: float
    tracks: tuple[TargetTimeline, ...]
    labels: tuple[Label, ...]
    groups: tuple[ConditionGroup, ...]
    scenario_yaml: str
    warnings: tuple[str, ...] = ()
    made_by: Mapping[str, str] = field(default_factory=versions)

    def shares(self, track: TargetTimeline) -> Floats:
        """Return the share of time of a target in each condition, shape (number of conditions,)."""
        return np.asarray(np.bincount(track.condition, minlength=len(self.labels)) / track.condition.size)


def orbit_csv(timeline: Timeline) -> str:
    """Return the table of an orbit: a line for each moment and target, units in the names of the columns."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(
        ("time_s", "target", "condition", "condition_name", "sunlit_share", "earth_over_sun", "background_electron",
         "sun_behind_share", "sun_visible_share", "sun_in_view_share", "brightest_electron", "sun_x", "sun_y", "sun_z")
    )  # fmt: skip
    for step, time in enumerate(timeline.times):
        common = [
            timeline.sun_visible[step],
            timeline.sun_in_view[step],
            timeline.brightest[step],
            *timeline.sun_direction[step],
        ]
        for track in timeline.tracks:
            code = int(track.condition[step])
            own = [track.lit[step], track.earth[step], track.background[step], track.sun_behind[step]]
            table.writerow(
                [
                    f"{time:.3f}",
                    track.name,
                    code,
                    timeline.labels[code].name,
                    *map(six_digits, (*own, *common)),
                ]
            )
    return text.getvalue()


def orbit_json(timeline: Timeline) -> str:
    """Return the shares of time of an orbit as JSON, beside the estimates."""
    targets: dict[str, object] = {}
    for track in timeline.tracks:
        share = timeline.shares(track)
        targets[track.name] = {
            "share": {label.name: float(value) for label, value in zip(timeline.labels, share, strict=True)},
            "grouped": {group.name: float(share[list(group.conditions)].sum()) for group in timeline.groups},
            "mean_sunlit_share": float(track.lit.mean()),
            "mean_earth_over_sun": float(track.earth.mean()),
            "largest_background_electron": float(track.background.max()),
            "share_of_time_sun_behind": float(np.mean(track.sun_behind > 0.0)),
        }
    result = {
        "steps": timeline.times.size,
        "period_s": timeline.period,
        "eclipse_share": float(1.0 - timeline.sun_visible.mean()),
        "full_well_electron": timeline.full_well,
        "conditions": [
            {"number": number, "name": label.name, "meaning": label.meaning}
            for number, label in enumerate(timeline.labels)
        ],
        "targets": targets,
        "paper": {group.name: group.estimate for group in timeline.groups},
        "versions": dict(timeline.made_by),
        "warnings": list(timeline.warnings),
    }
    return json_text(result)
