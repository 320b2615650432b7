"""A user's own aims: measured as a scan's are, with the background and the motion that are theirs, or refused."""

from __future__ import annotations

from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import Aim, InputError, Instrument, Scenario, load_scenario
from scanner_sim.instrument.own_aims import is_of_scan
from scanner_sim.render.device import Device
from scanner_sim.scan.raster import raster_aim

ROWS, COLUMNS = 2, 5
SUN = {"sun": {"direction": (0.0, 0.3, -1.0)}}


def scenario(**changes: Any) -> Scenario:
    """A grey wall that fills the upper half of the view, at 5 m."""
    wall = {
        "name": "wall",
        "shape": "rectangle",
        "size": (4.0, 2.0),
        "position": (0.0, -1.0, 5.0),
        "material": {"reflectance": 0.5},
    }
    scan = {"rows": ROWS, "columns": COLUMNS, "horizontal": (-0.1, 0.1), "vertical": (0.1, 0.12)}
    return load_scenario({"schema": 1, "seed": 4, "scene": {"objects": [wall]}, "scan": scan} | changes)


def whole(known: Scenario) -> Aim:
    return raster_aim(known.raster, np.arange(ROWS * COLUMNS, dtype=np.uint32), known.scanner.dwell)


def same(one: Any, other: Any) -> bool:
    return one.keys() == other.keys() and all(one[name].tobytes() == other[name].tobytes() for name in one)


def test_directions_become_shots_one_after_the_other(device: Device) -> None:
    """Claim: shots are numbered from the first, each in the middle of its dwell, at rest unless it is told."""
    instrument = Instrument(scenario(), device="cpu")
    dwell = instrument.scenario.scanner.dwell
    aim = instrument.aim([[0.1, 0.2], [0.3, 0.4]], [[0.0], [0.05]], first=7, travel_phi=1e-3)
    np.testing.assert_array_equal(aim.shot, [7, 8, 9, 10])
    np.testing.assert_array_equal(aim.theta, [0.1, 0.2, 0.3, 0.4])
    np.testing.assert_array_equal(aim.phi, [0.0, 0.0, 0.05, 0.05])
    np.testing.assert_allclose(aim.time, dwell * np.array([7.5, 8.5, 9.5, 10.5]))
    np.testing.assert_array_equal(aim.travel_theta, 0.0)
    np.testing.assert_array_equal(aim.travel_phi, 1e-3)
    assert instrument.measure(aim)["range_m"].shape == (4,)


def test_parts_of_an_aim_give_what_the_whole_gives(device: Device) -> None:
    """Claim: the same shots give the same bytes together and in parts, and from an aim that the user made."""
    known = scenario()
    instrument = Instrument(known, device="cpu")
    aim = whole(known)
    made = Aim(**{field.name: getattr(aim, field.name).copy() for field in fields(Aim)})
    samples = instrument.measure(made)
    assert same(samples, instrument.measure(aim))
    first, second = (instrument.measure(aim.part(part)) for part in (slice(0, 3), slice(3, None)))
    assert same(samples, {name: np.concatenate([first[name], second[name]]) for name in first})


def test_runs_of_other_seeds_are_measured_together_as_alone(device: Device) -> None:
    """Claim: the samples of each run stand one after the other and are those that it has alone, to the last bit."""
    known = scenario()
    aim = whole(known)
    together = Instrument(known, device="cpu").measure(aim, seeds=[4, 11])
    alone = [Instrument(scenario(seed=seed), device="cpu").measure(aim) for seed in (4, 11)]
    assert same(together, {name: np.concatenate([one[name] for one in alone]) for name in together})
    assert not np.array_equal(alone[0]["range_m"], alone[1]["range_m"])


def changed(aim: Aim, name: str, values: Any) -> Aim:
    return replace(aim, **{name: values})


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("theta", np.zeros(3), r"shape \(3,\)"),
        ("phi", np.zeros((2, 5)), r"shape \(2, 5\)"),
        ("time", [0.0] * 10, "and not float64"),
        ("shot", np.arange(10), "int64"),
        ("theta", np.zeros(10, dtype=np.float32), "float32"),
        ("phi", np.full(10, np.nan), "not finite"),
        ("time", np.full(10, np.inf), "not finite"),
        ("theta", np.full(10, 0.6), "reaches 0.6 rad"),
        ("travel_phi", np.full(10, -0.6), "reaches 0.6 rad"),
    ],
)
def test_an_aim_that_cannot_be_is_refused(device: Device, name: str, values: Any, words: str) -> None:
    known = scenario()
    with pytest.raises(InputError, match=words) as caught:
        Instrument(known, device="cpu").measure(changed(whole(known), name, values))
    assert name in str(caught.value)


def test_what_is_no_direction_is_refused(device: Device) -> None:
    instrument = Instrument(scenario(), device="cpu")
    for theta, phi, first, words in (
        ("left", 0.0, 0, "no angles"),
        ([0.0, 0.1], [0.0, 0.1, 0.2], 0, "no angles"),
        (0.0, 0.0, -1, "cannot be numbered"),
        (0.0, 0.0, 2**32, "cannot be numbered"),
        ([], [], 0, "cannot be numbered"),
    ):
        with pytest.raises(InputError, match=words):
            instrument.aim(theta, phi, first=first)
    nothing = whole(scenario()).part(slice(0, 0))
    with pytest.raises(InputError, match="at least one shot"):
        instrument.measure(nothing)
    with pytest.raises(InputError, match="2 backgrounds are not one for each of 1"):
        instrument.measure(whole(scenario()), backgrounds=[None, None])


@pytest.mark.parametrize(("ranging", "name"), [("triangulation", "background"), ("tof", "tof.background_w")])
def test_own_aims_see_the_background_where_they_look(device: Device, ranging: str, name: str) -> None:
    """Claim: shots at a sunlit wall see its light though the scan's rows look past it, as a scan over it does.

    Tolerance: 1 % for each shot (0.14 % found): an even wall, and sunlight whose paths have no noise but the bins'.
    """
    over = {"rows": ROWS, "columns": COLUMNS, "horizontal": (-0.1, 0.1), "vertical": (-0.12, -0.1)}
    past, at = (
        Instrument(scenario(ranging=ranging, lighting=SUN, **scan), device="cpu")
        for scan in ({}, {"scan": over})
    )
    aim = whole(at.scenario)
    assert is_of_scan(aim, at.scenario)
    assert not is_of_scan(aim, past.scenario)
    seen, own = at.measure(aim)[name], past.measure(aim)[name]
    assert seen.min() > 0.0
    np.testing.assert_allclose(own, seen, rtol=0.01)
    kept = past.backgrounds(aim)
    np.testing.assert_array_equal(past.measure(aim, backgrounds=kept)[name], own)


def test_in_a_scan_without_rows_the_sun_shines_on_what_moves_where_it_is(device: Device) -> None:
    """Claim: shots of a Lissajous figure see a sunlit wall's light while it stands there, and none when it has gone up,
    as the laser does.

    The wall goes at 10 m/s, ten times its height in 2 s.
    """
    wall = {
        "name": "wall",
        "shape": "rectangle",
        "size": (2.0, 2.0),
        "position": (0.0, 0.0, 5.0),
        "material": {"reflectance": 0.5},
        "motion": {"type": "twist", "velocity": (0.0, -10.0, 0.0)},
    }
    figure = {
        "type": "lissajous",
        "patterns": 1,
        "pattern": {"ratio": "9:8", "points": 256, "amplitude": 0.02},
    }
    light = {"background_seed": 3}
    known = scenario(scene={"objects": [wall]}, scan=figure, lighting=SUN, transport=light)
    instrument = Instrument(known, device="cpu")
    early, late = (
        instrument.measure(instrument.aim([-0.01, 0.01], 0.0, first=first)) for first in (0, 40_000)
    )
    assert (early["background"] > 0.0).all()
    assert (early["truth.object"] == 1).all()
    assert not late["background"].any()
    assert not late["truth.object"].any()
    # Later and earlier shots in turns, of two runs: each sees the light of its own time, and stands in its own place.
    parts = [instrument.aim([-0.01, 0.01], 0.0, first=first) for first in (40_000, 0)]
    turns = [2, 0, 3, 1]
    both = Aim(
        **{
            field.name: np.concatenate([getattr(part, field.name) for part in parts])[turns]
            for field in fields(Aim)
        }
    )
    together = instrument.measure(both, seeds=[known.seed, known.seed + 1])
    for name in ("background", "truth.object", "truth.theta_rad", "Y"):
        wanted = np.concatenate([late[name], early[name]])[turns]
        own, other = together[name].reshape(2, 4)
        np.testing.assert_array_equal(own, wanted, err_msg=name)
        if name in ("background", "truth.object"):
            # The mirrors of another run err otherwise.
            np.testing.assert_allclose(other, wanted, rtol=1e-5, err_msg=name)


def test_own_aims_move_as_they_say(device: Device) -> None:
    """Claim: speckle is averaged over the way of the shots, not over that of the scenario's raster."""
    instrument = Instrument(scenario(), device="cpu")
    share = instrument.scenario.scanner.exposure / instrument.scenario.scanner.dwell

    def moved(**travel: Any) -> tuple[Any, Any]:
        return instrument.triangulation.travel(instrument.fire(instrument.aim(np.zeros(3), 0.0, **travel))[0])

    assert moved() == (0.0, 0.0)
    assert moved(travel_theta=2e-3) == (pytest.approx(2e-3 * share), 0.0)
    along, across = (np.asarray(way.numpy()) for way in moved(travel_theta=[0.0, 1e-3, 2e-3]))
    np.testing.assert_allclose(along, share * np.array([0.0, 1e-3, 2e-3]), rtol=1e-6)
    np.testing.assert_array_equal(across, 0.0)
    _, across = (np.asarray(way.numpy()) for way in moved(travel_phi=1e-3))
    np.testing.assert_allclose(across, share * 1e-3, rtol=1e-3)
    raster: NDArray[Any] = whole(instrument.scenario).travel_theta
    assert instrument.triangulation.travel(None)[0] == pytest.approx(share * raster[0])


def test_a_scan_has_its_own_aims() -> None:
    """Claim: a raster has the shots at its own angles only, a figure all within its ends, a tracking run none."""
    known = scenario()
    aim = whole(known)
    assert is_of_scan(aim, known)
    for name, values in (
        ("phi", aim.phi + 1e-6),
        ("theta", aim.theta + 1e-6),
        ("shot", aim.shot + np.uint32(ROWS * COLUMNS)),
    ):
        assert not is_of_scan(changed(aim, name, values), known)
    figure = {"type": "spiral", "turns": 4, "radius": 0.2, "points": 64}
    assert is_of_scan(aim, scenario(scan=figure))
    assert not is_of_scan(changed(aim, "phi", aim.phi + 0.1), scenario(scan=figure))
    node = {"type": "track", "targets": ["node"]}
    ball = {
        "name": "node",
        "shape": "sphere",
        "diameter": 0.1,
        "position": (0.0, 0.0, 5.0),
        "material": {"reflectance": 0.5},
    }
    assert not is_of_scan(aim, scenario(scan=node, scene={"objects": [ball]}))


@pytest.mark.parametrize("name", ["theta", "phi"])
def test_an_aim_is_of_a_scan_without_rows_up_to_the_ends_of_its_field(name: str) -> None:
    """Claim: at the ends themselves the background is rendered, beyond them and for visits it is not."""
    ends = {"theta": (-0.1, 0.25), "phi": (-0.3, 0.05)}
    scan = SimpleNamespace(layout="shots", horizontal=ends["theta"], vertical=ends["phi"])
    known: Any = SimpleNamespace(scan=scan, scene=SimpleNamespace(objects=()))
    for values, inside in (
        (ends[name], True),
        (np.nextafter(ends[name], (-1, 0)), False),
        (np.nextafter(ends[name], (0, 1)), False),
    ):
        columns = {"theta": np.array([0.0, 0.1]), "phi": np.array([0.0, -0.1])} | {name: np.asarray(values)}
        aim: Any = SimpleNamespace(**columns)
        assert is_of_scan(aim, known) == inside
    scan.layout = "visits"
    assert not is_of_scan(aim, known)
