"""Experiments on edges: how finely a beam resolves across itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from scipy.optimize import curve_fit
from scipy.special import erf

from scanner_sim.analytic.beam import beam_radius
from scanner_sim.config import load_scanner
from scanner_sim.validation.reproduce.bench import Array
from scanner_sim.validation.reproduce.drawing import BLUE, GREEN, RED, sheet
from scanner_sim.validation.reproduce.family.judging import Finding, Measured
from scanner_sim.validation.reproduce.family.tiles import FAR, View
from scanner_sim.validation.reproduce.item import Task, row_of_claim

_WIDTH = 2.0 * np.sqrt(2.0 * np.log(2.0))
"""Full width at half maximum of a Gaussian over its standard deviation."""


def _edge_widths(task: Task, instrument: str, distance: float, ideal: float, step: int) -> Array:
    """Return the width of the line spread of each block of rows [m]; ``ideal`` is about what it is."""
    rows = 16 * task.choose(24, 3)
    # Rows farther apart than a spot have speckle of their own.
    view = View(distance, ideal / 18.0, min(2.0 * ideal, 0.25 * distance / rows), rows, 101)
    half = 0.5 * view.rows * view.apart + 10.0 * ideal
    objects = [
        {
            "name": name,
            "shape": "rectangle",
            "size": (2.0 * half, 2.0 * half),
            "position": (side * half, 0.0, distance),
            "material": {"reflectance": reflectance},
        }
        for name, side, reflectance in (("dark", -1.0, 0.05), ("bright", 1.0, 0.8))
    ]
    image = view.layers(task, objects, instrument, step)["Y"]
    place = (np.arange(view.columns) - view.columns // 2) * view.pitch / ideal
    found = []
    for block in image.reshape(-1, 16, view.columns).mean(axis=1):
        start = (float(block[:10].mean()), float(block[-10:].mean()), 0.0, 1.0 / _WIDTH)
        (*_, sigma), _ = curve_fit(_edge, place, block, start)
        found.append(_WIDTH * abs(float(sigma)) * ideal)
    return np.array(found)


def _edge(place: Array, low: float, high: float, middle: float, sigma: float) -> Array:
    """Return the response to an edge of a Gaussian line spread."""
    return np.asarray(low + 0.5 * (high - low) * (1.0 + erf((place - middle) / (np.sqrt(2.0) * sigma))))


def _widths(task: Task, instrument: str, distances: Array) -> tuple[Array, Array, Array]:
    """Return width, standard error, and the width of the ideal beam at distances [m]."""
    laser = load_scanner(instrument).laser
    radius = [
        float(beam_radius(R, laser.waist_radius, laser.waist_distance, laser.wavelength, 1.0))
        for R in distances.tolist()
    ]
    ideal = 0.5 * _WIDTH * np.array(radius)
    found, error = np.empty(len(distances)), np.empty(len(distances))
    for number, (distance, width) in enumerate(zip(distances.tolist(), ideal.tolist(), strict=True)):
        widths = _edge_widths(task, instrument, distance, width, number)
        found[number] = widths.mean()
        error[number] = widths.std(ddof=1) / np.sqrt(len(widths))
    return found, error, ideal


def _draw_widths(
    axes: Axes,
    distances: Array,
    found: Array,
    error: Array,
    ideal: Array,
    printed: tuple[float, float] | None,
) -> None:
    if printed is not None:
        axes.axhspan(*printed, color=RED, alpha=0.15, lw=0, label="as published")
    axes.plot(distances, 1e3 * ideal, color=GREEN, lw=1.2, label="Gaussian beam, M² = 1")
    axes.errorbar(distances, 1e3 * found, 3e3 * error, fmt="o", ms=4, lw=0.9, color=BLUE, label="simulated")
    axes.set(xlabel="range [m]", ylabel="full width of the line spread [mm]", ylim=(0.0, None))
    axes.legend()


def _resolved(
    task: Task, instrument: str, distances: Array, printed: tuple[float, float] | None
) -> tuple[Array, Array, Array, Measured]:
    """Return what :func:`_widths` does, and the least width with its picture; ``printed`` is a band [mm]."""
    found, error, ideal = _widths(task, instrument, distances)
    best = int(ideal.argmin())  # the least of those that were found is the one that errs most
    about = "an edge from reflectance 0.05 to 0.8, mirrors at rest; three standard errors"

    def draw(axes: Sequence[Axes]) -> None:
        _draw_widths(axes[0], distances, found, error, ideal, printed)

    over = row_of_claim(
        f"the same from {distances[0]:.3g} to {distances[-1]:.3g} m",
        "",
        f"{1e3 * ideal.min():.3g} to {1e3 * ideal.max():.3g} mm",
        f"{1e3 * found.min():.3g} to {1e3 * found.max():.3g} mm",
        bool((np.abs(found - ideal) < 4.0 * error + 0.02 * ideal).all()),
    )
    return (
        found,
        error,
        ideal,
        Measured(
            Finding(1e3 * float(found[best]), 1e3 * float(error[best])),
            expected=f"{1e3 * ideal.min():.3g} mm for the instrument's beam",
            rows=(over,),
            draw=lambda path: sheet(path, "Response to an edge", about, draw),
        ),
    )


def lateral(task: Task, instrument: str) -> Measured:
    """Measure the line spread of edges over the inspection's ranges; its least is judged."""
    return _resolved(task, instrument, np.linspace(1.6, FAR, task.choose(7, 4)), (0.35, 0.5))[-1]


def close_lateral(task: Task, instrument: str) -> Measured:
    """Measure the same before a close-range instrument, its focus among the ranges; the least is judged [µm]."""
    focus = load_scanner(instrument).laser.waist_distance
    distances = np.sort(np.append(np.linspace(0.35, 0.95, task.choose(6, 3)), focus))
    made = _resolved(task, instrument, distances, (0.055, 0.065))[-1]
    return replace(made, finding=Finding(1e3 * made.finding.value, 1e3 * made.finding.error), rows=())


def diffraction(task: Task, instrument: str) -> Measured:
    """Hold the line spread of edges against that of a beam which only diffraction widens."""
    found, error, ideal, made = _resolved(task, instrument, np.geomspace(2.0, 10.0, task.choose(6, 3)), None)
    standard = float(np.sqrt(np.sum((error / ideal) ** 2))) / len(ideal)
    ratio = Finding(float(np.mean(found / ideal)), standard)
    return replace(made, finding=ratio, expected="1: a Gaussian beam of M² = 1")
