"""A measure of the user's own: a function of a result that is a number, named on the command line."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

from scanner_sim.campaign.measures import MEASURES, Outcome
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.own_function import FAILURES, OwnFunction, failure


@dataclass(frozen=True)
class OwnMeasure:
    """A function that makes a number of an image, a table of shots or a track."""

    function: OwnFunction

    @property
    def column(self) -> str:
        """Name of the column: that of the function."""
        return self.function.short

    def load(self) -> Callable[[Any], float]:
        """Return the function.

        Raises
        ------
        InputError
            If there is no such module or function, or a measure of the program has its name.
        """
        if self.column in MEASURES:
            raise InputError(
                f"'{self.column}' is a measure of the program.", remedy="Give yours another name."
            )
        return self.function.load()

    def check(self, columns: Collection[str]) -> None:
        """Raise an InputError if another column of the campaign has its name."""
        if self.column in columns:
            raise InputError(
                f"'{self.column}' is a column of the campaign already.",
                remedy="Give your measure another name.",
            )

    def value(self, outcome: Outcome) -> float:
        """Return the number that the function makes of a run.

        Raises
        ------
        InputError
            If the function fails, or returns no number.
        """
        function = self.load()
        try:
            found = function(outcome.scan if outcome.track is None else outcome.track)
        except MemoryError:
            raise
        except FAILURES as error:
            raise InputError(
                f"the measure '{self.column}' fails: {failure(error)}.",
                remedy="Try it by itself on a kept run.",
            ) from error
        try:
            return float(found)
        except (TypeError, ValueError, OverflowError):
            raise InputError(
                f"the measure '{self.column}' returns a {type(found).__name__}, not a number.",
                remedy="Return one number, NaN where there is none.",
            ) from None
