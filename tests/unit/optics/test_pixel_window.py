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
