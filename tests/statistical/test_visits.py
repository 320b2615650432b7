"""Single visits of discs: σ that are honest at every attitude, distance and light, ranges that belong to their time.

Boards are those of ``benchmarks/visits.py``, which has the whole table: discs all over the field, each at its own
direction and range, turned about its own line of sight. The visits to one disc share its speckle, the place of its
spot on the pixels and its wobble: a disc counts as one normal number, which its four visits surpass by a little.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import claims
import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import Tracker, load_scenario, track_many
from scanner_sim.foundation.status import Status
from scanner_sim.tracking import measurement
from scanner_sim.tracking.record import PatternRecord, TrackStatus
from scanner_sim.tracking.state import TrackMode
from scanner_sim.tracking.target_ranges import target_ranges

pytestmark = [pytest.mark.usefixtures("device"), pytest.mark.slow]

Array = NDArray[np.float64]
BAND = 0.12
"""Half of what 0.9 to 1.15 allow a right mean of z², as a share."""
LEVEL = 3.9
"""Standard errors that a mean exceeds once in 10⁴ times."""


@pytest.fixture(scope="module")
def visits(repo_root: Path) -> Any:
    """The benchmark's module."""
    import importlib.util

    spec = importlib.util.spec_from_file_location("visits", repo_root / "benchmarks" / "visits.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def squares(visits: Any, pitch: float, yaw: float, distance: float, **more: Any) -> tuple[Array, int]:
    """Mean z² of each disc after the search, shape (discs, 3), and how many discs had a visit that did not measure."""
    means, missed = [], 0
    for index in range(3):
        made = visits.board(pitch, yaw, distance, 40 + index, **more)
        records = list(Tracker(made, device="cpu"))
        missed += len({record.target for record in records if record.status != TrackStatus.MEASURED})
        found, which, _ = visits.squares(records, {TrackMode.ACQUIRE, TrackMode.TRACK})
        means += [(found[which == disc] ** 2).mean(axis=0) for disc in np.unique(which)]
    return np.array(means), missed


@pytest.mark.parametrize(
    ("pitch", "yaw", "distance"),
    [(0, 0, 4), (40, 0, 4), (0, 40, 6), (30, 30, 6), (40, 0, 10), (0, 0, 20)],
)
def test_sigmas_are_honest_at_any_attitude(visits: Any, pitch: float, yaw: float, distance: float) -> None:
    """Claim: z² of Θ, φ and range is 1 in the mean, whatever the attitude and the distance, with all noise.

    Set-up: 27 discs of 100 mm, four visits each after the search. Expected: mean z² of 1; the claim is 0.9 to 1.15, and
    bounds are those of χ² with 27 degrees of freedom beyond it, 0.26 to 2.6. Of the discs at most one in 50 is missed
    by a visit. At (40, 0, 4) a plane without its curvature in the angles had 28 in range; at (0, 0, 20) half of the
    visits saw no two levels.
    """
    square, missed = squares(visits, pitch, yaw, distance)
    assert claims.at_most(missed, len(square), 0.02)
    for axis in range(3):
        assert claims.mean_square(np.sqrt(square[:, axis]), slack=BAND)


def test_both_rangefinders_state_what_triangulation_does_where_it_rules(visits: Any) -> None:
    """Claim: at 4 m, where pulses have a thousandth of a range, σ of ranges by both is that of triangulation to 2 %.

    Without what unlike pixels and speckle make visits share it was 0.6 of that.
    """
    sigma = []
    for ranging in ("triangulation", "both"):
        made = visits.board(0, 0, 4, 40, side=2, overrides=(f"ranging={ranging}",))
        records = [one for one in Tracker(made, device="cpu") if one.status == TrackStatus.MEASURED]
        sigma.append(np.median([one.covariance[2, 2] for one in records[-8:]]) ** 0.5)
    assert sigma[1] == pytest.approx(sigma[0], rel=0.02)


@pytest.mark.parametrize(("pitch", "yaw", "distance"), [(30, 30, 4), (20, 0, 6)])
def test_sigmas_of_retro_reflectors_are_honest(
    visits: Any, pitch: float, yaw: float, distance: float
) -> None:
    """Claim: z² of Θ, φ and range is 0.8 to 1.6 in the mean on discs of glass beads whose light is not clipped.

    Set-up: 27 discs of 100 mm on black plates, four visits each after the search, all noise. What the lobe does to the
    spot's light moves Θ by 4 µrad, half of its σ, which σ does not know: 0.3 of z². As circles through the crossings
    of their edges alone they had 0.00 to 0.04 in the angles, and 1.2 to 2 in range.
    """
    square, missed = squares(visits, pitch, yaw, distance, disc="retro_sheet")
    assert claims.at_most(missed, len(square), 0.02)
    for axis in range(3):
        assert claims.mean_square(np.sqrt(square[:, axis] / 1.2), slack=1.0 / 3.0)


@pytest.mark.parametrize("ranging", ["triangulation", "tof"])
@pytest.mark.parametrize("distance", [3.0, 12.0])
def test_sigmas_of_spheres_are_honest(visits: Any, distance: float, ranging: str) -> None:
    """Claim: z² of Θ, φ and range of the middles of spheres is at most 2 in the mean, and no middle lies 6 σ off.

    Set-up: 18 spheres of 200 mm before a wall, four visits each after the search, all noise; χ² with 18 degrees of
    freedom. By circles about what lies nearer than the wall, triangulation had 1.7 to 2 in Θ and 68 in range at 3 m, as
    one side of a sphere is seen beside the ground, and the other beside its shadow; pulses had 2.8 in φ at 12 m.
    """
    square, worst, missed = [], 0.0, 0
    for seed in (70, 71):
        made = visits.board(
            0, 0, distance, seed, diameter=0.2, spheres=True, overrides=(f"ranging={ranging}",)
        )
        records = list(Tracker(made, device="cpu"))
        missed += sum(record.status != TrackStatus.MEASURED for record in records)
        z, which, _ = visits.squares(records, {TrackMode.ACQUIRE, TrackMode.TRACK})
        square += [(z[which == ball] ** 2).mean(axis=0) for ball in np.unique(which)]
        worst = max(worst, float(np.abs(z).max()))
    assert claims.at_most(missed, 18 * 5, 0.02)
    assert (np.mean(square, axis=0) < 2.0 * (1.0 + LEVEL * np.sqrt(2.0 / len(square)))).all()
    assert worst < 6.0


def test_retro_reflectors_that_fill_the_wells_are_found(visits: Any) -> None:
    """Claim: at 10 and 15 m discs of 300 mm, 35 times as bright as white, are found by every visit, and no centre lies
    more than a twentieth of their radius off; σ does not say less than it is.

    Set-up: 18 discs at each distance. Where voxels without a signal of their own counted as dark, a third of the visits
    was refused, and others lay 1 to 7 mrad off. Expected: errors of up to a fourth of the gap between points, 1.7 and
    1.2 mrad; mean z² below 1 by χ² (18 discs).
    """
    for distance in (10.0, 15.0):
        square, missed = [], 0
        for seed in (60, 61):
            made = visits.board(0, 0, distance, seed, diameter=0.3, disc="retro_sheet")
            records = list(Tracker(made, device="cpu"))
            missed += sum(record.status != TrackStatus.MEASURED for record in records)
            for record in records:
                away = (record.position - record.truth)[:2]
                assert np.hypot(*away) < 0.05 * 0.15 / distance or record.mode is TrackMode.SEARCH
            z, which, _ = visits.squares(records, {TrackMode.ACQUIRE, TrackMode.TRACK})
            square += [(z[which == disc] ** 2).mean(axis=0) for disc in np.unique(which)]
        assert missed == 0
        assert (np.mean(square, axis=0)[:2] < 1.0 + LEVEL * np.sqrt(2.0 / len(square))).all()


ALONE = (
    "scanner.laser.speckle=false",
    "scanner.mirrors.wobble=0 rad",
    "scanner.mirrors.jitter=0 rad",
    "scanner.mirrors.readout_noise=0 rad",
    "scanner.mirrors.readout_step=0 rad",
)
"""The noise of the line sensor alone."""


def test_patterns_beside_discs_too_dark_to_be_found_are_honest() -> None:
    """Claim: z² of Θ and φ is 1 in the mean where a pattern lies beside a disc of which most voxels have no peak.

    Set-up: 32 runs with 36 black discs of 240 mm each at 24 m, whose voxels have three quarters of the light that a
    peak needs; first visits with the pattern of tracking, put 2 to 3 radii of the beam to one side, by lot. The noise
    of the line sensor alone: speckle and mirrors hide a third of it. Expected: mean z² of 1, with bounds of χ² (2304
    numbers), by which 1.17 is found; with dark voxels taken to have no light it is 1.31.
    """
    side, beam = 6, 0.253e-3
    random = np.random.default_rng(23)
    array = {"diameter": 0.24, "rows": side, "columns": side, "spacing": (0.8, 0.8), "plate": 0.7}
    far = {"name": "far", "array": array, "position": (0.0, 0.0, 24.0)}
    turns, away = random.uniform(0.0, 2.0 * np.pi, side**2), beam * random.uniform(2.0, 3.0, side**2)
    targets = [
        {"target": f"far/{number + 1}", "offset": (float(x), float(y), 0.0)}
        for number, (x, y) in enumerate(zip(away * np.cos(turns), away * np.sin(turns), strict=True))
    ]
    scan = {"type": "track", "targets": targets, "duration": 0.37, "tracker": {"search_amplitude": 1.22}}
    whole = {"schema": 1, "scene": {"objects": [far]}, "scan": scan, "scanner": {"laser_off": 0.5}}
    runs = [load_scenario(whole | {"seed": seed}, ALONE) for seed in range(1, 33)]
    records = [one for made in track_many(runs, device="cpu") for one in made.records[: side**2]]
    assert len({record.target for record in records}) == side**2
    assert all(record.status == TrackStatus.MEASURED for record in records)
    assert 0.1 < np.mean([record.samples.status == Status.BELOW_THRESHOLD for record in records]) < 0.3
    z = [(record.position - record.truth) / np.sqrt(np.diagonal(record.covariance)) for record in records]
    claim = claims.mean_square(np.array(z)[:, :2])
    assert claim.finds < 0.17
    assert claim


def test_sunlit_visits_without_dark_light_are_not_overconfident(visits: Any) -> None:
    """Claim: under the Sun with the laser on all the time, no visit errs far beyond its σ, not even in the search.

    Set-up: 18 discs at 10 m, four visits each. The background that a disc's rim leaves beneath the spots is not known:
    voxels there have a σ for it. Expected: mean z² of at most 1.15 by angle, no |z| of 5: of 150 normal ones one
    exceeds it in 10⁴ cases. Without that σ z² of φ is 7, and first visits lie 6 to 12 σ off.
    """
    found = []
    for index in range(2):
        records = list(Tracker(visits.board(0, 0, 10, 50 + index, visits=4, lit=True), device="cpu"))
        z, _, _ = visits.squares(records, set(TrackMode))
        found.append(z)
    z = np.concatenate(found)
    assert len(z) >= 60
    assert np.abs(z).max() < 5.0
    assert ((z[:, :2] ** 2).mean(axis=0) < 1.15 + LEVEL * np.sqrt(2.0 / 18.0)).all()


def test_first_visits_that_a_shadow_crosses_are_not_overconfident(repo_root: Path) -> None:
    """Claim: no first visit errs far beyond its σ where a visor's shadow leaves little light that tells the disc.

    Set-up: the vehicle of the approach 13 m away, its four discs of 100 mm seen first in ranges of triangulation, under
    eight places of the Sun, six seeds each. Sunlit voxels have a noise of 20 % there, and a pattern of the search
    crosses the rim four times. Expected: one visit in 200 at most with a |z| of 4.5 (two of 1900 were beyond, as most
    voxels on their discs had no range: one where the pattern has no points explains the rest), mean z² of the others at
    most 1, with as many numbers as there are discs and places. Fits alone have one in 25, and z² of 2.4 and 3.8.
    """
    found: dict[tuple[int, str], list[Array]] = {}
    for place in range(8):
        sun = {"beta": f"{10 + 7 * place} deg", "anomaly": f"{40 + 23 * place % 100} deg"}
        changes = [
            "scene.objects.0.position=[0 m, 0 m, 14.6 m]",
            "ranging=triangulation",
            "scan.duration=0.06 s",
            "transport.background_seed=3",
            *(f"lighting.orbit.{name}={angle}" for name, angle in sun.items()),
        ]
        vehicle = repo_root / "configs" / "approach" / "vehicle.yaml"
        runs = [load_scenario(vehicle, [*changes, f"seed={seed}"]) for seed in range(1, 7)]
        for made in track_many(runs, device="cpu"):
            first: dict[str, PatternRecord] = {}
            for record in made.records:
                if record.status == TrackStatus.MEASURED:
                    first.setdefault(record.target, record)
            for name, record in first.items():
                z = (record.position - record.truth) / np.sqrt(np.diagonal(record.covariance))
                found.setdefault((place, name), []).append(z[:2])
    largest = np.array([np.abs(z).max() for own in found.values() for z in own])
    assert len(largest) > 80
    assert claims.at_most(int((largest > 4.5).sum()), len(largest), 0.005)
    means = np.array([(np.clip(own, -4.5, 4.5) ** 2).mean(axis=0) for own in found.values()])
    assert (means.mean(axis=0) < 1.0 + LEVEL * np.sqrt(2.0 / len(means))).all()


def test_slopes_of_far_discs_are_not_those_of_their_rims(
    visits: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: slopes found at 30 m of discs that lean by 30° have no mean error, and scatter by no more than their σ.

    Set-up: 27 discs, no speckle, visits after the search. The rim moves ranges by some decimetres there, to one side on
    the left and to the other on the right: taken along, they turn planes about the vertical by 10 to 20°, and a circle
    that is laid on such a plane no longer tells the rim. Expected: means over the discs within the bounds of Student's
    t, which see half of a σ; mean z² of the discs' means within that of 54 normal numbers.
    """
    last: list[Any] = []

    def kept(*arguments: Any, **more: Any) -> Any:
        last[:] = [target_ranges(*arguments, **more)]
        return last[0]

    monkeypatch.setattr(measurement, "target_ranges", kept)
    z: list[Array] = []
    for index in range(3):
        made = visits.board(30, 0, 30, 60 + index, visits=4, overrides=("scanner.laser.speckle=false",))
        found: dict[str, list[Array]] = {}
        for record in Tracker(made, device="cpu"):
            if record.status == TrackStatus.MEASURED and record.mode != TrackMode.SEARCH:
                reach = record.truth[2]
                lean = np.array([0.0, reach * np.tan(np.deg2rad(30.0))])
                sigma = np.sqrt(np.diagonal(last[0].covariance[0])[1:])
                found.setdefault(record.target, []).append((last[0].slope[0] - lean) / sigma)
        z += [np.mean(own, axis=0) for own in found.values()]
    means = np.array(z)
    assert len(means) > 20
    for axis in range(2):
        assert claims.mean(means[:, axis])
    assert (means**2).mean() < 1.0 + LEVEL * np.sqrt(2.0 / means.size)


@pytest.mark.parametrize("pitch", [0.0, 25.0])
def test_the_range_belongs_to_its_time_stamp(pitch: float) -> None:
    """Claim: on a target that approaches or recedes, the range is that of the time stamp, not of other voxels' times.

    Set-up: a disc at 8 m that moves by 2 m/s along z, to and fro, 45 visits each; unlike pixels off, which move the
    ranges of neighbouring visits alike. Expected: errors along the motion, over its speed, have mean 0: within 3.9
    standard errors from the scatter of blocks of five visits, some 0.1 ms; twelve seeds had errors of 0.02 to 0.06 ms.
    Without the rise in time the range belongs to 0.2 ms later.
    """
    lags, blocks = [], []
    for speed in (2.0, -2.0):
        node = {"name": "node", "array": {"diameter": 0.1, "plate": 0.4}}
        node |= {"position": (0.1, 0.05, 8.0 - 0.35 * np.sign(speed))}
        node |= {"rotation": [{"axis": "x", "angle": f"{pitch} deg"}]}
        node |= {"motion": {"type": "twist", "velocity": (0.0, 0.0, speed)}}
        scan = {"type": "track", "targets": ["node"], "duration": 0.35}
        overrides = ("scan.tracker.fastest_range=3", "scanner.position_sensor.noise.prnu=false")
        made = load_scenario({"schema": 1, "seed": 9, "scene": {"objects": [node]}, "scan": scan}, overrides)
        late = [r for r in Tracker(made, device="cpu") if taken(r)]
        assert len(late) >= 40
        lag = np.array([r.position[2] - r.truth[2] for r in late]) / speed
        lags.append(lag)
        blocks += [part.mean() for part in np.array_split(lag, len(lag) // 5)]
    mean, error = np.mean(blocks), np.std(blocks, ddof=1) / np.sqrt(len(blocks))
    assert error < 0.08e-3
    assert abs(mean) < LEVEL * error, (mean, error)


def test_angles_of_what_comes_nearer_do_not_depend_on_how_the_pattern_runs(visits: Any) -> None:
    """Claim: a disc that grows during its pattern is measured as one at rest: patterns and inverted ones err alike.

    Set-up: without any noise, a disc of 60 mm that comes from 2.7 m to 2.4 m with 0.6 m/s and stands aside, so that it
    moves outward: 66 visits. Expected: rms errors of Θ and φ as of discs at rest, 1.7 and 1.5 µrad. Bound: twice that;
    a centre that is fitted as if the disc rested errs by 7.5 and 4.0 µrad, to one side and the other as the pattern is
    inverted.
    """
    node = {"name": "node", "array": {"diameter": 0.06, "plate": 0.12}, "position": (0.1, 0.1, 2.7)}
    node |= {"motion": {"type": "twist", "velocity": (0.0, 0.0, -0.6)}}
    scan = {"type": "track", "targets": ["node"], "duration": 0.5}
    base = {"schema": 1, "seed": 9, "scene": {"objects": [node]}, "scan": scan}
    late = [
        record
        for record in Tracker(
            load_scenario(base, ("scan.tracker.fastest_range=1", *visits.QUIET)), device="cpu"
        )
        if taken(record)
    ][5:]
    assert len(late) >= 60
    away = np.array([record.position - record.truth for record in late])[:, :2]
    assert np.sqrt((away**2).mean(axis=0)).max() < 3.4e-6


def taken(record: PatternRecord) -> bool:
    return record.status == TrackStatus.MEASURED and record.mode is TrackMode.TRACK
