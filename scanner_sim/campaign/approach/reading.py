"""From the file of an approach to its campaign: a point for each light and epoch, a run for each ranging and try."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation as Turning

from scanner_sim.campaign.approach.methods import METHODS
from scanner_sim.campaign.approach.path import Epoch, epochs_of, moments_of
from scanner_sim.campaign.approach.plan import Approach
from scanner_sim.campaign.measures import METHODS as POSE_METHODS
from scanner_sim.campaign.plan import Plan
from scanner_sim.campaign.runs import Campaign, changed
from scanner_sim.config.document import Document, Value, spell
from scanner_sim.config.load import load_scenario
from scanner_sim.config.reading import read_part
from scanner_sim.config.scanner import RangefinderName
from scanner_sim.config.scenario import Scenario
from scanner_sim.config.wording import choice
from scanner_sim.foundation.errors import Fault, ScenarioError
from scanner_sim.foundation.units import FROM_FILE
from scanner_sim.products.pose_study import COMPONENTS
from scanner_sim.scene.objects import SceneObject, TargetArray
from scanner_sim.scene.poses import placement_matrix
from scanner_sim.scene.relative_orbit import RelativeOrbit


class Point(NamedTuple):
    """A point of the campaign: number of its light, its epoch, and the array that is followed there."""

    orbit: int
    epoch: Epoch
    array: str


@dataclass(frozen=True)
class PlannedApproach:
    """An approach that can be done: its campaign, whose first axis are ``points`` and whose second ``rangings``."""

    approach: Approach
    campaign: Campaign
    points: tuple[Point, ...]
    rangings: tuple[RangefinderName, ...]

    @property
    def measures(self) -> tuple[str, ...]:
        """Names of the measures of its runs."""
        return self.campaign.plan.measure

    def run(self, point: int, ranging: RangefinderName = "triangulation", attempt: int = 0) -> int:
        """Return the number of the run of a point, a ranging and a try."""
        place = point, self.rangings.index(ranging), attempt
        return int(np.ravel_multi_index(place, self.campaign.plan.shape))


def read_approach(path: Path) -> PlannedApproach:
    """Return the approach of a file, with everything that is wrong with it found before its first try.

    Raises
    ------
    InputError
        If it or its scenario cannot be read.
    ScenarioError
        If either has faults; those of an epoch say when it is.
    """
    approach, document = read_part(path, Approach, "an approach")
    base = load_scenario(approach.base)
    faults = list(_unfit(approach, base))
    points: tuple[Point, ...] = ()
    if not faults:
        start = _object_of(base, approach.object).scanner_from_object()
        epochs, found = epochs_of(approach, start)
        faults += found
        points, unfit = _points(approach, epochs)
        faults += unfit
    if faults:
        raise ScenarioError([_at(document, fault) for fault in faults], source=str(path))
    planned = _planned(approach, base, points, path.absolute().parent)
    faults = [_at(document, fault) for fault in _unmeasurable(planned)]
    if faults:
        raise ScenarioError(faults, source=str(path))
    return planned


def _at(document: Document, fault: Fault) -> Fault:
    steps = tuple(int(step) if step.isdigit() else step for step in fault.location.split("."))
    return Fault(spell(steps), fault.problem, fault.remedy, document.line(steps))


def _object_of(base: Scenario, name: str) -> SceneObject:
    return next(item for item in base.scene.objects if item.name == name)


def _unfit(approach: Approach, base: Scenario) -> Iterator[Fault]:
    """Yield what the scenario lacks: objects, arrays that are fixed to them, a track, an orbit."""
    items = {item.name: item for item in base.scene.objects}
    carrier = items.get(approach.object)
    if carrier is None:
        yield Fault(
            "object", f"there is no object '{approach.object}'.", choice(approach.object, tuple(items))
        )
    elif carrier.parent is not None:
        problem = f"'{carrier.name}' is fixed to '{carrier.parent}', and moves with that."
        yield Fault("object", problem, f"Write object: {carrier.parent}.")
    for number, one in enumerate(approach.arrays):
        yield from _unfit_array(items, approach.object, one.array, f"arrays.{number}.array")
    if base.scan.layout != "visits":
        yield Fault(
            "base", "its scan does not follow targets.", "Write scan: {type: track, targets: [far]} there."
        )
    yield from _unfit_light(approach, base)


def _unfit_array(items: Mapping[str, SceneObject], carrier: str, name: str, location: str) -> Iterator[Fault]:
    arrays = tuple(item.name for item in items.values() if isinstance(item, TargetArray))
    item = items.get(name)
    if not isinstance(item, TargetArray):
        remedy = choice(name, arrays) if arrays else "The scenario has none: give it objects with 'array'."
        yield Fault(location, f"there is no target array '{name}'.", remedy)
        return
    if min(item.array.rows, item.array.columns) < 2:
        yield Fault(
            location, f"the targets of '{name}' have no pose.", "Give it two rows and two columns or more."
        )
    above: SceneObject | None = item
    while above is not None and above.name != carrier:
        above = items.get(above.parent or "")
    if above is None:
        yield Fault(location, f"'{name}' is not fixed to '{carrier}'.", f"Write parent: {carrier} there.")


def _unfit_light(approach: Approach, base: Scenario) -> Iterator[Fault]:
    """Yield an orbit that is missing, or another one than the path's."""
    light, path = base.lighting, approach.trajectory
    placed = light.orbit or light.tle
    if placed is None:
        yield Fault(
            "base",
            "its lighting has no orbit, so that nothing says how the light changes on the way.",
            "Write lighting: {orbit: {altitude: 400 km, beta: 30 deg}} there, or a tle.",
        )
        return
    if approach.orbits and light.orbit is None:
        problem = "the scenario's orbit is one of two-line elements, which say where the Sun is."
        yield Fault("orbits", problem, "Write lighting.orbit there, or remove this.")
    if not isinstance(path, RelativeOrbit):
        return
    if path.attitude != placed.attitude:
        yield Fault(
            "trajectory.attitude",
            "the light of the scenario falls on a scanner that looks elsewhere.",
            "Write the same attitude here and in the scenario's lighting.",
        )
    if light.orbit is not None and path.altitude != light.orbit.altitude:
        yield Fault(
            "trajectory.altitude",
            f"{1e-3 * path.altitude:g} km here, and {1e-3 * light.orbit.altitude:g} km in the scenario's lighting.",
            "Write the same altitude.",
        )


def _points(approach: Approach, epochs: tuple[Epoch, ...]) -> tuple[tuple[Point, ...], list[Fault]]:
    """Return the points, light by light, and epochs at which no array is left."""
    faults, arrays = [], []
    for epoch in epochs:
        array = approach.array_at(epoch.distance)
        if epoch.pose[2, 3] <= 0.0:
            problem = (
                f"at {epoch.time:.6g} s the object is behind the scanner (z = {epoch.pose[2, 3]:.4g} m)."
            )
            faults.append(Fault("trajectory", problem, "Turn the scanner, or end the epochs before."))
        elif array is None:
            problem = (
                f"at {epoch.time:.6g} s the range is {epoch.distance:.4g} m, and no array is followed there."
            )
            faults.append(Fault("arrays", problem, "Leave out 'below' of the last one."))
        arrays.append(array or "")
    orbits = range(max(len(approach.orbits), 1))
    found = tuple(Point(orbit, *both) for orbit in orbits for both in zip(epochs, arrays, strict=True))
    return found, faults


def _planned(approach: Approach, base: Scenario, points: tuple[Point, ...], folder: Path) -> PlannedApproach:
    """Return the campaign of an approach; faults as of :func:`read_approach`."""
    methods = [METHODS[name] for name in approach.methods]
    rangings = tuple(dict.fromkeys(method.ranging for method in methods))
    poses = [name for name in POSE_METHODS if any(method.pose == name for method in methods)]
    values = [_values(approach, base, point) for point in points]
    measures = [
        name
        for pose in poses
        for name in (
            f"{pose}_status",
            *(f"{pose}_{axis}{end}" for axis in COMPONENTS for end in ("", "_sigma")),
        )
    ]
    changes: dict[str, Value] = {
        "scan.duration": f"{approach.duration!r} s",
        "output.pictures": False,
        "output.frames": False,
    }
    if "camera" in approach.methods:
        # One frame to a try: the control's exposure is what it settles at on it.
        changes["camera.frame_rate"] = f"{min(base.camera.frame_rate, 1.0 / approach.duration)!r} Hz"
    asked: list[Value] = [
        list[Value](dict.fromkeys(one.pose for one in methods if one.ranging == ranging))
        for ranging in rangings
    ]
    plan = Plan.model_validate(
        {
            "schema": 1,
            "base": str(approach.base),
            "set": changes,
            "seed": approach.seed,
            "vary": [
                {"keys": {key: [one[key] for one in values] for key in values[0]}},
                {"keys": {"ranging": list(rangings), "pose.methods": asked}},
            ],
            "repeat": approach.tries,
            "measure": measures,
        },
        context={**FROM_FILE, "folder": folder},
    )
    start: dict[str, Value] = {**changes, **values[0], "ranging": rangings[0], "pose.methods": asked[0]}
    return PlannedApproach(
        approach, Campaign(plan, changed(base, start, folder, "the first epoch"), folder), points, rangings
    )


def _values(approach: Approach, base: Scenario, point: Point) -> dict[str, Value]:
    """Return what the scenario of a point has in the place of the base's values, as a file spells them."""
    followed: dict[str, Value] = {
        "target": point.array,
        "offset": [
            f"{value!r} {unit}" for value, unit in zip(approach.offset, ("rad", "rad", "m"), strict=True)
        ],
    }
    found: dict[str, Value] = {**_moving(approach.object, point.epoch), "scan.targets": [followed]}
    for item in base.scene.objects:
        if item.motion is not None and item.name != approach.object:
            start, times = placement_matrix(item.position, item.rotation), np.array([point.epoch.time])
            found |= _moving(item.name, *moments_of(item.motion, start, times))
    return found | _light_at(approach, base, point)


def _moving(name: str, epoch: Epoch) -> dict[str, Value]:
    """Return the keys of an object that moves evenly about an epoch."""
    turn = Turning.from_matrix(epoch.pose[:3, :3]).as_rotvec()
    angle = float(np.linalg.norm(turn))
    axis = (turn / angle).tolist() if angle else [0.0, 0.0, 1.0]
    twist: dict[str, Value] = {
        "type": "twist",
        "velocity": _spelled(epoch.velocity, "m/s"),
        "turn_rate": _spelled(epoch.turn_rate, "rad/s"),
    }
    return {
        f"scene.objects.{name}.position": _spelled(epoch.pose[:3, 3], "m"),
        f"scene.objects.{name}.rotation": {"axis": axis, "angle": f"{angle!r} rad"},
        f"scene.objects.{name}.motion": twist,
    }


def _spelled(values: Any, unit: str) -> list[Value]:
    return [f"{value!r} {unit}" for value in np.asarray(values).tolist()]


def _light_at(approach: Approach, base: Scenario, point: Point) -> dict[str, Value]:
    """Return the keys of the light at an epoch: where on the orbit or when by its elements, and what was told of it."""
    light = base.lighting
    if approach.orbits and light.orbit is not None:
        place = approach.orbits[point.orbit]
        orbit = light.orbit.model_copy(update={"beta": place.beta, "anomaly": place.anomaly})
        light = light.model_copy(update={"orbit": orbit})
    now = light.at(point.epoch.time)
    found: dict[str, Value] = {}
    if light.changes:
        found["lighting.changes"] = [one.model_dump(mode="json") for one in now.changes]
    if now.tle is not None:
        return found | {"lighting.tle.time": now.tle.time.isoformat()}
    assert now.orbit is not None
    beta, anomaly = (f"{angle!r} rad" for angle in (now.orbit.beta, now.orbit.anomaly))
    return found | {"lighting.orbit.beta": beta, "lighting.orbit.anomaly": anomaly}


def _unmeasurable(planned: PlannedApproach) -> Iterator[Fault]:
    """Yield epochs at which a target is out of the field of view or of the range, and scenarios with faults."""
    epochs = len(planned.points) // max(len(planned.approach.orbits), 1)
    objects = enumerate(planned.campaign.base.scene.objects)
    others = tuple(f"scene.objects[{k}]." for k, item in objects if item.name != planned.approach.object)
    for number, point in enumerate(planned.points):
        # The path is the same under every light: of the others the first epoch is enough.
        for ranging in planned.rangings if number < epochs or number % epochs == 0 else ():
            try:
                scenario = planned.campaign.scenario(planned.run(number, ranging))
            except ScenarioError as error:
                first = error.faults[0]
                problem = f"at {point.epoch.time:.6g} s, {first.location}: {first.problem}"
                yield Fault(
                    "base" if first.location.startswith(others) else "trajectory", problem, first.remedy
                )
                break
            fault = _out_of_reach(scenario, point, ranging)
            if fault is not None:
                yield fault
                break


def _out_of_reach(scenario: Scenario, point: Point, ranging: RangefinderName) -> Fault | None:
    """Return a target that cannot be measured at a point; None where all can."""
    near, far = scenario.scanner.seen_by(ranging)
    limit = scenario.scanner.mirrors.max_deflection
    pattern, tracker = scenario.following.pattern, scenario.following.tracker
    for target in scenario.targets:
        theta, phi, distance = target.expected.tolist()
        when = f"at {point.epoch.time:.6g} s '{target.name}'"
        if not near <= distance <= far:
            return Fault(
                "trajectory",
                f"{when} is at a range of {distance:.4g} m; {ranging} measures from {near:.4g} m to {far:.4g} m.",
                "End the epochs before, leave out the methods of that ranging, or take another instrument.",
            )
        half = tracker.track_amplitude * 0.5 * target.appearance.diameter / distance
        if abs(theta) + half > limit or abs(phi) + half * pattern.aspect > limit:
            return Fault(
                "trajectory",
                f"{when} leaves the field of view: it is at Θ = {math.degrees(theta):.4g} deg, φ = "
                f"{math.degrees(phi):.4g} deg, and with its pattern {math.degrees(limit):.4g} deg are possible.",
                "Follow a smaller array at near ranges, or end the epochs before.",
            )
    return None
