"""The Node's berthing ports: the front ring with its tunnel and hatch, and the radial ports."""

from __future__ import annotations

import numpy as np

from modelling import fittings as fit
from modelling.solids import (
    box,
    frame,
    joined,
    loft,
    moved,
    placed,
    ring_part,
    rounded_plate,
    tube,
    turned,
    turned_part,
)
from modelling.writing import Model

UP = -0.5 * np.pi
"""Angle about z of the direction up: y points down."""


def front_ring(model: Model) -> None:
    """Berthing mechanism: ring, bolt housings, guide petals, latches."""
    profile = [(0.90, 0.02), (0.915, 0.0), (1.0, 0.0), (1.015, 0.015), (1.015, 0.06), (0.985, 0.075)]
    profile += [(0.985, 0.19), (1.03, 0.205), (1.03, 0.23), (1.17, 0.25), (1.17, 0.33), (0.90, 0.33)]
    model.add("node_ring", "nickel", ring_part(profile, 128))
    seals = [
        ring_part([(r - 0.008, -0.006), (r + 0.008, -0.006), (r + 0.008, 0.01), (r - 0.008, 0.01)], 96)
        for r in (0.94, 0.965)
    ]
    model.add("node_ring", "black_paint", *seals)

    housing = joined(
        [
            box(0.085, 0.10, 0.035, 0.27, 0.012),
            moved(turned_part([(0.026, -0.02), (0.032, -0.012), (0.032, 0.06)], 20), (0.0, -0.005, 0.0)),
            moved(box(0.11, 0.03, 0.15, 0.26, 0.006), (0.0, 0.05, 0.0)),
        ]
    )
    housing = turned(housing, -0.5 * np.pi)
    bolts = fit.around(moved(housing, (1.065, 0.0, 0.0)), 16, np.pi / 16)
    model.add("node_ring", "oxidised_inconel", *bolts)
    nut = moved(turned_part([(0.010, -0.045), (0.014, -0.04), (0.014, -0.01)], 12), (1.06, 0.0, 0.0))
    model.add("node_ring", "nickel", *fit.around(nut, 16, np.pi / 16))

    # A petal leans outwards, tapers to its tip and has a rib on its inner face.
    edge = np.array([[-0.19, -0.014], [0.19, -0.014], [0.19, 0.014], [-0.19, 0.014]])
    rings = []
    for z, radius, width in (
        (0.16, 1.0, 1.0),
        (-0.02, 1.03, 1.0),
        (-0.20, 1.10, 0.62),
        (-0.235, 1.125, 0.45),
    ):
        rings.append(np.stack([radius + edge[:, 1], width * edge[:, 0], np.full(4, z)], axis=1))
    rib = tube([[1.0, 0.0, 0.05], [1.02, 0.0, -0.03], [1.085, 0.0, -0.2]], 0.022, 10)
    petal = joined([loft(rings), moved(rib, (0.0, 0.1, 0.0)), moved(rib, (0.0, -0.1, 0.0))])
    model.add("node_petals", "dyed_black_anodise", *fit.around(petal, 4, 0.25 * np.pi))

    arm = joined(
        [box(0.06, 0.20, -0.035, 0.2, 0.012), moved(box(0.09, 0.07, -0.06, 0.1, 0.015), (0.0, -0.08, 0.0))]
    )
    latch = moved(turned(arm, 0.5 * np.pi), (0.985, 0.0, 0.0))
    model.add("node_ring", "oxidised_inconel", *fit.around(latch, 4, 0.0))


def hatch(model: Model) -> None:
    """Bulkhead at the end of the tunnel with a square hatch."""
    front = 0.40
    model.add(
        "node_tunnel", "z93_white", turned_part([(0.91, front), (0.935, front + 0.02), (0.935, 0.6)], 96)
    )
    frame_part = rounded_plate(1.24, 1.24, 0.22, front - 0.03, front + 0.02, 0.012)
    door = rounded_plate(1.10, 1.10, 0.17, front - 0.075, front + 0.01, 0.02)
    model.add("node_hatch", "weathered_aluminium", frame_part, door)
    ribs = []
    for number in range(12):
        if number % 3:
            ribs.append(
                turned(
                    moved(box(0.33, 0.03, front - 0.10, front - 0.05, 0.006), (0.335, 0.0, 0.0)),
                    number * np.pi / 6,
                )
            )
    ribs.append(
        ring_part(
            [(0.20, front - 0.11), (0.26, front - 0.11), (0.27, front - 0.06), (0.19, front - 0.06)], 48
        )
    )
    model.add("node_hatch", "weathered_aluminium", *ribs)
    model.add("node_hatch", "black_oxide", turned_part([(0.185, front - 0.085), (0.2, front - 0.055)], 48))
    wheel = moved(
        ring_part([(0.062, -0.13), (0.078, -0.13), (0.078, -0.114), (0.062, -0.114)], 24), (0.36, 0.02, front)
    )
    spindle = moved(turned_part([(0.02, -0.135), (0.02, -0.06)], 12), (0.36, 0.02, front))
    spokes = [
        moved(turned(box(0.14, 0.012, -0.127 + 0.001 * a, -0.117 + 0.001 * a), a), (0.36, 0.02, front))
        for a in (0.3, 0.3 + np.pi / 3, 0.3 + 2 * np.pi / 3)
    ]
    model.add("node_hatch", "nickel", wheel, spindle, *spokes)
    hinge = joined(
        [moved(box(0.10, 0.16, front - 0.10, front + 0.014, 0.015), (-0.56, y, 0.0)) for y in (-0.3, 0.3)]
    )
    dogs = [
        turned(moved(box(0.10, 0.06, front - 0.095, front + 0.012, 0.012), (0.555, y, 0.0)), a)
        for y in (-0.25, 0.25)
        for a in (0.0, 0.5 * np.pi, 1.5 * np.pi)
    ]
    model.add("node_hatch", "oxidised_inconel", hinge, *dogs)
    boxes, caps = [], []
    for angle in np.radians([22, 68, 112, 158, 202, 248, 292, 338]):
        x, y = 0.80 * np.cos(angle), 0.80 * np.sin(angle)
        boxes.append(moved(box(0.10, 0.08, front - 0.08, front + 0.008, 0.01), (x, y, 0.0)))
        caps.append(moved(fit.stud(0.022, 0.05), (x, y, front - 0.075)))
    model.add("node_tunnel", "z93_white", *boxes)
    model.add("node_hatch", "nickel", *caps)


def radial_ports(model: Model) -> None:
    """Radial berthing ports to the sides and below; the one above carries Z1."""
    collar = [
        (0.90, 0.25),
        (1.10, 0.25),
        (1.10, -0.22),
        (1.02, -0.24),
        (1.02, -0.42),
        (1.06, -0.44),
        (1.06, -0.50),
        (0.90, -0.50),
    ]
    cover = turned_part([(0.30, -0.62), (0.70, -0.58), (0.95, -0.47), (0.95, -0.40)], 64)
    housing = moved(box(0.10, 0.09, -0.47, -0.2, 0.01), (1.09, 0.0, 0.0))
    for name, angle in (("starboard", 0.0), ("port", np.pi), ("nadir", 0.5 * np.pi), ("zenith", UP)):
        pose = frame(
            [2.2 * np.cos(angle), 2.2 * np.sin(angle), 4.0],
            [np.cos(angle), np.sin(angle), 0.0],
            [0.0, 0.0, 1.0],
        )
        model.add("node_ports", "weathered_aluminium", placed(ring_part(collar, 64), pose))
        model.add("node_ports", "oxidised_inconel", *[placed(part, pose) for part in fit.around(housing, 16)])
        if name != "zenith":
            model.add("node_ports", "beta_cloth", placed(cover, pose))
