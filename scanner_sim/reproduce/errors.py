"""Figure 12: the range error of both ways of ranging."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from scanner_sim.analytic.time_of_flight import crossing_range
from scanner_sim.reproduce.bench import BASE, FOCAL, aim, bench, grid, layers_of, plate, slope
from scanner_sim.reproduce.drawing import BLUE, GREEN, RED, ranges, sheet
from scanner_sim.reproduce.item import Item, Outcome, Task, judged, within

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_HALF = 0.05
_APART = 0.1
"""Time between two shots [s]: twice that in which a mirror's wobble changes."""
_NEAR, _FAR = 2.0, 30.0
"""Ranges between which laws are fitted [m]."""
_BLUR = 40e-6
"""Spread of a point on the sensor [m] that the lens's aberration and the sensor's diffusion share."""
_ENDS = {
    "all of it diffusion": {"receiver": {"aberration": 0.0}, "position_sensor": {"diffusion": _BLUR}},
    "all of it aberration": {"receiver": {"aberration": _BLUR}, "position_sensor": {"diffusion": 0.0}},
}
"""The two ends of how the spot's blur is shared out, which speckle tells apart."""
_FEW = 9
"""Voxels along each side that tell the stated σ of these ends."""
_WAYS = {"": "triangulation", "tof.": "time of flight", "fused.": "both, by their σ"}


def figure_12(task: Task) -> Outcome:
    """Measure σ of the range by triangulation and by time of flight, every source of error on."""
    distances = np.geomspace(1.75, 40.0, task.choose(14, 8))
    side = task.choose(24, 16)
    scatter = {way: np.empty(len(distances)) for way in _WAYS}
    stated = {way: np.empty(len(distances)) for way in _WAYS}
    ends = {name: np.empty(len(distances)) for name in _ENDS}
    for row, distance in enumerate(distances.tolist()):
        unit = {"lidar": {"digitiser": {"gate": (0.5, 60.0)}}}
        made = bench(task, [plate(distance, _HALF)], unit, ranging="both", step=row)
        layers = layers_of(made, aim(*grid(_HALF, side), _APART))
        for way in _WAYS:
            error = layers[f"{way}range_m"] - layers["truth.range_m"]
            scatter[way][row] = np.sqrt(np.nanmean(error**2))
            stated[way][row] = np.nanmedian(layers[f"{way}sigma_range_m"])
        for name, parts in _ENDS.items():
            other = layers_of(
                bench(task, [plate(distance, _HALF)], parts, step=row), aim(*grid(_HALF, _FEW), _APART)
            )
            ends[name][row] = np.nanmedian(other["sigma_range_m"])
    fitted = (distances >= _NEAR) & (distances <= _FAR)
    exponent = slope(distances[fitted], scatter[""][fitted])
    flat = scatter["tof."][fitted]
    ratio = np.log(scatter[""] / scatter["tof."])
    crossing = float(np.exp(np.interp(0.0, ratio, np.log(distances))))
    place = int(np.abs(distances - crossing).argmin())
    error_of_p = scatter[""][place] * FOCAL * BASE / distances[place] ** 2
    expected = crossing_range(float(scatter["tof."][place]), FOCAL, BASE, float(error_of_p))
    meetings = [
        float(np.exp(np.interp(0.0, np.log(values / stated["tof."]), np.log(distances))))
        for values in ends.values()
    ]
    worst = max(float(np.abs(np.log(scatter[way] / stated[way])).max()) for way in _WAYS)
    better = scatter["fused."] / np.minimum(scatter[""], scatter["tof."])
    at_ten = [float(np.interp(10.0, distances, values[""])) for values in (scatter, stated)]
    rows = (
        judged(
            "exponent of σ_R of triangulation, 2 to 30 m",
            "2",
            "2 (speckle) to 4 (read noise)",
            f"{exponent:.2f}",
            abs(exponent - 2.0) < 0.35,
        ),
        judged(
            "σ_R of time of flight, 2 to 30 m",
            "almost flat",
            "10 mm, the clock's jitter",
            f"{1e3 * flat.min():.1f} to {1e3 * flat.max():.1f} mm",
            flat.max() < 1.5 * flat.min(),
        ),
        judged(
            "range at which both are equal",
            "triangulation for short to medium range, 5 to 10 m",
            f"{expected:.1f} m",
            f"{crossing:.1f} m",
            within(crossing, expected, 0.1) and crossing < 10.0,
        ),
        judged(
            "the same, were all of the spot's blur the sensor's diffusion, or the lens's aberration",
            "",
            f"{crossing:.1f} m between them",
            f"{meetings[0]:.1f} m and {meetings[1]:.1f} m",
            meetings[1] < crossing < meetings[0],
        ),
        judged(
            "σ_R of triangulation at 10 m",
            "",
            f"{1e3 * at_ten[1]:.1f} mm, as the instrument states",
            f"{1e3 * at_ten[0]:.1f} mm",
            within(at_ten[0], at_ten[1], 0.1),
        ),
        judged(
            "σ_R of both together over that of the better one, worst",
            "",
            "at most 1",
            f"{better.max():.2f}",
            better.max() < 1.0 + 3.0 / side,
        ),
        judged(
            "scatter over the σ that the instrument states, worst",
            "",
            "1",
            f"{np.exp(worst):.2f}",
            worst < 0.35,
        ),
    )

    def draw(axes: Sequence[Axes]) -> None:
        for (way, name), colour in zip(_WAYS.items(), (BLUE, RED, GREEN), strict=True):
            bars = 1.96 * 1e3 * scatter[way] / np.sqrt(2.0 * side**2)
            axes[0].plot(distances, 1e3 * stated[way], color=colour, lw=1.2)
            axes[0].errorbar(
                distances,
                1e3 * scatter[way],
                bars,
                fmt="o",
                ms=4,
                lw=0.9,
                capsize=1.5,
                color=colour,
                label=name,
            )
        for (name, values), style in zip(ends.items(), ("--", "-."), strict=True):
            axes[0].plot(distances, 1e3 * values, color=BLUE, lw=0.9, ls=style, label=f"blur: {name}")
        guide = 1e3 * scatter[""][place] * (distances / distances[place]) ** 2
        axes[0].plot(distances, guide, color="black", lw=0.8, ls=":", label="R²")
        axes[0].set(yscale="log", ylabel="σ of the range [mm]")
        ranges(axes[0])
        axes[0].legend()

    about = f"dots: scatter about the truth, {side**2} voxels each, 95 %; lines: σ that the instrument states"
    return Outcome(
        rows, lambda path: sheet(path, "Range error against range (Figure 12)", about, draw, height=4.4)
    )


ITEMS = (
    Item(
        "fig12",
        "Figure 12: range error of both modes",
        "Triangulation errs as R²; time of flight, by its manufacturer's specification, is almost flat. No "
        "numbers can be read.",
        "Facing plates of reflectance 0.5 in the dark from 1.75 to 40 m; the preset with every source of error.",
        "With the maximum-likelihood fit near spots are found better than R² would have it, because they "
        "fill more pixels, and far ones worse, where read noise (R⁴) adds to speckle (R²). The floor of time "
        "of flight is the clock's jitter, an assumption, and so is the prototype's Δp: where both cross is "
        "no prediction, but that R = √(σ_TOF f d/Δp) there is. It lies beyond the paper's 5 to 10 m because "
        "the fit's Δp is small.",
        figure_12,
        also="`scanner-sim budget configs/tof_both.yaml` tells where each part of it comes from.",
    ),
)
"""Figure 12."""
