"""Equations 17 to 19 and Figures 16 and 17: the Sun's spectrum, and the laser over sunlight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from scanner_sim.analytic import spot, sun
from scanner_sim.products.pictures.style import FAINT
from scanner_sim.scene.light.lighting import Sun
from scanner_sim.scene.light.sun import irradiance_between, solar_irradiance, total_irradiance
from scanner_sim.validation.reproduce.bench import FOCAL, STILL, aim, bench, slope
from scanner_sim.validation.reproduce.drawing import BLUE, COLOURS, RED, ranges, sheet
from scanner_sim.validation.reproduce.item import Item, Outcome, Task, chosen, row_of_claim, within

_POWER, _WINDOW, _WAVELENGTH = 15e-3, 200e-6 * 250e-6, 1.5e-6
_WAIST, _APERTURE, _TRANSMISSION, _REFLECTANCE = 2e-3, 25e-3, 0.5, 0.5
_BANDWIDTHS = (10e-9, 30e-9, 50e-9)
_GAIN = float(np.pi / 4.0 * _APERTURE**2 * _TRANSMISSION)
"""B_p: the aperture's area and the transmission of lens and filter [m²]."""


def figure_16(_task: Task) -> Outcome:
    """Hold the simulator's Sun against eq 17 and the measured spectrum."""
    planck, measured = Sun(), Sun(spectrum="astm_g173")
    total, line = total_irradiance(planck), 1e-9 * float(solar_irradiance(planck, _WAVELENGTH))
    near = irradiance_between(measured, 1.49e-6, 1.51e-6) / 20.0
    above = near / line - 1.0
    spectra = sun.solar_spectra()
    beside = np.abs(spectra.wavelength - _WAVELENGTH) < 10.5e-9
    expected = float(np.mean(spectra.outside[beside])) / float(sun.planck_irradiance(_WAVELENGTH)) - 1.0
    rows = (
        row_of_claim(
            "total irradiance of 5770 K [W/m²]",
            "1353",
            f"{sun.total_irradiance():.1f}",
            f"{total:.1f}",
            within(total, 1353.0, 2e-3),
        ),
        row_of_claim(
            "the same by eq 17 with the radius as printed, 69 500 km",
            "1353",
            "",
            f"{0.01 * sun.total_irradiance():.2f} (no simulation)",
            False,
        ),
        row_of_claim(
            "irradiance at 1.5 µm [W/m²/nm]",
            "",
            f"{1e-9 * float(sun.planck_irradiance(_WAVELENGTH)):.4f}",
            f"{line:.4f}",
            within(line, 0.2487, 1e-3),
        ),
        row_of_claim(
            "measured spectrum above the black body at 1.5 µm",
            "",
            f"{100.0 * expected:.1f} %",
            f"{100.0 * above:.1f} %",
            abs(above - expected) < 0.005,
        ),
    )

    def draw(axes: Sequence[Axes]) -> None:
        micrometres = 1e6 * spectra.wavelength
        for values, label, colour in (
            (spectra.ground, "ASTM G-173, through the atmosphere", FAINT),
            (spectra.outside, "ASTM G-173, outside of it", BLUE),
            (spectra.planck, "black body of 5770 K (eq 17)", RED),
        ):
            axes[0].plot(micrometres, 1e-9 * values, label=label, color=colour, lw=1.1)
        axes[0].axvline(1.5, color="black", lw=0.8, ls=":")
        axes[0].annotate("laser, 1.5 µm", (1.52, 1.9))
        axes[0].set(
            xlabel="wavelength [µm]", ylabel="irradiance [W/m²/nm]", xlim=(0.28, 2.5), ylim=(0.0, 2.3)
        )
        axes[0].legend()

    about = "what the simulator's Sun sends, and the measured spectrum that it can take instead"
    return Outcome(
        rows, lambda path: sheet(path, "Spectral irradiance of the Sun (eq 17, Figure 16)", about, draw)
    )


def light_at(task: Task, distance: float, bandwidth: float) -> tuple[float, float]:
    """Return I_laser and I_sun [W] of a rendered Lambertian plane that faces scanner and Sun."""
    wall = {"name": "wall", "shape": "rectangle", "size": (50.0, 50.0), "position": (0.0, 0.0, distance)}
    made = bench(
        task,
        [{**wall, "material": {"reflectance": _REFLECTANCE}}],
        {"filter": {"bandwidth": bandwidth}, "mirrors": dict(STILL)},
        lighting={"sun": {"direction": (0.0, 0.0, -1.0)}},
        transport={"background_bounces": 1},
    )
    _, groups = made.expose(aim(0.0, 0.0))
    (group,) = groups
    budget = group.light.link_budget()
    return float(budget.laser[0]), float(budget.background[0])


def figure_17(task: Task) -> Outcome:
    """Hold rendered light against eqs 18 and 19."""
    distances = np.array(task.choose((2.0, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0, 30.0), (2.0, 5.0, 10.0, 20.0)))
    found = {
        width: np.array([light_at(task, float(distance), width) for distance in distances])
        for width in _BANDWIDTHS
    }
    rows, fine = [], np.geomspace(1.7, 40.0, 100)
    off_axis = (1.0 + (0.2 / distances) ** 2) ** -2
    image = FOCAL * 0.5 * _WAIST * np.hypot(1.0, distances * _WAVELENGTH / (np.pi * _WAIST**2)) / distances
    share = spot.share_within_height(np.hypot(image, 40e-6), 250e-6)
    laser = spot.laser_power_printed(distances, _POWER, _REFLECTANCE, _GAIN)
    power = found[30e-9][:, 0] / (laser * share * off_axis)
    ten = int(np.flatnonzero(distances == 10.0)[0])
    rows.append(
        row_of_claim(
            "I_laser at 10 m, reflectance 0.5 [nW]",
            "",
            f"{1e9 * float(laser[ten]):.2f}",
            f"{1e9 * found[30e-9][ten, 0]:.2f}",
            within(float(found[30e-9][ten, 0]), float(laser[ten]), 0.01),
        )
    )
    rows.append(
        row_of_claim(
            "I_laser over eq 19 (with cos⁴ψ and the pixels' height), worst",
            "1",
            "1",
            f"{power[np.abs(power - 1.0).argmax()]:.4f}",
            np.abs(power - 1.0).max() < 0.01,
        )
    )
    for width in _BANDWIDTHS:
        effective = sun.effective_irradiance(_WAVELENGTH, width)
        expected = sun.sun_power(_REFLECTANCE, _WINDOW, FOCAL, _GAIN, effective) * off_axis
        ratio = found[width][:, 1] / expected
        rows.append(
            row_of_claim(
                f"I_sun over eq 18, repaired, {1e9 * width:.0f} nm, worst",
                "",
                "1",
                f"{ratio[np.abs(ratio - 1.0).argmax()]:.4f}",
                np.abs(ratio - 1.0).max() < 0.01,
            )
        )
    effective = sun.effective_irradiance(_WAVELENGTH, 30e-9)
    printed = sun.sun_power(_REFLECTANCE, _WINDOW, FOCAL, _GAIN, effective, "printed")
    short = float(found[30e-9][ten, 1] / (printed * off_axis[ten]))
    rows.append(
        row_of_claim(
            "I_sun at 10 m over eq 18 without 1/π, as printed but for 1/f²",
            "1",
            f"1/π = {1.0 / np.pi:.3f}",
            f"{short:.3f}",
            within(short, 1.0, 0.01),
        )
    )
    signal = {width: light[:, 0] / light[:, 1] for width, light in found.items()}
    far = distances >= 10.0
    exponent = slope(distances[far], signal[30e-9][far])
    rows.append(
        row_of_claim(
            "exponent of I_laser/I_sun in R",
            "−2",
            "−2",
            f"{exponent:.3f}".replace("-", "−"),
            abs(exponent + 2.0) < 0.02,
        )
    )
    equal = {width: float(distances[-1]) * signal[width][-1] ** 0.5 for width in _BANDWIDTHS}
    rows.append(
        chosen(
            "range where I_laser = I_sun, 30 nm, a bandwidth chosen for it",
            "operational to 20 m",
            f"{sun.equal_range(_POWER, FOCAL, _WINDOW, sun.effective_irradiance(_WAVELENGTH, 30e-9)):.1f} m",
            f"{equal[30e-9]:.1f} m",
            within(equal[30e-9], 20.0, 0.03),
        )
    )

    def draw(axes: Sequence[Axes]) -> None:
        for width, colour in zip(_BANDWIDTHS, COLOURS, strict=False):
            effective = sun.effective_irradiance(_WAVELENGTH, width)
            ratio = sun.signal_to_sun(fine, _POWER, FOCAL, _WINDOW, effective)
            axes[0].plot(fine, ratio, color=colour, lw=1.1)
            ratio = sun.signal_to_sun(fine, _POWER, FOCAL, _WINDOW, effective, "printed")
            axes[0].plot(fine, ratio, "--", color=colour, lw=1.1)
            axes[0].plot(
                distances, signal[width], "o", color=colour, ms=4.5, label=f"filter of {1e9 * width:.0f} nm"
            )
        axes[0].plot([], [], "k-", lw=1.1, label="eqs 18 and 19, repaired")
        axes[0].plot([], [], "k--", lw=1.1, label="without 1/π, as printed")
        axes[0].axhline(1.0, color="black", lw=0.8, ls=":")
        axes[0].set(yscale="log", ylabel="I_laser / I_sun")
        ranges(axes[0])
        axes[0].legend()

    about = "dots: rendered light of a Lambertian plane that faces scanner and Sun; 15 mW, f 100 mm"
    return Outcome(
        tuple(rows),
        lambda path: sheet(path, "Laser over Sun (eqs 18 and 19, Figure 17)", about, draw, height=4.4),
    )


ITEMS = (
    Item(
        "fig16",
        "Equation 17 and Figure 16: spectrum of the Sun",
        "Planck's law at 5770 K with the Sun's radius 69 500 km at 149.68·10⁶ km; 1353 W/m² in all. Beside "
        "it measured spectra with and without the atmosphere.",
        "The spectrum that the simulator's Sun sends, summed and at 1.5 µm, beside ASTM G-173.",
        "The radius has lost a zero in print: 695 000 km give 1355 W/m², 69 500 km a hundredth of it. The "
        "measured spectrum is a fifth brighter at 1.5 µm than the black body; `lighting.sun.spectrum: "
        "astm_g173` takes it.",
        figure_16,
        ("eq17",),
    ),
    Item(
        "fig17",
        "Equations 18 and 19, Figure 17: laser over sunlight",
        "I_sun = S/f · T_r B_p [∫_band E + (B_s/B_p) ∫E], I_laser = T_r B_p P/(π R²); their ratio is drawn "
        "for f 100 mm and 15 mW, and the prototype is said to be operational to 20 m.",
        "Light rendered onto the pixels from a Lambertian plane that faces scanner and Sun.",
        "Eq 18 is damaged: S/f must be S/f², dλ is missing, and Lambert's 1/π, which stands in eq 19, too. "
        "As printed the ratio would be π times lower. The bandwidth is not printed: 30 nm is chosen such that "
        "both lights are equal at the paper's limit of 20 m, which hence bears nothing out. "
        "Near the scanner the pixels' height cuts the spot, "
        "and both lights fall by cos⁴ψ.",
        figure_17,
        ("eq18", "eq19"),
    ),
)
"""The Sun."""
