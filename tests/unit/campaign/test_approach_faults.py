"""What an approach needs of its scenario and its path: arrays with a pose, fixed to the object, in its light."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.campaign.approach import reading
from scanner_sim.campaign.plan import Plan
from scanner_sim.campaign.reading import _unfit_measures
from scanner_sim.scene.objects import TargetArray
from scanner_sim.scene.relative_orbit import RelativeOrbit


def array(rows: int = 2, columns: int = 2, name: str = "near", parent: str | None = "craft") -> Any:
    return TargetArray.model_construct(
        name=name, parent=parent, array=SimpleNamespace(rows=rows, columns=columns)
    )


def thing(name: str, parent: str | None = None) -> Any:
    return SimpleNamespace(name=name, parent=parent)


def said(faults: Any) -> list[str]:
    return [f"{fault.location}: {fault.problem} {fault.remedy}" for fault in faults]


@pytest.mark.parametrize(
    ("rows", "columns", "posed"),
    [(2, 2, True), (1, 9, False), (9, 1, False), (1, 2, False), (3, 2, True), (2, 3, True)],
)
def test_targets_in_a_row_have_no_pose(rows: int, columns: int, posed: bool) -> None:
    items = {"craft": thing("craft"), "near": array(rows, columns)}
    found = said(reading._unfit_array(items, "craft", "near", "at"))
    assert found == ([] if posed else [
        "at: the targets of 'near' have no pose. Give it two rows and two columns or more."
    ])  # fmt: skip


@pytest.mark.parametrize(
    ("parent", "others", "words"),
    [
        ("craft", {}, ""), ("arm", {"arm": thing("arm", "craft")}, ""),
        ("arm", {"arm": thing("arm", "other"), "other": thing("other")}, "'near' is not fixed to 'craft'"),
        (None, {}, "'near' is not fixed to 'craft'"),
    ],
)  # fmt: skip
def test_arrays_are_fixed_to_the_object_through_others_too(
    parent: str | None, others: dict[str, Any], words: str
) -> None:
    items = {"craft": thing("craft"), "near": array(parent=parent), **others}
    found = said(reading._unfit_array(items, "craft", "near", "at"))
    assert len(found) == bool(words)
    assert all(words in one and "Write parent: craft there" in one for one in found)


def test_arrays_that_are_none_are_told_with_those_that_are() -> None:
    items = {"craft": thing("craft"), "near": array()}
    (found,) = said(reading._unfit_array(items, "craft", "naer", "at"))
    assert found.startswith("at: there is no target array 'naer'. Did you mean 'near'?")
    (found,) = said(reading._unfit_array({"craft": thing("craft")}, "craft", "craft", "at"))
    assert "The scenario has none" in found


def base(**more: Any) -> Any:
    """Return a scenario with an orbit of 400 km, a craft and an array on it, whose scan follows."""
    orbit = SimpleNamespace(attitude="level", altitude=400e3)
    told: dict[str, Any] = {
        "scene": SimpleNamespace(objects=[thing("craft"), array()]), "scan": SimpleNamespace(layout="visits"),
        "lighting": SimpleNamespace(orbit=orbit, tle=None),
    }  # fmt: skip
    return SimpleNamespace(**told | more)


def approach(**more: Any) -> Any:
    path = RelativeOrbit.model_construct(attitude="level", altitude=400e3)
    told: dict[str, Any] = {
        "object": "craft", "arrays": [SimpleNamespace(array="near")], "trajectory": path, "orbits": ()
    }  # fmt: skip
    return SimpleNamespace(**told | more)


ELEMENTS = SimpleNamespace(orbit=None, tle=SimpleNamespace(attitude="level"))


@pytest.mark.parametrize(
    ("asked", "given", "words"),
    [
        ({}, {}, None),
        ({"object": "craff"}, {}, "object: there is no object 'craff'. Did you mean 'craft'?"),
        ({"object": "near"}, {}, "object: 'near' is fixed to 'craft', and moves with that. Write object: craft."),
        ({}, {"scan": SimpleNamespace(layout="image")}, "base: its scan does not follow targets."),
        ({}, {"lighting": SimpleNamespace(orbit=None, tle=None)}, "base: its lighting has no orbit"),
        ({}, {"lighting": ELEMENTS}, None),
        ({"orbits": ("one",)}, {"lighting": ELEMENTS}, "orbits: the scenario's orbit is one of two-line elements"),
        ({"trajectory": RelativeOrbit.model_construct(attitude="turned", altitude=400e3)}, {}, "trajectory.attitude: "),
        ({"trajectory": RelativeOrbit.model_construct(attitude="level", altitude=420e3)}, {},
         "trajectory.altitude: 420 km here, and 400 km in the scenario's lighting. Write the same altitude."),
        ({"trajectory": "waypoints"}, {}, None),
        ({"trajectory": RelativeOrbit.model_construct(attitude="level", altitude=9e5)}, {"lighting": ELEMENTS}, None),
    ],
)  # fmt: skip
def test_an_approach_needs_its_object_its_track_and_its_light(
    asked: dict[str, Any], given: dict[str, Any], words: str | None
) -> None:
    """Claim: one fault for each thing that lacks, where it lacks; elements say nothing of an altitude."""
    found = said(reading._unfit(approach(**asked), base(**given)))
    if asked.get("object") == "near":
        found = found[:1]
    assert found == [] if words is None else found[0].startswith(words)
    assert len(found) <= 2


def test_epochs_follow_the_array_of_their_range() -> None:
    """Claim: under each light all epochs in their order, each with the array of its range; one behind the scanner and
    one without an array are faults that say when."""

    def epoch(time: float, z: float) -> Any:
        pose = np.eye(4)
        pose[:3, 3] = 0.0, 0.0, z
        return SimpleNamespace(time=time, pose=pose, distance=abs(z))

    asked: Any = SimpleNamespace(
        orbits=("a", "b"), array_at=lambda R: "far" if 5.0 < R < 50.0 else "near" if R <= 5.0 else None
    )
    epochs = tuple(epoch(*one) for one in ((0.0, 60.0), (1.5, 20.0), (2.5, 4.0), (3.5, -2.0)))
    points, faults = reading._points(asked, epochs)
    assert [(point.orbit, point.epoch, point.array) for point in points] == [
        (orbit, one, name)
        for orbit in (0, 1)
        for one, name in zip(epochs, ("", "far", "near", "near"), strict=True)
    ]
    assert said(faults) == [
        "arrays: at 0 s the range is 60 m, and no array is followed there. Leave out 'below' of the last one.",
        "trajectory: at 3.5 s the object is behind the scanner (z = -2 m). Turn the scanner, or end the epochs before.",
    ]
    asked.orbits = ()
    assert [point.orbit for point in reading._points(asked, epochs)[0]] == [0] * 4


@pytest.mark.parametrize(
    ("layout", "bad", "good"),
    [("visits", "sigma_range", "lost_tracks"), ("image", "lost_tracks", "sigma_range")],
)
def test_measures_of_another_kind_are_told_with_those_that_fit(layout: str, bad: str, good: str) -> None:
    campaign: Any = SimpleNamespace(
        base=SimpleNamespace(scan=SimpleNamespace(layout=layout)),
        plan=Plan.model_construct(measure=(good, bad)),
    )
    document: Any = SimpleNamespace(line=lambda location: 10 + location[1])
    (fault,) = _unfit_measures(campaign, document)
    assert (fault.location, fault.line) == ("measure[1]", 11)
    possible = fault.remedy.removeprefix("Possible: ").removesuffix(".").split(", ")
    assert good in possible
    assert bad not in possible
