"""The Z1 truss on the Node's upper port: a box truss with gyroscope covers, antenna, radiators and boxes.

Drawn freely in the manner of the published Z1 (about 4.9 m × 4.2 m × 3 m), in the module frame of the Node.
"""

from __future__ import annotations

import itertools

import numpy as np

from modelling import fittings as fit
from modelling.node import AddTarget
from modelling.sheets import blanket, flat
from modelling.solids import (
    Array,
    Solid,
    bar,
    box,
    draped,
    frame,
    i_beam,
    joined,
    moved,
    placed,
    ring_part,
    tube,
    turned,
    turned_part,
)
from modelling.writing import Model

X = (-2.2, -0.75, 0.75, 2.2)
TOP, BOTTOM = -5.60, -2.98
FRONT, REAR = 1.90, 5.00
FACE = FRONT - 0.08
"""Depth of the front faces of the front beams."""


def front_pose(x: float, y: float, z: float) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = [x, y, z]
    return pose


def build(model: Model, add_target: AddTarget) -> None:
    _truss(model)
    _adapter(model)
    _walls(model)
    _gyroscopes(model)
    _radiators(model)
    _centre_bay(model)
    _antenna(model)
    _roof(model)
    _cables(model)
    _targets(model, add_target)


def _truss(model: Model) -> None:
    """Chords, posts and diagonals; gussets with bolts at the joints of the front."""
    up, ahead = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    beams: list[Solid] = []
    for z, y in itertools.product((FRONT, REAR), (TOP, BOTTOM)):
        beams.append(i_beam([X[0] - 0.08, y, z], [X[3] + 0.08, y, z], 0.16, 0.17, ahead))
    for z, x in itertools.product((FRONT, REAR), X):
        beams.append(i_beam([x, TOP + 0.06, z], [x, BOTTOM - 0.06, z], 0.14, 0.15, ahead))
    for y, x in itertools.product((TOP, BOTTOM), X):
        beams.append(i_beam([x, y, FRONT + 0.07], [x, y, REAR - 0.07], 0.13, 0.14, up))
    model.add("z1_truss", "weathered_aluminium", *beams)

    struts: list[Solid] = []
    mid = 0.5 * (TOP + BOTTOM)
    for x in (X[0], X[3]):
        struts.append(tube([[x, TOP, FRONT + 0.1], [x, BOTTOM, REAR - 0.1]], 0.045, 12))
        struts.append(tube([[x, BOTTOM, FRONT + 0.1], [x, mid - 0.05, 0.5 * (FRONT + REAR) - 0.1]], 0.04, 12))
    for a, b in ((X[1], 0.0), (X[2], 0.0)):
        struts.append(
            tube([[a, TOP + 0.1, FRONT + 0.03], [b, mid + 0.02 * np.sign(a), FRONT + 0.03]], 0.04, 12)
        )
    for x in (-1.25, 1.25):
        struts.append(tube([[x, -1.86, 1.34], [1.15 * x, BOTTOM, FRONT]], 0.05, 12))
        struts.append(tube([[x, -1.86, 1.34], [0.55 * x, BOTTOM, FRONT + 0.02]], 0.04, 12))
    model.add("z1_truss", "weathered_aluminium", *struts)

    gussets, heads = [], []
    for x, y in itertools.product(X, (TOP, BOTTOM)):
        gussets.append(moved(box(0.32, 0.26, FACE - 0.022, FACE + 0.02, 0.006), (x, y, 0.0)))
        for dx, dy in itertools.product((-0.12, -0.04, 0.04, 0.12), (-0.09, 0.09)):
            heads.append(moved(fit.bolt(0.013, 0.014), (x + dx, y + dy, FACE - 0.022)))
    model.add("z1_gussets", "oxidised_inconel", *gussets)
    model.add("z1_gussets", "nickel", *heads)


def _adapter(model: Model) -> None:
    """Berthing adapter between the Node's upper port and the truss."""
    pose = frame([0.0, -2.64, 4.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0])
    profile = [
        (0.90, 0.0),
        (1.09, 0.0),
        (1.09, -0.06),
        (1.0, -0.08),
        (1.15, -0.33),
        (1.15, -0.405),
        (0.90, -0.405),
    ]
    model.add("z1_truss", "weathered_aluminium", placed(ring_part(profile, 96), pose))


def _walls(model: Model) -> None:
    """Blankets inside the truss close it to the rear, the sides, above and below."""
    height, width = BOTTOM - TOP, X[3] - X[0]
    back = placed(
        draped(flat(width - 0.1, height - 0.1), blanket(56, 34, (6, 4), 0.06, 0.03, 31), 0.02),
        front_pose(0.0, 0.5 * (TOP + BOTTOM), 3.3),
    )
    model.add("z1_blankets", "beta_cloth", back)
    core = box(width - 0.08, height - 0.08, 3.30, REAR - 0.1)
    model.add("z1_core", "weathered_aluminium", moved(core, (0.0, 0.5 * (TOP + BOTTOM), 0.0)))
    depth = 3.3 - FRONT - 0.15
    for number, (x, normal) in enumerate(((X[0], -1.0), (X[3], 1.0))):
        pose = frame(
            [x - 0.01 * normal, 0.5 * (TOP + BOTTOM), FRONT + 0.1 + 0.5 * depth],
            [normal, 0.0, 0.0],
            [0.0, 0.0, 1.0],
        )
        skin = draped(flat(depth, height - 0.2), blanket(22, 34, (2, 4), 0.03, 0.015, 41 + number), 0.004)
        model.add("z1_blankets", "beta_cloth", placed(skin, pose))
        model.add("z1_core", "weathered_aluminium", placed(box(depth + 0.04, height - 0.1, 0.0, 0.03), pose))
    floor = frame([0.0, BOTTOM + 0.01, FRONT + 0.8], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    model.add("z1_core", "weathered_aluminium", placed(box(width - 0.12, 1.36, 0.0, 0.03), floor))
    roof = frame([0.0, TOP - 0.01, FRONT + 1.5], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0])
    model.add("z1_core", "weathered_aluminium", placed(box(width - 0.12, 2.8, 0.0, 0.03), roof))


def _gyroscopes(model: Model) -> None:
    """Two control moment gyroscopes in each outer bay, under domed covers."""
    for x, y in ((-1.475, -4.95), (-1.475, -3.63), (1.475, -4.95)):
        cover, metal = fit.domed_cover(0.60, 0.36, 8)
        pose = front_pose(x, y, 2.30)
        model.add("z1_gyroscopes", "z93_white", placed(cover, pose))
        model.add("z1_gyroscopes", "weathered_aluminium", placed(metal, pose))
        neck = turned_part([(0.38, 0.0), (0.38, 1.05)], 48)
        model.add("z1_gyroscopes", "weathered_aluminium", placed(neck, pose))
        arms = [
            turned(moved(box(0.56, 0.09, 0.03, 0.12, 0.01), (0.58, 0.0, 0.0)), a)
            for a in np.radians([45, 135, 225, 315])
        ]
        model.add("z1_gyroscopes", "oxidised_inconel", *[placed(arm, pose) for arm in arms])


def _radiators(model: Model) -> None:
    """Converter units with fins in the lower right bay."""
    mount = moved(box(1.34, 1.22, 2.42, 2.48), (1.475, -3.62, 0.0))
    model.add("z1_core", "weathered_aluminium", mount)
    for x, y, size in (
        (1.15, -3.62, (0.58, 1.08, 0.40)),
        (1.80, -3.34, (0.56, 0.52, 0.48)),
        (1.80, -3.90, (0.56, 0.50, 0.36)),
    ):
        body, fins = fit.finned_box(*size, fins=int(size[1] / 0.06))
        pose = front_pose(x, y, 2.42)
        model.add("z1_converters", "z93_white", placed(body, pose), placed(fins, pose))


def _centre_bay(model: Model) -> None:
    """Equipment under blankets, a grapple fixture, a target panel and a plasma contactor."""
    middle = moved(box(1.20, 0.96, 2.05, 3.34, 0.03), (0.0, -3.55, 0.0))
    model.add("z1_core", "weathered_aluminium", middle)
    cover = draped(flat(1.14, 0.90), blanket(44, 36, (4, 3), 0.035, 0.014, 57), 0.01)
    model.add("z1_blankets", "aluminised_kapton", placed(cover, front_pose(0.0, -3.55, 2.05)))
    base, shaft = fit.grapple_fixture()
    pose = front_pose(0.0, -3.55, 1.97)
    pedestal = turned_part([(0.18, -0.01), (0.20, 0.12)], 32)
    model.add("z1_grapple", "weathered_aluminium", placed(joined([base, pedestal]), pose))
    model.add("z1_grapple", "oxidised_inconel", placed(shaft, pose))
    plate = moved(box(1.18, 0.94, FACE + 0.02, FACE + 0.07, 0.008), (0.0, -4.72, 0.0))
    legs = [
        moved(box(0.08, 0.08, FACE + 0.06, 3.32), (x, y, 0.0)) for x in (-0.5, 0.5) for y in (-4.4, -5.05)
    ]
    model.add("z1_target_panel", "dyed_black_anodise", plate)
    model.add("z1_core", "weathered_aluminium", *legs)
    for x in (-0.66, 0.66):
        rail = placed(fit.handrail(0.80), frame([x + np.sign(x) * 0.09, -3.6, FACE], [0, 0, -1], [0, 1, 0]))
        model.add("z1_handrails", "weathered_aluminium", rail)
    for x in (-1.475, 0.0, 1.475):
        rail = placed(fit.handrail(0.95), front_pose(x, TOP, FACE))
        low = placed(fit.handrail(0.95), front_pose(x, BOTTOM, FACE))
        model.add("z1_handrails", "weathered_aluminium", rail, low)
    for x in (X[0], X[3]):
        for y in (-4.75, -3.85):
            pose = frame([x, y, FACE], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0])
            model.add("z1_handrails", "weathered_aluminium", placed(fit.handrail(0.70), pose))


def _antenna(model: Model) -> None:
    """Boom on the roof with a dish that looks to the scanner."""
    foot = np.array([1.35, TOP, 2.7])
    boom = tube([foot, np.add(foot, [0.0, -0.55, 0.0]), np.add(foot, [0.12, -1.15, -0.35])], 0.07, 16)
    collar = placed(
        turned_part([(0.16, -0.10), (0.18, -0.08), (0.18, 0.08)], 32), frame(foot, [0, -1, 0], [1, 0, 0])
    )
    model.add("z1_antenna", "weathered_aluminium", boom, collar)
    reflector, feed, legs = fit.dish(0.80, 0.55)
    pose = frame(np.add(foot, [0.14, -1.2, -0.68]), [-0.22, 0.12, -0.95], [1.0, 0.0, 0.0])
    model.add("z1_antenna", "z93_white", placed(reflector, pose))
    model.add("z1_antenna", "black_paint", placed(feed, pose))
    model.add("z1_antenna", "weathered_aluminium", placed(legs, pose))


def _roof(model: Model) -> None:
    """Left: a tracking antenna's box and mast; two plasma contactors; a small solar cell panel."""
    body, metal = fit.equipment_box(0.62, 0.46, 0.30)
    pose = front_pose(-1.45, TOP - 0.33, 2.35)
    plinth = moved(box(0.7, 0.16, 2.1, 2.75), (-1.45, TOP - 0.08, 0.0))
    model.add("z1_roof", "z93_white", placed(body, pose), placed(box(0.60, 0.44, 0.0, 0.35), pose))
    model.add("z1_roof", "nickel", placed(metal, pose))
    model.add("z1_roof", "weathered_aluminium", plinth)
    mast = tube([[-1.45, TOP - 0.5, 2.5], [-1.45, TOP - 1.1, 2.5]], 0.03, 12)
    horn = placed(
        turned_part([(0.11, -0.24), (0.105, -0.24 + 0.01), (0.03, 0.0), (0.03, 0.06)], 32),
        front_pose(-1.45, TOP - 1.12, 2.46),
    )
    model.add("z1_roof", "weathered_aluminium", mast, horn)
    for x in (-0.35, 0.35):
        unit = joined(
            [box(0.34, 0.40, -0.30, 0.30, 0.02), moved(box(0.38, 0.06, -0.26, 0.26), (0.0, 0.19, 0.0))]
        )
        pose = front_pose(x, TOP - 0.26, 2.40)
        model.add("z1_plasma_contactors", "aluminised_kapton", placed(unit, pose))
        nozzle = ring_part([(0.05, -0.44), (0.085, -0.44), (0.10, -0.29), (0.04, -0.29), (0.03, -0.33)], 32)
        model.add("z1_plasma_contactors", "oxidised_inconel", placed(nozzle, pose))
    pose = frame([-2.05, TOP - 0.75, 2.35], [-0.15, -0.25, -0.95], [1.0, 0.0, 0.0])
    cells = [
        moved(box(0.13, 0.13, -0.004, 0.006), (0.145 * i, 0.145 * j, 0.0))
        for i in (-1, 0, 1)
        for j in (-2, -1, 0, 1, 2)
    ]
    model.add("z1_solar_panel", "solar_cell", *[placed(cell, pose) for cell in cells])
    model.add("z1_roof", "weathered_aluminium", placed(box(0.48, 0.78, 0.0, 0.025), pose))
    stay = bar([-2.05, TOP, 2.45], [-2.05, TOP - 0.72, 2.40], 0.05, 0.05, (0.0, 0.0, 1.0))
    model.add("z1_roof", "weathered_aluminium", stay)


def _cables(model: Model) -> None:
    """Bundles along the bottom chord, up a post and down to the Node."""
    runs, saddles = [], []
    for lane in range(4):
        y = BOTTOM - 0.16 - 0.035 * lane
        xs = np.linspace(-2.1 + 0.1 * lane, 1.9 - 0.2 * lane, 10)
        points = [
            [x, y + 0.012 * np.sin(3.0 * n + lane), FACE + 0.03 + 0.012 * np.cos(2.0 * n + 2 * lane)]
            for n, x in enumerate(xs)
        ]
        runs.append(fit.cable(points, 0.014, steps=3))
    for x in (-1.7, -1.1, -0.4, 0.4, 1.0):
        saddles.append(moved(box(0.04, 0.30, FACE - 0.01, FACE + 0.06, 0.008), (x, BOTTOM - 0.19, 0.0)))
    for lane, x in enumerate((-0.52, -0.46, -0.40)):
        points = [
            [x, -3.05, FRONT - 0.02],
            [x - 0.03, -2.75, 1.72 - 0.05 * lane],
            [x + 0.05 * lane, -2.45, 1.55],
            [x + 0.1, -2.26, 1.36],
            [x + 0.12, -2.14, 1.18],
        ]
        runs.append(fit.cable(points, 0.02, steps=8))
    for lane, x in enumerate((-0.71, -0.79)):
        points = [
            [x + 0.01 * np.sin(2 * n + lane), y, FACE - 0.012]
            for n, y in enumerate(np.linspace(BOTTOM - 0.05, TOP + 0.1, 8))
        ]
        runs.append(fit.cable(points, 0.013, steps=3))
    model.add("z1_cables", "black_paint", *runs)
    model.add("z1_gussets", "nickel", *saddles)


def _targets(model: Model, add_target: AddTarget) -> None:
    """Six on the panel of the centre bay, one at each upper and lower corner, two on the adapter's struts."""
    for number, (y, x) in enumerate(itertools.product((-4.97, -4.47), (-0.42, 0.0, 0.42))):
        add_target(f"panel_{number + 1}", front_pose(x, y, FACE), 0.10)
    for number, (x, y) in enumerate(itertools.product((-2.2, 2.2), (TOP + 0.30, BOTTOM - 0.32))):
        add_target(f"corner_{number + 1}", front_pose(x, y, FACE - 0.02), 0.10)
        if y > BOTTOM:
            model.add(
                "z1_target_posts",
                "weathered_aluminium",
                moved(box(0.10, 0.46, FACE, FACE + 0.05), (x, y - 0.12, 0.0)),
            )
