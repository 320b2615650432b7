"""Shots under the Sun before what moves: each part of them sees the background of its own moment."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.instrument import instrument as room
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.lit_aims import lit_aims
from scanner_sim.scan.protocol import Aim

TIMES = np.array([0.1, 0.2, 0.9, 1.1, 1.2, 1.3, 2.4])


SIGHTS = {
    name: SimpleNamespace(name=name, pitch=pitch, receiver=SimpleNamespace(focal_length=0.1))
    for name, pitch in (("line", 50e-6), ("field", 80e-6))
}


def instrument(
    *,
    layout: str = "shots",
    dark: bool = False,
    bodies: bool = True,
    names: tuple[str, ...] = ("line", "field"),
) -> Any:
    """Return one of two rangefinders before a scan of seven shots, and no more than this module asks for."""
    zero = np.zeros(TIMES.size)
    whole = Aim(np.arange(TIMES.size, dtype=np.uint32), zero, zero, TIMES, zero, zero)
    scan = SimpleNamespace(layout=layout, shots=TIMES.size, aims=lambda _, batch: whole.batches(batch))
    sky = SimpleNamespace(dark=dark)
    scenario = SimpleNamespace(open_scan=scan, scan_setup=None, lighting=SimpleNamespace(sky=lambda: sky))
    finders = tuple(
        SimpleNamespace(sight=(SIGHTS[name], None), panorama_of=lambda row, name=name: (name, row))
        for name in names
    )
    loaded = SimpleNamespace(bodies=(1,) if bodies else ())
    made: Any = object.__new__(Instrument)
    vars(made).update(
        scenario=scenario, loaded=loaded, rangefinders=finders, _stay=SimpleNamespace(resume=nullcontext)
    )
    return made


@pytest.mark.parametrize(
    ("names", "step"), [(("line", "field"), 5e-4), (("line",), 5e-4), (("field",), 8e-4)]
)
def test_shots_of_one_slot_see_the_background_of_its_middle(
    names: tuple[str, ...], step: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: slots of a second have three, three and one shot; each rangefinder sees its rows at their middles, in
    batches of two; bins are those of the first rangefinder."""
    steps: list[float] = []

    def slots(_: Any, step: float) -> Any:
        steps.append(step)
        return SimpleNamespace(at=lambda time: (int(time), 0))

    def rows(parts: Any, times: Any, sight: Any) -> list[Any]:
        return [(sight.name, time, part.shot.tolist()) for part, time in zip(parts, times, strict=True)]

    monkeypatch.setattr(room, "TimeSlots", slots)
    monkeypatch.setattr(room, "rows_about", rows)
    found = list(lit_aims(instrument(names=names), 2))
    assert steps == [pytest.approx(step)]
    assert [aim.shot.tolist() for aim, _ in found] == [[0, 1], [2], [3, 4], [5], [6]]
    for (_, seen), (middle, own) in zip(
        found, [(0.5, [0, 1, 2])] * 2 + [(1.5, [3, 4, 5])] * 2 + [(2.5, [6])], strict=True
    ):
        assert seen == [(name, (name, middle, own)) for name in names]


@pytest.mark.parametrize("changes", [{"layout": "image"}, {"dark": True}, {"bodies": False}])
def test_images_darkness_and_what_rests_need_no_background_of_a_moment(changes: dict[str, Any]) -> None:
    found = list(lit_aims(instrument(**changes), 3))
    assert [(aim.shot.tolist(), seen) for aim, seen in found] == [
        ([0, 1, 2], None),
        ([3, 4, 5], None),
        ([6], None),
    ]
