"""Numbers of tracking by hand: targets that come nearer, what a fit begins from, limits of a scan and its warnings."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from scanner_sim import load_scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.optics.jump import jump_time
from scanner_sim.scan.schedule import Visiting
from scanner_sim.scan.ways import MOST_UPDATES
from scanner_sim.tracking.centroid import Centroid
from scanner_sim.tracking.disc_fit import disc_fit
from scanner_sim.tracking.response import Response
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.scan import FollowedTarget
from scanner_sim.tracking.state import TrackerSettings, init
from scanner_sim.tracking.warnings import track_warnings


def test_a_target_that_comes_nearer_is_no_brighter_at_rest() -> None:
    """Claim: light ∝ 1/R², seen while the target moves by R′ t along its beam and Θ′ t, φ′ t aside, is that of R at the
    stamp, and so are its angles from the centre, ∝ 1/R, and its ranges."""
    stamp, place = np.array([0.3]), np.array([[0.1, -0.05, 4.0]])
    rates = np.array([[0.02, -0.01, -0.6]])
    time = np.array([[0.25, 0.3, 0.33]])
    gone = time - 0.3
    reach = 4.0 - 0.6 * gone
    off = np.array([5e-3, -3e-3])
    aside = off[:, None] * 4.0 / reach
    one = np.ones((1, 3))
    samples = PatternSamples(
        time,
        0.1 + 0.02 * gone + aside[:1],
        -0.05 - 0.01 * gone + aside[1:],
        16.0 / reach**2,
        0.16 / reach**2,
        reach,
        1e-3 * one,
        np.zeros((1, 3), np.uint8),
    )
    still = samples.at_rest(stamp, place, rates)
    # First order in what changes: the square of 0.7 % is left.
    np.testing.assert_allclose(still.theta, 0.105 * one, atol=1e-6)
    np.testing.assert_allclose(still.phi, -0.053 * one, atol=1e-6)
    np.testing.assert_allclose(still.signal, one, rtol=2e-4)
    np.testing.assert_allclose(still.sigma_signal, 0.01 * one, rtol=2e-4)
    np.testing.assert_allclose(still.range, 4.0 * one, rtol=1e-12)


def test_a_disc_is_found_where_its_levels_are_clear_and_its_search_began() -> None:
    """Claim: of four equal patterns of a disc's exact values only that with both is found."""
    turn = np.linspace(0.0, 6.0 * np.pi, 90)
    place = 1.2e-2 * np.stack([np.cos(turn) * np.cos(turn / 3.0), np.sin(turn)])
    value = np.where(np.hypot(*place) < 8e-3, 1.0, 0.1)
    rows = np.ones((4, 1))
    one = rows * np.ones(90)
    clear = np.array([True, True, False, False])
    began = np.array([True, False, True, False])
    samples = PatternSamples(
        one, rows * place[0], rows * place[1], rows * value, one, one, one, np.zeros((4, 90), np.uint8)
    )
    level = np.ones(4)
    used = np.ones((4, 90), dtype=bool)
    response = Response(
        value=rows * value,
        sigma=1e-2 * one,
        used=used,
        hit=rows * value > 0.5,
        threshold=0.55 * level,
        target=level,
        ground=0.1 * level,
        clear=clear,
        fraction=0.5 * level,
        clipped=~used,
    )
    start = Centroid(np.zeros((4, 2)), np.zeros((4, 2, 2)), 8e-3 * level, 1e-4 * level, level, began)
    found = disc_fit(samples, response, start, spot=3e-4)
    assert found.found.tolist() == [True, False, False, False]
    other = disc_fit(samples, replace(response, clear=began), replace(start, found=clear), spot=3e-4)
    assert other.found.tolist() == [True, False, False, False]


def test_what_is_searched_lies_within_the_largest_search() -> None:
    """Claim: before anything is seen Θ and φ are known to the largest search pattern, R to a metre, by their σ."""
    settings = TrackerSettings(search_most=0.03)
    motion = init(np.array([0.1, 0.0, 6.0]), settings, 2.0).motion
    np.testing.assert_allclose(np.sqrt(np.diag(motion.covariance)[:3]), [0.03, 0.03, 1.0])
    assert motion.time == 2.0
    np.testing.assert_array_equal(motion.mean[:3], [0.1, 0.0, 6.0])


def test_only_ranges_that_are_none_are_refused() -> None:
    """Claim: any range ahead is one, however short; 0 is none, as those behind are, and no offset makes one of it: the
    message is of the range itself."""
    for near in (8.0, 1e-6):
        assert FollowedTarget(target="node", expected=(-0.1, -0.2, near)).expected == (-0.1, -0.2, near)
    for none in (0.0, -8.0):
        with pytest.raises(ValueError, match=f"a range of {none:g} m is none"):
            FollowedTarget(target="node", expected=(0.1, 0.2, none), offset=(0.0, 0.0, 9.0))


def track(*objects: dict[str, Any], scanner: dict[str, Any] | None = None, **changes: Any) -> Any:
    names = [item["name"] for item in objects]
    return load_scenario(
        {
            "schema": 1,
            "scene": {"objects": list(objects)},
            "scan": {"type": "track", "targets": names} | changes,
            "scanner": scanner or {},
        }
    )


def disc(name: str, x: float, z: float = 8.0) -> dict[str, Any]:
    return {"name": name, "array": {"diameter": 0.1, "plate": 0.11}, "position": (x, 0.0, z)}


def said(scenario: Any) -> str:
    scanner = scenario.scanner
    return " ".join(
        track_warnings(
            scenario.scan,
            scenario.targets,
            scanner.galvanometers,
            scanner.dwell,
            scanner.mirrors.max_deflection,
        )
    )


@pytest.mark.parametrize("points", [128, 4096])
@pytest.mark.parametrize("count", [1, 2])
def test_a_scan_holds_so_many_visits(points: int, count: int) -> None:
    """Claim: a tracked scan lasts the visits that memory holds, 2²⁵ or 2³² voxels, times (turning round + points ·
    dwell), and between several targets the time of a jump."""
    nodes = [disc(f"node{number}", 0.3 * number) for number in range(count)]
    pattern = {"points": points}
    scenario = track(*nodes, pattern=pattern)
    visiting, servos = scenario.scan.visiting, scenario.scanner.galvanometers
    period = visiting.turnaround + points * scenario.scanner.dwell
    period += (count - 1) * jump_time(servos, visiting.stated_jump)
    most = {128: 2**25, 4096: 2**20}[points] * period
    track(*nodes, pattern=pattern, duration=0.999 * most)
    with pytest.raises(InputError, match="patterns"):
        track(*nodes, pattern=pattern, duration=1.001 * most)


def test_the_longest_jump_is_from_one_end_of_the_field_to_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the drive's updates of a visit are those of a jump of twice the largest deflection, and as many as may be
    are taken."""
    scanner = track(disc("node", 0.0)).scanner
    farthest, asked = 2.0 * scanner.mirrors.max_deflection, []
    for updates, possible in ((MOST_UPDATES, True), (MOST_UPDATES + 1, False)):
        monkeypatch.setattr(
            Visiting, "updates_of", lambda *given, updates=updates: asked.append(given) or updates
        )
        if possible:
            track(disc("node", 0.0))
        else:
            with pytest.raises(InputError, match="updates of the drive's command"):
                track(disc("node", 0.0))
    assert {given[1:] for given in asked} == {(128, scanner.dwell, farthest, scanner.galvanometers)}


@pytest.mark.parametrize(("share", "passes"), [(0.99, True), (1.01, False)])
def test_encoders_see_the_end_of_a_pattern(share: float, passes: bool) -> None:
    """Claim: their readings may be late by less than the points of a pattern times the dwell of each."""
    whole = track(disc("node", 0.0)).scan.pattern.points * 2e-6
    quick = {"rate": 0.5e6, "galvanometers": {"readout_delay": share * whole}}
    if passes:
        track(disc("node", 0.0), scanner=quick)
    else:
        with pytest.raises(InputError, match="are no less than the"):
            track(disc("node", 0.0), scanner=quick)


def test_patterns_that_leave_the_field_or_meet_another_target_are_told() -> None:
    """Claim: a pattern of 1.22 radii of 50 mm at 8 m is 7.625 mrad wide; it leaves the field where its middle is
    nearer to the end than that, and meets a disc whose rim is nearer, 61 mm + 50 mm from its middle."""
    quiet = track(disc("one", -0.0565), disc("two", 0.0565))
    assert "also meets" not in said(quiet)
    assert "also meets" in said(track(disc("one", -0.0545), disc("two", 0.0545)))
    assert "also meets" not in said(track(disc("one", -0.0545), disc("two", 0.0545, z=8.7)))
    limit = quiet.scanner.mirrors.max_deflection
    for share, told in ((1.03, False), (0.97, True)):
        wide = {"target": "one", "expected": (limit - share * 7.625e-3, 0.0, 8.0)}
        scenario = load_scenario(
            {
                "schema": 1,
                "scene": {"objects": [disc("one", 0.0)]},
                "scan": {"type": "track", "targets": [wide]},
            }
        )
        assert ("leaves the field of view" in said(scenario)) == told


def test_runs_that_end_before_all_are_visited_are_told() -> None:
    """Claim: the second of two targets is visited from one period on."""
    both = disc("one", -0.2), disc("two", 0.2)
    scenario = track(*both)
    scan = scenario.scan
    period = scan.visiting.period(
        scan.pattern.points, scenario.scanner.dwell, 2, scenario.scanner.galvanometers
    )
    assert "are visited" in said(track(*both, duration=0.98 * period))
    assert "are visited" not in said(track(*both, duration=1.02 * period))


def test_a_search_that_the_mirrors_cannot_follow_is_told() -> None:
    """Claim: the largest search is judged where it is wider than what follows, and by its own amplitude."""
    assert "search_most" in said(track(disc("node", 0.0), tracker={"search_most": 1.2}))
    assert "search_most" not in said(track(disc("node", 0.0), tracker={"search_most": 7e-3}))
