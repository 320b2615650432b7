"""How the echo in a waveform is found and timed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

from pydantic import Field

from scanner_sim.foundation.parts import Part, Switch
from scanner_sim.foundation.units import Current, Ratio
from scanner_sim.signals.own import Function, OwnEstimators

TIMINGS = ("matched_filter", "leading_edge", "constant_fraction", "gaussian_fit")
"""How the program times an echo."""
PULSES = OwnEstimators("processing.pulse.timing", "register_pulse", "--pulse", TIMINGS)
"""Timings beside them that the user has registered."""

if TYPE_CHECKING:
    Timing: TypeAlias = str
else:
    Timing = PULSES.name_type


def register_pulse(name: str, function: Function) -> None:
    """Make a function of your own a timing of echoes: ``processing.pulse.timing: name``.

    Parameters
    ----------
    name
        Letters, digits and _.
    function
        Called as ``function(records, known)`` with some hundreds to thousands of waveforms at a time: ``records`` their
        currents [A], float64 of shape (n, samples); ``known`` a
        :class:`~scanner_sim.signals.waveform.own_pulse.KnownRecords`. It returns (delay, sigma, status) of each record,
        each of shape (n,): the time [s] at which the centroid of the pulse comes back, by ``known.time``, its standard
        deviation [s] without that of the clock, and a code of :class:`~scanner_sim.foundation.status.Status`. It must
        treat each record by itself, and alike whenever it is called.

    Raises
    ------
    InputError
        If the name is none, is taken by the program or by another function, or the function is none.

    Notes
    -----
    The function finds the echo, tells what is none, and states σ by itself: of the other keys of
    ``processing.pulse`` only ``false_alarms`` counts then, for the threshold that the function is told. The name is
    known in this process alone.
    """
    PULSES.register(name, function)


class PulseDetection(Part):
    """Settings of the time-of-flight detection."""

    timing: Timing = "matched_filter"
    """How an echo is timed; ``matched_filter`` comes nearest to the Cramér–Rao bound. Or the name of a function of your
    own, see the guide *Your own estimator*."""
    echo: Literal["first", "last", "strongest"] = "strongest"
    """Which one counts where there are several."""
    false_alarms: Ratio = Field(default=1e-4, ge=1e-12, le=0.5)
    """Probability that the noise of a record without any echo is taken for one; it sets the threshold."""
    level: Current | None = Field(default=None, gt=0.0, le=10.0)
    """Current whose crossing ``leading_edge`` times; by default the threshold in the dark."""
    walk_correction: Switch = True
    """Correct ``leading_edge`` for the amplitude, by a table over the time above the level."""
    fraction: Ratio = Field(default=0.5, ge=0.05, le=0.95)
    """Fraction of the peak whose crossing ``constant_fraction`` times."""
    overlap: Switch = True
    """Refuse pulses that are wider than any one surface makes them: echoes of two overlap, and their delay is of
    neither."""
