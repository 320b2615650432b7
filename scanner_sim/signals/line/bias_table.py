"""Tables of an estimator's systematic error, and the files that hold them.

A table holds the error of a position, estimate − truth, as a function of what decides it: how far the estimate lies
from the centre of the brightest pixel, and the spot's width. It is a table of the *estimate*, because that is what is
known when it is used.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.named_files import read_text_file

HEADING = "# scanner-sim: systematic error of a peak estimator, 1"
COLUMNS = ("width_px", "shift_px", "bias_px")
LARGEST_BIAS = 1.0
"""Largest error that a table holds, to both sides [pixel]."""
_LARGEST = 10_000
"""Lines of the largest file that is read."""
_LONGEST = 1000
"""Bytes of a line, on average."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BiasTable:
    """Systematic error of an estimator.

    Attributes
    ----------
    estimator
        Its name in scenarios.
    widths
        Standard deviations of the spot [pixel], ascending, shape (n,).
    shifts
        Estimates, counted from the centre of the brightest pixel [pixel], ascending, shape (m,).
    bias
        Estimate − truth [pixel], shape (n, m). Between the nodes it is linear, beyond them constant.
    """

    estimator: str
    widths: Floats
    shifts: Floats
    bias: Floats

    def at(self, widths: Floats, shifts: Floats) -> Floats:
        """Return the error on a grid of other widths (k,) and shifts (l,): shape (k, l)."""
        along = np.stack([np.interp(shifts, self.shifts, row) for row in self.bias])
        return np.stack([np.interp(widths, self.widths, column) for column in along.T], axis=1)


def invert(estimate: Floats, truth: Floats, shifts: Floats) -> Floats:
    """Return the error at given estimates from estimates at given truths.

    Parameters
    ----------
    estimate, truth
        Estimates and true positions of the spot, both from the centre of one pixel [pixel], shape (k,), ``truth``
        ascending.
    shifts
        Estimates at which the error is wanted, shape (m,).

    Returns
    -------
    ndarray
        Estimate − truth, shape (m,). The stretch about the pixel's centre in which the estimate ascends with the
        truth counts; beyond it the error is that of its ends.
    """
    rises = np.isfinite(estimate[:-1]) & (np.diff(estimate) > 0.0)
    middle = int(np.argmin(np.abs(truth)))
    falls_after, falls_before = np.flatnonzero(~rises[middle:]), np.flatnonzero(~rises[:middle])
    last = middle + int(falls_after[0]) if falls_after.size else len(truth) - 1
    first = int(falls_before[-1]) + 1 if falls_before.size else 0
    part = slice(first, last + 1)
    return np.asarray(np.interp(shifts, estimate[part], (estimate - truth)[part]), dtype=np.float64)


def write_bias(table: BiasTable, path: Path) -> None:
    """Write a table as CSV.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(f"{HEADING}\n# estimator: {table.estimator}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for width, row in zip(table.widths, table.bias, strict=True):
            for shift, value in zip(table.shifts, row, strict=True):
                writer.writerow((f"{width:.6g}", f"{shift:.6g}", f"{value:.6f}"))


def read_bias(path: Path) -> BiasTable:
    """Read a table that :func:`write_bias` wrote.

    Raises
    ------
    InputError
        If the file is no such table.
    """
    remedy = "Make one: scanner-sim calibrate CONFIG -o bias.csv"
    lines = read_text_file(path, _LARGEST * _LONGEST).splitlines()
    name = lines[1].removeprefix("# estimator: ") if len(lines) > 3 else ""
    if len(lines) > _LARGEST or not name or lines[0] != HEADING or lines[2] != ",".join(COLUMNS):
        raise InputError(f"{path} is no table of an estimator's systematic error.", remedy=remedy)
    try:
        values = np.array([[float(word) for word in line.split(",")] for line in lines[3:]])
        widths, shifts = np.unique(values[:, 0]), np.unique(values[:, 1])
        bias = values[:, 2].reshape(len(widths), len(shifts))
        grid = np.stack(np.meshgrid(widths, shifts, indexing="ij"), axis=-1).reshape(-1, 2)
        whole = np.isfinite(values).all() and np.array_equal(values[:, :2], grid) and widths[0] > 0.0
    except (ValueError, IndexError):
        whole = False
    if not whole or len(shifts) < 3 or np.abs(bias).max() > LARGEST_BIAS:
        raise InputError(f"{path} has lines that are missing, out of order or not possible.", remedy=remedy)
    return BiasTable(name, widths, shifts, bias)
