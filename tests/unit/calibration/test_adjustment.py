"""The adjustment of a calibration field: against SciPy, without noise, with blunders, and what no field can tell."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from calibration_fields import SURVEY, TOLERANCE, made_field, read
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from scanner_sim.calibration import adjustment, pictures
from scanner_sim.calibration.adjustment import (
    Unknowns,
    _known,
    _Layout,
    _moved,
    _sightings,
    adjust,
)
from scanner_sim.calibration.network import Field, ScaleBars
from scanner_sim.calibration.observability import correlations, unobserved
from scanner_sim.calibration.starts import _after, _view, fit_board, start_of
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.parameters import INDEX
from scanner_sim.ranging.believed import VoxelReadings

Array = NDArray[np.float64]


def sought(field: Field) -> list[int]:
    return [INDEX[name] for name in field.sought]


def test_without_noise_the_true_instrument_is_found() -> None:
    """Claim: exact readings of a drawn instrument give its parameters, to rounding, as far as tolerances let them.

    A tolerance is an observation of zero: it draws each parameter back by a share of its σ² over the tolerance's. With
    tolerances a thousand times as wide as the truth nothing of that is left but for what no sighting tells.
    """
    generator = np.random.default_rng(7)
    wide = {
        name: 1e3 * TOLERANCE[name]
        for name in ("base", "theta_zero", "theta_scale", "phi_scale", "array_offset")
    }
    field, truth = made_field(generator, stations=5, boards=3, noise=0.0, tolerance=wide)
    drawn = {name: 0.7 * TOLERANCE[name] * (-1) ** i for i, name in enumerate(wide)} | {
        "phi_zero": 0.0,
        "array_scale": 0.0,
    }
    seen = field.sightings
    believed = read_again(field, drawn)
    field = replace(field, sightings=replace(seen, readings=VoxelReadings(*believed.T)))
    found = adjust(field, start_of(field), robust=False)
    for name in wide:
        truth[INDEX[name]] = drawn[name]
    assert found.settled
    np.testing.assert_allclose(
        found.unknowns.parameters[sought(field)], truth[sought(field)], atol=1e-3 * min(TOLERANCE.values())
    )
    assert np.abs(found.residuals).max() < 1e-3


def read_again(field: Field, value: dict[str, float]) -> np.ndarray:
    """Return what an instrument with given parameters would read of the points that an ideal one has read."""
    from scanner_sim.ranging.believed import believed_points

    points = believed_points(
        field.sightings.readings, field.design, np.zeros(len(INDEX)), field.encoder_period
    ).point
    return read(points, value)


def test_scipy_finds_the_same() -> None:
    """Claim: parameters and covariance are those of SciPy's least squares with numerical slopes, in a small field.

    The reference adjusts readings by the forward way of the paper, written apart, with rotations of SciPy's. The
    adjustment's slopes leave out how J changes, which is worth hundredths of σ, and falls with the square of the
    errors: of a tenth of those that are stated some ten-thousandths are left.
    """
    field, _ = made_field(np.random.default_rng(11), stations=3, boards=2, noise=0.1)
    field = field.seeing(np.arange(0, len(field.sightings), 2))
    start = start_of(field)
    found = adjust(field, start, robust=False)
    reference = least_squares(
        reference_residuals, np.zeros(reference_size(field)), args=(field, start), method="lm", xtol=1e-12
    )
    k = len(field.sought)
    covariance = np.linalg.inv(reference.jac.T @ reference.jac)[:k, :k]
    sigma = np.sqrt(np.diagonal(covariance))
    away = (found.unknowns.parameters[sought(field)] / field.tolerances - reference.x[:k]) / sigma
    assert np.abs(away).max() < 0.01
    ours = found.covariance / np.outer(field.tolerances, field.tolerances)
    np.testing.assert_allclose(ours / np.outer(sigma, sigma), covariance / np.outer(sigma, sigma), atol=0.01)
    assert found.cost == pytest.approx(2.0 * reference.cost, rel=1e-4)


def reference_size(field: Field) -> int:
    return len(field.sought) + 6 * len(field.stations) + 6 + 3 * len(field.targets.names)


def reference_residuals(x: np.ndarray, field: Field, start: Unknowns) -> np.ndarray:
    """Return all residuals over σ: at parameters over tolerances, moves of poses, and targets' displacements."""
    k, n = len(field.sought), len(field.stations)
    value = dict.fromkeys(TOLERANCE, 0.0) | dict(zip(field.sought, x[:k] * field.tolerances, strict=True))
    moves = np.concatenate([x[k : k + 6 * n].reshape(n, 6), x[k + 6 * n : k + 6 * n + 6][None]]) * 1e-3
    displaced = x[k + 6 * n + 6 :].reshape(-1, 3)
    local = field.targets.places + SURVEY * displaced
    world = local.copy()
    second = field.targets.board == 1
    turn = Rotation.from_rotvec(moves[n, 3:]) * Rotation.from_matrix(start.boards.rotation[1])
    world[second] = turn.apply(local[second]) + start.boards.position[1] + moves[n, :3]
    seen = field.sightings
    residuals = [x[:k], displaced.ravel()]
    for number in range(n):
        chosen = seen.station == number
        turn = Rotation.from_rotvec(moves[number, 3:]) * Rotation.from_matrix(start.stations.rotation[number])
        points = turn.inv().apply(
            world[seen.target[chosen]] - start.stations.position[number] - moves[number, :3]
        )
        readings = np.stack([seen.readings.theta, seen.readings.phi, seen.readings.measured], axis=1)[chosen]
        residuals.append(((readings - read(points, value)) / seen.sigma[chosen]).ravel())
    return np.concatenate(residuals)


def test_a_blunder_counts_less_and_is_pointed_at() -> None:
    """Claim: a target that was mistaken by 400 σ keeps a small weight, and moves no parameter by more than one σ."""
    field, _ = made_field(np.random.default_rng(3), stations=4, boards=2)
    clean = adjust(field, start_of(field))
    theta = field.sightings.readings.theta.copy()
    theta[10] += 400.0 * field.sightings.sigma[10, 0]
    readings = replace(field.sightings.readings, theta=theta)
    wrong = replace(field, sightings=replace(field.sightings, readings=readings))
    found = adjust(wrong, start_of(wrong))
    assert found.weights.argmin() == 10
    assert found.weights[10] < 0.05
    sigma = np.sqrt(np.diagonal(clean.covariance))
    moved = (found.unknowns.parameters - clean.unknowns.parameters)[sought(field)]
    assert np.abs(moved / sigma).max() < 1.0
    plain = adjust(wrong, start_of(wrong), robust=False)
    assert np.abs((plain.unknowns.parameters - clean.unknowns.parameters)[sought(field)] / sigma).max() > 3.0


def test_what_a_station_has_in_common_is_where_the_loss_is_least() -> None:
    """Claim: with errors u in common the adjustment settles where u = Σ (L⁻¹G)ᵀ v of each station: the loss, the sum of
    v² and u², does not change there with u. A station that read with such errors is told so."""
    field, _ = made_field(np.random.default_rng(8), stations=3)
    seen = field.sightings
    common = np.zeros((len(seen), 3, 1))
    common[:, 2, 0] = 2e-6
    place = seen.readings.measured + np.where(seen.station == 1, 3e-6, 0.0)
    readings = replace(seen.readings, measured=place)
    field = replace(field, sightings=replace(seen, readings=readings, common=common))
    found = adjust(field, start_of(field), robust=False)
    assert found.settled
    shared = np.linalg.solve(seen.root, common)[..., 0]
    for station, value in enumerate(found.unknowns.common[:, 0]):
        own = seen.station == station
        # A step that promises less than a thousandth of σ ends the search.
        assert value == pytest.approx((shared[own] * found.residuals[own]).sum(), abs=0.01)
    assert found.unknowns.common[1, 0] > found.unknowns.common[[0, 2], 0].max() + 0.5


def test_what_sightings_alone_tell_depends_on_no_tolerance() -> None:
    """Claim: with tolerances of a twentieth, where exact readings leave everything in its place, the information is as
    before; of the covariance it is the inverse less what the tolerances tell. Tolerance: a hundredth of theirs."""
    found = []
    for part in (1.0, 0.05):
        tolerance = {name: part * value for name, value in TOLERANCE.items()}
        field, _ = made_field(np.random.default_rng(17), stations=3, noise=0.0, tolerance=tolerance)
        found.append(adjust(field, start_of(field), robust=False))
    known = np.outer(field.tolerances, field.tolerances)
    np.testing.assert_allclose(found[1].information * known, found[0].information * known, atol=0.01)
    alone = np.linalg.inv(found[1].covariance) - np.diag(field.tolerances**-2.0)
    np.testing.assert_allclose(alone * known, found[1].information * known, atol=0.01)


def test_a_single_board_leaves_combinations_unobserved() -> None:
    """Claim: what no field can tell is named: the zero of φ, which is a turn of the station; from one board more.

    With D_g = 50 mm a turn by the zero of φ displaces the second axis by micrometres, which the stations take up.
    """
    one, _ = made_field(np.random.default_rng(5), stations=2, boards=1)
    more, _ = made_field(np.random.default_rng(5), stations=6, boards=3)
    few = unobserved(one, adjust(one, start_of(one)))
    least = unobserved(more, adjust(more, start_of(more)))
    assert any(combination.parts[0][0] == "phi_zero" for combination in least)
    assert len(few) >= len(least)
    assert few[0].sigma >= least[0].sigma
    assert all(combination.sigma > 1.0 for combination in (*few, *least))
    assert "phi_zero" in " ".join(combination.words for combination in least)


def test_a_combination_is_known_to_the_root_of_its_information() -> None:
    """Claim: of information 4, 0.04 and none along three axes, in units of the tolerances, the last two are told as too
    little: to 5 tolerances, and not at all; the largest part comes first, with a plus."""
    axes = Rotation.from_euler("z", 60.0, degrees=True).as_matrix()
    tolerances = np.array([2.0, 10.0, 0.5])
    scaled = axes @ np.diag([4.0, 0.04, 0.0]) @ axes.T
    field = SimpleNamespace(sought=("a", "b", "c"), tolerances=tolerances)
    adjusted = SimpleNamespace(information=scaled / np.outer(tolerances, tolerances))
    never, little = unobserved(field, adjusted)  # type: ignore[arg-type]
    assert (never.sigma, never.words) == (math.inf, "+1.00 c")
    assert little.sigma == pytest.approx(5.0)
    assert little.words == "+0.87 a −0.50 b"


@pytest.mark.parametrize("across", [0, 2])
def test_stations_are_drawn_with_their_directions_and_named_from_above(across: int) -> None:
    """Claim: from each place a line ahead and one aside, of one length; names where they do not hide one another."""
    axes = Figure().add_subplot()
    turned = Rotation.from_euler("y", [[0.0], [0.5]]).as_matrix()
    places = np.array([[0.0, 0.1, 0.0], [2.0, -0.1, 1.0]])
    poses = SimpleNamespace(position=places, rotation=turned)
    result: Any = SimpleNamespace(
        adjusted=SimpleNamespace(unknowns=SimpleNamespace(stations=poses)),
        field=SimpleNamespace(stations=("s1", "s2")),
    )
    pictures._stations(axes, result, across, 1)
    marks, *lines = (line.get_xydata() for line in axes.lines)
    np.testing.assert_allclose(marks, places[:, [across, 1]])
    reach = 0.12 * float(np.ptp(places[:, [across, 1]])) + 0.3
    ends = [*(turned[:, :, 2]), *(turned[:, :, 0])]
    for line, place, way in zip(lines, [*places, *places], ends, strict=True):
        np.testing.assert_allclose(line[1] - line[0], reach * way[[across, 1]], atol=1e-12)
        np.testing.assert_allclose(line[0], place[[across, 1]])
    named = {one.get_text(): one.xy for one in axes.texts}
    assert named == ({"s1": (0.0, 0.1), "s2": (2.0, -0.1)} if across == 0 else {})


def test_a_direction_that_nothing_tells_has_no_number() -> None:
    """Claim: base and the scale of the array, beside a focal length that is right, act on ranges alike but for second
    order: where both are sought, one combination is next to unknown, and their correlation is near one."""
    tolerance = {"base": 1e-3, "array_scale": 5e-3}
    field, _ = made_field(np.random.default_rng(9), stations=4, boards=2, tolerance=tolerance, survey=0.0)
    found = adjust(field, start_of(field))
    assert abs(correlations(found)[0, 1]) > 0.9


def test_scale_bars_carry_the_scale_where_the_survey_does_not() -> None:
    """Claim: with targets surveyed to 10 mm only, a bar of 10 µm between two boards takes most of the base's σ away."""
    generator = np.random.default_rng(13)
    tolerance = {"base": 1e-3}
    loose, _ = made_field(generator, stations=4, boards=2, tolerance=tolerance, survey=0.0)
    loose = replace(loose, targets=replace(loose.targets, sigma=1e-2))
    before = adjust(loose, start_of(loose))
    placed = before.unknowns.boards
    targets = loose.targets
    world = (
        np.einsum("nij,nj->ni", placed.rotation[targets.board], targets.places)
        + placed.position[targets.board]
    )
    first, second = np.array([0, 5]), np.array([len(targets.names) - 1, len(targets.names) - 6])
    length = np.linalg.norm(world[second] - world[first], axis=1)
    barred = replace(loose, bars=ScaleBars(first, second, length, np.full(2, 1e-5)))
    after = adjust(barred, start_of(barred))
    assert after.freedom == before.freedom + 2
    assert after.covariance[0, 0] < 0.5 * before.covariance[0, 0]


@pytest.mark.parametrize("away", [0, 1, 2])
def test_bars_of_boards_that_are_not_seen_are_left_out(away: int) -> None:
    """Claim: where a board is held out, the bars that are left are those with both ends on other boards, each between
    the targets of the same names as before, with its own length and σ; so are the sightings."""
    whole, _ = made_field(np.random.default_rng(6), stations=3, boards=3)
    board, names = whole.targets.board, whole.targets.names
    pairs = [(5, 20), (37, 2), (18, 40), (9, 1), (30, 17), (47, 33), (45, 31)]
    ends = np.array(pairs)
    length, sigma = 1.0 + 0.1 * np.arange(len(pairs)), 1e-5 * (1.0 + np.arange(len(pairs)))
    kept = board[whole.sightings.target] != away
    field = replace(whole, bars=ScaleBars(*ends.T, length, sigma)).seeing(kept)
    left, bars = [k for k, pair in enumerate(pairs) if away not in board[list(pair)]], field.bars
    assert 0 < len(left) < len(pairs)
    found = [
        (field.targets.names[a], field.targets.names[b]) for a, b in zip(bars.first, bars.second, strict=True)
    ]
    assert found == [(names[a], names[b]) for a, b in (pairs[k] for k in left)]
    np.testing.assert_array_equal([bars.length, bars.sigma], [length[left], sigma[left]])
    assert [field.targets.names[k] for k in field.sightings.target] == [
        names[k] for k in whole.sightings.target[kept]
    ]


@pytest.mark.parametrize("depth", [0.0, 0.2])
def test_a_mirrored_board_is_a_fault(depth: float) -> None:
    """A flat one, whose mirror image is its back, and one whose targets stand at several depths."""
    field, _ = made_field(np.random.default_rng(2), depth=depth)
    start_of(field)
    places = field.targets.places.copy()
    places[field.targets.board == 1, 0] *= -1.0
    with pytest.raises(InputError, match="as in a mirror"):
        start_of(replace(field, targets=replace(field.targets, places=places)))


@pytest.mark.parametrize("size", [0.02, 1.0, 60.0])
def test_a_board_is_flat_or_mirrored_whatever_its_size(size: float) -> None:
    """Claim: targets within two hundredths of the board's extent of a plane are flat, and their mirror image is
    about the board from behind; with more depth the board that fits ten times better in the mirror is mirrored, and
    there is no depth between; targets within a thousandth of a line have no pose. All that is so of small boards and of
    large ones."""
    # Sixty targets: the rms misfit that a depth leaves, over the board's length, falls with the root of their number.
    generator = np.random.default_rng(11)
    local = size * generator.uniform(-0.3, 0.3, (60, 3)) * [1.0, 0.8, 0.0]
    depth = size * generator.uniform(-0.05, 0.05, (60, 3)) * [0.0, 0.0, 1.0]
    turn, place = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix(), size * np.array([0.4, -0.1, 5.0])
    mirror = np.array([-1.0, 1.0, 1.0])
    for share in (0.0, 0.006, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0):
        points = local + share * depth
        view = _view(points, points @ turn.T + place, "it")
        assert view is not None
        np.testing.assert_allclose(view[0], turn, atol=1e-9)
        np.testing.assert_allclose(view[1], place, atol=1e-9 * size)
        with pytest.raises(InputError, match="it are numbered as in a mirror"):
            _view(points * mirror, points @ turn.T + place, "it")
    line = local * np.array([1.0, 1e-6, 0.0])
    assert _view(line, line @ turn.T + place, "it") is None


@pytest.mark.parametrize("tilt", [0.0, 0.4, 1.0, 1.1, 1.57])
def test_a_flat_board_may_have_any_origin(tilt: float) -> None:
    """Claim: surveyed in axes whose origin lies before, behind or aside of it, and which are turned against it, a flat
    board has its pose; its mirror image is told while its front is turned from −z by less than 60°, and has a pose
    beyond, where nothing says which side is the front."""
    generator = np.random.default_rng(12)
    flat = generator.uniform(-0.4, 0.4, (12, 3)) * [1.0, 1.0, 0.0]
    surveyed_from = Rotation.from_rotvec([0.6 * tilt, -0.8 * tilt, 0.0])
    turn, place = Rotation.from_rotvec([0.2, 0.3, -0.4]), np.array([0.3, -0.2, 3.0])
    for origin in ([0.0, 0.0, 0.0], [0.0, 0.0, -8.0], [0.0, 0.0, 8.0], [9.0, 0.0, 0.0], [-2.0, 7.0, 5.0]):
        local = surveyed_from.apply(flat) + origin
        view = _view(local, turn.apply(flat) + place, "it")
        assert view is not None
        np.testing.assert_allclose(view[0], (turn * surveyed_from.inv()).as_matrix(), atol=1e-9)
        np.testing.assert_allclose(
            view[0] @ local.T + view[1][:, None], (turn.apply(flat) + place).T, atol=1e-8
        )
        mirrored = surveyed_from.apply(flat * [-1.0, 1.0, 1.0]) + origin
        if tilt < math.radians(60.0):
            with pytest.raises(InputError, match="it are numbered as in a mirror"):
                _view(mirrored, turn.apply(flat) + place, "it")
        else:
            assert _view(mirrored, turn.apply(flat) + place, "it") is not None


def test_a_station_that_sees_no_board_of_the_others_is_a_fault() -> None:
    field, _ = made_field(np.random.default_rng(2), stations=3)
    few = np.flatnonzero((field.sightings.station != 2) | (np.arange(len(field.sightings)) % 9 == 0))
    with pytest.raises(InputError, match="station s2"):
        start_of(field.seeing(few))


def test_a_board_that_is_bent_keeps_its_pose_and_tells_the_bend() -> None:
    """Claim: corners of a square that lie by turns 2 mm before and behind it move no rigid motion; of the coordinates,
    a third of which err, the misfit is 2 mm/√3."""
    local = np.array([[0.2, 0.2, 0.0], [-0.2, 0.2, 0.0], [-0.2, -0.2, 0.0], [0.2, -0.2, 0.0]])
    turn, place = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix(), np.array([0.4, -0.1, 5.0])
    bent = local + np.outer([2e-3, -2e-3, 2e-3, -2e-3], [0.0, 0.0, 1.0])
    rotation, position, misfit = fit_board(local, bent @ turn.T + place)
    np.testing.assert_allclose(rotation, turn, atol=1e-9)
    np.testing.assert_allclose(position, place, atol=1e-9)
    assert misfit == pytest.approx(2e-3 / math.sqrt(3.0))


def test_all_derivatives_of_an_adjustment_are_differences() -> None:
    """Claim: the derivatives of the readings' residuals, and of those of tolerances, survey and scale bars, by every
    unknown are central differences along the steps that the adjustment takes. Tolerance: of the differences."""
    field, _ = made_field(np.random.default_rng(11), stations=3, boards=3, noise=0.0)
    # Where nothing is left of the residuals, their weights need no derivative.
    at = adjust(field, start_of(field), robust=False).unknowns
    ends = np.array([0, 4]), np.array([9, 14])
    field = replace(field, bars=ScaleBars(*ends, np.array([0.7, 1.1]), np.array([2e-5, 3e-5])))
    layout = _Layout.of(field)

    def residuals(step: np.ndarray) -> np.ndarray:
        moved = _moved(field, layout, at, step)
        return np.concatenate([_sightings(field, layout, moved)[0].ravel(), _known(field, layout, moved)[0]])

    slopes = np.concatenate(
        [_sightings(field, layout, at)[1].toarray(), _known(field, layout, at)[1].toarray()]
    )
    assert slopes.shape[1] == layout.count
    for column in range(layout.count):
        size = np.abs(slopes[:, column]).max()
        step = np.eye(layout.count)[column] * (1e-1 / size)
        wanted = (residuals(step) - residuals(-step)) / (2.0 * step[column])
        np.testing.assert_allclose(slopes[:, column], wanted, atol=2e-4 * size, err_msg=str(column))


def test_unit_weight_is_the_root_of_the_squares_over_the_freedom() -> None:
    """Claim: √(Σ v²/f) of the weighted residuals; where nothing is left over, of their sum."""
    field, _ = made_field(np.random.default_rng(2))
    found = adjust(field, start_of(field), robust=False)
    assert found.freedom > 50
    assert found.unit_weight == pytest.approx(math.sqrt(found.cost / found.freedom), rel=1e-12)
    assert replace(found, cost=7.0, freedom=0).unit_weight == pytest.approx(math.sqrt(7.0))


@pytest.mark.parametrize("robust", [False, True])
def test_the_slope_is_that_of_the_loss(robust: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the loss is Σ ρ(|r|) and what is known beside, ρ = r² up to the knee k and k(2r − k) beyond (Huber), r²
    alone where nothing is doubted; the slope is −½ of its derivatives, by differences; residuals beyond the knee weigh
    k/r, in the normal matrix and in the cost, and what is known weighs in full."""
    random = np.random.default_rng(8)
    jacobian, slopes = random.normal(size=(12, 5)), random.normal(size=(3, 5))
    knee = adjustment._KNEE
    way = random.normal(size=(4, 3))
    away = way / np.linalg.norm(way, axis=1, keepdims=True) * (knee * np.array([[0.5], [0.95], [1.3], [2.6]]))
    beside, nothing = np.array([0.3, -0.7, 1.1]), SimpleNamespace()

    def at(step: Array) -> Any:
        monkeypatch.setattr(
            adjustment, "_sightings", lambda *_: (away + (jacobian @ step).reshape(4, 3), csr_array(jacobian))
        )
        monkeypatch.setattr(adjustment, "_known", lambda *_: (beside + slopes @ step, csr_array(slopes)))
        given: Any = nothing
        return adjustment._linearise(given, given, given, robust=robust)

    found = at(np.zeros(5))
    size = np.linalg.norm(away, axis=1)
    weight = np.minimum(1.0, knee / size) if robust else np.ones(4)
    rho = np.where((size > knee) & robust, knee * (2.0 * size - knee), size**2)
    known = float(beside @ beside)
    assert found.loss == pytest.approx(rho.sum() + known, rel=1e-12)
    assert found.cost == pytest.approx(float((weight * size**2).sum()) + known, rel=1e-12)
    np.testing.assert_allclose(found.weights, weight, rtol=1e-12)
    whole = sum(
        weight[row] * jacobian[3 * row : 3 * row + 3].T @ jacobian[3 * row : 3 * row + 3] for row in range(4)
    )
    np.testing.assert_allclose(found.normal, whole + slopes.T @ slopes, rtol=1e-12)
    for number, step in enumerate(1e-6 * np.eye(5)):
        rise = (at(step).loss - at(-step).loss) / 2e-6
        assert found.slope[number] == pytest.approx(-0.5 * rise, rel=1e-6)


def test_one_move_after_another_moves_points_by_both() -> None:
    """Claim: the inner first, then the outer, of any two turns and places."""
    rng = np.random.default_rng(22)
    outer, inner = (
        (np.linalg.qr(rng.normal(0.0, 1.0, (3, 3)))[0], rng.normal(0.0, 1.0, 3)) for _ in range(2)
    )
    points = rng.normal(0.0, 1.0, (5, 3))
    turn, place = _after(outer, inner)
    moved = (points @ inner[0].T + inner[1]) @ outer[0].T + outer[1]
    np.testing.assert_allclose(points @ turn.T + place, moved, atol=1e-12)
