"""Experiments on tiles: the narrowest crack, and the depth of a dent."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from scipy.optimize import least_squares

from scanner_sim.validation.reproduce.bench import Array, aim, bench, layers_of
from scanner_sim.validation.reproduce.drawing import BLUE, COLOURS, RED, logarithms, sheet
from scanner_sim.validation.reproduce.family.judging import Finding, Measured
from scanner_sim.validation.reproduce.item import Task, row_of_claim

_TILE = 0.5
"""Reflectance of tiles; that of real ones at this wavelength is not printed."""
_STEP = 0.35e-3
"""Distance of the voxels on a tile [m]: the finer of the printed resolutions."""
FAR = 4.0
"""The far end of the inspection [m]."""

_DEEP = 10e-3
"""Depth of the crack [m]."""
_ROWS = 60
"""Voxels along the crack: 21 mm of it."""
_ROSE = 5.0
"""Signal over noise at which a feature is told from noise with certainty (Rose, *J. Opt. Soc. Am.* 38, 1948, 196)."""
_AWAY = 16
"""Columns to each side of the crack that are not taken for its surroundings."""
_BOX = 3
"""Columns that are averaged."""

_DENT, _DEPTH = 76e-3, 5e-3
"""Diameter and depth of the dent [m]."""


class View(NamedTuple):
    """A small raster on a tile: its range, the distances of voxels and of rows on it [m], rows and columns."""

    distance: float
    pitch: float
    apart: float
    rows: int
    columns: int

    def layers(
        self, task: Task, objects: Sequence[Mapping[str, object]], instrument: str, step: int
    ) -> Mapping[str, Array]:
        """Return its layers, mirrors at rest, shape (rows, columns)."""
        made = bench(task, objects, {"preset": instrument}, step=step)
        phi, theta = np.meshgrid(
            (np.arange(self.rows) - self.rows // 2) * self.apart / self.distance,
            (np.arange(self.columns) - self.columns // 2) * self.pitch / self.distance,
            indexing="ij",
        )
        found = layers_of(made, aim(theta, phi))
        return {name: values.reshape(self.rows, self.columns) for name, values in found.items()}


def crack(task: Task, instrument: str) -> Measured:
    """Find the width at which a crack in a tile at 4 m reaches the criterion."""
    widths = np.geomspace(0.08e-3, 0.8e-3, task.choose(7, 4))
    runs = task.choose(6, 3)
    view = View(FAR, _STEP, _STEP, task.choose(_ROWS, 40), 161)
    seen = np.empty((runs, len(widths)))
    profile: Mapping[str, Array] = {}
    for run in range(runs):
        for number, width in enumerate(widths.tolist()):
            layers = view.layers(task, _cracked(width), instrument, run * len(widths) + number)
            seen[run, number] = max(_visibility(layers[name]) for name in ("Y", "range_m"))
            profile = layers
    found = np.array([_narrowest(widths, one) for one in seen])
    finding = Finding(1e3 * float(found.mean()), 1e3 * float(found.std(ddof=1) / np.sqrt(runs)))

    def draw(axes: Sequence[Axes]) -> None:
        axes[0].plot(1e3 * widths, seen.T, "o", color=BLUE, ms=3)
        axes[0].axhline(_ROSE, color="black", lw=0.8)
        axes[0].axvline(0.5, color=RED, lw=0.8)
        axes[0].set(xlabel="width of the crack [mm]", ylabel="signal over noise")
        logarithms(axes[0])
        shown = axes[1].imshow(profile["Y"], cmap="gray", aspect="auto")
        axes[1].set(xlabel="column", ylabel="row")
        axes[1].figure.colorbar(shown, ax=axes[1], label="signal [electron]")

    about = (
        f"a groove {1e3 * _DEEP:g} mm deep in a tile at {FAR:g} m, {view.rows} rows averaged, {runs} runs; black: the "
        f"criterion; red: as published; right: the widest, {1e3 * widths[-1]:.2g} mm"
    )
    return Measured(finding, draw=lambda path: sheet(path, "The narrowest crack", about, draw, 2))


def _cracked(width: float) -> list[dict[str, object]]:
    """Return a tile of two halves with a gap, and what closes the gap below."""
    half, tile = 0.2, {"reflectance": _TILE}
    box = {"shape": "box", "size": (2.0 * half, 2.0 * half, _DEEP), "material": tile}
    away, middle = half + 0.5 * width, FAR + 0.5 * _DEEP
    floor = {"shape": "rectangle", "size": (half, 2.0 * half), "material": tile}
    return [
        {"name": "left", "position": (-away, 0.0, middle), **box},
        {"name": "right", "position": (away, 0.0, middle), **box},
        {"name": "floor", "position": (0.0, 0.0, FAR + _DEEP), **floor},
    ]


def _visibility(image: Array) -> float:
    """Return signal over noise of a dark or bright column in the middle: means over rows and three columns.

    The noise is that of the same means where there is no crack, what neighbours have in common included.
    """
    mean = np.nanmean(image, axis=0)
    place = np.arange(mean.size) - mean.size // 2
    away = np.abs(place) > _AWAY
    mean = mean - np.polyval(np.polyfit(place[away], mean[away], 2), place)
    boxes = np.convolve(mean, np.full(_BOX, 1.0 / _BOX), mode="valid")
    centre = place[_BOX // 2 : -(_BOX // 2)]
    noise = float(boxes[np.abs(centre) > _AWAY + _BOX].std())
    return float(np.abs(boxes[np.abs(centre) <= _BOX // 2 + 1]).max()) / noise


def _narrowest(widths: Array, seen: Array) -> float:
    """Return the width at which the signal over noise reaches the criterion [m], by interpolation in logarithms."""
    if seen.max() < _ROSE:
        return float("inf")
    enough = int(np.argmax(seen >= _ROSE))
    if enough == 0:
        return float(widths[0])
    pair = slice(enough - 1, enough + 1)
    return float(np.exp(np.interp(np.log(_ROSE), np.log(seen[pair]), np.log(widths[pair]))))


def dent(task: Task, instrument: str) -> Measured:
    """Fit a spherical dent in a tile at 4 m, run after run."""
    runs = task.choose(10, 4)
    pitch = task.choose(1.5e-3, 3e-3)
    side = round(0.12 / pitch)
    view = View(FAR, pitch, pitch, side, side)
    depth, shown = np.empty(runs), np.empty((side, side))
    with tempfile.TemporaryDirectory() as folder:
        mesh = Path(folder, "dent.ply")
        mesh.write_text(_dented(), encoding="ascii")
        tile = {
            "name": "tile",
            "mesh": mesh,
            "position": (0.0, 0.0, FAR),
            "material": {"reflectance": _TILE},
        }
        for run in range(runs):
            layers = view.layers(task, [tile], instrument, run)
            x, y, z = (layers[f"P.{axis}"] for axis in "XYZ")
            depth[run] = _fitted_depth(x.ravel(), y.ravel(), z.ravel())
            shown = z
    error = depth - _DEPTH
    size = float(np.sqrt(np.mean(error**2)))
    standard = float(depth.std(ddof=1) / np.sqrt(runs))

    def draw(axes: Sequence[Axes]) -> None:
        picture = axes[0].imshow(1e3 * (shown - FAR), cmap="viridis", vmin=-1.0, vmax=1e3 * _DEPTH)
        axes[0].figure.colorbar(picture, ax=axes[0], label="z − 4 m [mm]")
        axes[1].plot(np.arange(runs) + 1, 1e3 * depth, "o", color=COLOURS[0], ms=4)
        axes[1].axhline(1e3 * _DEPTH, color="black", lw=0.8)
        axes[1].set(xlabel="run", ylabel="fitted depth [mm]")

    about = (
        f"a dent of {1e3 * _DENT:g} mm, {1e3 * _DEPTH:g} mm deep, in a tile at {FAR:g} m; voxels {1e3 * pitch:g} mm "
        "apart"
    )
    return Measured(
        Finding(1e3 * size, 1e3 * size / np.sqrt(2.0 * runs)),
        rows=(
            row_of_claim(
                f"mean of the fitted depth less the true one, {runs} runs",
                "",
                "0",
                f"{1e3 * error.mean():+.3f} ± {3e3 * standard:.3f} mm",
                abs(float(error.mean())) < 4.0 * standard + 1e-5,
            ),
        ),
        draw=lambda path: sheet(path, "The depth of a dent", about, draw, 2),
    )


def _sag(r: Array, depth: float, radius: float) -> Array:
    """Return the depth of a spherical dent at a distance from its axis [m], both lengths of its rim given."""
    sphere = (radius**2 + depth**2) / (2.0 * depth)
    inside = np.sqrt(np.maximum(sphere**2 - np.minimum(r, radius) ** 2, 0.0)) - (sphere - depth)
    return np.asarray(np.where(r < radius, inside, 0.0))


def _dented(points: int = 241) -> str:
    """Return a square tile with a dent in its middle as PLY, away from the scanner."""
    edge = np.linspace(-0.1, 0.1, points)
    x, y = np.meshgrid(edge, edge)
    z = _sag(np.hypot(x, y), _DEPTH, 0.5 * _DENT)
    corner = (np.arange(points - 1)[:, None] * points + np.arange(points - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + points], axis=1),
            np.stack([corner + 1, corner + points + 1, corner + points], axis=1),
        ]
    )
    rows = [f"{a:.7f} {b:.7f} {c:.7f}" for a, b, c in zip(x.ravel(), y.ravel(), z.ravel(), strict=True)]
    rows += [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {points**2}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    return head + "\n".join(rows) + "\n"


def _fitted_depth(x: Array, y: Array, z: Array) -> float:
    """Return the depth of the spherical dent in a plane that fits points best; plane, centre and rim are free too."""
    seen = np.isfinite(z)
    x, y, z = x[seen], y[seen], z[seen] - np.nanmedian(z)

    def residual(p: Array) -> Array:
        plane = p[0] + p[1] * x + p[2] * y
        return np.asarray(z - plane - _sag(np.hypot(x - p[3], y - p[4]), p[5], p[6]))

    start = [0.0, 0.0, 0.0, 0.0, 0.0, 3e-3, 35e-3]
    low = [-1.0, -1.0, -1.0, -0.02, -0.02, 1e-5, 0.02]
    high = [1.0, 1.0, 1.0, 0.02, 0.02, 0.02, 0.055]
    return float(
        least_squares(
            residual, start, bounds=(low, high), x_scale=[1e-3, 0.01, 0.01, 1e-3, 1e-3, 1e-3, 1e-2]
        ).x[5]
    )
