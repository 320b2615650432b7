"""The Node: a pressurised cylinder with an end cone and berthing rings.

Module frame: origin at the centre of the front berthing ring's mating plane, the module's axis along +z, Z1
up (−y). Overall sizes follow the published ones of Node 1 (4.5 m diameter, about 5.5 m long); the details are
drawn freely in its manner.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from modelling import berthing
from modelling import fittings as fit
from modelling.berthing import UP
from modelling.sheets import blanket, cone, panel
from modelling.solids import (
    Array,
    box,
    draped,
    frame,
    joined,
    loft,
    moved,
    placed,
    ring_part,
    turned_part,
)
from modelling.writing import Model

CONE_INNER = (1.12, 0.30)
CONE_OUTER = (2.16, 1.22)
HULL, SHIELD = 2.16, 2.25
BARREL = (1.42, 5.30)
SECTORS = 12

AddTarget = Callable[[str, Array, float], None]
"""Puts a target: name, pose of its face, diameter."""


def cone_pose(angle: float, share: float, lift: float = 0.0) -> Array:
    """Pose on the end cone at an angle, ``share`` of the way out; x runs around, y outwards."""
    slope = np.subtract(CONE_OUTER, CONE_INNER)
    radius, z = np.add(CONE_INNER, share * slope)
    radial = np.array([np.cos(angle), np.sin(angle), 0.0])
    normal = (radial * slope[1] - np.array([0.0, 0.0, slope[0]])) / np.hypot(*slope)
    origin = radius * radial + [0.0, 0.0, z] + lift * normal
    return frame(origin, normal, [np.sin(angle), -np.cos(angle), 0.0])


def barrel_pose(angle: float, z: float, lift: float = 0.0) -> Array:
    """Pose on the shield; x runs along the module, forwards to backwards."""
    radial = np.array([np.cos(angle), np.sin(angle), 0.0])
    return frame((SHIELD + lift) * radial + [0.0, 0.0, z], radial, [0.0, 0.0, 1.0])


QUARTER = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""Turns a fitting on its base, so that what ran along x runs along y."""


def build(model: Model, add_target: AddTarget) -> None:
    _hull(model)
    berthing.front_ring(model)
    berthing.hatch(model)
    _cone(model)
    _bulkhead(model)
    _shields(model)
    berthing.radial_ports(model)
    _cables(model)
    _targets(model, add_target)


def _hull(model: Model) -> None:
    """End cones and barrel in one closed skin, hollow at the front for the tunnel."""
    profile = [CONE_INNER, CONE_OUTER, (HULL, 5.42), (1.12, 6.25), (0.80, 6.25), (0.80, 0.62), (0.93, 0.58)]
    model.add("node_hull", "weathered_aluminium", ring_part([*profile, (0.93, 0.30)], 128))
    rear = [(0.80, 6.24), (1.05, 6.24), (1.05, 6.5), (0.80, 6.5)]
    model.add("node_hull", "weathered_aluminium", ring_part(rear, 96))


def _cone(model: Model) -> None:
    """Twelve blankets between seams with stringers; rails, boxes and a grapple fixture."""
    width = 2.0 * np.pi / SECTORS
    blankets, shiny = [], []
    for number in range(SECTORS):
        start = UP + number * width
        surface = cone(start, start + width, _along_cone(0.075), _along_cone(0.93), margin=0.032)
        height = blanket(29, 25, (2, 3), 0.045, 0.026, seed=100 + number)
        (shiny if number in (4, 7) else blankets).append(draped(surface, height, 0.02))
    model.add("node_blankets", "beta_cloth", *blankets)
    model.add("node_blankets", "aluminised_kapton", *shiny)

    stringers, heads = [], []
    for number in range(SECTORS):
        angle = UP + number * width
        stringers.append(placed(box(0.036, 1.30, -0.022, fit.SINK, 0.006), cone_pose(angle, 0.5)))
        heads += [
            placed(fit.bolt(0.011, 0.010), cone_pose(angle, share, 0.022))
            for share in np.linspace(0.08, 0.92, 7)
        ]
    model.add("node_cone", "weathered_aluminium", *stringers)
    model.add("node_cone", "nickel", *heads)

    rails = []
    for number in (1, 3, 5, 7, 9, 11):
        pose = cone_pose(UP + number * width, 0.52, 0.022) @ QUARTER
        rails.append(placed(fit.handrail(0.95), pose))
    for number in (0, 2, 4, 6, 8, 10):
        rails.append(placed(fit.handrail(0.52), cone_pose(UP + number * width, 0.80, 0.018)))
    model.add("node_handrails", "weathered_aluminium", *rails)

    for number, (share, size) in {
        2.5: (0.52, (0.42, 0.30, 0.20)),
        8.5: (0.45, (0.34, 0.44, 0.22)),
        9.5: (0.62, (0.46, 0.26, 0.16)),
    }.items():
        body, metal = fit.equipment_box(*size)
        pose = cone_pose(UP + number * width, share, 0.03)
        model.add("node_boxes", "z93_white", placed(body, pose))
        model.add("node_boxes", "nickel", placed(metal, pose))
        foot = box(size[0] - 0.05, size[1] - 0.05, -0.01, 0.06)
        model.add("node_cone", "weathered_aluminium", placed(foot, pose))
    base, shaft = fit.grapple_fixture()
    pose = cone_pose(UP + 3.5 * width, 0.5, 0.05)
    pedestal = turned_part([(0.17, -0.01), (0.19, 0.09)], 32)
    model.add("node_grapple", "weathered_aluminium", placed(joined([base, pedestal]), pose))
    model.add("node_grapple", "oxidised_inconel", placed(shaft, pose))


def _along_cone(share: float) -> tuple[float, float]:
    radius, z = np.add(CONE_INNER, share * np.subtract(CONE_OUTER, CONE_INNER))
    return float(radius), float(z)


def _bulkhead(model: Model) -> None:
    """Ring where cone and barrel meet, with flange bolts and the trunnions that carried it to orbit."""
    profile = [
        (2.10, 1.16),
        (2.20, 1.15),
        (2.27, 1.20),
        (2.30, 1.23),
        (2.30, 1.30),
        (2.265, 1.32),
        (2.265, 1.40),
        (2.10, 1.42),
    ]
    model.add("node_hull", "weathered_aluminium", ring_part(profile, 144))
    head = moved(fit.bolt(0.014, 0.016), (2.165, 0.0, 1.155))
    model.add("node_bulkhead", "nickel", *fit.around(head, 48, 0.02))
    for angle in (0.0, np.pi, 0.5 * np.pi):
        pose = frame(
            [2.22 * np.cos(angle), 2.22 * np.sin(angle), 1.62],
            [np.cos(angle), np.sin(angle), 0.0],
            [0.0, 0.0, 1.0],
        )
        fitting = loft(
            [
                _square(0.44, 0.34, 0.05),
                _square(0.44, 0.34, -0.05),
                _square(0.20, 0.18, -0.16),
                _square(0.18, 0.16, -0.18),
            ]
        )
        pin = turned_part(
            [(0.034, -0.38), (0.0413, -0.37), (0.0413, -0.16), (0.07, -0.155), (0.07, -0.10)], 32
        )
        model.add("node_trunnions", "weathered_aluminium", placed(fitting, pose))
        model.add("node_trunnions", "nickel", placed(pin, pose))


def _square(width: float, height: float, z: float) -> Array:
    x, y = 0.5 * width, 0.5 * height
    return np.array([[-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]])


def _shields(model: Model) -> None:
    """Micrometeoroid panels on the barrel with gaps, each with its screws; handrails; rear blankets."""
    columns, rows = 20, 4
    step, length = 2.0 * np.pi / columns, (BARREL[1] - BARREL[0]) / rows
    panels, screws = [], []
    for row in range(rows):
        z0 = BARREL[0] + row * length
        for column in range(columns):
            start = UP + (column + 0.5) * step
            surface = cone(start, start + step, (HULL, z0 + 0.008), (HULL, z0 + length - 0.008), margin=0.008)
            panels.append(draped(surface, panel(6, 3, SHIELD - HULL, 0.012), 0.02))
            if column % 2 == 0 and row % 2 == 0:
                angle = start + 0.04
                screws += [
                    placed(fit.stud(0.018, 0.012, 8), barrel_pose(angle, z0 + s))
                    for s in (0.05, length - 0.05)
                ]
    model.add("node_shields", "weathered_aluminium", *panels)
    model.add("node_shields", "nickel", *screws)
    rails = [
        placed(fit.handrail(0.85), barrel_pose(np.radians(a), z))
        for a in (-60, -120, 60, 120, 30, 150)
        for z in (2.4,)
    ]
    model.add("node_handrails", "weathered_aluminium", *rails)
    rear = []
    for number in range(6):
        start = UP + number * np.pi / 3
        surface = cone(start, start + np.pi / 3, (HULL, 5.44), (1.14, 6.24), margin=0.03)
        rear.append(draped(surface, blanket(16, 10, (3, 2), 0.04, 0.02, seed=200 + number), 0.04))
    model.add("node_blankets", "beta_cloth", *rear)


def _cables(model: Model) -> None:
    """Harnesses around the berthing ring and out over the cone, with saddles."""
    harness, saddles = [], []
    for lane, (radius, first, last) in enumerate(
        ((1.25, -160, -20), (1.29, -150, -35), (1.26, 25, 150), (1.30, 40, 170))
    ):
        points = []
        share = (radius - CONE_INNER[0]) / (CONE_OUTER[0] - CONE_INNER[0])
        for number, degree in enumerate(np.linspace(first, last, 16)):
            wave = 0.012 * np.sin(2.1 * number + lane)
            points.append(
                cone_pose(np.radians(degree), share + wave, 0.062 + 0.01 * np.cos(1.7 * number))[:3, 3]
            )
        out = np.radians(last + 5)
        points += [cone_pose(out + 0.02, s, 0.062)[:3, 3] for s in (0.3, 0.55, 0.8)]
        points.append(cone_pose(out + 0.03, 1.0, 0.09)[:3, 3])
        harness.append(fit.cable(points, 0.013 + 0.004 * (lane % 2), steps=3))
        for degree in np.linspace(first + 8 + 4 * (lane % 2), last - 8, 6):
            saddles.append(
                placed(
                    box(0.05 + 0.006 * lane, 0.07, -0.085 - 0.007 * lane, 0.03, 0.01),
                    cone_pose(np.radians(degree), share),
                )
            )
    model.add("node_cables", "black_paint", *harness)
    model.add("node_cone", "nickel", *saddles)


def _targets(model: Model, add_target: AddTarget) -> None:
    """Four large targets on the cone, facing straight ahead, and two on each side of the barrel."""
    for number, degree in enumerate((-135, -45, 45, 135)):
        angle = np.radians(degree + 0.0)
        pose = np.eye(4)
        pose[:3, 3] = [1.66 * np.cos(angle), 1.66 * np.sin(angle), 0.55]
        add_target(f"cone_{number + 1}", pose, 0.10)
        post = moved(turned_part([(0.05, 0.01), (0.05, 0.9 - 0.55)], 24), pose[:3, 3])
        model.add("node_cone", "weathered_aluminium", post)
    for number, (degree, z) in enumerate(((-15, 2.0), (-15, 3.0), (195, 2.0), (195, 3.0))):
        add_target(f"barrel_{number + 1}", barrel_pose(np.radians(degree), z, 0.02), 0.10)
