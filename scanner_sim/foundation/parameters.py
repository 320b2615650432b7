"""The parameters by which an instrument departs from its design: their names, units and order, once for all rooms.

Each is a *deviation*: what ``scanner`` says of the instrument is its design, and a parameter is added to it. The
instrument as built has true ones (:mod:`scanner_sim.optics.as_built`), a calibration believed ones
(:mod:`scanner_sim.ranging.calibration`). Signs are drawn in the page *The error model*.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from scanner_sim.foundation.units import Dimension


@dataclass(frozen=True)
class InstrumentParameter:
    """One way in which an instrument departs from its design.

    Attributes
    ----------
    name
        Name in files and arrays.
    dimension
        Unit in which a file gives it; inside it is SI.
    meaning
        What it does, in one sentence.
    sources
        Ways of ranging whose points it moves: ``triangulation``, ``tof``.
    """

    name: str
    dimension: Dimension
    meaning: str
    sources: tuple[str, ...] = ("triangulation", "tof")


_LENGTH = Dimension("m", ("0.1 mm",), ("mm", "um", "m", "nm"))
_ANGLE = Dimension("rad", ("50 urad",), ("urad", "mrad", "rad", "deg"))
_RATIO = Dimension("1", (1e-4, "100 ppm"))
_CUBIC = Dimension("rad^-2", ("1e-4 rad^-2",))
_LINE, _PULSE = ("triangulation",), ("tof",)

# fmt: off
PARAMETERS: Final = (
    InstrumentParameter("base", _LENGTH, "the lens's node is farther from the laser's axis than designed"),
    InstrumentParameter("focal_length", _LENGTH, "the image distance is longer than designed", _LINE),
    InstrumentParameter("axis_separation", _LENGTH, "the second axis is farther from the first one than designed"),
    InstrumentParameter("axis_offset", _LENGTH, "the second axis passes below the beam (towards +y)"),
    InstrumentParameter("axis_skew", _ANGLE, "the second axis is turned about z, from +x towards +y: it is not square "
                        "to the first"),
    InstrumentParameter("theta_zero", _ANGLE, "the beam points further along Θ than the encoder reads"),
    InstrumentParameter("phi_zero", _ANGLE, "the beam points further along φ than the encoder reads"),
    InstrumentParameter("theta_scale", _RATIO, "the same, growing with Θ"),
    InstrumentParameter("phi_scale", _RATIO, "the same, growing with φ"),
    InstrumentParameter("theta_cubic", _CUBIC, "the same, growing with Θ³"),
    InstrumentParameter("phi_cubic", _CUBIC, "the same, growing with φ³"),
    InstrumentParameter("theta_sine", _ANGLE, "amplitude of the same, as sin(2π Θ/encoder_period)"),
    InstrumentParameter("theta_cosine", _ANGLE, "amplitude of the same, as cos(2π Θ/encoder_period)"),
    InstrumentParameter("phi_sine", _ANGLE, "amplitude of the same, as sin(2π φ/encoder_period)"),
    InstrumentParameter("phi_cosine", _ANGLE, "amplitude of the same, as cos(2π φ/encoder_period)"),
    InstrumentParameter("array_offset", _LENGTH, "the array is shifted towards nearer ranges (+p)", _LINE),
    InstrumentParameter("array_scale", _RATIO, "the pixels are wider apart, relative to their pitch", _LINE),
    InstrumentParameter("array_tilt", _ANGLE, "the array's near end (+p) leans away from the lens", _LINE),
    InstrumentParameter("radial_1", _RATIO, "radial distortion k₁ of the lens, of (p/f)³", _LINE),
    InstrumentParameter("radial_2", _RATIO, "radial distortion k₂ of the lens, of (p/f)⁵", _LINE),
    InstrumentParameter("tangential", _RATIO, "tangential distortion p₂ of the lens, along the line", _LINE),
    InstrumentParameter("tof_zero", _LENGTH, "time of flight reads this much too far", _PULSE),
    InstrumentParameter("tof_scale", _RATIO, "delays read too long, relative to themselves", _PULSE),
)
# fmt: on
"""All of them; arrays of parameters have them in this order along their last axis."""

NAMES: Final = tuple(parameter.name for parameter in PARAMETERS)
INDEX: Final = {name: number for number, name in enumerate(NAMES)}
PERIODIC: Final = ("theta_sine", "theta_cosine", "phi_sine", "phi_cosine")
"""Those that need the period of the encoders."""
THETA_ERRORS: Final = [INDEX[f"theta_{part}"] for part in ("zero", "scale", "cubic", "sine", "cosine")]
"""Those of the encoder of Θ, in the order of :mod:`~scanner_sim.optics.encoder_errors`."""
PHI_ERRORS: Final = [INDEX[f"phi_{part}"] for part in ("zero", "scale", "cubic", "sine", "cosine")]
"""Those of the encoder of φ."""
