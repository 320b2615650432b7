"""Experiments on triangulation: its error, where it meets time of flight, speckle, and the tilt of a surface."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from scanner_sim.analytic.speckle import centroid_limit, published_range_limit
from scanner_sim.analytic.wave_optics import Lens, centroid, images
from scanner_sim.config import load_scanner
from scanner_sim.validation.reproduce.bench import (
    FIT,
    QUIET,
    SILENT,
    STILL,
    Array,
    aim,
    bench,
    grid,
    layers_of,
    plate,
    slope,
)
from scanner_sim.validation.reproduce.drawing import BLUE, GREEN, OCHRE, RED, logarithms, ranges, sheet
from scanner_sim.validation.reproduce.family.judging import Finding, Measured
from scanner_sim.validation.reproduce.item import Task, row_of_claim

_HALF = 0.05
"""Half the field over which the shots of a plate are spread [rad]."""
_APART = 0.1
"""Time between two shots [s]: twice that in which the mirrors' wobble changes."""


def scatter(layers: Mapping[str, Array], way: str = "") -> float:
    """Return the root mean square error of the ranges by one way [m]."""
    return float(np.sqrt(np.nanmean((layers[f"{way}range_m"] - layers["truth.range_m"]) ** 2)))


def _over_range(task: Task, instrument: str, distances: Array, side: int) -> Array:
    """Return the error of the range before plates at some distances [m], ``side``² voxels each."""
    shots = aim(*grid(_HALF, side), _APART)
    benches = (
        bench(task, [plate(R, _HALF)], {"preset": instrument}, step=step)
        for step, R in enumerate(distances.tolist())
    )
    return np.array([scatter(layers_of(one, shots)) for one in benches])


def at_ten(task: Task, instrument: str) -> Measured:
    """Measure the range error before plates up to 10 m."""
    distances, side = np.linspace(2.0, 10.0, task.choose(5, 3)), task.choose(32, 16)
    sigma = _over_range(task, instrument, distances, side)

    def draw(axes: Sequence[Axes]) -> None:
        axes[0].axhspan(0.0, 5.0, color=RED, alpha=0.12, lw=0, label="as published")
        axes[0].plot(distances, 1e3 * sigma, "o-", ms=4, lw=0.9, color=BLUE, label="simulated, rms")
        axes[0].set(xlabel="range [m]", ylabel="error of the range [mm]")
        axes[0].legend()

    about = f"facing plates of reflectance 0.5, {side**2} voxels each, every source of error, mirrors at rest"
    return Measured(
        Finding(1e3 * float(sigma[-1]), 1e3 * float(sigma[-1]) / math.sqrt(2.0 * side**2)),
        draw=lambda path: sheet(path, "Range error up to 10 m", about, draw),
    )


def close_depth(task: Task, instrument: str) -> Measured:
    """Measure the scatter of close ranges; its least is judged [µm]."""
    distances, side = np.linspace(0.35, 0.95, task.choose(7, 4)), task.choose(32, 16)
    sigma = _over_range(task, instrument, distances, side)
    best = float(sigma.min())

    def draw(axes: Sequence[Axes]) -> None:
        axes[0].axhline(10.0, color=RED, lw=0.9, label="as published")
        axes[0].plot(distances, 1e6 * sigma, "o-", ms=4, lw=0.9, color=BLUE, label="simulated, rms")
        axes[0].set(xlabel="range [m]", ylabel="error of the range [µm]", ylim=(0.0, None))
        axes[0].legend()

    about = f"facing plates of reflectance 0.5, {side**2} voxels each, every source of error, mirrors at rest"
    return Measured(
        Finding(1e6 * best, 1e6 * best / math.sqrt(2.0 * side**2)),
        draw=lambda path: sheet(path, "Range error of a close-range scanner", about, draw),
    )


def meeting(task: Task, instrument: str, other: str) -> Measured:
    """Find the range at which triangulation errs as much as the time of flight of another instrument."""
    distances, side = np.geomspace(2.0, 20.0, task.choose(9, 6)), task.choose(32, 16)
    sigma = np.empty((2, len(distances)))
    for step, R in enumerate(distances.tolist()):
        shots, target = aim(*grid(_HALF, side), _APART), [plate(R, _HALF)]
        for row, (name, ranging) in enumerate(((instrument, "triangulation"), (other, "tof"))):
            made = bench(task, target, {"preset": name}, ranging=ranging, step=step)
            sigma[row, step] = scatter(layers_of(made, shots))
    crossing, error = crossing_of(distances, sigma[0] / sigma[1], 1.0 / side)

    def draw(axes: Sequence[Axes]) -> None:
        axes[0].axvspan(2.5, 7.5, color=RED, alpha=0.12, lw=0, label="equal, as published")
        for values, colour, label in zip(
            sigma, (BLUE, OCHRE), (f"triangulation, {instrument}", f"time of flight, {other}"), strict=True
        ):
            axes[0].errorbar(
                distances,
                1e3 * values,
                3e3 * values / math.sqrt(2.0 * side**2),
                fmt="o-",
                ms=4,
                lw=0.9,
                color=colour,
                label=label,
            )
        axes[0].set_ylabel("σ of the range [mm]")
        logarithms(axes[0], "y")
        ranges(axes[0])
        axes[0].legend()

    about = f"facing plates of reflectance 0.5, {side**2} voxels each, every source of error, mirrors at rest"
    ratio = np.interp([2.5, 5.0, 7.5, 10.0], distances, sigma[0] / sigma[1])
    return Measured(
        Finding(crossing, error),
        rows=(
            row_of_claim(
                "σ of triangulation over that of time of flight at 2.5, 5, 7.5 and 10 m",
                "as good up to 5 m, worse from 5 to 10 m",
                "",
                ", ".join(f"{value:.2f}" for value in ratio),
                bool((ratio[:2] < 1.2).all() and (ratio[2:] > 1.0).all()),
            ),
        ),
        draw=lambda path: sheet(path, "Triangulation against time of flight", about, draw),
    )


def crossing_of(distances: Array, ratio: Array, share: float) -> tuple[float, float]:
    """Return where a rising ratio is one and its standard error [m]; infinite where it stays below.

    Parameters
    ----------
    distances
        Ascending, [m].
    ratio
        Of the errors there.
    share
        Standard error of a ratio over it.
    """
    x, y = np.log(distances), np.log(ratio)
    above = np.flatnonzero(y > 0.0)
    if not above.size:
        return math.inf, 0.0
    after = max(int(above[0]), 1)
    # The curves are smooth: a straight line through four neighbours tells the crossing better than through two.
    near = slice(max(after - 2, 0), after + 2)
    line, covariance = np.polyfit(x[near], y[near], 1), share**2
    steep = float(line[0])
    middle = -float(line[1]) / steep
    spread = x[near] - x[near].mean()
    variance = covariance * (1.0 / spread.size + (middle - x[near].mean()) ** 2 / float(spread @ spread))
    crossing = math.exp(middle)
    return crossing, crossing * math.sqrt(variance) / steep


def _speckled(task: Task, instrument: str) -> tuple[Array, Array, Array]:
    """Return apertures [m], σ of the range for speckle alone [m], and the published limit [m]."""
    distance, side = 5.0, task.choose(40, 16)
    apertures = np.geomspace(12.5e-3, 50e-3, task.choose(5, 3))
    scanner = load_scanner(instrument)
    target = plate(distance, _HALF, 0.5)
    target["material"] = {"reflectance": 0.5, "depolarisation": 0.0}
    sigma = np.empty(len(apertures))
    for step, aperture in enumerate(apertures.tolist()):
        only = {
            **QUIET,
            "preset": instrument,
            "laser": {"speckle": True},
            "receiver": {"aperture": aperture, "aberration": 0.0},
            "position_sensor": {"noise": dict(SILENT), "diffusion": 40e-6},
        }
        processing = {**FIT, "speckle_contrast": 1.0}
        made = bench(task, [target], only, processing=processing, step=step)
        layers = layers_of(made, aim(*grid(_HALF, side)))
        sigma[step] = scatter(layers)
    limit = np.array(
        [
            published_range_limit(
                1.0, scanner.laser.wavelength, distance, aperture, scanner.receiver.baseline
            )
            for aperture in apertures.tolist()
        ]
    )
    return apertures, sigma, limit


def speckle_limit(task: Task, instrument: str) -> Measured:
    """Hold ranges that speckle alone disturbs against the published limit, over apertures."""
    apertures, sigma, limit = _speckled(task, instrument)
    share = 1.0 / math.sqrt(2.0 * task.choose(40, 16) ** 2)
    ratio = sigma / limit
    lens, count = Lens(1.5e-6, 4.0), task.choose(300, 60)
    waves = np.array([centroid(image)[0] for image in images(lens, (30e-6, 30e-6), count, task.seed)])
    by_waves = float(waves.std(ddof=1)) * math.pi / lens.cell
    exponent = slope(apertures, sigma)
    spread = np.log(apertures) - np.log(apertures).mean()
    slack = 3.0 * share / float(np.sqrt(spread @ spread))

    def draw(axes: Sequence[Axes]) -> None:
        axes[0].plot(1e3 * apertures, 1e3 * limit, color=RED, lw=1.2, label="C λ/(2π sin u sin θ)")
        axes[0].plot(1e3 * apertures, 1e3 * limit / math.sqrt(2.0), color=GREEN, lw=1.2, label="over √2")
        axes[0].errorbar(
            1e3 * apertures,
            1e3 * sigma,
            3e3 * share * sigma,
            fmt="o",
            ms=4,
            lw=0.9,
            color=BLUE,
            label="simulated",
        )
        axes[0].set(xlabel="aperture [mm]", ylabel="σ of the range [mm]")
        logarithms(axes[0])
        axes[0].legend()

    about = "speckle of contrast 1 alone, a plate at 5 m, no aberration; three standard errors"
    return Measured(
        Finding(float(ratio.mean()), float(ratio.mean()) * share / math.sqrt(len(ratio))),
        expected=(
            f"{centroid_limit(1.0, 1.0, 1.0) * math.pi:.3f} for a Gaussian spot and a round lens; {by_waves:.2f} ± "
            f"{3.0 * by_waves / math.sqrt(2.0 * count):.2f} by random waves"
        ),
        rows=(
            row_of_claim(
                "exponent of σ in the aperture",
                "−1",
                "−1",
                f"{exponent:.3f} ± {slack:.3f}",
                abs(exponent + 1.0) < slack + 0.02,
            ),
        ),
        draw=lambda path: sheet(path, "Speckle against the published limit", about, draw),
    )


def speckle_share(task: Task, instrument: str) -> Measured:
    """Tell which share of the variance of ranges speckle has; the least between 2 and 10 m is judged."""
    distances, side = np.linspace(2.0, 10.0, task.choose(5, 3)), task.choose(40, 20)
    left = np.empty(len(distances))
    for number, distance in enumerate(distances.tolist()):
        sigma = []
        for speckle in (True, False):
            scanner = {"preset": instrument, "laser": {"speckle": speckle}}
            made = bench(task, [plate(distance, _HALF)], scanner, step=2 * number + speckle)
            sigma.append(scatter(layers_of(made, aim(*grid(_HALF, side), _APART))))
        left[number] = (sigma[1] / sigma[0]) ** 2
    worst = int(left.argmax())
    error = 2.0 * left / side

    def draw(axes: Sequence[Axes]) -> None:
        axes[0].errorbar(distances, 1.0 - left, 3.0 * error, fmt="o-", ms=4, lw=0.9, color=BLUE)
        axes[0].axhline(0.5, color="black", lw=0.8)
        axes[0].set(xlabel="range [m]", ylabel="share of speckle in the variance", ylim=(0.0, 1.02))

    about = f"facing plates of reflectance 0.5, {side**2} voxels each, with speckle and without; three standard errors"
    return Measured(
        Finding(float(1.0 - left[worst]), float(error[worst])),
        draw=lambda path: sheet(path, "Speckle among the errors of the range", about, draw),
    )


def tilt(task: Task, instrument: str) -> Measured:
    """Measure how far a surface seems from its place when it is tilted by 30°, over the measuring range."""
    scanner = load_scanner(instrument)
    near, far = scanner.nearest_range, min(scanner.farthest_range, 10.0)
    distance = 0.5 * (near + far)
    degrees = np.array([-30.0, -15.0, -5.0, 0.0, 5.0, 15.0, 30.0])
    moved = {axis: np.empty(len(degrees)) for axis in "xy"}
    for axis, values in moved.items():
        for number, angle in enumerate(degrees.tolist()):
            target = plate(distance, 0.2, 0.5)
            target["rotation"] = [{"axis": axis, "angle": math.radians(angle)}]
            made = bench(
                task, [target], {**QUIET, "mirrors": dict(STILL), "preset": instrument}, processing=FIT
            )
            layers = layers_of(made, aim([0.0], [0.0]))
            values[number] = float((layers["range_m"] - layers["truth.range_m"])[0])
        values -= values[degrees == 0.0]
    largest = 100.0 * max(float(np.abs(values).max()) for values in moved.values()) / (far - near)

    def draw(axes: Sequence[Axes]) -> None:
        for (axis, values), colour in zip(moved.items(), (BLUE, OCHRE), strict=True):
            axes[0].plot(degrees, 1e6 * values, "o-", ms=4, lw=0.9, color=colour, label=f"about {axis}")
        axes[0].set(xlabel="tilt [°]", ylabel="apparent distance change [µm]")
        axes[0].legend()

    about = f"a Lambertian plate at {distance:.3g} m, no noise; the measuring range is {far - near:.3g} m"
    return Measured(Finding(largest, 0.0), draw=lambda path: sheet(path, "A tilted surface", about, draw))
