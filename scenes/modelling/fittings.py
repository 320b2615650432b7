"""Things that are mounted on a structure many times.

Each stands on the plane z = 0 of its own frame, reaches out towards −z and is sunk a little behind it, so
that no face of it lies in the surface it stands on. Lengths in metres.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from modelling.solids import (
    Array,
    Solid,
    bar,
    box,
    circle,
    joined,
    loft,
    moved,
    ring_part,
    rounded_plate,
    tube,
    turned,
    turned_part,
)
from scanner_sim.scene.targets import circular_target

SINK = 0.012
"""How deep a fitting reaches behind the plane it stands on."""


def target_plate(diameter: float, size: float, thickness: float, segments: int = 96) -> dict[str, Solid]:
    """Circular target with its face in z = 0, on a plate that reaches back by ``thickness``.

    Unlike the other fittings its face is at the origin, which is the point that a tracker measures.
    """
    parts = circular_target(diameter, size, segments)
    surround, faces = parts["white"]
    count = len(surround) // 2
    edge = np.arange(count, 2 * count)
    after = np.roll(edge, -1)
    back = edge + count
    back_after = np.roll(back, -1)
    centre = 3 * count
    vertices = np.vstack([surround, surround[count:], np.zeros((1, 3))])
    vertices[2 * count :, 2] = thickness
    sides = [
        np.stack([edge, after, back_after], axis=1),
        np.stack([edge, back_after, back], axis=1),
        np.stack([np.full(count, centre), back, back_after], axis=1),
    ]
    disc, fan = parts["black"]
    return {
        "target_black": Solid(disc, fan.astype(np.int64)),
        "target_white": Solid(vertices, np.vstack([faces.astype(np.int64), *sides])),
    }


def bolt(radius: float, height: float) -> Solid:
    """Hexagonal head."""
    head = [circle(radius, z, 6) for z in (-height, 0.5 * SINK)]
    return loft([0.8 * head[0] + [0.0, 0.0, -0.2 * height], head[0] + [0.0, 0.0, 0.15 * height], head[1]])


def stud(radius: float, height: float, sides: int = 12) -> Solid:
    """Round boss with a bevelled edge."""
    bevel = 0.25 * radius
    return turned_part([(radius - bevel, -height), (radius, bevel - height), (radius, 0.3 * SINK)], sides)


def handrail(length: float, standoff: float = 0.07) -> Solid:
    """Handrail along x on stanchions with base plates."""
    half, bend = 0.5 * length, 0.03
    rail = tube(_rail_path(half, standoff, bend), 0.017, 10)
    supports = [-half, half] + ([0.0] if length > 0.7 else [])
    screw = loft([circle(0.008, z, 6) for z in (-0.02, 0.5 * SINK)])
    feet = []
    for x in supports:
        feet.append(moved(box(0.075, 0.055, -0.012, SINK, 0.004), (x, 0.0, 0.0)))
        feet += [moved(screw, (x + side * 0.027, side * 0.017, 0.0)) for side in (-1, 1)]
    if length > 0.7:
        feet.append(
            moved(turned_part([(0.012, -standoff), (0.014, 0.0), (0.014, 0.7 * SINK)], 10), (0.0, 0.0, 0.0))
        )
    return joined([rail, *feet])


def _rail_path(half: float, standoff: float, bend: float) -> Array:
    """Up from one foot, round two bends, down to the other."""
    turn = np.linspace(0.0, 0.5 * np.pi, 3)
    right = np.stack(
        [half - bend * (1.0 - np.sin(turn)), np.zeros(3), bend * (1.0 - np.cos(turn)) - standoff], axis=1
    )
    left = right[::-1] * [-1.0, 1.0, 1.0]
    return np.vstack([[[-half, 0.0, 0.7 * SINK]], left, right, [[half, 0.0, 0.7 * SINK]]])


def cable(points: ArrayLike, radius: float, steps: int = 8, sides: int = 10) -> Solid:
    """Smooth cable through points: a Catmull–Rom curve."""
    given = np.asarray(points, dtype=np.float64)
    padded = np.vstack([2 * given[0] - given[1], given, 2 * given[-1] - given[-2]])
    t = (np.arange(steps) / steps)[:, None]
    spans = []
    for a, b, c, d in zip(padded, padded[1:], padded[2:], padded[3:], strict=False):
        spans.append(
            0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3)
        )
    return tube(np.vstack([*spans, given[-1:]]), radius, sides)


def finned_box(width: float, height: float, depth: float, fins: int) -> tuple[Solid, Solid]:
    """Equipment box and its cooling fins."""
    body = box(width, height, -depth, SINK, 0.02)
    pitch = 0.9 * height / fins
    rows = (np.arange(fins) - 0.5 * (fins - 1)) * pitch
    blades = [
        moved(box(0.92 * width, 0.22 * pitch, -depth - 0.06, -depth + 0.01), (0.0, y, 0.0)) for y in rows
    ]
    return body, joined(blades)


def equipment_box(width: float, height: float, depth: float) -> tuple[Solid, Solid]:
    """Box with a raised lid; its bolts and two connectors are the second solid."""
    body = box(width, height, -depth, SINK, 0.015)
    lid = rounded_plate(
        0.86 * width, 0.82 * height, 0.05 * min(width, height), -depth - 0.015, -depth + 0.01, 0.006
    )
    x, y = 0.465 * width, 0.455 * height
    metal = [
        moved(bolt(0.012, 0.014), (sx * fx * x, sy * y, -depth))
        for sx in (-1, 1)
        for sy in (-1, 1)
        for fx in (0.2, 0.6, 0.95)
    ]
    metal += [moved(stud(0.03, 0.07), (s * 0.22 * width, 0.2 * height, -depth - 0.01)) for s in (-1, 1)]
    return joined([body, lid]), joined(metal)


def grapple_fixture() -> tuple[Solid, Solid]:
    """Base with three cam arms, and the grapple shaft with its tip."""
    base = [turned_part([(0.20, -0.05), (0.22, -0.03), (0.22, SINK)], 48)]
    for number in range(3):
        angle = 2.0 * np.pi * number / 3 + 0.5 * np.pi
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        base.append(bar(0.05 * out - [0, 0, 0.06], 0.215 * out - [0, 0, 0.075], 0.07, 0.06, (0.0, 0.0, 1.0)))
    shaft = turned_part(
        [(0.02, -0.32), (0.028, -0.31), (0.028, -0.285), (0.012, -0.27), (0.012, -0.08), (0.035, -0.04)], 16
    )
    return joined(base), shaft


def dish(radius: float, focal: float, segments: int = 48, rings: int = 7) -> tuple[Solid, Solid, Solid]:
    """Paraboloid that opens towards −z with its vertex at the origin; its feed; the struts."""
    r = np.linspace(radius / rings, radius, rings)
    front = [(float(x), float(-(x**2) / (4.0 * focal))) for x in r]
    back = [(float(x), z + 0.02) for x, z in front]
    shell = ring_part([*front, *reversed(back)], segments)
    hub = turned_part(
        [(radius / rings + 0.01, -0.01), (radius / rings + 0.03, 0.02), (0.16, 0.2), (0.16, 0.32)], 32
    )
    feed = turned_part(
        [(0.035, -focal - 0.02), (0.07, -focal + 0.02), (0.07, -focal + 0.14), (0.04, -focal + 0.2)], 24
    )
    legs = []
    for number in range(3):
        angle = 2.0 * np.pi * number / 3 + 0.5
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        foot = 0.8 * radius * out + [0.0, 0.0, -((0.8 * radius) ** 2) / (4.0 * focal) + 0.01]
        legs.append(tube([foot, 0.05 * out + [0.0, 0.0, 0.08 - focal]], 0.012, 10))
    return joined([shell, hub]), feed, joined(legs)


def domed_cover(radius: float, depth: float, ribs: int) -> tuple[Solid, Solid]:
    """Round cover with a domed face, and its ribs and rim bolts."""
    angle = np.linspace(0.12, 0.5 * np.pi, 9)
    dome = [(0.93 * radius * float(np.sin(a)), -depth - 0.22 * radius * float(np.cos(a))) for a in angle]
    body = turned_part(
        [
            *dome,
            (radius, -depth),
            (radius, 0.03 - depth),
            (0.94 * radius, 0.06 - depth),
            (0.94 * radius, SINK),
        ],
        48,
    )
    metal = []
    for number in range(ribs):
        turn = 2.0 * np.pi * number / ribs
        out = np.array([np.cos(turn), np.sin(turn), 0.0])
        reach = [
            (s, -depth - 0.22 * radius * np.sqrt(max(1.0 - (s / 0.93) ** 2, 0.0)))
            for s in (0.2, 0.45, 0.65, 0.8, 0.9)
        ]
        metal.append(tube([radius * s * out + [0, 0, z - 0.004] for s, z in reach], 0.018, 10))
        half = turn + np.pi / ribs
        metal.append(
            moved(bolt(0.013, 0.013), (0.965 * radius * np.cos(half), 0.965 * radius * np.sin(half), -depth))
        )
    metal.append(moved(stud(0.09, 0.03, 24), (0.0, 0.0, -depth - 0.215 * radius)))
    return body, joined(metal)


def around(solid: Solid, count: int, phase: float = 0.0) -> list[Solid]:
    """Copies of a solid turned evenly about z."""
    return [turned(solid, phase + 2.0 * np.pi * number / count) for number in range(count)]
