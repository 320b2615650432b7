"""Real orbits from two-line elements: SGP4 for the satellite, ERFA for the Sun; neither downloads anything.

Both libraries are loaded when first used.
"""

from __future__ import annotations

import math
import warnings
from datetime import datetime
from typing import Any

import erfa
import numpy as np
from numpy.typing import NDArray
from sgp4.api import SGP4_ERRORS, Satrec, jday

from scanner_sim.scene.light.earth import EARTH_RADIUS


def elements_fault(line1: str, line2: str) -> tuple[str, str] | None:
    """Return which of two lines of orbital elements is at fault ("line1", "line2"), and why; None for good ones."""
    for name, line, number in (("line1", line1, "1"), ("line2", line2, "2")):
        if len(line) != 69 or line[0] != number:
            return (
                name,
                f"it has {len(line)} characters and begins with '{line[:1]}'; 69 and '{number}' are wanted.",
            )
        total = sum(int(sign) if sign.isdecimal() else sign == "-" for sign in line[:68])
        if line[68] != str(total % 10):
            return name, f"its checksum is {total % 10}, but it ends in {line[68]}: a digit is wrong."
    if line1[2:7] != line2[2:7]:
        return "line2", f"it belongs to satellite {line2[2:7]}, the first line to {line1[2:7]}."
    try:
        satellite = _satellite(line1, line2)
    except ValueError as error:
        return "line1", f"it cannot be read: {error}."
    return None if satellite.error == 0 else ("line2", "it describes no orbit that SGP4 can follow.")


def elements_period(line1: str, line2: str) -> float:
    """Return the period [s] of an orbit from its mean motion."""
    return 60.0 * 2.0 * math.pi / float(_satellite(line1, line2).no_kozai)


def elements_age(line1: str, line2: str, time: datetime) -> float:
    """Return how long ago the elements were measured at ``time`` [s]; SGP4 errs by kilometres after days."""
    satellite = _satellite(line1, line2)
    whole, part = jday(*time.timetuple()[:6])
    return 86400.0 * float(whole - satellite.jdsatepoch + part - satellite.jdsatepochF)


def sun_from_elements(
    line1: str, line2: str, time: datetime, after: float = 0.0
) -> tuple[NDArray[np.float64], float]:
    """Return the direction to the Sun along the local axes, shape (3,), and the altitude [m].

    Parameters
    ----------
    line1, line2
        Two-line elements.
    time
        UTC.
    after
        Seconds after that.

    Returns
    -------
    direction, altitude
        Geometric direction from the Earth's centre: aberration (20″) and parallax (9″) are left out, against
        16′ of the Sun's radius. The altitude counts from the mean sphere.

    Raises
    ------
    ValueError
        If the orbit has decayed by then, or SGP4 cannot follow it for another reason.

    Notes
    -----
    SGP4 of Vallado et al. (AIAA 2006-6753) in the frame TEME. The Sun is ERFA's ``epv00`` (good to 1e-6 rad,
    1900 to 2100), turned to the true equator of date by the IAU 2006/2000A precession and nutation, and to
    its mean equinox by the equation of the equinoxes.
    """
    whole, part = jday(*time.timetuple()[:6])
    part += (1e-6 * time.microsecond + after) / 86400.0
    error, position, velocity = _satellite(line1, line2).sgp4(whole, part)
    if error:
        raise ValueError(str(SGP4_ERRORS[error]))
    r, v = np.array(position), np.array(velocity)
    nadir = -r / np.linalg.norm(r)
    starboard = np.cross(v, r)
    starboard /= np.linalg.norm(starboard)
    axes = np.stack([np.cross(starboard, nadir), starboard, nadir])
    return axes @ _sun_in_teme(whole, part), 1e3 * float(np.linalg.norm(r)) - EARTH_RADIUS


def _satellite(line1: str, line2: str) -> Any:
    return Satrec.twoline2rv(line1, line2)


def _sun_in_teme(whole: float, part: float) -> NDArray[np.float64]:
    """Return the direction to the Sun at a Julian date (UTC), true equator and mean equinox of date, (3,)."""
    with warnings.catch_warnings():
        # Beyond its table of leap seconds ERFA warns; the Sun moves by 0.04″ in a second.
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        tt = erfa.taitt(*erfa.utctai(whole, part))
    from_earth, _ = erfa.epv00(*tt)
    teme_from_gcrs = erfa.rz(erfa.ee06a(*tt), erfa.pnm06a(*tt))
    sun = -np.asarray(teme_from_gcrs @ from_earth["p"], dtype=np.float64)
    return np.asarray(sun / np.linalg.norm(sun))
