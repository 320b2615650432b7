"""A Python function of the user's own, named on the command line and nowhere else.

No file names one, so that opening a scenario, a plan or a result of somebody else's runs no code.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from scanner_sim.foundation.errors import InputError

FAILURES = (Exception, SystemExit)
"""What a function of the user's own may raise that is a fault of it: ``sys.exit`` would end the program without a
word."""


@dataclass(frozen=True)
class OwnFunction:
    """A function by its name, ``module:function``, and the folder in which the module is looked for first."""

    name: str
    folder: str

    @property
    def short(self) -> str:
        """Name of the function without its module."""
        return self.name.partition(":")[2]

    def load(self) -> Callable[..., Any]:
        """Return the function.

        Raises
        ------
        InputError
            If there is no such module or function, or the module fails while it is imported.
        MemoryError
            If memory is exhausted meanwhile, which is no fault of the module.
        """
        module, _, function = self.name.partition(":")
        if not module or module.startswith(".") or not function.isidentifier():
            raise InputError(
                f"'{self.name}' is not MODULE:FUNCTION.", remedy="Write for example my_module:my_function."
            )
        if sys.path[:1] != [self.folder]:
            sys.path.insert(0, self.folder)
        try:
            imported = importlib.import_module(module)
        except MemoryError:
            raise
        except FAILURES as error:
            if isinstance(error, ModuleNotFoundError) and f"{module}.".startswith(f"{error.name}."):
                raise InputError(f"there is no module {module}.", remedy="Start where it lies.") from None
            raise InputError(
                f"the module {module} cannot be imported: {failure(error)}.",
                remedy="Try it in Python by itself.",
            ) from error
        found = getattr(imported, function, None)
        if not callable(found):
            place = getattr(imported, "__file__", None) or "part of Python"
            raise InputError(
                f"the module {module} has no function {function}.",
                remedy=f"Check its name; the module that was imported is {place}.",
            )
        return found  # type: ignore[no-any-return]


def failure(error: BaseException) -> str:
    """Return what a function of the user's own raised, in words."""
    return f"{type(error).__name__}: {error}".removesuffix(": ")
