"""Windows of a frame."""

from __future__ import annotations

import numpy as np
import pytest

from scanner_sim.optics.pixel_window import PixelWindow


def test_a_window_holds_its_pixels_and_a_margin_and_ends_with_the_frame() -> None:
    found = PixelWindow.about(np.array([[3.2, 10.0], [20.0, 30.6]]), 4.5, (40, 48))
    assert found == PixelWindow(5, 37, 0, 26)
    frame = np.zeros((40, 48))
    frame[found.where] = 1.0
    assert frame.sum() == 32 * 26


@pytest.mark.parametrize("pixels", [[[np.nan, 3.0]], [[-9.0, 3.0]], [[60.0, 3.0]]])
def test_what_is_not_in_the_frame_has_none(pixels: list[list[float]]) -> None:
    assert PixelWindow.about(np.array(pixels), 4.0, (40, 48)) is None


@pytest.mark.parametrize(("rows", "columns"), [(40, 90), (90, 40), (40, 40)])
def test_a_window_ends_at_the_last_row_and_the_last_column(rows: int, columns: int) -> None:
    """Claim: in a wide frame as in a high one, what reaches beyond it on all sides is the whole frame; a pixel in a
    corner has the corner's rows and columns; the last pixel has one, and the one behind it none."""
    shape, margin = (rows, columns), 4.0
    everything = PixelWindow.about(np.array([[-5.0, -5.0], [columns + 5.0, rows + 5.0]]), margin, shape)
    assert everything == PixelWindow(0, rows, 0, columns)
    for right in (False, True):
        for low in (False, True):
            corner = np.array([[columns - 1.0 if right else 0.0, rows - 1.0 if low else 0.0]])
            assert PixelWindow.about(corner, margin, shape) == PixelWindow(
                rows - 5 if low else 0,
                rows if low else 5,
                columns - 5 if right else 0,
                columns if right else 5,
            )
    assert PixelWindow.about(np.array([[columns - 1.0, 9.0]]), 0.0, shape) == PixelWindow(
        9, 10, columns - 1, columns
    )
    assert PixelWindow.about(np.array([[9.0, rows - 1.0]]), 0.0, shape) == PixelWindow(rows - 1, rows, 9, 10)
    for beyond in ([float(columns), 9.0], [9.0, float(rows)]):
        assert PixelWindow.about(np.array([beyond]), 0.0, shape) is None
