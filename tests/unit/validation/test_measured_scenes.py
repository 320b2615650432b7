"""What laws of whole scenes ask of the instrument, and what they make of errors that are known."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_settings import Array, setting

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.status import Status
from scanner_sim.validation.compare import (
    coverage,
    mixed_scenes,
    test_bench,
    uneven,
)
from scanner_sim.validation.compare.mixed_scenes import MixedCoverage, MixedScene

# Scenes with more than one surface.


def test_shares_of_pulls_are_counted_at_their_bounds() -> None:
    """Claim: what is within 1.96 σ, beyond 3 and beyond 6; the share of hits that have a range; what has no truth is
    left out, and an image without ranges has no shares."""
    pulls = np.array([0.0, 1.9599, -1.96, 2.99, -3.01, 5.99, -6.01, 7.0])
    found = MixedCoverage(pulls, 1.0).shares()
    assert found == pytest.approx((2 / 8, 4 / 8, 2 / 8))
    assert all(math.isnan(one) for one in MixedCoverage(np.array([]), 0.0).shares())

    class Image(dict[str, Any]):
        valid = np.array([True, True, False, True, False])

    image: Any = Image(
        {
            "range_m": np.array([10.2, 9.9, math.nan, 10.0, math.nan]),
            "sigma_range_m": np.array([0.1, 0.05, math.nan, 0.1, math.nan]),
            "truth.range_m": np.array([10.0, 10.0, 10.0, math.nan, math.nan]),
            "truth.object": np.array([1, 2, 1, 0, 0]),
        }
    )
    made = MixedCoverage.of(image)
    np.testing.assert_allclose(made.pulls, [2.0, -2.0])
    assert made.kept == pytest.approx(2 / 3)


def test_scenes_are_drawn_evenly_in_logarithms() -> None:
    """Claim: of 400 scenes ranges and pitches, 0.25 to 2 mrad, are even in logarithms, and 70 % sweep; to 4 standard
    errors of means and of a share."""
    drawn = [MixedScene.drawn("clutter", seed, ranges=(2.0, 8.0)) for seed in range(400)]
    for values, low, high in (
        ([one.distance for one in drawn], 2.0, 8.0),
        ([one.pitch / one.distance for one in drawn], 0.25e-3, 2e-3),
    ):
        place = (np.log(values) - math.log(low)) / math.log(high / low)
        assert 0.0 <= place.min() < 0.02 < 0.98 < place.max() <= 1.0
        assert abs(place.mean() - 0.5) < 4.0 / math.sqrt(12.0 * 400.0)
    sweeps = np.mean([one.motion == "continuous" for one in drawn])
    assert abs(sweeps - 0.7) < 4.0 * math.sqrt(0.21 / 400.0)
    assert {one.tilt for one in drawn} == {math.radians(50.0)}
    # The same seed is the same scene: of the generator of seed 7 and 99 range, pitch and motion come in this order.
    random = np.random.default_rng([7, 99])
    range_, pitch, motion = random.uniform(math.log(2.0), math.log(8.0)), random.uniform(), random.random()
    assert drawn[7].distance == pytest.approx(math.exp(range_), rel=1e-12)
    assert drawn[7].pitch == pytest.approx(math.exp(range_) * 0.25e-3 * 8.0**pitch, rel=1e-12)
    assert (drawn[7].motion == "continuous") == (motion < 0.7)
    one = drawn[0]
    assert one.half == pytest.approx(0.5 * 127.0 * one.pitch / one.distance)


@pytest.mark.parametrize("kind", ["clutter", "glossy", "sunlit", "retro"])
def test_clutter_fills_the_field_before_a_wall(kind: Any) -> None:
    """Claim: twelve boxes and spheres of a tenth to four tenths of the field, within half of it from the middle; a wall
    behind them that leaves a gap above; materials of the kind, turns about three axes."""
    scene = MixedScene(kind, 3, distance=5.0, pitch=8e-3, side=64, speed=0.2)
    made = scene.scenario()
    wide = 63 * 8e-3
    (wall, *items), sun = made.scene.objects, made.lighting.sun
    assert len(items) == 12
    assert wall.size == pytest.approx((1.1 * wide, 0.8 * wide))
    assert wall.position == pytest.approx((0.0, 0.15 * wide, 5.0 + 0.6 * wide))
    assert max(abs(turn.angle) for turn in wall.rotation) <= math.radians(40.0)
    for item in items:
        away = np.array(item.position) - [0.0, 0.0, 5.0]
        assert np.abs(away).max() <= 0.5 * wide
        assert len(set(np.round(away, 9))) == 3  # the three are drawn apart
        sizes = [item.diameter] if item.shape == "sphere" else list(item.size)
        assert 0.1 * wide <= min(sizes) <= max(sizes) <= 0.4 * wide
        assert tuple(item.motion.velocity) == (0.2, 0.0, 0.0)
    assert {item.shape for item in items} == {"box", "sphere"}
    assert (sun != "none") == (kind == "sunlit")
    if kind == "sunlit":
        assert sun.direction[2] < 0.0
        assert made.lighting.earth.direction == (0.0, 1.0, 0.0)
    materials = {str(item.material) for item in (wall, *items)}
    if kind == "clutter":
        assert all(item.material.reflectance == 0.5 for item in (wall, *items))
    else:
        assert len(materials) > 1
    assert (made.raster.rows, made.raster.columns) == (64, 64)
    assert made.raster.horizontal == pytest.approx((-0.5 * wide / 5.0, 0.5 * wide / 5.0))
    assert made.raster.vertical == made.raster.horizontal
    assert made.seed == 3


def test_shares_of_glossy_and_retroreflecting_surfaces() -> None:
    """Claim: half of the glossy kind shine, 30 % of the other return light; of 2000 draws to 4 standard errors."""
    random = np.random.default_rng(5)
    shiny = [mixed_scenes._material(random, "glossy") in mixed_scenes._SHINY for _ in range(2000)]
    retro = [mixed_scenes._material(random, "retro") == "retro_sheet" for _ in range(2000)]
    assert abs(np.mean(shiny) - 0.5) < 4.0 * math.sqrt(0.25 / 2000.0)
    assert abs(np.mean(retro) - 0.3) < 4.0 * math.sqrt(0.21 / 2000.0)
    turns = np.array([[turn["angle"] for turn in mixed_scenes._turns(random, 0.5)] for _ in range(300)])
    assert np.abs(turns).max() <= 0.5
    assert (turns.min(axis=0) < -0.45).all()
    assert (turns.max(axis=0) > 0.45).all()
    assert [turn["axis"] for turn in mixed_scenes._turns(random, 0.5)] == ["x", "y", "z"]


def test_uneven_spots_are_measured_in_rasters_of_the_beam(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: middles from 1.6 to 6.4 times the nearest range, voxels one to three radii of the beam apart, stripes of
    1.5 to 11 radii; seed, scene, scan and light are those of what was drawn, the instrument is the scenario's."""
    told = setting(ranging="both", processing={"range_gate": (2.0, 9.0)})
    near = told.scenario.scanner.nearest_range
    assert uneven._ranges(told) == pytest.approx((1.6 * near, 6.4 * near))
    far = 0.9 * told.scenario.scanner.farthest_range
    assert 6.4 * near < far
    seen: list[Any] = []

    def of(image: Any) -> Any:
        return image

    monkeypatch.setattr(uneven.MixedCoverage, "of", of)
    monkeypatch.setattr(uneven, "simulate", lambda scenario, device: seen.append(scenario))
    real = MixedScene.scenario
    drawn: list[Any] = []

    def kept(scene: Any, **changes: Any) -> Any:
        drawn.append(scene)
        return real(scene, **changes)

    monkeypatch.setattr(MixedScene, "scenario", kept)
    for seed in range(12):
        uneven._scene(told, "stripes", seed)
    places = []
    for seed, (made, scene) in enumerate(zip(seen, drawn, strict=True)):
        beam = told.scenario.scanner.laser.radius(scene.distance)
        assert 1.6 * near <= scene.distance <= 6.4 * near
        places.append(math.log(scene.pitch / beam) / math.log(3.0))
        assert scene.widths == pytest.approx((1.5 * beam, 11.0 * beam))
        assert (made.seed, made.scan.rows, scene.side) == (seed, 64, 64)
        assert made.rangefinders == ("triangulation",)
        assert made.processing.range_gate is None
        assert made.scan.horizontal == pytest.approx((-scene.half, scene.half))
        assert len(made.scene.objects) > 1
    assert min(places) >= 0.0
    assert max(places) <= 1.0
    assert max(places) - min(places) > 0.5


@pytest.mark.parametrize("lit", [False, True])
@pytest.mark.parametrize("kind", ["clutter", "stripes", "glossy", "sunlit"])
def test_the_sun_shines_on_the_sunlit_scenes_alone(
    monkeypatch: pytest.MonkeyPatch, kind: Any, lit: bool
) -> None:
    """Claim: whatever light the compared scenario has, the Sun is where it was drawn, and the other kinds are dark."""
    told = setting(lighting={"sun": {"direction": (0.0, 1.0, 0.0)}} if lit else {})
    seen: list[Any] = []
    monkeypatch.setattr(uneven, "simulate", lambda scenario, device: seen.append(scenario))
    monkeypatch.setattr(uneven.MixedCoverage, "of", lambda image: image)
    uneven._scene(told, kind, 3)
    (made,) = seen
    assert made.lighting.sky().dark == (kind != "sunlit")
    if kind == "sunlit":
        assert -1.0 <= made.lighting.sun.direction[2] <= -0.3
        assert made.lighting.earth.direction == (0.0, 1.0, 0.0)


def test_kinds_of_scenes_are_judged_by_those_that_have_ranges(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the mean over scenes of the shares, of those with a hundred ranges or more, and of two such at least."""
    told = setting()
    many, few = np.zeros(100), np.zeros(99)
    asked = []

    def scene(_: Any, kind: str, seed: int) -> MixedCoverage:
        asked.append((kind, seed))
        number = len([one for one in asked if one[0] == kind]) - 1
        if kind == "glossy":
            return MixedCoverage(many if number == 0 else few, 1.0)
        pulls = many.copy()
        pulls[: {0: 10, 1: 20}.get(number, 0)] = 4.0
        pulls[:1] = 7.0
        return MixedCoverage(pulls if number < 2 or kind != "stripes" else few, 1.0)

    monkeypatch.setattr(uneven, "_scene", scene)
    found = uneven._measure(told)
    assert {case.split(":")[0] for case in found} == {"clutter", "stripes", "sunlit"}
    assert found["stripes: within 1.96 σ"].value == pytest.approx(0.85)
    assert found["stripes: beyond 3 σ"].value == pytest.approx(0.15)
    assert found["stripes: beyond 6 σ"].value == pytest.approx(0.01)
    # Sixteen scenes, of which 14 have one beyond.
    assert found["clutter: beyond 3 σ"].value == pytest.approx((0.1 + 0.2 + 14 * 0.01) / 16.0)
    assert len({seed for _, seed in asked}) == len(asked) == 64


# Coverage.


def test_voxels_of_a_scene_are_drawn_once_each_in_the_order_of_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of 16 voxels all, of more as many as are wanted, none twice; every seed has random numbers of its own."""
    told = setting()
    monkeypatch.setattr(coverage, "_DRAWN", 10)
    seen: list[Any] = []

    class Made:
        def __init__(self, scenario: Any, *, reuse: Any = None, **_: Any) -> None:
            self.scenario, self.reuse = scenario, reuse

        def measure(self, aim: Any) -> Any:
            seen.append((self.scenario.seed, aim.shot))
            return {"status": np.zeros(aim.shot.size)}

    monkeypatch.setattr(coverage, "Instrument", Made)
    monkeypatch.setattr(
        coverage, "_smooth",
        lambda known, own, aim, layers: (known is told) & np.full(aim.shot.size, own.scenario.seed in (5, 6)),
    )  # fmt: skip
    monkeypatch.setattr(coverage, "_unclipped", lambda own, layers: np.arange(layers["status"].size) > 3)
    found = list(coverage._on_scene(told, (5, 6), "triangulation"))
    assert [seed for seed, _ in seen] == [5, 6]
    for _, shots in seen:
        assert len(set(shots.tolist())) == 10
        assert (np.diff(shots.astype(int)) > 0).all()
        assert shots.max() < 16
    assert not np.array_equal(seen[0][1], seen[1][1])
    assert found[0][1].sum() == 6


@pytest.mark.parametrize(
    ("what", "good"),
    [
        ("plane", True),
        ("bent", False),
        ("hardly bent", True),
        ("steep", False),
        ("less steep", True),
        ("another object", False),
        ("another material", False),
        ("grainy", False),
        ("no range", False),
        ("no truth", False),
    ],
)
def test_smooth_is_what_lies_on_one_plane_of_known_speckle(
    monkeypatch: pytest.MonkeyPatch, what: str, good: bool
) -> None:
    """Claim: beside the axis by the beam's diameter and half of the travel, along both axes, object and material are
    the same, the range bends by less than a fifth of σ and rises by less than tan 60° of it; contrast as assumed."""
    told = setting()
    scanner, R = told.scenario.scanner, np.array([9.0, 9.0])
    apart = 2.0 * scanner.laser.radius(9.0) / 9.0 + 0.5e-3
    sigma = 1e-3
    bend = {"bent": 0.101, "hardly bent": 0.099}.get(what, 0.0) * sigma
    rise = {"steep": 1.001, "less steep": 0.999}.get(what, 0.5) * math.tan(math.radians(60.0)) * apart * 9.0
    status = np.array([0.0, float(Status.BELOW_THRESHOLD) if what == "no range" else 0.0])
    layers = {
        "status": status,
        "truth.range_m": np.array([9.0, math.nan if what == "no truth" else 9.0]),
        "truth.material": np.array([1.0, 2.0]),
        "truth.object": np.array([4.0, 4.0]),
        "sigma_range_m": np.full(2, sigma),
    }
    contrast = np.full(3, told.scenario.processing.speckle_contrast)
    contrast[2] += 1.01e-3 if what == "grainy" else 0.99e-3
    instrument: Any = SimpleNamespace(
        loaded=SimpleNamespace(coherence=SimpleNamespace(numpy=lambda: contrast**2))
    )
    aim: Any = SimpleNamespace(travel_theta=np.array([1e-3, -1e-3]))
    asked = []

    def truth(_: Any, aim: Any, some: Any, axis: str, moved: Array) -> tuple[Array, ...]:
        asked.append((axis, moved))
        np.testing.assert_allclose(np.abs(moved), apart, rtol=1e-6)
        side = np.sign(moved)
        spoilt = (axis == "phi") & (some == 1)
        ranges = R[some] + np.where(spoilt, bend + side * rise, 0.0)
        other = np.where(spoilt & (side > 0.0), 1.0, 0.0)
        return (
            ranges,
            4.0 + (other if what == "another object" else 0.0),
            layers["truth.material"][some] + (other if what == "another material" else 0.0),
        )

    monkeypatch.setattr(coverage, "_truth", truth)
    found = coverage._smooth(told, instrument, aim, layers)
    assert found.tolist() == [True, good]
    assert {axis for axis, _ in asked} == {"theta", "phi"}


def test_a_moved_shot_is_moved_along_one_axis(monkeypatch: pytest.MonkeyPatch) -> None:
    aim = test_bench.directions([0.1, 0.2, 0.3], [0.01, 0.02, 0.03], setting().scenario.scanner.mirrors, 1e-3)
    seen: list[Any] = []

    def expose(moved: Any) -> Any:
        seen.append(moved)
        held = [SimpleNamespace(numpy=lambda n=n: np.array([n, n])) for n in (7.0, 2.0, 3.0)]
        return SimpleNamespace(distance=held[0], object=held[1], material=held[2]), None

    found = coverage._truth(
        SimpleNamespace(expose=expose), aim, np.array([0, 2]), "phi", np.array([1e-3, -1e-3])
    )  # type: ignore[arg-type]
    np.testing.assert_allclose(found, [[7.0, 7.0], [2.0, 2.0], [3.0, 3.0]])
    np.testing.assert_allclose(seen[0].theta, [0.1, 0.3])
    np.testing.assert_allclose(seen[0].phi, [0.011, 0.029])
    assert seen[0].shot.tolist() == [0, 2]


@pytest.mark.parametrize(("height", "kept"), [(0.949, True), (0.951, False)])
def test_echoes_that_may_be_clipped_are_left_out(height: float, kept: bool) -> None:
    """Claim: of time of flight alone, those below 0.95 of the amplifier's saturation, in amperes."""
    unit = SimpleNamespace(
        amperes_per_electron=2e-9, unit=SimpleNamespace(photodiode=SimpleNamespace(saturation=1e-3))
    )
    layers = {"Y": np.array([height * 1e-3 / 2e-9])}
    timed: Any = SimpleNamespace(scenario=SimpleNamespace(rangefinders=("tof",)), time_of_flight=unit)
    assert coverage._unclipped(timed, layers).tolist() == [kept]
    both: Any = SimpleNamespace(scenario=SimpleNamespace(rangefinders=("triangulation", "tof")))
    assert coverage._unclipped(both, layers).tolist() == [True]


@pytest.mark.parametrize(("shots", "reason"), [(160, ""), (159, "159 voxels only")])
def test_a_scene_needs_four_times_the_fewest_voxels(shots: int, reason: str) -> None:
    told: Any = SimpleNamespace(
        scenario=SimpleNamespace(
            scanner=SimpleNamespace(
                mirrors=SimpleNamespace(temperature=SimpleNamespace(rate=0.0, amplitude=0.0))
            ),
            scan=SimpleNamespace(layout="image", shots=shots),
        ),
        own_scene=True,
    )
    said = coverage._surveyed(told)
    assert (reason in said) if reason else not said
    told.scenario.scanner.mirrors.temperature.amplitude = 1.0
    assert "drift" in coverage._surveyed(told)


def test_every_seed_of_a_scene_has_errors_of_the_mirrors_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a scenario whose light has a seed of its own is judged without it, as seeds are the samples."""
    made: list[Scenario] = []

    def noted(scenario: Scenario, **_: object) -> None:
        made.append(scenario)
        raise InterruptedError

    monkeypatch.setattr(coverage, "Instrument", noted)
    monkeypatch.setattr(uneven, "simulate", noted)
    told = setting(transport={"light_seed": 5})
    for measure in (
        lambda: next(coverage._on_planes(told, (1, 2), "triangulation")),
        lambda: next(coverage._on_scene(told, (1, 2), "triangulation")),
        lambda: uneven._scene(told, "clutter", 3),
    ):
        with pytest.raises(InterruptedError):
            measure()
    assert [one.transport.light_seed for one in made] == [None] * 3
