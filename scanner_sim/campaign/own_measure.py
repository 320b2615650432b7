"""A measure of the user's own: a Python function, named on the command line and nowhere else.

No file names one, so that opening a plan or a campaign of somebody else's runs no code.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from scanner_sim.campaign.measures import MEASURES, Outcome
from scanner_sim.foundation.errors import InputError


@dataclass(frozen=True)
class OwnMeasure:
    """A function by its name, ``module:function``, and the folder in which the module is looked for first."""

    name: str
    folder: str

    @property
    def column(self) -> str:
        """Name of the column: that of the function."""
        return self.name.partition(":")[2]

    def load(self) -> Callable[[Any], float]:
        """Return the function: of an image, a table of shots or a track it makes a number.

        Raises
        ------
        InputError
            If there is no such module or function, or a measure of the program has its name.
        """
        module, _, function = self.name.partition(":")
        if not module or not function.isidentifier():
            raise InputError(
                f"'{self.name}' is not MODULE:FUNCTION.", remedy="Write for example my_measures:edge."
            )
        if function in MEASURES:
            raise InputError(f"'{function}' is a measure of the program.", remedy="Give yours another name.")
        if self.folder not in sys.path:
            sys.path.insert(0, self.folder)
        try:
            found = getattr(importlib.import_module(module), function, None)
        except ImportError as error:
            raise InputError(
                f"the module {module} cannot be imported: {error}.", remedy="Start where it lies."
            ) from None
        if not callable(found):
            raise InputError(f"the module {module} has no function {function}.", remedy="Check its name.")
        return found  # type: ignore[no-any-return]

    def value(self, outcome: Outcome) -> float:
        """Return the number that the function makes of a run."""
        return float(self.load()(outcome.scan if outcome.track is None else outcome.track))
