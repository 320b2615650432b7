"""What was measured of patterns: the columns that a tracker looks at, and all others for who asks for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.instrument.samples import Samples
from scanner_sim.ranging.ranges import Columns, Layers


@dataclass(frozen=True, eq=False)
class PatternColumns(Mapping[str, NDArray[Any]]):
    """Columns of n shots by name, each of shape (n,): those of :class:`~scanner_sim.instrument.samples.Samples`.

    Points, their covariances and the truth cost a tracker more than its ranges, and it never asks for them.

    Attributes
    ----------
    fetch
        Returns the columns that a tracker looks at: it waits for the kernels that make them.
    make
        Makes all columns, these too.
    """

    fetch: Callable[[], Columns]
    make: Callable[[], Samples]

    @cached_property
    def at_hand(self) -> Columns:
        """Columns that a tracker looks at."""
        return self.fetch()

    @cached_property
    def whole(self) -> Samples:
        """All columns."""
        return self.make()

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column; where there is none of that name, KeyError says which there are."""
        return self.at_hand[name] if name in self.at_hand else self.whole[name]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of all columns."""
        return iter(self.whole)

    def __len__(self) -> int:
        """Return the number of all columns."""
        return len(self.whole)

    @classmethod
    def of(cls, samples: Samples) -> PatternColumns:
        """Return those of samples."""
        return cls(lambda: samples.measured, lambda: samples)

    @classmethod
    def joined(cls, parts: Sequence[tuple[PatternColumns, int]]) -> PatternColumns:
        """Return the first shots of parts, so many of each, one after the other."""
        counts = [shots for _, shots in parts]

        def beside(columns: Sequence[Columns]) -> Layers:
            return {
                name: np.concatenate([own[name][:shots] for own, shots in zip(columns, counts, strict=True)])
                for name in columns[0]
            }

        def whole() -> Samples:
            every = [part.whole for part, _ in parts]
            measured, truth = ([getattr(one, of) for one in every] for of in ("measured", "truth"))
            return Samples(beside(measured), beside(truth), every[0].own)

        return cls(lambda: beside([part.at_hand for part, _ in parts]), whole)
