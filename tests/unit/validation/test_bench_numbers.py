"""Numbers on the way to a comparison that no long run need be asked for."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from claims import mean
from made_benches import quick_task

from scanner_sim import load_scenario
from scanner_sim.scan.raster import RasterScan
from scanner_sim.validation.compare import test_bench as stand
from scanner_sim.validation.compare.closed_forms import ClosedForms
from scanner_sim.validation.compare.mixed_scenes import MixedScene, _stripes
from scanner_sim.validation.reproduce.bench import aim, bench, layers_of, plate

SCAN = {"rows": 2, "columns": 2, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}


def test_lines_of_the_stand_are_charges(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: 64 is no charge, and each number above it 500 electrons; shots lie where their groups say."""
    sensor = {"gain": 500.0, "bias": 64, "pixels": 8}
    scenario = load_scenario({"schema": 1, "scan": SCAN, "scanner": {"position_sensor": sensor}})
    numbers = np.stack([np.full(8, 64.0), np.arange(8.0) + 64.0])
    group = SimpleNamespace(index=np.array([1, 0]), signal=SimpleNamespace(lines=lambda: numbers))
    made = SimpleNamespace(expose=lambda aim: (None, [group]))
    monkeypatch.setattr(stand, "Instrument", lambda *_, **__: made)
    setting: Any = SimpleNamespace(device="cpu")
    aim: Any = SimpleNamespace(shot=np.arange(2))
    found = stand.lines(setting, scenario, aim)
    np.testing.assert_allclose(found, [500.0 * np.arange(8.0), np.zeros(8)])


@pytest.mark.parametrize(("filter_", "passed"), [("none", 0.6), ({"transmission": 0.7}, 0.42)])
def test_lens_and_filter_both_take_light(filter_: Any, passed: float) -> None:
    scanner = {"receiver": {"transmission": 0.6}, "filter": filter_}
    scenario = load_scenario({"schema": 1, "scan": SCAN, "scanner": scanner})
    assert ClosedForms(scenario).peak_transmission == pytest.approx(passed)


@pytest.mark.parametrize(("most", "seed"), [(0.4, 1), (math.radians(50.0), 5), (math.radians(50.0), 8)])
def test_stripes_stand_side_by_side_and_are_as_wide_as_drawn(most: float, seed: int) -> None:
    """Claim: each is from 10 to 12 mm wide and begins where the last one ends, and together they are wider than the
    field, on a board that is turned."""
    scene = MixedScene("stripes", 3, tilt=most, widths=(10e-3, 12e-3))
    items: Any = _stripes(np.random.default_rng(seed), scene)
    width, height = np.array([item["size"] for item in items]).T
    x, y, z = np.array([item["position"] for item in items]).T
    assert 10e-3 <= width.min() < 10.5e-3 < 11.5e-3 < width.max() <= 12e-3
    along = np.hypot(x[1:] - x[:-1], z[1:] - z[:-1])
    np.testing.assert_allclose(along, 0.5 * (width[1:] + width[:-1]), rtol=1e-9)
    tilt, turn = (part["angle"] for part in items[0]["rotation"])
    np.testing.assert_allclose((scene.distance - z) * np.cos(turn), x * np.sin(turn), atol=1e-12)
    field = 2.0 * scene.half * scene.distance
    assert x[0] < -0.5 * field
    assert x[-1] > 0.5 * field
    # As high as the field, and 44 % more, however it is turned about x.
    np.testing.assert_allclose(height * np.cos(tilt), 1.44 * field, rtol=1e-9)
    assert not y.any()
    bright = [item["material"]["reflectance"] for item in items]
    assert bright[:4] == [0.05, 0.8, 0.05, 0.8]


def test_the_stand_leaves_the_instrument_as_it_is_but_for_what_is_named() -> None:
    """Claim: before the target alone, in the dark, by triangulation, with the laser on all the time and at rest, the
    noise that is named and no other, drawn by the seed alone; another estimator brings no correction of its own; parts
    that are named stand in the place of these, and all else is the scenario's."""
    own = {
        "name": "own",
        "shape": "sphere",
        "diameter": 0.2,
        "position": (0.0, 0.0, 5.0),
        "material": "z93_white",
    }
    scenario = load_scenario({
        "schema": 1,
        "scan": SCAN,
        "seed": 3,
        "ranging": "both",
        "scanner": {"laser": {"power": 0.037}, "laser_off": 0.3, "rate": 700.0},
        "scene": {"objects": [own]},
        "lighting": {"sun": {"direction": (0.3, -0.5, -0.8)}},
        "transport": {"light_seed": 5, "background_seed": 6},
        "processing": {"range_gate": (2.0, 9.0), "threshold": 7.5, "bias_correction": "computed"},
    })  # fmt: skip
    setting: Any = SimpleNamespace(scenario=scenario)
    wall = stand.plate(4.0, 0.3, name="wall")
    made = stand.on_test_bench(setting, wall, seed=8, noise=("shot", "quantisation"))
    assert (made.seed, made.ranging, made.scan.shots, made.lighting.sun) == (8, "triangulation", 1, "none")
    assert [(item.name, item.position) for item in made.scene.objects] == [("wall", (0.0, 0.0, 4.0))]
    on = made.scanner.position_sensor.noise.model_dump()
    assert {name for name, value in on.items() if value} == {"shot", "quantisation"}
    assert (made.scanner.laser.power, made.scanner.rate, made.scanner.laser_off) == (0.037, 700.0, 0.0)
    assert not made.scanner.laser.speckle
    assert (made.transport.light_seed, made.transport.background_seed) == (None, 6)
    assert made.scanner.mirrors == scenario.scanner.mirrors.still()
    told = made.processing
    assert (told.threshold, told.peak, told.bias_correction) == (7.5, scenario.processing.peak, "computed")
    assert (told.range_gate, told.ambiguity, told.validation.shape, told.validation.background) == (
        None, 1.0, False, False,
    )  # fmt: skip
    mirrors = stand.mirrors_with_errors(setting)
    assert mirrors.wobble == scenario.scanner.mirrors.wobble > 0.0
    assert (mirrors.temperature.amplitude, mirrors.temperature.rate) == (0.0, 0.0)
    scan = RasterScan(rows=2, columns=5, horizontal=(-0.1, 0.2), vertical=(0.0, 0.1), motion="stepped")
    other = stand.on_test_bench(
        setting, wall, seed=8, speckle=True, mirrors=mirrors, peak="centre_of_mass", scan=scan, ranging="tof"
    )
    assert (other.ranging, other.scan, other.scanner.laser.speckle) == ("tof", scan, True)
    assert other.scanner.mirrors == mirrors
    assert (other.processing.peak, other.processing.bias_correction) == ("centre_of_mass", "none")
    assert not any(other.scanner.position_sensor.noise.model_dump().values())


def test_experiments_of_other_steps_share_no_noise() -> None:
    """Claim: the ranges of one step come again to the last bit; errors of another step are independent of its own.

    Set-up: 256 shots at a plate at 5 m. Expected: products of errors over their scatter have the mean 0.
    """
    errors = []
    for step in (0, 0, 1):
        found = layers_of(bench(quick_task(), [plate(5.0, 0.02)], step=step), aim(np.zeros(256), 0.0, 0.1))
        errors.append((found["range_m"] - found["range_m"].mean()) / found["range_m"].std())
    first, again, other = errors
    np.testing.assert_array_equal(first, again)
    claim = mean(first * other)
    assert claim
    assert claim.finds < 0.5
