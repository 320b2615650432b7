"""The tables of speckle on the page about light, from the judge's closed forms.

Run as ``python docs/speckle.py``; rewrites them in docs/theory/light.md. A test holds the page to what this makes.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from made_tables import marked, rewrite

from scanner_sim.analytic import speckle
from scanner_sim.analytic.beam import beam_radius
from scanner_sim.analytic.estimators import ESTIMATORS
from scanner_sim.config.scanner import Scanner

PAGE = Path(__file__).resolve().parent / "theory" / "light.md"
_LINE = 25
_NAMES = {
    "gaussian": "Gauss 3",
    "centre_of_mass": "centre of mass",
    "blais_rioux_2": "BR2",
    "blais_rioux_4": "BR4",
    "blais_rioux_8": "BR8",
}


def spot(distance: float, aberration: float) -> speckle.SpeckledSpot:
    """Return the preset's spot at a range [m], of whose blur the lens has an aberration [m] and the sensor the rest."""
    scanner = Scanner()
    laser, receiver, sensor = scanner.laser, scanner.receiver, scanner.position_sensor
    radius = float(
        beam_radius(distance, laser.waist_radius, laser.waist_distance, laser.wavelength, laser.m_squared)
    )
    return speckle.SpeckledSpot(
        image=0.5 * radius * receiver.focal_length / distance,
        cell=laser.wavelength * receiver.focal_length / receiver.aperture,
        aberration=aberration,
        diffusion=math.sqrt(scanner.point_spread**2 - aberration**2),
        pitch=sensor.pitch,
    )


def shares() -> dict[str, float]:
    """Return aberrations [m]: none, the preset's, all of the blur."""
    scanner = Scanner()
    return {
        "all diffusion": 0.0,
        "preset": scanner.receiver.aberration,
        "all aberration": scanner.point_spread,
    }


def by_range() -> str:
    """Return the table of packets, contrast, error of the centroid and of the range."""
    receiver = Scanner().receiver
    head = (
        "| R | σ_b | packets | contrast of the charge | "
        + " | ".join(f"centroid, {name}" for name in shares())
        + " |"
    )
    rows = [head, "|---" * 7 + "|"]
    for R in (3.0, 10.0, 20.0):
        own = [spot(R, aberration) for aberration in shares().values()]
        packets = 1.0 / own[0].energy_variance
        errors = [math.sqrt(0.5) * one.centroid_sigma for one in own]
        slope = R**2 / (receiver.focal_length * receiver.baseline)
        cells = [f"{1e6 * error:.2f} µm, {1e3 * slope * error:.2g} mm" for error in errors]
        contrast = 100.0 * math.sqrt(0.5 / packets)
        rows.append(
            f"| {R:.0f} m | {1e6 * own[0].image:.1f} µm | {packets:.0f} | {contrast:.1f} % | "
            + " | ".join(cells)
            + " |"
        )
    return "\n".join(rows)


def by_estimator() -> str:
    """Return the table of estimators: errors in units of C λN, root mean square over the place in a pixel."""
    rows = ["| R | blur | centroid | " + " | ".join(_NAMES.values()) + " |", "|---" * (3 + len(_NAMES)) + "|"]
    for R in (2.5, 10.0):
        for name, aberration in list(shares().items())[:2]:
            own = spot(R, aberration)
            cells = [f"{own.centroid_sigma / own.cell:.2f}"]
            for estimator in _NAMES:
                squares = []
                for phase in (np.arange(6) + 0.5) / 6.0 - 0.5:
                    centre = _LINE // 2 + float(phase)
                    line = speckle.pixel_shares(1.0, centre, own.sigma / own.pitch, _LINE)
                    covariance = speckle.pixel_covariance(own, centre, _LINE)
                    squares.append(speckle.position_sigma(ESTIMATORS[estimator], line, covariance) ** 2)
                cells.append(f"{math.sqrt(float(np.mean(squares))) * own.pitch / own.cell:.2f}")
            rows.append(f"| {R:g} m | {name} | " + " | ".join(cells) + " |")
    return "\n".join(rows)


def by_travel() -> str:
    """Return the table of what a dwell leaves of the variances."""
    rows = [
        "| travel | energy | centroid, travel along the line | centroid, across it |",
        "|---|---|---|---|",
    ]
    for travel in (1.0, 2.0, 4.0, 8.0):
        energy, along = speckle.averaged((travel, 0.0), 1.0)
        across = speckle.averaged((0.0, travel), 1.0)[1]
        rows.append(f"| {travel:g} w | 1/{1.0 / energy:.2f} | 1/{1.0 / along:.1f} | 1/{1.0 / across:.2f} |")
    return "\n".join(rows)


def tables() -> str:
    """Return what stands on the page between its marks."""
    parts = (
        "One frozen pattern of the preset's beam at f/4, C = 1/√2; the spot of a point is 40 µm in all, shared out in "
        "three ways:",
        by_range(),
        "Estimators differ, because each reads another part of the spot. One frozen pattern, in units of C λN, to "
        "first order:",
        by_estimator(),
        "What a dwell leaves of the variances:",
        by_travel(),
    )
    return marked("docs/speckle.py", parts)


def main() -> None:
    """Rewrite the tables of the page."""
    rewrite(PAGE, tables())


if __name__ == "__main__":
    main()
