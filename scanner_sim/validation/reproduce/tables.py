"""Tables 1 and 2: conditions of illumination along an orbit, and times of acquisition."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from scanner_sim.analytic.orbit import eclipse_fraction
from scanner_sim.config import load_scenario
from scanner_sim.products.pictures.timeline import draw_timeline
from scanner_sim.scan.lissajous import LissajousPattern
from scanner_sim.scan.raster import RasterScan
from scanner_sim.scan.schedule import Visiting, run_visit
from scanner_sim.scan.ways import mirrors_at
from scanner_sim.validation.reproduce.bench import DWELL, NRC_2000
from scanner_sim.validation.reproduce.drawing import BLUE, OCHRE, RED, sheet
from scanner_sim.validation.reproduce.item import Item, Outcome, Task, chosen, row_of_claim, within
from scanner_sim.validation.studies.conditions import ESTIMATES
from scanner_sim.validation.studies.sweep import sweep_orbit

_PRINTED_TIMES = {128: 0.8, 256: 3.3, 512: 13.1}
_BOUNDS = {"60 %": (0.5, 0.7), "35 %": (0.25, 0.45), "< 5 %": (0.0, 0.05), "< 1 %": (0.0, 0.01)}
"""What is taken for each of the paper's estimates."""


def table_1(task: Task) -> Outcome:
    """Sweep orbits and tell how long targets are in each condition."""
    scenario = load_scenario(task.config("lighting_orbit"))
    timeline = sweep_orbit(scenario, task.choose(90, 12), device=task.device)
    shares = np.array([timeline.shares(track) for track in timeline.tracks])
    names = ", ".join(track.name for track in timeline.tracks)
    rows = []
    for estimate in ESTIMATES:
        found = shares[:, [int(condition) for condition in estimate.conditions]].sum(axis=1)
        low, high = _BOUNDS[estimate.share]
        rows.append(
            row_of_claim(
                f"{estimate.name}: {names}",
                estimate.share,
                "",
                ", ".join(f"{100.0 * share:.0f} %" for share in found),
                bool(((found >= low) & (found <= high)).all()),
            )
        )
    eclipse = 1.0 - float(timeline.sun_visible.mean())
    dark = float(eclipse_fraction(400e3, np.radians(15.0)))
    lit = 1.0 - eclipse
    normal = shares[:, 0] / lit
    low, high = _BOUNDS["60 %"]
    rows += [
        row_of_claim(
            "the Earth hides the Sun, 400 km, β = 15°",
            "",
            f"{100.0 * dark:.1f} %",
            f"{100.0 * eclipse:.1f} %",
            abs(eclipse - dark) < 1.5 / timeline.times.size,
        ),
        row_of_claim(
            "normal, of the time in sunlight",
            "60 %",
            "",
            ", ".join(f"{100.0 * share:.0f} %" for share in normal),
            bool(((normal > low) & (normal < high)).all()),
        ),
    ]
    return Outcome(tuple(rows), lambda path: draw_timeline(timeline, path))


def table_2(task: Task) -> Outcome:
    """Tell how long rasters take, and run the mirrors over targets."""
    rows = []
    for size, printed in _PRINTED_TIMES.items():
        scan = RasterScan(rows=size, columns=size, horizontal=(-0.25, 0.25), vertical=(-0.25, 0.25))
        time = scan.shots * DWELL
        rows.append(
            chosen(f"raster of {size} × {size}", f"{printed} s", f"{size**2} · 50 µs", f"{time:.2f} s",
                   abs(time - printed) < 0.051)
        )  # fmt: skip
    turns = task.choose(8, 3)
    single, _ = _visit_times([(0.0, 0.0)], turns)
    rows.append(chosen("one target, a pattern of 128 voxels", "6.6 ms", "0.2 ms + 128 · 50 µs",
                       f"{1e3 * single:.2f} ms", within(single, 6.6e-3, 0.01)))  # fmt: skip
    spread = {}
    for half in (0.05, 0.25):
        corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
        spread[half], settled = _visit_times(corners, turns)
        rows.append(
            chosen(
                f"each of four targets, {2.0 * half:g} rad apart",
                "10 ms",
                f"{1e3 * Visiting().period(128, DWELL, 4, NRC_2000.galvanometers):.2f} ms",
                f"{1e3 * spread[half]:.2f} ms, off by {1e6 * settled:.0f} µrad at most when measuring begins",
                within(spread[half], 10e-3, 0.02) and settled < 300e-6,
            )
        )

    def draw(axes: Sequence[Axes]) -> None:
        sizes = np.array(list(_PRINTED_TIMES))
        axes[0].plot(sizes, sizes**2 * DWELL, color=BLUE, lw=1.2, label="simulated scan")
        axes[0].plot(sizes, list(_PRINTED_TIMES.values()), "o", color=RED, ms=4.5, label="Table 2")
        axes[0].set(xlabel="rows = columns", ylabel="time of a raster [s]")
        axes[0].legend()
        bars = {"one target": single, "0.1 rad apart": spread[0.05], "0.5 rad apart": spread[0.25]}
        axes[1].bar(list(bars), [1e3 * time for time in bars.values()], color=BLUE, width=0.5)
        axes[1].axhline(6.6, color=RED, lw=0.9, ls="--", label="Table 2, one target")
        axes[1].axhline(10.0, color=OCHRE, lw=0.9, ls="--", label="Table 2, several")
        axes[1].set(ylabel="time of a target [ms]", ylim=(0.0, 13.0))
        axes[1].legend(loc="upper left")

    about = "20 000 voxels a second; the mirrors' motion is simulated, with lag and limits"
    return Outcome(tuple(rows), lambda path: sheet(path, "Times of acquisition (Table 2)", about, draw, 2))


def _visit_times(positions: Sequence[tuple[float, float]], turns: int) -> tuple[float, float]:
    """Return the mean time from pattern to pattern [s], and how far the first voxel is from its command [rad]."""
    servo, visiting, pattern = NRC_2000.galvanometers, Visiting(), LissajousPattern(amplitude=6e-3)
    period = visiting.period(pattern.points, DWELL, len(positions), servo)
    mirrors, begun, late = mirrors_at(*positions[0]), [], 0.0
    for number in range(turns * len(positions)):
        start = (number + 1) * period - pattern.points * DWELL
        position = positions[number % len(positions)]
        motion, mirrors = run_visit(
            servo,
            mirrors,
            pattern,
            number // len(positions),
            position,
            start=start,
            dwell=DWELL,
            visiting=visiting,
        )
        begun.append(float(motion.time[0]))
        # Lag along the figure is no matter of the jump: the middle voxel has the same.
        lag = motion.true_theta - motion.commanded_theta
        late = max(late, float(np.abs(lag[:4]).max() - np.abs(lag[4:]).max()) if number else 0.0)
    return float(np.diff(begun).mean()), late


ITEMS = (
    Item(
        "table1",
        "Table 1: conditions of ambient illumination",
        "60 % normal, 35 % shadow, below 5 % saturation and poor illumination, below 1 % back illumination: "
        "estimated, in orbit.",
        "One orbit of 400 km over three arrays of targets before the Node; Sun, Earth and shadows by ray tracing.",
        "The paper says neither for which orbit and targets nor where a condition ends, and leaves no room "
        "for the night, a third of a low orbit, unless that is its shadow. What follows from the orbit "
        "alone, the eclipse, agrees; the rest belongs to the scene: a target deep in a ring is shaded all "
        "day.",
        table_1,
        also="`scanner-sim orbit configs/lighting_orbit.yaml`",
    ),
    Item(
        "table2",
        "Table 2: times of acquisition",
        "0.8, 3.3 and 13.1 s for rasters of 128², 256² and 512²; 6.6 ms for one target, 10 ms for each of "
        "several; 20 000 voxels a second.",
        "The simulator's own schedule; for targets the motion of the mirrors with lag and limits.",
        "None, but nothing here bears out the paper: the rate of voxels is the printed one, and the 0.2 ms beside "
        "128 voxels and the mirrors' limits are chosen so that the printed times come out. A raster's flyback takes "
        "no time, in print as here.",
        table_2,
    ),
)
"""Tables 1 and 2."""
