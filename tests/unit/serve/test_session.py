"""What a served run hands to its pose filter: each visit once, and none from before the filter began."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from scanner_sim.serve import messages as ask
from scanner_sim.serve import session
from scanner_sim.serve.session import Session


class Filter:
    """A filter that keeps what it is given."""

    def __init__(self, targets: Any, **settings: Any) -> None:
        self.targets, self.settings, self.seen = targets, settings, []

    def update(self, record: Any) -> None:
        self.seen.append(record)


def test_a_filter_has_every_visit_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the first question brings in all visits since the filter was begun, later ones what came since; a filter
    that is begun anew knows nothing of what was before, and has the settings that it was begun with."""
    monkeypatch.setattr(session, "PoseFilter", Filter)
    mirrors = SimpleNamespace(axis_separation=0.05)
    run: Any = object.__new__(Session)
    run.tracker = SimpleNamespace(
        targets=("one",), scenario=SimpleNamespace(scanner=SimpleNamespace(mirrors=mirrors))
    )
    run.records, run._filter, run._filtered = ["a", "b"], None, 0
    run._begin_filter = ask.Filter(protocol=ask.PROTOCOL, command="filter")
    first = run._fed()
    assert (first.targets, first.settings["axis_separation"], first.seen) == (("one",), 0.05, ["a", "b"])
    assert run._fed().seen == ["a", "b"]
    run.records += ["c", "d"]
    assert run._fed() is first
    assert first.seen == ["a", "b", "c", "d"]
    begun = ask.Filter(protocol=ask.PROTOCOL, command="filter", acceleration=0.25, turn_acceleration=0.5)
    assert run._start_filter(begun) == {}
    run.records.append("e")
    second = run._fed()
    assert second is not first
    assert second.seen == ["e"]
    assert (second.settings["acceleration"], second.settings["turn_acceleration"]) == (0.25, 0.5)
