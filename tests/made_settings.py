"""Settings of a comparison whose laws take few shots, for tests of what laws ask of the instrument."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim import load_scenario
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup, FlatTarget

Array = NDArray[np.float64]

GREY, MIDDLE = 0.4, 9.0
RANGES = (3.0, MIDDLE, 20.0)
SCAN = {"type": "raster", "rows": 4, "columns": 4, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}


class Few(ComparisonSetup):
    """A setting whose laws take the same small number of shots."""

    count = 16

    def shots(self, number: int) -> int:  # noqa: ARG002 (whatever is wanted)
        return self.count


def setting(seeds: int = 1, **changes: Any) -> Few:
    """Return a setting of the shipped instrument, changed as said, before plates of one grey at three ranges."""
    told = load_scenario({"schema": 1, "seed": 7, "scan": SCAN} | changes)
    return Few(told, FlatTarget(GREY, RANGES), seeds)


def lidar(told: Few, **unit: Any) -> Few:
    """Return a setting whose time of flight is changed as said."""
    return dataclasses.replace(told, scenario=told.scenario.changed(scanner={"lidar": unit}))
