"""From visits to poses: which rounds count, whose poses are compared, and where the outline of a target is."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scanner_sim.instrument.closed_loop import poses
from scanner_sim.instrument.closed_loop.poses import outlines_of, poses_of, rims_of
from scanner_sim.pose.settings import PoseSettings
from scanner_sim.ranging.axes import Axes
from scanner_sim.tracking.errors import ErrorParts
from scanner_sim.tracking.record import TrackStatus
from scanner_sim.tracking.state import TrackMode

SCENARIO = """\
schema: 1
scene:
  objects:
    - {name: a, array: {diameter: 100 mm, plate: 150 mm}, position: [0 m, 0 m, 8 m]}
    - name: b
      array: {diameter: 100 mm, plate: 150 mm}
      position: [1 m, 0 m, 8 m]
      rotation: {axis: y, angle: 30 deg}
    - {name: ball, shape: sphere, diameter: 100 mm, position: [0 m, 1 m, 8 m], material: z93_white}
scan: {type: track, targets: [a, b]}
"""
FOUND = SimpleNamespace(diameter=0.1)


def target(name: str, item: str) -> Any:
    return SimpleNamespace(name=name, object=item, centre=np.zeros(3), appearance=FOUND)


def visit(
    name: str,
    time: float,
    status: TrackStatus = TrackStatus.MEASURED,
    at: float = 8.0,
    after: TrackMode = TrackMode.TRACK,
) -> Any:
    return SimpleNamespace(
        target=name,
        time=time,
        status=status,
        after=after,
        position=np.array([0.0, 0.0, at]),
        errors=ErrorParts.all_white(np.eye(3)),
        truth_point=np.array(
            [0.9, -1.2, 5.0] if name == "ball" else [1.0, 0.0, 8.0] if name[0] == "b" else [0.0, 0.0, 8.0]
        ),
    )


def track(*visits: Any) -> Any:
    carried = [target(f"{item}/{number}", item) for item in "ab" for number in range(3)]
    targets = (*carried, target("ball", "ball"))
    return SimpleNamespace(records=visits, targets=targets, scenario_yaml=SCENARIO, axes=Axes(0.05))


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What poses and relative poses were asked of, instead of being computed."""
    noted: list[Any] = []

    def series(name: str, points: Any, time: Any, observations: Any, *, method: str, **more: Any) -> Any:
        noted.append((name, method, list(time)))
        return SimpleNamespace(name=name, method=method)

    monkeypatch.setattr(poses, "pose_series", series)
    monkeypatch.setattr(
        poses, "relative_series", lambda a, b, both: noted.append((a.name, b.name, a.method, b.method))
    )
    return noted


def rounds(last: int) -> list[Any]:
    """Two rounds of six visits, a tenth of a second apart, and some of a third."""
    names = [f"{item}/{number}" for item in "ab" for number in range(3)]
    return [visit(name, 0.1 * (6 * turn + place)) for turn in range(3) for place, name in enumerate(names)][
        : 12 + last
    ]


@pytest.mark.parametrize(("last", "times"), [(0, [0.25, 0.85]), (5, [0.25, 0.85]), (6, [0.25, 0.85, 1.45])])
def test_a_round_counts_when_it_is_whole(asked: list[Any], last: int, times: list[float]) -> None:
    """Claim: poses are at the mean times of rounds, 0.6 s apart; one that lacks a visit at the end is left out."""
    poses_of(track(*rounds(last)), PoseSettings(methods=("uv",)))
    assert asked[0] == ("a", "uv", pytest.approx(times))


@pytest.mark.parametrize(
    "kept_out",
    [{"status": TrackStatus.REFUSED}, {"after": TrackMode.ACQUIRE}, {"status": TrackStatus.NOT_FOUND}],
)
def test_what_was_not_followed_gives_no_place(
    monkeypatch: pytest.MonkeyPatch, kept_out: dict[str, Any]
) -> None:
    """Claim: of two rounds the observations are those of targets that were measured and are followed; a visit that was
    refused, or measured while its target is acquired, leaves its place empty, and its round at the same mean time."""
    given: list[Any] = []

    def noted(time: Any, position: Any, errors: Any, at: Any) -> Any:
        given.append((time, position, at))
        return SimpleNamespace(of=lambda columns: None)

    monkeypatch.setattr(poses, "interpolate", noted)
    monkeypatch.setattr(
        poses, "pose_series", lambda name, *rest, **more: SimpleNamespace(name=name, method="")
    )
    monkeypatch.setattr(poses, "relative_series", lambda a, b, both: None)
    visits = rounds(0)
    visits[8] = visit(visits[8].target, visits[8].time, **kept_out)
    poses_of(track(*visits), PoseSettings(methods=("uv",)))
    ((time, position, at),) = given
    empty = np.zeros((2, 6), dtype=bool)
    empty[1, 2] = True
    np.testing.assert_array_equal(np.isnan(time), empty)
    np.testing.assert_array_equal(np.isnan(position).any(axis=-1), empty)
    assert list(at) == pytest.approx([0.25, 0.85])


def test_objects_are_compared_by_one_method_each(asked: list[Any]) -> None:
    """Claim: of two objects and two methods there are four series, and two relative ones, each by a method alone."""
    poses_of(track(*rounds(0)), PoseSettings(methods=("uv", "xyz")))
    assert [(name, method) for name, method, _ in asked[:4]] == [
        ("a", "uv"), ("a", "xyz"), ("b", "uv"), ("b", "xyz"),
    ]  # fmt: skip
    assert asked[4:] == [("a", "b", "uv", "uv"), ("a", "b", "xyz", "xyz")]


def test_the_outline_of_a_target_is_as_wide_as_it_is() -> None:
    """Claim: a disc of 100 mm 8 m ahead, on the axis of both mirrors, spans 100 mm over 8 m in Θ, and over 8 m less the
    distance of the axes in φ; a ball of the same diameter spans it over its distances from both axes."""
    rim = rims_of(track())
    separation = 0.05
    disc = rim(visit("a/0", 0.0))
    span = np.ptp(disc, axis=0)
    assert span[0] == pytest.approx(0.1 / 8.0, rel=1e-3)
    assert span[1] == pytest.approx(0.1 / (8.0 - separation), rel=1e-3)
    seen = visit("ball", 0.0)
    x, y, z = seen.truth_point
    reach = np.hypot(y, z - separation)
    ball = rim(seen)
    assert np.ptp(ball, axis=0) == pytest.approx(
        [0.1 / np.hypot(x, reach + separation), 0.1 / reach], rel=0.02
    )
    assert ball[:-1].mean(axis=0) == pytest.approx(
        [np.arctan2(x, reach + separation), np.arctan2(y, z - separation)], abs=2e-4
    )


def test_a_true_outline_is_where_the_believed_mirrors_point() -> None:
    """Claim: beams at the outline's deflections, turned by φ about the line through (0, e, D_g) along
    (cos s, sin s, 0), pass it: SciPy's rotation, with axes that are neither square nor meet."""
    made, seen = track(), visit("b/0", 0.0)
    made.axes = Axes(0.06, offset=5e-3, skew=-0.02)
    ((across, down),) = outlines_of(made)([seen])
    turn = np.linspace(0.0, 2.0 * np.pi, 181)[:, None]
    points = seen.truth_point + np.cos(turn) * across + np.sin(turn) * down
    middle, axis = np.array([0.0, 5e-3, 0.06]), np.array([np.cos(0.02), -np.sin(0.02), 0.0])
    for (theta, phi), point in zip(rims_of(made)(seen), points, strict=True):
        second = Rotation.from_rotvec(-phi * axis)
        beam = second.apply([np.sin(theta), 0.0, np.cos(theta)])
        away = point - (middle - second.apply(middle))
        assert np.linalg.norm(np.cross(away, beam)) == pytest.approx(0.0, abs=1e-9)


def test_outlines_lie_in_the_plane_of_discs_and_across_the_line_to_all_else() -> None:
    """Claim: of visits in any order, half axes of 50 mm; those of a board turned by 30° about y lie along its axes."""
    names = ("b/1", "ball", "a/0", "b/2")
    visits = [visit(name, 0.1 * number) for number, name in enumerate(names)]
    half = outlines_of(track())(visits)
    assert half.shape == (4, 2, 3)
    turned = 0.05 * np.array([[np.cos(np.pi / 6), 0.0, -np.sin(np.pi / 6)], [0.0, 1.0, 0.0]])
    for number, expected in ((0, turned), (2, 0.05 * np.eye(3)[:2]), (3, turned)):
        assert half[number] == pytest.approx(expected, abs=1e-15)
    first, second = half[1]
    gram = np.array([first, second, visits[1].truth_point]) @ np.array([first, second]).T
    assert gram == pytest.approx(np.array([[0.05**2, 0.0], [0.0, 0.05**2], [0.0, 0.0]]), abs=1e-15)
    assert first[1] == 0.0
    assert outlines_of(track())([]).shape == (0, 2, 3)
