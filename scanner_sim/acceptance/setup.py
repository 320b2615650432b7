"""From a plan to what is scanned: artefacts as they are made, a window for each surface, what cannot be tested."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scanner_sim.acceptance.plan import AcceptancePlan, LengthBar, Plate, Zone
from scanner_sim.config.document import Document
from scanner_sim.config.load import load_scenario
from scanner_sim.config.reading import in_order, read_part
from scanner_sim.config.scanner import RangefinderName
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import Fault, ScenarioError, at_least
from scanner_sim.foundation.streams import Stream, host_generator
from scanner_sim.optics.deflection import deflected_frame
from scanner_sim.ranging.coordinates import angles_and_range
from scanner_sim.scene.poses import placement_matrix

Array = NDArray[np.float64]

_MADE, SEEDED, DRAWN = 0, 1, 2
"""Draws of the stream of surveys: what artefacts differ from their certificates by, seeds of repetitions, and the first
of the draws that tell what noise makes of forms."""
_SPOTS, _PLATE_SPOTS = 5.0, 10.0
"""Diameters of the beam that a sphere's diameter and a plate's smaller edge must have at least."""
_MARGIN = 2.0
"""Diameters of the beam by which points of a plate must lie within its edges."""
_WIDER = 1.1
"""A sphere's window over the sphere."""


@dataclass(frozen=True)
class Surface:
    """A sphere or plate that is scanned.

    Attributes
    ----------
    name
        Its artefact and, of a bar, which end.
    artefact
        Index of the artefact in the plan.
    is_plate
        Whether it is a plate.
    horizontal, vertical
        Window of the scan, Θ and φ [rad].
    nearest, farthest
        Distances of its points from the scanner [m].
    extent
        Diameter of a sphere, or the smaller edge of a plate [m].
    spot
        Diameter of the beam (1/e²) at its farthest point [m].
    """

    name: str
    artefact: int
    is_plate: bool
    horizontal: tuple[float, float]
    vertical: tuple[float, float]
    nearest: float
    farthest: float
    extent: float
    spot: float


@dataclass(frozen=True)
class Setup:
    """A plan with everything that it names.

    Attributes
    ----------
    plan, base
        The plan, and the scenario of the instrument.
    rangefinder
        What measures the ranges.
    surfaces
        What is scanned, in the order of the plan's artefacts.
    made
        True length or diameter of each artefact [m]: the certified one, off by a draw of its uncertainty; 0 of plates.
    """

    plan: AcceptancePlan
    base: Scenario
    rangefinder: RangefinderName
    surfaces: tuple[Surface, ...]
    made: Array

    def zone_of(self, artefact: int) -> Zone:
        """Return the limits of an artefact: those of the zone that its farthest point is in."""
        farthest = max(one.farthest for one in self.surfaces if one.artefact == artefact)
        return next(zone for zone in self.plan.limits if farthest <= zone.up_to)


def read_setup(path: Path) -> Setup:
    """Read a plan and what it names.

    Raises
    ------
    InputError
        If a file cannot be read.
    ScenarioError
        With all faults that could be found, in the order of the plan.
    """
    plan, document = read_part(path, AcceptancePlan, "an acceptance test")
    base = load_scenario(plan.base)
    if plan.ranging is None and len(base.rangefinders) > 1:
        problem = "the scenario measures by both ways, and an acceptance test judges one of them."
        line = document.line(("base",))
        fault = Fault("ranging", problem, "Write ranging: triangulation or tof.", line)
        raise ScenarioError([fault], source=str(path))
    rangefinder = plan.ranging or base.rangefinders[0]
    made = _made(plan)
    setup = Setup(plan, base, rangefinder, tuple(_surfaces(plan, base, made)), made)
    faults = list(_faults(setup, document))
    if faults:
        raise ScenarioError(in_order(faults), source=str(path))
    return setup


def _made(plan: AcceptancePlan) -> Array:
    certified = [
        0.0 if isinstance(one, Plate) else one.length if isinstance(one, LengthBar) else one.diameter
        for one in plan.artefacts.values()
    ]
    sigma = [0.0 if isinstance(one, Plate) else one.sigma for one in plan.artefacts.values()]
    noise = host_generator(plan.seed, Stream.ACCEPTANCE, _MADE).standard_normal(len(certified))
    return np.array(certified) + np.array(sigma) * noise


def _surfaces(plan: AcceptancePlan, base: Scenario, made: Array) -> Iterator[Surface]:
    for number, one in enumerate(plan.artefacts.values()):
        if isinstance(one, Plate):
            local = np.array([[x, y, 0.0] for x in (-0.5, 0.0, 0.5) for y in (-0.5, 0.0, 0.5)])
            pose = placement_matrix(one.position, one.rotation)
            points = local * [*one.size, 0.0] @ pose[:3, :3].T + pose[:3, 3]
            yield _surface(base, one.name, number, True, points, min(one.size))
        elif isinstance(one, LengthBar):
            for end, centre in zip(("first", "second"), one.ends(float(made[number])), strict=True):
                points = _limb(centre, one.diameter)
                yield _surface(base, f"{one.name}/{end}", number, False, points, one.diameter)
        else:
            points = _limb(np.array(one.position), one.diameter)
            yield _surface(base, one.name, number, False, points, one.diameter)


def _limb(centre: Array, diameter: float) -> Array:
    """Return points around a sphere, a little outside of it, shape (n, 3)."""
    turn = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    rise = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 9)[:, None]
    unit = np.stack(
        np.broadcast_arrays(np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise))
    )
    return centre + 0.5 * _WIDER * diameter * unit.reshape(3, -1).T


def _surface(
    base: Scenario, name: str, artefact: int, is_plate: bool, points: Array, extent: float
) -> Surface:
    separation = base.scanner.mirrors.axis_separation
    _, theta, phi = angles_and_range(points[:, 0], points[:, 1], points[:, 2], separation)
    distance = np.linalg.norm(points, axis=1)
    ends = [(float(one.min()), float(one.max())) for one in (theta, phi, distance)]
    near, far = ends[2] if points[:, 2].min() > 0.0 else (0.0, ends[2][1])
    spot = 2.0 * base.scanner.laser.radius(far)
    return Surface(name, artefact, is_plate, ends[0], ends[1], near, far, extent, spot)


def on_plate(plate: Plate, surface: Surface, points: Array) -> NDArray[np.bool_]:
    """Return which points lie within the edges of a plate where the plan has it: as who tests cuts them out."""
    pose = placement_matrix(plate.position, plate.rotation)
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    inside = 0.5 * np.array(plate.size) - _MARGIN * surface.spot
    return np.asarray((np.abs(local[:, :2]) <= inside).all(axis=1))


def _faults(setup: Setup, document: Document) -> Iterator[Fault]:
    keys = list(setup.plan.artefacts)
    for surface in setup.surfaces:
        kind, number = keys[surface.artefact]
        for key, problem, remedy in _untestable(setup, surface):
            yield Fault(f"{kind}[{number}].{key}", problem, remedy, document.line((kind, number, key)))
    for artefact, (kind, number) in enumerate(keys):
        yield from _unlimited(setup, artefact, kind, number, document)
        if kind == "lengths":
            yield from _in_line(setup, artefact, number, document)


def _untestable(setup: Setup, surface: Surface) -> Iterator[tuple[str, str, str]]:
    """Yield the key, what is wrong with it and the remedy, where a surface cannot be measured."""
    scanner = setup.base.scanner
    reach = scanner.mirrors.max_deflection
    wide = max(map(abs, (*surface.horizontal, *surface.vertical)))
    what = f"{surface.name} lies"
    if surface.nearest <= 0.0:
        yield (
            "position",
            f"{what} behind the scanner or around it.",
            "The scanner looks along its z: move it.",
        )
        return
    if wide > reach:
        yield (
            "position",
            f"{what} outside of the field of view: the mirrors would turn by {np.rad2deg(wide):.3g} deg, "
            f"and reach {np.rad2deg(reach):.3g} deg.",
            "Move it towards the z axis or farther away.",
        )
    nearest, farthest = scanner.seen_by(setup.rangefinder)
    if surface.nearest < nearest or surface.farthest > farthest:
        yield (
            "position",
            f"{what} between {surface.nearest:.3g} m and {surface.farthest:.3g} m, and the {setup.rangefinder} "
            f"of the scanner measures from {nearest:.3g} m to {farthest:.3g} m.",
            "Move it into the ranges that are measured.",
        )
    key, fewest = ("size", _PLATE_SPOTS) if surface.is_plate else ("diameter", _SPOTS)
    if surface.extent < fewest * surface.spot:
        yield (
            key,
            f"{1e3 * surface.extent:.3g} mm is too small for the beam of {1e3 * surface.spot:.3g} mm (1/e²) there.",
            f"Make it {at_least(1e3 * fewest * surface.spot)} mm or more.",
        )


def _in_line(setup: Setup, artefact: int, number: int, document: Document) -> Iterator[Fault]:
    """Yield that the balls of a bar stand so nearly in one line of sight that the scan of one would meet the other."""
    bar = list(setup.plan.artefacts.values())[artefact]
    assert isinstance(bar, LengthBar)
    ends = [one for one in setup.surfaces if one.artefact == artefact]
    centres = bar.ends(float(setup.made[artefact]))
    if min(one.nearest for one in ends) <= 0.0 or not any(
        _meets(setup.base, one, centre, bar.diameter) for one, centre in zip(ends, centres[::-1], strict=True)
    ):
        return
    near, far = sorted(ends, key=lambda one: one.nearest)
    problem = (
        f"as the scanner sees them, {near.name} at {near.nearest:.3g} m stands before {far.name} at "
        f"{far.nearest:.3g} m or so near beside it that points of both would be taken for one ball."
    )
    remedy = "Turn the bar, or move it aside, so that its balls are seen beside one another."
    key = "direction"
    yield Fault(f"lengths[{number}].{key}", problem, remedy, document.line(("lengths", number, key)))


def _meets(base: Scenario, surface: Surface, centre: Array, diameter: float) -> bool:
    """Return whether a beam in the window of a surface touches a ball: the one that passes nearest to its centre."""
    scanner = base.scanner
    separation = scanner.mirrors.axis_separation
    _, theta, phi = angles_and_range(centre[0], centre[1], centre[2], separation)
    theta, phi = np.clip(theta, *surface.horizontal), np.clip(phi, *surface.vertical)
    angles = np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi)
    beam = deflected_frame(*angles, separation, scanner.receiver.baseline)
    away = centre - np.array(beam.laser)
    passed = float(np.linalg.norm(np.cross(away, np.array(beam.along))))
    return passed < 0.5 * diameter + scanner.laser.radius(float(np.linalg.norm(away)))


def _unlimited(setup: Setup, artefact: int, kind: str, number: int, document: Document) -> Iterator[Fault]:
    """Yield that no limit is stated for what an artefact tests."""
    farthest = max(one.farthest for one in setup.surfaces if one.artefact == artefact)
    last = setup.plan.limits[-1]
    if farthest > last.up_to:
        problem = f"it reaches {farthest:.4g} m, and limits are stated up to {last.up_to:g} m."
        line = document.line((kind, number, "position"))
        yield Fault(f"{kind}[{number}].position", problem, "Move it nearer, or add a zone.", line)
        return
    zone = setup.zone_of(artefact)
    wanted = {"lengths": ("length",), "spheres": ("size", "form"), "plates": ("flatness",)}[kind]
    if all(getattr(zone, key) is None for key in wanted):
        place = setup.plan.limits.index(zone)
        name = list(setup.plan.artefacts.values())[artefact].name
        problem = f"there is no limit for {' or '.join(wanted)}, which {name} tests."
        line = document.line(("limits", place))
        yield Fault(f"limits[{place}]", problem, f"Write for example {wanted[0]}: 1 mm.", line)
