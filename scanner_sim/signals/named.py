"""Estimators of the user's own by the names of Python functions, for processes that must find them again."""

from __future__ import annotations

import os
from dataclasses import dataclass

from scanner_sim.foundation.own_function import OwnFunction
from scanner_sim.signals.processing import PEAKS
from scanner_sim.signals.waveform.settings import PULSES


@dataclass(frozen=True)
class NamedEstimators:
    """Functions for ``processing.peak`` and ``processing.pulse.timing``, each under its own name; None for none."""

    peak: OwnFunction | None = None
    pulse: OwnFunction | None = None

    @classmethod
    def of(cls, peak: str | None, pulse: str | None) -> NamedEstimators:
        """Return those of two options of the command line, ``module:function``; modules lie in the working folder."""
        return cls(*(None if name is None else OwnFunction(name, os.getcwd()) for name in (peak, pulse)))

    def register(self) -> list[str]:
        """Register the functions in this process; return the overrides by which a scenario takes them.

        Raises
        ------
        InputError
            If there is no such function, or its name is taken.
        """
        taken = []
        for function, estimators in ((self.peak, PEAKS), (self.pulse, PULSES)):
            if function is not None:
                estimators.register(function.short, function.load())
                taken.append(f"{estimators.key}={function.short}")
        return taken


NO_ESTIMATORS = NamedEstimators()
