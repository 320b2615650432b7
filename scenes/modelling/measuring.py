"""Small scenes for measuring, and the board of four targets."""

from __future__ import annotations

import numpy as np

from modelling.fittings import target_plate
from modelling.solids import Solid, box, frame, moved, placed, turned_part
from modelling.writing import Model

SIDE = 4.0
"""Side of the flat measuring scenes, metres."""


def _quad(x: tuple[float, float], y: tuple[float, float], z: float) -> Solid:
    """Rectangle at depth z, facing −z."""
    vertices = np.array(
        [[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]], dtype=np.float64
    )
    return Solid(vertices, np.array([[0, 2, 1], [0, 3, 2]]))


def plane() -> Model:
    model = Model()
    half = 0.5 * SIDE
    model.add("plane", "grey_reference", _quad((-half, half), (-half, half), 0.0))
    return model


def tilted_plane(angle_deg: float = 30.0) -> Model:
    """The plane turned about y, its right edge away from the scanner."""
    angle = np.radians(angle_deg)
    pose = frame([0.0, 0.0, 0.0], [np.sin(angle), 0.0, -np.cos(angle)], [1.0, 0.0, 0.0])
    model = Model()
    model.add("tilted_plane", "grey_reference", placed(plane().groups["plane", "grey_reference"][0], pose))
    return model


def step(depth: float = 0.1) -> Model:
    """Left half at z = 0, right half ``depth`` behind it; the riser at x = 0 faces right."""
    half = 0.5 * SIDE
    model = Model()
    near, far = _quad((-half, 0.0), (-half, half), 0.0), _quad((0.0, half), (-half, half), depth)
    riser = Solid(
        np.array([[0.0, -half, 0.0], [0.0, -half, depth], [0.0, half, depth], [0.0, half, 0.0]]),
        np.array([[0, 2, 1], [0, 3, 2]]),
    )
    model.add("near", "grey_reference", near)
    model.add("far", "grey_reference", far)
    model.add("riser", "grey_reference", riser)
    return model


def material_edge() -> Model:
    """One plane, black left of x = 0 and white right of it."""
    half = 0.5 * SIDE
    model = Model()
    model.add("left", "target_black", _quad((-half, 0.0), (-half, half), 0.0))
    model.add("right", "target_white", _quad((0.0, half), (-half, half), 0.0))
    return model


def sphere(radius: float = 0.5, rings: int = 128, segments: int = 256) -> Model:
    """Sphere of 1 m diameter; its facets lie at most 0.08 mm inside it."""
    polar = np.pi * (np.arange(1, rings) / rings)
    profile = [(radius * float(np.sin(t)), -radius * float(np.cos(t))) for t in polar]
    solid = turned_part(profile, segments)
    # The two fans' centres are lifted from the first circle's plane to the poles.
    solid.vertices[-2:] = [[0.0, 0.0, -radius], [0.0, 0.0, radius]]
    model = Model()
    model.add("sphere", "grey_reference", solid)
    return model


def target_board() -> Model:
    """Four targets of 50 mm at the corners of a 1 m × 1 m square, on a board with a frame.

    The targets' faces lie in z = 0.
    """
    model = Model()
    for row, y in (("upper", -0.5), ("lower", 0.5)):
        for side, x in (("left", -0.5), ("right", 0.5)):
            for colour, solid in target_plate(0.05, 0.2, 0.02).items():
                model.add(f"{row}_{side}", colour, moved(solid, (x, y, 0.0)))
    model.add("board", "dyed_black_anodise", box(1.36, 1.36, 0.012, 0.04))
    thick, reach = 0.06, 1.44
    rails = [
        moved(box(reach, thick, -0.01, 0.06, 0.006), (0.0, sign * 0.5 * (reach - thick), 0.0))
        for sign in (-1, 1)
    ]
    rails += [
        moved(
            box(thick, reach - 2 * thick + 0.004, -0.008, 0.058, 0.006),
            (sign * 0.5 * (reach - thick), 0.0, 0.0),
        )
        for sign in (-1, 1)
    ]
    rails.append(box(0.05, reach - 0.1, 0.03, 0.09))
    rails.append(box(reach - 0.1, 0.05, 0.034, 0.085))
    model.add("frame", "weathered_aluminium", *rails)
    return model
