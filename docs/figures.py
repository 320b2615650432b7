"""Figures 16, 17 and retro-reflectors: run as ``python docs/figures.py``, writes below docs/pictures/.

Figure 16 is the Sun's spectrum; Figure 17 the ratio I_laser/I_sun over range, its dots from rendered light and its
lines from eqs 18 and 19, repaired and as printed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from retroreflectors import figure_retroreflectors

from scanner_sim import Scenario
from scanner_sim.analytic import sun
from scanner_sim.scan.raster import raster_aim
from scanner_sim.workbench import Workbench

PICTURES = Path(__file__).resolve().parent / "pictures"
POWER, FOCAL_LENGTH, WINDOW, WAVELENGTH = 15e-3, 0.1, 200e-6 * 250e-6, 1.5e-6
BANDWIDTHS = {10e-9: "#0072b2", 30e-9: "#d55e00", 50e-9: "#009e73"}


def main() -> None:
    save(figure_16(), "figure_16.png")
    save(figure_17(), "figure_17.png")
    save(figure_retroreflectors(), "retroreflectors.png")


def save(figure: Figure, name: str) -> None:
    FigureCanvasAgg(figure)
    figure.savefig(PICTURES / name, dpi=150, metadata={"Software": None})


def figure_16() -> Figure:
    """The Sun's spectral irradiance: black body, outside of the atmosphere, and through it."""
    spectra = sun.solar_spectra()
    figure = Figure(figsize=(7.5, 4.5), layout="constrained")
    axes = figure.add_subplot()
    micrometres = 1e6 * spectra.wavelength
    for values, label, colour in (
        (spectra.ground, "ASTM G-173, on the ground", "#999999"),
        (spectra.outside, "ASTM G-173, outside of the atmosphere", "#0072b2"),
        (spectra.planck, "black body of 5770 K (eq 17)", "#d55e00"),
    ):
        axes.plot(micrometres, 1e-9 * values, label=label, color=colour, lw=1.2)
    axes.axvline(1.5, color="black", lw=0.8, ls=":")
    axes.annotate("laser, 1.5 µm", (1.52, 1.9))
    axes.set(xlabel="wavelength [µm]", ylabel="irradiance [W/m²/nm]", xlim=(0.28, 2.5), ylim=(0.0, 2.3))
    axes.set_title("Spectral irradiance of the Sun (Figure 16)", loc="left", weight="bold")
    axes.legend(frameon=False)
    return figure


def figure_17() -> Figure:
    """I_laser/I_sun over range, rendered and by the equations."""
    figure = Figure(figsize=(7.5, 4.8), layout="constrained")
    axes = figure.add_subplot()
    ranges = np.geomspace(1.7, 40.0, 100)
    dots = np.array([2.0, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0, 30.0])
    for bandwidth, colour in BANDWIDTHS.items():
        effective = sun.effective_irradiance(WAVELENGTH, bandwidth)
        for model, line in (("physical", "-"), ("printed", "--")):
            ratio = sun.signal_to_sun(ranges, POWER, FOCAL_LENGTH, WINDOW, effective, model)
            axes.loglog(ranges, ratio, line, color=colour, lw=1.2)
        rendered = [ratio_at(float(distance), bandwidth) for distance in dots]
        axes.loglog(dots, rendered, "o", color=colour, ms=5, label=f"filter of {1e9 * bandwidth:.0f} nm")
    axes.plot([], [], "k-", lw=1.2, label="eqs 18 and 19, repaired")
    axes.plot([], [], "k--", lw=1.2, label="the same without 1/π, as printed")
    axes.axhline(1.0, color="black", lw=0.8, ls=":")
    axes.set(xlabel="range [m]", ylabel="I_laser / I_sun")
    axes.set_title("Laser over Sun (Figure 17); dots: rendered light", loc="left", weight="bold")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_xticks([2, 3, 5, 7, 10, 15, 20, 30, 40])
    axes.minorticks_off()
    axes.grid(which="both", color="#dddddd", lw=0.5)
    axes.legend(frameon=False)
    return figure


def ratio_at(distance: float, bandwidth: float) -> float:
    """Return the rendered ratio of a Lambertian plane that faces scanner and Sun."""
    wall = {"name": "wall", "shape": "rectangle", "size": (50.0, 50.0), "position": (0.0, 0.0, distance)}
    scenario = Scenario(
        schema=1,
        scanner={"filter": {"bandwidth": bandwidth}, "mirrors": {"jitter": 0.0}},
        scene={"objects": [{**wall, "material": {"reflectance": 0.5}}]},
        lighting={"sun": {"direction": (0.0, 0.0, -1.0)}},
        scan={"rows": 1, "columns": 1, "horizontal": (0.0, 0.0), "vertical": (0.0, 0.0)},
    )
    bench = Workbench(scenario)
    _, groups = bench.expose(raster_aim(scenario.scan, np.array([0], dtype=np.uint32), 50e-6))
    (group,) = groups
    budget = group.light.link_budget()
    return float(budget.laser[0]) / float(budget.background[0])


if __name__ == "__main__":
    main()
