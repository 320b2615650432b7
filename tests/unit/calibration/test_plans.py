"""Plans of self-calibrations: their faults, their fields, and what of a field cannot be adjusted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from calibration_fields import DESIGN, made_field
from scipy.spatial.transform import Rotation

from scanner_sim import load_scenario
from scanner_sim.calibration import selfcal
from scanner_sim.calibration.adjustment import Adjusted, adjust
from scanner_sim.calibration.network import FEWEST
from scanner_sim.calibration.plan import Standing
from scanner_sim.calibration.report import report
from scanner_sim.calibration.selfcal import _has_views, self_calibrate
from scanner_sim.calibration.setup import Setup, common_of, field_of, read_setup, reading_slopes
from scanner_sim.calibration.tables import SightingTable
from scanner_sim.foundation.errors import InputError, ScenarioError
from scanner_sim.ranging.believed import believed_points
from scanner_sim.ranging.coordinates import angles_and_range, coordinates
from scanner_sim.scene.poses import placement_matrix

PLAN = """\
schema: 1
base: base.yaml
seed: 4
parameters: {base: 0.1 mm, theta_zero: 0.2 mrad}
survey: 0.1 mm
boards:
  - {name: near, array: {rows: 3, columns: 3, spacing: [0.2 m, 0.2 m], diameter: 50 mm, plate: 0.1 m},
     position: [0 m, 0 m, 2 m]}
  - {name: far, array: {rows: 2, columns: 3, spacing: [0.3 m, 0.3 m], diameter: 80 mm, plate: 0.2 m},
     position: [0.5 m, 0 m, 4 m]}
stations: [{name: s1}, {name: s2, position: [0.2 m, 0 m, -0.3 m]}]
"""
BASE = "schema: 1\nscan: {type: raster, rows: 4, columns: 4, horizontal: [-5 deg, 5 deg], vertical: [-5 deg, 5 deg]}\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "base.yaml").write_text(BASE, encoding="utf-8")
    return tmp_path


def setup_of(folder: Path, *changes: tuple[str, str]) -> Setup:
    text = PLAN
    for was, now in changes:
        assert was in text
        text = text.replace(was, now)
    (folder / "plan.yaml").write_text(text, encoding="utf-8")
    return read_setup(folder / "plan.yaml")


def exact(setup: Setup) -> SightingTable:
    """Return sightings without errors of every target from every station."""
    station, target, position = [], [], []
    for one in setup.plan.stations:
        pose = one.field_from_here()
        points = (setup.standing - pose[:3, 3]) @ pose[:3, :3]
        r, theta, phi = angles_and_range(
            points[:, 0], points[:, 1], points[:, 2], setup.design.axis_separation
        )
        station += [one.name] * len(points)
        target += setup.names
        position.append(np.stack([theta, phi, r], axis=1))
    places = np.concatenate(position)
    covariance = np.tile(np.diag([1e-10, 1e-10, 1e-8]), (len(places), 1, 1))
    none = np.zeros(len(places))
    return SightingTable(
        tuple(station), tuple(target), places, covariance, none, none, none + 1.0, none, none
    )


def some(table: SightingTable, kept: list[int]) -> SightingTable:
    """Return some sightings of a table."""
    return SightingTable(
        tuple(table.station[i] for i in kept),
        tuple(table.target[i] for i in kept),
        *(
            getattr(table, name)[kept]
            for name in ("position", "covariance", "pixels", "image", "image_width", "wobble", "time")
        ),
    )


@pytest.mark.parametrize(
    ("was", "now", "words"),
    [
        ("base: 0.1 mm", "base: 0.1", "parameters.base: 0.1 has no unit"),
        ("base: 0.1 mm", "bse: 0.1 mm", "parameters.bse: there is no such key. Did you mean 'base'?"),
        ("base: 0.1 mm, ", "tof_zero: 1 mm, ", "parameters.tof_zero: triangulation does not see it"),
        ("{base: 0.1 mm, theta_zero: 0.2 mrad}", "{}", "parameters: nothing is looked for"),
        ("base: 0.1 mm, ", "phi_sine: 1 urad, ", "encoder_period: the encoders' periodic errors need"),
        ("name: far", "name: near", "boards[1].name (object 'near'): 'near' is there already"),
        ("{name: s1}", "{name: s2}", "stations[1].name (object 's2'): 's2' is there already"),
        (
            "stations: [{name: s1}, {name: s2, position: [0.2 m, 0 m, -0.3 m]}]",
            "",
            "stations: there are none",
        ),
        (
            "position: [0.5 m",
            "points: base.yaml, position: [0.5 m",
            "is none of the kinds that are read here: .csv",
        ),
        ("[{name: s1}", "[{name: s1, held_out: true}", ""),
        (
            "position: [0 m, 0 m, 2 m]",
            "diameter: 50 mm, position: [0 m, 0 m, 2 m]",
            "boards[0].diameter (object 'near'): it is that of the array. Write array.diameter.",
        ),
        (
            "position: [0 m, 0 m, 2 m]",
            "plate: 0.1 m, position: [0 m, 0 m, 2 m]",
            "boards[0].plate (object 'near'): it is that of the array. Write array.plate.",
        ),
        (
            "seed: 4",
            "scale_bars: [{between: [near/1, fra/2], sigma: 1 mm}]",
            "there is no board 'fra'. Did you mean",
        ),
        ("seed: 4", "scale_bars: [{between: [near/1, far/7], sigma: 1 mm}]", "board far has no target '7'"),
        ("seed: 4", "scale_bars: [{between: [far/1, far/1], sigma: 1 mm}]", "both ends are one target"),
        ("seed: 4", "ranging: both", "ranging: 'both' is not possible here"),
    ],
)
def test_faults_of_a_plan_have_place_and_remedy(folder: Path, was: str, now: str, words: str) -> None:
    if not words:
        assert setup_of(folder, (was, now)).plan.stations[0].held_out
        return
    with pytest.raises(ScenarioError) as error:
        setup_of(folder, (was, now))
    assert words in str(error.value)


def test_a_board_has_one_set_of_targets(folder: Path) -> None:
    """Claim: an array, or a file of points; with both it is not known which is meant, with neither there is nothing."""
    (folder / "far.csv").write_text("target,x_m,y_m,z_m\na,0,0,0\nb,1,0,0\nc,0,1,0\n", encoding="utf-8")
    array = "array: {rows: 2, columns: 3, spacing: [0.3 m, 0.3 m], diameter: 80 mm, plate: 0.2 m}"
    assert [
        len(places)
        for places in setup_of(folder, (array, "points: far.csv, diameter: 60 mm")).places.values()
    ] == [9, 3]
    for now, words in (
        (
            f"{array}, points: far.csv",
            "boards[1] (object 'far'): it has both array and points. Write one of them.",
        ),
        ("held_out: true", "boards[1] (object 'far'): it has neither array nor points. Write one of them."),
    ):
        with pytest.raises(ScenarioError) as error:
            setup_of(folder, (array, now))
        assert words in str(error.value)


def test_own_sightings_need_a_board_to_go_by_and_no_named_station(folder: Path) -> None:
    """Claim: with sightings of your own all stations that are named may be held out, and never all boards."""
    setup = setup_of(folder)
    station, board = setup.plan.stations[0], setup.plan.boards[0]
    own = {"sightings": Path("own.csv"), "boards": (board,), "stations": (station,)}
    away = {"held_out": True}
    for listed, one, faults in (("stations", station, []), ("boards", board, ["boards"])):
        told = own | {listed: (one.model_copy(update=away),)}
        assert [fault.location for fault in setup.plan.model_copy(update=told).cross_checks()] == faults


def test_an_instrument_of_both_ways_must_be_told_which(folder: Path) -> None:
    (folder / "base.yaml").write_text(BASE + "ranging: both\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match="a calibration goes by one of them"):
        setup_of(folder)
    assert setup_of(folder, ("seed: 4", "ranging: tof")).rangefinder == "tof"


@pytest.mark.parametrize(
    ("preset", "ranging", "part"),
    [
        ("pulsed_scanner", "triangulation", "position sensor"),
        ("close_range_scanner", "tof", "time-of-flight unit"),
    ],
)
def test_an_instrument_has_what_it_is_calibrated_by(
    folder: Path, preset: str, ranging: str, part: str
) -> None:
    """Claim: also where the sightings are one's own, for which nothing is simulated."""
    narrow = BASE.replace("5 deg", "1 deg")
    (folder / "base.yaml").write_text(f"{narrow}scanner: {{preset: {preset}}}\n", encoding="utf-8")
    with pytest.raises(
        ScenarioError, match=f"ranging: {preset} has no {part}, which {ranging} asks"
    ) as error:
        setup_of(folder, ("seed: 4", f"ranging: {ranging}"))
    assert [(fault.location, fault.line) for fault in error.value.faults] == [("ranging", 3)]


@pytest.mark.parametrize("own", [True, False])
def test_pulses_alone_are_calibrated_by_sightings_of_ones_own(folder: Path, own: bool) -> None:
    """Claim: of an instrument without a position sensor none can be simulated, and the plan is told so; read ones will
    do."""
    narrow = BASE.replace("5 deg", "1 deg")
    (folder / "base.yaml").write_text(f"{narrow}scanner: {{preset: pulsed_scanner}}\n", encoding="utf-8")
    (folder / "own.csv").write_text("", encoding="utf-8")
    seen = ("base: 0.1 mm, ", "tof_zero: 1 mm, ")
    if own:
        assert setup_of(folder, seen, ("seed: 4", "sightings: own.csv")).by == "coaxial"
        return
    with pytest.raises(ScenarioError, match="pulsed_scanner follows no targets") as error:
        setup_of(folder, seen)
    assert [fault.location for fault in error.value.faults] == ["sightings"]


@pytest.mark.parametrize("base", ["both", "tof", "triangulation"])
@pytest.mark.parametrize(("ranging", "seen", "unseen"), [("tof", "tof_zero", "focal_length"),
                                                         ("triangulation", "focal_length", "tof_zero")])  # fmt: skip
def test_a_plans_own_way_of_ranging_decides_what_it_can_find(
    folder: Path, base: str, ranging: str, seen: str, unseen: str
) -> None:
    """Claim: parameters that this way sees are taken, and one that it does not is refused, whatever the base has."""
    (folder / "base.yaml").write_text(BASE + f"ranging: {base}\n", encoding="utf-8")
    own = ("seed: 4", f"ranging: {ranging}")
    taken = setup_of(folder, own, ("base: 0.1 mm", f"{seen}: 0.1 mm"))
    assert taken.rangefinder == ranging
    assert set(taken.plan.parameters.given) == {seen, "theta_zero"}
    with pytest.raises(ScenarioError, match=f"{unseen}: {ranging} does not see it") as error:
        setup_of(folder, own, ("base: 0.1 mm", f"{seen}: 0.1 mm, {unseen}: 1 mm"))
    assert [fault.location for fault in error.value.faults] == [f"parameters.{unseen}"]


def test_what_has_no_place_stands_in_the_origin_of_the_field() -> None:
    """Claim: in the axes of the field, and the adjustment sees it."""
    standing = Standing(name="board")
    np.testing.assert_array_equal(placement_matrix(standing.position, standing.rotation), np.eye(4))
    assert not standing.held_out


def test_survey_and_bars_of_what_is_simulated_err_by_their_sigma(folder: Path) -> None:
    """Claim: the adjustment sees targets that are off by the survey's σ, and a bar by its own; held to 6 σ and to the
    χ² of 45 coordinates within its 1e-6 quantiles."""
    bar = "scale_bars: [{between: [near/1, far/2], sigma: 1 mm}, {between: [near/1, far/2], length: 2 m, sigma: 1 mm}]"
    setup = setup_of(folder, ("survey", f"{bar}\nsurvey"))
    true = np.concatenate([np.array(list(places.values())) for places in setup.places.values()])
    assert setup.surveyed().sigma == 1e-4
    off = (setup.surveyed().places - true) / 1e-4
    assert 8.0 < (off**2).sum() < 110.0
    ends = setup.standing[[0, 10]]
    lengths = setup.bars().length
    assert 0.0 < abs(lengths[0] - np.linalg.norm(ends[1] - ends[0])) < 6e-3
    assert lengths[1] == 2.0


@pytest.mark.parametrize("by", ["triangulation", "coaxial", "offset"])
def test_slopes_of_readings_are_those_of_the_observation_equation(by: str) -> None:
    """Claim: ∂readings/∂(Θ, φ, R) undoes ∂point/∂readings, up to ∂point/∂(Θ, φ, R) of eq 3 by differences."""
    position = np.array([[0.1, -0.2, 2.5], [-0.3, 0.3, 6.0]])
    slopes = reading_slopes(DESIGN, by, position)  # type: ignore[arg-type]

    def points(place: np.ndarray) -> np.ndarray:
        theta, phi, r = place.T
        return np.stack(coordinates(r, theta, phi, DESIGN.axis_separation), axis=-1)

    steps = 1e-6 * np.eye(3)
    expected = np.stack(
        [(points(position + step) - points(position - step)) / 2e-6 for step in steps], axis=-1
    )
    from scanner_sim.ranging.calibration import ideal_readings

    readings = ideal_readings(DESIGN, by, position[:, 2], position[:, 0], position[:, 1])  # type: ignore[arg-type]
    believed = believed_points(readings, DESIGN, np.zeros(23))
    np.testing.assert_allclose(believed.by_readings @ slopes, expected, atol=1e-7)


def test_readings_that_err_together_weigh_by_their_covariance() -> None:
    """Claim: an adjustment by whitened readings is the one by readings that are mixed with a known matrix: Θ and φ of
    each sighting swapped for their sum and difference have another root, and the same result."""
    field, _ = made_field(np.random.default_rng(6), stations=3)
    plain = adjust(field, selfcal.start_of(field), robust=False)
    turn = Rotation.from_rotvec([0.3, 0.2, 0.1]).as_matrix()
    mixed = replace(field, sightings=replace(field.sightings, root=field.sightings.root @ turn))
    again = adjust(mixed, selfcal.start_of(mixed), robust=False)
    np.testing.assert_allclose(again.unknowns.parameters, plain.unknowns.parameters, rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(again.covariance, plain.covariance, rtol=1e-6)
    np.testing.assert_allclose(mixed.sightings.sigma, field.sightings.sigma, rtol=1e-12)


def test_sightings_scatter_by_their_own_covariance_as_readings(folder: Path) -> None:
    """Claim: root rootᵀ = J (C − pixels² of the range) Jᵀ, with J the slopes of the readings."""
    setup = setup_of(folder)
    table = exact(setup)
    shape = np.array([[1e-5, 0.0, 0.0], [3e-6, 2e-5, 0.0], [1e-4, -2e-4, 8e-4]])
    pixels = np.linspace(1e-4, 5e-4, len(table.position))
    covariance = np.tile(shape @ shape.T, (len(pixels), 1, 1))
    covariance[:, 2, 2] += pixels**2
    root = field_of(setup, replace(table, covariance=covariance, pixels=pixels)).sightings.root
    slopes = reading_slopes(setup.design, setup.by, table.position)
    for made, slope in zip(root, slopes, strict=True):
        np.testing.assert_allclose(made @ made.T, slope @ shape @ shape.T @ slope.T, rtol=1e-6, atol=1e-18)


def test_exact_sightings_leave_an_instrument_as_designed(folder: Path) -> None:
    setup = setup_of(folder, ("survey: 0.1 mm", "survey: 0 mm"))
    found = self_calibrate(setup, exact(setup))
    assert np.abs(found.values / [1e-4, 2e-4]).max() < 1e-6
    assert found.adjusted.unit_weight < 1e-3
    assert found.held is None
    assert found.held_out is None


def test_what_is_held_out_is_not_seen(folder: Path) -> None:
    """Claim: sightings of a held-out board that are far off change nothing, and are told by its misfit."""
    setup = setup_of(folder, ("name: far", "held_out: true, name: far"))
    table = exact(setup)
    wrong = table.position.copy()
    wrong[[name == "far/2" for name in table.target], 0] += 1e-3
    clean, found = self_calibrate(setup, table), self_calibrate(setup, replace(table, position=wrong))
    np.testing.assert_array_equal(found.values, clean.values)
    assert found.field.targets.boards == ("near",)
    assert found.held_out is not None
    np.testing.assert_allclose(found.sigma**2, np.diag(found.adjusted.covariance))
    assert clean.held_out is not None
    assert found.held_out.calibrated > 5.0 * clean.held_out.calibrated


@pytest.mark.parametrize("more", [0, 1])
def test_a_misfit_wants_enough_targets_of_one_board_from_one_station(more: int) -> None:
    """Claim: two stations that see one target fewer than enough of each of two boards have no view; one more is one."""
    few = FEWEST - 1
    targets = np.concatenate(
        [np.arange(few), 10 + np.arange(few), np.arange(few), 10 + np.arange(few + more)]
    )
    station = np.repeat([0, 0, 1, 1], [few, few, few, few + more])
    field: Any = SimpleNamespace(
        sightings=SimpleNamespace(station=station, target=targets),
        targets=SimpleNamespace(boards=("a", "b"), board=np.repeat([0, 1], 10)),
    )
    assert _has_views(field) is (more == 1)


def test_a_board_that_nobody_sees_is_named(folder: Path) -> None:
    setup = setup_of(folder)
    table = exact(setup)
    kept = [index for index, name in enumerate(table.target) if not name.startswith("far")]
    few = some(table, kept)
    with pytest.raises(InputError, match="no sightings of board far"):
        field_of(setup, few)


def test_too_few_sightings_of_a_station_are_named(folder: Path) -> None:
    setup = setup_of(folder)
    table = exact(setup)
    kept = [i for i, name in enumerate(table.station) if name == "s1" or i % 7 == 0]
    few = some(table, kept)
    with pytest.raises(InputError, match="station s2: not tied"):
        self_calibrate(setup, few)


def test_an_adjustment_that_does_not_settle_says_what_to_add(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unsettled(*_: object) -> Adjusted:
        return replace(adjust(field, selfcal.start_of(field)), settled=False)

    setup = setup_of(folder, ("boards:", "boards:"))
    table = exact(setup)
    field = field_of(setup, table)
    monkeypatch.setattr(selfcal, "adjust", unsettled)
    with pytest.raises(InputError) as error:
        self_calibrate(setup, table)
    assert "has not settled" in str(error.value)
    assert "Add stations at another distance" in str(error.value)


def test_unlike_pixels_are_common_to_images_that_lie_on_them() -> None:
    """Claim: G Gᵀ is the covariance of the readings by unlike pixels, (1 − Δ²/2w²) exp(−Δ²/4w²) of images Δ apart, and
    none between stations. Parts below a thousandth are left out."""
    image, width = np.array([10.0, 11.0, 40.0, 10.0]), np.array([2.0, 2.0, 2.0, 2.0])
    pixels, slope = np.array([1e-5, 2e-5, 1e-5, 1e-5]), np.array([-0.1, -0.1, -0.2, -0.1])
    none = np.zeros((4, 3))
    table = SightingTable(
        ("a",) * 3 + ("b",), tuple("1234"), none, np.zeros((4, 3, 3)), pixels, image, width, *np.zeros((2, 4))
    )
    slopes = np.eye(3) * np.stack([slope, slope, slope], axis=1)[:, None]
    made = common_of(
        table, np.array([0, 0, 0, 1]), slopes, load_scenario(yaml.safe_load(BASE)).scanner.mirrors
    )
    assert not made[:, :2].any()
    found = np.einsum("ik,jk->ij", made[:3, 2], made[:3, 2])
    square = ((image[:3, None] - image[:3]) / 2.0) ** 2
    read = (slope * pixels)[:3]
    expected = read[:, None] * read * (1.0 - 0.5 * square) * np.exp(-0.25 * square)
    np.testing.assert_allclose(found, expected, atol=2e-3 * (read**2).sum())
    assert (made[3, 2] ** 2).sum() == pytest.approx(1e-12, rel=2e-3, abs=0.0)


def test_wobble_is_common_to_what_is_close_in_time_and_in_the_other_angle() -> None:
    """Claim: Θ of two sightings has σ² in common at one time and one φ, whatever their Θ; nothing two wobble times or
    two wobble angles apart, nor between stations; R, by which the reading of a range goes, none. So does φ with Θ."""
    time = np.array([0.0, 0.0, 4.0, 0.0, 0.0])
    position = np.array([[0.0, 0.0, 3.0], [0.3, 0.0, 3.0], [0.0, 0.0, 3.0], [0.0, 0.3, 3.0], [0.0, 0.0, 3.0]])
    none = np.zeros(5)
    table = SightingTable(
        ("a",) * 4 + ("b",),
        tuple("12345"),
        position,
        np.zeros((5, 3, 3)),
        none,
        none,
        none + 1.0,
        none + 2e-6,
        time,
    )
    mirrors = load_scenario(yaml.safe_load(BASE)).scanner.mirrors
    mirrors = mirrors.model_copy(update={"wobble_time": 2.0, "wobble_angle": 0.15})
    slopes = np.tile(np.eye(3), (5, 1, 1))
    slopes[:, 2, 0] = -0.2
    made = common_of(table, np.array([0, 0, 0, 0, 1]), slopes, mirrors)
    found = np.einsum("ick,jdk->ijcd", made[:4], made[:4]) / 4e-12
    wanted = np.zeros((4, 4, 2))
    wanted[range(4), range(4)] = 1.0
    wanted[0, 1, 0] = wanted[1, 0, 0] = 1.0
    wanted[0, 3, 1] = wanted[3, 0, 1] = 1.0
    np.testing.assert_allclose(found[:, :, (0, 1), (0, 1)], wanted, atol=1e-3)
    np.testing.assert_allclose(found[:, :, 2, 0], -0.2 * wanted[:, :, 0], atol=1e-3)


def test_a_report_tells_the_misfit_of_what_was_fitted_and_of_what_was_held_out(folder: Path) -> None:
    """Claim: each has its own numbers, in the words of the report; nothing held out has none."""
    setup = setup_of(folder, ("name: far", "held_out: true, name: far"))
    table = exact(setup)
    table.position[:] += 1e-5 * np.random.default_rng(5).standard_normal(table.position.shape)
    found = self_calibrate(setup, table)
    told: Any = report(setup, found, ())["misfit"]
    assert found.held_out is not None
    for name, misfit in (("fitted", found.fitted), ("held_out", found.held_out)):
        assert told[name]["calibrated"] == misfit.calibrated
        assert told[name]["as_designed"] == misfit.designed
        assert (told[name]["views"], told[name]["sightings"]) == (misfit.views, misfit.targets)
    assert found.fitted.targets != found.held_out.targets
    less: Any = report(setup, replace(found, held_out=None), ())["misfit"]
    assert less["held_out"] is None


def test_a_report_has_the_poses_that_take_points_into_the_field(folder: Path) -> None:
    """Claim: of exact sightings those of the plan before its first board, whose frame the field has: rotation times a
    point of a station or a board, and its position, is where that point stands. Both are turned, by no half turn."""
    turned = "rotation: {axis: [1, 2, 0], angle: 8 deg}"
    setup = setup_of(
        folder,
        ("position: [0.2 m, 0 m, -0.3 m]", f"position: [0.2 m, 0 m, -0.3 m], {turned}"),
        ("position: [0.5 m, 0 m, 4 m]", f"position: [0.5 m, 0 m, 4 m], {turned}"),
        ("survey: 0.1 mm", "survey: 0 mm"),
    )
    told: Any = report(setup, self_calibrate(setup, exact(setup)), ())
    first = np.linalg.inv(setup.plan.boards[0].field_from_here())
    for kind, planned in (("stations", setup.plan.stations), ("boards", setup.plan.boards)):
        assert list(told[kind]) == [one.name for one in planned]
        for one in planned:
            pose = first @ one.field_from_here()
            np.testing.assert_allclose(told[kind][one.name]["rotation"], pose[:3, :3], atol=1e-6)
            np.testing.assert_allclose(told[kind][one.name]["position_m"], pose[:3, 3], atol=1e-6)


def test_doubted_sightings_are_told_by_name_the_least_trusted_first(folder: Path) -> None:
    """Claim: a report and the terminal, which has room for a few, begin with the sighting of the smallest weight; one
    that counts in full is not told."""
    setup = setup_of(folder)
    table = exact(setup)
    found = self_calibrate(setup, table)
    weights = np.ones(len(table.station))
    weights[[1, 4, 7, 9, 20]] = 0.6, 0.2, 0.05, 1.0 - 1e-12, 0.99
    doubted = replace(found, adjusted=replace(found.adjusted, weights=weights))
    wanted = [(table.station[n], table.target[n], weights[n]) for n in (7, 4, 1, 20)]
    assert list(doubted.doubted) == wanted
    told: Any = report(setup, doubted, ())["doubted_sightings"]
    assert [(one["station"], one["target"], one["weight"]) for one in told] == wanted
