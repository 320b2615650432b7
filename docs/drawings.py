"""Draw the figures of the documentation: ``python docs/drawings.py`` writes ``conventions.svg``, ``pose.svg``,
``departures.svg`` and ``focus.svg``.

Nothing is to scale: base, axis separation and sensor are enlarged so that they can be seen.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Polygon, Rectangle

LASER, LENS, GREY, INK = "#c0392b", "#1f618d", "#8a8f94", "#1c1c1c"
FOCAL, BASE, SEPARATION, RANGE = 0.55, 0.9, 0.75, 3.0
THETA, PHI = np.deg2rad(18.0), np.deg2rad(24.0)


def arrow(axes: Axes, start: np.ndarray, end: np.ndarray, colour: str = INK, style: str = "-|>") -> None:
    """Draw an arrow from ``start`` to ``end``."""
    axes.annotate(
        "",
        end,
        start,
        arrowprops={"arrowstyle": style, "color": colour, "lw": 1.1, "shrinkA": 0, "shrinkB": 0},
    )


def label(axes: Axes, place: np.ndarray, text: str, colour: str = INK, **settings: object) -> None:
    """Write ``text`` centred at ``place``."""
    axes.text(*place, text, color=colour, **{"ha": "center", "va": "center", "fontsize": 10, **settings})


def triangulation(axes: Axes) -> None:
    """Draw the plane of triangulation from above: eq 1."""
    u, n = np.array([np.sin(THETA), np.cos(THETA)]), np.array([np.cos(THETA), -np.sin(THETA)])
    laser, node = np.zeros(2), np.array([BASE, 0.0])
    spot = RANGE * u
    p = FOCAL * BASE * np.cos(THETA) / (RANGE - BASE * np.sin(THETA))
    axis_foot = node - FOCAL * u
    image = axis_foot + p * n

    axes.plot(*zip(laser, spot, strict=True), color=LASER, lw=2)
    axes.plot(*zip(spot, image, strict=True), color=LENS, lw=1)
    axes.plot(*zip(axis_foot, node + 2.2 * u, strict=True), color=LENS, lw=0.9, ls="--")
    axes.plot(*zip(laser, [0.0, RANGE], strict=True), color=GREY, lw=0.8, ls=":")
    axes.plot(*zip(node - 0.2 * n, node + 0.2 * n, strict=True), color=LENS, lw=4, solid_capstyle="round")
    axes.plot(*zip(axis_foot - 0.02 * n, axis_foot + 0.42 * n, strict=True), color=INK, lw=3)
    axes.plot(*spot, "o", color=LASER, ms=7)
    axes.plot(*image, "o", color=LASER, ms=4)
    axes.plot(*laser, "o", color=INK, ms=4)
    axes.plot(*node, "o", color=INK, ms=3)

    axes.add_patch(Arc((0, 0), 2.2, 2.2, theta1=90 - np.rad2deg(THETA), theta2=90, color=INK))
    label(axes, 1.27 * np.array([np.sin(THETA / 2), np.cos(THETA / 2)]), "Θ > 0")
    label(axes, np.add(spot, (0.08, 0.14)), "spot", LASER, ha="left")
    label(axes, 0.62 * np.add(spot, (-0.1, 0.08)), "R", LASER)
    label(axes, np.array([-0.1, -0.12]), "laser (0, 0)", ha="right")
    label(axes, np.add(node, (0.3, 0.1)), "lens node (d, 0)", LENS, ha="left")
    label(axes, node + 2.3 * u, "∥ u", LENS)
    label(axes, node + 0.55 * (axis_foot - node) + [-0.12, 0.04], "f", LENS)
    label(axes, np.add(axis_foot, (-0.12, -0.12)), "p = 0 (infinity)", ha="right", fontsize=9)
    label(axes, np.add(image, (0.05, -0.17)), "p", LASER)
    label(
        axes,
        axis_foot + 0.47 * n,
        "sensor: nearer →",
        ha="left",
        fontsize=9,
        rotation=-np.rad2deg(THETA),
        rotation_mode="anchor",
    )
    arrow(axes, laser, 0.8 * u, LASER)
    label(axes, 0.85 * u + [0.16, -0.06], "u", LASER)
    arrow(axes, node + 0.95 * u, node + 0.95 * u + 0.5 * n)
    label(axes, node + 0.95 * u + 0.6 * n, "n")
    axes.plot(*zip(laser, node, strict=True), color=INK, lw=0.8)
    label(axes, np.array([0.5 * BASE, 0.1]), "d")
    compass(axes, np.array([-1.2, 1.9]), "x", "z'")
    axes.set_title("From above: the plane of triangulation, seen along +y", fontsize=11)
    axes.set(xlim=(-1.6, 2.6), ylim=(-1.0, 3.3), aspect="equal")


def compass(axes: Axes, place: np.ndarray, right: str, other: str) -> None:
    """Draw two axes: one to the right, and one up or, where the panel counts downwards, down."""
    arrow(axes, place, np.add(place, (0.55, 0.0)))
    arrow(axes, place, np.add(place, (0.0, 0.55)))
    label(axes, np.add(place, (0.67, 0.0)), right)
    label(axes, np.add(place, (0.0, 0.67)), other)


def second_mirror(axes: Axes) -> None:
    """Draw the second deflection from the side: eq 3."""
    axes.invert_yaxis()
    pivot = np.array([SEPARATION, 0.0])
    towards = np.array([np.cos(PHI), np.sin(PHI)])
    virtual = pivot - SEPARATION * towards
    reach = 2.0
    end = pivot + reach * towards
    axes.plot([0.0, 3.2], [0.0, 0.0], color=GREY, lw=0.8, ls=":")
    axes.plot(*zip(virtual, pivot, strict=True), color=LASER, lw=1.2, ls="--")
    axes.plot([0.0, SEPARATION], [0.0, 0.0], color=LASER, lw=1.2, alpha=0.45)
    axes.plot(*zip(pivot, end, strict=True), color=LASER, lw=2)
    axes.plot(*end, "o", color=LASER, ms=7)
    axes.plot(0.0, 0.0, "o", color=INK, ms=5)
    axes.plot(*virtual, "o", color=LENS, ms=6, mfc="white", mew=1.6)
    axes.plot(*pivot, "s", color=INK, ms=6)
    axes.add_patch(Arc(tuple(pivot), 1.8, 1.8, theta1=0, theta2=np.rad2deg(PHI), color=INK))
    label(axes, pivot + 1.22 * np.array([np.cos(PHI / 2), np.sin(PHI / 2)]), "φ > 0")
    label(axes, np.array([-0.08, 0.17]), "first axis:\norigin", ha="right", fontsize=9)
    label(axes, np.add(pivot, (0.0, 0.42)), "second axis\n(along x)", fontsize=9)
    label(
        axes,
        np.add(virtual, (0.0, -0.3)),
        "laser and lens appear here:\n(0 or d, −D_g sinφ, D_g (1 − cosφ))",
        LENS,
        fontsize=9,
    )
    label(axes, np.array([0.5 * SEPARATION, 0.12]), "D_g")
    label(
        axes,
        pivot + 0.62 * reach * towards + [-0.05, 0.25],
        "R cosΘ − D_g",
        LASER,
        rotation=-np.rad2deg(PHI),
        fontsize=9,
    )
    label(axes, np.add(end, (0.12, 0.12)), "spot", LASER, ha="left")
    compass(axes, np.array([-1.0, 0.75]), "z", "y (down)")
    axes.set_title("From the right: the second mirror turns everything by φ", fontsize=11)
    axes.set(xlim=(-1.4, 3.4), ylim=(1.75, -1.1), aspect="equal")


def picture(axes: Axes) -> None:
    """Draw the order of the shots in a picture of 3 × 4 voxels."""
    axes.invert_yaxis()
    for row in range(3):
        for column in range(4):
            axes.add_patch(Rectangle((column, row), 1, 1, fill=False, ec=GREY))
            label(axes, np.array([column + 0.5, row + 0.5]), str(row * 4 + column))
    arrow(axes, np.array([0.0, -0.25]), np.array([4.0, -0.25]))
    arrow(axes, np.array([-0.25, 0.0]), np.array([-0.25, 3.0]))
    label(axes, np.array([2.0, -0.55]), "column: Θ grows, to the right")
    label(axes, np.array([-0.55, 1.5]), "row: φ grows,\ndownwards", rotation=90)
    label(axes, np.array([2.0, 3.35]), "number of the shot = row · columns + column", fontsize=9)
    axes.set_title("The picture: what the scanner sees", fontsize=11)
    axes.set(xlim=(-1.2, 4.4), ylim=(3.7, -0.9), aspect="equal")


def line_sensor(axes: Axes) -> None:
    """Draw the pixels of the line sensor and the light of a spot."""
    share = np.array([0.02, 0.16, 0.68, 0.95, 0.5, 0.09, 0.01, 0.0])
    axes.bar(np.arange(8), 1.2 * share, width=0.92, color="#e6b0aa", ec=LASER, lw=0.6)
    for pixel in range(8):
        axes.add_patch(Rectangle((pixel - 0.5, -0.42), 1, 0.42, fill=False, ec=INK, lw=0.8))
        label(axes, np.array([pixel, -0.21]), str(pixel))
    peak = float(np.arange(8) @ share / share.sum())
    axes.plot([peak, peak], [-0.42, 1.35], color=LASER, lw=1, ls="--")
    label(axes, np.array([peak, 1.48]), f"peak at {peak:.2f} px", LASER)
    arrow(axes, np.array([-0.5, -0.75]), np.array([7.9, -0.75]))
    label(axes, np.array([3.7, -1.0]), "p = offset + (peak + ½) · pitch, nearer →", fontsize=9)
    axes.plot([-0.5, -0.5], [-0.85, -0.42], color=INK, lw=0.8)
    label(axes, np.array([-0.5, -1.0]), "offset", fontsize=9)
    axes.set_title("The line: pixel i has its centre at i", fontsize=11)
    axes.set(xlim=(-1.0, 8.1), ylim=(-1.25, 1.75))


def seen_from_above(points: np.ndarray) -> np.ndarray:
    """Return points (..., 3) of the scanner frame as on the sheet: x to the right, y down, z slanting away."""
    return np.stack([points[..., 0] + 0.55 * points[..., 2], 0.42 * points[..., 2] - points[..., 1]], axis=-1)


def axes_of_frame(axes: Axes, origin: np.ndarray, turned: np.ndarray, names: str, colour: str) -> None:
    """Draw the three axes of a frame, the columns of ``turned``, at ``origin``."""
    for name, direction in zip(names.split(), turned.T, strict=True):
        tip = seen_from_above(origin + 0.9 * direction)
        arrow(axes, seen_from_above(origin), tip, colour)
        label(axes, seen_from_above(origin + 1.08 * direction), name, colour)


def about(axis: int, angle: float) -> np.ndarray:
    """Return the right-handed rotation about one of the axes."""
    turned = np.eye(3)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    turned[first, first] = turned[second, second] = np.cos(angle)
    turned[second, first] = np.sin(angle)
    turned[first, second] = -turned[second, first]
    return turned


def pose_frames(axes: Axes) -> None:
    """Draw scanner and object, and what a pose is."""
    turned = about(1, 0.5) @ about(0, 0.15) @ about(2, 0.2)
    place = np.array([1.6, 0.1, 5.0])
    corners = 0.8 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    outline = seen_from_above(corners @ turned.T + place)
    axes.add_patch(Polygon(outline, fc="#eef2f5", ec=GREY))
    for number, corner in enumerate(outline):
        axes.plot(*zip(seen_from_above(np.zeros(3)), corner, strict=True), color=LASER, lw=0.6, ls=":")
        axes.plot(*corner, "o", color=LASER, ms=6)
        label(axes, np.add(corner, (0.0, 0.24 if number < 2 else -0.24)), f"r{'₁₂₃₄'[number]}", LASER)
    axes_of_frame(axes, np.zeros(3), np.eye(3), "x y z", INK)
    axes_of_frame(axes, place, turned, "x_o y_o z_o", LENS)
    arrow(axes, seen_from_above(np.zeros(3)), seen_from_above(place), INK)
    label(axes, np.add(seen_from_above(0.55 * place), (0.22, -0.14)), "t")
    label(axes, np.array([-0.2, -0.25]), "scanner", ha="right")
    label(axes, np.add(seen_from_above(place), (0.95, -0.6)), "object", LENS)
    label(axes, np.array([2.6, -1.75]), "X = R r + t        R = scanner_from_object", fontsize=11)
    label(axes, np.array([2.6, -2.15]), "errors: t + δt, exp([δω]×) R, both along x, y, z", fontsize=10)
    axes.set_title("A pose: the object's frame in the scanner's", fontsize=11)
    axes.set(xlim=(-1.2, 6.6), ylim=(-2.4, 3.6), aspect="equal")


def turns(axes: Axes) -> None:
    """Draw yaw, pitch and roll, each as it is seen along its axis."""
    for number, (name, right, other, words) in enumerate(
        (
            ("yaw, from above", "x", "z", "about y: turns right"),
            ("pitch, from the right", "z", "−y", "about x: turns up"),
            ("roll, from behind", "x", "y", "about z: right side down"),
        )
    ):
        middle = np.array([0.0, -3.0 * number])
        down = other == "y"
        angle = np.deg2rad(25.0)
        arrow(axes, middle, np.add(middle, (1.3, 0.0)), GREY)
        label(axes, np.add(middle, (1.5, 0.0)), right, GREY)
        arrow(axes, middle, np.add(middle, (0.0, -1.3 if down else 1.3)), GREY)
        label(axes, np.add(middle, (0.0, -1.5 if down else 1.5)), other, GREY)
        # What looks along z (yaw, pitch) or to the right (roll) goes to: right, up, down.
        forward = {0: np.array([0.0, 1.0]), 1: np.array([1.0, 0.0]), 2: np.array([1.0, 0.0])}[number]
        sense = {0: -angle, 1: angle, 2: -angle}[number]
        rotation = np.array([[np.cos(sense), -np.sin(sense)], [np.sin(sense), np.cos(sense)]])
        arrow(axes, middle, middle + 1.25 * rotation @ forward, LENS)
        arrow(axes, middle + 0.8 * forward, middle + 0.82 * rotation @ forward, LASER, "->")
        label(axes, np.add(middle, (2.0, 0.75)), name, ha="left")
        label(axes, np.add(middle, (2.0, 0.4)), words, LENS, ha="left", fontsize=9)
    axes.set_title("R = R_y(yaw) R_x(pitch) R_z(roll)", fontsize=11)
    axes.set(xlim=(-0.6, 4.6), ylim=(-7.9, 1.8), aspect="equal")


def departures_above(axes: Axes) -> None:
    """Draw the signs of what departs in the plane of triangulation, at Θ = 0, seen along +y."""
    behind, lean = -FOCAL, np.deg2rad(14.0)
    axes.plot([0.0, 0.0], [0.0, 2.2], color=GREY, lw=0.9, ls=":")
    turned = 2.2 * np.array([np.sin(np.deg2rad(9.0)), np.cos(np.deg2rad(9.0))])
    axes.plot([0.0, turned[0]], [0.0, turned[1]], color=LASER, lw=2)
    axes.plot([BASE - 0.22, BASE + 0.22], [0.0, 0.0], color=LENS, lw=4, solid_capstyle="round")
    axes.plot([BASE, BASE + 0.42], [behind, behind], color=GREY, lw=2, ls=":")
    further = behind - 0.16
    end = np.array([BASE + 0.12, further]) + 0.5 * np.array([np.cos(lean), -np.sin(lean)])
    axes.plot([BASE + 0.12, end[0]], [further, end[1]], color=INK, lw=3)
    axes.plot([0.0, BASE], [0.0, 0.0], color=INK, lw=0.8)
    arrow(axes, np.array([BASE, 0.12]), np.array([BASE + 0.5, 0.12]))
    label(axes, np.array([BASE + 0.55, 0.12]), "base", ha="left")
    arrow(axes, np.array([BASE - 0.3, behind]), np.array([BASE - 0.3, further - 0.12]))
    label(axes, np.array([BASE - 0.35, behind - 0.12]), "focal_length", ha="right")
    arrow(axes, np.array([BASE, behind + 0.12]), np.array([BASE + 0.2, behind + 0.12]))
    label(axes, np.array([BASE + 0.25, behind + 0.14]), "array_offset: +p, nearer", ha="left", fontsize=9)
    label(axes, np.add(end, (0.05, -0.05)), "array_tilt: the near end leans away", ha="left", fontsize=9)
    arrow(axes, np.array([0.03, 1.75]), np.array([0.25, 1.72]), LASER)
    label(
        axes,
        np.array([0.36, 1.9]),
        "theta_zero: the beam points further\nthan the encoder reads",
        LASER,
        ha="left",
        fontsize=9,
    )
    label(axes, np.array([-0.08, 2.1]), "Θ as read", GREY, ha="right", fontsize=9)
    compass(axes, np.array([-0.9, 1.0]), "x", "z")
    axes.set_title("From above, at Θ = 0: dotted as designed, solid as built", fontsize=11)
    axes.set(xlim=(-1.2, 3.2), ylim=(-1.15, 2.4), aspect="equal")


def departures_ahead(axes: Axes) -> None:
    """Draw the signs of the second axis, seen along the beam (+z)."""
    axes.invert_yaxis()
    skew, offset = np.deg2rad(12.0), 0.5
    along = np.array([np.cos(skew), np.sin(skew)])
    axes.plot([-2.0, 2.0], [0.0, 0.0], color=GREY, lw=2, ls=":")
    for end in (-2.0, 2.0):
        axes.plot([0.0, end * along[0]], [offset, offset + end * along[1]], color=INK, lw=2.5)
    axes.plot(0.0, 0.0, "o", color=LASER, ms=9)
    label(axes, np.array([-0.12, -0.2]), "beam at Θ = 0, seen along it", LASER, ha="right", fontsize=9)
    arrow(axes, np.array([0.0, 0.05]), np.array([0.0, offset]))
    label(axes, np.array([0.1, 0.28]), "axis_offset", ha="left")
    axes.add_patch(Arc((0.0, offset), 2.6, 2.6, theta1=0, theta2=np.rad2deg(skew), color=INK))
    axes.plot([0.0, 1.6], [offset, offset], color=GREY, lw=0.8)
    label(axes, np.array([1.4, offset + 0.14]), "axis_skew", ha="left")
    label(axes, np.array([2.05, 0.0]), "second axis\nas designed", GREY, ha="left", fontsize=9)
    compass(axes, np.array([-2.0, 1.2]), "x", "y (down)")
    axes.set_title("Along the beam: where the second axis lies", fontsize=11)
    axes.set(xlim=(-2.6, 3.0), ylim=(2.1, -0.8), aspect="equal")


def array_in_focus(axes: Axes) -> None:
    """Draw the lens, the image of the beam, and what of a point on an upright array is blurred."""
    f, d, half, near, far = 1.0, 1.3, 0.34, 2.6, 6.0
    beam, node = -d, np.zeros(2)
    images = [np.array([f * d / (z - f), -f * z / (z - f)]) for z in (near, far)]
    axes.plot([beam, beam], [-0.25, 3.3], color=LASER, lw=2)
    axes.plot([0.0, 0.0], [-2.2, 3.3], color=GREY, lw=0.8, ls="--")
    axes.plot([-half, half], [0.0, 0.0], color=LENS, lw=4, solid_capstyle="round")
    axes.plot(*zip([0.0, -f], 1.3 * images[0] - 0.3 * np.array([0.0, -f]), strict=True), color=INK, lw=3)
    spot = np.array([beam, near])
    for edge in (-half, 0.0, half):
        axes.plot(*zip(spot, [edge, 0.0], images[0], strict=True), color=LENS, lw=0.7)
    axes.plot(*zip([beam * 3.3 / far, 3.3], node, images[1], strict=True), color=GREY, lw=0.7)
    upright = images[1][1]
    axes.plot([0.0, 1.0], [upright, upright], color=INK, lw=1.2, ls=":")
    cut = [edge + (images[0][0] - edge) * upright / images[0][1] for edge in (-half, half)]
    axes.plot(cut, [upright, upright], color=LASER, lw=4, solid_capstyle="butt")
    axes.plot(*spot, "o", color=LASER, ms=6)
    axes.plot(*images[0], "o", color=LASER, ms=4)
    axes.plot(0.0, -f, "o", color=INK, ms=4)
    label(axes, np.array([beam - 0.08, near]), "spot at z", LASER, ha="right")
    label(axes, np.array([-half - 0.08, 0.0]), "lens, A", LENS, ha="right")
    label(axes, np.array([-0.08, -f]), "(0, f): image of infinity", ha="right", fontsize=9)
    label(axes, images[0] + [0.1, 0.0], "s = f d/(z − f) · √(1 + (f/d)²)", ha="left", fontsize=9)
    label(axes, images[0] + [0.1, -0.24], "array on the image of the beam: sharp", ha="left", fontsize=9)
    label(axes, np.array([1.08, upright]), "upright array, focused farther: blurred", ha="left", fontsize=9)
    label(axes, np.array([0.5 * beam, -0.3]), "d")
    arrow(axes, np.array([beam, -0.18]), np.array([0.0, -0.18]), style="<|-|>")
    axes.set_title("The lens and its array, seen along +y", fontsize=11)
    axes.set(xlim=(-2.4, 3.4), ylim=(-2.3, 3.3), aspect="equal")


def main(folder: Path) -> None:
    """Write the drawings; the same program writes the same bytes."""
    mpl.rcParams.update({"svg.hashsalt": "scanner-sim", "font.family": "DejaVu Sans"})
    figure = Figure(figsize=(12.0, 9.6), layout="constrained")
    panels = figure.subplots(2, 2, gridspec_kw={"height_ratios": [1.35, 1.0]})
    for draw, axes in zip((triangulation, second_mirror, picture, line_sensor), panels.flat, strict=True):
        axes.set_axis_off()
        draw(axes)
    figure.savefig(folder / "conventions.svg", metadata={"Date": None})
    figure = Figure(figsize=(12.0, 5.6), layout="constrained")
    panels = figure.subplots(1, 2, gridspec_kw={"width_ratios": [1.7, 1.0]})
    for draw, axes in zip((pose_frames, turns), panels, strict=True):
        axes.set_axis_off()
        draw(axes)
    figure.savefig(folder / "pose.svg", metadata={"Date": None})
    figure = Figure(figsize=(8.6, 7.4), layout="constrained")
    axes = figure.subplots()
    axes.set_axis_off()
    array_in_focus(axes)
    figure.savefig(folder / "focus.svg", metadata={"Date": None})
    figure = Figure(figsize=(12.0, 4.6), layout="constrained")
    panels = figure.subplots(1, 2, gridspec_kw={"width_ratios": [1.25, 1.0]})
    for draw, axes in zip((departures_above, departures_ahead), panels, strict=True):
        axes.set_axis_off()
        draw(axes)
    figure.savefig(folder / "departures.svg", metadata={"Date": None})


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
