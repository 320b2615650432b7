"""Equations 1 to 5: ranges, points, and how their errors grow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from scanner_sim.analytic import geometry
from scanner_sim.validation.compare.instrument import closed_budget
from scanner_sim.validation.reproduce.bench import (
    BASE,
    DWELL,
    FIT,
    FOCAL,
    PITCH,
    QUIET,
    SEPARATION,
    STILL,
    aim,
    bench,
    grid,
    layers_of,
    plate,
    slope,
)
from scanner_sim.validation.reproduce.drawing import BLUE, COLOURS, GREEN, OCHRE, RED, ranges, sheet
from scanner_sim.validation.reproduce.item import Item, Outcome, Task, chosen, row_of_claim, within

_HALF = 0.45
"""Deflection to each side over which the field is tried [rad]."""


def eq1(task: Task) -> Outcome:
    """Hold rendered spots against eq 1."""
    distances = np.geomspace(1.8, 40.0, task.choose(14, 6))
    theta = np.linspace(-_HALF, _HALF, 9)
    position, true = np.empty((len(distances), len(theta))), np.empty((len(distances), len(theta)))
    measured = np.empty_like(position)
    for row, distance in enumerate(distances.tolist()):
        layers = layers_of(bench(task, [plate(distance, _HALF)], QUIET, processing=FIT), aim(theta, 0.2))
        position[row], true[row] = (layers["peak_px"] + 0.5) * PITCH, layers["truth.range_m"]
        measured[row] = layers["range_m"]
    expected = geometry.image_position(true, theta, FOCAL, BASE)
    seen = np.isfinite(position)
    off = (position - expected)[seen] / PITCH
    error = (measured - true)[seen] / true[seen] ** 2
    rows = (
        row_of_claim(
            "spot on the line, rendered less eq 1 (rms)",
            "eq 1",
            "0",
            f"{np.sqrt(np.mean(off**2)):.4f} pixel",
            np.sqrt(np.mean(off**2)) < 0.01,
        ),
        row_of_claim(
            "range error without noise at 10 m (rms)",
            "",
            "0",
            f"{1e5 * np.sqrt(np.mean(error**2)):.2f} mm",
            np.sqrt(np.mean(error**2)) < 5e-6,
        ),
        chosen(
            "nearest range, p = 12.8 mm at Θ = 0",
            "",
            f"{FOCAL * BASE / 12.8e-3:.2f} m",
            f"{bench(task, []).scenario.scanner.nearest_range:.2f} m",
            within(bench(task, []).scenario.scanner.nearest_range, FOCAL * BASE / 12.8e-3, 1e-9),
        ),
    )

    def draw(axes: Sequence[Axes]) -> None:
        fine = np.geomspace(1.6, 45.0, 200)
        for colour, column in zip(COLOURS, (0, 4, 8), strict=False):
            label = f"Θ = {theta[column]:+.2f} rad"
            line = geometry.image_position(fine, theta[column], FOCAL, BASE)
            axes[0].plot(fine, 1e3 * line, color=colour, lw=1.2, label=label)
            axes[0].plot(true[:, column], 1e3 * position[:, column], "o", color=colour, ms=3.5)
        axes[0].set(yscale="log", ylabel="p [mm]")
        ranges(axes[0])
        axes[0].legend()
        axes[1].plot(true[seen], 1e3 * off, "o", color=BLUE, ms=3)
        axes[1].set_ylabel("rendered − eq 1 [1/1000 pixel]")
        ranges(axes[1])

    about = "lines: eq 1; dots: spots rendered onto pixels, maximum-likelihood fit, no noise"
    return Outcome(rows, lambda path: sheet(path, "Range from the spot's place (eq 1)", about, draw, 2))


def eq2(task: Task) -> Outcome:
    """Hold measured delays against eq 2."""
    distances = np.geomspace(2.0, 100.0, task.choose(10, 5))
    count = task.choose(40, 10)
    unit = {"digitiser": {"gate": (0.5, 130.0)}}
    mean, spread, delay = (np.empty(len(distances)) for _ in range(3))
    for row, distance in enumerate(distances.tolist()):
        made = bench(
            task, [plate(distance, 0.02)], {"mirrors": dict(STILL), "lidar": unit}, ranging="tof", step=row
        )
        layers = layers_of(made, aim(*grid(0.02, count)))
        error = layers["range_m"] - layers["truth.range_m"]
        mean[row], spread[row] = np.nanmean(error), np.nanstd(error)
        delay[row] = 2e9 * np.nanmean(layers["range_m"]) / 299792458.0
    closed = np.array([closed_budget(made.scenario, 0.5, R)["tof"]["all"] for R in distances.tolist()])
    ratio, scatter = spread / closed, 1.0 / np.sqrt(2.0 * count**2)
    off = np.abs(ratio - 1.0)
    standard = spread / count
    worst = float(np.abs(mean / standard).max())
    rows = (
        row_of_claim(
            "mean range less truth, worst of all distances",
            "R = c τ/2",
            "0",
            f"{1e3 * mean[np.abs(mean / standard).argmax()]:+.2f} mm, {worst:.1f} standard errors",
            worst < 4.0,
        ),
        chosen(
            "σ of one pulse, 2 m to 100 m",
            "nearly flat over range",
            f"{1e3 * closed.min():.1f} to {1e3 * closed.max():.1f} mm",
            f"{1e3 * spread.min():.1f} to {1e3 * spread.max():.1f} mm",
            bool(spread[distances < 30.0].max() < 2.0 * spread.min()),
        ),
        row_of_claim(
            "the same over its closed form, worst of all distances",
            "",
            "1",
            f"{ratio[off.argmax()]:.3f}, {off.max() / scatter:.1f} standard errors",
            off.max() < 4.0 * scatter,
        ),
    )

    def draw(axes: Sequence[Axes]) -> None:
        axes[0].plot(distances, delay, "o", color=BLUE, ms=4)
        fine = np.geomspace(2.0, 100.0, 50)
        axes[0].plot(fine, 2e9 * fine / 299792458.0, color=BLUE, lw=1)
        axes[0].set(yscale="log", ylabel="delay [ns]")
        axes[1].errorbar(distances, 1e3 * mean, 2e3 * standard, fmt="o", ms=3.5, lw=0.9, color=RED)
        axes[1].axhline(0.0, color="black", lw=0.7)
        axes[1].set_ylabel("mean − truth [mm], two standard errors")
        for one in axes:
            ranges(one)

    about = f"line: eq 2; dots: {count**2} waveforms each, facing plate of reflectance 0.5, matched filter"
    return Outcome(rows, lambda path: sheet(path, "Range from a pulse's delay (eq 2)", about, draw, 2))


def eq3(task: Task) -> Outcome:
    """Hold measured points against eq 3 and the plane that they lie on."""
    distance = 8.0
    theta, phi = grid(_HALF, task.choose(41, 21))
    layers = layers_of(bench(task, [plate(distance, _HALF)], QUIET, processing=FIT), aim(theta, phi))
    points = np.stack([layers[f"P.{axis}"] for axis in "XYZ"], axis=-1)
    judge = geometry.point_from_shot(layers["range_m"], theta, phi, SEPARATION)
    without = geometry.point_from_shot(layers["range_m"], theta, phi, 0.0)
    flat = 1e3 * (points[:, 2] - distance)
    rounding = 1e6 * float(np.nanmax(np.abs(points - judge)))
    left = np.linalg.norm(points - without, axis=1)
    rows = (
        row_of_claim("points against eq 3, largest", "eq 3", "0", f"{rounding:.3f} µm", rounding < 2.0),
        row_of_claim(
            "flatness of the measured plane at 8 m (rms)",
            "",
            "0",
            f"{np.sqrt(np.nanmean(flat**2)):.3f} mm",
            np.sqrt(np.nanmean(flat**2)) < 0.2,
        ),
        row_of_claim(
            "points if D_g is left out, largest shift",
            "D_g ≪ R",
            f"{1e3 * 2.0 * SEPARATION * np.sin(_HALF / 2.0):.1f} mm at any range",
            f"{1e3 * float(np.nanmax(left)):.1f} mm",
            within(float(np.nanmax(left)), 2.0 * SEPARATION * float(np.sin(_HALF / 2.0)), 0.02),
        ),
    )

    def draw(axes: Sequence[Axes]) -> None:
        dots = axes[0].scatter(
            points[:, 0], points[:, 1], c=flat, s=6, cmap="coolwarm", vmin=-0.05, vmax=0.05
        )
        axes[0].set(xlabel="x [m]", ylabel="y [m], down", aspect="equal")
        axes[0].invert_yaxis()
        axes[0].figure.colorbar(dots, ax=axes[0], label="z − 8 m [mm]")
        shown = np.abs(theta) < 1e-9
        axes[1].plot(phi[shown], 1e3 * left[shown], "o", color=BLUE, ms=3.5)
        line = 2e3 * SEPARATION * np.sin(np.abs(phi[shown]) / 2.0)
        axes[1].plot(phi[shown], line, color=BLUE, lw=1)
        axes[1].set(xlabel="φ [rad]", ylabel="shift without D_g [mm]")

    about = "a plate at 8 m over ±0.45 rad, no noise"
    return Outcome(rows, lambda path: sheet(path, "Coordinates (eq 3)", about, draw, 2))


def eq4(task: Task) -> Outcome:
    """Measure σ_R for a constant error of the spot's position, over range and over the field."""
    error = 10e-6
    scanner: dict[str, object] = {**QUIET, "mirrors": {**STILL, "synchronisation": error}}
    distances, side = np.geomspace(3.0, 35.0, task.choose(12, 6)), task.choose(48, 32)
    sigma = np.empty(len(distances))
    for row, distance in enumerate(distances.tolist()):
        made = bench(task, [plate(distance, 0.05)], scanner, processing=FIT, step=row)
        layers = layers_of(made, aim(*grid(0.05, side)))
        sigma[row] = np.nanstd(layers["range_m"] - layers["truth.range_m"])
    position = FOCAL * error * (1.0 + (geometry.image_position(distances, 0.0, FOCAL, BASE) / FOCAL) ** 2)
    printed = geometry.range_error_printed(distances, FOCAL, BASE, position)
    theta = np.linspace(-_HALF, _HALF, 7)
    ratio = np.empty(len(theta))
    for row, angle in enumerate(theta.tolist()):
        made = bench(task, [plate(8.0, _HALF)], scanner, processing=FIT, step=100 + row)
        layers = layers_of(made, aim(np.full(side**2, angle), 0.0))
        R = float(layers["truth.range_m"][0])
        p = float(geometry.image_position(R, angle, FOCAL, BASE))
        own = FOCAL * error * (1.0 + (p / FOCAL) ** 2)
        found = np.nanstd(layers["range_m"] - layers["truth.range_m"])
        ratio[row] = found / float(geometry.range_error_printed(R, FOCAL, BASE, own))
    along = 8.0 / np.cos(theta)
    exact = geometry.range_error(along, theta, FOCAL, BASE, 1.0)
    exact = exact / geometry.range_error_printed(along, FOCAL, BASE, 1.0)
    exponent, mean = slope(distances, sigma), float(np.mean(sigma / printed))
    tolerance = 4.0 / np.sqrt(2.0 * side**2)
    rows = (
        row_of_claim(
            "exponent of σ_R in R, constant Δp", "2", "2", f"{exponent:.3f}", abs(exponent - 2.0) < 0.05
        ),
        row_of_claim(
            "σ_R over the printed form on the axis", "1", "1", f"{mean:.3f}", abs(mean - 1.0) < tolerance
        ),
        row_of_claim(
            "the same at Θ = ∓0.45 rad",
            "1",
            f"{exact[0]:.3f}, {exact[-1]:.3f}",
            f"{ratio[0]:.3f}, {ratio[-1]:.3f}",
            np.abs(ratio - 1.0).max() < 0.75 * tolerance,
        ),
    )

    def draw(axes: Sequence[Axes]) -> None:
        axes[0].plot(distances, 1e3 * printed, color=BLUE, lw=1.2, label="eq 4")
        axes[0].plot(distances, 1e3 * sigma, "o", color=BLUE, ms=4, label="simulated")
        axes[0].set(yscale="log", ylabel="σ of the range [mm]")
        ranges(axes[0])
        axes[1].plot(theta, exact, color=GREEN, lw=1.2, label="exact")
        axes[1].axhline(1.0, color=BLUE, lw=1.2, label="eq 4 as printed")
        axes[1].errorbar(theta, ratio, 0.5 * tolerance * ratio, fmt="o", ms=4, lw=0.9, color=GREEN)
        axes[1].set(xlabel="Θ [rad]", ylabel="σ of the range over eq 4, at z = 8 m")
        for one in axes:
            one.legend()

    about = f"10 µrad between projection and reception, nothing else; {side**2} voxels for each dot"
    return Outcome(rows, lambda path: sheet(path, "Growth of the range error (eq 4)", about, draw, 2))


def eq5(task: Task) -> Outcome:
    """Measure the errors of x, y and z over the field."""
    angle, apart, distance, phi = 50e-6, 1e-6, 8.0, 0.3
    scanner = {**QUIET, "mirrors": {**STILL, "jitter": angle, "synchronisation": apart}}
    theta, shots = np.array([-0.45, -0.25, 0.0, 0.25, 0.45]), task.choose(16000, 4000)
    found, full, printed = (np.empty((len(theta), 3)) for _ in range(3))
    for row, one in enumerate(theta.tolist()):
        made = bench(task, [plate(distance, 0.5)], scanner, processing=FIT, step=row)
        layers = layers_of(made, aim(np.full(shots, one), phi, DWELL))
        R = float(np.median(layers["truth.range_m"]))
        truth = geometry.point_from_shot(
            layers["truth.range_m"], layers["truth.theta_rad"], layers["truth.phi_rad"], SEPARATION
        )
        measured = np.stack([layers[f"P.{axis}"] for axis in "XYZ"], axis=-1)
        found[row] = np.nanstd(measured - truth, axis=0)
        p = float(geometry.image_position(R, one, FOCAL, BASE))
        position = FOCAL * (1.0 + (p / FOCAL) ** 2) * apart
        full[row] = geometry.propagated_errors(R, one, phi, FOCAL, BASE, SEPARATION, position, angle, angle)[
            :3
        ]
        printed[row] = geometry.propagated_errors_printed(R, one, phi, FOCAL, BASE, position, angle, angle)
    tolerance = 4.5 / np.sqrt(2.0 * shots)
    worst, short = found / full, found / printed
    rows = (
        row_of_claim(
            "σ of x, y, z over the full Jacobian",
            "",
            "1",
            f"{worst.min():.3f} to {worst.max():.3f}",
            np.abs(worst - 1.0).max() < tolerance,
        ),
        row_of_claim(
            "σ of x, y, z over the printed form",
            "1",
            f"{(full / printed).min():.2f} to {(full / printed).max():.2f}",
            f"{short.min():.2f} to {short.max():.2f}",
            np.abs(short - 1.0).max() < tolerance,
        ),
    )

    def draw(axes: Sequence[Axes]) -> None:
        for number, (name, colour) in enumerate(zip("xyz", (BLUE, RED, OCHRE), strict=True)):
            axes[0].plot(theta, 1e3 * full[:, number], color=colour, lw=1.2, label=f"{name}, full Jacobian")
            axes[0].plot(theta, 1e3 * printed[:, number], color=colour, lw=1.0, ls="--")
            axes[0].plot(theta, 1e3 * found[:, number], "o", color=colour, ms=4)
        axes[0].plot([], [], "k--", lw=1.0, label="eq 5 as printed")
        axes[0].set(xlabel="Θ [rad]", ylabel="σ [mm]")
        axes[0].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))

    about = f"plate at 8 m, φ = 0.3 rad, Δp of 1 µrad, ΔΘ = Δφ = 50 µrad; {shots} shots for each dot"
    return Outcome(rows, lambda path: sheet(path, "Errors of a point (eq 5)", about, draw))


ITEMS = (
    Item(
        "eq1",
        "Equation 1: range by triangulation",
        "R = f d cosΘ/p + d sinΘ, with f 100 mm. The base d is not printed.",
        "Plates from 1.8 to 40 m over ±0.45 rad; the spot is rendered onto the pixels and found again, "
        "without noise.",
        "None: eq 1 is exact for the two-mirror optics. Base (0.2 m) and length of the array (12.8 mm) are "
        "assumptions.",
        eq1,
    ),
    Item(
        "eq2",
        "Equation 2: range by time of flight",
        "R = c τ/2.",
        "Waveforms of pulses from facing plates, with all noise, timed by the matched filter.",
        "None on the laser's own axis. Beside it, at the lens, the way back is longer, and the simulator takes its "
        "exact form. The unit's pulse, diode and clock are not printed: they are assumptions, and the clock's jitter "
        "is chosen such that σ is nearly flat.",
        eq2,
    ),
    Item(
        "eq3",
        "Equation 3: coordinates",
        "x, y, z from R, Θ, φ with ψ = D_g/R.",
        "A plate at 8 m over ±0.45 rad on both axes, without noise.",
        "None: with y downwards eq 3 is exact as printed. D_g is not printed (50 mm here); it must not be "
        "left out of coordinates, only out of their errors.",
        eq3,
    ),
    Item(
        "eq4",
        "Equation 4: error of the range",
        "ΔR ≈ R² Δp/(f d).",
        "σ of simulated ranges with one source of error alone, an angle between projection and reception, "
        "which is a constant Δp but for 1 + p²/f².",
        "Exact on the axis. Over the field ΔR = (R − d sinΘ)² Δp/(f d cosΘ): the printed form promises up to "
        "16 % too little at the rim.",
        eq4,
    ),
    Item(
        "eq5",
        "Equation 5: errors of x, y, z",
        "Squares of the errors of R, Θ and φ add, each along its own direction.",
        "Scatter of simulated points about the true ones, simulated pixels.",
        "The printed form takes R for independent of Θ. That is right for time of flight; in triangulation R "
        "follows Θ at fixed p, and the full Jacobian must be used, which the simulator does. Off the axis "
        "the printed form is up to half too small or too large.",
        eq5,
    ),
)
"""Equations 1 to 5."""
