"""Where the background takes objects to be, and whose light it has: from when on something told counts for it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim import Scenario, load_scenario
from scanner_sim.instrument.closed_loop.situation import InUse, Situations
from scanner_sim.instrument.closed_loop.told import with_light, with_move

STEP = 1e-3
"""A bin of the background: a quarter of it is 2.5 mm at 10 m."""
ARM = 2.0
"""Half the box about the node, along x."""


def scenario(**lighting: Any) -> Scenario:
    plate = {
        "array": {"diameter": 0.1, "plate": 0.4},
        "motion": {"type": "twist", "velocity": (0.5, 0.0, 0.0)},
    }
    return load_scenario(
        {
            "schema": 1,
            "lighting": lighting or {"sun": {"direction": (0.0, -1.0, -0.2)}},
            "scene": {
                "objects": [
                    {"name": "wall", "shape": "rectangle", "size": (4.0, 4.0), "position": (0.0, 0.0, 12.0),
                     "material": "z93_white"},
                    {"name": "node", "position": (0.0, 0.0, 10.0), **plate},
                    {"name": "other", "position": (3.0, 0.0, 10.0), **plate},
                ]
            },
            "scan": {"type": "track", "targets": ["node"]},
        }
    )  # fmt: skip


def loaded() -> Any:
    """Two bodies, each in a box that reaches ±2 m along x and has no other size."""
    box = SimpleNamespace(corner=lambda number: (ARM if number % 2 else -ARM, 0.0, 0.0))
    return SimpleNamespace(bodies=(SimpleNamespace(mitsuba=SimpleNamespace(bbox=lambda: box)),) * 2)


def moved(
    before: Scenario, time: float, *, place: tuple[float, float, float] = (0.0, 0.0, 10.0), **rates: Any
) -> Scenario:
    pose = np.eye(4)
    pose[:3, 3] = place
    rates = {"velocity": (0.0, 0.0, 0.0), "turn_rate": (0.0, 0.0, 0.0)} | rates
    return with_move(before, "node", pose, time=time, clock=0.0, **rates)


def place(items: Any, time: float) -> list[float]:
    return [float(value) for value in items[0].pose_at(time)[0, :3, 3]]


def test_only_what_moves_is_in_a_situation() -> None:
    """Claim: the node and its neighbour, in the order of the scene, and the background has them as they are until
    something is told."""
    found, used = Situations(scenario(), loaded(), STEP).at(0.5, InUse())
    assert [item.name for item in found.items] == ["node", "other"]
    assert found.background is found.items
    assert used == InUse()
    assert place(found.items, 0.5) == pytest.approx([0.25, 0.0, 10.0])


def test_the_first_state_that_is_told_counts_at_once() -> None:
    """Claim: from the moment for which it is told, however little it changes; what is not told goes on as before."""
    situations = Situations(moved(scenario(), 1.0, place=(0.5, 0.0, 10.0)), loaded(), STEP)
    found, used = situations.at(0.999, InUse())
    assert used == InUse()
    found, used = situations.at(1.0, used)
    assert [name for name, _ in used.moves] == ["node"]
    assert place(found.background, 3.0) == pytest.approx([0.5, 0.0, 10.0])
    assert found.background[1] == found.items[1]
    assert situations.at(2.0, used)[0].background is found.background


def test_what_is_told_for_later_is_not_in_the_background_yet() -> None:
    """Claim: until its time an object stands there as it does where nothing was told, for a background may be of a
    moment that is later than the pattern; beside one that was told already, too."""
    untold = place(Situations(scenario(), loaded(), STEP).at(0.5, InUse())[0].background, 1.5)
    later = moved(scenario(), 1.0, place=(9.0, 0.0, 10.0))
    found, _ = Situations(later, loaded(), STEP).at(0.5, InUse())
    assert place(found.background, 1.5) == untold == pytest.approx([0.75, 0.0, 10.0])
    both = with_move(
        later, "other", np.eye(4), velocity=(0.0, 0.0, 0.0), turn_rate=(0.0, 0.0, 0.0), time=0.2, clock=0.0
    )
    found, used = Situations(both, loaded(), STEP).at(0.5, InUse())
    assert [name for name, _ in used.moves] == ["other"]
    assert place(found.background, 1.5) == untold
    assert place(found.background[1:], 1.5) == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("rates", "most"),
    [
        # A corner at (±2, 0, 10) is 10.198 m away, and to a thousandth still is when it has moved.
        ({"velocity": (0.01, 0.0, 0.0)}, 0.25e-3 * np.hypot(10.0, 2.0) / 0.01),
        ({"velocity": (0.0, 0.0, -0.01)}, 0.25e-3 * np.hypot(10.0, 2.0) / 0.01),
        ({"turn_rate": (0.0, 0.0, 1e-3)}, 0.25e-3 * np.hypot(10.0, 2.0) / 2e-3),
    ],
    ids=["across", "nearer", "turning"],
)
def test_a_state_counts_when_a_corner_is_a_quarter_of_a_bin_away(rates: Any, most: float) -> None:
    """Claim: what stood still and is told to move is in the background where it stood until some corner of it has
    moved by a quarter of a bin as the scanner sees it; the motion itself is the true one throughout."""
    still = moved(scenario(), 0.0)
    situations = Situations(still, loaded(), STEP)
    _, used = situations.at(0.0, InUse())
    situations.follow(moved(still, 1.0, **rates))
    before, after = 1.0 + 0.99 * most, 1.0 + 1.01 * most
    found, again = situations.at(before, used)
    assert again is used
    assert place(found.background, before) == pytest.approx([0.0, 0.0, 10.0])
    moving = np.array(rates.get("velocity", (0.0, 0.0, 0.0)))
    assert place(found.items, before) == pytest.approx([0.0, 0.0, 10.0] + 0.99 * most * moving)
    found, again = situations.at(after, used)
    assert again.moves[0][1].time == 1.0
    assert place(found.background, after) == pytest.approx([0.0, 0.0, 10.0] + 1.01 * most * moving)


def test_another_state_stands_elsewhere() -> None:
    """Claim: one background after the other, and back again: each stands where its own state says."""
    first = moved(scenario(), 0.0)
    both = moved(first, 1.0, place=(0.3, 0.0, 10.0))
    situations = Situations(both, loaded(), STEP)
    here = situations.at(0.5, InUse())
    there = situations.at(1.5, here[1])
    assert place(here[0].background, 0.5) == pytest.approx([0.0, 0.0, 10.0])
    assert place(there[0].background, 1.5) == pytest.approx([0.3, 0.0, 10.0])
    assert place(situations.at(0.5, here[1])[0].background, 0.5) == pytest.approx([0.0, 0.0, 10.0])


def test_objects_of_a_run_beside_are_the_same_ones() -> None:
    """Claim: equal ones are the same objects, so that their windows are shared; one that moves otherwise is its own."""
    one = Situations(scenario(), loaded(), STEP)
    alike, moving = (
        Situations(each, loaded(), STEP, like=one) for each in (scenario(), moved(scenario(), 0.0))
    )
    items = [each.at(0.0, InUse())[0].items for each in (one, alike, moving)]
    assert all(own is other for own, other in zip(items[1], items[0], strict=True))
    assert items[2][0] is not items[0][0]
    assert items[2][1] is items[0][1]


def test_without_light_nothing_is_asked_of_the_background() -> None:
    dark = moved(scenario(sun="none"), 0.0, place=(0.3, 0.0, 10.0))
    found, used = Situations(dark, loaded(), STEP).at(1.0, InUse())
    assert found.background is found.items
    assert used == InUse()
    assert found.sky.dark


def test_light_counts_when_it_differs_from_what_is_in_use() -> None:
    """Claim: of Suns at 0, 1, 1.3, 1.6 and 1.2 mrad the background has the first, the second by its 1 mrad, that again
    by 0.3 mrad, the fourth by 0.6 mrad, and that again by 0.4 mrad: always against what it has, half a mrad at most."""
    lit = scenario()
    for time, angle in enumerate((0.0, 1e-3, 1.3e-3, 1.6e-3, 1.2e-3)):
        sun = (np.sin(angle), 0.0, np.cos(angle))
        lit = with_light(lit, sun=sun, earth=None, visible=None, time=float(time), clock=0.0)
    situations, used, had = Situations(lit, loaded(), STEP), InUse(), []
    for time in (0.5, 1.5, 2.5, 3.5, 4.5):
        found, now = situations.at(time, used)
        assert now.light is not None
        assert found.sky.sun_direction is not None
        np.testing.assert_allclose(found.sky.sun_direction, now.light.sun, atol=1e-12)
        assert (now is used) == (now == used)
        had.append(now.light.time)
        used = now
    assert had == [0.0, 1.0, 1.0, 3.0, 3.0]
