"""Patterns of several runs in one launch of frozen kernels, against each run's own instrument."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim import Scenario, load_scenario
from scanner_sim.instrument.closed_loop.frozen_instrument import FrozenInstrument
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.render.device import Device
from scanner_sim.scan.protocol import Aim

POINTS = 7
GREY: dict[str, Any] = {"shape": "rectangle", "material": {"reflectance": 0.5}}


def scenario(seed: int, speed: float, **processing: str) -> Scenario:
    """A wall, and a plate before it that moves to the right."""
    wall = GREY | {"name": "wall", "size": (3.0, 3.0), "position": (0.0, 0.0, 6.0)}
    plate = GREY | {
        "name": "plate",
        "size": (0.4, 0.4),
        "position": (0.1, 0.0, 5.5),
        "material": {"reflectance": 0.2},
        "motion": {"type": "twist", "velocity": (speed, 0.0, 0.0)},
    }
    scan = {"rows": 1, "columns": POINTS, "horizontal": (-0.1, 0.1), "vertical": (0.0, 0.0)}
    blocks = {"scene": {"objects": [wall, plate]}, "scan": scan, "processing": processing}
    return load_scenario({"schema": 1, "seed": seed, **blocks})


def pattern(number: int) -> Aim:
    """Shots on the plate and beside it, none within 10 mm of an edge; later and elsewhere for each number."""
    angle = np.array([-0.05, -0.034, -0.015, 0.005, 0.02, 0.03, 0.066]) + 0.003 * number
    first = POINTS * number
    return Aim(
        np.arange(first, first + POINTS, dtype=np.uint32),
        angle,
        0.02 - 0.5 * angle,
        50e-6 * (np.arange(POINTS) + 0.5) + 0.1 * number,
        np.full(POINTS, 1e-4),
        np.full(POINTS, -5e-5),
    )


def joined(*aims: Aim) -> Aim:
    names = ("shot", "theta", "phi", "time", "travel_theta", "travel_phi")
    return Aim(*(np.concatenate([getattr(one, name) for one in aims]) for name in names))


def test_patterns_of_several_runs_are_those_that_each_has_alone(device: Device) -> None:
    """Claim: every column of three patterns of two runs, launched together, has the bits that the run's own instrument
    gives: its own seed, its own mirrors' and encoders' errors, its objects where they are at the shots' times.

    Near edges patterns are lit more finely, which their lines show: of the shots with other lines, a third at most, the
    truth alone is the same.
    """
    runs = [Instrument(scenario(4, 0.3), device="cpu"), Instrument(scenario(9, -0.2), device="cpu")]
    bench = FrozenInstrument(*runs)
    assert bench.fast
    order = np.array([1, 0, 1])
    aims = [pattern(number) for number in (2, 3, 4)]
    found = bench.measure(joined(*aims), order)
    met: list[NDArray[Any]] = []
    for place, (run, aim) in enumerate(zip(order, aims, strict=True)):
        alone = runs[run].measure(aim)
        assert {"P.X", "sigma_range_m", "truth.theta_rad", "truth.object"} <= set(alone)
        own = slice(POINTS * place, POINTS * (place + 1))
        alike = np.asarray(found["Y"])[own] == alone["Y"]
        assert alike.mean() > 0.66
        for name in alone:
            counts = np.ones(POINTS, bool) if name.startswith("truth.") else alike
            assert np.asarray(found[name])[own][counts].tobytes() == alone[name][counts].tobytes(), name
        met.append(alone["truth.object"])
    assert not np.array_equal(met[0], met[1])


def test_patterns_are_corrected_for_the_estimators_bias(device: Device) -> None:
    """Claim: with the computed correction two patterns, the second by kernels that were recorded for the first, have
    the ranges that the instrument gives them, and these are not those of the bare estimator."""
    corrected, bare = (
        Instrument(scenario(4, 0.3, peak="parabola", bias_correction=correction), device="cpu")
        for correction in ("computed", "none")
    )
    bench = FrozenInstrument(corrected)
    assert bench.fast
    # Dr.Jit ends the process where frozen kernels read an array that was not handed to them.
    assert corrected.triangulation.bias is not None
    assert any(handed is corrected.triangulation.bias.values for handed in bench._tables)
    for number in (2, 3):
        aim = pattern(number)
        found, alone = bench.measure(aim), corrected.measure(aim)
        alike = np.asarray(found["Y"]) == alone["Y"]
        assert alike.mean() > 0.66
        for name in ("range_m", "sigma_range_m"):
            assert np.asarray(found[name])[alike].tobytes() == alone[name][alike].tobytes()
        assert (alone["range_m"] != bare.measure(aim)["range_m"]).all()
