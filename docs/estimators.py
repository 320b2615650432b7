"""How well each estimator finds the spot: run as ``python docs/estimators.py``, writes docs/pictures/estimators.png.

Standard deviation over the Cramér–Rao bound against the spot's width, at a largest pixel of 50 times the white noise;
the same of the fit against that ratio; and the largest systematic error, with and without the computed table. The
numbers of ``docs/theory/signals.md`` are printed.
"""

from __future__ import annotations

from pathlib import Path

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic import noise, spot
from scanner_sim.products.pictures.style import FAINT, house_style, save
from scanner_sim.render.device import activate

PICTURE = Path(__file__).resolve().parent / "pictures" / "estimators.png"
PIXELS, READ, PLACES = 64, 1000.0, 40
WIDTHS = np.array([0.5, 0.6, 0.7, 0.85, 1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0])
RATIOS = np.array([5.0, 7.0, 10.0, 20.0, 50.0, 200.0, 1000.0])
COLOURS = {
    "parabola": "#999999",
    "gaussian": "#009e73",
    "centre_of_mass": "#cc79a7",
    "blais_rioux_2": "#56b4e9",
    "blais_rioux_4": "#0072b2",
    "blais_rioux_8": "#1f3a6e",
    "maximum_likelihood": "#d55e00",
}
Array = NDArray[np.float64]


def measure(
    method: str, sigma: float, ratio: float, read: float = READ, each: int = 1000, corrected: bool = False
) -> tuple[Array, Array]:
    """Return errors, shape (places, lines), and bounds, shape (places,), of spots ``ratio`` times the noise high."""
    import drjit.auto.ad as auto

    from scanner_sim.config.scanner import Scanner
    from scanner_sim.detector.line.exposure import electrons_per_watt, expose
    from scanner_sim.detector.line.noise import NoiseSwitches
    from scanner_sim.optics.line_image import sharp_everywhere
    from scanner_sim.signals.line.bias import Bias, computed_bias
    from scanner_sim.signals.line.expected import ExpectedSpot
    from scanner_sim.signals.line.peaks import find_peaks
    from scanner_sim.signals.processing import Processing, Validation

    centres = np.repeat(28.0 + (np.arange(PLACES) + 0.5) / PLACES - 0.5, each)
    shares = spot.pixel_shares(centres, np.full_like(centres, sigma), PIXELS)
    charge = ratio * READ / shares.max(axis=1)
    switches = dict.fromkeys(NoiseSwitches.model_fields, False) | {"read": read > 0.0}
    changes = {"pixels": PIXELS, "gain": 1.0, "adc_bits": 24, "full_well": 1e9, "read_noise": read}
    line = Scanner(position_sensor={**changes, "noise": NoiseSwitches(**switches)}).position_sensor
    watts = charge[:, None] * shares / electrons_per_watt(line, 1.5e-6, 50e-6)
    table = auto.Float(watts.astype(np.float32).ravel())
    signal = expose(
        lambda pixel, place: dr.gather(auto.Float, table, place * PIXELS + pixel),
        dr.arange(auto.UInt32, len(centres)),
        line,
        1.5e-6,
        50e-6,
        7,
    )
    bare = Validation(background=False, shape=False, misfit=0.0, max_reflectance=None)
    known = ExpectedSpot(
        sharp_everywhere(0.1), 0.2, 1e-9, 0.0, 1e3, sigma * 50e-6, 0.0, 50e-6, 0.0, PIXELS, 1e12
    )
    bias = Bias(computed_bias(method, 0.45, 3.6)) if corrected else None
    processing = Processing(peak=method, threshold=2.0, ambiguity=1.0, validation=bare)
    peaks = find_peaks(signal, line, processing, 50e-6, known, 0.0, bias)
    white = [
        noise.cramer_rao(c - 28.0, sigma, 1e12 * q, 0.0, 1e12 * READ)
        for c, q in zip(centres[::each], charge[::each], strict=True)
    ]
    return (peaks.position.numpy() - centres).reshape(PLACES, each), np.array(white)


def over_bound(method: str, sigma: float, ratio: float) -> float:
    """Return the standard deviation over the bound, root mean squares over the places; outliers are left out."""
    error, bound = measure(method, sigma, ratio)
    if method == "maximum_likelihood":
        error = np.where(np.abs(error) < 6.0 * bound[:, None], error, np.nan)
    return float(np.sqrt(np.mean(np.nanvar(error, axis=1, ddof=1)) / np.mean(bound**2)))


def largest_bias(method: str, sigma: float, corrected: bool) -> float:
    """Return the largest error of noise-free lines [pixel]."""
    error, _ = measure(method, sigma, 1000.0, 0.0, 10, corrected)
    return float(np.abs(error).max())


def main() -> None:
    activate("cpu")
    with house_style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9.0, 3.6), dpi=150, layout="constrained")
        left, middle, right = figure.subplots(1, 3)
        for method, colour in COLOURS.items():
            ratios = [over_bound(method, width, 50.0) for width in WIDTHS]
            print(f"{method:20s}", " ".join(f"{r:.2f}" for r in ratios))
            left.plot(WIDTHS, ratios, "-o", ms=2.5, lw=1.0, color=colour, label=method)
            for corrected in (False, True):
                bias = [max(1e6 * largest_bias(method, width, corrected), 1.0) * 1e-6 for width in WIDTHS]
                right.semilogy(WIDTHS, bias, ":" if corrected else "-", lw=1.0, color=colour)
        for width, shade in ((0.5, "#f4b183"), (1.0, "#d55e00"), (3.0, "#7f3300")):
            ratios = [over_bound("maximum_likelihood", width, ratio) for ratio in RATIOS]
            print("fit", width, " ".join(f"{r:.3f}" for r in ratios))
            middle.semilogx(RATIOS, ratios, "-o", ms=2.5, lw=1.0, color=shade, label=f"s = {width:g} px")
        for axes, limit in ((left, 1.0), (middle, 1.05), (right, 0.002)):
            axes.axhline(limit, color=FAINT, lw=0.7, ls="--", zorder=0)
            axes.spines[["top", "right"]].set_visible(False)
        left.set(
            xlabel="width of the spot s [px]", ylabel="standard deviation over the bound", ylim=(0.9, 3.2)
        )
        middle.set(
            xlabel="largest pixel over white noise",
            ylabel="the same of maximum_likelihood",
            ylim=(0.95, 1.10),
        )
        right.set(xlabel="width of the spot s [px]", ylabel="largest systematic error [px]")
        left.set_title("Efficiency at a ratio of 50", loc="left", weight="bold")
        middle.set_title("Efficiency of the fit", loc="left", weight="bold")
        right.set_title("Bias; dotted: corrected", loc="left", weight="bold")
        middle.legend(loc="upper right")
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=7, fontsize=7.0)
        save(figure, PICTURE)


if __name__ == "__main__":
    main()
