"""Windows of patterns side by side: each shot reads the window of its own pattern, and rows are where they were."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from scanner_sim.render.background.view import Window, WindowsBeside, join_windows, window_heights

pytestmark = pytest.mark.usefixtures("device")

STEP, ROW_STEP = 3e-4, 7e-4
POSITIONS = [(0.1, -0.05, 2, 5), (-0.2, 0.07, 4, 3), (0.3, 0.02, 1, 6)]
SHOTS = 4


def layer(number: int, pattern: int) -> np.ndarray:
    """Return what a layer of a pattern's window holds, all unlike."""
    _, _, rows, bins = POSITIONS[pattern]
    return np.float32(1000.0 * number + 100.0 * pattern + np.arange(rows * bins))


def numbers(values: Any) -> np.ndarray:
    return np.asarray(values.numpy())


def test_each_shot_has_the_window_of_its_pattern() -> None:
    """Claim: angles, rows, bins and start are the pattern's; from the start on layers hold the bins of its window."""
    layers = [[mi.Float(layer(number, pattern)) for number in range(2)] for pattern in range(3)]
    first, phi, rows, bins, start, *joined = join_windows(POSITIONS, layers)
    beside = WindowsBeside(first, phi, rows, bins, STEP, ROW_STEP, start=start, shots=SHOTS)
    index = np.array([11, 0, 5, 3, 8, 4], np.uint32)
    found = beside.at(mi.UInt32(index))
    for place, pattern in enumerate(index // SHOTS):
        angle, height, count, across = POSITIONS[pattern]
        assert numbers(found.first)[place] == np.float32(angle)
        assert numbers(found.phi)[place] == np.float32(height)
        assert (numbers(found.rows)[place], numbers(found.bins)[place]) == (count, across)
        begin = numbers(found.start)[place]
        for number, values in enumerate(joined):
            own = numbers(values)[begin : begin + count * across]
            np.testing.assert_array_equal(own, layer(number, pattern))
    assert (found.step, found.row_step) == (STEP, ROW_STEP)
    assert dr.width(joined[0]) == sum(rows * bins for *_, rows, bins in POSITIONS)


def test_shots_lie_between_the_rows_of_their_window_and_not_beyond() -> None:
    """Claim: rows stand a step apart from the first one on, bins from the first angle; φ outside counts as the end."""
    window = Window(
        mi.Float(0.1), mi.Float(-0.05), mi.UInt32(3), mi.UInt32(5), STEP, ROW_STEP, heights=mi.Float(1.0, 2.0)
    )
    at = np.array([-1.0, 0.0, 0.25, 1.7, 2.0, 2.6])
    shots: Any = SimpleNamespace(phi=mi.Float(np.float32(-0.05 + ROW_STEP * at)[::-1]))
    index = mi.UInt32(np.arange(6, dtype=np.uint32)[::-1].copy())
    np.testing.assert_allclose(numbers(window.row(shots, index, 0)), np.clip(at, 0.0, 2.0), atol=2e-5)
    first, step, last = window.lattice()
    assert (numbers(first)[0], numbers(last)[0]) == (np.float32(0.1), 4.0)
    assert numbers(step)[0] == np.float32(STEP)


@pytest.mark.parametrize("share", [0.2, 0.45])
def test_rows_between_which_one_interpolates_blur_as_much_as_heights_lack(share: float) -> None:
    """Claim: a pixel's height without a point spread, and the triangle between rows δ apart, whose variance is
    (f δ)²/6, have h²/12 together."""
    receiver = SimpleNamespace(focal_length=0.1)
    layout: Any = SimpleNamespace(height=250e-6, point_spread=1e-12, receiver=receiver)
    whole, less = (
        float(np.var(numbers(window_heights(layout, step)).astype(np.float64)))
        for step in (0.0, share * 250e-6 / 0.1)
    )
    assert whole == pytest.approx((250e-6) ** 2 / 12.0, rel=0.05)
    assert 1.0 - less / whole == pytest.approx(12.0 * share**2 / 6.0, rel=1e-3)
