"""Does the reference filter know how wrong it is, and does one that takes all errors for white not?

Levels: a right program fails a test of this file for fewer than one in 10⁴ seeds; seeds are fixed.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import claims
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from scanner_sim.analytic import geometry
from scanner_sim.config import scenario_from_text
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.closed_loop.poses import true_poses
from scanner_sim.instrument.closed_loop.track import track_many
from scanner_sim.optics.deflection import WOBBLE_LASTS, wobble_correlation
from scanner_sim.pose.filter import FilterModel, FilterState
from scanner_sim.pose.first_motions import Expected, first_motion
from scanner_sim.pose.pose_filter import PoseFilter
from scanner_sim.pose.transforms import rotation_from_vector, vector_from_rotation
from scanner_sim.tracking.errors import ErrorParts
from scanner_sim.tracking.record import PatternRecord, Track, TrackStatus
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.state import Refusal, TrackMode

Array = NDArray[np.float64]

SEPARATION, PERIOD, IMAGE = 0.05, 0.01, 400.0
"""D_g [m], time between visits [s], image [pixel] times depth [m]."""
CORNERS = {"a/1": [-0.4, -0.4, 0.0], "a/2": [0.4, -0.4, 0.0], "a/3": [-0.4, 0.4, 0.0], "a/4": [0.4, 0.4, 0.1]}
UNREST = 1e-12
"""Spectral density of accelerations, below anything that moves a pose in these runs."""
NOTHING = PatternSamples(*(np.zeros((1, 0)) for _ in range(7)), status=np.zeros((1, 0), dtype=np.uint8))


def white(records: list[PatternRecord]) -> list[PatternRecord]:
    """The same visits, their errors said to be new each time."""
    return [replace(record, errors=ErrorParts.all_white(record.covariance)) for record in records]


def nees(state: FilterState, pose: Array, twist: Array, number: int = 0) -> float:
    """Squared error of the twelve numbers of an object by their stated covariance."""
    away = np.concatenate(
        [
            state.position[number] - pose[:3, 3],
            vector_from_rotation(state.rotation[number] @ pose[:3, :3].T),
            state.velocity[number] - twist[:3],
            state.turn_rate[number] - twist[3:],
        ]
    )
    return float(away @ np.linalg.solve(state.covariance_of(number), away))


@dataclass(frozen=True)
class PixelField:
    """What unlike pixels make of ranges, by the place of their images [width]: 64 waves of the correlation's spectrum.

    That of (1 − Δ²/2) exp(−Δ²/4) goes as k² exp(−k²): k is the length of three normal numbers over √2.
    """

    rate: Array
    phase: Array

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> PixelField:
        return cls(
            np.linalg.norm(rng.standard_normal((64, 3)), axis=1) / np.sqrt(2.0),
            rng.uniform(0.0, 2.0 * np.pi, 64),
        )

    def at(self, place: Array) -> Array:
        waves = np.cos(self.rate * place[..., None] + self.phase)
        return np.asarray(np.sqrt(2.0 / len(self.rate)) * waves.sum(axis=-1))


def correlated(correlation: Array, rng: np.random.Generator) -> Array:
    """Normal numbers of a correlation."""
    root: Array = np.linalg.cholesky(correlation + 1e-9 * np.eye(len(correlation)))
    return root @ rng.standard_normal(len(correlation))


@dataclass(frozen=True)
class Moving:
    """An object that moves evenly but for a push: pose at 0 s, rates, when the push comes and what it adds to them."""

    position: Array
    rotation: Array
    speed: Array
    rate: Array
    push: tuple[float, Array] = (np.inf, np.zeros(3))

    def at(self, time: float) -> tuple[Array, Array]:
        """Its pose, shape (4, 4), and its six rates."""
        since = max(time - self.push[0], 0.0)
        pose = np.eye(4)
        pose[:3, :3] = rotation_from_vector(time * self.rate) @ self.rotation
        pose[:3, 3] = self.position + time * self.speed + since * self.push[1]
        return pose, np.concatenate([self.speed + (since > 0.0) * self.push[1], self.rate])


def moving(rng: np.random.Generator, fastest: float | None = None) -> Moving:
    """A square some 8 m away that moves by up to 20 mm/s and 20 mrad/s, or with rates of that standard deviation."""
    start = rng.uniform([-0.5, -0.5, 8.0], [0.5, 0.5, 9.0])
    rates = rng.uniform(-0.02, 0.02, (2, 3)) if fastest is None else fastest * rng.standard_normal((2, 3))
    return Moving(start, rotation_from_vector(rng.uniform(-0.3, 0.3, 3)), *rates)


def run(rng: np.random.Generator, visits: int, truth: Moving, period: float = PERIOD) -> list[PatternRecord]:
    """Visits to a moving square with errors drawn as their parts say."""
    points, names = np.array(list(CORNERS.values())), list(CORNERS)
    surface = np.diag([4.5e-6, 2.5e-6, 4e-4]) ** 2
    surface[0, 1] = surface[1, 0] = 4e-12
    parts = replace(
        ErrorParts.all_white(np.diag([6e-6, 4e-6, 2e-4]) ** 2),
        surface=surface,
        turn=np.asarray(0.06),
        approach=np.asarray(1e9),
        pixels=np.asarray(4e-4**2),
        image_width=np.asarray(0.9),
        wobble=np.asarray(3e-6**2),
        wobble_time=np.asarray(0.05),
        wobble_angle=np.asarray(0.05),
        drift=np.array([2e-6, 1e-6]),
    )
    own, drift, field = rng.standard_normal((4, 3)), rng.standard_normal(), PixelField.drawn(rng)
    before, wobble, records = 0.0, np.zeros((2, 4)), []
    fade = np.exp(-period / (WOBBLE_LASTS * 0.05))
    for visit in range(visits):
        time = (visit + 1) * period
        pose, _ = truth.at(time)
        rotation, position = pose[:3, :3], pose[:3, 3]
        reach, theta, phi = geometry.shot_from_point(points @ rotation.T + position, SEPARATION)
        place = np.stack([theta, phi, reach], axis=1)
        image = IMAGE * np.cos(theta) / reach
        pixels = field.at(image / 0.9)
        for axis in (0, 1):
            apart = (place[:, None, 1 - axis] - place[:, 1 - axis]) / 0.05
            drawn = correlated(wobble_correlation(apart), rng)
            share = fade if visit else 0.0
            wobble[axis] = share * wobble[axis] + np.sqrt(1.0 - share**2) * drawn
        roll = abs(float(truth.rate @ (position / np.linalg.norm(position)))) * (time - before)
        stays = np.exp(-roll / 0.06)
        own = stays * own + np.sqrt(1.0 - stays**2) * rng.standard_normal((4, 3))
        before, which = time, visit % 4
        error = np.linalg.cholesky(parts.white) @ rng.standard_normal(3)
        error += np.linalg.cholesky(surface) @ own[which]
        error[:2] += 3e-6 * wobble[:, which] + drift * parts.drift
        error[2] += 4e-4 * pixels[which]
        records.append(
            PatternRecord(
                number=visit,
                target=names[which],
                time=time,
                mode=TrackMode.TRACK,
                after=TrackMode.TRACK,
                refusal=Refusal.NONE,
                status=TrackStatus.MEASURED,
                amplitude=7e-3,
                centre=place[which, :2],
                position=place[which] + error,
                covariance=parts.whole,
                errors=replace(parts, image=image[which]),
                point=np.zeros(3),
                point_covariance=np.eye(3),
                truth=place[which],
                truth_point=np.zeros(3),
                samples=NOTHING,
            )
        )
    return records


def followed(poses: FilterModel, records: list[PatternRecord], first: int) -> FilterState:
    state = poses.begin(records[:first])
    for record in records[first:]:
        state = poses.updated(state, record)
    return state


@pytest.mark.slow
def test_the_filter_states_its_errors_where_errors_are_as_stated() -> None:
    """Claim: fed with visits whose errors are drawn from their parts, the filter's normalised squared errors of pose
    and rates are χ² of twelve; fed with the same as white noise they are not.

    Set-up: 30 runs of 80 visits to four targets of an object that moves and turns by up to 20 mm/s and 20 mrad/s along
    each axis; surface, wobble, pixels and drift as at 8 to 9 m, each a Gauss-Markov process. The last visit's errors.
    Expected: a mean of 12. Tolerance: 360 degrees of freedom, level 5e-5 on either side: 0.74 to 1.32 of it, which
    a σ that is wrong by a fifth leaves in nine of ten cases. As white noise, which the first twelve runs show, it is
    beyond 1.5, some four σ of χ² of 144 away; it is about 7.
    """
    rng = np.random.default_rng(31)
    poses = FilterModel({"a": CORNERS}, SEPARATION, UNREST, UNREST)
    objects = [moving(rng) for _ in range(30)]
    made = [(run(rng, 80, truth), truth.at(80 * PERIOD)) for truth in objects]
    told, taken_for_white = (
        np.mean([nees(followed(poses, records, 8), *truth) for records, truth in some]) / 12.0
        for some in (made, [(white(records), truth) for records, truth in made[:12]])
    )
    low, high = stats.chi2.ppf([5e-5, 1.0 - 5e-5], 360) / 360
    assert low < told < high
    assert taken_for_white > 1.5


def test_the_filter_knows_what_the_calibration_leaves_open() -> None:
    """Claim: where all visits of a run have the errors of a calibration in common, the filter's squared errors are χ²
    of twelve, and after 24 visits σ across is not below what the turn leaves: nine tenths of that at 8 m, the nearest
    range.

    Set-up: 60 runs of 24 visits, each with an instrument of its own: three errors of unit variance move Θ, φ and R by
    0.1 mrad and 3 mm, more than ten times what a visit has for itself. Tolerance: χ² of 720 degrees of freedom.
    """
    rng = np.random.default_rng(37)
    common = np.array([[1e-4, -4e-5, 0.0], [2e-5, 8e-5, 0.0], [0.0, 0.0, 3e-3]])
    poses = FilterModel({"a": CORNERS}, SEPARATION, UNREST, UNREST)
    squares = []
    for _ in range(60):
        truth, drawn = moving(rng), common @ rng.standard_normal(3)
        records = [
            replace(
                one,
                position=one.position + drawn,
                covariance=one.covariance + common @ common.T,
                errors=replace(one.errors, common=common),
            )
            for one in run(rng, 24, truth)
        ]
        state = followed(poses, records, 8)
        squares.append(nees(state, *truth.at(24 * PERIOD)))
        sigma = np.sqrt(np.diagonal(state.covariance_of()))
        assert (sigma[:2] > 0.9 * 8.0 * np.linalg.norm(common[:2], axis=1)).all()
    claim = claims.mean_square(np.sqrt(np.array(squares) / 12.0), freedom=720)
    assert claim
    assert claim.finds < 0.4


def test_what_measured_nothing_changes_nothing() -> None:
    rng = np.random.default_rng(32)
    records = run(rng, 9, moving(rng))
    poses = FilterModel({"a": CORNERS}, SEPARATION)
    state = poses.begin(records[:8])
    assert poses.updated(state, replace(records[8], status=TrackStatus.REFUSED)) is state
    assert poses.updated(state, replace(records[8], target="other")) is state
    with pytest.raises(InputError, match="2 targets were measured"):
        poses.begin(records[:2])


FASTEST = 0.1
"""Standard deviation of velocities [m/s] and rates of turn [rad/s] of objects that a filter begins with."""


def started(
    records: list[PatternRecord], truth: Moving, *, told: bool = False, further: int = 4
) -> tuple[int, float, list[float]]:
    """After how many visits a filter began, its squared errors then, and the surprises of some further visits."""
    poses = PoseFilter(
        {"a": CORNERS}, axis_separation=SEPARATION, acceleration=UNREST, turn_acceleration=UNREST
    )
    error, surprises = np.nan, list[float]()
    for number, record in enumerate(records):
        if told and truth.push[0] < record.time and number and records[number - 1].time < truth.push[0]:
            poses.push(truth.push[1], time=truth.push[0])
        poses.update(record)
        if poses.state is None:
            continue
        if np.isnan(error):
            begun, error = number + 1, nees(poses.state, *truth.at(record.time))
        else:
            surprises.append(poses.state.surprise)
        if len(surprises) == further:
            return begun, error, surprises
    raise AssertionError("it did not begin")


@pytest.mark.parametrize(
    "period", [PERIOD, 0.4, *(pytest.param(slow, marks=pytest.mark.slow) for slow in (0.1, 1.0))]
)
def test_the_filter_begins_with_visits_at_their_own_times(period: float) -> None:
    """Claim: the filter states its errors as it begins, and what the next visits show, whether the first visits follow
    at once or lie seconds apart, while the object moves and turns.

    Set-up: 60 objects whose rates are as the filter expects, by σ of 0.1 m/s and 0.1 rad/s along each axis. Between
    visits 1 s apart they move by σ of 0.1 m and 6°. Expected: squared errors of twelve, surprises of three. The
    filter begins with the third visit where they follow at once, and with the seventh at the latest. Tolerance: χ² of
    720 degrees of freedom; 5 % for what straight lines leave out. With all visits taken for one time squared
    errors were 10² times as large after one more visit at 0.1 s, and 10⁴ times at 0.4 s.
    """
    rng = np.random.default_rng([33, round(100 * period)])
    made = []
    for _ in range(60):
        truth = moving(rng, FASTEST)
        made.append(started(run(rng, 11, truth, period), truth))
    begun, errors, surprises = (np.array(part) for part in zip(*made, strict=True))
    assert begun.max() <= 7
    assert begun.min() == (3 if period == PERIOD else 4)
    for z in (np.sqrt(errors / 12.0), np.sqrt(surprises / 3.0)):
        claim = claims.mean_square(z, freedom=720, slack=0.05)
        assert claim
        assert claim.finds < 0.4


def test_of_errors_that_are_new_each_time_the_likeliest_motion_is_all_there_is() -> None:
    """Claim: where visits have nothing in common the filter begins with the likeliest motion itself, by rates that are
    expected about zero: with as large a σ as the visits leave them, so that they are drawn half of the way to it.

    Tolerance: a fiftieth of the filter's σ for steps that the search leaves out; without the draw they lie half of it
    away.
    """
    rng = np.random.default_rng(36)
    for _ in range(3):
        slow = moving(rng, 3e-4)
        records = white(run(rng, 8, slow, 0.1))
        poses = FilterModel({"a": CORNERS}, SEPARATION, UNREST, UNREST, fastest=3e-4, fastest_turn=3e-4)
        expected = Expected(3e-4, 3e-4, UNREST, UNREST)
        span = records[0].time, records[-1].time
        wanted = first_motion("a", CORNERS, records, span, SEPARATION, expected)
        found = poses.begin(records)
        sigma = np.sqrt(np.diagonal(found.covariance_of(0)))
        assert (sigma[6:] > 0.3 * 3e-4).any()
        away = np.concatenate([found.velocity[0] - wanted.velocity, found.turn_rate[0] - wanted.turn_rate])
        np.testing.assert_allclose(away / sigma[6:], 0.0, atol=0.02)


def test_the_filter_begins_across_a_push_that_it_is_told() -> None:
    """Claim: a push between the first visits is part of the motion if it is told; untold, it is taken for turns.

    Set-up: as above with 0.2 s between visits, and σ of 0.05 m/s along each axis after the third. Tolerance: χ² of 480
    degrees of freedom.
    """
    rng = np.random.default_rng(34)
    objects = [replace(moving(rng, FASTEST), push=(0.7, 0.05 * rng.standard_normal(3))) for _ in range(40)]
    made = [(run(rng, 11, truth, 0.2), truth) for truth in objects]
    begun, errors, surprises = zip(*(started(*one, told=True) for one in made), strict=True)
    assert max(begun) <= 7
    for z in (np.sqrt(np.array(errors) / 12.0), np.sqrt(np.array(surprises) / 3.0)):
        assert claims.mean_square(z, freedom=480, slack=0.05)
    early = [records[:4] for records, _ in made]
    untold = []
    for records, (_, truth) in zip(early, made, strict=True):
        poses = FilterModel({"a": CORNERS}, SEPARATION, UNREST, UNREST)
        with suppress(InputError):
            untold.append(nees(poses.begin(records), *truth.at(records[-1].time)))
    assert np.median(untold) > 100.0 * 12.0


def test_visits_that_show_no_motion_begin_nothing() -> None:
    """Claim: three visits far apart leave the attitude open; a target at a false place is no motion of the object."""
    rng = np.random.default_rng(35)
    poses = FilterModel({"a": CORNERS}, SEPARATION, UNREST, UNREST)
    records = run(rng, 12, moving(rng, FASTEST), 0.4)
    with pytest.raises(InputError, match="leave the attitude of 'a' open"):
        poses.begin(records[:3])
    false = replace(records[5], position=records[5].position + np.array([5e-4, 0.0, 0.0]))
    with pytest.raises(InputError, match="show no even motion"):
        poses.begin([*records[:5], false, *records[6:]])
    assert poses.begin(records[::-1]).time == records[-1].time


SCENE = """\
schema: 1
seed: {seed}
scene:
  objects:
    - name: node
      array: {{diameter: 100 mm, rows: 2, columns: 2, spacing: [0.8 m, 0.8 m], plate: 400 mm}}
      position: [{x} m, 0.1 m, 9 m]
      rotation: [{{axis: y, angle: {yaw} deg}}, {{axis: x, angle: {pitch} deg}}]
      motion: {{type: twist, velocity: [8 mm/s, -6 mm/s, 5 mm/s], turn_rate: [0.3 deg/s, 0.5 deg/s, -0.5 deg/s]}}
scan: {{type: track, duration: 0.8 s, targets: [node]}}
"""


def last_errors(made: Track) -> list[float]:
    """Squared errors after the last visit, by the filter fed with parts and with white noise."""
    scenario = scenario_from_text(made.scenario_yaml, name="scenario")
    separation = scenario.scanner.mirrors.axis_separation
    poses = FilterModel.of(made.targets, separation, acceleration=UNREST, turn_acceleration=UNREST)
    found = []
    for some in (list(made.records), white(list(made.records))):
        state = followed(poses, some, 12)
        first, then = true_poses(scenario, "node", np.array([state.time, state.time + 1e-3]))
        turn = vector_from_rotation(then[:3, :3] @ first[:3, :3].T)
        twist = np.concatenate([then[:3, 3] - first[:3, 3], turn]) / 1e-3
        found.append(nees(state, first, twist))
    return found


@pytest.mark.slow
@pytest.mark.usefixtures("device")
def test_the_filter_states_its_errors_in_the_closed_loop() -> None:
    """Claim: the same of tracked targets, from laser to filter, with all of the instrument's noise.

    Set-up: a square of four discs at 9 m, moving by 11 mm/s and turning by 0.8 deg/s; six runs of 80 visits.
    Expected: a mean of 12. Tolerance: 72 degrees of freedom, level 5e-5 on either side: 0.46 to 1.79 of it. Visits
    taken for white noise give about 5: as they must lie beyond the bound, too, the test can fail.
    """
    cases = ((1, 0.2, 10.0, -5.0), (2, -0.2, -8.0, 6.0), (3, 0.0, 4.0, 12.0))
    cases += ((4, 0.3, -12.0, -3.0), (5, -0.3, 6.0, 9.0), (6, 0.1, -3.0, -10.0))
    scenarios = [
        scenario_from_text(SCENE.format(seed=seed, x=x, yaw=yaw, pitch=pitch), name="moving.yaml")
        for seed, x, yaw, pitch in cases
    ]
    found = [last_errors(made) for made in track_many(scenarios, device="cpu")]
    told, taken_for_white = np.mean(found, axis=0) / 12.0
    low, high = stats.chi2.ppf([5e-5, 1.0 - 5e-5], 72) / 72
    assert low < told < high
    assert taken_for_white > high
