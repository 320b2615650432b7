"""Estimators of a user's own for tests: ten lines of NumPy each, as the guide has them, and wrong ones."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.status import Status

Array = NDArray[np.float64]
Told = tuple[Array, Array, NDArray[np.int64]]


def gaussian_copy(lines: Array, known: Any) -> Told:
    """The program's ``gaussian`` without validation, baseline, speckle and correction, in double precision."""
    rows, brightest = np.arange(len(lines)), lines.argmax(axis=1)
    floor = np.sqrt(known.read_noise**2 + known.gain**2 / 12.0 + known.dark)
    centre = np.clip(brightest, 1, lines.shape[1] - 2)
    near = centre[:, None] + [-1, 0, 1]
    charge = np.maximum(lines[rows[:, None], near], 0.5 * floor)
    left, middle, right = np.log(charge).T
    curvature = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / curvature
    slope = np.stack([1.0 - 2.0 * shift, 4.0 * shift, -1.0 - 2.0 * shift], axis=1)
    slope = slope / (2.0 * curvature[:, None] * charge)
    sigma = np.sqrt(np.sum(slope**2 * known.variance[rows[:, None], near], axis=1))
    status = np.full(len(lines), Status.VALID, dtype=np.int64)
    status[(np.abs(shift) > 1.0) | (centre != brightest)] = Status.OUT_OF_ARRAY
    beside = np.abs(np.arange(lines.shape[1]) - brightest[:, None]) <= 3
    status[(known.saturated & beside).any(axis=1)] = Status.SATURATED
    status[~(lines[rows, brightest] > known.threshold * floor)] = Status.BELOW_THRESHOLD
    return centre + shift, sigma, status


def centroid(lines: Array, known: Any) -> Told:
    """Centre of mass of the seven pixels about the brightest one."""
    pixel, brightest = np.arange(lines.shape[1]), lines.argmax(axis=1)
    used = np.abs(pixel - brightest[:, None]) <= 3
    charge = np.where(used, lines, 0.0)
    total = charge.sum(axis=1)
    position = (charge * pixel).sum(axis=1) / total
    gradient = used * (pixel - position[:, None]) / total[:, None]
    sigma = known.position_sigma(gradient, position, total)
    found = lines.max(axis=1) > known.threshold * np.sqrt(known.variance.min(axis=1))
    full = (known.saturated & used).any(axis=1)
    status = np.where(found, np.where(full, Status.SATURATED, Status.VALID), Status.BELOW_THRESHOLD)
    return position, sigma, status


def centroid_of_line(line: Array) -> float:
    """Its closed form: the position that it tells of a line without noise."""
    used = np.abs(np.arange(line.size) - line.argmax()) <= 3
    return float((line * used) @ np.arange(line.size) / (line @ used))


def overconfident(lines: Array, known: Any) -> Told:
    """The same with σ too small by 30 %."""
    position, sigma, status = centroid(lines, known)
    return position, 0.7 * sigma, status


def biased(lines: Array, known: Any) -> Told:
    """The same, too far by half its σ."""
    position, sigma, status = centroid(lines, known)
    return position + 0.5 * sigma, sigma, status


def blundering(lines: Array, known: Any) -> Told:
    """The same, wrong in all that it tells: three pixels away, with twice its σ, blind for full pixels."""
    position, sigma, status = centroid(lines, known)
    moved = np.where(position > 0.5 * lines.shape[1], position - 3.0, position + 3.0)
    return moved, 2.0 * sigma, np.where(status == Status.SATURATED, Status.VALID, status)


def pulse_vertex(records: Array, known: Any) -> Told:
    """The top of the Gaussian through the highest sample and its neighbours."""
    rows, top = np.arange(len(records)), np.clip(records.argmax(axis=1), 1, records.shape[1] - 2)
    near = top[:, None] + [-1, 0, 1]
    height = np.maximum(records[rows[:, None], near], 0.01 * known.step)
    left, middle, right = np.log(height).T
    curvature = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / curvature
    slope = np.stack([1.0 - 2.0 * shift, 4.0 * shift, -1.0 - 2.0 * shift], axis=1)
    step = known.time[1] - known.time[0]
    gradient = np.zeros(records.shape)
    gradient[rows[:, None], near] = step * slope / (2.0 * curvature[:, None] * height)
    found = (height[:, 1] > known.threshold) & (curvature < 0.0) & (np.abs(shift) <= 1.0)
    full = known.saturated.any(axis=1)
    status = np.where(found, np.where(full, Status.SATURATED, Status.VALID), Status.BELOW_THRESHOLD)
    return known.time[top] + step * shift, known.delay_sigma(gradient, records), status


def overconfident_pulse(records: Array, known: Any) -> Told:
    """The same with σ too small by 30 %."""
    delay, sigma, status = pulse_vertex(records, known)
    return delay, 0.7 * sigma, status
