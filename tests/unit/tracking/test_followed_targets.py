"""What a scan follows: looks taken from the scene, and targets that nothing can tell apart."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from scanner_sim import load_scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.ranging.coordinates import coordinates
from scanner_sim.tracking.response import TargetKind


def followed(*objects: dict[str, Any], names: tuple[str, ...] = ("node",)) -> Any:
    return load_scenario(
        {
            "schema": 1,
            "scene": {"objects": list(objects)},
            "scan": {"type": "track", "targets": list(names)},
        }
    )


def array(name: str = "node", x: float = 0.0, z: float = 8.0, **more: Any) -> dict[str, Any]:
    return {"name": name, "array": {"diameter": 0.1, "plate": 0.15}, "position": (x, 0.0, z), **more}


@pytest.mark.parametrize(
    ("appearance", "kind"),
    [
        ({}, TargetKind.BLACK),
        ({"disc": "target_white", "material": "target_black"}, TargetKind.WHITE),
        ({"disc": "retro_sheet"}, TargetKind.RETRO),
        ({"disc": {"reflectance": 0.3}, "material": {"reflectance": 0.4}}, TargetKind.BLACK),
        ({"disc": {"reflectance": 0.3}, "material": {"reflectance": 0.2}}, TargetKind.WHITE),
        ({"disc": {"reflectance": 0.9}, "material": "target_black"}, TargetKind.WHITE),
    ],
)
def test_discs_are_what_they_are_beside_their_plates(appearance: dict[str, Any], kind: TargetKind) -> None:
    target = followed(array(**appearance)).targets[0]
    assert target.appearance.kind is kind
    assert target.appearance.diameter == pytest.approx(0.1)


@pytest.mark.parametrize(("apart", "overlap"), [(0.09, True), (0.12, False), (0.16, False)])
def test_targets_overlap_within_both_radii(apart: float, overlap: bool) -> None:
    """Claim: discs of 100 mm overlap less than 100 mm apart, and not beyond, at one range."""
    both = array(x=-0.5 * apart), array("other", x=0.5 * apart)
    if overlap:
        with pytest.raises(InputError, match="overlaps"):
            followed(*both, names=("node", "other"))
    else:
        assert len(followed(*both, names=("node", "other")).targets) == 2


def test_targets_one_behind_the_other_do_not_overlap() -> None:
    """Claim: beyond both range gates, of 0.3 m each, ranges tell targets apart."""
    with pytest.raises(InputError, match="overlaps"):
        followed(array(), array("other", z=8.5), names=("node", "other"))
    assert len(followed(array(), array("other", z=8.7), names=("node", "other")).targets) == 2


def test_members_of_an_array_are_counted_from_one_and_stand_where_they_are() -> None:
    """Claim: of two discs 0.4 m apart the second is at the right, at Θ > 0; an offset is added."""
    row = array(columns=2)
    row["array"] |= {"columns": 2, "spacing": (0.4, 1.0)}
    del row["columns"]
    (first,), (second,) = (followed(row, names=(f"node/{member}",)).targets for member in (1, 2))
    assert (first.name, second.name) == ("node/1", "node/2")
    assert (first.centre[0], second.centre[0]) == pytest.approx((-0.2, 0.2))
    assert (first.expected[0], second.expected[0]) == pytest.approx((-0.025, 0.025), rel=2e-3)
    assert second.expected[1] == pytest.approx(0.0, abs=1e-12)
    asked = {"target": "node/2", "offset": (1e-3, -2e-3, 0.05)}
    (moved,) = followed(row, names=(asked,)).targets  # type: ignore[arg-type]
    assert (moved.expected - second.expected).tolist() == pytest.approx([1e-3, -2e-3, 0.05])


def test_a_moving_target_is_expected_where_it_is_at_the_start() -> None:
    """Claim: a target at 8 m that comes nearer by 1 m/s is expected at 8 m."""
    motion = {"type": "twist", "velocity": (0.0, 0.0, -1.0)}
    (target,) = followed(array(motion=motion)).targets
    assert target.expected.tolist() == pytest.approx([0.0, 0.0, 8.0], abs=1e-12)


@pytest.mark.parametrize(
    "shape", [{"shape": "rectangle", "size": (0.1, 0.1)}, {"shape": "disc", "diameter": 0.2}]
)
@pytest.mark.parametrize(
    "told", [{}, {"kind": "black"}, {"diameter": 0.3}, {"kind": "black", "diameter": 0.3}]
)
def test_a_target_needs_both_kind_and_diameter(shape: dict[str, Any], told: dict[str, Any]) -> None:
    """Claim: a plain rectangle has neither, and is refused unless both are told; a disc is raised and has its own
    diameter, and what is told goes before either."""
    item = {"name": "node", "position": (0.0, 0.0, 8.0), "material": "grey_reference", **shape}
    scan = {"type": "track", "targets": [{"target": "node", **told}]}
    given = {"schema": 1, "scene": {"objects": [item]}, "scan": scan}
    if shape["shape"] == "rectangle" and len(told) < 2:
        with pytest.raises(InputError, match="node"):
            load_scenario(given)
        return
    (target,) = load_scenario(given).targets
    assert target.appearance.kind is TargetKind(told.get("kind", TargetKind.RAISED))
    assert target.appearance.diameter == told.get("diameter", 0.2)


def grid(rows: int, columns: int) -> dict[str, Any]:
    pattern = {"diameter": 0.05, "plate": 0.1, "rows": rows, "columns": columns, "spacing": (0.3, 0.2)}
    return {"name": "node", "array": pattern, "position": (0.0, 0.0, 8.0)}


def test_all_members_of_an_array_are_followed_where_they_stand() -> None:
    """Claim: an array's name stands for its members, row by row from the top left, each by its own number."""
    scenario = followed(grid(2, 3))
    targets, separation = scenario.targets, scenario.scanner.mirrors.axis_separation
    assert [one.name for one in targets] == [f"node/{number}" for number in range(1, 7)]
    places = [(x, y) for y in (-0.1, 0.1) for x in (-0.3, 0.0, 0.3)]
    assert [tuple(one.centre[:2].tolist()) for one in targets] == [pytest.approx(place) for place in places]
    for one, (x, y) in zip(targets, places, strict=True):
        theta, phi, reach = one.expected.tolist()
        assert np.stack(coordinates(reach, theta, phi, separation)) == pytest.approx((x, y, 8.0), abs=1e-9)


def test_an_array_has_so_many_members() -> None:
    """Claim: the last one can be followed, and the next is not there; the message has how many there are."""
    assert followed(grid(2, 3), names=("node/6",)).targets[0].name == "node/6"
    with pytest.raises(InputError, match=r"'node' has 6 targets.*Write node/1 to node/6"):
        followed(grid(2, 3), names=("node/7",))


def test_so_many_targets_are_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: members count one by one, of one array and of several; one more than may be is refused, of so many that a
    limit off by a tenth is another one."""
    other = grid(1, 2) | {"name": "other", "position": (0.0, 3.0, 8.0)}
    monkeypatch.setattr("scanner_sim.tracking.scan.MOST_TARGETS", 26)
    assert len(followed(grid(4, 6), other, names=("node", "other")).targets) == 26
    monkeypatch.setattr("scanner_sim.tracking.scan.MOST_TARGETS", 25)
    with pytest.raises(InputError, match="more than 25 targets"):
        followed(grid(4, 6), other, names=("node", "other"))
    monkeypatch.setattr("scanner_sim.tracking.scan.MOST_TARGETS", 23)
    with pytest.raises(InputError, match="has 24 targets; 23 can be followed"):
        followed(grid(4, 6))


@pytest.mark.parametrize(("short", "possible"), [(7.9, True), (8.1, False)])
def test_a_target_is_expected_at_some_range(short: float, possible: bool) -> None:
    """Claim: an offset may bring it near, and not behind the scanner."""
    asked: Any = {"target": "node", "offset": (0.0, 0.0, -short)}
    if possible:
        assert followed(array(), names=(asked,)).targets[0].expected[2] == pytest.approx(8.0 - short)
        return
    with pytest.raises(InputError, match=r"expected at \(0 deg, 0 deg, -0\.1 m\), which is no place"):
        followed(array(), names=(asked,))


@pytest.mark.parametrize(("told", "missing"), [({"diameter": 0.3}, "kind"), ({"kind": "black"}, "diameter")])
def test_what_the_scene_does_not_tell_is_asked_for(told: dict[str, Any], missing: str) -> None:
    """Claim: of a rectangle the scene tells neither; the message has the first that is missing."""
    item = {
        "name": "node",
        "shape": "rectangle",
        "size": (0.1, 0.1),
        "position": (0, 0, 8),
        "material": "nickel",
    }
    asked: Any = {"target": "node", **told}
    with pytest.raises(InputError, match=f"of which the scene tells the {missing}"):
        followed(item, names=(asked,))


def test_what_the_scan_tells_of_a_target_counts() -> None:
    """Claim: kind and diameter are the scan's where it tells them, of arrays, discs and spheres, else the scene's."""
    sphere = {"name": "ball", "shape": "sphere", "diameter": 0.3, "position": (1, 0, 8), "material": "nickel"}
    disc = {**sphere, "name": "disc", "shape": "disc", "position": (-1, 0, 8)}
    names = "node", "ball", "disc"
    told = [{"target": name, "diameter": 0.07, "kind": "white"} for name in names]
    for asked, sizes, kinds in (
        (names, [0.1, 0.3, 0.3], ["black", "raised", "raised"]),
        (told, [0.07] * 3, ["white"] * 3),
    ):
        found = followed(array(), sphere, disc, names=tuple(asked)).targets  # type: ignore[arg-type]
        assert [one.appearance.diameter for one in found] == sizes
        assert [one.appearance.kind for one in found] == kinds
        assert [one.appearance.surface for one in found] == ["flat", "sphere", "flat"]
