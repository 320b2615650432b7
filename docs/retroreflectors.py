"""The picture of retro-reflectors: gain over the observation angle, and the signal over range.

Run as ``python docs/retroreflectors.py``; writes docs/pictures/retroreflectors.png. Lines are the judge's closed forms,
dots the simulator's BSDF and rendered light.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from scanner_sim.analytic import retroreflector as judge
from scanner_sim.config.scanner import Scanner
from scanner_sim.products.pictures.style import house_style
from scanner_sim.scene.materials import MATERIALS, mitsuba_bsdf
from scanner_sim.scene.objects import Scene

PICTURE = Path(__file__).resolve().parent / "pictures" / "retroreflectors.png"
COLOURS = {"retro_sheet": "#0072b2", "corner_cube_array": "#d55e00"}
LABELS = {"retro_sheet": "bead sheet", "corner_cube_array": "corner cubes"}
STANDARD = {"retro_sheet": (250.0, 95.0), "corner_cube_array": (700.0, 250.0)}
"""Least coefficients of retro-reflection at 0.2° and 0.5° [cd/lx/m²], ASTM D4956 types III and VIII."""
RANGES = (2.0, 3.0, 5.0, 10.0, 20.0, 40.0)


def figure_retroreflectors() -> Figure:
    """Gain over observation angle; power at the lens over range, beside the laser and around it."""
    from scanner_sim.render.device import activate

    activate("cpu")
    with house_style():
        figure = Figure(figsize=(10.0, 4.6), layout="constrained")
        left, right = figure.subplots(1, 2)
        _gains(left)
        _powers(right)
        return figure


def _sheet(name: str) -> judge.Sheet:
    entry = MATERIALS[name]
    lobe = entry.retro
    if lobe is None:
        raise ValueError(f"'{name}' is no retro-reflector")
    law, value = lobe.entrance
    beads = law == "entrance_half_angle"
    return judge.Sheet(
        entry.reflectance,
        lobe.retro_share,
        lobe.half_width,
        half_angle=value if beads else None,
        refractive_index=1.0 if beads else value,
    )


def _gains(axes: Any) -> None:
    angle = np.geomspace(0.03, 30.0, 200)
    dots = np.geomspace(0.04, 25.0, 14)
    for name, colour in COLOURS.items():
        axes.loglog(angle, judge.gain(_sheet(name), np.deg2rad(angle)), color=colour, lw=1.2)
        axes.loglog(dots, _evaluated(name, np.deg2rad(dots)), "o", color=colour, ms=4, label=LABELS[name])
        least = np.pi * np.array(STANDARD[name])
        axes.loglog((0.2, 0.5), least, "x", color="black", ms=6, mew=1.2, zorder=3)
    axes.loglog([], [], "x", color="black", ms=6, mew=1.2, label="least values, ASTM D4956")
    for R in (2.0, 5.0, 10.0, 20.0):
        seen = float(np.rad2deg(np.arctan2(Scanner().receiver.baseline, R)))
        axes.axvline(seen, color="#999999", lw=0.8, ls=":")
        box = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
        axes.annotate(f"{R:g} m", (seen, 6e3), fontsize=8, ha="center", color="#555555", bbox=box)
    axes.axhline(1.0, color="black", lw=0.8, ls=":")
    axes.set(xlabel="observation angle [°]", ylabel="gain over white Lambertian", ylim=(0.2, 1e4))
    axes.set_title("Gain; dotted: lens at 0.2 m, by range", loc="left", weight="bold")
    _plain(axes)


def _powers(axes: Any) -> None:
    scanner = Scanner()
    R = np.geomspace(1.7, 45.0, 100)
    lens, power = scanner.receiver, scanner.laser.power
    for name, colour in COLOURS.items():
        sheet = _sheet(name)
        around = judge.coaxial_power(R, power, sheet, lens.aperture, lens.transmission)
        beside = judge.offset_power(R, power, sheet, lens.baseline, lens.aperture, lens.transmission)
        axes.loglog(R, 1e9 * around, "--", color=colour, lw=1.2)
        axes.loglog(R, 1e9 * beside, "-", color=colour, lw=1.2)
        for coaxial in (False, True):
            found = [1e9 * _rendered(name, distance, coaxial) for distance in RANGES]
            axes.loglog(RANGES, found, "o", color=colour, ms=4, mfc="white" if coaxial else colour)
    white = judge.Sheet(1.0, 0.0, 0.01)
    level = judge.offset_power(R, power, white, lens.baseline, lens.aperture, lens.transmission)
    axes.loglog(R, 1e9 * level, color="black", lw=1.2, label="white wall")
    axes.loglog([], [], "--", color="#555555", lw=1.2, label="lens around the laser")
    axes.loglog([], [], "-", color="#555555", lw=1.2, label="lens 0.2 m beside it")
    axes.set(xlabel="range [m]", ylabel="power at the sensor [nW]")
    axes.set_xticks([2, 3, 5, 10, 20, 40])
    axes.set_title("Signal of 15 mW; dots: rendered light", loc="left", weight="bold")
    _plain(axes)


def _plain(axes: Any) -> None:
    axes.xaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()
    axes.grid(which="major", color="#dddddd", lw=0.5)
    axes.legend(frameon=False, fontsize=8, loc="lower left")


def _evaluated(name: str, angle: np.ndarray) -> np.ndarray:
    """Return the gain of the BSDF itself, lit along the normal."""
    import drjit as dr
    import mitsuba as mi

    bsdf: Any = mi.load_dict(mitsuba_bsdf(MATERIALS[name]))
    si: Any = dr.zeros(mi.SurfaceInteraction3f, len(angle))
    si.wi = mi.Vector3f(0.0, 0.0, 1.0)
    sine, cosine = dr.sincos(mi.Float(angle.astype(np.float32)))
    value = bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(sine, 0.0, cosine))[0].numpy()
    return np.asarray(np.pi * value / np.cos(angle))


def _rendered(name: str, R: float, coaxial: bool) -> float:
    """Return the rendered power [W] of a wall square to the beam, on pixels that see all of its spot."""
    import mitsuba as mi

    from scanner_sim.render.beam.line_projection import LineProjection
    from scanner_sim.render.beam.splitter import render_light
    from scanner_sim.render.settings import Transport
    from scanner_sim.render.shots import Shots
    from scanner_sim.render.transport import OpticalLayout
    from scanner_sim.scene.files.loader import load_scene

    scanner = Scanner()
    sensor, receiver, offset = scanner.position_sensor, scanner.receiver, 0.0
    if coaxial:
        receiver, offset = receiver.model_copy(update={"baseline": 1e-6}), -0.5 * sensor.length
    bench = OpticalLayout(
        scanner.laser, receiver, scanner.mirrors.axis_separation, 1.0, sensor.pitch, 1e-3, offset
    )
    wall = {"name": "wall", "shape": "rectangle", "size": (20.0, 20.0), "position": (0.0, 0.0, R)}
    loaded = load_scene(Scene.model_validate({"objects": [{**wall, "material": name}]}))
    shot = Shots(number=mi.UInt32(0), theta=mi.Float(0.0), phi=mi.Float(0.0))
    _, (light,) = render_light(loaded, LineProjection(bench), Transport(uneven_beamlets=256), shot, seed=0)
    return float(light.line(0, sensor.pixels).sum())


def main() -> None:
    figure = figure_retroreflectors()
    FigureCanvasAgg(figure)
    figure.savefig(PICTURE, dpi=150, metadata={"Software": None})


if __name__ == "__main__":
    main()
