"""How often the host waits for the device while a batch is measured.

Counted in a process of its own: Dr.Jit's arrays are never again what they were once their indexing was replaced.
"""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

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


def waits(config: Path) -> int:
    """Return how often the host reads what it has given to the device just before, in the second batch of a scan."""
    import drjit as dr
    import numpy as np

    from scanner_sim import load_scenario
    from scanner_sim.instrument.instrument import Instrument
    from scanner_sim.scan.raster import raster_aim

    instrument = Instrument(load_scenario(config, ["scan.rows=12", "scan.columns=12"]), device="cpu")
    aim = raster_aim(instrument.scenario.raster, np.arange(144, dtype=np.uint32), 50e-6)
    _, groups = instrument.expose(aim)
    assert len(list(groups)) == 2
    instrument.measure(aim)
    events = _watched(dr)
    instrument.measure(aim)
    return sum(pair == ("work", "read") for pair in pairwise(events))


def _watched(dr: Any) -> list[str]:
    """Return what happens from now on: ``work`` is given to the device, or the host reads some of it."""
    import mitsuba as mi

    seen: list[str] = []
    there, evaluate = (dr.VarState.Evaluated, dr.VarState.Literal), dr.eval

    def reading(function: Any) -> Any:
        def read(array: Any, *arguments: Any) -> Any:
            # What is not computed yet is computed to be read.
            seen.extend(["read"] if array.state in there else ["work", "read"])
            return function(array, *arguments)

        return read

    def working(*arrays: Any) -> bool:
        seen.append("work")
        return bool(evaluate(*arrays))

    dr.eval = working
    for kind in (mi.Float, mi.UInt32, mi.Int32, mi.Bool):
        for name in ("numpy", "__getitem__"):
            setattr(kind, name, reading(getattr(kind, name)))
    return seen


@pytest.mark.slow
def test_the_host_waits_for_a_batch_only_where_it_must(repo_root: Path) -> None:
    """Claim: after the first batch, the host waits for work that it has given as often as ``READS`` says, not more.

    What is read without work in between is there already. It can fail: results read group by group wait once more.
    """
    command = [sys.executable, __file__, str(repo_root / "configs" / "quickstart.yaml")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == len(READS)


if __name__ == "__main__":
    sys.stdout.write(str(waits(Path(sys.argv[1]))))
