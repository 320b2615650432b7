"""Targets beside one another along both axes, of unlike sizes and gates: what is refused, and what is warned of."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Galvanometers

from scanner_sim.ranging.axes import Axes
from scanner_sim.scan.lissajous import LissajousPattern
from scanner_sim.scan.schedule import Visiting
from scanner_sim.tracking.lasting import _positive
from scanner_sim.tracking.measurement import TargetAppearance
from scanner_sim.tracking.record import Track, TrackStatus, TrackTarget
from scanner_sim.tracking.response import TargetKind
from scanner_sim.tracking.scan import _clash
from scanner_sim.tracking.state import TrackerSettings, TrackMode
from scanner_sim.tracking.warnings import track_warnings

SERVOS = Galvanometers(natural_frequency=1e5, slew=1e5, acceleration=1e9)


def target(name: str, place: tuple[float, float, float], diameter: float, depth: float) -> TrackTarget:
    appearance = TargetAppearance(kind=TargetKind.BLACK, diameter=diameter, depth=depth)
    return TrackTarget(name, name, appearance, np.array(place), np.zeros(3))


def said(*targets: TrackTarget, aspect: float = 1.0, field: float = 0.5, duration: float = 9.0) -> list[str]:
    pattern = LissajousPattern(aspect=aspect)
    scan: Any = SimpleNamespace(
        pattern=pattern, tracker=TrackerSettings(), visiting=Visiting(), duration=duration
    )
    return list(track_warnings(scan, targets, SERVOS, 50e-6, field))


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_pattern_leaves_the_field_by_its_own_reach(axis: int, side: float) -> None:
    """Claim: along Θ it reaches 1.22 radii of its target, along φ that times the aspect, to either side."""
    reach = 1.22 * (0.03 / 5.0) * (1.0, 0.4)[axis]
    for share, told in ((1.02, False), (0.98, True)):
        place = [0.1, -0.1, 5.0]
        place[axis] = side * (0.5 - share * reach)
        sentences = said(target("one", (place[0], place[1], 5.0), 0.06, 0.3), aspect=0.4)
        assert any("leaves the field of view" in one for one in sentences) is told
        if told:
            angle = f"{np.degrees(place[axis]):.4g}°"
            assert f"{'Θφ'[axis]} {angle}" in sentences[0]


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sizes", [(0.04, 0.1), (0.1, 0.04)])
@pytest.mark.parametrize("beside", [-1.0, 1.0])
def test_a_pattern_meets_another_target_by_both_sizes(
    axis: int, sizes: tuple[float, float], beside: float
) -> None:
    """Claim: the larger of both patterns and the larger of both discs count, the pattern along φ by its aspect; one
    that is off along one axis alone is met no more, nor is one beyond both range gates, of 0.2 and 0.35 m."""
    for share, along, told in ((0.98, 0.53, True), (1.02, 0.53, False), (0.98, 0.57, False)):
        ranges = 5.0 + along, 5.0
        amplitude = 1.22 * max(0.5 * size / reach for size, reach in zip(sizes, ranges, strict=True))
        place = [0.02, -0.03]
        place[axis] += beside * share * (amplitude * (1.0, 0.4)[axis] + 0.05 / ranges[1])
        one = target("one", (0.02, -0.03, ranges[0]), sizes[0], 0.2)
        other = target("two", (place[0], place[1], ranges[1]), sizes[1], 0.35)
        met = [text for text in said(one, other, aspect=0.4) if "'one' also meets 'two'" in text]
        assert bool(met) is told


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0, 4.0])
@pytest.mark.parametrize(
    ("share", "depth", "clashes"), [(0.98, 0.16, True), (1.02, 0.16, False), (0.98, 0.14, False)]
)
def test_targets_overlap_by_their_distance_in_any_direction(
    angle: float, share: float, depth: float, clashes: bool
) -> None:
    """Claim: discs whose middles are nearer than both radii overlap, wherever one lies from the other, unless their
    ranges lie apart by both gates; what is said has the distance and the radii. One name is one target."""
    radii = 0.04 / 8.0 + 0.01 / 7.6
    place = (0.1 + share * radii * np.cos(angle), 0.2 + share * radii * np.sin(angle), 7.6)
    one, other = target("one", (0.1, 0.2, 8.0), 0.08, 0.25), target("two", place, 0.02, depth)
    aside = target("far", (-0.3, 0.0, 8.0), 0.1, 0.3)
    for first, second in ((one, other), (other, one)):
        found = _clash(first, [aside, second])
        assert (found is not None) is clashes
        if found is not None:
            assert f"{1e3 * share * radii:.3g} mrad apart" in found[0]
            assert f"together are {1e3 * radii:.3g} mrad" in found[0]
    assert _clash(target("one", (0.3, 0.2, 8.0), 0.08, 0.25), [aside, one]) is not None


def test_a_finite_sums_negative_variances_are_none() -> None:
    """Claim: a variance below 0 becomes 0, and a covariance of Θ and φ what their σ allow; what is possible stays."""
    rng = np.random.default_rng(4)
    root = rng.normal(size=(20, 3, 3))
    fine = np.zeros((20, 3, 3))
    fine[:, :2, :2] = (root @ root.transpose(0, 2, 1))[:, :2, :2]
    fine[:, 2, 2] = rng.uniform(0.0, 2.0, 20)
    np.testing.assert_array_equal(_positive(fine), fine)
    for sign in (-1.0, 1.0):
        wide = np.array([[4.0, sign * 7.0, 0.0], [sign * 7.0, 9.0, 0.0], [0.0, 0.0, -1.0]])
        expected = [[4.0, sign * 6.0, 0.0], [sign * 6.0, 9.0, 0.0], [0.0, 0.0, 0.0]]
        np.testing.assert_allclose(_positive(wide[None])[0], expected)
    lost = _positive(np.array([[[-1e-3, 0.5, 0.0], [0.5, 2.0, 0.0], [0.0, 0.0, 3.0]]]))[0]
    np.testing.assert_array_equal(lost, np.diag([0.0, 2.0, 3.0]))


def visit(name: str, time: float, sigma: float, status: TrackStatus, after: TrackMode) -> Any:
    covariance: NDArray[np.float64] = np.diag([1.0, 2.0, sigma**2])
    return SimpleNamespace(target=name, time=time, covariance=covariance, status=status, after=after)


def test_a_notebook_shows_each_target_as_it_was_followed() -> None:
    """Claim: of each target its visits, how many were measured, the median σ of these ranges and its last state; one
    that was never visited says so; the time is that of the last visit."""
    ok, refused = TrackStatus.MEASURED, TrackStatus.REFUSED
    records: Any = (
        visit("one", 0.1, 2e-3, ok, TrackMode.ACQUIRE),
        visit("two", 0.2, 7e-3, refused, TrackMode.SEARCH),
        visit("one", 0.3, 9e-3, refused, TrackMode.TRACK),
        visit("one", 0.5, 4e-3, ok, TrackMode.TRACK),
        visit("one", 0.45, 3e-3, ok, TrackMode.LOST),
    )
    targets = tuple(target(name, (0.0, 0.0, 5.0), 0.1, 0.3) for name in ("one", "two", "three"))
    track = Track(records, targets, 11, "", "", Axes(0.05), warnings=("it is late",))
    assert [record.time for record in track.of("one")] == [0.1, 0.3, 0.5, 0.45]
    html = track._repr_html_()
    assert "5 visits in 0.5 s, seed 11" in html
    cells = [part.split("<")[0] for part in html.split(">") if part.split("<")[0].strip()]
    at = cells.index("one")
    assert cells[at : at + 5] == ["one", "4", "3", "3 mm", "lost"]
    assert cells[at + 5 : at + 10] == ["two", "1", "0", "none", "search"]
    assert cells[at + 10 : at + 15] == ["three", "0", "0", "none", "never visited"]
    assert "it is late" in html
