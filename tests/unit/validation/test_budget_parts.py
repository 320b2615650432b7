"""The parts of a budget: its sources, instruments with one of them, targets, and how errors become rows."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import load_scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.optics.deflection import ERRORS
from scanner_sim.ranging.believed import Design
from scanner_sim.ranging.calibration import Calibration
from scanner_sim.ranging.ranges import Deflections, Geometry, ranges_with_points
from scanner_sim.scene.objects import Scene
from scanner_sim.validation.studies import budget, budget_sources

Array = NDArray[np.float64]
SUN = {"sun": {"direction": (0.0, 0.0, -1.0)}}


def scenario(columns: int = 5, horizontal: tuple[float, float] = (-0.2, 0.1), **parts: Any) -> Any:
    scan = {"rows": 4, "columns": columns, "horizontal": horizontal, "vertical": (-0.05, 0.15)}
    return load_scenario({"schema": 1, "scan": scan, **parts})


def test_sources_are_what_the_instrument_has() -> None:
    """Claim: each switch, speckle, each error of the mirrors that is not none; the Sun where there is light and shot
    noise to tell it; drift where the temperature changes."""
    usual = set(budget_sources.sources_of(scenario()))
    assert {"shot", "read", "quantisation", "response", "speckle", "estimator", "all"} <= usual
    assert not {"sun", "drift", "clock", "amplifier"} & usual
    lit = scenario(lighting=SUN)
    assert set(budget_sources.sources_of(lit)) == usual | {"sun"}
    blind = scenario(lighting=SUN, scanner={"position_sensor": {"noise": {"shot": False}}})
    assert set(budget_sources.sources_of(blind)) == usual - {"shot"}
    for name, keys in ERRORS.items():
        if name != "drift":
            without = scenario(scanner={"mirrors": dict.fromkeys(keys, 0.0)})
            assert set(budget_sources.sources_of(without)) == usual - {name}
    for course in ({"rate": 1e-3}, {"amplitude": 1.0}):
        warm = scenario(scanner={"mirrors": {"temperature": course, "drift_scale": 1e-4}})
        assert ("drift" in budget_sources.sources_of(warm)) == ("drift" in ERRORS)
    even = scenario(scanner={"laser": {"speckle": False}})
    assert set(budget_sources.sources_of(even)) == usual - {"speckle"}
    timed = scenario(ranging="both", lighting=SUN)
    assert budget_sources.modes_of(timed) == ("triangulation", "tof", "fused")
    assert set(budget_sources.sources_of(timed, "tof")) == {
        "shot", "amplifier", "quantisation", "clock", "sun", "estimator", "all",
    }  # fmt: skip
    assert budget_sources.sources_of(timed, "fused") == ("all",)


UNSTEADY = {
    "vibration": {"shift": ((5.0, 1e-8), (100.0, 1e-10))},
    "power_noise": 0.02,
    "pulse_noise": 0.03,
    "stray_light": 0.1,
}


@pytest.mark.parametrize(
    ("key", "line", "pulses"),
    [
        ("vibration", {"vibration"}, {"vibration"}),
        ("power_noise", {"power"}, set()),
        ("pulse_noise", set(), {"power"}),
        ("stray_light", {"stray"}, set()),
        ("base", set(), set()),
    ],
)
def test_what_is_unsteady_as_built_is_a_source(key: str, line: set[str], pulses: set[str]) -> None:
    """Claim: what shakes, scatters or strays has a row where it reaches a range; stray light has none without the shot
    noise that tells it."""
    built = {"as_built": {key: (UNSTEADY | {"base": 1e-4})[key]}}
    for mode, wanted in (("triangulation", line), ("tof", pulses)):
        usual = set(budget_sources.sources_of(scenario(ranging="both"), mode))  # type: ignore[arg-type]
        found = budget_sources.sources_of(scenario(ranging="both", scanner=built), mode)  # type: ignore[arg-type]
        assert set(found) - usual == wanted
    quiet = built | {"position_sensor": {"noise": {"shot": False}}}
    assert "stray" not in budget_sources.sources_of(scenario(scanner=quiet))


@pytest.mark.parametrize("name", ["shot", "read", "vibration", "power", "stray", "sun", "estimator"])
def test_what_is_unsteady_acts_alone(name: str) -> None:
    """Claim: of what shakes and scatters an instrument has its own source; the spot lacks what strays in all of them,
    and shot noise alone is without the noise of that light, which stays in ``stray`` and ``sun``."""
    known = scenario(ranging="both", scanner={"as_built": UNSTEADY | {"base": 1e-4}})
    made = budget_sources.quietened(known.scanner, name)
    own = made.as_built
    assert own is not None
    assert own.base == 1e-4
    assert (own.vibration is not None) == (name == "vibration")
    assert (own.power_noise, own.pulse_noise) == ((0.02, 0.03) if name == "power" else (None, None))
    stray = own.stray_light or 0.0
    assert stray == (0.0 if name == "shot" else 0.1)
    assert made.laser.power * (1.0 - stray) == pytest.approx(0.9 * known.scanner.laser.power)
    shot = name in ("shot", "sun", "stray")
    assert (made.position_sensor.noise.shot, made.lidar.photodiode.noise.shot) == (shot, shot)
    assert budget_sources.quietened(scenario().scanner, name).as_built is None


@pytest.mark.parametrize(
    "name", ["shot", "read", "quantisation", "response", "speckle", "jitter", "wobble", "estimator"]
)
def test_an_instrument_has_one_source_of_error(name: str) -> None:
    """Claim: one switch of the line, or speckle, or one error of the mirrors, which is 32 times as large where it moves
    the light; dark level and full well stay, as they are no noise that is measured."""
    known = scenario(ranging="both")
    made = budget_sources.quietened(known.scanner, name)
    line = {key for key, value in made.position_sensor.noise if value}
    own = {"shot": "shot", "read": "read", "quantisation": "quantisation", "response": "prnu"}.get(name)
    assert line == {"dark", "saturation", *([own] if own else [])}
    assert made.laser.speckle == (name == "speckle")
    heard = {key for key, value in made.lidar.photodiode.noise if value}
    assert heard & {"shot", "amplifier", "quantisation", "clock"} == {name} & {"shot", "quantisation"}
    for error, keys in ERRORS.items():
        for key in keys:
            factor = 32.0 if error == name and name in ("jitter", "wobble") else float(error == name)
            value = getattr(made.mirrors, key)
            if isinstance(value, float):
                assert value == pytest.approx(factor * getattr(known.scanner.mirrors, key)), key


@pytest.mark.parametrize("name", ["shot", "vibration", "estimator", "drift"])
def test_the_temperature_changes_for_the_drift_alone(name: str) -> None:
    """Claim: what else goes with the temperature, as a base that expands, is no part of another row."""
    course = {"temperature": {"amplitude": 2.0, "rate": 1e-3}, "drift_zero": 1e-6}
    made = budget_sources.quietened(scenario(scanner={"mirrors": course}).scanner, name)
    kept = made.mirrors.temperature
    assert (kept.amplitude, kept.rate) == ((2.0, 1e-3) if name == "drift" else (0.0, 0.0))


@pytest.mark.parametrize(
    ("name", "dark"), [("shot", True), ("stray", True), ("read", False), ("sun", False), ("all", False)]
)
def test_shot_noise_is_that_of_the_laser_in_the_dark(name: str, dark: bool) -> None:
    """Claim: light stays but for shot noise; ``sun`` is shot noise with it; all is the instrument as it is."""
    known = scenario(lighting=SUN, processing={"range_gate": (2.0, 9.0)})
    made = budget._alone(known, name, Scene())
    assert made.lighting.sky().dark == dark
    assert made.processing.range_gate is None
    switched = {key for key, value in made.scanner.position_sensor.noise if value}
    own = {"shot": {"shot"}, "sun": {"shot"}, "stray": {"shot"}, "read": {"read"}}
    assert switched == ({"dark", "saturation"} | own[name] if name != "all" else switched)
    if name == "all":
        assert made.scanner == known.scanner


@pytest.mark.parametrize(("sweep", "columns"), [(2e-3, 5), (1e-3, 101), (0.0999, 5)])
def test_columns_are_as_far_apart_as_the_sweep_that_is_asked_for(sweep: float, columns: int) -> None:
    made = budget.with_sweep(scenario(columns), sweep)
    raster = made.raster
    assert raster.motion == "continuous"
    assert raster.travel == pytest.approx(sweep)
    assert raster.columns == columns
    assert sum(raster.horizontal) == 0.0
    assert budget.with_sweep(scenario(), 0.0).raster.motion == "stepped"
    assert budget.with_sweep(scenario(), None).raster == scenario().raster
    for wrong in (-1e-9, 0.1):
        with pytest.raises(InputError, match=r"between 0 and 0\.1 rad"):
            budget.with_sweep(scenario(), wrong)


@pytest.mark.parametrize("travel", [0.0, 2e-3, 0.03, 0.06])
def test_a_raster_over_the_target_has_the_scenarios_sweep_and_shots_enough(travel: float) -> None:
    """Claim: columns as far apart as the scenario's within ±0.05 rad, two at least; as many rows as make 22² shots of
    22 columns at most."""
    known = budget.with_sweep(scenario(), travel)
    made = budget._raster(known)
    assert made.travel == pytest.approx(travel)
    first, last = made.horizontal
    assert first == -last
    assert made.vertical == (-0.05, 0.05)
    if travel:
        assert made.columns == max(2, int(0.1 / travel + 1e-9) + 1)
        assert last - first == pytest.approx(travel * (made.columns - 1))
    else:
        assert (made.columns, last) == (22, 0.05)
    used = min(22, made.columns)
    assert made.rows * used >= 22**2 > (made.rows - 1) * used
    aim = budget._aim(known)
    assert aim.theta.size == made.rows * used
    # As far apart as there is room.
    assert np.unique(aim.theta.round(12)).size == used
    assert aim.theta.max() - aim.theta.min() == pytest.approx(last - first, rel=1e-6)
    assert np.unique(aim.phi.round(12)).size == made.rows


@pytest.mark.parametrize("distance", [2.0, 25.0])
def test_a_plate_holds_all_that_is_lit_and_little_more(distance: float) -> None:
    """Claim: the field, a sweep to each side, and four radii of the beam beyond; a tenth larger, square to the axis.
    It has poses of its own, so that each lane has it elsewhere, and rests."""
    known = budget.with_sweep(scenario(), 0.06)
    raster, radius = budget._raster(known), known.scanner.laser.radius(distance)
    half = max(0.05, raster.horizontal[1]) + 0.06
    needed = 2.0 * (half * distance + 4.0 * radius)
    assert budget._size(known, distance) == pytest.approx(1.1 * needed)
    (plate,) = budget._plate(distance, 0.7, 0.3).objects
    assert plate.size == (0.7, 0.7)
    assert plate.material.reflectance == 0.3
    assert plate.moves
    pose = np.eye(4)
    pose[2, 3] = distance
    np.testing.assert_array_equal(plate.pose_at(np.array([0.0, 70.0])), [pose, pose])


def test_a_course_of_time_is_a_period_or_the_scan_and_long_enough() -> None:
    """Claim: the longest of the scan (or a period of the temperature) and 22² times twice the time of a wobble."""
    known = scenario()
    mirrors, raster = known.scanner.mirrors, known.raster
    least = 2.0 * mirrors.wobble_time * 484.0
    assert budget.course_time(known) == pytest.approx(max(raster.shots * known.scanner.dwell, least))
    course = {"mirrors": {"temperature": {"amplitude": 1.0, "period": 5000.0}}}
    assert budget.course_time(scenario(scanner=course)) == pytest.approx(5000.0)
    # √2 K of amplitude have a root mean square of 1 K over a period; a rate r over a time T has r T/√3.
    temperature = SimpleNamespace(difference=lambda t: math.sqrt(2.0) * np.sin(2.0 * np.pi * t / 5000.0))
    assert budget.kelvins_of(SimpleNamespace(temperature=temperature), 5000.0) == pytest.approx(1.0)  # type: ignore[arg-type]
    temperature = SimpleNamespace(difference=lambda t: 2e-3 * t)
    assert budget.kelvins_of(SimpleNamespace(temperature=temperature), 900.0) == pytest.approx(  # type: ignore[arg-type]
        1.8 / math.sqrt(3.0), rel=2e-3
    )


def test_kelvins_of_a_course_are_taken_at_even_moments() -> None:
    """Claim: the moments are 1024, each as long after the other, from 0 to one step before the end, so that a whole
    period counts each of its parts once: the root mean square of A sin is A/√2."""
    asked: list[Array] = []

    def difference(times: Array) -> Array:
        asked.append(times)
        return np.asarray(3.0 * np.sin(2.0 * np.pi * times / 70.0))

    mirrors: Any = SimpleNamespace(temperature=SimpleNamespace(difference=difference))
    assert budget.kelvins_of(mirrors, 70.0) == pytest.approx(3.0 / math.sqrt(2.0), rel=1e-12)
    (times,) = asked
    np.testing.assert_allclose(times, 70.0 * np.arange(1024) / 1024, rtol=1e-12)


def test_ranges_of_one_instrument_are_read_by_another() -> None:
    """Claim: the shots are those of the instrument that is, with the seeds and poses of their lanes; peaks and echoes
    are found, and ranges made of them, by the one that it takes itself for; errors are less the true ranges."""
    asked: list[Any] = []
    truth = SimpleNamespace(distance=SimpleNamespace(numpy=lambda: np.array([5.0, 6.0, 7.0], np.float32)))
    aim: Any = SimpleNamespace(shot=np.arange(3, dtype=np.uint32))

    def ranged(*given: Any) -> Any:
        asked.append(given)
        return SimpleNamespace(range=np.array([5.5, 6.25, 6.0]))

    line = SimpleNamespace(position="peaks", sigma="sigmas", status="statuses")
    group = SimpleNamespace(index=np.arange(3), delays=SimpleNamespace())
    own: Any = SimpleNamespace(
        fire=lambda *given: (("shots", *given[1:]), "pointing"),
        deflections=lambda given, pointing, seeds: ("turned", pointing, seeds),
        triangulation=SimpleNamespace(expose=lambda shots: asked.append(shots) or (truth, "groups")),
        time_of_flight=SimpleNamespace(
            listen=lambda shots, detector: asked.append((shots, detector)) or (truth, None, [group])
        ),
    )
    by_line = SimpleNamespace(
        gathered=lambda count, groups: asked.append((count, groups)) or line, ranges=ranged
    )
    by_time = SimpleNamespace(
        detector="detector",
        unit=SimpleNamespace(digitiser="digitiser"),
        ranges=lambda delays, turned: ranged(turned),
    )
    targets: Any = object.__new__(budget._Targets)
    targets.aim, targets.seeds, targets.poses = aim, "seeds", "poses"
    targets.assumed = SimpleNamespace(triangulation=by_line, time_of_flight=by_time)
    turned, shots = ("turned", "pointing", "seeds"), ("shots", "seeds", "poses")
    made = targets._by_line(own)
    np.testing.assert_allclose(made.error, [0.5, 0.25, -1.0])
    assert made.deflections == turned
    assert own.triangulation.reader is by_line
    assert asked == [shots, (3, "groups"), ("peaks", "sigmas", "statuses", turned)]
    asked.clear()
    filled: list[Any] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(budget.EchoDelays, "fill", lambda _, *given: filled.append(given))
        np.testing.assert_allclose(targets._by_time(own).error, [0.5, 0.25, -1.0])
    assert asked == [(shots, "detector"), (turned,)]
    assert filled == [(group.index, group.delays, "digitiser")]


@pytest.mark.parametrize(("zero", "error"), [(None, 0.03), (math.sqrt(0.03), 0.15)])
def test_fused_errors_are_weighted_by_both_sigmas(zero: float | None, error: float) -> None:
    """Claim: of 10.4 m ± 0.2 and 10.0 m ± 0.1 the fused range is (10.4/4 + 10)/(5/4) = 10.08 m; less the true 10.05.
    Where the calibration leaves the zero of the time of flight open by √0.03, both have ± 0.2, as in a scan: 10.2 m."""
    known = None
    if zero is not None:
        covariance = np.zeros((len(NAMES), len(NAMES)))
        covariance[INDEX["tof_zero"], INDEX["tof_zero"]] = zero**2
        known = Calibration(np.zeros(len(NAMES)), covariance, Design(0.05, 0.2, 0.05))
    geometry = Geometry(0.05, 0.2, 0.05, 2e-5, 0.0, 0.0, calibration=known)
    one, exact = np.ones(3), np.zeros(3)
    deflections = Deflections(exact, exact, exact, exact)
    target = object.__new__(budget._Targets)
    target.shape = (1, 1)
    target.assumed = cast("Any", SimpleNamespace(geometry=geometry))

    def measured(mode: str, name: str) -> Any:
        assert name == "all"
        value, sigma = {"triangulation": (10.4, 0.2), "tof": (10.0, 0.1)}[mode]
        status = np.zeros(3, dtype=np.uint32)
        ranges = ranges_with_points(
            value * one, sigma * one, status, sigma * one, exact, deflections, geometry
        )
        return SimpleNamespace(truth=10.05 * one, ranges=ranges, deflections=deflections)

    target._measured = measured  # type: ignore[method-assign]
    np.testing.assert_allclose(target.errors("fused", "all"), error, atol=1e-12)


def test_a_budget_gathers_errors_by_way_source_and_distance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: errors at places about a distance are carried to it, as R² by triangulation, its bias as R, those of time
    of flight as they are; each place has a seed of its own, each step is told of, rows go by way and source."""
    known = scenario(ranging="both")
    seeds: list[int] = []
    sign = np.where(np.arange(100) % 2 == 0, 1.0, -1.0) * math.sqrt(0.99)

    class Targets:
        def __init__(self, *given: Any) -> None:
            _, _, self.where, own, grey, _ = given
            assert grey == 0.3
            seeds.extend(own)

        def errors(self, mode: str, name: str) -> Array:
            # Grows as it is carried, so that every place has the same at the distance.
            power = {"triangulation": 1.0 if name == "estimator" else 2.0}.get(mode, 0.0)
            each = np.ones(100) if name == "estimator" else sign
            return np.asarray(1e-3 * self.where[..., None] ** power * each)

    monkeypatch.setattr(budget, "Instrument", lambda *_, **__: None)
    monkeypatch.setattr(budget, "_Targets", Targets)
    monkeypatch.setattr(budget, "_pixel_phases", lambda _, R: iter((0.97 * R, 0.99 * R, 1.01 * R, 1.03 * R)))
    monkeypatch.setattr(
        budget, "sources_of", lambda _, mode: {"fused": ("all",)}.get(mode, ("read", "estimator"))
    )
    steps: list[tuple[int, int]] = []
    rows = budget.measure_budget(known, np.array([4.0, 9.0]), 0.3, progress=lambda *done: steps.append(done))
    assert [(row.mode, row.source, row.range_m) for row in rows] == [
        (mode, source, distance)
        for mode, source in (
            ("triangulation", "read"), ("triangulation", "estimator"), ("tof", "read"), ("tof", "estimator"),
            ("fused", "all"),
        )
        for distance in (4.0, 9.0)
    ]  # fmt: skip
    wanted = [16e-3, 81e-3, 4e-3, 9e-3, 1e-3, 1e-3, 1e-3, 1e-3]
    assert [row.simulated_m for row in rows[:8]] == pytest.approx(wanted)
    # Of all errors together the mean counts, too: n in the denominator.
    assert [row.simulated_m for row in rows[8:]] == pytest.approx([1e-3 * math.sqrt(0.99)] * 2)
    assert len(set(seeds)) == 8
    # Both distances together, each way and source by itself.
    assert steps == [(number + 1, 5) for number in range(5)]


@pytest.mark.parametrize("stray", [False, True])
def test_light_counts_by_what_it_adds(monkeypatch: pytest.MonkeyPatch, stray: bool) -> None:
    """Claim: errors ±3 by the laser, ±5 with what strays, ±13 with the Sun as well: stray light adds 4, the Sun 12 to
    both, or √160 to the laser's alone."""
    sizes = {"shot": 3.0, "stray": 5.0, "sun": 13.0}
    sign = np.where(np.arange(100) % 2 == 0, 1e-3, -1e-3).reshape(1, 1, 100)
    made = SimpleNamespace(errors=lambda mode, name: sizes[name] * sign)
    monkeypatch.setattr(budget, "Instrument", lambda *_, **__: None)
    monkeypatch.setattr(budget, "_Targets", lambda *_: made)
    monkeypatch.setattr(budget, "_pixel_phases", lambda _, R: iter((R,)))
    names = ("shot", *(["stray"] if stray else []), "sun")
    monkeypatch.setattr(budget, "sources_of", lambda *_: names)
    rows = budget.measure_budget(scenario(), np.array([5.0]), 0.3)
    wanted = {"stray": 4.0, "sun": 12.0 if stray else math.sqrt(160.0)}
    for row in rows[1:]:
        assert row.simulated_m == pytest.approx(1e-3 * wanted[row.source])


def test_each_way_of_ranging_measures_by_its_own_detector(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of one source alone the instrument of that source, on the light of all; what is quiet, and all together,
    are measured once; errors of sources are less those of the quiet one."""
    asked: list[tuple[Any, ...]] = []

    def ranged(way: str) -> Any:
        def found(_: Any, instrument: Any) -> Any:
            asked.append((way, instrument))
            size = {"tof": 3.0, "line": 5.0}[way]
            return SimpleNamespace(error=np.array([size * len(instrument[0])]))

        return found

    monkeypatch.setattr(budget._Targets, "_by_time", ranged("tof"))
    monkeypatch.setattr(budget._Targets, "_by_line", ranged("line"))
    monkeypatch.setattr(budget, "_alone", lambda scenario, name, scene: (name, scenario, scene))
    monkeypatch.setattr(
        budget, "Instrument", lambda made, *, device, reuse: (made[0], made[1:], device, reuse)
    )
    target: Any = object.__new__(budget._Targets)
    known = SimpleNamespace(scene="scene")
    target.scenario, target.device, target.lit = known, "cpu", ("all", "lit")
    target.shape, target._kept = (1, 1), {}
    for mode, way, size in (("tof", "tof", 3.0), ("triangulation", "line", 5.0)):
        quiet = len(budget_sources.QUIET)
        assert target.errors(mode, "read") == pytest.approx(size * (4 - quiet))
        assert target.errors(mode, budget_sources.ALL) == pytest.approx(size * len(budget_sources.ALL))
        assert target.errors(mode, "shot+read") == pytest.approx(size * (9 - quiet))
        names = [(asked_way, instrument[0]) for asked_way, instrument in asked]
        assert names == [
            (way, "read"),
            (way, budget_sources.QUIET),
            (way, budget_sources.ALL),
            (way, "shot+read"),
        ]
        assert asked[0] == (way, ("read", (known, "scene"), "cpu", ("all", "lit")))
        asked.clear()
