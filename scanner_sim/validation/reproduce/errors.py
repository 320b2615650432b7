"""Figure 12: the range error of both ways of ranging."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from scanner_sim.validation.compare.instrument import closed_budget, closed_crossing
from scanner_sim.validation.reproduce.bench import Array, aim, bench, grid, layers_of, plate, slope
from scanner_sim.validation.reproduce.drawing import BLUE, GREEN, RED, ranges, sheet
from scanner_sim.validation.reproduce.item import Item, Outcome, Task, chosen, row_of_claim, within

_HALF = 0.05
_APART = 0.1
"""Time between two shots [s]: twice that in which a mirror's wobble changes."""
_REFLECTANCE = 0.5
_ORDERS = 0.05
"""How far the closed form may be off by its first order, and σ as stated: the pixels' height near, one response."""
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
_WAYS = {"": "triangulation", "tof.": "time of flight", "fused.": "both combined"}


def _equal(distances: Array, ratio: Array) -> float:
    """Return where a rising ratio is one [m], by interpolation in logarithms."""
    return float(np.exp(np.interp(0.0, np.log(ratio), np.log(distances))))


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
    by_form = {"": "triangulation", "tof.": "tof", "fused.": "fused"}
    budgets = [closed_budget(made.scenario, _REFLECTANCE, distance) for distance in distances.tolist()]
    closed = {way: np.array([one[name]["all"] for one in budgets]) for way, name in by_form.items()}
    fitted = (distances >= _NEAR) & (distances <= _FAR)
    exponent, expected = (slope(distances[fitted], sigma[""][fitted]) for sigma in (scatter, closed))
    away = np.log(distances[fitted]) - np.log(distances[fitted]).mean()
    blur = 1.0 / np.sqrt(2.0 * side**2)
    slack_of_slope = float(3.0 * blur / np.sqrt(away @ away) + 2.0 * _ORDERS / np.log(_FAR / _NEAR))
    flat, form = scatter["tof."][fitted], closed["tof."][fitted]
    crossing = _equal(distances, scatter[""] / scatter["tof."])
    meeting = closed_crossing(made.scenario, _REFLECTANCE, float(distances[0]), float(distances[-1]))
    position = int(np.abs(distances - crossing).argmin())
    steep = slope(
        distances[position - 1 : position + 2], (closed[""] / closed["tof."])[position - 1 : position + 2]
    )
    slack = (3.0 * np.sqrt(2.0) * blur + _ORDERS) / steep
    meetings = [_equal(distances, values / stated["tof."]) for values in ends.values()]
    reach = 4.5 * blur
    ratios = [np.concatenate([scatter[way] / other[way] for way in _WAYS]) for other in (stated, closed)]
    worst = [float(ratio[np.abs(np.log(ratio)).argmax()]) for ratio in ratios]
    at_ten = [
        float(np.exp(np.interp(np.log(10.0), np.log(distances), np.log(one[""]))))
        for one in (scatter, closed)
    ]
    rows = (
        row_of_claim(
            "exponent of σ_R of triangulation, 2 to 30 m, against its own closed form",
            "",
            f"{expected:.2f} ± {slack_of_slope:.2f}",
            f"{exponent:.2f}",
            abs(exponent - expected) < slack_of_slope,
        ),
        row_of_claim(
            "the same against the R² of the paper",
            "2",
            f"{expected:.2f}",
            f"{exponent:.2f}",
            abs(exponent - 2.0) < slack_of_slope,
        ),
        chosen(
            "σ_R of time of flight, 2 to 30 m: flat by the jitter of its clock, an assumption",
            "almost flat",
            f"{1e3 * form.min():.1f} to {1e3 * form.max():.1f} mm",
            f"{1e3 * flat.min():.1f} to {1e3 * flat.max():.1f} mm",
            flat.max() < 1.5 * flat.min(),
        ),
        row_of_claim(
            "range at which both are equal, mirrors at rest, against the closed forms",
            "",
            f"{meeting:.1f} ± {slack * meeting:.1f} m",
            f"{crossing:.1f} m",
            within(crossing, meeting, slack),
        ),
        row_of_claim(
            "the same against the paper",
            "triangulation for short to medium range, 5 to 10 m",
            f"{meeting:.1f} m",
            f"{crossing:.1f} m",
            5.0 <= crossing <= 10.0,
        ),
        row_of_claim(
            "the same, were all of the spot's blur the sensor's diffusion, or the lens's aberration",
            "",
            f"{crossing:.1f} m between them",
            f"{meetings[0]:.1f} m and {meetings[1]:.1f} m",
            meetings[1] < crossing < meetings[0],
        ),
        row_of_claim(
            "σ_R of triangulation at 10 m",
            "",
            f"{1e3 * at_ten[1]:.1f} mm",
            f"{1e3 * at_ten[0]:.1f} mm",
            within(at_ten[0], at_ten[1], 3.0 * blur + _ORDERS),
        ),
        row_of_claim(
            "scatter over the closed forms, both ways and their fusion, worst",
            "",
            "1",
            f"{worst[1]:.2f}",
            abs(np.log(worst[1])) < reach + _ORDERS,
        ),
        row_of_claim(
            "scatter over the σ that the instrument states, worst",
            "",
            "1",
            f"{worst[0]:.2f}",
            abs(np.log(worst[0])) < reach + _ORDERS,
        ),
    )

    def draw(axes: Sequence[Axes]) -> None:
        for (way, name), colour in zip(_WAYS.items(), (BLUE, RED, GREEN), strict=True):
            bars = 1.96 * 1e3 * scatter[way] / np.sqrt(2.0 * side**2)
            axes[0].plot(distances, 1e3 * closed[way], color=colour, lw=1.2)
            axes[0].plot(distances, 1e3 * stated[way], color=colour, lw=0.9, ls=":")
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
        guide = 1e3 * scatter[""][position] * (distances / distances[position]) ** 2
        axes[0].plot(distances, guide, color="black", lw=0.8, ls=":", label="R²")
        axes[0].set(yscale="log", ylabel="σ of the range [mm]")
        ranges(axes[0])
        axes[0].legend()

    about = (
        f"dots: scatter about the truth, {side**2} voxels each, 95 %; lines: closed forms, dotted: σ stated"
    )
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
        "No single power of R: near spots fill more pixels and have more speckle in them to average, and far away "
        "read noise (R⁴) adds to speckle (R²), as the closed form has it with the exact geometry. R² alone would ask "
        "for one Δp at all ranges. The floor of time of flight is the clock's jitter, an assumption, and so is how the "
        "spot's blur is shared out, on which Δp depends: where both cross is no prediction. Mirrors rest here; in a "
        "sweep speckle is averaged and the crossing lies farther, which `budget` tells beside it.",
        figure_12,
        also="`scanner-sim budget configs/tof_both.yaml` tells where each part of it comes from.",
    ),
)
"""Figure 12."""
