"""How often the host waits for the device while a batch is measured."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from scanner_sim import load_scenario
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.render.device import Device
from scanner_sim.scan.raster import raster_aim

READS = (
    "errors of the mirrors",
    "encoders",
    "kinds of footprints",
    "size of a table",
    "size of a table",
    "results",
)
"""What of a batch of both kinds of light is read while the device may still work on it. On a GPU the tables of speckle
have one size, and the host asks for none."""

_THERE = (dr.VarState.Evaluated, dr.VarState.Literal)


@pytest.fixture
def events(device: Device, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What happens from now on: ``work`` is given to the device, or the host reads some of it."""
    seen: list[str] = []

    def reading(function: Any) -> Any:
        def read(array: Any, *arguments: Any) -> Any:
            # What is not computed yet is computed to be read.
            seen.extend(["read"] if array.state in _THERE else ["work", "read"])
            return function(array, *arguments)

        return read

    def working(*arrays: Any) -> bool:
        seen.append("work")
        return evaluate(*arrays)

    evaluate = dr.eval
    monkeypatch.setattr(dr, "eval", working)
    for kind in (mi.Float, mi.UInt32, mi.Int32, mi.Bool):
        for name in ("numpy", "__getitem__"):
            monkeypatch.setattr(kind, name, reading(getattr(kind, name)))
    return seen


def test_the_host_waits_for_a_batch_only_where_it_must(
    device: Device, repo_root: Path, events: list[str]
) -> None:
    """Claim: after the first batch, the host waits for work that it has given as often as ``READS`` says, not more.

    What is read without work in between is there already. It can fail: results read group by group wait once more.
    """
    config = repo_root / "configs" / "quickstart.yaml"
    instrument = Instrument(load_scenario(config, ["scan.rows=12", "scan.columns=12"]), device="cpu")
    aim = raster_aim(instrument.scenario.raster, np.arange(144, dtype=np.uint32), 50e-6)
    _, groups = instrument.expose(aim)
    assert len(list(groups)) == 2
    instrument.measure(aim)
    events.clear()
    instrument.measure(aim)
    assert sum(pair == ("work", "read") for pair in pairwise(events)) == len(READS)
