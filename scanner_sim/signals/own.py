"""Estimators of the user's own: functions of NumPy arrays, by the names under which his own calls have put them here.

Nothing else fills the tables: no import, no file. What a function is given and must return is checked here; what it may
know stands in :mod:`~scanner_sim.signals.line.own_peak` and :mod:`~scanner_sim.signals.waveform.own_pulse`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationInfo, ValidatorFunctionWrapHandler, WithJsonSchema, WrapValidator
from pydantic_core import PydanticCustomError

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.own_function import FAILURES, failure
from scanner_sim.foundation.status import Status

Array = NDArray[np.float64]
Function = Callable[..., Any]
"""Of arrays and of what is known, to (place, σ, status) of each row."""

STORED: Final = {"stored": True}
"""Context of validation of what was simulated before: an estimator that is not registered here may be named in it."""

_NAME = r"^[A-Za-z_][A-Za-z0-9_]{0,63}$"
_SHOWN = 3
"""Rows that a message names."""


class OwnEstimators:
    """The user's estimators of one kind.

    Parameters
    ----------
    key
        Key of the scenario that names one.
    call, option
        How one is registered in Python and on the command line.
    built_in
        Names of the program's own.
    """

    def __init__(self, key: str, call: str, option: str, built_in: Collection[str]) -> None:
        self.key, self.call, self.option, self.built_in = key, call, option, tuple(built_in)
        self._functions: dict[str, Function] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """All names that are known: the program's, then the user's."""
        return (*self.built_in, *self._functions)

    def register(self, name: str, function: Function) -> None:
        """Put a function under a name.

        Raises
        ------
        InputError
            If the name is none, is taken by the program or by another function, or the function is none.
        """
        if not re.fullmatch(_NAME, str(name)):
            raise InputError(
                f"{name!r} is no name of an estimator.", remedy="Letters, digits and _ are possible."
            )
        if name in self.built_in:
            raise InputError(f"'{name}' is an estimator of the program.", remedy="Give yours another name.")
        if not callable(function):
            raise InputError(f"what was given for '{name}' is no function.", remedy="Give one.")
        if self._functions.setdefault(name, function) is not function:
            raise InputError(
                f"another function is registered as '{name}'.", remedy="Give this one another name."
            )

    def clear(self) -> None:
        """Forget all functions."""
        self._functions.clear()

    def function(self, name: str) -> Function | None:
        """Return the function of a name; None for an estimator of the program.

        Raises
        ------
        InputError
            If there is none of that name.
        """
        if name in self.built_in:
            return None
        if name not in self._functions:
            raise InputError(f"{self.key}: no estimator '{name}' is registered.", remedy=self.remedy)
        return self._functions[name]

    def is_own(self, name: str) -> bool:
        """Return whether a name is none of the program's."""
        return name not in self.built_in

    @property
    def remedy(self) -> str:
        """How an estimator becomes known, in words."""
        return (
            f"Register your own with scanner_sim.{self.call}(name, function), or on the command line with "
            f"{self.option} MODULE:FUNCTION."
        )

    @property
    def name_type(self) -> Any:
        """The type of a scenario's value that names one."""
        return Annotated[
            Literal[self.built_in],
            WrapValidator(self._validate),
            WithJsonSchema({"anyOf": [{"enum": list(self.built_in)}, {"type": "string", "pattern": _NAME}]}),
        ]

    def _validate(self, value: object, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> object:
        stored = isinstance(info.context, dict) and info.context.get("stored", False)
        if isinstance(value, str) and (value in self._functions or (stored and re.fullmatch(_NAME, value))):
            return value
        try:
            return handler(value)
        except ValueError:
            context = {"names": self.names, "remedy": self.remedy}
            raise PydanticCustomError("estimator", "no estimator of this name is known", context) from None


def estimated(
    name: str, function: Function, rows: int, *given: Any
) -> tuple[Array, Array, NDArray[np.uint32]]:
    """Return what a function of the user's makes of some rows: places, σ and status, each of shape (rows,).

    What is not valid has neither place nor σ: NaN.

    Raises
    ------
    InputError
        If the function fails, or returns anything but three arrays of that shape with codes of
        :class:`~scanner_sim.foundation.status.Status`, and a finite place and σ of 0 or more where the code is 0.
    """
    remedy = "It must return (position, sigma, status), one of each for every row."
    try:
        # Rows without a signal divide by it: what comes of that is looked at below.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            found = function(*given)
    except MemoryError:
        raise
    except FAILURES as error:
        raise InputError(
            f"the estimator '{name}' fails: {failure(error)}.", remedy="Try it by itself on a few rows."
        ) from error
    if not isinstance(found, tuple | list) or len(found) != 3:
        raise InputError(
            f"the estimator '{name}' returns a {type(found).__name__}, not three arrays.", remedy=remedy
        )
    try:
        place, sigma = (np.array(part, dtype=np.float64) for part in found[:2])
        status = np.asarray(found[2])
    except (TypeError, ValueError) as error:
        raise InputError(
            f"the estimator '{name}' returns what are no arrays: {error}.", remedy=remedy
        ) from None
    shapes = [part.shape for part in (place, sigma, status)]
    if shapes != [(rows,)] * 3:
        raise InputError(
            f"the estimator '{name}' returns arrays of the shapes {', '.join(map(str, shapes))} for {rows} rows.",
            remedy=remedy,
        )
    if status.dtype.kind not in "iu" or not np.isin(status, [int(code) for code in Status]).all():
        raise InputError(
            f"the estimator '{name}' returns a status that is no code of scanner_sim.Status.",
            remedy="Write for example np.where(found, Status.VALID, Status.BELOW_THRESHOLD).",
        )
    valid = status == Status.VALID
    refuse(name, valid & ~np.isfinite(place), "valid positions that are not finite")
    refuse(
        name,
        valid & ~(np.isfinite(sigma) & (sigma >= 0.0)),
        "valid positions whose σ is no number of 0 or more",
    )
    place[~valid] = sigma[~valid] = np.nan
    return place, sigma, status.astype(np.uint32)


def refuse(name: str, wrong: NDArray[np.bool_], what: str) -> None:
    """Raise an InputError where an estimator returned for any row what it must not."""
    if wrong.any():
        rows = ", ".join(map(str, np.flatnonzero(wrong)[:_SHOWN]))
        raise InputError(
            f"the estimator '{name}' returns {what}, {int(wrong.sum())} of {wrong.size}, as of row {rows}.",
            remedy="Give such a row another status than VALID, as Status.BELOW_THRESHOLD.",
        )


def row_sums(values: Array) -> Array:
    """Return the sum of each row of values, shape (n, m), in their order: zeros at either end change no bit of it."""
    return np.asarray(np.add.accumulate(values, axis=1)[:, -1])
