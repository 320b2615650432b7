"""The interference filter: what passes at which wavelength and incidence.

The filter stands before the lens, so light that images at p has met it at the incidence atan(p/f); see
:func:`incidence`. All transmissions here are relative to the filter's peak, which counts with the lens.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Discriminator, Field, Tag

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Count, Number, Part
from scanner_sim.foundation.units import Length, Ratio
from scanner_sim.optics.laser import Laser

Floats = NDArray[np.float64]


class BandpassFilter(Part):
    """An interference filter in front of the lens."""

    transmission: Ratio = Field(default=1.0, gt=0.0, le=1.0)
    """Peak transmission."""
    centre: Length | None = Field(default=None, ge=0.2e-6, le=30e-6)
    """Centre of the pass band at normal incidence; by default the laser's nominal wavelength."""
    bandwidth: Length = Field(default=30e-9, ge=1e-11, le=2e-6)
    """Full width of the pass band at half of its peak."""
    shape: Literal["tophat", "cavities"] = "tophat"
    """``tophat`` as in eq 18, or the rounded edges of a filter of several ``cavities``."""
    cavities: Count = Field(default=3, ge=2, le=10)
    """Number of coupled cavities: more make steeper edges. Without meaning for ``tophat``."""
    blocking: Ratio = Field(default=1e-6, ge=0.0, le=0.1)
    """Transmission outside of the pass band, relative to the peak: ``-60 dB``."""
    effective_index: Number = Field(default=2.0, gt=1.0, le=4.0)
    """Effective index of refraction: a high one shifts less with incidence."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a band that reaches to the wavelength zero."""
        if self.centre is not None and self.bandwidth >= self.centre:
            yield Fault(
                "bandwidth",
                f"a band of {1e9 * self.bandwidth:g} nm is wider than its centre of {1e9 * self.centre:g} nm.",
                "Reduce it, or write 'filter: none'.",
            )


FilterChoice = Annotated[
    Annotated[Literal["none"], Tag("(word)")] | Annotated[BandpassFilter, Tag("(filter)")],
    Discriminator(lambda value: "(word)" if isinstance(value, str) else "(filter)"),
    Field(examples=[{"bandwidth": "10 nm"}]),
]
"""A filter, or ``none``: then everything passes that the detector responds to."""


def peak_transmission(filter: FilterChoice) -> float:  # noqa: A002 (the name of the part in a scenario)
    """Return the largest transmission: 1 without a filter."""
    return 1.0 if filter == "none" else filter.transmission


def incidence(position: ArrayLike, focal_length: float) -> Floats:
    """Return the incidence [rad] of light that images at the position p [m]: atan(p/f)."""
    return np.arctan(np.asarray(position, dtype=np.float64) / focal_length)


def centre_at(centre: float, effective_index: float, incidence: ArrayLike) -> Floats:
    """Return the centre of the pass band [m] at an incidence [rad]: λ₀ √(1 − sin²θ/n²).

    ``centre`` is the one at normal incidence [m]; the shape of ``incidence`` is kept. Source: Macleod,
    *Thin-Film Optical Filters*, 4th ed., 2010, section 8.2.4. The width is taken to stay, which holds to
    about 20°.
    """
    sine = np.sin(np.asarray(incidence, dtype=np.float64))
    return np.asarray(centre * np.sqrt(1.0 - (sine / effective_index) ** 2))


def passband(
    filter: FilterChoice,  # noqa: A002
    wavelength: ArrayLike,
    incidence: ArrayLike = 0.0,
    *,
    nominal: float,
) -> Floats:
    """Return the pass band's share of the peak transmission, 0 to 1, blocking left out.

    Parameters
    ----------
    filter
        The filter, or ``none``: 1 everywhere.
    wavelength, incidence
        Wavelength [m] and angle [rad]; they broadcast.
    nominal
        The laser's nominal wavelength [m], the centre of a filter that has none of its own.

    Returns
    -------
    ndarray
        Broadcast shape. With x = 2 (λ − λ_c)/Δλ: ``tophat`` is 1 for |x| ≤ 1 and 0 elsewhere; ``cavities`` is
        1/(1 + x^2m), the maximally flat response of m cavities (Baumeister, *Optical Coating Technology*,
        2004, ch. 7; for m = 1 it is the line of a single Fabry–Perot cavity).
    """
    wavelength, incidence = np.broadcast_arrays(
        np.asarray(wavelength, dtype=np.float64), np.asarray(incidence, dtype=np.float64)
    )
    if filter == "none":
        return np.ones(wavelength.shape)
    centre = centre_at(centre_of(filter, nominal), filter.effective_index, incidence)
    return band_shape(filter, 2.0 * (wavelength - centre) / filter.bandwidth)


def laser_gain(
    filter: FilterChoice,  # noqa: A002
    laser: Laser,
    response: tuple[float, float],
    incidence: ArrayLike = 0.0,
) -> Floats:
    """Return how much of the laser's light counts, as a share of the peak; shape of ``incidence`` [rad].

    The line is where it drifted to, infinitely narrow. Outside of the pass band the blocking is left, outside
    of the detector's ``response`` [m] nothing.
    """
    inside = passband(filter, laser.line, incidence, nominal=laser.wavelength)
    leak = 0.0 if filter == "none" else filter.blocking
    seen = response[0] <= laser.line <= response[1]
    return np.asarray(seen * (inside + leak * (1.0 - inside)))


def filter_warnings(
    filter: FilterChoice,  # noqa: A002
    laser: Laser,
    response: tuple[float, float],
    largest_incidence: float = 0.0,
    detector: str = "position_sensor",
) -> tuple[str, ...]:
    """Return a sentence for each reason why the detector would not see the laser.

    Parameters
    ----------
    filter, laser
        The filter and the laser.
    response
        Wavelengths to which the detector responds [m].
    largest_incidence
        Incidence [rad] at which the array ends.
    detector
        The detector's key within the scanner.
    """
    line = f"{1e9 * laser.line:.6g} nm"
    if not response[0] <= laser.line <= response[1]:
        return (
            f"scanner.{detector}.response: the laser's {line} lies outside of it, so no voxel will have a return",
        )
    gains = laser_gain(filter, laser, response, np.array([0.0, largest_incidence]))
    if filter == "none" or gains.min() >= 0.5:
        return ()
    centre = centre_of(filter, laser.wavelength)
    low, high = 1e9 * (centre - 0.5 * filter.bandwidth), 1e9 * (centre + 0.5 * filter.bandwidth)
    if gains[0] < 0.5:
        weak = "hardly any voxel will have a return" if gains[0] < 1e-2 else "most of the light is lost"
        return (
            f"scanner.filter: its band of {low:.6g} nm to {high:.6g} nm misses the laser's {line}, so {weak}",
        )
    shifted = 1e9 * float(centre_at(centre, filter.effective_index, largest_incidence))
    return (
        f"scanner.filter: at {math.degrees(largest_incidence):.3g} deg, where near ranges image, its centre shifts to "
        f"{shifted:.6g} nm and the band misses the laser's {line}",
    )


def centre_of(filter: BandpassFilter, nominal: float) -> float:  # noqa: A002
    """Return the centre of the pass band at normal incidence [m]; ``nominal`` is the laser's wavelength."""
    return nominal if filter.centre is None else filter.centre


def band_shape(filter: BandpassFilter, x: Floats) -> Floats:  # noqa: A002
    """Return the pass band at x half widths from its centre."""
    if filter.shape == "tophat":
        return np.asarray((np.abs(x) <= 1.0).astype(np.float64))
    # Beyond 1e6 half widths nothing is left, and powers would overflow.
    return np.asarray(1.0 / (1.0 + np.minimum(np.abs(x), 1e6) ** (2 * filter.cavities)))
