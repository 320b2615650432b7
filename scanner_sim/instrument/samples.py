"""What an instrument measured of some shots: columns of numbers by name, and the truth about them apart."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.channels import CHANNEL, Channel
from scanner_sim.ranging.ranges import Layers

if TYPE_CHECKING:
    import xarray

_TRUTH = "truth."


@dataclass(frozen=True, eq=False)
class Samples(Mapping[str, NDArray[Any]]):
    """Measurements of n shots by name, ``samples["range_m"]``, each of shape (n,).

    Names are those of an image's channels, and of ``own``. Columns without a prefix are of the instrument's first
    rangefinder. The truth is read by its whole name, ``samples["truth.range_m"]``, too.

    Attributes
    ----------
    measured
        What the instrument knows.
    truth
        What it does not know, by names without ``truth.``.
    own
        Columns beside those of an image: unit and meaning.
    """

    measured: Layers
    truth: Layers
    own: Mapping[str, Channel]

    @classmethod
    def in_order(cls, parts: Sequence[Samples], places: Sequence[NDArray[np.intp]]) -> Samples:
        """Return the shots of parts as one, those of each at its ``places``, shape (n,)."""
        order = np.argsort(np.concatenate(places))

        def together(columns: Sequence[Layers]) -> Layers:
            return {name: np.concatenate([one[name] for one in columns])[order] for name in columns[0]}

        measured, truth = ([getattr(part, of) for part in parts] for of in ("measured", "truth"))
        return cls(together(measured), together(truth), parts[0].own)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column.

        Raises
        ------
        KeyError
            If there is none of that name; the message names those that there are.
        """
        found = (self.truth if name.startswith(_TRUTH) else self.measured).get(name.removeprefix(_TRUTH))
        if found is None:
            raise KeyError(f"no column {name!r} in these samples; they have {', '.join(self)}")
        return found

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names: what was measured, then the truth."""
        yield from self.measured
        yield from (_TRUTH + name for name in self.truth)

    def __len__(self) -> int:
        """Return the number of columns."""
        return len(self.measured) + len(self.truth)

    def channel(self, name: str) -> Channel:
        """Return unit and meaning of a column."""
        return self.own[name] if name in self.own else CHANNEL[name]

    def to_xarray(self) -> xarray.Dataset:
        """Return the columns as an xarray dataset over ``shot``, with ``units`` and ``long_name``."""
        import xarray

        about = {name: self.channel(name) for name in self}
        return xarray.Dataset(
            {
                name: ("shot", values, {"units": about[name].unit, "long_name": about[name].meaning})
                for name, values in self.items()
            }
        )
